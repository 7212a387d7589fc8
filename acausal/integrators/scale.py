"""What the states of a motion are measured by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.collocation.problem import Problem, Tolerances
from acausal.numerics.rounding import rounding_of_rates

_EPS = float(np.finfo(float).eps)
_NOTHING = 1e-290
_PART = 0.125
_NOISE = 512.0
_SMALL = 1e-4
DOUBTS = 8
"""Rejections, less steps without, that call for an explanation."""


class Scale:
    """Per state (nx,) `values` = atol + rtol times the largest magnitude met so far, and at least what rounding alone can do.

    What a step moves a state by counts as its size by an eighth, as long as it has met nothing larger: so states that start at zero
    have a size, and no unit is needed. A fixed step solves its equations to rounding, with rtol = 1. The same as in runtime/stages.h.
    """

    def __init__(self, problem: Problem, tolerances: Tolerances, x: np.ndarray) -> None:
        self.problem = problem
        self.unit = tolerances.rtol if tolerances.step is None else 1.0
        self._atol = tolerances.atol * self.unit / tolerances.rtol
        self.size = np.abs(x) if problem.met is None else np.maximum(np.abs(x), problem.met)
        self.noise = np.zeros_like(self.size)
        self.doubts, self.patience = 0, DOUBTS
        self.values, self.limit = self.size, self.size

    def begin(self, h: float) -> None:
        """For a step of size h."""
        self._least = np.maximum(_NOISE * h * self.noise, _NOTHING)
        self.values = np.maximum(self._atol + self.unit * self.size, self._least)
        self.limit = self.size / (_PART * h)
        self._widened = False

    def widen(self, h: float, rates: np.ndarray) -> bool:
        """Whether the values changed since rates (stages, nx) move states as never before."""
        most = np.abs(rates).max(axis=0)
        if not (most > self.limit).any() and not self._widened:
            return False
        self.values = np.maximum(self._atol + self.unit * np.maximum(self.size, _PART * h * most), self._least)
        self._widened = True
        return True

    def unit_of_rates(self, h: float) -> np.ndarray:
        """(nx,) to measure changes of rates with; 0 for what is exactly zero."""
        return np.where(self.values > _NOTHING, h / self.values, 0.0)

    def floor(self, h: float, x: np.ndarray, K: np.ndarray) -> float:
        """The change that rounding alone can make, in units of the values."""
        size = np.maximum(np.abs(x), np.abs(h * K).max(axis=0))
        known = self.values > _NOTHING
        rounding = 2 * _EPS * float((size / self.values).max(initial=0.0, where=known))
        return max(0.25 * self.noise_in(h), min(rounding, 2 * _EPS / self.unit))

    def noise_in(self, h: float) -> float:
        """What the rounding of rates moves states by in a step of size h, in units of the values."""
        return h * float((self.noise / self.values).max(initial=0.0, where=self.values > _NOTHING))

    def met(self, x: np.ndarray) -> None:
        """Remember the magnitudes of x."""
        np.maximum(self.size, np.abs(x), out=self.size)

    def blame_rounding(self, points: Sequence[tuple[float, np.ndarray]], h: float, *, desperate: bool) -> bool:
        """Whether states are nothing but rounding at the start of a step or, when zero there, at its last stage: no step size is accurate.

        Asked where steps are rejected again and again. Large states are disturbed for a moment at singular positions, too: that
        explains steps only when they have shrunk to next to nothing.
        """
        explains, part = False, self.unit if desperate else max(self.unit, _SMALL)
        for t, x in points:
            if ((np.abs(x - points[0][1]) > self.size) & (self.size > 0)).any():
                break
            u = self.problem.inputs(np.array([t]))[:, 0]
            found = rounding_of_rates(self.problem.rhs, t, x, u, self.problem.parameters, h)
            explained = np.isfinite(found) & (found > self.noise) & (_NOISE * h * found > part * self.size)
            self.noise[explained] = np.maximum(found, _NOISE * self.noise)[explained]  # it grows with the motion
            explains, part = explains | bool(explained.any()), 1.0
        self.doubts, self.patience = 0, DOUBTS if explains else min(2 * self.patience, 1000)
        return explains
