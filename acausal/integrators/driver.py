"""Adaptive collocation: the loop over steps that Gauss and Radau share."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from acausal.collocation.problem import Newton, Problem, Progress, Solution, Statistics, Status, StatusKind, Tolerances
from acausal.collocation.tableau import Tableau, legendre_values
from acausal.integrators.dense import CollocationPolynomial, refined
from acausal.integrators.projection import Projection
from acausal.integrators.scale import LEFT, PART, Scale
from acausal.integrators.stages import StageSolver
from acausal.runtime.compiled import Pace, Slow

_EPS = float(np.finfo(float).eps)
_LEFT = 1e-3
"""What the iteration may leave of the error of a step."""
_AVOIDED = 4
"""Times that a step is made shorter for what is awkward at singular positions."""
_SHORTER = 0.8
"""Steps that are to become shorter than that make rounding looked at."""


@dataclass(frozen=True)
class Step:
    """A step of size h from (t, x) whose stage rates K (s, nx) were found; a = Legendre coefficients of the rates, (s, nx)."""

    t: float
    h: float
    x: np.ndarray
    K: np.ndarray
    a: np.ndarray
    scale: np.ndarray
    noise: np.ndarray | float = 0.0
    """What rounding makes of the rates (nx,), as far as it is forgiven."""


@dataclass(frozen=True)
class Scheme:
    """What tells one collocation method from another: tableau, error of a step in units of its `scale`, and order of that error."""

    tableau: Tableau
    error: Callable[[StageSolver, Step], float]
    error_order: int
    newton: Newton
    superconvergent: bool
    """Whether the ends of steps are much more accurate than the collocation polynomial."""


@dataclass
class Run:
    """The state of a run: grows step by step, and is turned into a `Solution` at any moment."""

    problem: Problem
    scheme: Scheme
    tolerances: Tolerances
    t: float
    x: np.ndarray
    end: float
    h: float = 0.0
    rejected: int = 0
    error: float = 0.0
    """Of the last step, in units of the tolerance."""
    hard: int = 0
    """Steps whose size was set by the convergence of the iteration and not by accuracy, less the others."""
    asked: int = 4
    """How many of them until `slow` is asked."""
    slowness: float = 1.0
    """Step size that accuracy allows over that of the iteration."""
    contraction: float = 0.0
    """Of the iteration in the last step."""
    newton_steps: int = 0
    trusted: float = 0.0
    """Size of the last step without doubts."""
    planned: float = 0.0
    """Size of the last step before steps began to be rejected."""
    missed: bool = False
    """Whether tries of the last step were rejected."""
    times: list[float] = field(default_factory=list)
    states: list[np.ndarray] = field(default_factory=list)
    coefficients: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.started = time.perf_counter()
        self.solver = StageSolver(self.problem, self.scheme.tableau)
        self.newton = self.scheme.newton is Newton.ALWAYS
        self.times.append(self.t)
        self.states.append(self.x)
        self._projection = Projection(self.problem)
        self._carry = np.zeros_like(self.x)
        self.scale = Scale(self.problem, self.tolerances, self.x)
        self.last: Step | None = None

    @property
    def status(self) -> Status:
        """Of a run that nothing has stopped."""
        return Status(StatusKind.SUCCESS, self.t)

    def solution(self, status: Status) -> Solution:
        """What has been computed so far."""
        t, x = np.array(self.times), np.array(self.states)
        tableau, problem, superconvergent = self.scheme.tableau, self.problem, self.scheme.superconvergent
        coefficients = np.array(self.coefficients).reshape(len(t) - 1, tableau.stages, self.x.size)

        @functools.cache
        def polynomial() -> CollocationPolynomial:
            return refined(problem, t, x, coefficients) if superconvergent else CollocationPolynomial(t, x, coefficients)

        statistics = Statistics(
            tableau.name + (" with Newton" if self.newton_steps and self.scheme.newton is Newton.WHERE_SLOW else ""),
            tableau.order,
            len(t) - 1,
            self.rejected,
            self.solver.evaluations,
            self.solver.iterations,
            time.perf_counter() - self.started,
            self.solver.factorisations,
        )
        return Solution(t, x.T, lambda times: polynomial()(times), statistics, status)

    def guess(self, h: float) -> np.ndarray:
        """Stage rates (s, nx) by extrapolating the last step's polynomial; the rate at the start for the first step.

        Extrapolated Legendre series diverge where steps are large, so the series ends before its smallest term.
        """
        c, s = self.scheme.tableau.c, self.scheme.tableau.stages
        if self.last is None:
            return np.tile(self.solver.rate(self.t, self.x), (s, 1))
        theta = 1 + c * (h / self.last.h)
        P = legendre_values(theta, s)
        if s > 2:
            sizes = (np.abs(self.last.a) / self.last.scale).max(axis=1) * P[-1]
            terms = max(2, int(np.argmin(sizes[1:])) + 1)
            return P[:, :terms] @ self.last.a[:terms]
        return P @ self.last.a

    def accept(self, step: Step) -> None:
        """Advance with compensated summation, project onto the invariants, remember the polynomial."""
        h = step.h
        increment = ((h * self.scheme.tableau.b)[:, None] * step.K).sum(axis=0) + self._carry
        x = self.x + increment
        self._carry = increment - (x - self.x)
        self.t = self.end if abs(self.end - (self.t + h)) <= 4 * _EPS * abs(self.end) else self.t + h
        self.x = self._projection(self.t, x, self.scale.size)
        if self.x is not x:
            self._carry = np.zeros_like(x)
        self.scale.met(self.x)
        self.times.append(self.t)
        self.states.append(self.x)
        self.coefficients.append(step.a)
        self.last = step
        self.newton_steps += self.newton


def drive(
    problem: Problem,
    scheme: Scheme,
    x0: np.ndarray,
    t0: float,
    t1: float,
    tolerances: Tolerances,
    progress: Progress | None,
    *,
    slow: Slow | None = None,
) -> tuple[Solution, bool]:
    """Integrate from t0 to t1; the solution, and whether `slow` ended it early by "leave"."""
    run = Run(problem, scheme, tolerances, t0, np.array(x0, dtype=float), t1)
    if not np.isfinite(run.x).all():
        worst = int(np.flatnonzero(~np.isfinite(run.x))[0])
        return run.solution(Status(StatusKind.NON_FINITE, t0, "The start values are not finite.", worst)), False
    if x0.size == 0 or t1 == t0:
        return run.solution(run.status), False
    shown = time.perf_counter()
    try:
        with np.errstate(all="ignore"):  # what is not finite is seen and answered
            run.h = tolerances.step or _first_step(run)
            while run.t < t1:
                status = _advance(run)
                if status is not None:
                    return run.solution(status), False
                if slow is not None and _asked(run, slow) == "leave":
                    return run.solution(run.status), True
                if progress is not None and time.perf_counter() - shown > 0.2:
                    shown = time.perf_counter()
                    progress((run.t - t0) / (t1 - t0))
    except KeyboardInterrupt:
        return run.solution(Status(StatusKind.INTERRUPTED, run.t, "Interrupted.")), False
    return run.solution(run.status), False


def _asked(run: Run, slow: Slow) -> str:
    """What `slow` says where it is to be asked; Newton's iteration begins where it says so."""
    if run.hard < run.asked or run.tolerances.step is not None:
        return "go on"
    run.hard, run.asked = 0, 2 * run.asked if run.asked < 1000 else run.asked
    answer = slow(Pace(run.t, run.x, run.scale.size, run.h, run.slowness, run.contraction, run.newton))
    if answer == "newton":
        run.newton, run.asked = True, 4
    return answer


