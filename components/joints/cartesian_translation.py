"""Translation without rotation."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.expression import Variable
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Pose, symbolic
from acausal.parts.steps import AbstractStep, Shift


@final
class CartesianTranslation(AbstractStepJoint):
    """frame_b shifts by q (3) [m] along the axes of frame_a and does not turn. Three freedoms. v = q' [m/s].

    scene.gantry = CartesianTranslation()
    """

    q = Variable("m", "displacement in frame_a", size=3)
    v = Variable("m/s", "velocity in frame_a", size=3)

    def steps(self) -> tuple[AbstractStep, ...]:
        return (Shift(slice(0, 3), slice(0, 3)),)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R = symbolic(X_ab.rotation)
        return ca.vertcat(R[2, 1], R[0, 2], R[1, 0])

    def closure_sign(self, X_ab: Pose) -> ca.SX:
        return ca.trace(symbolic(X_ab.rotation)) - 2

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return symbolic(X_ab.position)
