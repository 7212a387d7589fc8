"""Switches inside a function: what jumps or bends, held at one side, and the values that say how long that side is the true one."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.instructions import operations
from acausal.numerics.staged import Function, Staged, Systems, composed, systems_of

COMPARED = (ca.OP_LT, ca.OP_LE, ca.OP_FMIN, ca.OP_FMAX)
WHOLE = (ca.OP_FLOOR, ca.OP_CEIL)
PERIODIC = (ca.OP_FMOD, ca.OP_REMAINDER)
JUMPS = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_SIGN, *WHOLE, *PERIODIC}
"""Operations whose results jump; others only bend."""
_SWITCHES = {*COMPARED, *WHOLE, *PERIODIC, ca.OP_SIGN, ca.OP_FABS}


@dataclass(frozen=True, eq=False)
class Switching:
    """A function x' = f(t, x, u, p) with its switches held: those that parameters alone do not decide.

    `rates`: (t, x, (u, sides), p) -> x', smooth in t, x and u. `rows`: (t, x, (u, sides), p) -> values that are positive where the sides are
    the true ones; `sides`: (t, x, u, p) -> the true ones. Where row k becomes negative, side `switch`[k] becomes `factor`[k] side + `plus`[k].
    `looked_at`: the expressions that switch. `others`: like `rates`, what else is smooth then.
    """

    rates: Function
    rows: Function
    sides: Function
    switch: np.ndarray
    factor: np.ndarray
    plus: np.ndarray
    looked_at: tuple[ca.SX, ...]
    others: tuple[Function, ...]

    @functools.cached_property
    def words(self) -> tuple[str, ...]:
        """The expressions that switch, in t_0, x_0, x_1, ..., u_0, ..., p_0, ..., for people: long ones take longer to write than to compute."""
        return tuple(_shortened(str(value)) for value in self.looked_at)


def switching(given: Function, *others: Function) -> Switching | None:
    """That of an SX function (t, x, u, p) -> x', and of others that hold the same switches; None without any switch."""
    function, shapes = systems_of(given)
    if not function.is_a("SXFunction"):
        return None
    parts = [function, *(systems_of(other)[0] for other in others)]
    ends = np.cumsum([part.size1_out(0) for part in parts]).tolist()
    if not any(map(has_switches, parts)):
        return None
    if others:
        function, shapes = systems_of(
            composed("all", [given, *others], lambda _, all: [ca.vertcat(*(one[0] for one in all))], fold=True)
        )
    found = _Holder()
    names = [*"txup", *(f"answer{k}_" for k in range(len(shapes)))]
    arguments = [ca.vertcat(*(ca.SX.sym(f"{name}_{k}") for k in range(function.size1_in(i)))) for i, name in enumerate(names)]
    (held, *operands), (_, *true_operands) = found.held(function, arguments)
    if not found.sides:
        return None
    (t, x, u, p), answers = arguments[:4], tuple(arguments[4:])
    inputs = ca.vertcat(u, *found.sides)
    systems, true = Systems(shapes, tuple(operands), answers), Systems(shapes, tuple(true_operands), answers)

    def made(name: str, result: ca.SX) -> Function:
        return Staged.of(name, [t, x, inputs, p], [ca.densify(result)], systems, fold=False)

    return Switching(
        made("rates", held[: ends[0], :]),
        made("rows", ca.vertcat(*found.rows)),
        Staged.of("sides", [t, x, u, p], [ca.densify(ca.vertcat(*(row.true for row in found.switches)))], true, fold=False),
        np.array(found.switch),
        np.array(found.factor, dtype=float),
        np.array(found.plus, dtype=float),
        tuple(switch.looked_at for switch in found.switches),
        tuple(made("others", held[a:b, :]) for a, b in itertools.pairwise(ends)),
    )


def has_switches(function: ca.Function) -> bool:
    """Whether an SX function switches anywhere."""
    return bool(operations(function) & _SWITCHES)


def switches(expression: ca.SX, operations: Collection[int]) -> list[ca.SX]:
    """Every operation of these kinds inside an expression."""
    stack, seen, found = [expression[i] for i in range(expression.numel())], set[int](), list[ca.SX]()
    while stack:
        node = stack.pop()
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        if node.n_dep():
            if node.op() in operations:
                found.append(node)
            stack += [node.dep(i) for i in range(node.n_dep())]
    return found


_LONGEST = 600
"""Of words; compilers and readers are content with less than a page."""


def _shortened(words: str) -> str:
    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]} ..."


@dataclass(frozen=True)
class _Switch:
    """Its true side, and what is looked at."""

    true: ca.SX
    looked_at: ca.SX


