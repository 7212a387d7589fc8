"""Integrators: implicit collocation (Gauss, Radau IIA) driven from Python, and CasADi's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acausal.errors import OptionError
from acausal.integrators.problem import Problem, Progress, Solution, Tolerances


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
    progress: Progress | None = None,
) -> Solution:
    """Integrate from t0 to t1 > t0. Numerical trouble is a `Status` in the result; a wrong call raises `OptionError`.

    "auto": Gauss with fixed-point iteration, and Radau IIA from where that no longer converges (stiff scenes).
    """
    from acausal.integrators.builtin import METHODS, integrate_builtin
    from acausal.integrators.collocation import collocate
    from acausal.integrators.tableau import gauss_legendre, radau_iia

    if not t1 >= t0 or not np.isfinite(t1 - t0):
        raise OptionError(f"simulate: the end {t1} s must be finite and not before the start {t0} s.")
    if not (0 < rtol < 1 and atol > 0) or (step is not None and not step > 0):
        raise OptionError(f"simulate: need 0 < rtol < 1, atol > 0 and step > 0, not rtol={rtol}, atol={atol}, step={step}.")
    tolerances = Tolerances(max(rtol, 1e-15), atol, step, max_steps)
    if method in METHODS:
        return integrate_builtin(method, problem, x0, t0, t1, tolerances, progress)
    if method == "radau":
        odd = order or (5 if rtol > 1e-6 else 9 if rtol > 1e-10 else 13)
        return collocate(problem, radau_iia((odd + 1) // 2), x0, t0, t1, tolerances, newton=True, progress=progress)[0]
    if method not in ("auto", "gauss"):
        raise OptionError(f"simulate: unknown method '{method}'. Use auto, gauss, radau, {', '.join(METHODS)}.")
    even = order or default_order(rtol)
    tableau = gauss_legendre(even // 2)
    if method == "gauss":
        return collocate(problem, tableau, x0, t0, t1, tolerances, newton=False, progress=progress)[0]
    solution, stiff = collocate(problem, tableau, x0, t0, t1, tolerances, newton=False, leave_when_stiff=True, progress=progress)
    if not stiff:
        return solution
    rest = integrate(
        problem, solution.x[:, -1], float(solution.t[-1]), t1, rtol, atol, method="radau", max_steps=max_steps, progress=progress
    )
    return _joined(solution, rest)


def default_order(rtol: float) -> int:
    """Order of Gauss at which a tolerance is cheapest."""
    return 8 if rtol >= 1e-4 else 12 if rtol >= 1e-7 else 16


def _joined(first: Solution, second: Solution) -> Solution:
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
    )
    return Solution(
        np.concatenate([first.t, second.t[1:]]), np.hstack([first.x, second.x[:, 1:]]), dense, statistics, second.status
    )
