"""Points that stay on one side of a surface or a curve, and leave it."""

from __future__ import annotations

from typing import Any, final

import casadi as ca

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.component import System
from acausal.language.connector import Frame, Point
from acausal.language.expression import Expression, Variable
from acausal.language.impact_laws import Restitution
from acausal.language.origin import origin
from acausal.parts.contact import AbstractTouch
from components.contacts.hard_contact import HardPoint
from components.contacts.laws import Coulomb, Hard, checked_restitution
from components.contacts.point_over import PointOverCurve, PointOverSurface
from components.geometry.curves import AbstractCurve
from components.geometry.surfaces import AbstractSurface, checked_surface
from components.orientation import Axis, axis_vector

_LOOSE = "A point stays on one side of something: connect both."


@final
class OneSidedPoint(System, AbstractTouch):
    """The origin of frame_b, a point, stays on one side of a surface or curve of frame_a, where the normal points: PointOnPlane, PointOnSurface and PointOnCurve
    with unilateral=True are this.

    0 <= gap, 0 <= normal_force [N], one of them zero; `law`: Hard(restitution, friction). Over a surface nothing else is held. Over a curve: its normal is
    across it and across `side`, x y' with x along the curve; sideways the point is held, without friction. Where the curve ends the point flies off.
    `q` and `v`: where nearest points have no closed form, the coordinates of the nearest place and the gap, and their rates; else the point's own part
    has coordinates. By numbers that are expressions of `ac.time` the surface or curve changes its shape; what it is made of then moves along its normal.

        scene.floor = PointOnPlane(unilateral=True, restitution=0.8)
    """

    namesakes = ("joint", "force_part")
    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Point.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, place: AbstractSurface | AbstractCurve, law: Hard, side: Axis = "y") -> None:
        place = place if isinstance(place, AbstractCurve) else checked_surface(place, "OneSidedPoint")
        across = axis_vector(side, "OneSidedPoint's side")
        self.joint: PointOverSurface | PointOverCurve | None = None
        if isinstance(place, AbstractCurve):
            self.joint = PointOverCurve(place, across)
        elif place.clearance(ca.SX.sym("p", 3)) is None:
            self.joint = PointOverSurface(place)
        self.force_part = HardPoint(place if self.joint is None else self.joint, law)  # pyright: ignore[reportArgumentType]  # curves have joints
        for part in (self.joint, self.force_part):
            if part is not None:
                self.connect(self.frame_a, part.frame_a)
                self.connect(self.frame_b, part.frame_b)

    @property
    def q(self) -> Variable:
        """Coordinates of the nearest place, and the gap."""
        return self._joint("q").q

    @property
    def v(self) -> Variable:
        """Rates of `q`, or what the surface has in their place."""
        return self._joint("v").v

    @property
    def gap(self) -> Expression:
        return self.force_part.gap

    def touch(self) -> tuple[Expression, Expression]:
        return self.force_part.touch()

    def ends(self) -> tuple[Frame, Point]:
        return self.force_part.ends()

    def pushed(self) -> tuple[Point, ...]:
        return self.force_part.pushed()

    def _joint(self, name: str) -> PointOverSurface | PointOverCurve:
        if self.joint is None:
            raise AttributeError(
                f"{self!r} has no '{name}': its point keeps its own coordinates. Look at its gap, force or slip."
            )
        return self.joint


def hard_law(part: str, unilateral: Any, restitution: Restitution, friction: Coulomb | None) -> Hard | None:
    """Of a guide that holds on one side; None where it holds on both. Raises `ParameterError`."""
    if not isinstance(unilateral, bool):
        raise ParameterError(
            f"{part}'s unilateral is {shown(unilateral)} ({origin()}). Give True where it may be left, else False."
        )
    law = Hard(checked_restitution(restitution, part), friction)
    if unilateral:
        return law
    if isinstance(law.restitution.restitution, Expression) or law.restitution.restitution != 0:
        raise ParameterError(
            f"{part} has a restitution of {shown(restitution)} and holds on both sides ({origin()}): nothing strikes. With unilateral=True it may be left."
        )
    return None
