"""A rigid connection as a constraint."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic, vee


@final
class Weld(AbstractConstraint):
    """frame_a and frame_b are one: three rows in position [m], three in the sines of small turns. No freedom."""

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R = symbolic(X_ab.rotation)
        return ca.vertcat(symbolic(X_ab.position), vee(R))

    def closure_sign(self, X_ab: Pose) -> ca.SX:
        return ca.trace(symbolic(X_ab.rotation)) - 1
