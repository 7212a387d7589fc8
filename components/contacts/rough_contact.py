"""Bodies that touch at all times, and rub by what they press one another with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.component import System
from acausal.language.connector import Frame
from acausal.language.expression import Expression, Variable
from acausal.language.origin import origin
from acausal.parts.contact import AbstractTouch, read
from acausal.parts.pose import symbolic
from components.contacts.laws import Coulomb, Sliding
from components.contacts.touching import Touching
from components.geometry.surfaces import AbstractSurface, checked_surface
from components.joint_friction import AbstractBorneFriction

_LOOSE = "A contact is between two bodies: connect both of its frames."


@final
class TouchFriction(AbstractBorneFriction):
    """Dry friction in both directions where the bodies of a `joint` touch, Touching(..., Sliding()), by its normal force of either sign: a part of `RoughContact`."""

    def __init__(self, joint: Touching, law: Coulomb) -> None:
        if not (isinstance(joint, Touching) and isinstance(joint.law, Sliding)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"TouchFriction's joint is {joint!r} ({origin()}). Give a Touching(shape, surface, Sliding()).")
        self.touching = joint
        self._beside(joint, law, 2)

    def rubs(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        near = self.touching.nearness()
        arm = near.point_b - symbolic(near.pose.position)
        torques = ca.horzcat(*(ca.cross(arm, near.tangents[:, k]) for k in range(2)))
        return self.touching.law.slipping()[:2, :].T, ca.vertcat(torques, near.tangents)

    def presses(self) -> Sequence[Expression]:
        return [read(self.touching.nearness().normal).T @ self.borne[1]]


@final
class RoughContact(System, AbstractTouch):
    """A body with the outside `shape`, fixed in frame_b, touches the `surface` of frame_a at all times, and slides, rolls and pivots there with
    dry friction: a RollingBall with `friction` is this.

    `joint`: Touching with five velocities, which holds also where it pulls (then runs tell). `friction`: up to the coefficient times the
    `normal_force` [N], of either sign, against the slip; rolling is where that vanishes.

        scene.contact = RoughContact(Sphere(0.1), Plane(), Coulomb(0.2))
    """

    namesakes = ("joint",)
    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, shape: AbstractSurface, surface: AbstractSurface, law: Coulomb) -> None:
        self.joint = Touching(
            checked_surface(shape, "RoughContact", "shape"), checked_surface(surface, "RoughContact"), Sliding()
        )
        self.connect(self.frame_a, self.joint.frame_a)
        self.connect(self.frame_b, self.joint.frame_b)
        self.friction = TouchFriction(self.joint, law)

    @property
    def q(self) -> Variable:
        """Coordinates, see Touching."""
        return self.joint.q

    @property
    def v(self) -> Variable:
        """Angular velocity in frame_b (3) [rad/s], and the slip along the surface's tangents (2) [m/s]."""
        return self.joint.v

    def touch(self) -> tuple[Expression, Expression]:
        return self.joint.touch()

    def ends(self) -> tuple[Frame, Frame]:
        return self.joint.ends()

    def pushed(self) -> tuple[Frame, ...]:
        return (self.joint.frame_b, self.friction.frame_b)
