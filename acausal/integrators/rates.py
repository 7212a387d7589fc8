"""Rates of all states, and their derivatives, on arrays that stay where they are."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.collocation.problem import Problem
from acausal.numerics.bound import BoundFunction, arguments, dense


class Rates:
    """f at `count` points in one call: set the times with `at` and the states `X` (count, nx), then `evaluate`."""

    def __init__(self, problem: Problem, count: int) -> None:
        f = dense(problem.rhs)
        nx, nu = f.size1_in(1), f.size1_in(2)
        self._inputs = problem.inputs if nu else None
        self.t = np.empty(count)
        self.X = np.empty((count, nx))
        self.u = np.zeros((count, nu))
        self.p = np.ascontiguousarray(np.tile(problem.parameters, (count, 1)))
        self.K = np.empty((count, nx))
        self.evaluate = BoundFunction(f.map(count) if count > 1 else f, (self.t, self.X, self.u, self.p), self.K)
        self.run = self.evaluate.run

    def at(self, times: np.ndarray | float) -> None:
        """Set the times, and the inputs there."""
        self.t[:] = times
        if self._inputs is not None:
            self.u[:] = self._inputs(self.t).T


class Jacobian:
    """df/dx (nx, nx), exact, by algorithmic differentiation."""

    def __init__(self, problem: Problem) -> None:
        f, nx = problem.rhs, problem.rhs.size1_in(1)
        symbols = arguments(f)
        J = ca.densify(ca.jacobian(f.call(symbols)[0], symbols[1]))
        self._problem = problem
        self._t, self._x, self._u = np.empty(1), np.empty(nx), np.zeros(f.size1_in(2))
        transposed = ca.Function("jacobian", symbols, [J.T], {"cse": True} if f.is_a("SXFunction") else {})
        values = (self._t, self._x, self._u, np.array(problem.parameters, dtype=float))
        self._bound = BoundFunction(transposed, values, np.empty((nx, nx)))

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """At one point; the returned array is used again by the next call."""
        self._t[0] = t
        self._x[:] = x
        if self._u.size:
            self._u[:] = self._problem.inputs(self._t)[:, 0]
        return self._bound()
