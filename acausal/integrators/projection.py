"""Back onto the invariants after a step."""

from __future__ import annotations

import numpy as np

from acausal.collocation.problem import Problem
from acausal.integrators.passage import passage_of
from acausal.numerics.bound import BoundFunction

_EPS = float(np.finfo(float).eps)


class Projection:
    """Applies `problem.project` until corrections stop shrinking: Hairer and Wanner II, section VII.2."""

    def __init__(self, problem: Problem) -> None:
        self._passage = passage_of(problem)
        self._bound: BoundFunction | None = None
        if problem.project is None:
            return
        nx = problem.rhs.size1_in(1)
        self._t, self._x = np.empty(1), np.empty(nx)
        self._bound = BoundFunction(problem.project, (self._t, self._x, np.array(problem.parameters, dtype=float)), np.empty(nx))

    def __call__(self, t: float, x: np.ndarray, size: np.ndarray) -> np.ndarray:
        """x (nx,) with the invariants met as well as rounding allows (at most ten corrections); x itself if they are.

        `size` (nx,): the largest |x| so far, in units of which corrections are measured.
        """
        if self._bound is None or (self._passage is not None and self._passage.is_crossing(t, x)):
            return x
        self._t[0], last = t, np.inf
        for k in range(10):
            self._x[:] = x
            trial = self._bound().copy()
            change, scale = np.abs(trial - x), np.maximum(size, np.abs(x))
            largest = float(np.max(change[change > 0] / scale[change > 0], initial=0.0)) if np.isfinite(trial).all() else np.inf
            if not largest < np.inf or largest <= 2 * _EPS:
                break
            # moving positions may open the velocity rows at first; the second correction closes them
            if k > 1 and not largest < 0.5 * last:
                break
            x, last = trial, largest
        return x
