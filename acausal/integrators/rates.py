"""CasADi functions on arrays that stay where they are: no conversion and no copy per call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import casadi as ca
import numpy as np

from acausal.collocation.problem import Problem


class Kernel:
    """A CasADi function of one result, bound to its argument arrays and to `result`; calling it fills `result`.

    The arrays are column-major as CasADi sees them, so a numpy array (m, n) is a CasADi matrix (n, m). Not for two threads.
    """

    def __init__(self, function: ca.Function, arguments: Sequence[np.ndarray], result: np.ndarray) -> None:
        function = dense(function)
        buffer, run = cast(Any, function.buffer())  # CasADi's stub leaves the size argument out
        for i, array in enumerate(arguments):
            buffer.set_arg(i, array.data)
        buffer.set_res(0, result.data)
        self.result = result
        self.run = run
        self.arguments = tuple(arguments)
        self._alive = (function, buffer)  # their addresses are in use

    @staticmethod
    def of(function: ca.Function) -> Kernel:
        """A kernel of a function of one column, with arrays of its own; see `at`."""
        return Kernel(function, (np.empty(function.size1_in(0)),), np.empty(function.numel_out(0)))

    def at(self, argument: np.ndarray) -> np.ndarray:
        """The result for a value of the first argument; the array is used again by the next call."""
        self.arguments[0][:] = argument
        return self()

    def __call__(self) -> np.ndarray:
        self.run()
        return self.result


def dense(function: ca.Function) -> ca.Function:
    """The same function without structural zeros in its first result: `buffer` moves stored entries only."""
    if function.nnz_out(0) == function.numel_out(0):
        return function
    symbols = arguments(function)
    return ca.Function(function.name(), symbols, [ca.densify(function.call(symbols)[0])])


def arguments(function: ca.Function) -> list[Any]:
    """Fresh symbols for all arguments: SX for an SX function, MX for any other."""
    kind = ca.SX if function.is_a("SXFunction") else ca.MX
    return [kind.sym(f"a{i}", *function.size_in(i)) for i in range(function.n_in())]


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
        self.evaluate = Kernel(f.map(count) if count > 1 else f, (self.t, self.X, self.u, self.p), self.K)
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
        self._kernel = Kernel(transposed, values, np.empty((nx, nx)))

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """At one point; the returned array is used again by the next call."""
        self._t[0] = t
        self._x[:] = x
        if self._u.size:
            self._u[:] = self._problem.inputs(self._t)[:, 0]
        return self._kernel()


def difference_jacobian(problem: Problem, t: float, x: np.ndarray) -> np.ndarray:
    """df/dx (nx, nx) at one point by one-sided differences, good for eigenvalues to about seven digits.

    n + 1 evaluations; the exact one has many times more operations than f where f is large.
    """
    n = x.size
    step = 1e-7 * (1 + np.abs(x))
    X = np.tile(x[:, None], n + 1)
    X[np.arange(n), np.arange(n)] += step
    times = np.full(n + 1, t)
    p = np.repeat(np.asarray(problem.parameters)[:, None], n + 1, axis=1)
    F = np.array(problem.rhs(times[None, :], X, problem.inputs(times), p)).reshape(n, n + 1)
    return (F[:, :n] - F[:, n:]) / step


def copied_states(rhs: ca.Function) -> list[tuple[int, int]]:
    """Pairs (i, j) of states with x_i' = x_j as it stands, such as positions and velocities. Empty for a function that is not SX."""
    if not rhs.is_a("SXFunction"):
        return []
    symbols = arguments(rhs)
    x, rate = symbols[1], ca.densify(rhs.call(symbols)[0])
    place = {e.element_hash(): j for j, e in enumerate(ca.vertsplit(x))} if x.numel() else {}
    rows = [(i, e) for i, e in enumerate(ca.vertsplit(rate)) if e.is_symbolic()] if x.numel() else []
    pairs = [(i, place[e.element_hash()]) for i, e in rows if e.element_hash() in place]
    sources = {j for _, j in pairs}
    return [(i, j) for i, j in pairs if i not in sources]
