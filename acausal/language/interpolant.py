"""Splines of scipy and samples: piecewise polynomials, which are expressions like any other formula, and tables for inputs."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.origin import origin
from acausal.language.pieces import PiecewisePolynomial

_FITPACK = 5
"""The largest degree of splines that it knows."""


def is_spline(value: object) -> bool:
    """Whether it is one of scipy's interpolating functions, or samples."""
    return isinstance(value, PiecewisePolynomial) or any(
        cls.__module__.startswith("scipy.interpolate") for cls in type(value).__mro__
    )


def of_spline(spline: Any, x: ca.SX) -> ca.SX | list[ca.SX]:
    """The value at the scalar `x`, or one for each column of data. Raises `ParameterError` for what is no piecewise polynomial.

    Beyond the data as the spline says itself: going on, periodic, or NaN.
    """
    values = [_piecewise(pieces, x) for pieces in pieces_of(spline)]
    return values if len(values) > 1 or np.ndim(getattr(spline, "c", 0)) == 3 else values[0]


def pieces_of(spline: Any) -> list[PiecewisePolynomial]:
    """The columns of a spline as piecewise polynomials. Raises `ParameterError` for what is none."""
    if isinstance(spline, PiecewisePolynomial):
        return [spline]
    from scipy.interpolate import BSpline, PPoly, UnivariateSpline, interp1d

    if isinstance(spline, interp1d):
        return [_of_interp1d(spline)]
    if isinstance(spline, UnivariateSpline):
        spline = BSpline(*spline._eval_args)  # pyright: ignore[reportPrivateUsage]  # scipy has no other way to its knots
    if isinstance(spline, BSpline):
        spline = polynomials_of(spline)
    if not isinstance(spline, PPoly) or np.iscomplexobj(spline.c) or spline.c.ndim > 3:
        raise ParameterError(
            f"{type(spline).__name__} of scipy is no piecewise polynomial of one variable ({origin()}). Use ac.samples(times, values), or of scipy "
            "CubicSpline, PchipInterpolator, Akima1DInterpolator or make_interp_spline; ac.lookup takes RectBivariateSpline and RegularGridInterpolator."
        )
    c, knots = np.asarray(spline.c), np.asarray(spline.x, dtype=float)
    first, last = float(knots[0]), float(knots[-1])
    columns = np.moveaxis(c.reshape(*c.shape[:2], -1), 0, 1)
    if spline.extrapolate == "periodic":
        return [PiecewisePolynomial(knots[:-1], column, first, last - first) for column in np.moveaxis(columns, 2, 0)]
    outside = None if spline.extrapolate else (np.nan, np.nan)
    return [_ended(knots, column, outside) for column in np.moveaxis(columns, 2, 0)]


def polynomials_of(spline: Any) -> Any:
    """The pieces of a `BSpline` of any degree, as scipy's `PPoly`: scipy's own way there ends the process above degree 5."""
    from scipy.interpolate import BSpline, PPoly

    if spline.k <= _FITPACK:
        return PPoly.from_spline(spline, extrapolate=spline.extrapolate)
    plain = BSpline(spline.t, spline.c, spline.k)
    slopes = [(plain.derivative(m) if m else plain)(spline.t[:-1]) / math.factorial(m) for m in range(spline.k + 1)]
    return PPoly.construct_fast(np.array(slopes[::-1]), spline.t, spline.extrapolate)


def _ended(knots: np.ndarray, coefficients: np.ndarray, outside: tuple[float, float] | None) -> PiecewisePolynomial:
    """Pieces between knots (n + 1,), with these values outside; None: the first and the last go on."""
    if outside is None:
        return PiecewisePolynomial(knots[:-1], coefficients)
    ends = np.zeros((2, 1, coefficients.shape[1]))
    ends[:, 0, -1] = outside
    begins = np.concatenate([knots[:1], knots[:-1], [np.nextafter(knots[-1], np.inf)]])
    return PiecewisePolynomial(begins, np.vstack([ends[0], coefficients, ends[1]]))


def _of_interp1d(given: Any) -> PiecewisePolynomial:
    """scipy's `interp1d` of one row of data."""
    x, y, kind = np.asarray(given.x, dtype=float), np.asarray(given.y, dtype=float), given._kind
    if y.ndim != 1:
        raise ParameterError(f"interp1d of data of shape {y.shape} cannot stand here ({origin()}): give one row.")
    fill: Any = given.fill_value
    outside = None if isinstance(fill, str) else tuple(np.broadcast_to(np.asarray(fill, dtype=float).ravel(), (2,)).tolist())
    if kind not in ("linear", "nearest", "previous", "next"):
        raise ParameterError(
            f"interp1d of kind {kind!r} cannot stand here ({origin()}). Use scipy's CubicSpline or make_interp_spline."
        )
    if kind == "linear":
        return _ended(x, np.column_stack([np.diff(y) / np.diff(x), y[:-1]]), outside)
    if kind == "previous":
        return _ended(np.append(x, x[-1]), y[:, None], outside)
    middle = 0.5 * (x[:-1] + x[1:])
    knots = np.concatenate([x[:1], np.nextafter(x[:-1] if kind == "next" else middle, np.inf), x[-1:]])
    return _ended(knots, y[:, None], outside)


def _piecewise(pieces: PiecewisePolynomial, x: ca.SX) -> ca.SX:
    """Horner's rule with the coefficients of the piece that x is in."""
    at = x - pieces.period * ca.floor((x - pieces.first) / pieces.period) if pieces.period else x
    begins = pieces.begins
    *coefficients, begin = (_chosen([float(entry) for entry in row], begins[1:], at) for row in (*pieces.coefficients.T, begins))
    value, s = ca.SX(0), at - begin
    for coefficient in coefficients:
        value = value * s + coefficient
    return value


def _chosen(entries: list[float], between: np.ndarray, x: ca.SX) -> ca.SX:
    """The entry of the piece that x is in, found by halving."""
    if len(entries) == 1 or all(entry == entries[0] for entry in entries):
        return ca.SX(entries[0])
    half = len(entries) // 2
    return ca.if_else(
        x < float(between[half - 1]), _chosen(entries[:half], between[: half - 1], x), _chosen(entries[half:], between[half:], x)
    )
