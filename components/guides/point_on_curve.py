"""A point that slides along a curve."""

from __future__ import annotations

from typing import Any, Literal, Self, final, overload

import casadi as ca
import numpy as np

from acausal.language.construction import checked_new
from acausal.language.expression import Expression, Variable
from acausal.language.impact_laws import Restitution
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from components.contacts.laws import Coulomb
from components.contacts.one_sided_point import OneSidedPoint, hard_law
from components.geometry.curves import CUSP, AbstractCurve, checked_curve, drawn
from components.geometry.laws import at_time, changing
from components.guides.rough_guide import RoughGuide
from components.orientation import Axis, axis_vector


@final
class PointOnCurve(AbstractJoint):
    """frame_b slides along a `curve` fixed in frame_a, and does not turn. One freedom.

    q: the curve's parameter, v = q'. A particle sits on frame_b; a body's point does with a Spherical between. The curve moves as frame_a does:
    on a free body, on a PrescribedMotion; by numbers that are expressions of `ac.time` it also changes its shape. It holds on both sides.

    `unilateral`: a track that is left and landed on, see OneSidedPoint; a body whose point does so turns freely. It holds on the side of the normal,
    across the curve (x) and across `side`, a direction of frame_a: x y', so that on a track that runs along x with `side` "y" the point is above.
    Sideways it stays. Off its end a point flies on.
    `restitution`: 0 (no bounce) ... 1 (no loss). `friction`: Coulomb(...), if any: by that push alone; where it holds on both sides by the force across, of
    two components, see RoughGuide.

        scene.wire = PointOnCurve(Helix(radius=0.2, lead=0.05))
    """

    if_outside = "The curve ends there."
    if_singular = CUSP
    q = Variable("m", "the curve's parameter")
    v = Variable("m/s", "rate of the curve's parameter")

    @overload
    def __new__(cls, curve: AbstractCurve, *, unilateral: Literal[False] = False) -> Self: ...
    @overload
    def __new__(cls, curve: AbstractCurve, *, unilateral: Literal[False] = False, friction: Coulomb) -> RoughGuide: ...
    @overload
    def __new__(
        cls,
        curve: AbstractCurve,
        *,
        unilateral: Literal[True],
        restitution: Restitution = 0.0,
        friction: Coulomb | None = None,
        side: Axis = "y",
    ) -> OneSidedPoint: ...
    @checked_new
    def __new__(
        cls,
        curve: AbstractCurve,
        *,
        unilateral: bool = False,
        restitution: Restitution = 0.0,
        friction: Coulomb | None = None,
        side: Axis = "y",
    ) -> Any:
        across = axis_vector(side, "PointOnCurve's side")
        law = hard_law("PointOnCurve", unilateral, restitution, friction)
        if law is not None:
            return OneSidedPoint(checked_curve(curve, "PointOnCurve"), law, across)
        return (
            super().__new__(cls, curve)
            if friction is None
            else RoughGuide(cls(curve), checked_curve(curve, "PointOnCurve"), friction)
        )

    def __init__(
        self, curve: AbstractCurve, *, unilateral: Literal[False] = False, **_: Any
    ) -> None:  # _: no bounce, no friction
        self.curve = checked_curve(curve, "PointOnCurve")
        self._declare("q", curve.unit)
        self._declare("v", f"{curve.unit or '1'}/s")

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(np.eye(3), at_time(t, self.curve.point(q))[0])

    def given_motions(self) -> tuple[Expression, ...]:
        return changing(self.curve.point(ca.SX(ca.DM(self.start_q()))))

    def domain(self, q: ca.SX) -> ca.SX:
        return self.curve.inside(q)

    def shapes(self) -> tuple[Any, ...]:
        return drawn(self.curve)

    def regular(self, q: ca.SX) -> ca.SX:
        return self.curve.regular(q)
