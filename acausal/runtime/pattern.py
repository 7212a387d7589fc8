"""Which entries of a Jacobian are not zero, and what follows from it for computing and factoring it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.staged import Function, dependence


@dataclass(frozen=True)
class Pattern:
    """Entries of df/dx by columns: `start` (n + 1,) and `row` (entries,); a `colour` (n,) for each column, 0 .. `colours` - 1, columns of one colour
    sharing no row; an `order` (n,) of elimination with little fill (approximate minimum degree), and what it leaves: `fill` entries of L, and `work`,
    the squares of their numbers by columns, summed.
    """

    start: np.ndarray
    row: np.ndarray
    colour: np.ndarray
    colours: int
    order: np.ndarray
    fill: int
    work: float

    @functools.cached_property
    def most(self) -> int:
        """Entries that L or U of 1 - z df/dx have at most, whatever the pivots: those of the Cholesky factor of A'A for A with columns in this order (George
        and Ng, An implementation of Gaussian elimination with partial pivoting for sparse systems, 1985).
        """
        n = self.order.size
        A = _with_diagonal(ca.Sparsity(n, n, self.start.tolist(), self.row.tolist())).sub(list(range(n)), self.order.tolist())[0]
        return ca.mtimes(A.T, A).ldl(False)[0].nnz() + n


def jacobian_pattern(rhs: Function) -> Pattern:
    """Of rhs(t, x, u, p) by x."""
    entries = dependence(rhs, 1)
    colours = entries.uni_coloring()
    colour = np.zeros(entries.size2(), dtype=np.int64)
    columns, groups = colours.get_triplet()
    colour[columns] = groups
    whole = _with_diagonal(entries)
    L, order = (whole + whole.T).ldl()
    below = np.diff(np.array(L.colind(), dtype=np.int64)) + 1
    numbers = (np.array(values, dtype=np.int64) for values in (entries.colind(), entries.row(), order))
    start, row, order = numbers
    return Pattern(start, row, colour, colours.size2(), order, int(below.sum()), float((below.astype(float) ** 2).sum()))


def _with_diagonal(entries: ca.Sparsity) -> ca.Sparsity:
    return entries + ca.Sparsity.diag(entries.size1())
