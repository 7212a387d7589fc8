"""Rows and their derivatives by the unknowns of a search, from one kernel."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.assembly import Residual
from acausal.numerics.bound import BoundFunction
from acausal.numerics.folding import folded_function


@dataclass(frozen=True)
class Rows:
    """(y (n,), data) -> rows (m,) and Jacobian (m, n)."""

    kernel: BoundFunction
    unknowns: int

    @staticmethod
    def of(y: ca.SX, data: ca.SX, rows: ca.SX) -> Rows:
        """Of rows (m, 1) in y (n, 1) and the data."""
        both = ca.vertcat(ca.densify(rows), ca.vec(ca.densify(ca.jacobian(rows, y))))
        return Rows(BoundFunction.of(folded_function("residual", [ca.vertcat(y, data)], [both])), y.numel())

    def __call__(self, y: np.ndarray, data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both = self.kernel.at(np.concatenate([y, data])).copy()
        m = both.size // (self.unknowns + 1)
        return both[:m], both[m:].reshape(self.unknowns, m).T

    def at(self, data: np.ndarray) -> Residual:
        """For these data: y -> rows and Jacobian."""
        return lambda y: self(y, data)
