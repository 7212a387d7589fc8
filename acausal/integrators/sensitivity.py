"""Forward sensitivities: derivatives of a motion with respect to start values, inputs and parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.collocation.modes import ModesMet
from acausal.collocation.problem import Accuracy, Directions, Problem, Status
from acausal.integrators.automatic import gauss_or_radau
from acausal.integrators.base import native
from acausal.runtime.native import Run


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

    The derivatives are those of the numerical motion, carried along step by step, directions in lanes. What is asked for inside of steps is refined as dense
    output is, or the step ends there.
    """
    choice = gauss_or_radau()
    start = float(times[0])
    run = Run(native(problem), problem, x0, start, start, accuracy, choice, directions, times[1:])
    begins = run.discrete_S.T.copy()
    status = run.advance(float(times[-1])).status
    x = np.column_stack([x0, run.asked_x.T])
    S = np.concatenate([directions.dx[None], run.asked_S.transpose(0, 2, 1)])
    discrete = np.concatenate([begins[None], run.asked_discrete.transpose(0, 2, 1)])
    return Sensitive(x, S, status, run.core.passages, run.modes(), _law(run.core.grazed), _law(run.core.coincides), discrete)


def _law(number: int) -> int | None:
    return number - 1 if number else None
