"""A body that follows a curve, turned as the curve turns: a car on rails."""

from __future__ import annotations

from typing import Any, final

import casadi as ca

from acausal.language.expression import Expression, Variable, sx
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from components.geometry.curves import AbstractCurve, checked_curve, drawn
from components.geometry.laws import at_time, changing
from components.orientation import Axis, axis_vector


@final
class AlongCurve(AbstractJoint):
    """frame_b slides without friction along a `curve` fixed in frame_a and turns with it: x along the curve. One freedom.

    y is the direction `side` of frame_a, as far as it is across the curve, and z completes them: the curve must not run along `side`, but may run
    straight up, so that a looping in the plane z, x has side "y". q: the curve's parameter, v = q'. It holds on both sides.

        scene.car = AlongCurve(SplineCurve(track), side="y")
    """

    if_outside = "The curve ends there."
    if_singular = "The curve has a cusp there, or runs along `side`: how the body is turned is not known. Give another `side`, across the curve all along."
    q = Variable("m", "the curve's parameter")
    v = Variable("m/s", "rate of the curve's parameter")

    def __init__(self, curve: AbstractCurve, side: Axis = "y") -> None:
        self.curve, self.side = checked_curve(curve, "AlongCurve"), axis_vector(side, "AlongCurve's side")
        self._declare("q", curve.unit)
        self._declare("v", f"{curve.unit or '1'}/s")

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        x, across = self._directions(q)
        y = across / ca.norm_2(across)
        return Pose(*at_time(t, ca.horzcat(x, y, ca.cross(x, y)), self.curve.point(q)))

    def given_motions(self) -> tuple[Expression, ...]:
        return changing(self.curve.point(ca.SX(ca.DM(self.start_q()))))

    def domain(self, q: ca.SX) -> ca.SX:
        return self.curve.inside(q)

    def shapes(self) -> tuple[Any, ...]:
        return drawn(self.curve)

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.vertcat(self.curve.regular(q), ca.sumsqr(self._directions(q)[1]))

    def _directions(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The curve's, of length 1, and `side` as far as it is across, (3, 1)."""
        s, side = ca.SX.sym("s"), sx(self.side)
        slope = ca.substitute(ca.jacobian(self.curve.point(s), s), s, q)
        x = slope / ca.norm_2(slope)
        return x, side - ca.dot(side, x) * x
