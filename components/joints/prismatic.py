"""A slider."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.connector import Translational
from acausal.language.expression import Variable
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Matrix, Pose, symbolic
from acausal.parts.steps import AbstractStep, Slide
from components.orientation import Axis, axis_vector, mounting


@final
class Prismatic(AbstractStepJoint):
    """Slider: frame_b shifts by q [m] along `axis`, a direction fixed in both frames. One freedom.

    v = q' [m/s]. R_ab = 1, p_ab = axis q. `flange` (translational) carries a force along the axis: s = q.
    Raises `ParameterError` for an axis of length zero.

        scene.rail = Prismatic(axis="x")
    """

    if_given_arguments = (
        "Springs, dampers, motors and stops are parts of their own, connected to its flange; friction in it is a JointFriction."
    )
    flange = Translational.port()
    q = Variable("m", "displacement")
    v = Variable("m/s", "velocity")

    def __init__(self, axis: Axis = "z") -> None:
        self.axis = axis_vector(axis, "Prismatic's axis")

    def steps(self) -> tuple[AbstractStep, ...]:
        return (Slide(slice(0, 1), slice(0, 1), self.mounting()),)

    def mounting(self) -> Matrix:
        return mounting(self.axis)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R, p = symbolic(X_ab.rotation), symbolic(X_ab.position)
        return ca.vertcat(p[0], p[1], R[2, 1], R[0, 2], R[1, 0])

    def closure_sign(self, X_ab: Pose) -> ca.SX:
        return ca.trace(symbolic(X_ab.rotation)) - 2

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return symbolic(X_ab.position)[2]
