"""Rows that are independent beyond doubt, found and used in time that grows like the number of their entries.

Singular values tell everything about a matrix and cost the cube of its size. Constraints of large mechanisms have few entries each, and
nearly always it is plain which of them are independent: L D L' = J J' then gives the same steps (Bjorck, Numerical Methods for Least
Squares Problems, 1996, ch. 6), and says so itself where it is in doubt.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.thresholds import DEPENDENT

LARGE = 32
"""Rows and columns of a matrix (m, n) above which libraries find singular values in blocks, on all cores, others' work or not: this is quicker."""
_PLAIN = 1e-8
"""Square of the sine of the angle between a row and those before it, above which it is independent of them."""
_LIFT = 1e-12
"""Part of its square that is added to each row's, so that none vanishes."""
_FOLLOWS = 0.1
"""What may be left of another one beside the span of these, as part of what counts as zero."""
_SUMS = 3
_SURE = 1e-4
"""Singular values above this part of the largest are no matter of doubt ..."""
_MARGIN = 1e3
"""... nor are those that are so many times what counts as zero."""
_LOOKS, _MOST = 4, 60
"""Inverse iterations for a look at the smallest singular value, and most of those that find it."""
_HELD, _LET, _REFINED, _EXACT = 1e-8, 1e-6, 6, 1e-12
"""What makes systems of wishes and rows definite, for these and those; times that their solution is refined, and to what part."""
_DENSE = 128
"""Rows and columns up to which a factor is dense."""
_FEW = 16
"""Free directions that are found one by one."""


@dataclass(frozen=True)
class Sparse:
    """A matrix (m, n) by its entries, column by column."""

    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    @staticmethod
    def of(J: np.ndarray) -> Sparse:
        """The entries that are not zero."""
        columns, rows = np.nonzero(J.T)
        return Sparse(J.shape, rows, columns, J[rows, columns])

    def only(self, rows: np.ndarray) -> Sparse:
        """Some of the rows, in their order."""
        place = np.full(self.shape[0], -1)
        place[rows] = np.arange(rows.size)
        kept = place[self.rows] >= 0
        return Sparse((rows.size, self.shape[1]), place[self.rows[kept]], self.columns[kept], self.values[kept])

    def times(self, x: np.ndarray) -> np.ndarray:
        """J x (m,)."""
        return np.bincount(self.rows, self.values * x[self.columns], self.shape[0])

    def transposed_times(self, c: np.ndarray) -> np.ndarray:
        """J' c (n,)."""
        return np.bincount(self.columns, self.values * c[self.rows], self.shape[1])

    @staticmethod
    def of_casadi(matrix: ca.DM) -> Sparse:
        """The entries of a matrix of CasADi."""
        rows, columns = matrix.sparsity().get_triplet()
        return Sparse(matrix.shape, np.array(rows, dtype=int), np.array(columns, dtype=int), np.array(matrix.nonzeros()))

    @property
    def turned(self) -> Sparse:
        """J'."""
        order = np.lexsort((self.columns, self.rows))
        return Sparse((self.shape[1], self.shape[0]), self.columns[order], self.rows[order], self.values[order])

    @property
    def casadi(self) -> ca.DM:
        """The same for CasADi."""
        starts = np.concatenate([[0], np.cumsum(np.bincount(self.columns, minlength=self.shape[1]))])
        return ca.DM(ca.Sparsity(*self.shape, starts.tolist(), self.rows.tolist()), self.values.tolist())