def _advance(run: Run) -> Status | None:
    """One accepted step; a status when none is possible."""
    if len(run.times) > run.tolerances.max_steps:
        return Status(StatusKind.MAX_STEPS, run.t, f"{run.tolerances.max_steps} steps were not enough.")
    if run.tolerances.step is not None:
        return _advance_fixed(run, run.tolerances.step)
    order, failed, misses, tries, avoided, asked = run.scheme.error_order, False, 0, 0, 0, False
    scale, first, refused = run.scale, min(run.h, run.end - run.t), 0
    if not run.missed or first > run.planned:
        run.planned = first
    if scale.doubts == 0:
        run.trusted = run.h
    while True:
        scale.doubts += refused > 0
        refused += 1
        if scale.in_doubt:
            first = min(max(run.trusted, run.h), run.end - run.t)
            if scale.rests_on_rounding(run.t, run.x, first, run.solver.rate):
                run.h = first
        h = min(run.h, run.end - run.t)
        if run.end - run.t - h < 1e-3 * h:
            h = run.end - run.t
        if h <= 16 * _EPS * max(abs(run.t), abs(run.end) * 1e-3):
            return _underflow(run)
        scale.begin(h, max(run.planned, h))
        solve = run.solver.newton if run.newton else run.solver.fixed_point
        solved = solve(run.t, h, run.x, run.guess(h), scale, LEFT)
        if solved is None:
            if not asked and _stalls_on_rounding(run, h):
                asked = True
                continue
            asked = True
            # where it converged well until now, something local is in the way: other nodes may miss it
            shrink = 0.85 if run.contraction < 0.1 and tries < 4 else 0.4
            run.h, run.rejected, failed, tries = shrink * h, run.rejected + 1, True, tries + 1
            run.planned = min(run.planned, run.h)
            continue
        K, contraction = solved
        to_legendre, along = run.scheme.tableau.to_legendre, run.solver.along
        step = Step(run.t, h, run.x, K, to_legendre @ (K if along is None else along), scale.values)
        error = _step_error(run, step)
        if not error <= 1:
            growth = 0.65 * error ** (-1 / (order + 1)) if error < np.inf else 0.1
            run.h, run.rejected, misses = h * min(0.9, max(0.15, growth)), run.rejected + 1, misses + 1
            continue
        zone = run.solver.zone
        if zone is not None and avoided < _AVOIDED and zone.is_awkward(run.t, h, run.x, run.x + h * (run.scheme.tableau.b @ K)):
            run.h, run.rejected, avoided, refused = 0.8 * h, run.rejected + 1, avoided + 1, refused - 1
            continue
        if run.scheme.superconvergent and step.K.shape[0] > 2 and _hides_kink(run, step, strict=misses > 0):
            run.h, run.rejected, misses = 0.3 * h, run.rejected + 1, misses + 1
            continue
        if zone is not None:  # rounding makes errors jump there: how they grow from step to step says nothing
            run.error = 0.0
        wanted = _next_size(run, h, error)
        run.error, run.contraction, run.missed = error, contraction, misses > 0
        run.accept(step if along is None else replace(step, a=to_legendre @ K))
        _limit_by_contraction(run, h, wanted, contraction, failed)
        if refused == 1:
            scale.doubts = max(0, scale.doubts - 1)
        return None


