"""Adaptive collocation: the driver loop for Gauss and Radau, on CasADi's virtual machine."""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass, field

import numpy as np

from acausal.integrators.dense import CollocationPolynomial, refined
from acausal.integrators.problem import Problem, Progress, Solution, Statistics, Status, StatusKind, Tolerances
from acausal.integrators.stages import StageSolver
from acausal.integrators.tableau import Tableau, legendre_values

_EPS = float(np.finfo(float).eps)


@dataclass
class Run:
    """The state of a run: grows step by step, and is turned into a `Solution` at any moment."""

    problem: Problem
    tableau: Tableau
    newton: bool
    tolerances: Tolerances
    t: float
    x: np.ndarray
    end: float
    h: float = 0.0
    rejected: int = 0
    error: float = 0.0
    """Of the last step, in units of the tolerance."""
    hard: int = 0
    """Steps in a row whose size was set by the convergence of the fixed-point iteration, not by accuracy."""
    times: list[float] = field(default_factory=list)
    states: list[np.ndarray] = field(default_factory=list)
    coefficients: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.started = time.perf_counter()
        self.solver = StageSolver(self.problem, self.tableau, self.newton)
        self.times.append(self.t)
        self.states.append(self.x.copy())
        self._carry = np.zeros_like(self.x)
        self._size = np.abs(self.x)
        self._last: tuple[float, np.ndarray] | None = None

    def scale(self) -> np.ndarray:
        """atol + rtol * the largest |x| met so far, per state (nx,)."""
        return self.tolerances.atol + self.tolerances.rtol * self._size

    def solution(self, status: Status) -> Solution:
        """What has been computed so far."""
        t, x = np.array(self.times), np.array(self.states)
        s, nx = self.tableau.stages, self.x.size
        coefficients = np.array(self.coefficients).reshape(len(t) - 1, s, nx)

        @functools.cache
        def polynomial() -> CollocationPolynomial:
            if self.newton:
                return CollocationPolynomial(t, x, coefficients)
            return refined(self.problem, t, x, coefficients)

        statistics = Statistics(
            self.tableau.name,
            self.tableau.order,
            len(t) - 1,
            self.rejected,
            self.solver.rates.evaluations,
            self.solver.iterations,
            time.perf_counter() - self.started,
        )
        return Solution(t, x.T, lambda times: polynomial()(times), statistics, status)

    def guess(self, h: float) -> np.ndarray:
        """Stage rates (s, nx) by extrapolating the last step's polynomial; the rate at the start for the first step."""
        if self._last is None:
            self.solver.rates.at(np.full(self.tableau.stages, self.t))
            self.solver.rates.X[:] = self.x
            return self.solver.rates.evaluate().copy()
        h_last, a = self._last
        return legendre_values(1 + self.tableau.c * (h / h_last), self.tableau.stages) @ a

    def accept(self, h: float, K: np.ndarray, a: np.ndarray) -> None:
        """Advance by h with compensated summation, project onto the invariants, remember the polynomial."""
        increment = h * (self.tableau.b @ K) + self._carry
        x = self.x + increment
        self._carry = increment - (x - self.x)
        self.t = self.end if abs(self.end - (self.t + h)) <= 4 * _EPS * abs(self.end) else self.t + h
        projected = self.projected(self.t, x)
        if projected is not x:
            self._carry = np.zeros_like(x)
        self.x = projected
        np.maximum(self._size, np.abs(self.x), out=self._size)
        self.times.append(self.t)
        self.states.append(self.x)
        self.coefficients.append(a)
        self._last = (h, a)

    def is_stiff(self) -> bool:
        """Whether the fastest decay, not accuracy, holds the step size down, or is so fast that iteration holds on by luck only."""
        eigenvalues = np.linalg.eigvals(self.solver.jacobian(self.t, self.x))
        decay = self.h * float(np.max(-eigenvalues.real, initial=0.0))
        growth = self.h * float(np.max(eigenvalues.real, initial=0.0))  # as large as the decay where energy is kept
        return decay > 3 * growth and (decay > 8 or (decay > 0.5 and self.error < 1e-3))

    def projected(self, t: float, x: np.ndarray) -> np.ndarray:
        """x with the invariants met as well as rounding allows (Newton, at most ten corrections)."""
        project, invariants = self.problem.project, self.problem.invariants
        if project is None or invariants is None:
            return x
        gap = float(np.max(np.abs(np.array(invariants(t, x, self.problem.parameters))), initial=0.0))
        for k in range(10):
            if gap <= 2 * _EPS:
                break
            trial = np.array(project(t, x, self.problem.parameters)).ravel()
            new = float(np.max(np.abs(np.array(invariants(t, trial, self.problem.parameters))), initial=0.0))
            # moving q may open the velocity rows at first; the second correction closes them
            if not np.isfinite(new) or (k >= 2 and not new < gap):
                break
            x, gap = trial, new
        return x