@dataclass(frozen=True)
class Independent:
    """Rows of a matrix (m, n) that span all of them; `rows`: which (k,)."""

    rows: np.ndarray
    matrix: Sparse
    """These rows (k, n)."""
    solve: Callable[[np.ndarray], np.ndarray]
    """c (k,) -> (J J')^-1 c."""

    @staticmethod
    def of(J: np.ndarray, dependent: float = DEPENDENT) -> Independent | None:
        """None where the matrix is small, or where singular values have to say which rows are independent: none are that are below `dependent`."""
        if min(J.shape) <= LARGE or not np.isfinite(J).all():
            return None
        dense = _of_few(J, dependent) if max(J.shape) <= _DENSE else None
        if dense is not None:
            return dense
        rows, matrix = np.arange(J.shape[0]), Sparse.of(J)
        gram, others = _gram(matrix), np.zeros(0, dtype=int)
        solve, heights, most = _factorised(gram)
        if not (heights > _PLAIN).all():  # pivots of rounding errors spoil those after them
            lengths = np.array(ca.diag(gram).full()).ravel()
            heights = _factorised(gram + ca.diag(ca.DM(np.where(lengths > 0, _LIFT * lengths, 1.0))))[1]
            high = (lengths > 0) & (heights > _PLAIN)
            rows, others = np.flatnonzero(high), np.flatnonzero(~high)
            matrix = matrix.only(rows)
            solve, heights, most = _factorised(_gram(matrix))
        found = Independent(rows, matrix, solve)
        if not rows.size or not (heights > _PLAIN).all():
            return None
        # a few sums of the others say what all of them do
        sums = np.random.default_rng(10).normal(size=(_SUMS if others.size else 0, others.size)) @ J[others]
        if any(np.max(np.abs(found.free(found.free(row)))) > _FOLLOWS * dependent for row in sums):
            return None
        return found if found._is_above(_sure(dependent, most)) else None

    @property
    def freedoms(self) -> int:
        """Directions that no row feels."""
        return self.matrix.shape[1] - self.rows.size

    def least(self, c: np.ndarray) -> np.ndarray:
        """The least x (n,) with J x = c (m,), for c that these rows say all of."""
        return self.matrix.transposed_times(self.solve(c[self.rows]))

    def free(self, x: np.ndarray) -> np.ndarray:
        """The part of x (n,) that no row feels."""
        return x - self.matrix.transposed_times(self.solve(self.matrix.times(x)))

    @functools.cached_property
    def smallest(self) -> float:
        """The smallest singular value of the rows."""
        return float(self._least_values(_MOST)[0][0])

    @functools.cached_property
    def basis(self) -> np.ndarray:
        """(n, freedoms), orthonormal: all directions that no row feels."""
        if self.freedoms > _FEW:
            return np.linalg.qr(self.matrix.casadi.full().T, mode="complete")[0][:, self.rows.size :]
        found = np.random.default_rng(8).normal(size=(self.matrix.shape[1], self.freedoms))
        for _twice in range(2):
            found = np.linalg.qr(np.array([self.free(x) for x in found.T]).reshape(found.T.shape).T)[0]
        return found

    def softest(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Some of the smallest singular values (k,), the least first, their directions (k, n) and weights of rows (k, rows)."""
        values, weights = self._least_values(_MOST, count)
        return values, np.array([self.matrix.transposed_times(w) for w in weights]) / values[:, None], weights

    def least_along(self, r: np.ndarray, W: np.ndarray, radius: float, dampings: np.ndarray) -> np.ndarray | None:
        """Of the x (n,) that no row feels, the least that minimises |r + W x|, damped by as few of the `dampings` as keep its entries within
        `radius`; None where rounding says too much about it.
        """
        J, wishes = self.matrix.casadi, Sparse.of(W)
        squares, wanted = _gram(wishes.turned), wishes.transposed_times(r)
        most = _bound(squares)
        step = self._held(J, squares, most * _HELD, wanted)
        if step is None or np.max(np.abs(step)) <= radius:
            return step
        few, many = 0, len(dampings) - 1
        while few < many:
            middle = (few + many) // 2
            step = self._held(J, squares, most * max(_HELD, dampings[middle]), wanted)
            if step is None:
                return None
            few, many = (few, middle) if np.max(np.abs(step)) <= radius else (middle + 1, many)
        step = self._held(J, squares, most * max(_HELD, dampings[few]), wanted)
        return None if step is None else step * min(1.0, radius / np.max(np.abs(step)))

    def _held(self, J: ca.DM, squares: ca.DM, damping: float, wanted: np.ndarray) -> np.ndarray | None:
        """The x that no row feels with (squares + damping) x + wanted a sum of rows, of a quasidefinite system (Vanderbei 1995), refined."""
        n, k = self.matrix.shape[1], self.rows.size
        top = squares + damping * ca.DM.eye(n)
        whole = ca.blockcat([[top, J.T], [J, -_LET / max(1.0, damping) * ca.DM.eye(k)]])
        solve, found = _factorised(whole)[0], np.zeros(n + k)
        top = Sparse.of_casadi(top)
        for _ in range(_REFINED):
            x, y = found[:n], found[n:]
            left = np.concatenate([-wanted - top.times(x) - self.matrix.transposed_times(y), -self.matrix.times(x)])
            if np.max(np.abs(left)) <= _EXACT * np.max(np.abs(wanted), initial=0.0):
                return x
            found = found + solve(left)
        return None

    def _is_above(self, value: float) -> bool:
        """Whether a few inverse iterations find no singular value below this one."""
        x = np.random.default_rng(9).normal(size=self.rows.size)
        for _ in range(_LOOKS):
            x = self.solve(x / np.linalg.norm(x))
        return bool(np.linalg.norm(x) * value**2 < 1.0)

    def _least_values(self, most: int, count: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """By inverse iteration (Lanczos), no value below the true one; with the weights of rows (k, rows)."""
        k = self.rows.size
        start = np.random.default_rng(9).normal(size=k)
        known = np.zeros((min(k, most), k))
        known[0] = start / np.linalg.norm(start)
        alpha, beta, best = list[float](), list[float](), np.zeros(count)
        levels, vectors = np.zeros(1), np.ones((1, 1))
        for step in range(len(known)):
            w = self.solve(known[step])
            alpha.append(float(w @ known[step]))
            for _twice in range(2):
                w = w - (known[: step + 1] @ w) @ known[: step + 1]
            levels, vectors = np.linalg.eigh(np.diag(alpha) + np.diag(beta, 1) + np.diag(beta, -1))
            found, length = levels[: -count - 1 : -1], float(np.linalg.norm(w))
            settled = found.size == count and np.all(np.abs(found - best) <= 1e-10 * found[0])
            if settled or step + 1 == len(known) or length <= 1e-12 * found[0]:
                break
            best = np.resize(found, count)
            beta.append(length)
            known[step + 1] = w / length
        found = np.maximum(levels[: -count - 1 : -1], np.finfo(float).tiny)
        return found**-0.5, vectors[:, : -count - 1 : -1].T @ known[: len(alpha)]


def _sure(dependent: float, most: float) -> float:
    """Above which no singular value is a matter of doubt; `most`: a bound of the square of the largest."""
    return max(_SURE, _MARGIN * dependent) * max(1.0, most**0.5)


def _of_few(J: np.ndarray, dependent: float) -> Independent | None:
    """`Independent.of` where all rows are, by a dense factor of J J': looking for the entries takes longer than they do. None where that leaves doubts."""
    gram = J @ J.T
    try:
        L = np.linalg.cholesky(gram)
    except np.linalg.LinAlgError:
        return None
    if not (np.diag(L) ** 2 > _PLAIN * np.diag(gram)).all():
        return None
    inverse = np.linalg.inv(L)
    # |L^-1| >= 1 / the smallest singular value
    if not np.linalg.norm(inverse) * _sure(dependent, _most(gram)) < 1.0:
        return None
    return Independent(np.arange(len(J)), Sparse.of(J), lambda c: inverse.T @ (inverse @ c))


def rank_of(J: np.ndarray, zero: float) -> int:
    """How many singular values of a matrix are above this part of the largest, or of 1 where that is less."""
    plain = Independent.of(J, zero)
    if plain is not None:
        return plain.rows.size
    s = np.linalg.svd(J, compute_uv=False)
    return int(np.sum(s > zero * np.max(s, initial=1.0)))


def free_directions(J: np.ndarray, zero: float) -> tuple[Callable[[np.ndarray], np.ndarray], int]:
    """x (n,) -> its part that no row of J (m, n) feels; and how many directions are free. `zero` as for `rank_of`."""
    plain = Independent.of(J, zero)
    if plain is not None:
        return plain.free, plain.freedoms
    _, s, Vt = np.linalg.svd(J)
    free = Vt[int(np.sum(s > zero * np.max(s, initial=1.0))) :].T
    return lambda x: free @ (free.T @ x), free.shape[1]


def inverse(J: np.ndarray, zero: float, rank: int | None = None) -> Callable[[np.ndarray], np.ndarray]:
    """c (m,) -> the least x (n,) that minimises |J x - c|, J of this rank; unless it is given, as many singular values as are above that part of
    the largest.
    """
    plain = Independent.of(J, zero)
    if plain is not None and rank in (None, plain.rows.size):
        return plain.least
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    kept = int(np.sum(s > zero * np.max(s, initial=0.0))) if rank is None else rank
    Vt[:, ~J.any(axis=0)] = 0.0  # but for rounding: what no row depends on stays exactly as it is
    inverse = (Vt[:kept].T / s[:kept]) @ U[:, :kept].T
    return lambda c: inverse @ c


def damped(J: np.ndarray) -> tuple[Callable[[np.ndarray, float], np.ndarray], float]:
    """(c (m,), d) -> J' (J J' + d 1)^-1 c, for d > 0 and a matrix (m, n) with few entries; and a bound of the square of its largest singular value."""
    wide = J.shape[0] <= J.shape[1]
    if max(J.shape) <= _DENSE:
        square = J @ J.T if wide else J.T @ J

        def dense_step(c: np.ndarray, damping: float) -> np.ndarray:
            solution = np.linalg.solve(square + damping * np.eye(len(square)), c if wide else J.T @ c)
            return J.T @ solution if wide else solution

        return dense_step, _most(square)
    matrix = Sparse.of(J if wide else J.T)
    gram = _gram(matrix)
    one = ca.DM.eye(gram.shape[0])

    def step(c: np.ndarray, damping: float) -> np.ndarray:
        solve = _factorised(gram + damping * one)[0]
        return matrix.transposed_times(solve(c)) if wide else solve(matrix.times(c))

    return step, _factorised(gram)[2]


def _gram(matrix: Sparse) -> ca.DM:
    J = matrix.casadi
    return ca.mtimes(J, J.T)


def _factorised(gram: ca.DM) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray, float]:
    """Solutions with a symmetric matrix (m, m), semidefinite; the squares of the sines between each row and those before it; a bound of the
    largest eigenvalue (Gershgorin).
    """
    D, LT, order = ca.ldl(gram)
    heights, dense = np.zeros(gram.shape[0]), ca.Sparsity.dense(gram.shape[0], 1)
    lengths = np.array(ca.diag(gram).full()).ravel()[order]
    heights[order] = np.divide(D.full().ravel(), lengths, out=np.zeros(lengths.size), where=lengths > 0)

    def solve(c: np.ndarray) -> np.ndarray:
        return np.array(ca.ldl_solve(ca.DM(dense, c.tolist()), D, LT, order).nonzeros())

    return solve, heights, _bound(gram)


def _most(gram: np.ndarray) -> float:
    """A bound of the largest eigenvalue (Gershgorin)."""
    return float(np.max(np.sum(np.abs(gram), axis=0)))


def _bound(gram: ca.DM) -> float:
    columns = np.array(gram.sparsity().get_col(), dtype=int)
    return float(np.max(np.bincount(columns, np.abs(gram.nonzeros()), gram.shape[1]), initial=0.0))
