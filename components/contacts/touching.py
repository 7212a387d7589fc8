"""A body of any shape that touches a surface of any shape: a joint in least velocities."""

from __future__ import annotations

from typing import final

import casadi as ca
import numpy as np

from acausal.language.expression import Expression, Parameter, Variable, declared_in
from acausal.parts.contact import AbstractContact
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import Motion
from acausal.parts.pose import Pose, symbolic
from components.contacts.laws import AbstractTouchingLaw, Rolling, checked_law
from components.contacts.meeting import meeting, on_surface
from components.geometry.surfaces import AbstractSurface, checked_surface


@final
class Touching(AbstractJoint, AbstractContact):
    """A body with the outside `shape`, fixed in frame_b, touches the `surface` fixed in frame_a in one point, on the side of its normal.

    `law`: Rolling() (three velocities), RollingWithoutPivoting() (two), Sliding() (five); no multiplier.
    A shape that is known by its point for each normal (Sphere, Ellipsoid, Disk, Torus, ConvexShape) has q: unit quaternion of R_ab (4, scalar
    first), then the coordinates of the touching point on the surface. Any other (Cylinder, Cone, Revolution, ParametricSurface) has q: coordinates
    of that point on the shape, the angle from the surface's first tangent to the shape's [rad], and its coordinates on the surface.
    v: angular velocity of frame_b against frame_a, in frame_b (3) [rad/s], or what the law says.
    Only while the shape is curved more than the surface in all directions, which `domain` says. The contact can pull.
    D. J. Montana, The kinematics of contact and grasp, Int. J. Robotics Research 7 (1988).

        scene.contact = Touching(Ellipsoid((0.2, 0.1, 0.1)), Sphere(0.5))
    """

    if_outside = "The body is curved less than the hollow that it lies in, or both are flat, or it touches in more than one point, or one of them ends."
    q = Variable("", "coordinates of the body, then of the touching point on the surface", size=6)
    v = Variable("rad/s", "angular velocity in frame_b", size=3)

    def __init__(self, shape: AbstractSurface, surface: AbstractSurface, law: AbstractTouchingLaw | None = None) -> None:
        self.shape, self.surface = checked_surface(shape, "Touching", "shape"), checked_surface(surface, "Touching")
        self.law = checked_law(Rolling() if law is None else law, "Touching")
        self._meeting = meeting(shape, surface)
        start = _start(shape, surface)
        self._own, self._place = slice(0, len(self._meeting.start)), slice(len(self._meeting.start), len(start))
        self._declare("q", "", len(start), start)
        self._declare("v", self.law.unit, self.law.freedoms)

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        own, place = q[self._own], q[self._place]
        R = self._meeting.rotation(own, place)
        return Pose(R, self.surface.point(place) - R @ self._meeting.arm(own, place))

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        own, place = q[self._own], q[self._place]
        w, slip = self._turning(q, v), self._slip(q, v)
        u = self._meeting.gliding(own, place, w, slip)
        return ca.vertcat(self._meeting.rates(own, place, w, slip, u), self.surface.rates(place, u))

    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        return ca.vertcat(self._meeting.invariants(q[self._own]), self.surface.invariants(q[self._place]))

    def domain(self, q: ca.SX) -> ca.SX:
        return ca.vertcat(self._meeting.fit(q[self._own], q[self._place]), self.surface.inside(q[self._place]))

    def turns(self) -> tuple[bool, ...]:
        return (*self._meeting.turns, *self.surface.turns)

    def touch(self) -> tuple[Expression, Expression]:
        return on_surface(self.surface, self.q[self._place], self.frame_a)

    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        own, place = q[self._own], q[self._place]
        X = self.pose(q, t)
        R, arm, w, slip = symbolic(X.rotation), self._meeting.arm(own, place), self._turning(q, v), self._slip(q, v)
        u = self._meeting.gliding(own, place, w, slip)
        tangents = self._tangents(q)
        turning, slipping = self.law.turning(tangents), tangents @ self.law.slipping()
        subspace = ca.sparsify(ca.vertcat(turning, ca.skew(arm) @ turning + slipping))
        velocity = ca.cross(arm, w) + slipping @ v
        arm_rate = R.T @ (self.surface.slopes(place) @ u - slip)
        # rates of the tangents in frame_b, of which the law makes velocities
        turned = R.T @ self._tangents_rate(place, u) - ca.cross(ca.horzcat(w, w), tangents)
        bias_w = (self.law.turning(turned) - self.law.turning(ca.SX(3, 2))) @ v
        bias_v = ca.cross(arm_rate, w) + ca.cross(arm, bias_w) + turned @ self.law.slipping() @ v + ca.cross(w, velocity)
        return (Motion(X, self.rates(q, v, t), subspace, ca.vertcat(w, velocity), ca.vertcat(ca.densify(bias_w), bias_v), v),)

    def _tangents(self, q: ca.SX) -> ca.SX:
        """Of the surface, in frame_b."""
        return self._meeting.rotation(q[self._own], q[self._place]).T @ self.surface.tangents(q[self._place])

    def _tangents_rate(self, place: ca.SX, u: ca.SX) -> ca.SX:
        """In frame_a, where the touching point glides over the surface with u."""
        surface = self.surface
        tangents, turn = surface.tangents(place), surface.connection(place) @ u
        normal_rate = surface.slopes(place) @ surface.curvature(place) @ u
        about = ca.horzcat(turn * tangents[:, 1], -turn * tangents[:, 0])
        return about - surface.normal(place) @ (tangents.T @ normal_rate).T

    def _turning(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """Angular velocity in frame_b."""
        return self.law.turning(self._tangents(q)) @ v

    def _slip(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """Velocity of the body's point over the surface, in frame_a."""
        return self.surface.tangents(q[self._place]) @ (self.law.slipping() @ v)


def _start(shape: AbstractSurface, surface: AbstractSurface) -> tuple[float, ...]:
    """Coordinates where a search for start values begins; they may depend on parameters as they are."""
    place = surface.start_for(float(np.linalg.norm(_value(shape.point(ca.SX(ca.DM(shape.start)))))))
    own = meeting(shape, surface).start
    normal = _value(surface.normal(ca.SX(ca.DM(place))))
    if len(own) == 4 and not np.all(_value(shape.single(ca.SX(ca.DM(-normal)))) > 0.5):
        # a wheel stands: the half turn about the middle between its normal and that of the ground
        middle = _value(shape.normal(ca.SX(ca.DM(shape.start)))) - normal
        own = (0.0, *(middle / np.linalg.norm(middle)))
    return (*own, *place)


def _value(column: ca.SX) -> np.ndarray:
    """(n,) with parameters as they are."""
    known = [symbol for symbol in declared_in(column) if isinstance(symbol, Parameter)]
    given = ca.vertcat(ca.SX(0, 1), *(symbol.sx for symbol in known))
    return np.array(ca.Function("value", [given], [ca.densify(column)])([symbol.value for symbol in known])).ravel()
