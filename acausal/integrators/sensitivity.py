"""Forward sensitivities: derivatives of a motion with respect to start values, inputs and parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.collocation.problem import Directions, Newton, Problem, Status, StatusKind, Tolerances
from acausal.collocation.tableau import gauss_legendre
from acausal.integrators.automatic import Automatic, stiffness_of
from acausal.integrators.gauss import default_order
from acausal.integrators.radau import Radau
from acausal.numerics.folding import folded_function
from acausal.runtime.compiled import Choice, CompiledProblem, Run


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
    problem: Problem, x0: np.ndarray, times: np.ndarray, directions: Directions, tolerances: Tolerances
) -> Sensitive:
    """States and derivatives at ascending times (m,), the first of which is the start.

    Compiled: the derivatives of the numerical motion, carried along step by step, directions in lanes; steps end at the times.
    Otherwise the variational equations are integrated together with the motion.
    """
    if problem.compiled is not None:
        return _compiled(problem, problem.compiled, x0, times, directions, tolerances)
    return _augmented(problem, x0, times, directions, tolerances)


def _compiled(
    problem: Problem, compiled: CompiledProblem, x0: np.ndarray, times: np.ndarray, directions: Directions, tolerances: Tolerances
) -> Sensitive:
    x = np.full((x0.size, times.size), np.nan)
    S = np.full((times.size, *directions.dx.shape), np.nan)
    x[:, 0], S[0] = x0, directions.dx
    tableau = gauss_legendre(default_order(tolerances.rtol, problem) // 2)
    slow, choice = stiffness_of(problem, tableau), Choice((tableau,), Newton.WHERE_SLOW)
    run = Run(compiled, problem, x0, float(times[0]), float(times[0]), tolerances, choice, directions)
    status, passages = Status(StatusKind.SUCCESS, float(times[0])), 0
    for k, end in enumerate(times[1:], start=1):
        outcome = run.advance(float(end), slow=slow)
        if outcome.left:
            passages += run.core.passages
            now = Directions(run.S.T.copy(), directions.du, directions.dp)
            choice = Radau().choice(tolerances.rtol)
            problem = replace(problem, met=np.ctypeslib.as_array(run.core.size, run.x.shape).copy())
            run = Run(compiled, problem, run.x, outcome.status.time, float(end), tolerances, choice, now)
            outcome = run.advance(float(end))
        status = outcome.status
        if status.kind is not StatusKind.SUCCESS:
            break
        x[:, k], S[k] = run.x, run.S.T
    return Sensitive(x, S, status, passages + run.core.passages)


def _augmented(problem: Problem, x0: np.ndarray, times: np.ndarray, directions: Directions, tolerances: Tolerances) -> Sensitive:
    f, nx, n = problem.rhs, x0.size, directions.dx.shape[1]
    t, x, u, p = (ca.SX.sym(name, f.size1_in(i)) for i, name in enumerate("txup"))
    S = ca.SX.sym("S", nx, n)
    y = ca.vertcat(x, ca.vec(S))
    rate = ca.densify(f(t, x, u, p))
    change = [
        ca.jtimes(rate, ca.vertcat(x, u, p), ca.vertcat(S[:, d], directions.du[:, d], directions.dp[:, d])) for d in range(n)
    ]
    rhs = folded_function("variational", [t, y, u, p], [ca.densify(ca.vertcat(rate, *change))])
    invariants = project = None
    if problem.invariants is not None and problem.project is not None:
        invariants = ca.Function("invariants", [t, y, p], [problem.invariants(t, x, p)])
        nearer = ca.densify(problem.project(t, x, p))
        moved = [ca.jtimes(nearer, ca.vertcat(x, p), ca.vertcat(S[:, d], directions.dp[:, d])) for d in range(n)]
        project = folded_function("projection", [t, y, p], [ca.densify(ca.vertcat(nearer, *moved))])
    whole = Problem(rhs, invariants, project, problem.inputs, problem.parameters, problem.constant_inputs)
    start = np.concatenate([x0, directions.dx.ravel(order="F")])
    solution = Automatic().integrate(whole, start, float(times[0]), float(times[-1]), tolerances)
    y_at = np.full((start.size, times.size), np.nan)
    reached = times <= solution.t[-1]
    y_at[:, reached] = solution.dense(times[reached])
    return Sensitive(y_at[:nx], y_at[nx:].T.reshape(times.size, n, nx).transpose(0, 2, 1), solution.status)
