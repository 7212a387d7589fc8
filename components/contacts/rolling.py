"""Rolling without slipping on a plane: what bodies of any shape have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import final

import casadi as ca

from acausal.mechanics.joint import AbstractJoint
from acausal.mechanics.pose import Pose, symbolic


class AbstractRolling(AbstractJoint, ABC):
    """A convex body, fixed in frame_b, rolls on the plane z = 0 of frame_a without slipping; z points to the body.

    Three velocities and no multiplier in a tree (Kane's form); closing a loop, one position row (touching) and two velocity rows
    (no slip). Reactions are not limited: the contact can pull. Must provide `contact_point`, `closure_rates`, and what a joint does.
    """

    @abstractmethod
    def contact_point(self, n: ca.SX) -> ca.SX:
        """The body's lowest point (3, 1) [m] in frame_b, when the unit vector `n` (3, 1) of frame_b points up."""

    @final
    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        n = symbolic(X_ab.rotation)[2, :].T
        return symbolic(X_ab.position)[2] + ca.dot(n, self.contact_point(n))
