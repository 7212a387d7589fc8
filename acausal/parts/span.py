"""What two frames give to a flange: a number that their poses determine, through which scalar parts act on both."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import final

import casadi as ca

from acausal.language.connector import Rotational, Translational
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic


class AbstractSpan(AbstractConstraint, ABC):
    """Two frames and one flange that moves with them. Must declare a `flange` and provide `coordinate`. It holds nothing.

    What flows into the flange acts on both frames by virtual work: a positive effort drives the coordinate forward.
    """

    flange: Rotational | Translational

    @abstractmethod
    def coordinate(self, X_ab: Pose) -> ca.SX:
        """Angle [rad] or position [m] of the flange, scalar, for the pose X_ab of frame_b in frame_a."""

    def line(self, X_ab: Pose) -> tuple[ca.SX, ca.SX] | None:
        """What to draw: a string between two places (3, 1) [m] in the axes of frame_a; None: nothing."""
        return None

    @final
    def wrench_on_b(self, X_ab: Pose) -> ca.SX:
        """Torque and force (6, 1) on frame_b, in its axes, of a unit effort."""
        R, p = symbolic(X_ab.rotation), symbolic(X_ab.position)
        moved = ca.SX.sym("moved", 6)
        value = self.coordinate(Pose(R @ (ca.SX.eye(3) + ca.skew(moved[:3])), p + R @ moved[3:]))
        return ca.densify(ca.substitute(ca.jacobian(value, moved), moved, ca.SX.zeros(6)).T)

    @final
    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return ca.SX(0, 1)