class _Holder:
    """Repeats a function's operations, with switches held."""

    def __init__(self) -> None:
        self.sides: list[ca.SX] = []
        self.switches: list[_Switch] = []
        self.rows: list[ca.SX] = []
        self.switch: list[int] = []
        self.factor: list[float] = []
        self.plus: list[float] = []
        self._known: list[tuple[ca.SX, ca.SX]] = []

    def held(self, f: ca.Function, arguments: Sequence[ca.SX]) -> tuple[list[ca.SX], list[ca.SX]]:
        """The results with switches held, and as they are."""
        size = f.sz_w() + 1
        work, true, moving = [ca.SX(0)] * size, [ca.SX(0)] * size, [False] * size
        results = [[[ca.SX(0)] * f.nnz_out(i) for i in range(f.n_out())] for _ in range(2)]
        for k in range(f.n_instructions()):
            code, to, of = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
            if code == ca.OP_OUTPUT:
                for found, values in zip(results, (work, true), strict=True):
                    found[to[0]][to[1]] = values[of[0]]
                continue
            if code == ca.OP_INPUT:
                work[to[0]] = true[to[0]] = arguments[of[0]][of[1]]
                moving[to[0]] = of[0] != 3  # parameters
            elif code == ca.OP_CONST:
                work[to[0]] = true[to[0]] = ca.SX(f.instruction_constant(k))
                moving[to[0]] = False
            else:
                a, b = [work[i] for i in of], [true[i] for i in of]
                now = any(moving[i] for i in of)
                exact = ca.SX.unary(code, b[0]) if len(of) == 1 else ca.SX.binary(code, b[0], b[1])
                if now and code in _SWITCHES:
                    work[to[0]] = self._side(code, a, b)
                else:
                    work[to[0]] = ca.SX.unary(code, a[0]) if len(of) == 1 else ca.SX.binary(code, a[0], a[1])
                true[to[0]], moving[to[0]] = exact, now

        def filled(values: list[list[ca.SX]]) -> list[ca.SX]:
            found = [ca.SX.zeros(f.sparsity_out(i)) for i in range(f.n_out())]
            for result, entries in zip(found, values, strict=True):
                for k, entry in enumerate(entries):
                    result.nz[k] = entry
            return found

        return filled(results[0]), filled(results[1])

    def _side(self, code: int, a: list[ca.SX], true: list[ca.SX]) -> ca.SX:
        """The result of a switching operation on `a`, held."""
        if code == ca.OP_LE:  # where both are equal, as inputs may be that jump
            return 1 - self._below(a[1] - a[0], true[1] - true[0])
        if code in COMPARED or code == ca.OP_FABS:
            below = self._below(a[0] - a[1] if len(a) == 2 else a[0], true[0] - true[1] if len(a) == 2 else true[0])
            if code == ca.OP_LT:
                return below
            if code == ca.OP_FABS:
                return (1 - 2 * below) * a[0]
            return ca.if_else(below, a[0], a[1]) if code == ca.OP_FMIN else ca.if_else(below, a[1], a[0])
        if code == ca.OP_SIGN:
            side = self._new(a[0], ca.sign(true[0]))
            self._row(ca.if_else(side > 0, a[0], ca.if_else(side < 0, 1, a[0])), 0, -1)
            self._row(ca.if_else(side < 0, -a[0], ca.if_else(side > 0, 1, -a[0])), 0, 1)
            return side
        if code == ca.OP_CEIL:
            return -self._whole(-a[0], ca.floor(-true[0]), 0, 1)
        if code == ca.OP_FLOOR:
            return self._whole(a[0], ca.floor(true[0]), 0, 1)
        ratio, exact = a[0] / a[1], true[0] / true[1]
        if code == ca.OP_REMAINDER:
            return a[0] - a[1] * self._whole(ratio, exact - ca.remainder(exact, 1), -0.5, 0.5)
        return a[0] - a[1] * self._whole(ratio, ca.if_else(exact < 0, ca.ceil(exact), ca.floor(exact)), None, None)

    def _below(self, value: ca.SX, true: ca.SX) -> ca.SX:
        """Whether a value is negative, 0 or 1."""
        for known, side in self._known:
            if ca.is_equal(known, value, 3):
                return side
            if ca.is_equal(known, -value, 3):
                return 1 - side
        side = self._new(value, true < 0)
        self._row((1 - 2 * side) * value, -1, 1)
        self._known.append((value, side))
        return side

    def _whole(self, value: ca.SX, true: ca.SX, low: float | None, high: float | None) -> ca.SX:
        """The number n with n + low <= value < n + high; without these, towards zero."""
        side = self._new(value, true)
        below = side + low if low is not None else ca.if_else(side > 0, side, side - 1)
        above = side + high if high is not None else ca.if_else(side < 0, side, side + 1)
        self._row(value - below, 1, -1)
        self._row(above - value, 1, 1)
        return side

    def _new(self, value: ca.SX, true: ca.SX) -> ca.SX:
        side = ca.SX.sym(f"side{len(self.sides)}")
        self.sides.append(side)
        self.switches.append(_Switch(true, value))
        return side

    def _row(self, row: ca.SX, factor: float, plus: float) -> None:
        self.rows.append(row)
        self.switch.append(len(self.sides) - 1)
        self.factor.append(factor)
        self.plus.append(plus)
