"""A hinge."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.connector import Rotational
from acausal.language.expression import Variable
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Matrix, Pose, symbolic
from acausal.parts.steps import AbstractStep, Turn
from components.orientation import Axis, axis_vector, mounting


@final
class Revolute(AbstractStepJoint):
    """Hinge: frame_b turns by the angle q [rad] about `axis`, a direction fixed in both frames. One freedom.

    v = q' [rad/s]. Positive by the right hand about `axis` (default z). R_ab = exp([axis]x q), p_ab = 0.
    `flange` (rotational) carries a torque about the axis: phi = q.
    Raises `ParameterError` for an axis of length zero.

        scene.hinge = Revolute(axis="y")
    """

    if_given_arguments = (
        "Springs, dampers, motors and stops are parts of their own, connected to its flange; friction in it is a JointFriction."
    )
    flange = Rotational.port()
    q = Variable("rad", "angle")
    v = Variable("rad/s", "angular velocity")

    def __init__(self, axis: Axis = "z") -> None:
        self.axis = axis_vector(axis, "Revolute's axis")

    def steps(self) -> tuple[AbstractStep, ...]:
        return (Turn(slice(0, 1), slice(0, 1), self.mounting()),)

    def mounting(self) -> Matrix:
        return mounting(self.axis)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R = symbolic(X_ab.rotation)
        return ca.vertcat(symbolic(X_ab.position), R[0, 2], R[1, 2])

    def closure_sign(self, X_ab: Pose) -> ca.SX:
        return symbolic(X_ab.rotation)[2, 2]

    def coordinates(self, X_ab: Pose) -> ca.SX:
        R = symbolic(X_ab.rotation)
        return ca.atan2(R[1, 0], R[0, 0])
