"""Lie brackets of the admissible velocities, by automatic differentiation at points of the manifold of configurations.

The fields X_i span the admissible velocities, [X_i, B] = (DB) X_i - (DX_i) B. Only their values on the manifold matter, since they are
tangent to it; how they go on outside is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.explain.integrability.pfaffian import PfaffianSystem
from acausal.numerics.folding import folded

_ZERO = 1e-9
_CLEAR = 1e-6
_FLOOR = 1e-4
_MOST_INSTRUCTIONS = 300_000


@dataclass
class Rank:
    """Counts directions one by one, and keeps how clear each decision was: `smallest` that was taken, `largest` that was not."""

    smallest: float = 1.0
    largest: float = 0.0

    @property
    def clear(self) -> bool:
        """Whether no decision was near the border between rounding errors and a direction of its own."""
        return self.smallest > _CLEAR and self.largest < _ZERO

    def new_directions(self, basis: np.ndarray, vectors: np.ndarray, scales: np.ndarray) -> tuple[np.ndarray, list[int]]:
        """Orthonormal columns `basis` (n, r) grown by columns of `vectors` (n, k), and which were taken: the largest remainder first.

        `scales` (k,): sizes before cancellation, which say what rounding errors are.
        """
        rest = vectors / np.where(scales > 0, scales, 1.0)
        taken: list[int] = []
        while basis.shape[1] < basis.shape[0]:
            for _twice in range(2):
                rest = rest - basis @ (basis.T @ rest)
            sizes = np.linalg.norm(rest, axis=0)
            best = int(np.argmax(sizes)) if sizes.size else 0
            if not sizes.size or sizes[best] < np.sqrt(_ZERO * _CLEAR):
                self.largest = max(self.largest, float(sizes[best]) if sizes.size else 0.0)
                break
            self.smallest = min(self.smallest, float(sizes[best]))
            taken.append(best)
            basis = np.column_stack([basis, rest[:, best] / sizes[best]])
        return basis, taken


@dataclass(frozen=True)
class Closure:
    """How the space of reachable directions grows with brackets: its `dimensions`.

    `complete`: no further bracket gives a new direction; otherwise the expressions became too large.
    """

    dimensions: tuple[int, ...]
    complete: bool


def admissible_fields(system: PfaffianSystem, point: np.ndarray) -> ca.SX:
    """Fields (n, d) that satisfy all constraints on the manifold, near `point` (n,).

    Gauss-Jordan elimination of the constraint rows in symbols, pivots chosen by their values at the point: constants first, which keep the
    expressions short. Rows that vanish at the point (redundant ones, also those which hold only on the manifold) are left out.
    """
    n = system.y.numel()
    G = ca.densify(ca.vertcat(ca.jacobian(system.holonomic, system.y), system.forms))
    values = np.array(ca.Function("rows", [system.y], [G])(point)).reshape(-1, n)
    rows = [[G[i, j] for j in range(n)] for i in range(G.shape[0])]
    pivots: dict[int, int] = {}
    open_rows = set(range(G.shape[0]))
    while open_rows:
        found = _pivot(rows, values, sorted(open_rows), [j for j in range(n) if j not in pivots])
        if found is None:
            break
        i, j = found
        open_rows.discard(i)
        pivots[j] = i
        values[i] = values[i] / values[i, j]
        rows[i] = [entry / rows[i][j] if k != j else ca.SX(1) for k, entry in enumerate(rows[i])]
        for other in range(len(rows)):
            factor = rows[other][j]
            if other == i or factor.is_zero():
                continue
            values[other] = values[other] - values[other, j] * values[i]
            rows[other] = [
                a - factor * b if k != j else ca.SX(0) for k, (a, b) in enumerate(zip(rows[other], rows[i], strict=True))
            ]
    free = [j for j in range(n) if j not in pivots]
    X = ca.SX.zeros(n, len(free))
    for k, j in enumerate(free):
        X[j, k] = 1
        for p, i in pivots.items():
            X[p, k] = -rows[i][j]
    return X


def _pivot(
    rows: Sequence[Sequence[ca.SX]], values: np.ndarray, open_rows: Sequence[int], columns: Sequence[int]
) -> tuple[int, int] | None:
    """The entry to divide by: not small, constant where possible, in a row and column with few others. None where all vanish."""
    rest = np.abs(values[np.ix_(open_rows, columns)])
    if rest.size == 0 or np.max(rest) < _ZERO:
        return None
    heights = np.max(rest, axis=1, initial=0.0)
    best, cost = None, (np.inf, np.inf)
    for a, i in enumerate(open_rows):
        for b, j in enumerate(columns):
            if heights[a] < _ZERO or rest[a, b] < 0.2 * heights[a]:
                continue
            fill = (np.count_nonzero(rest[a] > _ZERO) - 1) * (np.count_nonzero(rest[:, b] > _ZERO) - 1)
            own = (0.0 if rows[i][j].is_constant() else 1.0, float(fill))
            if own < cost:
                best, cost = (i, j), own
    return best


def involutive_closure(system: PfaffianSystem, points: Sequence[np.ndarray], size: int, rank: Rank) -> Closure:
    """D, D + [D, D], D + [D, D] + [D, [D, D]] ... at the points, until nothing new comes or there are `size` dimensions.

    Each bracket goes one derivative deeper, and expressions grow about threefold.
    """
    X = admissible_fields(system, points[0])
    generators = _values(system, [X], points)
    newest, sizes = X, [np.linalg.norm(values[0], axis=0) for values in generators]
    bases = [rank.new_directions(np.zeros((X.shape[0], 0)), V[0], s)[0] for V, s in zip(generators, sizes, strict=True)]
    dimensions = [max(basis.shape[1] for basis in bases)]
    while dimensions[-1] < size:
        pairs = [(i, k) for i in range(X.shape[1]) for k in range(newest.shape[1])]
        parts = [_bracket(X[:, i], newest[:, k], system.y) for i, k in pairs]
        first, second = (ca.horzcat(*column) for column in zip(*parts, strict=True))
        if ca.Function("size", [system.y], [first, second]).n_instructions() > _MOST_INSTRUCTIONS:
            return Closure(tuple(dimensions), False)
        brackets: list[np.ndarray] = []
        grown: list[tuple[np.ndarray, list[int]]] = []
        for basis, V, own, (A, B) in zip(bases, generators, sizes, _values(system, [first, second], points), strict=True):
            # what cancels within a bracket leaves rounding errors that its own size does not tell
            floor = np.array([np.linalg.norm(V[0][:, i]) * own[k] for i, k in pairs])
            scales = np.linalg.norm(A, axis=0) + np.linalg.norm(B, axis=0)
            scales = np.maximum(scales, _FLOOR * np.maximum(floor, np.max(scales)))
            grown.append(rank.new_directions(basis, A - B, scales))
            brackets.append(A - B)
        bases = [basis for basis, _ in grown]
        taken = max((chosen for _, chosen in grown), key=len)
        if not taken:
            break
        dimensions.append(max(basis.shape[1] for basis in bases))
        newest = folded((first - second)[:, taken])
        sizes = [np.linalg.norm(values[:, taken], axis=0) for values in brackets]
    return Closure(tuple(dimensions), True)


def _values(system: PfaffianSystem, fields: Sequence[ca.SX], points: Sequence[np.ndarray]) -> list[list[np.ndarray]]:
    function = ca.Function("fields", [system.y], [ca.densify(each) for each in fields])
    return [[np.array(each) for each in function.call([point])] for point in points]


def _bracket(X: ca.SX, B: ca.SX, y: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(DB) X and (DX) B, whose difference is [X, B]."""
    return ca.densify(ca.jtimes(B, y, X)), ca.densify(ca.jtimes(X, y, B))
