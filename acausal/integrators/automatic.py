"""Gauss, and Radau IIA from where the scene turns out to be stiff."""

from __future__ import annotations

import functools
import warnings
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from acausal.collocation.problem import Accuracy, Newton, Problem, Progress, Solution
from acausal.collocation.tableau import Tableau, eigenvectors, gauss_legendre
from acausal.errors import NoCompilerWarning, NoRuntimeError
from acausal.integrators.base import AbstractIntegrator, native
from acausal.integrators.builtin import Cvodes
from acausal.integrators.gauss import Gauss, default_order, newton_where_slow
from acausal.integrators.radau import Radau
from acausal.numerics.rounding import scaled_jacobian
from acausal.runtime.native import Choice, Pace, Slow
from acausal.wording import callers_level

_LARGEST = 400
"""States up to which eigenvalues are looked at."""
_FAST = 1.0
"""Decay in a step from which on Gauss, which does not damp it, is the wrong method."""


@functools.cache
def warn_no_compiler(reason: str) -> None:
    """Say, once in a process for each reason, what is missing."""
    warnings.warn(f"{reason} CVODES of CasADi integrates instead.", NoCompilerWarning, stacklevel=callers_level())


@dataclass(frozen=True)
class Automatic(AbstractIntegrator):
    """Starts with Gauss; goes on with Radau IIA where fast decay, not accuracy, would hold the step size down.

    A fast oscillation without damping stays with Gauss, which keeps its energy: Radau would damp it. `order` is Gauss's.
    With a fixed `step` [s] it is Gauss.
    """

    name: ClassVar[str] = "auto"
    order: int | None = None
    step: float | None = None

    def __post_init__(self) -> None:
        Gauss(self.order, self.step)  # raises for an order that Gauss does not have

    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None = None
    ) -> Solution:
        """See `AbstractIntegrator`. The statistics name the methods that ran."""
        accuracy = accuracy.with_step(self.step)
        try:
            compiled = native(problem)
        except NoRuntimeError as error:
            warn_no_compiler(str(error))
            return Cvodes().integrate(problem, x0, t0, t1, accuracy, progress)
        tableau = gauss_legendre((self.order or default_order(accuracy.rtol, compiled.lanes)) // 2)
        choice, leave = Choice((tableau,), Newton.WHERE_SLOW), stiffness_of(problem, tableau)
        first, stiff = compiled.integrate(problem, x0, t0, t1, accuracy, choice, progress, leave)
        if not stiff or first.stopped:
            return first
        done = (float(first.t[-1]) - t0) / (t1 - t0)
        later = None if progress is None else lambda fraction: progress(done + (1 - done) * fraction)
        problem = replace(problem, met=np.max(np.abs(first.x), axis=1))
        rest = Radau().integrate(problem, first.x[:, -1], float(first.t[-1]), t1, accuracy, later)
        return joined(first, rest)


def stiffness_of(problem: Problem, tableau: Tableau) -> Slow:
    """Leaves Gauss for Radau where decay explains the contraction of the iteration, or is fast against the steps of Newton's; solves by
    Newton where something else makes it slow.
    """
    radius = float(np.max(np.abs(eigenvectors(tableau)[0])))
    seen = 0  # a look at one moment may deceive: decay and growth take turns in many a motion

    def answer(pace: Pace) -> str:
        nonlocal seen
        if pace.x.size > _LARGEST:
            return newton_where_slow(pace)
        u = problem.inputs(np.array([pace.t]))[:, 0]
        decay, growth = fastest(scaled_jacobian(problem.rhs, pace.t, pace.x, u, problem.parameters, pace.size))
        least = _FAST if pace.newton else 0.1 * pace.contraction / radius
        seen = seen + 1 if decay > 3 * growth and pace.h * decay > least else 0
        return "leave" if seen > 1 else "go on" if seen else newton_where_slow(pace)

    return answer


def fastest(jacobian: np.ndarray) -> tuple[float, float]:
    """Fastest decay and growth [1/s] of a linear system (n, n); the two are equal where energy is kept, and 0 where rates are not known."""
    if not np.isfinite(jacobian).all():
        return 0.0, 0.0
    real = np.real(np.linalg.eigvals(jacobian))
    return float(np.max(-real, initial=0.0)), float(np.max(real, initial=0.0))


def joined(first: Solution, second: Solution) -> Solution:
    """Two solutions one after the other."""
    switch = first.t[-1]

    def dense(times: np.ndarray) -> np.ndarray:
        result = np.empty((first.x.shape[0], times.size))
        early = times < switch
        if early.any():
            result[:, early] = first.dense(times[early])
        if (~early).any():
            result[:, ~early] = second.dense(times[~early])
        return result

    a, b = first.statistics, second.statistics
    statistics = replace(
        b,
        method=f"{a.method}, then {b.method}",
        steps=a.steps + b.steps,
        rejected=a.rejected + b.rejected,
        evaluations=a.evaluations + b.evaluations,
        iterations=a.iterations + b.iterations,
        seconds=a.seconds + b.seconds,
        factorisations=a.factorisations + b.factorisations,
        kernels=a.kernels if a.kernels == b.kernels else f"{a.kernels}, then {b.kernels}",
        compiling=a.compiling + b.compiling,
    )
    return Solution(
        np.concatenate([first.t, second.t[1:]]),
        np.hstack([first.x, second.x[:, 1:]]),
        dense,
        statistics,
        second.status,
        first.crossings + second.crossings,
        second.stopped,
        first.located and second.located,
    )
