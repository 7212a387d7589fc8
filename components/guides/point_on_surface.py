"""A point that slides on a surface."""

from __future__ import annotations

from typing import Any, Literal, Self, final, overload

import casadi as ca
import numpy as np

from acausal.language.construction import checked_new
from acausal.language.expression import Expression, Variable, time
from acausal.language.impact_laws import Restitution
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from acausal.parts.seen import AbstractSeenAlong
from components.contacts.laws import Coulomb
from components.contacts.one_sided_point import OneSidedPoint, hard_law
from components.geometry.laws import at_time, changing
from components.geometry.net import net
from components.geometry.surfaces import APEX, AbstractSurface, checked_surface
from components.guides.rough_guide import RoughGuide


@final
class PointOnSurface(AbstractJoint, AbstractSeenAlong):
    """frame_b slides on a `surface` fixed in frame_a, and does not turn. Two freedoms.

    q: the surface's coordinates, v (2): their velocities; no multiplier. A particle sits on frame_b; a body's point does with a Spherical
    between. The surface moves as frame_a does; by numbers that are expressions of `ac.time` it also changes its shape (not an ImplicitSurface). It
    holds on both sides.

    `unilateral`: it holds on the side of the normal only; the point, of a particle or of a body that turns freely, leaves it and strikes it again, see
    OneSidedPoint. `restitution`: 0 (no bounce) ... 1 (no loss). `friction`: Coulomb(...), if any; where it holds on both sides by the normal force of
    either sign, see RoughGuide.

        scene.bowl = PointOnSurface(HeightField(lambda x, y: x**2 + y**2))
    """

    if_outside = "The surface ends there, or its coordinates do."
    if_singular = APEX
    q = Variable("m", "coordinates on the surface", size=2)
    v = Variable("m/s", "velocities of the coordinates", size=2)

    @overload
    def __new__(cls, surface: AbstractSurface, *, unilateral: Literal[False] = False) -> Self: ...
    @overload
    def __new__(cls, surface: AbstractSurface, *, unilateral: Literal[False] = False, friction: Coulomb) -> RoughGuide: ...
    @overload
    def __new__(
        cls,
        surface: AbstractSurface,
        *,
        unilateral: Literal[True],
        restitution: Restitution = 0.0,
        friction: Coulomb | None = None,
    ) -> OneSidedPoint: ...
    @checked_new
    def __new__(
        cls,
        surface: AbstractSurface,
        *,
        unilateral: bool = False,
        restitution: Restitution = 0.0,
        friction: Coulomb | None = None,
    ) -> Any:
        law = hard_law("PointOnSurface", unilateral, restitution, friction)
        if law is not None:
            return OneSidedPoint(checked_surface(surface, "PointOnSurface"), law)
        if friction is not None:
            return RoughGuide(cls(surface), checked_surface(surface, "PointOnSurface"), friction)
        return super().__new__(cls, surface)

    def __init__(
        self, surface: AbstractSurface, *, unilateral: Literal[False] = False, **_: Any
    ) -> None:  # _: no bounce, no friction
        self.surface = checked_surface(surface, "PointOnSurface")
        self._declare("q", surface.unit, len(surface.start), surface.start if any(surface.start) else None)
        self._declare("v", f"{surface.unit or '1'}/s")

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(self.surface, places), ()

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(np.eye(3), at_time(t, self.surface.point(q))[0])

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        return self.surface.rates(q, v)

    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        return self.surface.invariants(q)

    def turns(self) -> tuple[bool, ...]:
        return self.surface.turns

    def given_motions(self) -> tuple[Expression, ...]:
        q, v = ca.SX(ca.DM(self.start_q())), ca.SX.sym("v", 2)
        coordinates = ca.vertcat(self.surface.rates(q, v), self.surface.invariants(q))
        return () if ca.depends_on(coordinates, time.sx) else changing(self.surface.point(q))

    def domain(self, q: ca.SX) -> ca.SX:
        return self.surface.inside(q)

    def regular(self, q: ca.SX) -> ca.SX:
        return self.surface.regular(q)
