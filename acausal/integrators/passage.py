"""States next to singular positions of loops, where branches of the motion cross: a branch is found from points to either side.

The runtime does the same in every step (acausal/runtime/passage.h, whose numbers these are).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.collocation.problem import Problem
from acausal.numerics.staged import plain

_CROSSING = 5e-5
_AHEAD = 0.016
_NODES = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
POINTS = _NODES.size
"""To either side of a state, together."""
_WEIGHTS = np.array([-1 / 70, 4 / 35, -2 / 5, 4 / 5, 4 / 5, -2 / 5, 4 / 35, -1 / 70])
_INNER = np.array([0, 1 / 20, -3 / 10, 3 / 4, 3 / 4, -3 / 10, 1 / 20, 0])
"""Of a polynomial's values at the nodes, for its value at 0; at the inner ones."""
_SLOPES = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""The same for its derivative there."""
_STRAIGHT = 1e-9
"""Part of the velocities next to a singular position by which those between points to either side may differ, where nothing tells that the motion turns aside."""
_SMOOTH = 1e-3
"""Part of values at points to either side by which a polynomial through these may miss nearer ones."""
_THROWN = 8.0
"""Times as far as what lies between points to either side, that closing loops throws a state which is taken from there."""
_CORRECTIONS = 4
_SEARCH = 30
_NEARER = np.array([1.0, 1 / 8, 1 / 64])
"""Parts of the usual distance of points to either side that a motion is read between."""


@dataclass(frozen=True)
class Passage:
    """Rates and states of a problem near singular positions."""

    problem: Problem

    def clearances(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n,) at states X (n, nx)."""
        native = self.problem.native
        if native is not None:
            return native.clearances(t, X, self.problem.parameters)
        assert self.problem.clearance is not None
        return np.array(self.problem.clearance(t[None, :], X.T, self._p(t.size)))[0]

    def crossing(self, t: np.ndarray, X: np.ndarray, h: np.ndarray) -> np.ndarray:
        """How far [s] (n,) to go ahead and back from states X (n, nx), in steps of size h, to have clearance; no number where that leads nowhere."""
        ahead, tau, distance = self._ahead(t, X), h.copy(), np.full(t.size, np.inf)

        def look(some: np.ndarray) -> None:
            """Takes distances there on average; distances grow in proportion to |tau|."""
            moved = np.concatenate([-tau[some], tau[some]])[:, None] * np.tile(ahead[some], (2, 1))
            there = np.tile(t[some], 2) + moved[:, 0], np.tile(X[some], (2, 1)) + moved[:, 1:]
            distance[some] = np.sqrt(np.maximum(self.clearances(*there), 0.0)).reshape(2, -1).mean(axis=0)

        for factor, wrong in ((0.25, lambda: distance > 2 * _AHEAD), (4.0, lambda: distance < 0.5 * _AHEAD)):
            for _ in range(_SEARCH):
                if not (some := wrong()).any():
                    break
                tau[some] *= factor
                look(some)
        for _ in range(2):
            if (some := (distance > 0) & (distance < np.inf)).any():
                tau[some] *= _AHEAD / distance[some]
                look(some)
        return np.where((distance > 0.5 * _AHEAD) & (distance < 2 * _AHEAD), tau, np.nan)

    def points(self, t: np.ndarray, X: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times (n, 8) and states (n, 8, nx) to either side, with closed loops."""
        moved = tau[:, None, None] * _NODES[:, None] * self._ahead(t, X)[:, None, :]
        times, found = t[:, None] + moved[..., 0], X[:, None, :] + moved[..., 1:]
        for _ in range(_CORRECTIONS):
            found = self.projected(times.ravel(), found.reshape(times.size, -1)).reshape(found.shape)
        return times, found

    def between(self, t: np.ndarray, X: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """States (n, nx) between the points to either side of those at a singular position, on a branch; no numbers where none are found."""
        found, known = np.full(X.shape, np.nan), np.flatnonzero(tau > 0)
        if not known.size:
            return found
        points = self.points(t[known], X[known], tau[known])[1]
        good = np.isfinite(points).all(axis=(1, 2))
        found[known[good]] = _WEIGHTS @ points[good]
        return found

    def nearest(
        self, t: np.ndarray, X: np.ndarray, closed: np.ndarray, h: np.ndarray, usual: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Of states (n, nx) next to singular positions `closed`, where loops are closed at X itself, or what lies between points to either side, nearer ones where
        the motion bends: those whose velocities, times `usual` (nx,), are nearest to those of X by far. And how far these are [s] (n, 3), no numbers where the
        motion does not lead straight through.
        """

        def size(V: np.ndarray) -> np.ndarray:
            return np.linalg.norm((V * usual)[:, self.problem.positions :], axis=1)

        # no nearer, or one of those to either side would come to lie in the position itself
        least = 2 * np.sqrt(np.maximum(self.clearances(t, X), 0.0)) / _AHEAD
        aside = self.crossing(t, X, h)[:, None] * np.maximum(_NEARER, least[:, None])
        best, off = closed, size(closed - X) / _THROWN
        straight = np.zeros(t.size, dtype=bool)
        for tau in aside.T:
            found = self.between(t, X, tau)
            moved = size(found - X)
            straight |= moved < np.maximum(off, _STRAIGHT * size(X))
            best = np.where((moved < off)[:, None], found, best)
            off = np.fmin(moved, off)
        return best, np.where(straight[:, None], aside, np.nan)

    def bends(self, far: np.ndarray, near: np.ndarray) -> np.ndarray:
        """(n,): where near points to either side tell more than far ones, though rounding errors are larger in them: where these, of values (rows, n, 8), differ
        less from near ones than without the outermost points they do.
        """
        found, other, inner = self.middle(far), self.middle(near), far @ _INNER
        less, more = np.abs(found - other) < np.abs(found - inner), np.abs(found - other) > np.abs(found - inner)
        return less.sum(axis=0) > more.sum(axis=0)

    def is_smooth(self, far: np.ndarray, near: np.ndarray, part: np.ndarray) -> np.ndarray:
        """(n,): where values (rows, n, 8) at points to either side, and at `part` (n,) of their distance, belong to one polynomial. They do not where a force
        becomes infinite in between.
        """
        powers = np.arange(POINTS)
        nearer = (part[:, None, None] * _NODES[:, None]) ** powers @ np.linalg.inv(_NODES[:, None] ** powers)
        missed = np.abs(near - np.einsum("rnk,njk->rnj", far, nearer))
        return missed.max(axis=(0, 2)) <= _SMOOTH * np.abs(far).max(axis=(0, 2))

    def middle(self, values: np.ndarray) -> np.ndarray:
        """What lies between `values` (..., 8) at the points."""
        return values @ _WEIGHTS

    def slope(self, values: np.ndarray, tau: float) -> np.ndarray:
        """Its rate."""
        return values @ _SLOPES / tau

    def rates(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n, nx)."""
        return np.array(plain(self.problem.rhs)(t[None, :], X.T, self.problem.inputs(t), self._p(t.size))).T

    def projected(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n, nx), once."""
        assert self.problem.project is not None
        return np.array(self.problem.project(t[None, :], X.T, self.problem.inputs(t), self._p(t.size))).T

    def is_crossing(self, t: float, x: np.ndarray) -> bool:
        """Whether a state is next to a singular position, where closing loops only adds rounding errors."""
        return bool(self.are_crossing(np.array([t]), x[None, :])[0])

    def are_crossing(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """The same (n,) of states X (n, nx)."""
        return self.clearances(t, X) < _CROSSING

    def _ahead(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Rates of t and states (n, 1 + nx), those of velocities left out."""
        rates = self.rates(t, X)
        rates[:, self.problem.positions :] = 0.0
        return np.concatenate([np.ones((t.size, 1)), rates], axis=1)

    def _p(self, n: int) -> np.ndarray:
        return np.repeat(self.problem.parameters[:, None], n, axis=1)


def passage_of(problem: Problem) -> Passage | None:
    """None where no branches of the motion cross."""
    return None if problem.clearance is None or problem.project is None else Passage(problem)
