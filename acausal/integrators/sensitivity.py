"""Forward sensitivities: derivatives of a motion with respect to start values, inputs and parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from acausal.collocation.problem import Accuracy, Directions, Newton, Problem, Status, StatusKind
from acausal.collocation.tableau import gauss_legendre
from acausal.integrators.automatic import stiffness_of
from acausal.integrators.base import native
from acausal.integrators.gauss import default_order
from acausal.integrators.radau import Radau
from acausal.runtime.native import Choice, Run


@dataclass(frozen=True)
class Sensitive:
    """States x (nx, m) at m times and their derivatives S (m, nx, n) in n directions; NaN after the time of a failing `status`.

    `passages`: number of steps around singular positions of loops, where derivatives of the rates are huge and lose digits.
    """

    x: np.ndarray
    S: np.ndarray
    status: Status
    passages: int = 0


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
    tableau = gauss_legendre(default_order(accuracy.rtol, compiled.lanes) // 2)
    slow, choice = stiffness_of(problem, tableau), Choice((tableau,), Newton.WHERE_SLOW)
    run = Run(compiled, problem, x0, float(times[0]), float(times[0]), accuracy, choice, directions)
    status, passages = Status(StatusKind.SUCCESS, float(times[0])), 0
    for k, end in enumerate(times[1:], start=1):
        outcome = run.advance(float(end), slow=slow)
        if outcome.left:
            passages += run.core.passages
            now = Directions(run.S.T.copy(), directions.du, directions.dp)
            choice = Radau().choice(accuracy.rtol)
            problem = replace(problem, met=np.ctypeslib.as_array(run.core.size, run.x.shape).copy())
            run = Run(compiled, problem, run.x, outcome.status.time, float(end), accuracy, choice, now)
            outcome = run.advance(float(end))
        status = outcome.status
        if status.kind is not StatusKind.SUCCESS:
            break
        x[:, k], S[k] = run.x, run.S.T
    return Sensitive(x, S, status, passages + run.core.passages)
