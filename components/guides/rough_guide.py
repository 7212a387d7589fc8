"""Guides that hold on both sides, and rub."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.component import System
from acausal.language.connector import Frame
from acausal.language.expression import Expression, Variable, sx, time
from acausal.language.origin import origin
from acausal.parts.contact import read
from acausal.parts.joint import AbstractJoint
from components.contacts.laws import Coulomb
from components.geometry.curves import AbstractCurve
from components.geometry.surfaces import AbstractSurface
from components.joint_friction import AbstractBorneFriction

_LOOSE = "A guide leads something: connect both."


@final
class GuideFriction(AbstractBorneFriction):
    """Dry friction of a `joint` that leads frame_b's origin along `place`, a curve or a surface of frame_a, by the force across it, of two components at a curve, of either
    sign at a surface: a part of `RoughGuide`.
    """

    def __init__(self, joint: AbstractJoint, place: AbstractCurve | AbstractSurface, law: Coulomb) -> None:
        _check(joint, place, "GuideFriction")
        self.place = place
        self._beside(joint, law, 1 if isinstance(place, AbstractCurve) else 2)

    def rubs(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        if isinstance(self.place, AbstractCurve):
            s = ca.SX.sym("s")
            slope = ca.substitute(ca.jacobian(self.place.point(s), s), s, q)
            speed = ca.norm_2(slope)
            return speed, ca.vertcat(ca.SX.zeros(3), slope / speed)
        at = self._at(q)
        tangents = self.place.tangents(at)
        slips = self.place.slopes(at).T @ tangents
        return ca.vertcat(ca.SX(self.v.size - 2, 2), slips), ca.vertcat(ca.SX.zeros(3, 2), tangents)

    def presses(self) -> Sequence[Expression]:
        force = self.borne[1]
        return [force] if isinstance(self.place, AbstractCurve) else [read(self.place.normal(self._at(self.q.sx))).T @ force]

    def _at(self, q: ca.SX) -> ca.SX:
        """Coordinates on the surface, the last ones of the joint."""
        return q[q.numel() - len(self.place.start) :] if isinstance(self.place, AbstractSurface) else q


@final
class RoughGuide(System):
    """frame_b's origin on a curve or a surface of frame_a, on both sides, with dry friction: PointOnCurve, PointOnSurface and PointOnPlane with
    `friction`, and without unilateral=True, are this.

    The friction is limited by the coefficient times the size of the `normal_force` (3, 1) [N], which the guide exerts across itself, in frame_a's axes;
    it sticks, and slips as a Coulomb law says. `q`, `v`: as of the guide, `joint`.

        scene.wire = PointOnCurve(Circle(0.5), friction=Coulomb(0.3))
    """

    namesakes = ("joint",)
    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, joint: AbstractJoint, place: AbstractCurve | AbstractSurface, law: Coulomb) -> None:
        _check(joint, place, "RoughGuide")
        self.joint = joint
        self.connect(self.frame_a, joint.frame_a)
        self.connect(self.frame_b, joint.frame_b)
        self.friction = GuideFriction(joint, place, law)

    @property
    def q(self) -> Variable:
        """Coordinates of the place."""
        return self.joint.q

    @property
    def v(self) -> Variable:
        """Their velocities."""
        return self.joint.v

    @property
    def normal_force(self) -> Expression:
        """What the guide exerts on frame_b across itself (3, 1) [N], in frame_a's axes."""
        return self.friction.borne[1]


def _check(joint: object, place: object, part: str) -> None:
    """Raises `ParameterError` for what is no guide, and for one that changes with time."""
    if not isinstance(joint, AbstractJoint):
        raise ParameterError(
            f"{part}'s joint is {joint!r} ({origin()}). Give what leads a point along the place, e.g. PointOnCurve(...)."
        )
    if not isinstance(place, AbstractCurve | AbstractSurface):
        raise ParameterError(f"{part}'s place is {place!r} ({origin()}). Give the joint's curve or surface, e.g. Circle(0.5).")
    q = ca.SX.sym("q", 1 if isinstance(place, AbstractCurve) else len(place.start))
    if ca.depends_on(sx(place.point(q)), time.sx):
        raise ParameterError(
            f"{part}'s {type(place).__name__} changes with time ({origin()}): what slips along it is not known. Let frame_a move, on a PrescribedMotion."
        )
