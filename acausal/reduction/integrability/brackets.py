"""Lie brackets of the admissible velocities, by automatic differentiation at points of the manifold of configurations.

The fields X_i span the admissible velocities, [X_i, B] = (DB) X_i - (DX_i) B. Only their values on the manifold matter, since they are
tangent to it; how they go on outside is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.reduction.integrability.pfaffian import PfaffianSystem

_ZERO = 1e-9
_CLEAR = 1e-6
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
    """How the space of reachable directions grows with brackets: its `dimensions`, and orthonormal columns of the last at each point.

    `complete`: no further bracket gives a new direction; otherwise the expressions became too large.
    """

    dimensions: tuple[int, ...]
    spaces: tuple[np.ndarray, ...]
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
            rows[other] = [a - factor * b if k != j else ca.SX(0) for k, (a, b) in enumerate(zip(rows[other], rows[i], strict=True))]
    free = [j for j in range(n) if j not in pivots]
    X = ca.SX.zeros(n, len(free))
    for k, j in enumerate(free):
        X[j, k] = 1
        for p, i in pivots.items():
            X[p, k] = -rows[i][j]
    return X


def _pivot(rows: Sequence[Sequence[ca.SX]], values: np.ndarray, open_rows: Sequence[int], columns: Sequence[int]) -> tuple[int, int] | None:
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
    level = _Level.of(system, X, X, points)
    bases = [rank.new_directions(np.zeros((X.shape[0], 0)), V, S)[0] for V, S in zip(level.values, level.scales, strict=True)]
    dimensions = [max(basis.shape[1] for basis in bases)]
    newest = X
    while dimensions[-1] < size:
        parts = [_bracket(X[:, i], newest[:, k], system.y) for i in range(X.shape[1]) for k in range(newest.shape[1])]
        pairs = [(a, b) for a, b in parts if not (a - b).is_zero()]
        if not pairs:
            return Closure(tuple(dimensions), tuple(bases), True)
        first, second = ca.horzcat(*(a for a, _ in pairs)), ca.horzcat(*(b for _, b in pairs))
        if ca.Function("size", [system.y], [first, second]).n_instructions() > _MOST_INSTRUCTIONS:
            return Closure(tuple(dimensions), tuple(bases), False)
        level = _Level.of(system, first, second, points)
        grown = [rank.new_directions(basis, V, S) for basis, V, S in zip(bases, level.values, level.scales, strict=True)]
        best = max(grown, key=lambda item: item[0].shape[1])
        bases = [basis for basis, _ in grown]
        if best[0].shape[1] == dimensions[-1]:
            return Closure(tuple(dimensions), tuple(bases), True)
        dimensions.append(best[0].shape[1])
        newest = (first - second)[:, best[1]]
    return Closure(tuple(dimensions), tuple(bases), True)


@dataclass
class _Level:
    """Values (n, k) of fields at each point, and their sizes (k,) before the two parts of a bracket cancel."""

    values: list[np.ndarray] = field(default_factory=list)
    scales: list[np.ndarray] = field(default_factory=list)

    @classmethod
    def of(cls, system: PfaffianSystem, first: ca.SX, second: ca.SX, points: Sequence[np.ndarray]) -> _Level:
        function = ca.Function("fields", [system.y], [ca.densify(first), ca.densify(second)])
        level = cls()
        for point in points:
            A, B = (np.array(part) for part in function(point))
            alone = first is second
            level.values.append(A if alone else A - B)
            level.scales.append(np.linalg.norm(A, axis=0) + (0.0 if alone else np.linalg.norm(B, axis=0)))
        return level


def _bracket(X: ca.SX, B: ca.SX, y: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(DB) X and (DX) B, whose difference is [X, B]."""
    return ca.densify(ca.jtimes(B, y, X)), ca.densify(ca.jtimes(X, y, B))
