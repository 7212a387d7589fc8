"""What the states of a motion are measured by."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acausal.collocation.problem import Problem, Tolerances
from acausal.numerics.rounding import rounding_of_rates

_EPS = float(np.finfo(float).eps)
_NOTHING = 1e-290
PART = 0.125
"""Of what a step moves a state: counts as its size, as long as it has met nothing larger."""
LEFT = 1e-3
"""What the iteration may leave of the error of a step."""
_FEW = 4.0
"""Times the mean of a few samples: what rounding makes of rates at most."""
_SMALL = 1e-4
"""Part of a state that rounding disturbs in a step: then it is nothing but rounding."""
_SOON = 0.1
"""Of a step: a little later."""
_DOUBTS = 8
"""Rejections, less steps without, that make every operation's rounding looked at."""
_UNHEARD = 8
"""Steps in which nothing was forgiven to rounding: then it is not looked at any more."""


class Scale:
    """Per state (nx,) `values` = atol + rtol times the largest magnitude met so far.

    What a step moves a state by counts as its size by an eighth, as long as it has met nothing larger: so states that start at zero
    have a size, and no unit is needed. Those that are nothing but rounding count so much that rounding is no more
    than what the iteration may leave. A fixed step solves its equations to rounding, with rtol = 1. `noise` (nx,): what rounding
    makes of the rates, zeros where that is not looked at. The same as in runtime/stages.h.
    """

    def __init__(self, problem: Problem, tolerances: Tolerances, x: np.ndarray) -> None:
        self.problem = problem
        self.unit = tolerances.rtol if tolerances.step is None else 1.0
        self._atol = tolerances.atol * self.unit / tolerances.rtol
        self.size = np.abs(x) if problem.met is None else np.maximum(np.abs(x), problem.met)
        self.noise, self._least = np.zeros_like(self.size), np.zeros_like(self.size)
        self.doubts, self._patience = 0, _DOUBTS
        self.noisy, self._unheard = False, 0
        self.values, self.limit, self.reach = self.size, self.size, 0.0

    def begin(self, h: float, reach: float) -> None:
        """For a step of size h, where without rejections steps of size `reach` would be."""
        self.reach = reach
        self.values = np.maximum(self._atol + self.unit * self.size, self._floor(h))
        self.limit = self.size / (PART * reach)
        self._widened = False

    def widen(self, h: float, rates: np.ndarray) -> bool:
        """Whether the values changed since rates (stages, nx) move states as never before."""
        most = np.abs(rates).max(axis=0)
        if not (most > self.limit).any() and not self._widened:
            return False
        self.values = np.maximum(self._atol + self.unit * np.maximum(self.size, PART * self.reach * most), self._floor(h))
        self._widened = True
        return True

    def _floor(self, h: float) -> np.ndarray:
        noise = h * self.noise / LEFT
        return np.maximum(noise * (noise / np.maximum(np.maximum(self.size, noise), _NOTHING)), _NOTHING)

    def unit_of_rates(self, h: float) -> np.ndarray:
        """(nx,) to measure changes of rates with; 0 for what is exactly zero."""
        return np.where(self.values > _NOTHING, h / self.values, 0.0)

    def floor(self, h: float, x: np.ndarray, K: np.ndarray) -> float:
        """The change that rounding of the states alone can make, in units of the values."""
        size = np.maximum(np.abs(x), np.abs(h * K).max(axis=0))
        known = self.values > _NOTHING
        rounding = 2 * _EPS * float((size / self.values).max(initial=0.0, where=known))
        return min(rounding, 2 * _EPS / self.unit)

    def heard(self, change: np.ndarray, much: np.ndarray | float) -> np.ndarray:
        """Sizes of changes (n, nx) less `much` times what rounding makes of the rates."""
        return np.maximum(np.abs(change) - much * self.noise, 0.0)

    def noise_in(self, h: float) -> float:
        """What the rounding of rates moves states by in a step of size h, in units of the values."""
        return h * float((self.noise / self.values).max(initial=0.0))

    def met(self, x: np.ndarray) -> None:
        """Remember the magnitudes of x."""
        np.maximum(self.size, np.abs(x), out=self.size)

    def look_at_noise(self, h: float, noise: np.ndarray) -> None:
        """Forgive this much (nx,) to rounding from now on, in steps of size h."""
        self.noise, self.noisy = np.maximum(noise, self._least), True
        self.values = np.maximum(self.values, self._floor(h))

    def count_noise(self, forgiven: bool, before: bool) -> None:
        """Whether something was forgiven in this step, and whether rounding was looked at `before` it."""
        self._unheard = 0 if forgiven else self._unheard + 1
        if self._unheard > (_UNHEARD if before else 0):
            self.forget_noise()

    def forget_noise(self) -> None:
        """Rounding is not looked at any more."""
        self.noise, self.noisy, self._unheard = self._least, bool(self._least.any()), 0

    @property
    def in_doubt(self) -> bool:
        """Whether steps are rejected again and again."""
        return self.doubts >= self._patience

    def rests_on_rounding(self, t: float, x: np.ndarray, h: float, rate: Callable[[float, np.ndarray], np.ndarray]) -> bool:
        """Whether states are nothing but rounding, which disturbing them does not show: at rest in zero, or in an equilibrium.

        Looked at at the start (t, x) of a step of size h and, for states that are zero there, a little later.
        """
        explains = False
        for later in (False, True):
            u, rates = self.problem.inputs(np.array([t]))[:, 0], rate(t, x)
            noise = _FEW * rounding_of_rates(self.problem.rhs, t, x, u, self.problem.parameters, h)
            shown = np.where(
                self.size > 0, h * noise > max(self.unit, _SMALL) * self.size, later & (noise > _SMALL * np.abs(rates))
            )
            more = np.isfinite(noise) & (noise > self._least) & shown
            self._least = np.where(more, 2 * noise, self._least)
            explains = explains or bool(more.any())
            t, x = t + _SOON * h, x + _SOON * h * rates
        self.doubts, self._patience = 0, _DOUBTS if explains else min(2 * self._patience, 1000)
        if explains:
            self.forget_noise()
        return explains


def sampled_noise(problem: Problem, t: np.ndarray, X: np.ndarray, h: float, copies: list[tuple[int, int]]) -> np.ndarray:
    """What rounding makes of the rates (nx,) at stages X (n, nx) at times t (n,) of a step of size h.

    How much they change when the states change by a unit or two of their last place. The largest change is left out: there the
    rates may jump. What is the integral of a disturbed state, by `copies` (to, from), is disturbed with it.
    """
    n = t.size
    draw = np.random.default_rng(1)
    u, p = problem.inputs(t), np.repeat(problem.parameters[:, None], n, axis=1)
    moved = [X * (1 + _EPS * (draw.integers(0, 4, X.shape) - 1.5)) for _ in range(2)]
    one, other = (np.array(problem.rhs(t[None, :], x.T, u, p)) for x in moved)
    change = np.nan_to_num(np.abs(one - other), nan=0.0, posinf=0.0)
    noise = _FEW * (change.sum(axis=1) - change.max(axis=1)) / max(1, n - 1)
    for to, of in copies:
        noise[to] = max(noise[to], h * noise[of])
    return noise
