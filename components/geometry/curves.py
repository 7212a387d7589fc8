"""Curves in space, given by a parameter."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.expression import Scalar, flag, scalar, sx, vector
from acausal.language.interpolant import is_spline, of_spline
from acausal.language.origin import origin
from acausal.visual.shapes import Wire
from components.geometry.laws import moving, place

CUSP = "The curve has a cusp there, and no direction: what slides along it would have to stop and start in no time; or its slope is infinite, as where a root of its parameter ends: give it by another parameter."
"""Said where `AbstractCurve.regular` is zero."""


class AbstractCurve(ABC):
    """A curve in the axes of the frame that it is fixed in. Must provide `point`; new ones need nothing else."""

    unit: ClassVar[str] = "m"
    """Of the parameter: "m" for a length, "rad" for an angle, "" for a number."""
    ends: tuple[float, float] | None = None
    """Of the parameter; None for a curve without ends."""
    period: tuple[float, float] | None = None
    """Of the parameter, once round a closed curve."""

    @abstractmethod
    def point(self, s: ca.SX) -> ca.SX:
        """Place (3, 1) [m] at the parameter s, with two derivatives."""

    @final
    def inside(self, s: ca.SX) -> ca.SX:
        """Positive between the curve's ends, (n, 1), without unit and of size 1 well inside. Empty for a curve without ends."""
        return ca.SX(0, 1) if self.ends is None else within(s, self.ends)

    def regular(self, s: ca.SX) -> ca.SX:
        """Zero at a cusp, where the curve has no direction, else positive, (n, 1); of any unit. Empty where it has none."""
        at = ca.SX.sym("s")
        return ca.substitute(ca.sumsqr(ca.jacobian(self.point(at), at)), at, s)


@final
class Line(AbstractCurve):
    """Straight through `through` (3,) [m] along `direction` (3,); the parameter is the distance [m].

    Line((1, 0, 0))
    """

    def __init__(self, direction: Scalar, through: Scalar = (0.0, 0.0, 0.0)) -> None:
        self.direction = vector(direction, "Line's direction")
        if isinstance(self.direction, np.ndarray) and not np.any(self.direction):
            raise ParameterError(f"Line's direction is zero ({origin()}). Give a vector along the line.")
        self.through = vector(through, "Line's point", unit="m")

    def point(self, s: ca.SX) -> ca.SX:
        direction = sx(self.direction)
        return sx(self.through) + s * direction / ca.norm_2(direction)

    def regular(self, s: ca.SX) -> ca.SX:
        return ca.SX(0, 1)


@final
class Circle(AbstractCurve):
    """Of `radius` [m] > 0 about the origin in the plane z = 0; the parameter is the angle from x [rad].

    Circle(radius=0.5)
    """

    unit = "rad"
    period = (0.0, 2 * np.pi)

    def __init__(self, radius: Scalar) -> None:
        self.radius = scalar(radius, "Circle's radius", positive=True, unit="m")

    def point(self, s: ca.SX) -> ca.SX:
        return sx(self.radius) * ca.vertcat(ca.cos(s), ca.sin(s), 0)

    def regular(self, s: ca.SX) -> ca.SX:
        return ca.SX(0, 1)


@final
class Helix(AbstractCurve):
    """Of `radius` [m] > 0 about z, rising by `lead` [m] each radian; the parameter is the angle from x [rad].

    Helix(radius=0.2, lead=0.05)
    """

    unit = "rad"

    def __init__(self, radius: Scalar, lead: Scalar) -> None:
        self.radius = scalar(radius, "Helix's radius", positive=True, unit="m")
        self.lead = scalar(lead, "Helix's lead", unit="m")

    def point(self, s: ca.SX) -> ca.SX:
        return ca.vertcat(sx(self.radius) * ca.cos(s), sx(self.radius) * ca.sin(s), sx(self.lead) * s)

    def regular(self, s: ca.SX) -> ca.SX:
        return ca.SX(0, 1)


@final
class ParametricCurve(AbstractCurve):
    """Any curve: `law` (s) -> (x, y, z) [m], by CasADi's or numpy's functions. `ends`: of s, where the curve has ends; `unit` of s.

    ParametricCurve(lambda s: (s - ca.sin(s), 0, ca.cos(s)), unit="rad")  # a cycloid
    """

    def __init__(self, law: Callable[[ca.SX], Any], ends: tuple[float, float] | None = None, unit: str = "") -> None:
        self._s = ca.SX.sym("s")
        self.law = moving("ParametricCurve", place("ParametricCurve", law, "s", self._s), "s", self._s)
        self.ends = ends
        self.unit = unit  # pyright: ignore[reportAttributeAccessIssue]

    def point(self, s: ca.SX) -> ca.SX:
        return ca.substitute(self.law, self._s, s)

    def regular(self, s: ca.SX) -> ca.SX:
        square = super().regular(s)
        return ca.vertcat(square, 1 / square)  # nor where its slope is infinite


