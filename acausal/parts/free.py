"""Free joints: what a body that nothing holds can do."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.expression import Variable
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Pose, quaternion_from_matrix, symbolic
from acausal.parts.steps import AbstractStep, Ball, Shift


@final
class FreeJoint(AbstractStepJoint):
    """Six freedoms. q: unit quaternion R_ab (4, scalar first) and position p_ab in frame_a (3) [m];
    v: angular velocity in frame_b (3) [rad/s] and rate of the position in frame_a (3) [m/s].
    """

    q = Variable("", "unit quaternion (4), position in frame_a (3) [m]", size=7, start=(1, 0, 0, 0, 0, 0, 0))
    v = Variable("", "angular velocity in frame_b (3) [rad/s], velocity in frame_a (3) [m/s]", size=6)

    def steps(self) -> tuple[AbstractStep, ...]:
        return (Shift(slice(4, 7), slice(3, 6)), Ball(slice(0, 4), slice(0, 3)))

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return ca.vertcat(quaternion_from_matrix(symbolic(X_ab.rotation)), symbolic(X_ab.position))

    def velocities(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return ca.vertcat(w_ab_b, symbolic(X_ab.rotation) @ v_ab_b)


@final
class FreePoint(AbstractStepJoint):
    """Three freedoms of a point. q: position in frame_a (3) [m]; v: its rate [m/s]. Orientation stays that of frame_a."""

    q = Variable("m", "position in frame_a", size=3)
    v = Variable("m/s", "velocity in frame_a", size=3)

    def steps(self) -> tuple[AbstractStep, ...]:
        return (Shift(slice(0, 3), slice(0, 3)),)

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return symbolic(X_ab.position)
