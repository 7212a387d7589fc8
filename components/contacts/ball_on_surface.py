"""Balls that roll on curved surfaces: the centre glides on the parallel surface."""

from __future__ import annotations

from typing import Any, final

import casadi as ca
import numpy as np

from acausal.language.expression import Expression, Scalar, Variable, scalar, sx
from acausal.parts.contact import AbstractContact
from acausal.parts.inertia import Inertia, is_round
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import Motion
from acausal.parts.pose import Pose, quaternion_rate, rotation_from_quaternion
from acausal.parts.seen import AbstractSeenAlong
from components.contacts.laws import Rolling
from components.contacts.meeting import on_surface, solved
from components.contacts.nearness import nearness, touched
from components.geometry.net import net
from components.geometry.surfaces import APEX, AbstractSurface, Sphere, checked_surface


@final
class RollingBallOnSurface(AbstractJoint, AbstractContact, AbstractSeenAlong):
    """A ball of `radius` [m] > 0 with its centre at frame_b rolls without slipping on a `surface` fixed in frame_a, on the side of its normal.

    Three velocities and no multiplier. q: unit quaternion of R_ab (4, scalar first), then the surface's coordinates of the point that touches; v: angular
    velocity of frame_b against frame_a, in frame_a (3) [rad/s]. Only while the ball fits the surface: 1 + radius * curvature > 0 in all directions,
    which `domain` says. The contact can pull. On a plane `RollingBall` has the same motion with fewer operations.

        scene.contact = RollingBallOnSurface(radius=0.05, surface=Sphere(0.4, inside_out=True))
    """

    if_outside = "The ball is larger than the hollow that it lies in, or the surface ends there."
    if_singular = APEX
    q = Variable("", "unit quaternion, scalar first (4); coordinates of the surface", size=6, start=(1.0, 0, 0, 0, 0, 0))
    v = Variable("rad/s", "angular velocity in frame_a", size=3)

    def __init__(self, radius: Scalar, surface: AbstractSurface) -> None:
        self.radius = scalar(radius, "RollingBallOnSurface's radius", positive=True, unit="m")
        self.surface = checked_surface(surface, "RollingBallOnSurface")
        start = (1.0, 0.0, 0.0, 0.0, *surface.start)
        self._declare("q", "", len(start), start)

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(rotation_from_quaternion(q[:4]), self._centre(q[4:]))

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(self.surface, places), net(Sphere(self.radius), np.zeros((1, 3)), None)

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        turned = rotation_from_quaternion(q[:4]).T @ v
        return ca.vertcat(quaternion_rate(q[:4], turned), self.surface.rates(q[4:], self._gliding(q, v)))

    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        return ca.vertcat(0.5 * (ca.sumsqr(q[:4]) - 1), self.surface.invariants(q[4:]))

    def domain(self, q: ca.SX) -> ca.SX:
        stretch = self._stretch(q[4:])  # of the parallel surface: 1 + radius * curvature in its directions
        return ca.vertcat(ca.det(stretch), ca.trace(stretch) / 2, self.surface.inside(q[4:]))

    def regular(self, q: ca.SX) -> ca.SX:
        return self.surface.regular(q[4:])

    def turns(self) -> tuple[bool, ...]:
        return (*(True,) * 4, *self.surface.turns)

    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        rates, normal = self.rates(q, v, t), self.surface.normal(q[4:])
        arm = -sx(self.radius) * normal  # to the point that touches
        arm_rate = -sx(self.radius) * (self.surface.slopes(q[4:]) @ self.surface.curvature(q[4:]) @ self._gliding(q, v))
        twist, bias = ca.vertcat(v, ca.cross(arm, v)), ca.vertcat(ca.SX.zeros(3), ca.cross(arm_rate, v))
        subspace = ca.vertcat(ca.SX.eye(3), ca.skew(arm))
        X = Pose(np.eye(3), self._centre(q[4:]))
        return (Motion(X, rates, subspace, twist, bias, v, spin=rotation_from_quaternion(q[:4])),)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX | None:
        near = nearness(Sphere(self.radius), self.surface, X_ab)
        return None if near is None else near.gap

    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        near = nearness(Sphere(self.radius), self.surface, X_ab)
        return ca.SX(0, 1) if near is None else Rolling().forbidden(near, w_ab_b, v_ab_b)

    def touch(self) -> tuple[Expression, Expression]:
        found = touched(Sphere(self.radius), self.surface, self.frame_a, self.frame_b)
        return found or on_surface(self.surface, self.q[4:], self.frame_a)

    def looks_turned_round(self, behind_a: Inertia) -> bool:
        return is_round(behind_a)

    def _centre(self, q: ca.SX) -> ca.SX:
        return self.surface.point(q) + sx(self.radius) * self.surface.normal(q)

    def _stretch(self, q: ca.SX) -> ca.SX:
        return ca.SX.eye(2) + sx(self.radius) * self.surface.curvature(q)

    def _gliding(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """Velocities (2, 1) of the point that touches, on the surface: the centre moves by slopes (1 + radius W) times them."""
        surface = self.surface
        centre = ca.cross(v, sx(self.radius) * surface.normal(q[4:]))
        return solved(surface.metric(q[4:]) @ self._stretch(q[4:]), surface.slopes(q[4:]).T @ centre)
