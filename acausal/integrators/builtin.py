"""CasADi's own integrators as fall-back and independent check: cvodes, idas, rosenbrock."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from acausal.collocation.problem import Accuracy, Problem, Progress, Solution, Statistics, Status, StatusKind
from acausal.integrators.base import AbstractIntegrator
from acausal.numerics.staged import plain

_GRID = 100
_CORRECTIONS, _CORRECTED = 1000, 1e-15
"""Of invariants, at most, and what the last one changes of a state; two suffice but where inputs jump."""


@dataclass(frozen=True)
class Cvodes(AbstractIntegrator):
    """SUNDIALS' CVODES: backward differentiation formulas of variable order."""

    name: ClassVar[str] = "cvodes"

    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None = None
    ) -> Solution:
        """See `AbstractIntegrator`. On a grid of 100 intervals."""
        return _integrate_builtin(self.name, problem, x0, t0, t1, accuracy, progress)


@dataclass(frozen=True)
class Idas(Cvodes):
    """SUNDIALS' IDAS: backward differentiation formulas for implicit equations."""

    name: ClassVar[str] = "idas"


@dataclass(frozen=True)
class Rosenbrock(Cvodes):
    """CasADi's linearly implicit method of order 5(4)."""

    name: ClassVar[str] = "rosenbrock"


def _integrate_builtin(
    name: str, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None
) -> Solution:
    """Integrate on a grid of 100 intervals, projecting onto the invariants after each.

    Inputs are held over each interval. Dense output integrates again from the nearest grid point, so it has the method's accuracy.
    """
    started = time.perf_counter()
    f = plain(problem.rhs)
    t, x, u, p, span, begin = (
        ca.MX.sym(n, k)
        for n, k in (("t", 1), ("x", f.size1_in(1)), ("u", f.size1_in(2)), ("p", f.size1_in(3)), ("span", 1), ("begin", 1))
    )
    parameters = ca.vertcat(begin, span, u, p)
    dae = {"t": t, "x": x, "p": parameters, "ode": span * f(begin + span * t, x, u, p)}
    options = {"abstol": accuracy.atol or accuracy.rtol, "reltol": accuracy.rtol}
    if name in ("cvodes", "idas"):
        options["max_num_steps"] = 100_000
    if accuracy.max_step is not None and t1 > t0:
        options["max_step_size"] = min(1.0, accuracy.max_step * _GRID / (t1 - t0))
    step = ca.integrator("step", name, dae, 0.0, 1.0, options) if x.numel() else None  # which asks for a state

    project = problem.project
    led = project is not None and project.jac_sparsity(0, 2).nnz() > 0

    def projected(time: float, state: np.ndarray, u: np.ndarray) -> np.ndarray:
        for k in range(_CORRECTIONS if project is not None else 0):
            assert project is not None
            before, state = state, np.array(project(time, state, u, problem.parameters)).ravel()
            if k > 0 and not np.any(np.abs(state - before) > _CORRECTED * np.abs(state)):
                break
        return state

    def advance(start: float, h: float, state: np.ndarray) -> np.ndarray:
        if step is None:
            return state
        held = problem.inputs(np.array([start + h / 2]))[:, 0]
        if led:  # what follows inputs at once jumps to where they are held
            state = projected(start, state, held)
        return np.array(step(x0=state, p=np.concatenate([[start, h], held, problem.parameters]))["xf"]).ravel()

    times = np.linspace(t0, t1, _GRID + 1)
    states = [np.array(x0, dtype=float)]
    status = Status(StatusKind.SUCCESS, t1)
    for k in range(_GRID):
        try:
            new = advance(times[k], times[k + 1] - times[k], states[-1])
        except RuntimeError as error:
            status = Status(
                StatusKind.BUILTIN_FAILED, float(times[k]), f"CasADi's {name} gave up: {str(error).strip().splitlines()[-1]}"
            )
            break
        except KeyboardInterrupt:
            status = Status(StatusKind.INTERRUPTED, float(times[k]), "Interrupted.")
            break
        if not np.all(np.isfinite(new)):
            status = Status(
                StatusKind.NON_FINITE,
                float(times[k]),
                f"CasADi's {name} returned a number that is not finite.",
                int(np.flatnonzero(~np.isfinite(new))[0]),
            )
            break
        new = projected(times[k + 1], new, problem.inputs(times[[k + 1]])[:, 0])
        states.append(new)
        try:
            if progress is not None:
                progress((k + 1) / _GRID)
        except KeyboardInterrupt:
            status = Status(StatusKind.INTERRUPTED, float(times[k + 1]), "Interrupted.")
            break
    reached = times[: len(states)]
    grid = np.array(states)

    def dense(wanted: np.ndarray) -> np.ndarray:
        result = np.empty((grid.shape[1], wanted.size))
        for i, moment in enumerate(wanted):
            k = max(0, int(np.searchsorted(reached, moment, side="right")) - 1)
            result[:, i] = grid[k] if moment <= reached[k] else advance(reached[k], moment - reached[k], grid[k])
        return result

    statistics = Statistics(name, 0, len(states) - 1, 0, 0, 0, time.perf_counter() - started)
    return Solution(reached, grid.T, dense, statistics, status)
