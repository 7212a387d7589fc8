"""A function at many places at once, as a CasADi function: by the runtime's lanes, where the function is long and there are many places."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.runtime.series import Series

_LONG = 100_000
"""Instructions times places, from which lanes gain more than a call from Python costs."""
_GLANCES = 2
"""How often a function is asked for before its program is made."""


class Lane:
    """A function of columns (z, c, ...) -> one column by the runtime's lanes, at any number of places. Its program is made once, when it has been asked for twice: it costs as
    much as some thousand points.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function, self._asked = function, 0
        self.sizes = [function.size1_in(i) for i in range(function.n_in())]
        self.rows = function.size1_out(0)

    def ready(self) -> bool:
        """Whether it pays to use it now."""
        self._asked += 1
        return self._asked > _GLANCES

    def __call__(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        """As `Series`: the first argument is its states, the others are its inputs."""
        return self._series(t, x, u, p)

    @functools.cached_property
    def _series(self) -> Series:
        f = self._function
        t, none = ca.SX.sym("t"), ca.SX.sym("none", 0)  # pyright: ignore[reportArgumentType]
        parts = [ca.SX.sym(f"a{i}", n) for i, n in enumerate(self.sizes)]
        x, u = parts[0], ca.vertcat(ca.SX(0, 1), *parts[1:])
        return Series(ca.Function(f.name(), [t, x, u, none], [ca.densify(f(*parts))]))


def mapped(function: ca.Function, count: int, lane: Lane | None = None) -> ca.Function:
    """`function` of columns (z, c, ...) -> one column, at `count` places: arguments (count, n) and values (count, m), a row for each place. `lane`: its own, if it has
    one.
    """
    plain = plainly(function, count)
    if function.n_instructions() * count < _LONG:
        return plain
    return Lanes(function.name(), lane or Lane(function), plain, count)


def plainly(function: ca.Function, count: int) -> ca.Function:
    """By CasADi's virtual machine."""
    given = [ca.MX.sym(f"a{i}", count, function.size1_in(i)) for i in range(function.n_in())]
    values = function.map(count)(*(one.T for one in given))
    return ca.Function(f"{function.name()}_mapped", given, [ca.densify(values).T])


class Lanes(ca.Callback):
    """The virtual machine's `plain` at first, then a `lane`."""

    def __init__(self, name: str, lane: Lane, plain: ca.Function, count: int) -> None:
        super().__init__()
        self._count, self._plain, self._lane = count, plain, lane
        self._t, self._p = np.zeros(count), np.zeros(0)
        self._buffer: Any
        self._buffer, self._trigger = plain.buffer()
        self.construct(f"{name}_lanes", {})

    def get_n_in(self) -> int:
        """As CasADi asks."""
        return len(self._lane.sizes)

    def get_n_out(self) -> int:
        """As CasADi asks."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """As CasADi asks."""
        return ca.Sparsity.dense(self._count, self._lane.sizes[i])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """As CasADi asks."""
        return ca.Sparsity.dense(self._count, self._lane.rows)

    def has_eval_buffer(self) -> bool:
        """As CasADi asks."""
        return True

    def eval_buffer(self, arg: Sequence[Any], res: Sequence[Any]) -> int:
        """Values at all places. Whatever is raised here is taken for a failure by who asks."""
        if not self._lane.ready():
            for i, one in enumerate(arg):
                self._buffer.set_arg(i, one)
            self._buffer.set_res(0, res[0])
            self._trigger()
            return 0
        x, *rest = (np.frombuffer(one, dtype=float).reshape(-1, self._count) for one in arg)
        found = self._lane(self._t, x, np.vstack([np.zeros((0, self._count)), *rest]), self._p)
        np.frombuffer(res[0], dtype=float)[:] = found.ravel()
        return 0
