"""Integrate with the method of a name."""

from __future__ import annotations

import numpy as np

from acausal.collocation.problem import Accuracy, Problem, Progress, Solution
from acausal.errors import OptionError


def integrate(
    problem: Problem,
    x0: np.ndarray,
    t0: float,
    t1: float,
    accuracy: Accuracy,
    *,
    method: str = "auto",
    order: int | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Integrate from t0 to t1 >= t0 with the integrator called `method`: auto, gauss, radau, cvodes, idas, rosenbrock, or one added.

    Numerical trouble is a `Status` in the result; a wrong call raises `OptionError`.
    """
    from acausal.integrators.base import integrator

    if not t1 >= t0 or not np.isfinite(t1 - t0):
        raise OptionError(f"simulate: the end {t1} s must be finite and not before the start {t0} s.")
    solution = integrator(method, order, accuracy.step).integrate(problem, x0, t0, t1, accuracy, progress)
    if problem.guards is not None and not solution.located:
        from acausal.integrators.guards import located

        return located(problem, solution)
    return solution
