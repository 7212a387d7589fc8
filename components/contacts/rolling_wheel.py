"""Wheels that roll on a plane, seen from axes that yaw and lean with the wheel and do not spin."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.language.expression import Expression, Scalar, Variable, scalar, sx
from acausal.parts.contact import AbstractContact, read
from acausal.parts.inertia import Inertia, is_round
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import Motion
from acausal.parts.pose import Matrix, Pose, product, rotation_about_z, rotation_to_axis, symbolic
from acausal.parts.seen import AbstractSeenAlong
from acausal.visual import shapes
from acausal.visual.geometry import vector_of
from components.geometry.net import net
from components.geometry.surfaces import Plane
from components.orientation import Axis, axis_vector, mounting

_TO_Y = rotation_to_axis(np.array([0.0, 1.0, 0.0]))
_THIN = 0.02
"""Of its radius: how thick a thin disk is drawn."""


class AbstractRollingWheel(AbstractJoint, AbstractContact, AbstractSeenAlong, ABC):
    """A body of revolution about `axis` of frame_b rolls on the plane z = 0 of frame_a without slipping; z points to the body.

    Three velocities and no multiplier in a tree (Kane's form); closing a loop, one position row (touching) and two velocity rows (no
    slip, along the heading and across it). Reactions are not limited: the contact can pull. frame_b's origin is on the axis.
    Heading axes C go with the wheel and do not spin: x along the way it rolls, y the axle, z up in the wheel's plane.
    q: yaw, lean, spin [rad], then x and y of frame_b's origin in frame_a [m]; its height follows from the shape.
    R_ab = R_z(yaw) R_x(lean) R_y(spin) R_0: at zero the wheel stands upright, `axis` along y of frame_a (R_0 takes it there and is
    the identity for axis "y"), and rolls along x. Positive yaw turns to the left; positive lean lifts the axle's positive end, so
    that the top tips to the right; positive spin rolls forward.
    v: angular velocity of frame_b against frame_a in the heading axes (3) [rad/s]: (lean', along the axle, cos(lean) yaw').
    yaw' = v[2] / cos(lean), spin' = v[1] - sin(lean) yaw'. Of a balanced wheel nothing depends on the spin, and v is constant where
    it rolls straight or around a circle. Singular only where the wheel lies flat, as the contact is.
    O'Reilly, Intermediate Dynamics for Engineers (2nd ed.), 10.8. Must provide `lowest_point` and `outside`, and an `axis` in its constructor.
    """

    if_outside = "The wheel has fallen through its plane: it does not roll on its rim any more."
    q = Variable("", "yaw, lean, spin [rad] (3); x and y of the centre in frame_a [m] (2)", size=5)
    v = Variable("rad/s", "angular velocity along the heading, the axle, and up in the wheel's plane", size=3)
    axis: np.ndarray | Expression

    @abstractmethod
    def lowest_point(self, sine: ca.SX, cosine: ca.SX) -> ca.SX:
        """Of the wheel that leans by the angle of this `sine` and `cosine` > 0: (along the axle, up in its plane) (2, 1) [m]."""

    @abstractmethod
    def outside(self) -> tuple[Any, ...]:
        """Shapes that it looks like."""

    @final
    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(Plane(), places), self.outside()

    @final
    def touch(self) -> tuple[Expression, Expression]:
        a, b = self.frame_a, self.frame_b
        sine, cosine, axes = self._seen_heading(Pose((a.rotation.T @ b.rotation).sx, np.zeros(3)))
        return b.position + b.rotation @ read(axes.T @ self._arm(sine, cosine)), a.rotation[:, 2]

    @final
    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        sine, cosine, _ = self._seen_heading(X_ab)
        return symbolic(X_ab.position)[2] + ca.dot(self.lowest_point(sine, cosine), ca.vertcat(sine, cosine))

    @final
    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        # along the heading and across it, so that what another wheel forbids already is one of the rows, and not a mixture
        sine, cosine, axes = self._seen_heading(X_ab)
        slip = axes @ v_ab_b - ca.cross(self._arm(sine, cosine), axes @ w_ab_b)
        return ca.vertcat(slip[0], cosine * slip[1] - sine * slip[2])

    @final
    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        X = self._heading(q)
        return Pose(symbolic(X.rotation) @ self._spin(q[2]), X.position)

    @final
    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        sine, cosine = ca.sin(q[1]), ca.cos(q[1])
        yaw = v[2] / cosine
        velocity = symbolic(self._heading(q).rotation) @ ca.cross(self._arm(sine, cosine), v)
        return ca.vertcat(yaw, v[0], v[1] - sine * yaw, velocity[:2])

    @final
    def domain(self, q: ca.SX) -> ca.SX:
        return ca.cos(q[1])

    @final
    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        rates = self.rates(q, v, t)
        arm = self._arm(ca.sin(q[1]), ca.cos(q[1]))
        arm_rate = ca.jtimes(arm, q[1], v[0])
        turning = ca.vertcat(v[0], v[1] - rates[2], v[2])  # angular velocity of the heading axes
        velocity = ca.cross(arm, v)
        bias_w = rates[2] * ca.vertcat(-v[2], 0, v[0])  # turning x v
        bias_v = ca.cross(arm_rate, v) + ca.cross(turning, velocity)
        subspace = ca.sparsify(ca.vertcat(ca.SX.eye(3), ca.skew(arm)))
        twist, bias = ca.vertcat(v, velocity), ca.vertcat(bias_w, bias_v)
        return (Motion(self._heading(q), rates, subspace, twist, bias, v, spin=self._spin(q[2])),)

    @final
    def coordinates(self, X_ab: Pose) -> ca.SX:
        R = symbolic(X_ab.rotation) @ symbolic(self._upright()).T
        lean = ca.atan2(R[2, 1], ca.sqrt(R[0, 1] ** 2 + R[1, 1] ** 2))
        return ca.vertcat(ca.atan2(-R[0, 1], R[1, 1]), lean, ca.atan2(-R[2, 0], R[2, 2]), symbolic(X_ab.position)[:2])

    @final
    def velocities(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return self._spin(self.coordinates(X_ab)[2]) @ w_ab_b

    @final
    def looks_turned_round(self, behind_a: Inertia) -> bool:
        return not isinstance(self.axis, Expression) and is_round(behind_a, self.axis)

    def _heading(self, q: ca.SX) -> Pose:
        """X_aC of the heading axes at the wheel's centre."""
        sine, cosine = ca.sin(q[1]), ca.cos(q[1])
        lean = ca.SX(3, 3)
        lean[0, 0], lean[1, 1], lean[1, 2], lean[2, 1], lean[2, 2] = 1, cosine, -sine, sine, cosine
        arm = self._arm(sine, cosine)
        return Pose(rotation_about_z(q[0]) @ lean, ca.vertcat(q[3:5], -(sine * arm[1] + cosine * arm[2])))

    def _seen_heading(self, X_ab: Pose) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Sine and cosine of the lean, and R_Cb of the heading axes, whatever the spin."""
        e, n = sx(self.axis), symbolic(X_ab.rotation)[2, :].T
        sine = ca.dot(e, n)
        across = n - e * sine
        cosine = ca.norm_2(across)
        up = across / cosine
        return sine, cosine, ca.horzcat(ca.cross(e, up), e, up).T

    def _arm(self, sine: ca.SX, cosine: ca.SX) -> ca.SX:
        """From the centre to the point of contact, in heading axes (3, 1) [m]."""
        return ca.vertcat(0, self.lowest_point(sine, cosine))

    def _spin(self, angle: ca.SX) -> ca.SX:
        """R_Cb: frame_b in the heading axes."""
        return symbolic(product(product(_TO_Y, rotation_about_z(angle)), product(_TO_Y.T, self._upright())))

    def _upright(self) -> Matrix:
        """R_0, which takes the axis to y."""
        axis = self.axis
        turned = Expression(symbolic(_TO_Y.T) @ axis.sx, axis.leaves) if isinstance(axis, Expression) else _TO_Y.T @ axis
        return product(product(_TO_Y, mounting(turned).T), _TO_Y.T)


@final
class RollingDisk(AbstractRollingWheel):
    """A thin disk of `radius` [m] > 0 about `axis`, with its centre at frame_b, rolls on its edge on the plane z = 0 of frame_a.

    scene.contact = RollingDisk(radius=0.3, axis="y")
    """

    def __init__(self, radius: Scalar, axis: Axis = "y") -> None:
        self.radius = scalar(radius, "RollingDisk's radius", positive=True, unit="m")
        self.axis = axis_vector(axis, "RollingDisk's axis")

    def lowest_point(self, sine: ca.SX, cosine: ca.SX) -> ca.SX:
        return ca.vertcat(0, -sx(self.radius))

    def outside(self) -> tuple[Any, ...]:
        radius, axis = self.radius, self.axis
        if not (isinstance(radius, float) and isinstance(axis, np.ndarray)):
            return ()
        return (shapes.Disk(radius, _THIN * radius, vector_of(axis)),)


@final
class RollingTorus(AbstractRollingWheel):
    """A wheel with a round rim: circle of `radius` about `axis` with a tube of radius `tube` [m] > 0 rolls on the plane z = 0 of frame_a.

    scene.contact = RollingTorus(radius=0.3, tube=0.02, axis="y")
    """

    def __init__(self, radius: Scalar, tube: Scalar, axis: Axis = "y") -> None:
        self.radius = scalar(radius, "RollingTorus's radius", positive=True, unit="m")
        self.tube = scalar(tube, "RollingTorus's tube", positive=True, unit="m")
        self.axis = axis_vector(axis, "RollingTorus's axis")

    def lowest_point(self, sine: ca.SX, cosine: ca.SX) -> ca.SX:
        return ca.vertcat(-sx(self.tube) * sine, -sx(self.radius) - sx(self.tube) * cosine)

    def outside(self) -> tuple[Any, ...]:
        radius, tube, axis = self.radius, self.tube, self.axis
        if not (isinstance(radius, float) and isinstance(tube, float) and isinstance(axis, np.ndarray)):
            return ()
        return (shapes.Torus(radius, tube, vector_of(axis)),)
