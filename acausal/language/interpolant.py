"""Splines of scipy as expressions: piecewise polynomials, so that they can be differentiated and compiled like any other formula."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.origin import origin


def is_spline(value: object) -> bool:
    """Whether it is one of scipy's interpolating functions."""
    return any(cls.__module__.startswith("scipy.interpolate") for cls in type(value).__mro__)


def of_spline(spline: Any, x: ca.SX) -> ca.SX | list[ca.SX]:
    """The value at the scalar `x`, or one for each column of data. Raises `ParameterError` for what is no piecewise polynomial.

    Beyond the data as the spline says itself: going on, periodic, or NaN.
    """
    from scipy.interpolate import BSpline, PPoly

    if isinstance(spline, BSpline):
        spline = PPoly.from_spline(spline, extrapolate=spline.extrapolate)
    if not isinstance(spline, PPoly) or np.iscomplexobj(spline.c) or spline.c.ndim > 3:
        raise ParameterError(
            f"{type(spline).__name__} of scipy cannot stand in an equation ({origin()}). Use a piecewise polynomial of one variable: CubicSpline, "
            "PchipInterpolator, Akima1DInterpolator or make_interp_spline."
        )
    c, knots = np.asarray(spline.c), np.asarray(spline.x)
    first, last = float(knots[0]), float(knots[-1])
    at = x - (last - first) * ca.floor((x - first) / (last - first)) if spline.extrapolate == "periodic" else x
    columns = c.reshape(*c.shape[:2], -1)
    values = [_piecewise(columns[:, :, j], knots, at) for j in range(columns.shape[2])]
    if not spline.extrapolate:
        values = [ca.if_else(ca.logic_and(x >= first, x <= last), value, np.nan) for value in values]
    return values if c.ndim == 3 else values[0]


def _piecewise(c: np.ndarray, knots: np.ndarray, x: ca.SX) -> ca.SX:
    """Horner's rule with the coefficients (k, pieces), highest power first, of the piece that x is in."""
    *coefficients, begin = (_chosen([float(entry) for entry in row], knots[1:-1], x) for row in (*c, knots[:-1]))
    value, s = ca.SX(0), x - begin
    for coefficient in coefficients:
        value = value * s + coefficient
    return value


def _chosen(entries: list[float], between: np.ndarray, x: ca.SX) -> ca.SX:
    """The entry of the piece that x is in, found by halving."""
    if all(entry == entries[0] for entry in entries):
        return ca.SX(entries[0])
    half = len(entries) // 2
    return ca.if_else(
        x < float(between[half - 1]), _chosen(entries[:half], between[: half - 1], x), _chosen(entries[half:], between[half:], x)
    )
