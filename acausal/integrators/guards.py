"""Guards: functions whose zeros are wanted along a motion; here located on the dense output of a finished solution.

The C runtime does the same while it integrates (acausal/runtime/guards.h). An interval is left alone when the sizes of Chebyshev
coefficients exclude a zero, searched by bracketing when they show that the guard is monotone, and halved otherwise.
Boyd: Solving Transcendental Equations, chapters 2 and 3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from acausal.collocation.problem import Crossing, Problem, Solution, Status, StatusKind

_POINTS = 16
_TOUCH = 1e-13
_NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(_POINTS) / (_POINTS - 1))

Values = Callable[[np.ndarray], np.ndarray]
"""times (m,) -> one guard (m,)"""


@dataclass(frozen=True)
class _Search:
    value: Values
    largest: float
    start: float | None
    """Time at which the motion starts, for its first step."""

    def zeros(self, lo: float, hi: float, depth: int = 0) -> list[tuple[float, int]]:
        """Zeros in (lo, hi] with directions; 0 where zero is only touched."""
        values = self.value(lo + (hi - lo) * _NODES)
        c = chebyshev.chebfit(2 * _NODES - 1, values, _POINTS - 1)
        at_start = lo == self.start and abs(values[0]) <= 1e-12 * self.largest
        if abs(c[0]) > 1.01 * np.sum(np.abs(c[1:])) + 1e-300 and not at_start:
            return []
        if np.max(np.abs(values)) <= _TOUCH * self.largest or depth > 40:
            return [] if at_start else [(0.5 * (lo + hi), 0)]
        slope = chebyshev.chebder(c)
        if abs(slope[0]) <= np.sum(np.abs(slope[1:])):
            middle = 0.5 * (lo + hi)
            return self.zeros(lo, middle, depth + 1) + self.zeros(middle, hi, depth + 1)
        rising = 1 if values[-1] > values[0] else -1
        if at_start:
            return []  # `leaving` has seen to it
        if values[-1] == 0:
            return [(hi, rising)]
        if values[0] == 0 or (values[0] > 0) == (values[-1] > 0):
            return []
        return [(float(brentq(lambda t: float(self.value(np.array([t]))[0]), lo, hi, xtol=1e-15, rtol=1e-14)), rising)]  # pyright: ignore[reportArgumentType]  # scipy's stub


def located(problem: Problem, solution: Solution) -> Solution:
    """The solution with its crossings, cut at the first one that stops the motion."""
    guards = problem.guards
    if guards is None or solution.t.size < 2:
        return solution
    t = solution.t
    h = np.diff(t)
    nodes = t[:-1, None] + h[:, None] * _NODES
    values = _guard_values(problem, guards.function, solution, nodes.ravel()).reshape(-1, h.size, _POINTS)
    to_chebyshev = np.linalg.inv(chebyshev.chebvander(2 * _NODES - 1, _POINTS - 1)).T
    found: list[Crossing] = []
    for g, direction in enumerate(guards.directions):
        c = np.abs(values[g] @ to_chebyshev)
        near = ~(c[:, 0] > 1.01 * c[:, 1:].sum(axis=1))
        near[0] |= abs(values[g, 0, 0]) <= 1e-12 * np.max(np.abs(values[g, 0]))
        for k in np.flatnonzero(near):
            largest = float(np.max(np.abs(values[g, k])))
            if not 0 < largest < np.inf:
                continue
            search = _Search(lambda times, g=g: _guard_values(problem, guards.function, solution, times)[g], largest, float(t[0]) if k == 0 else None)  # fmt: skip
            first = leaving(values[g, 0], largest) if k == 0 else 0
            if first and first == direction:
                found.append(Crossing(float(t[0]), g, first))
            for time, sense in search.zeros(float(t[k]), float(t[k + 1])):
                if direction in (0, sense) or sense == 0:
                    found.append(Crossing(time, g, sense))
    found.sort(key=lambda crossing: crossing.time)
    for n, crossing in enumerate(found):
        if guards.stops[crossing.guard]:
            return _cut(solution, tuple(found[: n + 1]), crossing.time)
    return replace(solution, crossings=tuple(found))


def leaving(values: np.ndarray, largest: float) -> int:
    """Direction in which the values (m,) leave zero; 0 when they do not start there."""
    small = np.abs(values) <= 1e-12 * largest
    return int(np.sign(values[np.argmin(small)])) if small[0] and not small.all() else 0


def _guard_values(problem: Problem, function: ca.Function, solution: Solution, times: np.ndarray) -> np.ndarray:
    x = solution.dense(times)
    p = np.repeat(problem.parameters[:, None], times.size, axis=1)
    return np.array(function(times[None, :], x, problem.inputs(times), p)).reshape(-1, times.size)


def _cut(solution: Solution, crossings: tuple[Crossing, ...], time: float) -> Solution:
    keep = solution.t < time
    t = np.append(solution.t[keep], time) if keep.any() else solution.t[:1]
    x = np.column_stack([solution.x[:, keep], solution.dense(np.array([time]))]) if keep.any() else solution.x[:, :1]
    return replace(solution, t=t, x=x, crossings=crossings, status=Status(StatusKind.SUCCESS, time), stopped=True)
