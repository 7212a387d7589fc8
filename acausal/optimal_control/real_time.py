"""One step of sequential quadratic programming from the plan before, as one CasADi function.

Diehl, Bock and Schloeder: A real-time iteration scheme for nonlinear optimization in optimal feedback control (2005), with the Hessian of the cost alone.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.numerics.bound import bound
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.separable import Program

QP_SOLVERS = ("piqp", "osqp", "qpoases", "proxqp", "daqp")
_NEARLY_CONVEX, _PROXIMAL, _MET = 1e-9, 1e-7, 1e-4
"""Of the largest curvature: what is still none, and what is added; how well a step must meet the linear constraints."""
_QUIET: dict[str, dict[str, Any]] = {"qpoases": {"printLevel": "none", "sparse": True}, "osqp": {"osqp": {"verbose": False}}}


class RealTime:
    """Unknowns of the plan before (n,) and states (nx,) -> unknowns of the plan after one step; None where that does not meet the constraints to
    first order. Raises `OptionError` for a cost that is not convex, and a free duration: plans of other lengths cannot be shifted by one matrix.
    """

    def __init__(self, best: Optimum, program: Program, rate: float, solver: str, options: dict[str, Any]) -> None:
        if solver not in QP_SOLVERS:
            raise OptionError(f"controller: there is no solver {solver!r}. Use 'ipopt', {', '.join(map(repr, QP_SOLVERS))}.")
        least, most = best.transcribed.asked.duration
        if least < most:
            raise OptionError("controller: one step at a time goes with a fixed time only. Leave `solver` out.")
        nx = best.transcribed.asked.stage.sizes[0]
        self._nx = nx
        self._function = self._made(best, program, _shift(best, rate), solver, options)
        self._in = np.zeros(program.size), np.zeros(nx)
        self._out = np.zeros(program.size), np.zeros(1)
        self._trigger, self._alive = bound(self._function, self._in, self._out)

    def __call__(self, w: np.ndarray, state: np.ndarray) -> np.ndarray | None:
        self._in[0][:], self._in[1][:] = w, state
        self._out[0][:], self._out[1][:] = np.nan, np.nan  # where a solver gives up nothing is written
        self._trigger()
        found, off = self._out[0].copy(), float(self._out[1][0])
        return found if off < _MET and np.isfinite(found).all() else None

    def _made(self, best: Optimum, program: Program, shift: ca.DM, solver: str, options: dict[str, Any]) -> ca.Function:
        n, nx = program.size, self._nx
        of_cost = program.of_cost()
        triangle = of_cost.derivatives["hess_lag"](best.unknowns, [], 1.0, np.zeros(of_cost.rows))
        open_ones = (program.bounds[0] < program.bounds[1]).astype(float)
        curvature = np.linalg.eigvalsh(open_ones[:, None] * np.array(ca.triu2symm(triangle)) * open_ones)
        if curvature[0] < -_NEARLY_CONVEX * curvature[-1]:
            raise OptionError(
                "controller: the cost is not convex at the plan, and one step at a time needs that. Leave `solver` out."
            )
        w, x = ca.MX.sym("w", n), ca.MX.sym("x", nx)
        start = ca.vertcat(x / ca.DM(best.transcribed.units[:nx]), (ca.MX(shift) @ w)[nx:])
        lower, upper = (ca.MX(ca.DM(bound)) for bound in program.bounds)
        begin = ca.vertcat(start[:nx], ca.fmin(ca.fmax(start[nx:], lower[nx:]), upper[nx:]))
        none = ca.DM(0, 1)
        rows, J = program.derivatives["jac_g"](begin, none)
        slope = program.derivatives["grad_f"](begin, none)[1]
        H = ca.triu2symm(of_cost.derivatives["hess_lag"](begin, none, 1.0, ca.DM.zeros(of_cost.rows)))
        some = ca.MX(ca.sparsify(ca.diag(ca.DM(open_ones))))  # what is fixed may make any product with the rest
        H = some @ H @ some
        H += float(_PROXIMAL * curvature[-1]) * ca.MX(ca.DM.eye(n))
        fixed = ca.MX.zeros(nx)
        least, most = ca.vertcat(fixed, (lower - begin)[nx:]), ca.vertcat(fixed, (upper - begin)[nx:])
        under, over = (ca.MX(ca.DM(limit)) - rows for limit in program.limits)
        quadratic = ca.conic(
            "step", solver, {"h": H.sparsity(), "a": J.sparsity()}, {**_QUIET.get(solver, {}), **options, "error_on_fail": False}
        )
        found = quadratic(h=H, g=slope, a=J, lbx=least, ubx=most, lba=under, uba=over)["x"]
        moved = J @ found
        off = ca.mmax(ca.fmax(0.0, ca.vertcat(under - moved, moved - over, least - found, found - most)))
        return ca.Function("real_time", [w, x], [begin + found, off])


def _shift(best: Optimum, rate: float) -> ca.DM:
    """(n, n): unknowns of the plan, later by the rate, and with its end held."""
    transcribed, motion = best.transcribed, best.motion
    n, later = best.unknowns.size, np.clip(motion.times + rate / motion.duration, 0.0, 1.0)
    found = np.zeros((n, n))
    zero = transcribed.motion(np.zeros(n))
    for k in range(n):
        one = transcribed.motion(np.eye(1, n, k).ravel())
        there = type(one)(motion.times, one.at(later), one.duration, one.free)
        found[:, k] = transcribed.unknowns(there)
    assert not zero.values.any()
    return ca.sparsify(ca.DM(found))
