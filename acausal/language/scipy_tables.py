"""scipy's tables of several variables on a grid, as formulas: tensor products of piecewise polynomials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.casadi_tables import Table, product
from acausal.language.origin import origin

_DEGREES = {"linear": 1, "slinear": 1, "cubic": 3, "quintic": 5}


@dataclass(frozen=True)
class Bounded:
    """A table with what it is beyond its data: that at the nearest place of them where `outside` is None, else this number."""

    table: Table
    least: np.ndarray
    most: np.ndarray
    outside: float | None

    @property
    def variables(self) -> int:
        return self.least.size

    def at(self, x: list[ca.SX]) -> ca.SX:
        """The value (1, 1) at the variables."""
        ends = list(zip(x, self.least.tolist(), self.most.tolist(), strict=True))
        if self.outside is None:
            return self.table.at([ca.if_else(v < a, a, ca.if_else(v > b, b, v)) for v, a, b in ends])
        inside = ca.SX(1)
        for v, a, b in ends:
            inside = ca.logic_and(inside, ca.logic_and(v >= a, v <= b))
        return ca.if_else(inside, self.table.at(x), self.outside)


def table_of(given: Any) -> Table | Bounded | None:
    """Of scipy's tables on a grid; None for anything else. Raises `ParameterError` for one that is no piecewise polynomial, or not of scalars."""
    from scipy import interpolate

    if isinstance(given, interpolate.BivariateSpline):
        spline: Any = given
        knots, degrees = spline.get_knots(), spline.degrees
        shape = [axis.size - degree - 1 for axis, degree in zip(knots, degrees, strict=True)]
        return _bounded(list(knots), degrees, spline.get_coeffs().reshape(shape), None)
    if isinstance(given, interpolate.RegularGridInterpolator):
        return _of_grid(given)
    if isinstance(given, getattr(interpolate, "NdBSpline", ())):
        degrees = given.k if isinstance(given.k, tuple) else (given.k,) * len(given.t)
        if given.extrapolate:
            return _scalar(product(list(given.t), degrees, given.c, going_on=True))
        return _bounded(list(given.t), degrees, given.c, np.nan)
    return None


def _of_grid(given: Any) -> Table | Bounded:
    from scipy.interpolate import make_interp_spline

    degree = _DEGREES.get(given.method)
    if degree is None:
        raise ParameterError(
            f"RegularGridInterpolator by the method '{given.method}' cannot stand here ({origin()}). Use 'linear', 'slinear', 'cubic' or 'quintic'."
        )
    coefficients, knots = np.asarray(given.values, dtype=float), list[np.ndarray]()
    for k, axis in enumerate(given.grid):
        spline: Any = make_interp_spline(axis, np.moveaxis(coefficients, k, 0), degree)
        coefficients = np.moveaxis(spline.c, 0, k)
        knots.append(spline.t)
    degrees = (degree,) * len(knots)
    grid: Any = given
    if grid.fill_value is None and not grid.bounds_error:
        return _scalar(product(knots, degrees, coefficients, going_on=True))
    return _bounded(knots, degrees, coefficients, np.nan if grid.bounds_error else np.asarray(grid.fill_value).item())


def _bounded(knots: list[np.ndarray], degrees: Any, coefficients: np.ndarray, outside: float | None) -> Bounded:
    ends = np.array([(axis[degree], axis[-degree - 1]) for axis, degree in zip(knots, degrees, strict=True)], dtype=float)
    return Bounded(_scalar(product(knots, degrees, coefficients, going_on=True)), ends[:, 0], ends[:, 1], outside)


def _scalar(table: Table | None) -> Table:
    if table is None:
        raise ParameterError(
            f"A table of scipy with more than one value at each place cannot stand here ({origin()}). Make one for each."
        )
    return table
