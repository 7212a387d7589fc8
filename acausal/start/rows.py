"""Rows and their derivatives by the unknowns of a search, from one kernel."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.assembly import Residual
from acausal.numerics.bound import BoundFunction
from acausal.numerics.entries import entries, placed, places


@dataclass(frozen=True)
class Rows:
    """(y (n,), data) -> rows (m,) and Jacobian (m, n). The kernel gives the rows and the Jacobian's entries, which are at `places`."""

    kernel: BoundFunction
    places: tuple[np.ndarray, np.ndarray]
    shape: tuple[int, int]

    @staticmethod
    def of(y: ca.SX, data: ca.SX, rows: ca.SX) -> Rows:
        """Of rows (m, 1) in y (n, 1) and the data."""
        J = ca.jacobian(rows, y)
        both = ca.vertcat(ca.densify(rows), entries([J]))
        return Rows(BoundFunction.of(ca.Function("residual", [ca.vertcat(y, data)], [both])), places(J.sparsity()), J.shape)

    def __call__(self, y: np.ndarray, data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both, m = self.kernel.at(np.concatenate([y, data])), self.shape[0]
        return both[:m].copy(), placed(both[m:], *self.places, self.shape)

    def at(self, data: np.ndarray) -> Residual:
        """For these data: y -> rows and Jacobian."""
        return lambda y: self(y, data)
