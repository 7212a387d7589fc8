"""The stage equations K = f(t + c h, x + h A K) of one collocation step: fixed-point iteration, or simplified Newton."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import casadi as ca
import numpy as np

from acausal.integrators.problem import Problem
from acausal.integrators.tableau import Tableau

_EPS = float(np.finfo(float).eps)


class Rates:
    """f at many points in one call, without copies: `values(times (n,), X (n, nx)) -> (n, nx)`. Not for use by two threads."""

    def __init__(self, problem: Problem, count: int) -> None:
        nx = problem.rhs.size1_in(1)
        self._inputs = problem.inputs if problem.rhs.size1_in(2) else None
        mapped = problem.rhs.map(count) if count > 1 else problem.rhs
        buffer, self._run = cast(Any, mapped.buffer())  # CasADi's stub leaves the size argument out
        self.t = np.empty(count)
        self.X = np.empty((count, nx))
        self.u = np.zeros((count, problem.rhs.size1_in(2)))
        self.p = np.ascontiguousarray(np.tile(problem.parameters, (count, 1)))
        self.K = np.empty((count, nx))
        for i, array in enumerate((self.t, self.X, self.u, self.p)):
            buffer.set_arg(i, array.data)
        buffer.set_res(0, self.K.data)
        self._buffer = buffer  # keeps the arrays' addresses alive
        self.evaluations = 0

    def at(self, times: np.ndarray) -> None:
        """Set the times, and the inputs there."""
        self.t[:] = times
        if self._inputs is not None:
            self.u[:] = self._inputs(times).T

    def evaluate(self) -> np.ndarray:
        """f at the present times and `X`; the returned array is used again by the next call."""
        self._run()
        self.evaluations += self.t.size
        return self.K


@dataclass
class StageSolver:
    """Solves the stage equations of one tableau. `iterations` counts over all steps."""

    problem: Problem
    tableau: Tableau
    newton: bool = False
    iterations: int = 0

    def __post_init__(self) -> None:
        self.rates = Rates(self.problem, self.tableau.stages)
        self._jacobian: ca.Function | None = None
        self._inverse: np.ndarray | None = None
        self._inverse_h = 0.0
        if self.newton:
            values, self._vectors = np.linalg.eig(self.tableau.A)
            self._eigenvalues = values
            self._vectors_inverse = np.linalg.inv(self._vectors)

    def solve(
        self, t: float, h: float, x: np.ndarray, K: np.ndarray, scale: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, float] | None:
        """Stage rates (s, nx) from a guess K; and the contraction rate seen. None when it does not converge.

        `scale` (nx,): sizes of the states for norms; converged when changes of h K are below `tolerance` in units of scale.
        """
        return self._newton(t, h, x, K, scale, tolerance) if self.newton else self._fixed_point(t, h, x, K, scale, tolerance)

    def _fixed_point(
        self, t: float, h: float, x: np.ndarray, K: np.ndarray, scale: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, float] | None:
        rates, hA = self.rates, h * self.tableau.A
        rates.at(t + h * self.tableau.c)
        previous, before, contraction = np.inf, np.inf, 0.0
        factor = h / scale
        floor = 4 * _EPS * float(np.max(np.maximum(np.abs(x), np.max(np.abs(h * K), axis=0)) / scale, initial=0.0))
        for k in range(60):
            np.matmul(hA, K, out=rates.X)
            rates.X += x
            new = rates.evaluate()
            change = float(np.max(np.abs((new - K) * factor), initial=0.0))
            K = new.copy()
            self.iterations += 1
            if not np.isfinite(change):
                return None
            if change <= tolerance or change <= floor:
                return K, contraction
            if k >= 1:
                # over two iterations where possible: on second-order systems every other one only moves the rates
                contraction = change / previous if k == 1 else (change / before) ** 0.5
                if contraction > 0.95 and k >= 4:
                    # rounding is reached when changes stop shrinking while already tiny
                    return (K, contraction) if change <= 1e4 * floor else None
                if k >= 6 and change * contraction ** (60 - k) > max(tolerance, floor):
                    return None
            previous, before = change, previous
        return None

    def _newton(
        self, t: float, h: float, x: np.ndarray, K: np.ndarray, scale: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, float] | None:
        rates, hA = self.rates, h * self.tableau.A
        rates.at(t + h * self.tableau.c)
        inverse = self._factor(t, h, x)
        if inverse is None:
            return None
        previous, contraction = np.inf, 0.0
        factor = h / scale
        floor = 8 * _EPS * float(np.max(np.abs(x) / scale, initial=0.0))
        for k in range(12):
            np.matmul(hA, K, out=rates.X)
            rates.X += x
            residual = rates.evaluate() - K
            transformed = self._vectors_inverse @ residual
            step = np.real(self._vectors @ np.einsum("sij,sj->si", inverse, transformed))
            change = float(np.max(np.abs(step * factor), initial=0.0))
            self.iterations += 1
            if not np.isfinite(change):
                return None
            K = K + step
            if change <= tolerance or change <= floor:
                return K, contraction
            if k >= 1:
                contraction = change / previous
                if contraction > 0.95:
                    return (K, contraction) if change <= 1e3 * floor else None
            previous = change
        return None

    def jacobian(self, t: float, x: np.ndarray) -> np.ndarray:
        """df/dx (nx, nx), exact."""
        if self._jacobian is None:
            f = self.problem.rhs
            arguments = [ca.SX.sym(f"a{i}", f.size1_in(i)) for i in range(4)]
            self._jacobian = ca.Function(
                "jacobian", arguments, [ca.densify(ca.jacobian(f.call(arguments)[0], arguments[1]))], {"cse": True}
            )
        u = self.problem.inputs(np.array([t]))[:, 0]
        return np.array(self._jacobian(t, x, u, self.problem.parameters))

    def _factor(self, t: float, h: float, x: np.ndarray) -> np.ndarray | None:
        """(s, nx, nx): inverses of 1 - h lambda J for the eigenvalues lambda of A."""
        J = self.jacobian(t, x)
        if not np.all(np.isfinite(J)):
            return None
        blocks = np.eye(x.size) - (h * self._eigenvalues)[:, None, None] * J
        try:
            return np.linalg.inv(blocks)
        except np.linalg.LinAlgError:
            return None