@final
class SplineCurve(AbstractCurve):
    """Cubic spline through `points` (n, 3) [m], n >= 3, or any scipy spline with three columns; the parameter runs along the polygon [m].

    `closed`: back to the first point, smoothly. Curvature is continuous, its slope jumps at the points; steps end there.

        SplineCurve([(0, 0, 1), (1, 0, 0.2), (2, 0, 0.6)])
    """

    def __init__(self, points: Any, closed: bool = False) -> None:
        self.spline = points if is_spline(points) else _through(points, flag(closed, "SplineCurve's closed"))
        values = of_spline(self.spline, ca.SX.sym("s"))
        if not isinstance(values, list) or len(values) != 3:
            raise ParameterError(f"SplineCurve needs three columns x, y, z ({origin()}).")
        self.closed = self.spline.extrapolate == "periodic"
        whole = float(self.spline.x[0]), float(self.spline.x[-1])
        self.ends, self.period = (None, whole) if self.closed else (whole, None)

    def point(self, s: ca.SX) -> ca.SX:
        return ca.vertcat(*of_spline(self.spline, s))


def checked_curve(curve: object, part: str) -> AbstractCurve:
    """Raises `ParameterError` for anything else."""
    if not isinstance(curve, AbstractCurve):
        raise ParameterError(
            f"{part}'s curve is {shown(curve)} ({origin()}). Give a curve of components, e.g. Circle(radius=0.5)."
        )
    return curve


_PIECES = 96
"""Straight ones that a curve is drawn with."""


def drawn(curve: AbstractCurve) -> tuple[Any, ...]:
    """A wire along a curve of plain numbers that ends, or is closed; nothing along others."""
    s = ca.SX.sym("s")
    place, whole = curve.point(s), curve.ends or curve.period
    if whole is None or any(not ca.is_equal(symbol, s) for symbol in ca.symvar(place)):
        return ()
    at = np.linspace(*whole, _PIECES + 1)
    points = np.array(ca.Function("curve", [s], [ca.densify(place)]).map(at.size)(at[None, :])).T
    return (Wire(tuple((float(x), float(y), float(z)) for x, y, z in points)),)


_STRAIGHTENS = 0.1
"""Of a curve's parameter: how far behind its ends it is nearly straight."""


@dataclass(frozen=True)
class Prolonged:
    """A `curve` that goes on behind its ends: at first with the direction and curvature that it has there, soon straight."""

    curve: AbstractCurve

    def point(self, s: ca.SX) -> ca.SX:
        """Place (3, 1) [m], with two derivatives that are continuous."""
        if self.curve.ends is None:
            return self.curve.point(s)
        a, b = self.curve.ends
        on = self.curve.point(self.last(s))
        return ca.if_else(s < a, self._behind(a, a - s), ca.if_else(s > b, self._behind(b, s - b), on))

    def last(self, s: ca.SX) -> ca.SX:
        """The last parameter that the curve itself has on the way to s."""
        if self.curve.ends is None:
            return s
        a, b = self.curve.ends
        return ca.if_else(s < a, a, ca.if_else(s > b, b, s))

    def end(self, s: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        """Whether s is behind an end of the curve, and what that is long, about [m]; None for one without ends."""
        if self.curve.ends is None:
            return None
        a, b = self.curve.ends
        return ca.logic_or(s < a, s > b), ca.norm_2(self._derivatives(a)[1]) * (b - a)

    def _behind(self, end: float, far: ca.SX) -> ca.SX:
        """At a parameter so `far` behind an end."""
        assert self.curve.ends is not None
        a, b = self.curve.ends
        point, slope, bend = self._derivatives(end)
        most = _STRAIGHTENS * (b - a)
        turned = most**2 * (ca.exp(-far / most) - 1 + far / most)  # far^2 / 2 at first
        return point + (far if end == b else -far) * slope + turned * bend

    def _derivatives(self, s: float) -> tuple[ca.SX, ca.SX, ca.SX]:
        at = ca.SX.sym("s")
        point = self.curve.point(at)
        slope = ca.jacobian(point, at)
        found = ca.substitute([point, slope, ca.jacobian(slope, at)], [at], [ca.SX(s)])
        return found[0], found[1], found[2]


def within(s: ca.SX, ends: tuple[float, float]) -> ca.SX:
    """Positive between both ends, of size 1 in the middle."""
    half = (ends[1] - ends[0]) / 2
    return ca.vertcat((s - ends[0]) / half, (ends[1] - s) / half)


def _through(points: Any, closed: bool) -> Any:
    from scipy.interpolate import CubicSpline

    try:
        through = np.asarray(points, dtype=float)
    except (TypeError, ValueError, OverflowError):
        through = np.zeros(0)
    if through.ndim != 2 or through.shape[1:] != (3,) or len(through) < 3 or not np.isfinite(through).all():
        raise ParameterError(
            f"SplineCurve's points have the shape {through.shape} ({origin()}). Give at least three finite points (n, 3)."
        )
    if closed:
        through = np.vstack([through, through[:1]])
    lengths = np.linalg.norm(np.diff(through, axis=0), axis=1)
    if np.any(lengths == 0):
        k = int(np.argmin(lengths))
        raise ParameterError(
            f"SplineCurve's points {k} and {k + 1} are the same ({origin()}): the curve has no direction there. Leave one out."
        )
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    return CubicSpline(s, through, bc_type="periodic" if closed else "not-a-knot", extrapolate="periodic" if closed else True)
