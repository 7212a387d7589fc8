"""Elementary steps of joints, with closed forms: turn about an axis, slide along one, screw, translate, ball."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.parts.motion import Motion
from acausal.parts.pose import Matrix, Pose, product, quaternion_rate, rotation_about_z, rotation_from_quaternion, symbolic

_UNITS = np.eye(6)


@dataclass(frozen=True)
class AbstractStep(ABC):
    """A motion with a closed form. `q` and `v` say which entries of the joint's q and v are its own."""

    q: slice
    v: slice

    @abstractmethod
    def motion(self, q: ca.SX, v: ca.SX) -> Motion:
        """The motion for its own share of q and v."""

    def rates(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """q' of its own share."""
        return v

    def invariants(self, q: ca.SX) -> ca.SX:
        """What stays zero along every motion."""
        return ca.SX(0, 1)


@dataclass(frozen=True)
class Turn(AbstractStep):
    """Rotation by q [rad] about the third axis of `mounting` (3, 3)."""

    mounting: Matrix

    def motion(self, q: ca.SX, v: ca.SX) -> Motion:
        return _along(Pose(rotation_about_z(q), np.zeros(3)), (2,), self.mounting, v, angle=q)


@dataclass(frozen=True)
class Slide(AbstractStep):
    """Translation by q [m] along the third axis of `mounting` (3, 3)."""

    mounting: Matrix

    def motion(self, q: ca.SX, v: ca.SX) -> Motion:
        return _along(Pose(np.eye(3), ca.vertcat(0, 0, q)), (5,), self.mounting, v)


@dataclass(frozen=True)
class ScrewTurn(AbstractStep):
    """Rotation by q [rad] about, and translation by `lead` q [m] along, the third axis of `mounting` (3, 3)."""

    mounting: Matrix
    lead: float | ca.SX

    def motion(self, q: ca.SX, v: ca.SX) -> Motion:
        subspace = ca.SX(ca.DM(_UNITS[:, [2]])) + ca.SX(self.lead) * ca.SX(ca.DM(_UNITS[:, [5]]))
        pose = Pose(rotation_about_z(q), ca.vertcat(0, 0, ca.SX(self.lead) * q))
        return Motion(pose, v, subspace, subspace @ v, ca.SX(6, 1), v, None, 1.0, self.mounting)


@dataclass(frozen=True)
class Shift(AbstractStep):
    """Translation by q (3, 1) [m] in the axes of frame_a."""

    def motion(self, q: ca.SX, v: ca.SX) -> Motion:
        return _along(Pose(np.eye(3), q), (3, 4, 5), np.eye(3), v)


@dataclass(frozen=True)
class Ball(AbstractStep):
    """Rotation by the unit quaternion q (4, 1), scalar first; v is the angular velocity in frame_b [rad/s]."""

    def motion(self, q: ca.SX, v: ca.SX) -> Motion:
        moved = _along(Pose(rotation_from_quaternion(q), np.zeros(3)), (0, 1, 2), np.eye(3), v)
        return Motion(moved.pose, quaternion_rate(q, v), moved.subspace, moved.twist, moved.bias, v, moved.axes)

    def rates(self, q: ca.SX, v: ca.SX) -> ca.SX:
        return quaternion_rate(q, v)

    def invariants(self, q: ca.SX) -> ca.SX:
        return 0.5 * (ca.sumsqr(q) - 1)


def _along(pose: Pose, axes: tuple[int, ...], mounting: Matrix, v: ca.SX, angle: ca.SX | None = None) -> Motion:
    subspace = _units(axes)
    return Motion(pose, v, subspace, ca.densify(subspace @ v), ca.SX(6, 1), v, axes, 1.0, mounting, angle)


@functools.cache
def _units(axes: tuple[int, ...]) -> ca.SX:
    return ca.sparsify(ca.SX(ca.DM(_UNITS[:, list(axes)])))


def chained_pose(steps: Sequence[AbstractStep], q: ca.SX) -> Pose:
    """X_ab of the steps one after the other."""
    X = Pose.identity()
    for step in steps:
        motion = step.motion(q[step.q], ca.SX.sym("v", step.v.stop - step.v.start))
        mounting = Pose(motion.mounting, np.zeros(3))
        X = X @ mounting @ motion.pose @ mounting.inverse()
    return Pose(symbolic(X.rotation), symbolic(X.position))


def turned(mounting: Matrix, vector: Matrix) -> Matrix:
    """A vector given in the mounted frame, in the joint's frame."""
    return product(mounting, vector)
