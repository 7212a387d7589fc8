"""Curves in space, given by a parameter."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Scalar, flag, scalar, sx, vector
from acausal.language.interpolant import is_spline, of_spline
from acausal.language.origin import origin
from components.geometry.laws import place

CUSP = "The curve has a cusp there, and no direction: what slides along it would have to stop and start in no time."
"""Said where `AbstractCurve.regular` is zero."""


class AbstractCurve(ABC):
    """A curve in the axes of the frame that it is fixed in. Must provide `point`; new ones need nothing else."""

    unit: ClassVar[str] = "m"
    """Of the parameter: "m" for a length, "rad" for an angle, "" for a number."""

    @abstractmethod
    def point(self, s: ca.SX) -> ca.SX:
        """Place (3, 1) [m] at the parameter s, with two derivatives."""

    def inside(self, s: ca.SX) -> ca.SX:
        """Positive between the curve's ends, (n, 1), without unit and of size 1 well inside. Empty for a curve without ends."""
        return ca.SX(0, 1)

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
        self.law = place("ParametricCurve", law, self._s)
        self.ends = ends
        self.unit = unit  # pyright: ignore[reportAttributeAccessIssue]

    def point(self, s: ca.SX) -> ca.SX:
        return ca.substitute(self.law, self._s, s)

    def inside(self, s: ca.SX) -> ca.SX:
        return ca.SX(0, 1) if self.ends is None else within(s, self.ends)


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
        self.ends = (float(self.spline.x[0]), float(self.spline.x[-1]))
        self.closed = self.spline.extrapolate == "periodic"

    def point(self, s: ca.SX) -> ca.SX:
        return ca.vertcat(*of_spline(self.spline, s))

    def inside(self, s: ca.SX) -> ca.SX:
        return ca.SX(0, 1) if self.closed else within(s, self.ends)


def checked_curve(curve: object, part: str) -> AbstractCurve:
    """Raises `ParameterError` for anything else."""
    if not isinstance(curve, AbstractCurve):
        raise ParameterError(f"{part}'s curve is {curve!r} ({origin()}). Give a curve of components, e.g. Circle(radius=0.5).")
    return curve


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