def collocate(
    problem: Problem,
    tableau: Tableau,
    x0: np.ndarray,
    t0: float,
    t1: float,
    tolerances: Tolerances,
    *,
    newton: bool,
    leave_when_stiff: bool = False,
    progress: Progress | None = None,
) -> tuple[Solution, bool]:
    """Integrate by collocation; the solution, and whether it was left early because fixed-point iteration is hopeless."""
    run = Run(problem, tableau, newton, tolerances, t0, np.array(x0, dtype=float), t1)
    if not np.all(np.isfinite(run.x)):
        return run.solution(Status(StatusKind.NON_FINITE, t0, "The start values are not finite.")), False
    if x0.size == 0 or t1 == t0:
        return run.solution(Status(StatusKind.SUCCESS, t0)), False
    run.h = tolerances.step or _first_step(run)
    shown = time.perf_counter()
    try:
        while run.t < t1:
            status = _advance(run)
            if status is not None:
                return run.solution(status), False
            if leave_when_stiff and (run.hard > 12 or (len(run.times) % 25 == 0 and run.is_stiff())):
                return run.solution(Status(StatusKind.NOT_CONVERGED, run.t)), True
            if progress is not None and time.perf_counter() - shown > 0.2:
                shown = time.perf_counter()
                progress((run.t - t0) / (t1 - t0))
    except KeyboardInterrupt:
        return run.solution(Status(StatusKind.INTERRUPTED, run.t, "Interrupted.")), False
    return run.solution(Status(StatusKind.SUCCESS, run.t)), False


def _advance(run: Run) -> Status | None:
    """One accepted step; a status when none is possible."""
    if len(run.times) > run.tolerances.max_steps:
        return Status(StatusKind.MAX_STEPS, run.t, f"{run.tolerances.max_steps} steps were not enough.")
    fixed = run.tolerances.step is not None
    limited = False
    while True:
        h = min(run.h, run.end - run.t)
        if run.end - run.t - h < (1e-9 if fixed else 1e-3) * h:
            h = run.end - run.t
        if h <= 16 * _EPS * max(abs(run.t), abs(run.end) * 1e-3):
            return _underflow(run)
        scale = run.scale()
        solved = run.solver.solve(run.t, h, run.x, run.guess(h), scale, 1e-3 if not fixed else 0.0)
        if solved is None:
            if fixed:
                return Status(
                    StatusKind.NOT_CONVERGED, run.t, "The stage equations did not converge; use a smaller step.", _worst(run)
                )
            run.h, run.rejected, limited = 0.4 * h, run.rejected + 1, True
            continue
        K, contraction = solved
        a = run.tableau.to_legendre @ K
        if fixed:
            run.accept(h, K, a)
            return None
        error = (
            _radau_error(run, h, K, scale) if run.newton and run.tableau.name == "radau" else _gauss_error(run, h, a, K, scale)
        )
        order = run.tableau.stages if run.newton and run.tableau.name == "radau" else run.tableau.order
        growth = 0.9 * (1 / max(error, 1e-30)) ** (1 / (order + 1))
        if not error <= 1:
            run.h, run.rejected = h * min(0.9, max(0.15, growth)), run.rejected + 1
            continue
        run.error = error
        run.accept(h, K, a)
        wanted = h * min(4.0, max(0.3, growth))
        if not run.newton and contraction > 0.25:  # more iterations than a smaller step would cost
            limited = limited or wanted > 1.5 * h
            wanted = min(wanted, h * 0.25 / contraction) if contraction > 0.35 else min(wanted, h)
        run.hard = run.hard + 1 if limited else 0
        run.h = wanted
        return None


