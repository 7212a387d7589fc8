"""A point that slides on a plane."""

from __future__ import annotations

from typing import Any, Literal, Self, final, overload

import casadi as ca
import numpy as np

from acausal.language.construction import checked_new
from acausal.language.expression import Expression, Variable
from acausal.language.impact_laws import Restitution
from acausal.parts.contact import AbstractContact
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Pose, quaternion_from_matrix, rotation_to_axis, symbolic
from acausal.parts.seen import AbstractSeenAlong
from acausal.parts.steps import AbstractStep, Ball, Slide
from components.contacts.laws import Coulomb
from components.contacts.one_sided_point import OneSidedPoint, hard_law
from components.geometry.net import net
from components.geometry.surfaces import Plane
from components.guides.rough_guide import RoughGuide

_ALONG_X, _ALONG_Y = (rotation_to_axis(np.array(axis)) for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))


@final
class PointOnPlane(AbstractStepJoint, AbstractContact, AbstractSeenAlong):
    """The origin of frame_b slides on the plane z = 0 of frame_a: a foot, a skid, the tip of a top on ice.

    Five freedoms; closing a loop, one row. q: unit quaternion of R_ab (4, scalar first), then x and y of frame_b's origin in
    frame_a [m]; v: angular velocity of frame_b against frame_a, in frame_b (3) [rad/s], x' and y' [m/s]. The contact can pull. A particle,
    which does not turn, sits on PointOnSurface(Plane()).

    `unilateral`: it does not pull, but may be left, and struck again: see OneSidedPoint. Then the point keeps its own coordinates, `restitution` is 0 (no
    bounce) ... 1 (no loss), and `friction` Coulomb(...), if any. With `friction` alone it holds on both sides, and rubs: see RoughGuide.

        scene.foot = PointOnPlane(unilateral=True, restitution=0.8)
    """

    if_given_arguments = (
        'Its plane is z = 0 of frame_a: connect that to a turned frame, world.at((0, 0, 0), rotation=("x", 1.57)).'
    )
    q = Variable("", "unit quaternion, scalar first (4); x and y in frame_a (2) [m]", size=6, start=(1.0, 0, 0, 0, 0, 0))
    v = Variable("", "angular velocity in frame_b (3) [rad/s]; velocity along x and y of frame_a (2) [m/s]", size=5)

    @overload
    def __new__(cls, *, unilateral: Literal[False] = False) -> Self: ...
    @overload
    def __new__(cls, *, unilateral: Literal[False] = False, friction: Coulomb) -> RoughGuide: ...
    @overload
    def __new__(
        cls, *, unilateral: Literal[True], restitution: Restitution = 0.0, friction: Coulomb | None = None
    ) -> OneSidedPoint: ...
    @checked_new
    def __new__(cls, *, unilateral: bool = False, restitution: Restitution = 0.0, friction: Coulomb | None = None) -> Any:
        law = hard_law("PointOnPlane", unilateral, restitution, friction)
        if law is not None:
            return OneSidedPoint(Plane(), law)
        return super().__new__(cls) if friction is None else RoughGuide(cls(), Plane(), friction)

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(Plane(), places), ()

    def steps(self) -> tuple[AbstractStep, ...]:
        return (
            Slide(slice(4, 5), slice(3, 4), _ALONG_X),
            Slide(slice(5, 6), slice(4, 5), _ALONG_Y),
            Ball(slice(0, 4), slice(0, 3)),
        )

    def touch(self) -> tuple[Expression, Expression]:
        return self.frame_b.position, self.frame_a.rotation[:, 2]

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return symbolic(X_ab.position)[2]

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return ca.vertcat(quaternion_from_matrix(symbolic(X_ab.rotation)), symbolic(X_ab.position)[:2])

    def velocities(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return ca.vertcat(w_ab_b, (symbolic(X_ab.rotation) @ v_ab_b)[:2])
