"""A point that slides along a curve."""

from __future__ import annotations

from typing import final

import casadi as ca
import numpy as np

from acausal.language.expression import Variable
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from components.geometry.curves import AbstractCurve, checked_curve


@final
class PointOnCurve(AbstractJoint):
    """frame_b slides without friction along a `curve` fixed in frame_a, and does not turn. One freedom.

    q: the curve's parameter, v = q'. A particle sits on frame_b; a body's point does with a Spherical between. The curve moves as frame_a does:
    on a free body, on a PrescribedMotion. It holds on both sides.

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
        return Pose(np.eye(3), self.curve.point(q))

    def domain(self, q: ca.SX) -> ca.SX:
        return self.curve.inside(q)