def _step_error(run: Run, step: Step) -> float:
    """The error of a step in units of its scale.

    Where it asks for shorter steps, what of it is rounding is looked at and forgiven, which no step size makes smaller; for as long
    as there is something to forgive.
    """
    scale, order, before = run.scale, run.scheme.error_order, run.scale.noisy
    error = run.scheme.error(run.solver, step)
    if run.solver.along is not None:
        scale.forget_noise()
        return error
    if not before and error <= (0.55 / _SHORTER) ** (order + 1):
        return error
    scale.look_at_noise(step.h, run.solver.noise(step.h))
    left = run.scheme.error(run.solver, replace(step, noise=scale.noise, scale=scale.values))
    scale.count_noise(left < 0.5 * error, before)
    return left


def _stalls_on_rounding(run: Run, h: float) -> bool:
    """Whether an iteration that did not converge stopped at what rounding makes of the rates; it may be tried again, this being forgiven."""
    scale, solver = run.scale, run.solver
    if solver.along is not None or scale.noisy or not np.isfinite(solver.change):
        return False
    scale.look_at_noise(h, solver.noise(h))
    noise = 2 * scale.noise_in(h) * float(np.sqrt(run.x.size))
    if noise > LEFT and solver.change < noise:
        return True
    scale.forget_noise()
    return False


def _hides_kink(run: Run, step: Step, *, strict: bool) -> bool:
    """Whether the rates jump or bend before the first or after the last node, where no stage sees it.

    The polynomial then misses the rates at the ends of the step by more than the neglected terms explain. `strict`: after
    rejections, when a kink is near. What a jump of the rates moves a state by in a step of the size that was planned counts as the
    state's size: so jumps from rest are found, too.
    """
    tableau, solver, unit = run.scheme.tableau, run.solver, step.h / step.scale
    end = step.x + ((step.h * tableau.b)[:, None] * step.K).sum(axis=0)
    signs = (-1.0) ** np.arange(tableau.stages)
    soonest, stages = step.h / (run.scale.unit * PART * run.scale.reach), tableau.stages
    missed = (
        signs @ step.a - solver.rate_along(step.t, step.x, step.h),
        step.a.sum(axis=0) - solver.rate_along(step.t + step.h, end, step.h),
    )
    first, last = (
        float(np.max(np.where(np.isnan(m), np.nan, np.minimum(run.scale.heard(m, stages) * unit, soonest)), initial=0.0))
        for m in missed
    )
    last = last if np.isfinite(missed[1]).all() else np.nan
    worst = max(first, last)
    if not np.isfinite(last):
        return True
    if tableau.c[0] * worst <= 1:
        return False
    sizes = np.abs(step.a * unit).max(axis=1)
    neglected = float(sizes[-1]) * float(sizes[-1] / sizes.max()) ** (1 / (tableau.stages - 1))
    return strict or worst > 6 * neglected


