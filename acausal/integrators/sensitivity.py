"""Forward sensitivities: derivatives of a motion with respect to start values, inputs and parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.collocation.modes import ModesMet
from acausal.collocation.problem import Accuracy, Directions, Problem, Status, StatusKind
from acausal.integrators.automatic import gauss_or_radau
from acausal.integrators.base import native
from acausal.runtime.native import Run, interrupts_noted


@dataclass(frozen=True)
class Sensitive:
    """States x (nx, m) at m times and their derivatives S (m, nx, n) in n directions; NaN after the time of a failing `status`.

    `passages`: number of steps around singular positions of loops, where derivatives of the rates are huge and lose digits. `modes`: as they changed.
    `discrete` (m, k, n): derivatives of discrete values. `grazed`: the law of modes whose guard only touched zero first, None: none; `coincides`: that whose gap closed together with others, each for itself.
    """

    x: np.ndarray
    S: np.ndarray
    status: Status
    passages: int = 0
    modes: ModesMet | None = None
    grazed: int | None = None
    coincides: int | None = None
    discrete: np.ndarray | None = None


def integrate_sensitivities(
    problem: Problem, x0: np.ndarray, times: np.ndarray, directions: Directions, accuracy: Accuracy
) -> Sensitive:
    """States and derivatives at ascending times (m,), the first of which is the start.

    The derivatives are those of the numerical motion, carried along step by step, directions in lanes; steps end at the times.
    """
    compiled = native(problem)
    x = np.full((x0.size, times.size), np.nan)
    S = np.full((times.size, *directions.dx.shape), np.nan)
    x[:, 0], S[0] = x0, directions.dx
    choice = gauss_or_radau(accuracy.rtol)
    run = Run(compiled, problem, x0, float(times[0]), float(times[0]), accuracy, choice, directions)
    status, D = Status(StatusKind.SUCCESS, float(times[0])), [run.discrete_S.T.copy()] * times.size
    with interrupts_noted() as interrupts:  # once for all times: each of them may be a step of microseconds
        for k, end in enumerate(times[1:], start=1):
            status = run.advance(float(end)).status
            if interrupts:
                raise KeyboardInterrupt
            if status.kind is not StatusKind.SUCCESS:
                break
            x[:, k], S[k], D[k] = run.x, run.S.T, run.discrete_S.T.copy()
    return Sensitive(x, S, status, run.core.passages, run.modes(), _law(run.core.grazed), _law(run.core.coincides), np.array(D))


def _law(number: int) -> int | None:
    return number - 1 if number else None
