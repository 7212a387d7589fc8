"""Balls and ellipsoids that roll on a plane: any orientation is as good as any other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Literal, Self, final, overload

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.construction import checked_new
from acausal.language.expression import Expression, Scalar, Variable, scalar, sx, vector
from acausal.language.origin import origin
from acausal.parts.contact import AbstractContact, read
from acausal.parts.inertia import Inertia, is_round
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import Motion
from acausal.parts.pose import Pose, quaternion_from_matrix, quaternion_rate, rotation_from_quaternion, symbolic
from acausal.parts.seen import AbstractSeenAlong
from components.contacts.hard_contact import HardContact
from components.contacts.laws import Coulomb
from components.contacts.one_sided_point import hard_law
from components.contacts.rough_contact import RoughContact
from components.geometry.net import net
from components.geometry.shapes import Ellipsoid
from components.geometry.surfaces import AbstractSurface, Plane, Sphere


class AbstractRollingBody(AbstractJoint, AbstractContact, AbstractSeenAlong, ABC):
    """A convex body, fixed in frame_b, rolls on the plane z = 0 of frame_a without slipping; z points to the body.

    Three velocities and no multiplier in a tree (Kane's form); closing a loop, one position row (touching) and two velocity rows
    (no slip, along x and y). Reactions are not limited: the contact can pull.
    q: unit quaternion of R_ab (4, scalar first), then x and y of frame_b's origin in frame_a [m]; its height follows from the
    shape. v: angular velocity of frame_b against frame_a, in frame_b (3) [rad/s]. Must provide `contact_point` and `outside`.
    """

    q = Variable(
        "", "unit quaternion, scalar first (4); x and y of the centre in frame_a (2) [m]", size=6, start=(1.0, 0, 0, 0, 0, 0)
    )
    v = Variable("rad/s", "angular velocity in frame_b", size=3)

    @abstractmethod
    def contact_point(self, n: ca.SX) -> ca.SX:
        """The body's lowest point (3, 1) [m] in frame_b, when the unit vector `n` (3, 1) of frame_b points up."""

    @abstractmethod
    def outside(self) -> AbstractSurface:
        """What it looks like."""

    @final
    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(Plane(), places), net(self.outside(), np.zeros((1, 3)), None)

    @final
    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        R = rotation_from_quaternion(q[:4])
        n = R[2, :].T
        return Pose(R, ca.vertcat(q[4], q[5], -ca.dot(n, self.contact_point(n))))

    @final
    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        R = rotation_from_quaternion(q[:4])
        velocity = R @ ca.cross(self.contact_point(R[2, :].T), v)
        return ca.vertcat(quaternion_rate(q[:4], v), velocity[:2])

    @final
    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        return 0.5 * (ca.sumsqr(q[:4]) - 1)

    @final
    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        X = self.pose(q, t)
        n = symbolic(X.rotation)[2, :].T
        normal = ca.SX.sym("n", 3)
        c_of_n = self.contact_point(normal)
        c = ca.substitute(c_of_n, normal, n)
        c_rate = ca.substitute(ca.jtimes(c_of_n, normal, ca.cross(normal, v)), normal, n)
        velocity = ca.cross(c, v)
        bias = ca.cross(v, velocity) + ca.cross(c_rate, v)
        subspace = ca.vertcat(ca.SX.eye(3), ca.skew(c))
        return (Motion(X, self.rates(q, v, t), subspace, ca.vertcat(v, velocity), ca.vertcat(ca.SX.zeros(3), bias), v),)

    @final
    def touch(self) -> tuple[Expression, Expression]:
        b, up = self.frame_b, self.frame_a.rotation[:, 2]
        return b.position + b.rotation @ read(self.contact_point((b.rotation.T @ up).sx)), up

    @final
    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        n = symbolic(X_ab.rotation)[2, :].T
        return symbolic(X_ab.position)[2] + ca.dot(n, self.contact_point(n))

    @final
    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        R = symbolic(X_ab.rotation)
        slip = v_ab_b + ca.cross(w_ab_b, self.contact_point(R[2, :].T))
        return R[:2, :] @ slip

    @final
    def coordinates(self, X_ab: Pose) -> ca.SX:
        return ca.vertcat(quaternion_from_matrix(symbolic(X_ab.rotation)), symbolic(X_ab.position)[:2])

    @final
    def velocities(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return w_ab_b


@final
class RollingBall(AbstractRollingBody):
    """A ball of `radius` [m] > 0 with its centre at frame_b rolls on the plane z = 0 of frame_a.

    `friction`: Coulomb(...): it slides and rolls, held to the plane, see RoughContact. `unilateral`: it lifts off and strikes too, with `restitution`, see
    HardContact; smooth without `friction`.

    scene.contact = RollingBall(radius=0.1)
    """

    @overload
    def __new__(cls, radius: Scalar) -> Self: ...
    @overload
    def __new__(cls, radius: Scalar, *, friction: Coulomb) -> RoughContact: ...
    @overload
    def __new__(
        cls, radius: Scalar, *, unilateral: Literal[True], friction: Coulomb | None = None, restitution: Scalar = 0.0
    ) -> HardContact: ...
    @checked_new
    def __new__(
        cls, radius: Scalar, *, friction: Coulomb | None = None, unilateral: bool = False, restitution: Scalar = 0.0
    ) -> Any:
        law = hard_law("RollingBall", unilateral, restitution, friction)
        if law is None and friction is None:
            return super().__new__(cls, radius)
        ball = Sphere(scalar(radius, "RollingBall's radius", positive=True, unit="m"))
        return HardContact(ball, Plane(), law) if law is not None else RoughContact(ball, Plane(), friction or Coulomb(0.0))

    def __init__(
        self, radius: Scalar, *, friction: None = None, unilateral: Literal[False] = False, restitution: Scalar = 0.0
    ) -> None:
        self.radius = scalar(radius, "RollingBall's radius", positive=True, unit="m")

    def contact_point(self, n: ca.SX) -> ca.SX:
        return -sx(self.radius) * n

    def outside(self) -> Sphere:
        return Sphere(self.radius)

    def looks_turned_round(self, behind_a: Inertia) -> bool:
        return is_round(behind_a)


@final
class RollingEllipsoid(AbstractRollingBody):
    """An ellipsoid with `semi_axes` (3,) [m] > 0 along the axes of frame_b, its centre at frame_b, rolls on the plane z = 0 of frame_a.

    scene.contact = RollingEllipsoid(semi_axes=(0.2, 0.03, 0.02))
    """

    def __init__(self, semi_axes: Scalar) -> None:
        self.semi_axes = vector(semi_axes, "RollingEllipsoid's semi_axes", unit="m")
        if isinstance(self.semi_axes, np.ndarray) and np.any(self.semi_axes <= 0):
            raise ParameterError(f"RollingEllipsoid's semi_axes are {self.semi_axes} ({origin()}). They must be positive.")

    def contact_point(self, n: ca.SX) -> ca.SX:
        squares = sx(self.semi_axes) ** 2
        return -squares * n / ca.sqrt(ca.dot(squares * n, n))

    def outside(self) -> Ellipsoid:
        return Ellipsoid(self.semi_axes)
