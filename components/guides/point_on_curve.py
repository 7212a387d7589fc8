"""A point that slides along a curve."""

from __future__ import annotations

from typing import final

import casadi as ca
import numpy as np

from acausal.language.expression import Expression, Variable
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from components.geometry.curves import AbstractCurve, checked_curve
from components.geometry.laws import at_time, changing


@final
class PointOnCurve(AbstractJoint):
    """frame_b slides without friction along a `curve` fixed in frame_a, and does not turn. One freedom.

    q: the curve's parameter, v = q'. A particle sits on frame_b; a body's point does with a Spherical between. The curve moves as frame_a does:
    on a free body, on a PrescribedMotion; by numbers that are expressions of `ac.time` it also changes its shape. It holds on both sides.

        scene.wire = PointOnCurve(Helix(radius=0.2, lead=0.05))
    """

    if_outside = "The curve ends there."
    q = Variable("m", "the curve's parameter")
    v = Variable("m/s", "rate of the curve's parameter")

    def __init__(self, curve: AbstractCurve) -> None:
        self.curve = checked_curve(curve, "PointOnCurve")
        self._declare("q", curve.unit)
        self._declare("v", f"{curve.unit or '1'}/s")

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(np.eye(3), at_time(t, self.curve.point(q))[0])

    def given_motions(self) -> tuple[Expression, ...]:
        return changing(self.curve.point(ca.SX(ca.DM(self.start_q()))))

    def domain(self, q: ca.SX) -> ca.SX:
        return self.curve.inside(q)