def _next_size(run: Run, h: float, error: float) -> float:
    """Step size for an error of one, by the smaller of the plain and the predictive controller (Gustafsson 1994)."""
    if error == 0:
        return 4.0 * h
    power = 1 / (run.scheme.error_order + 1)
    growth = 0.55 * error**-power
    if run.last is not None and run.error > 0:
        growth = min(growth, growth * (h / run.last.h) * (run.error / error) ** power)
    return h * min(4.0, max(0.3, growth))


def _limit_by_contraction(run: Run, h: float, wanted: float, contraction: float, failed: bool) -> None:
    """Sets the next step size: as accuracy allows, and such that the iteration converges quickly."""
    squared = run.solver.copies and not run.newton
    best, power = (0.2, 0.5) if squared else (0.3, 1.0)
    limit = 0.7 * h if failed else h * (best / contraction) ** power if contraction > 0 else np.inf
    slow = failed or wanted > 2 * limit
    run.h = min(wanted, limit)
    run.slowness = wanted / run.h
    run.hard = run.hard + 1 if slow or run.newton else max(0, run.hard - 1)


def _advance_fixed(run: Run, size: float) -> Status | None:
    h = min(size, run.end - run.t)
    if run.end - run.t - h < 1e-9 * h:
        h = run.end - run.t
    scale = run.scale
    scale.begin(h, h)
    guess = run.guess(h)
    solved = run.solver.newton(run.t, h, run.x, guess, scale, 0.0) if run.newton else None
    if solved is None:
        solved = run.solver.fixed_point(run.t, h, run.x, guess, scale, 0.0)
    if solved is None and run.scheme.newton is Newton.WHERE_SLOW:
        solved = run.solver.newton(run.t, h, run.x, run.guess(h), scale, 0.0)
        run.newton_steps += solved is not None
    if solved is None:
        if not np.isfinite(run.solver.rate(run.t, run.x)).all():
            return _underflow(run)
        message = "The stage equations did not converge; use a smaller step."
        return Status(StatusKind.NOT_CONVERGED, run.t, message, _worst(run))
    run.accept(Step(run.t, h, run.x, solved[0], run.scheme.tableau.to_legendre @ solved[0], scale.values))
    return None


def _first_step(run: Run) -> float:
    """A first step: a part of the time in which the motion changes much, from the rates at the start and a little later along them.

    Roots of size over change of rate, and rates over their change, are times whatever the unit. A state near zero may pretend to
    change quickly, hence a least step; what is too long is rejected.
    """
    span, size, time, soon = run.end - run.t, np.abs(run.x), np.inf, 1e-3 * (run.end - run.t)
    rate = run.solver.rate(run.t, run.x).copy()
    for _ in range(8):
        bend = np.abs(run.solver.rate(run.t + soon, run.x + soon * rate) - rate) / soon
        here = np.where((size == 0) | (bend == 0), np.inf, np.maximum(np.sqrt(size / bend), np.abs(rate) / bend))
        time = float(np.where(np.isfinite(bend), here, 0.0).min(initial=np.inf))
        if time >= 2 * soon:
            break
        soon = max(0.1 * time, 1e-3 * soon)
    return min(0.01 * span, max(1e-6 * span, (1e-4 * run.tolerances.rtol) ** (1 / (run.scheme.error_order + 1)) * time))


def _underflow(run: Run) -> Status:
    rate = run.solver.rate(run.t, run.x)
    if not np.isfinite(rate).all() or not np.isfinite(run.x).all():
        return Status(StatusKind.NON_FINITE, run.t, "A rate became infinite or not a number.", _worst(run))
    message = "The step size fell to rounding: the motion may be singular here."
    return Status(StatusKind.STEP_UNDERFLOW, run.t, message, _worst(run))


def _worst(run: Run) -> int | None:
    """The state with a rate that is not finite, otherwise the one with the largest rate in units of its tolerance."""
    rate = run.solver.rate(run.t, run.x)
    bad = np.flatnonzero(~np.isfinite(rate))
    return int(bad[0]) if bad.size else int(np.argmax(np.abs(rate) / run.scale.values)) if rate.size else None