def _gauss_error(run: Run, h: float, a: np.ndarray, K: np.ndarray, scale: np.ndarray) -> float:
    """Error of a Gauss step in units of `scale`, from how fast the Legendre coefficients of the rates decay.

    They decay geometrically, a_k ~ a_0 r^k; the last one known gives r, and quadrature on s nodes misses a_2s.
    """
    s = run.tableau.stages
    sizes = np.max(np.abs(a) * (h / scale), axis=1)
    largest = float(np.max(sizes))
    if largest == 0.0:
        return 0.0
    if s == 1:
        run.solver.rates.X[:] = run.x
        start = run.solver.rates.evaluate()
        ratio = float(np.max(np.abs((K - start) * h / scale))) / largest
        return largest * min(1.0, ratio) ** 2
    tail = float(sizes[-1])
    if s > 2:
        tail = max(tail, largest * (float(sizes[-2]) / largest) ** ((s - 1) / (s - 2)))
    return largest * (tail / largest) ** (2 * s / (s - 1))


def _radau_error(run: Run, h: float, K: np.ndarray, scale: np.ndarray) -> float:
    """Embedded formula of order s with the rate at the start, filtered by (1 - h g J)^-1: Hairer and Wanner II, (IV.8.19)."""
    gamma, weights = _radau_weights(run.tableau.stages)
    run.solver.rates.at(np.full(run.tableau.stages, run.t))
    run.solver.rates.X[:] = run.x
    start = run.solver.rates.evaluate()[0].copy()
    difference = h * (gamma * start + weights @ K)
    matrix = np.eye(run.x.size) - h * gamma * run.solver.jacobian(run.t, run.x)
    error = np.linalg.solve(matrix, difference)
    norm = float(np.sqrt(np.mean((error / scale) ** 2)))
    if norm > 1 and len(run.times) == 1:  # a second filter, for a first step within a boundary layer
        run.solver.rates.X[:] = run.x + error
        again = h * (gamma * run.solver.rates.evaluate()[0] + weights @ K)
        norm = min(norm, float(np.sqrt(np.mean((np.linalg.solve(matrix, again) / scale) ** 2))))
    return norm


@functools.cache
def _radau_weights(stages: int) -> tuple[float, np.ndarray]:
    from acausal.integrators.tableau import radau_iia

    tableau = radau_iia(stages)
    values = np.linalg.eigvals(tableau.A)
    gamma = float(np.real(values[np.argmin(np.abs(values.imag))]))
    powers = np.vander(tableau.c, stages, increasing=True).T
    moments = 1 / np.arange(1, stages + 1)
    moments[0] -= gamma
    return gamma, np.linalg.solve(powers, moments) - tableau.b


def _first_step(run: Run) -> float:
    """A first step on which the state changes by about 1 % of its size; the error control does the rest."""
    rate = run.guess(0.0)[0]
    span = run.end - run.t
    size = np.maximum(np.abs(run.x), 1e-3 * max(1.0, float(np.max(np.abs(run.x), initial=0.0))))
    fastest = float(np.max(np.abs(rate) / size, initial=0.0))
    if not np.isfinite(fastest):
        return 1e-6 * span
    return min(0.01 * span, 0.05 / fastest) if fastest > 0 else 0.01 * span


def _underflow(run: Run) -> Status:
    rate = run.guess(run.h)
    if not np.all(np.isfinite(rate)) or not np.all(np.isfinite(run.x)):
        return Status(StatusKind.NON_FINITE, run.t, "A rate became infinite or not a number.", _worst(run))
    return Status(
        StatusKind.STEP_UNDERFLOW, run.t, "The step size fell to rounding: the motion may be singular here.", _worst(run)
    )


def _worst(run: Run) -> int | None:
    run.solver.rates.at(np.full(run.tableau.stages, run.t))
    run.solver.rates.X[:] = run.x
    rate = run.solver.rates.evaluate()[0]
    bad = np.flatnonzero(~np.isfinite(rate))
    return int(bad[0]) if bad.size else int(np.argmax(np.abs(rate))) if rate.size else None
