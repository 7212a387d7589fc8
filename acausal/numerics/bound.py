"""CasADi functions on arrays that stay where they are: no conversion and no copy per call."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, cast

import casadi as ca
import numpy as np


def bound(function: ca.Function, given: Sequence[np.ndarray], told: Sequence[np.ndarray]) -> tuple[Callable[[], None], object]:
    """A call that reads its arguments from `given` and writes stored entries of its results to `told`, and what has to live as long as it is called."""
    buffer, run = cast(Any, function.buffer())  # CasADi's stub leaves the size argument out
    for k, array in enumerate(given):
        buffer.set_arg(k, array.data)
    for k, array in enumerate(told):
        buffer.set_res(k, array.data)
    return run, (function, buffer, *given, *told)


class BoundFunction:
    """A CasADi function of one result, bound to its argument arrays and to `result`; calling it fills `result`.

    The arrays are column-major as CasADi sees them, so a numpy array (m, n) is a CasADi matrix (n, m). Not for two threads.
    """

    def __init__(self, function: ca.Function, arguments: Sequence[np.ndarray], result: np.ndarray) -> None:
        self.result = result
        self.arguments = tuple(arguments)
        self.run, self._alive = bound(dense(function), arguments, [result])

    @staticmethod
    def of(function: ca.Function) -> BoundFunction:
        """A function of one column bound, with arrays of its own; see `at`."""
        return BoundFunction(function, (np.empty(function.size1_in(0)),), np.empty(function.numel_out(0)))

    def at(self, argument: np.ndarray) -> np.ndarray:
        """The result for a value of the first argument; the array is used again by the next call."""
        self.arguments[0][:] = argument
        return self()

    def __call__(self) -> np.ndarray:
        self.run()
        return self.result


class Columns:
    """A function of columns, its first result (numel,) column by column, by buffers that each thread has of its own: many times quicker than a call, which converts
    what it takes and gives.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function, self._own = dense(function), threading.local()

    def __reduce__(self) -> tuple[Any, ...]:
        return Columns, (self._function,)

    def __call__(self, *arguments: np.ndarray | float) -> np.ndarray:
        """(numel,); `arguments`: columns, or numbers where there is one entry."""
        bound = self._bound(1)
        for own, argument in zip(bound.arguments, arguments, strict=True):
            own[:] = argument
        return bound().copy()

    def at_once(self, *arguments: np.ndarray) -> np.ndarray:
        """(numel, k) at k points, in one call, whose price is that of many small functions; `arguments`: (n, k)."""
        k = arguments[0].shape[1]
        bound = self._bound(k)
        for own, argument in zip(bound.arguments, arguments, strict=True):
            own[:] = argument.ravel(order="F")
        return bound().reshape(k, -1).T.copy()

    def _bound(self, k: int) -> BoundFunction:
        """To k points."""
        known: dict[int, BoundFunction] = self._own.__dict__.setdefault("known", {})
        if k not in known:
            f = self._function if k == 1 else self._function.map(k)
            known[k] = BoundFunction(f, [np.empty(f.numel_in(i)) for i in range(f.n_in())], np.empty(f.numel_out(0)))
        return known[k]


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
