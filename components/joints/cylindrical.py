"""A turning slider."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.expression import Variable
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Matrix, Pose, symbolic
from acausal.parts.steps import AbstractStep, Slide, Turn
from components.orientation import Axis, axis_vector, mounting


@final
class Cylindrical(AbstractStepJoint):
    """frame_b turns by q[0] [rad] about and shifts by q[1] [m] along `axis`, a direction fixed in both frames. Two freedoms.

    v = q'. Raises `ParameterError` for an axis of length zero.

        scene.sleeve = Cylindrical(axis="x")
    """

    q = Variable("", "angle [rad], displacement [m]", size=2)
    v = Variable("", "angular velocity [rad/s], velocity [m/s]", size=2)

    def __init__(self, axis: Axis = "z") -> None:
        self.axis = axis_vector(axis, "Cylindrical's axis")

    def steps(self) -> tuple[AbstractStep, ...]:
        M = self.mounting()
        return (Slide(slice(1, 2), slice(1, 2), M), Turn(slice(0, 1), slice(0, 1), M))

    def mounting(self) -> Matrix:
        return mounting(self.axis)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R, p = symbolic(X_ab.rotation), symbolic(X_ab.position)
        return ca.vertcat(p[0], p[1], R[0, 2], R[1, 2])

    def closure_sign(self, X_ab: Pose) -> ca.SX:
        return symbolic(X_ab.rotation)[2, 2]

    def coordinates(self, X_ab: Pose) -> ca.SX:
        R = symbolic(X_ab.rotation)
        return ca.vertcat(ca.atan2(R[1, 0], R[0, 0]), symbolic(X_ab.position)[2])
