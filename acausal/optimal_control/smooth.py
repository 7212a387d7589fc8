"""A function with its derivatives, made once: programs on one mesh after another use them at other places."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.folding import folded_function
from acausal.optimal_control.lanes import Lane, mapped


@dataclass(frozen=True, eq=False)
class Smooth:
    """A `function` (z (n,), c (k,)) -> values (m,)."""

    function: ca.Function

    def picked(self, values: np.ndarray) -> Smooth:
        """Some of the values alone."""
        key = tuple(values.tolist())
        if key not in self._picked:
            z, c = self._symbols
            self._picked[key] = Smooth(folded_function("picked", [z, c], [self.function(z, c)[list(key)]]))
        return self._picked[key]

    @functools.cached_property
    def slopes(self) -> ca.Function:
        """(z, c) -> entries of the Jacobian of the values, by columns."""
        z, c = self._symbols
        return folded_function("slopes", [z, c], [_entries(self._jacobian)])

    @functools.cached_property
    def slope_entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the entries of `slopes`."""
        return _places(self._jacobian.sparsity())

    @functools.cached_property
    def curvature(self) -> ca.Function:
        """(z, c, factors (m,)) -> entries of the upper triangle of the Hessian of the values' sum with these factors, by columns."""
        return folded_function("curvature", [*self._symbols, self._factors], [_entries(self._hessian)])

    @functools.cached_property
    def curvature_entries(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the entries of `curvature`."""
        return _places(self._hessian.sparsity())

    @functools.cached_property
    def pull(self) -> ca.Function:
        """(z, c, factors (m,)) -> slopes of the values' sum with these factors, by z and c (n + k,)."""
        z, c = self._symbols
        summed = ca.dot(self._factors, self.function(z, c))
        return ca.Function("pull", [z, c, self._factors], [ca.densify(ca.gradient(summed, ca.vertcat(z, c)))])

    def mapped(self, function: ca.Function, count: int) -> ca.Function:
        """One of these functions, at `count` places; its lanes are made once."""
        lane = self._lanes.setdefault(function.name(), Lane(function))
        return mapped(function, count, lane)

    @functools.cached_property
    def _jacobian(self) -> ca.SX:
        z, c = self._symbols
        return ca.jacobian(self.function(z, c), z)

    @functools.cached_property
    def _hessian(self) -> ca.SX:
        z, c = self._symbols
        return ca.triu(ca.hessian(ca.dot(self._factors, self.function(z, c)), z)[0])

    @functools.cached_property
    def _factors(self) -> ca.SX:
        return ca.SX.sym("factors", self.function.size1_out(0))

    @functools.cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX]:
        return ca.SX.sym("z", self.function.size1_in(0)), ca.SX.sym("c", self.function.size1_in(1))

    @functools.cached_property
    def _picked(self) -> dict[tuple[int, ...], Smooth]:
        return {}

    @functools.cached_property
    def _lanes(self) -> dict[str, Lane]:
        return {}


def _entries(matrix: ca.SX) -> ca.SX:
    return ca.vec(ca.densify(matrix.nz[:])) if matrix.nnz() else ca.SX(0, 1)  # of a row, `nz` is a row


def _places(sparsity: ca.Sparsity) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = sparsity.get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)
