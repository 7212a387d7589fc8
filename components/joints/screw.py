"""A screw."""

from __future__ import annotations

import math
from typing import final

import casadi as ca

from acausal.language.connector import Rotational
from acausal.language.expression import Expression, Scalar, Variable, scalar
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Matrix, Pose, symbolic
from acausal.parts.steps import AbstractStep, ScrewTurn
from components.orientation import Axis, axis_vector, mounting


@final
class Screw(AbstractStepJoint):
    """frame_b turns by q [rad] about `axis` and moves on by `pitch` [m] a turn along it. One freedom.

    v = q' [rad/s]. A positive pitch is a right-handed thread; it must not be zero in a closed loop.
    `flange` (rotational) carries a torque about the axis: phi = q.

        scene.spindle = Screw(axis="x", pitch=0.005)
    """

    flange = Rotational.port()
    q = Variable("rad", "angle")
    v = Variable("rad/s", "angular velocity")

    def __init__(self, axis: Axis = "z", pitch: Scalar = 0.01) -> None:
        self.axis = axis_vector(axis, "Screw's axis")
        self.pitch = scalar(pitch, "Screw's pitch", unit="m")

    def _lead(self) -> float | ca.SX:
        """Advance per radian [m/rad]."""
        return self.pitch.sx / (2 * math.pi) if isinstance(self.pitch, Expression) else self.pitch / (2 * math.pi)

    def steps(self) -> tuple[AbstractStep, ...]:
        return (ScrewTurn(slice(0, 1), slice(0, 1), self.mounting(), self._lead()),)

    def mounting(self) -> Matrix:
        return mounting(self.axis)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R, p = symbolic(X_ab.rotation), symbolic(X_ab.position)
        c, s = ca.cos(turn := p[2] / self._lead()), ca.sin(turn)
        # an angle, whose slope is the same everywhere: a sine would come to zero in each half turn
        return ca.vertcat(p[0], p[1], R[0, 2], R[1, 2], ca.atan2(R[1, 0] * c - R[0, 0] * s, R[0, 0] * c + R[1, 0] * s))

    def closure_sign(self, X_ab: Pose) -> ca.SX:
        R, turn = symbolic(X_ab.rotation), symbolic(X_ab.position)[2] / self._lead()
        return ca.fmin(R[2, 2], R[0, 0] * ca.cos(turn) + R[1, 0] * ca.sin(turn))

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return symbolic(X_ab.position)[2] / self._lead()
