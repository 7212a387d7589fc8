"""A piece of a motion: what was integrated in one go, in states of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.charts.chart import Chart
from acausal.collocation.problem import Problem, Solution, Through
from acausal.integrators.passage import passage_of
from acausal.outputs.functions import Functions


@dataclass(frozen=True, eq=False)
class Piece:
    """The `solution` of a `problem`, in the states of `functions`; `chart`: whose coordinates these are, None for states of the model."""

    functions: Functions
    problem: Problem
    solution: Solution
    chart: Chart | None = None

    def ends(self, seen: Functions) -> np.ndarray:
        """States (nx, n) of `seen` at the ends of steps."""
        return self._in(seen, self.solution.t, self.solution.x)

    def between(self, times: np.ndarray, seen: Functions) -> np.ndarray:
        """States (nx, n) of `seen` at times (n,), as they are interpolated."""
        return self._in(seen, times, self.solution.dense(times))

    def states(self, times: np.ndarray, seen: Functions) -> tuple[np.ndarray, np.ndarray]:
        """States (nx, n) of `seen` at times (n,), projected so that invariants hold; next to singular positions, where that throws states off, they are between
        those to either side. And how far these are [s] (n, 3), nearer and nearer ones; no numbers elsewhere.
        """
        x = self.solution.dense(times)
        found, aside = self._on_branches(times, x, self._projected(times, x))
        return self._in(seen, times, found), np.where(seen is self.functions, aside, np.nan)

    def _projected(self, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        project, native = self.functions.projection, self.problem.native
        inputs = self.problem.with_modes(self.solution.modes).inputs
        if native is not None:
            matter = native.integrand.led or native.integrand.masks
            return native.projected(times, x, inputs(times) if matter else None, self.problem.parameters)
        if project is None:
            return x
        u, p, projected = inputs(times), np.repeat(self.problem.parameters[:, None], times.size, axis=1), x
        for _ in range(3):  # moving q opens the velocity rows a little; the next projection closes them
            projected = np.array(project(times[None, :], projected, u, p)).reshape(x.shape)
        return np.where(np.all(np.isfinite(projected), axis=0), projected, x)

    def _on_branches(self, times: np.ndarray, x: np.ndarray, projected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`projected`, but next to singular positions what lies between states to either side of x, where that is nearer to x: a motion that passes by turns
        aside between these, one that leads through is thrown off by closing loops where it is. And how far these are.
        """
        problem, aside = self.problem.with_modes(self.solution.modes), np.full((times.size, 3), np.nan)
        passage, past = passage_of(problem), problem.exact is not None and problem.exact.through is Through.NEVER
        if passage is None or past:
            return projected, aside
        some = np.flatnonzero(passage.are_crossing(times, x.T))
        usual, h = self.functions.integrand.usual, np.diff(self.solution.t)
        if some.size and usual is not None and h.any():
            step = np.maximum(np.searchsorted(self.solution.t[:-1][h > 0], times[some], side="right") - 1, 0)
            found, aside[some] = passage.nearest(times[some], x.T[some], projected.T[some], h[h > 0][step], usual)
            projected[:, some] = found.T
        return projected, aside

    def _in(self, seen: Functions, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        if seen is self.functions:
            return x
        return seen.space.restricted(self.functions.space.expanded(times, x, self.problem.parameters))
