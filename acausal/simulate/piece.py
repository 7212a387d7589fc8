"""A piece of a motion: what was integrated in one go, in states of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.charts.chart import Chart
from acausal.collocation.problem import Problem, Solution
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

    def states(self, times: np.ndarray, seen: Functions) -> np.ndarray:
        """States (nx, n) of `seen` at times (n,), projected so that invariants hold."""
        x, project, native = self.solution.dense(times), self.functions.projection, self.problem.native
        inputs = self.problem.with_modes(self.solution.modes).inputs
        if native is not None:
            matter = native.integrand.led or native.integrand.masks
            x = native.projected(times, x, inputs(times) if matter else None, self.problem.parameters)
        elif project is not None:
            u, p = inputs(times), np.repeat(self.problem.parameters[:, None], times.size, axis=1)
            projected = x
            for _ in range(3):  # moving q opens the velocity rows a little; the next projection closes them
                projected = np.array(project(times[None, :], projected, u, p)).reshape(x.shape)
            x = np.where(np.all(np.isfinite(projected), axis=0), projected, x)
        return self._in(seen, times, x)

    def _in(self, seen: Functions, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        if seen is self.functions:
            return x
        return seen.space.restricted(self.functions.space.expanded(times, x, self.problem.parameters))
