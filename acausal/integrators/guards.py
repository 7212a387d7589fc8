"""Guards: functions whose zeros are wanted along a motion; here located on the dense output of a finished solution.

The C runtime does the same while it integrates (acausal/runtime/guards.h). An interval is left alone when the sizes of Chebyshev
coefficients exclude a zero, searched by bracketing when they show that the guard is monotone, and halved otherwise.
Boyd: Solving Transcendental Equations, chapters 2 and 3.

Values no larger than what rounding makes of them have no sign. A guard has a side once it has had a sign; it crosses when it gets the
other one, however flat the zero between, and touches when it gets the same one again. Where it has no sign for a whole step, it has
no side any more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from numpy.polynomial import chebyshev

from acausal.collocation.problem import Crossing, Guards, Problem, Solution, Status, StatusKind
from acausal.numerics.rounding import rounding_of

_POINTS = 16
_AT_START = 1e-12
_ROUNDINGS = 16.0
_SEARCHES = 4000
_NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(_POINTS) / (_POINTS - 1))

Values = Callable[[np.ndarray], np.ndarray]
"""times (m,) -> one guard (m,)"""


@dataclass
class _Follower:
    """Follows the sign of one guard from step to step."""

    value: Values
    wanted: int
    stops: bool
    start: float
    end: float
    found: list[tuple[float, int]] = field(default_factory=list)
    side: int = 0
    since: float | None = None
    """When it came to zero, as long as it is there."""
    at_start: bool = False
    """Whether it has been at zero since the start."""
    noise: float = 0.0
    searches: int = 0
    h: float = 0.0
    """Size of the step."""

    def step(self, lo: float, hi: float, noise: float) -> None:
        """Zeros of a step from lo to hi, into `found`."""
        self.noise, self.searches, self.h = noise, 0, hi - lo
        if lo == self.start:
            values = self.value(lo + (hi - lo) * _NODES)
            largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
            if abs(values[0]) <= _AT_START * largest:
                self.noise = max(noise, _AT_START * largest)
            self.at_start = bool(abs(values[0]) <= self.noise)
        self.follow(lo, hi, 0)
        if self.since is not None and self.since <= lo:
            self.side, self.since = 0, None
        if self.since is not None and self.side and hi >= self.end:
            self.event(self.since, -self.side)

    def follow(self, lo: float, hi: float, depth: int) -> None:
        """The same within a part of a step."""
        values = self.value(np.append(lo + (hi - lo) * _NODES[:-1], hi))
        self.searches += 1
        deep = depth > 40 or self.searches > _SEARCHES
        middle, finite = 0.5 * (lo + hi), np.isfinite(values)
        if not finite.all():
            if finite.any() and depth <= 20 and not deep:
                self.follow(lo, middle, depth + 1)
                self.follow(middle, hi, depth + 1)
            return
        none = self.noise if self.since is None else 4 * self.noise  # or noise would come and go
        if np.max(np.abs(values)) <= none:
            self.comes_to_zero(lo)
            return
        c = _TO_CHEBYSHEV @ values
        if abs(c[0]) > 1.01 * np.sum(np.abs(c[1:])) + none:
            self.takes_side(lo, 1 if values[0] > 0 else -1)
            return
        slope = chebyshev.chebder(c)
        if not deep and abs(slope[0]) <= np.sum(np.abs(slope[1:])):
            self.follow(lo, middle, depth + 1)
            self.follow(middle, hi, depth + 1)
            return
        before, after = (int(np.sign(v)) if abs(v) > none else 0 for v in (values[0], values[-1]))
        crosses = values[0] * values[-1] < 0 or (values[0] > 0) != (values[-1] > 0)
        if before:
            self.takes_side(lo, before)
        if before and after and before != after:
            self.takes_side(self.zero(lo, hi), after)
        elif after:
            self.takes_side(lo, after)
        else:
            self.comes_to_zero(lo if not before else self.zero(lo, hi) if crosses else hi)

    def zero(self, lo: float, hi: float) -> float:
        """The zero between two times with values of both signs."""
        from scipy.optimize import brentq

        if self.value(np.array([hi]))[0] == 0:
            return hi
        return float(brentq(lambda t: float(self.value(np.array([t]))[0]), lo, hi, xtol=1e-15, rtol=1e-14))  # pyright: ignore[reportArgumentType]  # scipy's stub

    def event(self, time: float, direction: int) -> None:
        """Enter an event if its direction is wanted; 0, touching, always is."""
        if direction == 0 or self.wanted in (0, direction):
            self.found.append((time, direction))

    def takes_side(self, time: float, sign: int) -> None:
        """From `time` on the guard has this sign; a zero before it counts as in the middle of where there was no sign."""
        if self.side and (sign != self.side or self.since is not None):
            self.event(time if self.since is None else 0.5 * (self.since + time), sign if sign != self.side else 0)
        elif not self.side and self.at_start and self.wanted == sign and not (self.stops and self.leaves_steadily(time)):
            self.event(self.start, sign)
        self.side, self.since, self.at_start = sign, None, False

    def comes_to_zero(self, time: float) -> None:
        """From `time` on the guard has no sign."""
        if self.since is None:
            self.since = time

    def leaves_steadily(self, time: float) -> bool:
        """Whether a guard that starts at zero leaves it in proportion to time: then it is in the middle of a crossing."""
        soon = max(2 * (time - self.start), _NODES[1] * self.h)
        whole, half = np.abs(self.value(self.start + soon * np.array([1.0, 0.5])))
        return bool(half > 0.36 * whole)


_TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(2 * _NODES - 1, _POINTS - 1))


def located(problem: Problem, solution: Solution) -> Solution:
    """The solution with its crossings, cut at the first one that stops the motion."""
    guards = problem.guards
    if guards is None or solution.t.size < 2:
        return solution
    t = solution.t
    h = np.diff(t)
    nodes = t[:-1, None] + h[:, None] * _NODES
    values = _guard_values(problem, guards.function, solution, nodes.ravel()).reshape(-1, h.size, _POINTS)
    found: list[Crossing] = []
    for g in range(len(guards.directions)):
        found += [Crossing(time, g, sense) for time, sense in _zeros(problem, solution, guards, g, values[g])]
    found.sort(key=lambda crossing: crossing.time)
    for n, crossing in enumerate(found):
        if guards.stops[crossing.guard]:
            return _cut(solution, tuple(found[: n + 1]), crossing.time)
    return replace(solution, crossings=tuple(found))


def _zeros(problem: Problem, solution: Solution, guards: Guards, g: int, values: np.ndarray) -> list[tuple[float, int]]:
    """Zeros of guard g with directions, whose values (steps, points) are known."""
    t, size = solution.t, np.maximum.accumulate(np.abs(solution.x), axis=1)

    def value(times: np.ndarray) -> np.ndarray:
        return _guard_values(problem, guards.function, solution, times)[g]

    follower = _Follower(value, guards.directions[g], guards.stops[g], float(t[0]), float(t[-1]))
    c = np.abs(values @ _TO_CHEBYSHEV.T)
    clear = c[:, 0] > 1.01 * c[:, 1:].sum(axis=1)
    clear[0] = False
    for k in range(t.size - 1):
        sign = 1 if values[k, 0] > 0 else -1
        if clear[k] and follower.side in (0, sign) and follower.since is None and not follower.at_start:
            follower.side = sign
            continue
        sizes = np.abs(values[k])
        where = float(t[k] + (t[k + 1] - t[k]) * _NODES[int(np.argmin(np.where(np.isfinite(sizes), sizes, np.inf)))])
        u = problem.inputs(np.array([where]))[:, 0]
        x = solution.dense(np.array([where]))[:, 0]
        noise = float(rounding_of(guards.function, where, x, u, problem.parameters, np.spacing(size[:, k + 1]))[g])
        follower.step(float(t[k]), float(t[k + 1]), _ROUNDINGS * noise if np.isfinite(noise) else 0.0)
    return follower.found


def _guard_values(problem: Problem, function: ca.Function, solution: Solution, times: np.ndarray) -> np.ndarray:
    x = solution.dense(times)
    p = np.repeat(problem.parameters[:, None], times.size, axis=1)
    return np.array(function(times[None, :], x, problem.inputs(times), p)).reshape(-1, times.size)


def _cut(solution: Solution, crossings: tuple[Crossing, ...], time: float) -> Solution:
    keep = solution.t < time
    t = np.append(solution.t[keep], time) if keep.any() else solution.t[:1]
    x = np.column_stack([solution.x[:, keep], solution.dense(np.array([time]))]) if keep.any() else solution.x[:, :1]
    return replace(solution, t=t, x=x, crossings=crossings, status=Status(StatusKind.SUCCESS, time), stopped=True)
