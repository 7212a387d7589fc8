"""Dry friction in joints and guides that hold on both sides, by what they bear."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import IncompatibleError, ParameterError
from acausal.language.component import add_connection
from acausal.language.connector import Frame
from acausal.language.expression import Expression, Magnitude, Reaction, Scalar, scalar, sx
from acausal.language.mode_laws import DryFriction, ModeLaw, together
from acausal.language.origin import origin
from acausal.parts.contact import read
from acausal.parts.force import AbstractReactiveForce, Action, at_ends
from acausal.parts.joint import AbstractJoint
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic
from components.contacts.laws import Coulomb
from components.joints.cylindrical import Cylindrical
from components.joints.planar import Planar
from components.joints.prismatic import Prismatic
from components.joints.revolute import Revolute
from components.joints.screw import Screw


class AbstractBorneFriction(AbstractReactiveForce, ABC):
    """Dry friction at a joint, which it acts beside, limited by what that bears. Must provide `rubs` and `presses`, and call `_beside`.

    `drag`: reactions with which frame_b is driven forward against frame_a, one for each column of `rubs`.
    """

    frame_a = Frame.port()
    frame_b = Frame.port()
    joint: AbstractJoint
    law: Coulomb
    drag: tuple[Reaction, ...]

    def _beside(self, joint: AbstractJoint, law: object, directions: int, unit: str = "N") -> None:
        """Raises `ParameterError` for what is no joint, and no friction law."""
        if not isinstance(joint, AbstractJoint):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"{type(self).__name__}'s joint is {joint!r} ({origin()}). Give the joint that it is beside.")
        if not isinstance(law, Coulomb):
            raise ParameterError(f"{type(self).__name__}'s law is {shown(law)} ({origin()}). Give Coulomb(0.1).")
        if (law.patch is not None) != (directions == 3):
            what = (
                "rubs as a patch: give Coulomb(0.1, patch=Patch(radius))"
                if directions == 3
                else "does not spin: leave out the law's patch"
            )
            raise ParameterError(f"{type(self).__name__} of a {type(joint).__name__} {what} ({origin()}).")
        self.joint, self.law = joint, law
        self.q, self.v = joint.q, joint.v
        self.drag = tuple(Reaction(unit, "friction, along the slip") for _ in range(directions))
        add_connection(self, joint.frame_a, self.frame_a)
        add_connection(self, joint.frame_b, self.frame_b)

    @abstractmethod
    def rubs(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(nv, k): slips by the joint's v; (6, k): wrenches by the drags, torque first, on what is at frame_b, about its origin, in frame_a's axes."""

    @abstractmethod
    def presses(self) -> Sequence[Expression]:
        """Forces [N] or torques [N*m], of one to three components, the sum of whose magnitudes presses; times the coefficient it is the limit."""

    @property
    def borne(self) -> tuple[Expression, Expression]:
        """Torque and force (3, 1) that the joint exerts on what is at frame_b, about its origin, in frame_a's axes."""
        back = self.frame_a.rotation.T
        return -(back @ self.joint.frame_b.torque), -(back @ self.joint.frame_b.force)

    @final
    def laws(self) -> Iterable[ModeLaw]:
        sizes = [Magnitude(force) for force in self.presses()]
        load = sum(sizes[1:], 1.0 * sizes[0])
        slip = read(self.rubs(self.q.sx)[0].T @ self.v.sx)
        pressure = None if self.law.patch is None else self.law.patch.pressure
        yield DryFriction(together(self.drag), slip, self.law.mu * load, self.law.static * load, pressure=pressure)

    @final
    def actions(self, placement: Placement) -> tuple[Action, ...]:
        wrench = self.rubs(self.q.sx)[1] @ ca.vertcat(*(drag.sx for drag in self.drag))
        return at_ends(placement, self.frame_a, self.frame_b, wrench[3:], wrench[:3])


