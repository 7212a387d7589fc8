"""A blade or a narrow wheel that cannot move sideways."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic


@final
class KnifeEdge(AbstractConstraint):
    """A blade along x of frame_b does not move across itself over the plane z = 0 of frame_a; it may slide along itself and turn.

    Takes one velocity and no position: 0 = (z_a x x_b) . v, where v is the velocity of frame_b's origin against frame_a. A skate, a sledge, an axle with
    a wheel whose rolling does not matter. It does not hold the blade on the plane: Planar or PointOnPlane do. O'Reilly, Intermediate Dynamics for
    Engineers (2nd ed.), 8.3.

        scene.skate = KnifeEdge()
    """

    if_given_arguments = (
        "Its blade is along x of frame_b: connect that to a turned frame of the body, body.at((0, 0, 0), rotation=...)."
    )

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        normal = symbolic(X_ab.rotation)[2, :].T
        return ca.dot(ca.cross(normal, ca.SX([1, 0, 0])), v_ab_b)
