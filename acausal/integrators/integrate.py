"""Integrate with the method of a name."""

from __future__ import annotations

import warnings

import numpy as np

from acausal.arguments import finite
from acausal.collocation.problem import Problem, Progress, Solution, Tolerances
from acausal.errors import OptionError, RoundingWarning
from acausal.wording import callers_level

_FINEST = 1e-15


def integrate(
    problem: Problem,
    x0: np.ndarray,
    t0: float,
    t1: float,
    rtol: float,
    atol: float,
    *,
    method: str = "auto",
    order: int | None = None,
    step: float | None = None,
    max_steps: int = 1_000_000,
    max_step: float | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Integrate from t0 to t1 >= t0 with the integrator called `method`: auto, gauss, radau, cvodes, idas, rosenbrock, or one added.

    Numerical trouble is a `Status` in the result; a wrong call raises `OptionError`.
    """
    from acausal.integrators.base import integrator

    rtol, atol = finite(rtol, "simulate: rtol"), finite(atol, "simulate: atol")
    if not t1 >= t0 or not np.isfinite(t1 - t0):
        raise OptionError(f"simulate: the end {t1} s must be finite and not before the start {t0} s.")
    if not (0 < rtol < 1 and atol >= 0) or (step is not None and not step > 0):
        raise OptionError(f"simulate: need 0 < rtol < 1, atol >= 0 and step > 0, not rtol={rtol}, atol={atol}, step={step}.")
    if max_step is not None and (not max_step > 0 or step is not None):
        raise OptionError(
            f"simulate: max_step must be positive, and goes with steps that adapt, not with a fixed `step`: max_step={max_step}, step={step}."
        )
    if rtol < _FINEST:
        message = f"rtol={rtol:g} asks for more than double precision holds; {_FINEST:g} is used. Errors stay at rounding."
        warnings.warn(message, RoundingWarning, stacklevel=callers_level())
        rtol = _FINEST
    tolerances = Tolerances(rtol, atol, None, max_steps, max_step)
    solution = integrator(method, order, step).integrate(problem, x0, t0, t1, tolerances, progress)
    if problem.guards is not None and not solution.located:
        from acausal.integrators.guards import located

        return located(problem, solution)
    return solution
