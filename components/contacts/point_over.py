"""Points over surfaces and curves: where they are nearest, and how far off."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.expression import Expression, Variable, sx, time
from acausal.language.origin import origin
from acausal.parts.contact import read
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from acausal.parts.seen import AbstractSeenAlong
from components.contacts.nearness import End, Nearness
from components.geometry.curves import AbstractCurve, Prolonged, checked_curve, drawn
from components.geometry.laws import at_time, changing
from components.geometry.net import net
from components.geometry.surfaces import APEX, AbstractSurface, Parallel, checked_surface
from components.joints.spherical import Spherical
from components.orientation import Axis, axis_vector

_LOOKS = 33
"""Places round a closed curve at which its directions are looked at."""
_ALIKE = 1e-9
"""Sine of the angle below which two directions are one."""


class AbstractPointOver(AbstractJoint, ABC):
    """frame_b, a point, over something of frame_a; its last coordinate is the gap [m], its last velocity the gap's rate. A body at frame_b turns freely,
    by a `socket` of its own. Must provide `directions`, `axes` and `end`.
    """

    directions: ClassVar[int]
    """Along what it is over."""

    @abstractmethod
    def axes(self) -> ca.SX:
        """(3, directions + 1): tangents where it is nearest, and the normal, in frame_a."""

    @abstractmethod
    def end(self, place: ca.SX) -> End | None:
        """Of what it is over, for its place (3, 1) [m] in frame_a; None where that has none, or where a motion ends there."""

    @final
    def nearness(self) -> Nearness:
        """Where it is nearest."""
        X, axes, q = self.pose(self.q.sx, time.sx), self.axes(), self.q.sx
        place = sx(X.position)
        return Nearness(X, q[q.numel() - 1], place, axes[:, -1], axes[:, : self.directions], end=self.end(place))


@final
class PointOverSurface(AbstractPointOver, AbstractSeenAlong):
    """frame_b, a point, at the `gap` [m] over a `surface` of frame_a, on the side of its normal. Three freedoms: nothing is held. A body there turns
    freely; `socket`: the ball joint by which it does.

    q: the surface's coordinates where it is nearest, and the gap. Only as far as the surface's centres of curvature, which `domain` says.

        scene.over = PointOverSurface(HeightField(lambda x, y: 0.1 * x**2))
    """

    directions = 2
    if_outside = "The point is at a centre of curvature of the surface, where no place is the nearest, or the surface ends there."
    if_singular = APEX
    q = Variable("", "coordinates of the nearest place on the surface; gap [m]", size=3)
    v = Variable("", "velocities of the coordinates, and of the gap [m/s]", size=3)

    def __init__(self, surface: AbstractSurface) -> None:
        self.surface, self.socket = checked_surface(surface, "PointOverSurface"), Spherical()
        start = (*surface.start, 0.0)
        self._declare("q", "", len(start), start if any(start) else None)

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(self.surface, places), ()

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        place, over = self._parts(q)
        return Pose(np.eye(3), at_time(t, over.point(place))[0])

    def given_motions(self) -> tuple[Expression, ...]:
        q = ca.SX(ca.DM(self.start_q()))
        return changing(self.surface.point(self._parts(q)[0]))

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        return ca.vertcat(self.surface.rates(self._parts(q)[0], v[:2]), v[2])

    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        return self.surface.invariants(self._parts(q)[0])

    def domain(self, q: ca.SX) -> ca.SX:
        place, over = self._parts(q)
        return over.inside(place)

    def regular(self, q: ca.SX) -> ca.SX:
        return self.surface.regular(self._parts(q)[0])

    def turns(self) -> tuple[bool, ...]:
        return (*self.surface.turns, False)

    def end(self, place: ca.SX) -> None:
        return None

    def axes(self) -> ca.SX:
        place, _ = self._parts(self.q.sx)
        return ca.horzcat(self.surface.tangents(place), self.surface.normal(place))

    def _parts(self, q: ca.SX) -> tuple[ca.SX, Parallel]:
        """Coordinates on the surface, and the parallel one that the point is on."""
        k = q.numel() - 1
        return q[:k], Parallel(self.surface, read(q[k]))


@final
class PointOverCurve(AbstractPointOver):
    """frame_b, a point, at the gap [m] over a `curve` of frame_a, across it and across `side`. Two freedoms: only sideways it is held. A body there
    turns freely; `socket`: the ball joint by which it does.

    q: the curve's parameter where it is nearest, and the gap, along the normal x y': x along the curve, y' the direction `side` as far as it is across.
    Only as far as the curve's centres of curvature, which `domain` says. A curve with ends goes on behind them, soon straight, so that a point may fly there.

        scene.over = PointOverCurve(Circle(0.5), side="z")
    """

    directions = 1
    if_outside = "The point is at a centre of curvature of the curve, where no place is the nearest."
    if_singular = (
        "The curve has a cusp there, or runs along `side`: it has no normal. Give another `side`, across the curve all along."
    )
    q = Variable("", "the curve's parameter at the nearest place; gap [m]", size=2)
    v = Variable("", "rates of the curve's parameter, and of the gap [m/s]", size=2)

    def __init__(self, curve: AbstractCurve, side: Axis = "y") -> None:
        self.curve, self.side = checked_curve(curve, "PointOverCurve"), axis_vector(side, "PointOverCurve's side")
        if isinstance(self.side, np.ndarray) and _runs_along(self.curve, self.side):
            raise ParameterError(
                f"The curve that a point stays on one side of runs along `side`, {shown(tuple(self.side.tolist()))} ({origin()}): nothing is across both there. Give a side that is "
                "across the curve all along, of a curve in one plane that plane's normal: side='z' for a Circle, '-z' for its other side."
            )
        self.socket = Spherical()

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        axes, point, _ = self._over(q[0])
        return Pose(np.eye(3), at_time(t, point + q[1] * axes[:, 1])[0])

    def given_motions(self) -> tuple[Expression, ...]:
        return changing(self._line.point(ca.SX(ca.DM(self.start_q()[:1]))))

    def domain(self, q: ca.SX) -> ca.SX:
        return 1 + q[1] * self._over(q[0])[2]

    def regular(self, q: ca.SX) -> ca.SX:
        s = ca.SX.sym("s")
        slope = ca.substitute(ca.jacobian(self._line.point(s), s), s, q[0])
        return ca.vertcat(self.curve.regular(self._line.last(q[0])), ca.sumsqr(ca.cross(slope, sx(self.side))) / ca.sumsqr(slope))

    def turns(self) -> tuple[bool, ...]:
        return (self.curve.unit != "m", False)

    def shapes(self) -> tuple[Any, ...]:
        return drawn(self.curve)

    def axes(self) -> ca.SX:
        return self._over(self.q.sx[0])[0]

    def end(self, place: ca.SX) -> End | None:
        s = self.q.sx[0]
        end = self._line.end(s)
        return None if end is None else End(end[0], place - at_time(time.sx, self.curve.point(self._line.last(s)))[0], end[1])

    @property
    def _line(self) -> Prolonged:
        return Prolonged(self.curve)

    def _over(self, at: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Tangent and normal (3, 2), the curve's point, and its bend [1/m], positive where the normal points away from its centre."""
        s, side = ca.SX.sym("s"), sx(self.side)
        point = self._line.point(s)
        slope = ca.jacobian(point, s)
        x = slope / ca.norm_2(slope)
        normal = ca.cross(x, side)
        normal = normal / ca.norm_2(normal)
        bend = ca.dot(ca.jacobian(normal, s), x) / ca.norm_2(slope)
        axes, found, bent = ca.substitute([ca.horzcat(x, normal), point, bend], [s], [at])
        return axes, found, bent


def _runs_along(curve: AbstractCurve, side: np.ndarray) -> bool:
    """Whether a curve of plain numbers has this direction (3,) where it begins, or on its way round in one plane."""
    s = ca.SX.sym("s")
    slope = ca.densify(ca.jacobian(curve.point(s), s))
    if any(not ca.is_equal(symbol, s) for symbol in ca.symvar(slope)):
        return False
    at = np.array([0.0]) if curve.period is None else np.linspace(*curve.period, _LOOKS)
    slopes = np.array(ca.Function("slopes", [s], [slope]).map(at.size)(at[None, :])).T
    lengths = np.linalg.norm(slopes, axis=1, keepdims=True)
    if not (np.isfinite(lengths).all() and lengths.all()):  # cusps are told where a motion comes to them
        return False
    normals = np.cross(slopes / lengths, side)
    sines = np.linalg.norm(normals, axis=1)
    signed = normals @ normals[np.argmax(sines)] / max(float(np.max(sines)), _ALIKE)
    turns = np.allclose(np.abs(signed), sines, rtol=0, atol=_ALIKE) and float(np.min(signed)) < 0
    return turns or float(sines[0]) < _ALIKE