@final
class JointFriction(AbstractBorneFriction):
    """Dry friction of a joint by the force that it truly bears, of two components where these are two: beside a Revolute, Prismatic,
    Cylindrical, Screw or Planar.

    `law`: Coulomb(mu, static), with N below; `drag`: what drives frame_b forward, against the slip where it slips.

    - Revolute, a plain bearing of `radius` [m]: torque up to mu radius N, N the force across the axis; with a `collar` [m], besides mu
      collar times the force along it.
    - Prismatic: force up to mu N, N across the axis. Cylindrical, a sleeve of `radius`: along it and around it together.
    - With `length` [m] a bearing or slide bears at its ends: N = |F/2 + F'| + |F/2 - F'|, with a couple F' length across the axis, as
      where a drawer jams.
    - Planar, a disk that slides and spins: `law` with a `patch` about frame_b, N the force along the normal.
    - Screw with a square thread of mean `radius`: along the thread, N across its flank; held by itself where the lead's slope is below mu.

        scene.bearing = JointFriction(scene.hinge, Coulomb(0.1), radius=0.02)
    """

    def __init__(
        self, joint: Revolute | Prismatic | Cylindrical | Screw | Planar, law: Coulomb, radius: Scalar | None = None, collar: Scalar | None = None, length: Scalar | None = None
    ) -> None:  # fmt: skip
        if not isinstance(joint, Revolute | Prismatic | Cylindrical | Screw | Planar):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise IncompatibleError(
                f"JointFriction is beside a Revolute, Prismatic, Cylindrical, Screw or Planar, and was given {joint!r} ({origin()}). Give the joint: scene.hinge."
            )
        needs = not isinstance(joint, Prismatic | Planar)
        name = type(joint).__name__
        self.radius = _measure(radius, "radius", name, needs, needs)
        self.collar = _measure(collar, "collar", name, isinstance(joint, Revolute), False)
        self.length = _measure(length, "length", name, not isinstance(joint, Screw | Planar), False)
        self._beside(
            joint,
            law,
            3 if isinstance(joint, Planar) else 1 + isinstance(joint, Cylindrical),
            "N*m" if isinstance(joint, Revolute) else "N",
        )

    def rubs(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        joint, axis, none, r = self.joint, self._axes[:, 2], ca.SX.zeros(3), ca.SX(_plain(self.radius))
        if isinstance(joint, Revolute):
            return ca.SX(1), ca.vertcat(axis, none)
        if isinstance(joint, Planar):
            assert self.law.patch is not None
            edge = sx(self.law.patch.radius)
            return ca.diag(ca.vertcat(1, 1, edge)), ca.diagcat(edge * axis, self._axes[:, :2])[:, [1, 2, 0]]
        if isinstance(joint, Prismatic):
            return ca.SX(1), ca.vertcat(none, axis)
        if isinstance(joint, Cylindrical):
            return ca.diag(ca.vertcat(r, 1)), ca.horzcat(ca.vertcat(r * axis, none), ca.vertcat(none, axis))
        along = self._along_thread
        return along, ca.vertcat(r * r / along * axis, self._lead / along * axis)

    def presses(self) -> Sequence[Expression]:
        torque, force = self.borne
        axis, across = read(self._axes[:, 2]), read(self._axes[:, :2].T)
        if isinstance(self.joint, Planar):
            return [axis.T @ force]
        r = _expression(self.radius) if isinstance(self.joint, Revolute | Screw) else 1.0
        if isinstance(self.joint, Screw):
            return [read(self._along_thread) / r * (axis.T @ force)]
        radial = r * (across @ force)
        found = [radial]
        if self.length is not None:
            couple = r / self.length * (across @ read(ca.skew(axis.sx)) @ torque)
            found = [0.5 * radial - couple, 0.5 * radial + couple]
        if self.collar is not None:
            found.append(self.collar * (axis.T @ force))
        return found

    @property
    def _axes(self) -> ca.SX:
        """(3, 3), the last one along the joint's axis."""
        joint = self.joint
        assert isinstance(joint, Revolute | Prismatic | Cylindrical | Screw | Planar)
        return symbolic(joint.mounting())

    @property
    def _lead(self) -> ca.SX:
        """Of a screw's thread [m/rad]."""
        assert isinstance(self.joint, Screw)
        return ca.SX(_plain(self.joint.pitch)) / (2 * np.pi)

    @property
    def _along_thread(self) -> ca.SX:
        """Way along the thread by the angle [m/rad]."""
        return ca.sqrt(ca.SX(_plain(self.radius)) ** 2 + self._lead**2)


def _measure(value: Scalar | None, what: str, joint: str, has: bool, needs: bool) -> float | Expression | None:
    """A length of a joint's bearing. Raises `ParameterError`."""
    if value is None:
        if needs:
            raise ParameterError(
                f"JointFriction of a {joint} needs its 'radius' [m] ({origin()}), at which it rubs: JointFriction(joint, Coulomb(0.1), radius=0.02)."
            )
        return None
    if not has:
        raise ParameterError(f"JointFriction's {what} is {value!r}, and a {joint} has none ({origin()}). Leave it out.")
    return scalar(value, f"JointFriction's {what}", positive=True, unit="m")


def _plain(value: float | Expression | None) -> ca.SX | float:
    return value.sx if isinstance(value, Expression) else 0.0 if value is None else value


def _expression(value: float | Expression | None) -> float | Expression:
    assert value is not None
    return value
