"""Back onto the invariants after a step."""

from __future__ import annotations

import numpy as np

from acausal.collocation.problem import Problem
from acausal.numerics.kernel import Kernel

_EPS = float(np.finfo(float).eps)


class Projection:
    """Applies `problem.project` until the invariants stop shrinking: Hairer and Wanner II, section VII.2."""

    def __init__(self, problem: Problem) -> None:
        self._kernels: tuple[Kernel, Kernel] | None = None
        if problem.project is None or problem.invariants is None:
            return
        nx, ng = problem.rhs.size1_in(1), problem.invariants.size1_out(0)
        self._t, self._x = np.empty(1), np.empty(nx)
        values = (self._t, self._x, np.array(problem.parameters, dtype=float))
        self._kernels = Kernel(problem.invariants, values, np.empty(ng)), Kernel(problem.project, values, np.empty(nx))

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """x (nx,) with the invariants met as well as rounding allows (at most ten corrections); x itself if they are."""
        if self._kernels is None:
            return x
        invariants, project = self._kernels
        self._t[0], self._x[:] = t, x
        gap = float(np.abs(invariants()).max(initial=0.0))
        for k in range(10):
            if gap <= 2 * _EPS:
                break
            self._x[:] = trial = project().copy()
            new = float(np.abs(invariants()).max(initial=0.0))
            # moving positions may open the velocity rows at first; the second correction closes them
            if not np.isfinite(new) or (k >= 2 and not new < gap):
                break
            x, gap = trial, new
        return x
