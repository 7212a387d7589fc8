"""What an `SX` function computes, as statements in static single assignment, each once: what C source and programs are made from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from acausal.errors import ExportError
from acausal.numerics.staged import Function, LinearSystem, systems_of
from acausal.numerics.uncollected import uncollected

UNARY = tuple(
    getattr(ca, f"OP_{name}")
    for name in (
        "NEG", "SQ", "TWICE", "INV", "SQRT", "FABS", "NOT", "SIGN", "EXP", "LOG", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "SINH",
        "COSH", "TANH", "ASINH", "ACOSH", "ATANH", "FLOOR", "CEIL", "ERF", "ERFINV", "LOG1P", "EXPM1",
    )
)  # fmt: skip
BINARY = tuple(
    getattr(ca, f"OP_{name}")
    for name in (
        "ADD", "SUB", "MUL", "DIV", "LT", "LE", "EQ", "NE", "AND", "OR", "IF_ELSE_ZERO", "POW", "FMIN", "FMAX", "FMOD", "REMAINDER",
        "COPYSIGN", "ATAN2", "HYPOT",
    )
)  # fmt: skip
LEAVES = (ca.OP_INPUT, ca.OP_CONST)
_COPY = (ca.OP_ASSIGN, ca.OP_LIFT)
SYSTEM, ANSWER = -1, -2
"""No operations of CasADi: a system of linear equations, whose operands are `args` and whose number is `place`; and its answer at `place`, of args[0]."""


class Value(NamedTuple):
    """How a value is made from others (operation `code`, `args`), or a constant `number`, or the input at `place`."""

    code: int
    args: tuple[int, ...] = ()
    number: float = 0.0
    place: int = 0


_new: Callable[[type[Value], tuple[Any, ...]], Value] = tuple.__new__
"""A value of all it has, four times as quickly as by its names: there are tens of thousands."""


@dataclass(frozen=True)
class Statements:
    """A function as values, in an order in which each follows what it needs.

    Inputs are the stored entries of all arguments one after the other, outputs those of all results. `rare` and `often`: values that
    are needed and depend on seldom changing inputs only, or on others too; `kept`: those among the rare that the others or the results need.
    """

    values: tuple[Value, ...]
    results: tuple[tuple[int, int], ...]
    """(output, value)"""
    rare: tuple[int, ...]
    often: tuple[int, ...]
    kept: tuple[int, ...]
    inputs: int
    outputs: int
    systems: tuple[LinearSystem, ...] = ()

    def pairs(self, part: list[int]) -> dict[int, tuple[int, int]]:
        """argument -> (its sine, its cosine), of those that are both made in a part of the statements."""
        values = self.values
        sines = {values[i].args[0]: i for i in part if values[i].code == ca.OP_SIN}
        cosines = {values[i].args[0]: i for i in part if values[i].code == ca.OP_COS}
        return {a: (sines[a], cosines[a]) for a in sines if a in cosines}


@uncollected
def statements(function: Function, name: str, parameters: tuple[int, ...] = ()) -> Statements:
    """The statements of a function. `parameters`: numbers of the arguments that seldom change.

    Raises `ExportError` for operations that are not known here, and for functions that cannot be expanded to `SX`.
    """
    function, systems = systems_of(function)
    if not function.is_a("SXFunction"):
        try:
            function = function.expand()
        except RuntimeError as error:
            raise ExportError(
                f"'{name}' cannot be written as C: it does not expand to SX ({str(error).splitlines()[-1]})."
            ) from error
    first = [sum(function.nnz_in(k) for k in range(i)) for i in range(function.n_in() + 1)]
    seldom = {place for i in parameters for place in range(first[i], first[i + 1])}
    found = _Collected()
    results = _read(function, name, first, found)
    values = tuple(found.values)
    given, outputs = function.n_in() - len(systems), sum(function.nnz_out(i) for i in range(function.n_out() - len(systems)))
    if systems:
        values, results = _with_systems(values, results, systems, first[given], outputs)
    needed, fixed = _needed(values, results), _fixed(values, seldom)
    wanted = {a for i, v in enumerate(values) if needed[i] and not fixed[i] for a in v.args} | {v for _, v in results}
    kept = tuple(sorted(i for i in wanted if fixed[i] and values[i].code not in LEAVES))
    rare, often = (tuple(i for i in range(len(values)) if needed[i] and fixed[i] is kind) for kind in (True, False))
    return Statements(values, tuple(results), rare, often, kept, first[given], outputs, systems)


def _with_systems(
    values: tuple[Value, ...], results: list[tuple[int, int]], systems: Sequence[LinearSystem], inputs: int, outputs: int
) -> tuple[tuple[Value, ...], list[tuple[int, int]]]:
    """Values and results of which the inputs from `inputs` on have become answers, and the results from `outputs` on operands: what needs a system stands behind it."""
    begins = inputs + np.cumsum([0, *(system.answers for system in systems)])
    stage: list[int] = []  # number of the first system that is needed, counted from behind: 0 for none
    for code, args, _, place in values:
        own = int(np.searchsorted(begins, place, side="right")) if code == ca.OP_INPUT and place >= inputs else 0
        for a in args:
            if stage[a] > own:
                own = stage[a]
        stage.append(own)
    staged: list[list[int]] = [[] for _ in range(len(systems) + 1)]
    for i, k in enumerate(stage):
        staged[k].append(i)
    found: list[Value] = []
    new = [0] * len(values)
    of_result = dict(results)
    at, system = outputs, -1
    for k, members in enumerate(staged):
        for i in members:
            code, args, number, place = values[i]
            new[i] = len(found)
            if code == ca.OP_INPUT and k:
                found.append(Value(ANSWER, (system,), 0.0, place - int(begins[k - 1])))
            else:
                found.append(_new(Value, (code, tuple([new[a] for a in args]), number, place)))
        if k < len(systems):
            system = len(found)
            found.append(Value(SYSTEM, tuple(new[of_result[at + j]] for j in range(systems[k].operands)), 0.0, k))
            at += systems[k].operands
    return tuple(found), [(place, new[v]) for place, v in results if place < outputs]


class _Collected:
    """Values made so far, equal ones once."""

    def __init__(self) -> None:
        self.values: list[Value] = []
        self._known: dict[tuple[int, ...] | str, int] = {}

    def add(self, code: int, *args: int) -> int:
        return self._once((code, *args), code, args)

    def number(self, number: float) -> int:
        return self._once(number.hex(), ca.OP_CONST, (), number)  # 0 and -0 are equal, but not the same

    def input(self, place: int) -> int:
        return self._once((ca.OP_INPUT, place), ca.OP_INPUT, (), 0.0, place)

    def _once(self, key: tuple[int, ...] | str, code: int, args: tuple[int, ...], number: float = 0.0, place: int = 0) -> int:
        at = self._known.setdefault(key, len(self.values))
        if at == len(self.values):
            self.values.append(_new(Value, (code, args, number, place)))
        return at

    def power(self, base: int, exponent: int) -> int:
        """x^n; for small integers and halves by products and roots. NaN for halves of x = -inf."""
        n = self.values[exponent].number
        if self.values[exponent].code != ca.OP_CONST or not 0 < abs(n) <= 8 or (2 * n) % 1:
            return self.add(ca.OP_POW, base, exponent)
        if abs(n) % 1:
            base = self.add(ca.OP_ADD, base, self.number(0.0))  # powers of -0 are those of 0
        factors = [self.add(ca.OP_SQRT, base)] if abs(n) % 1 else []
        factors += [base] * int(abs(n))
        product = factors[0]
        for factor in factors[1:]:
            product = self.add(ca.OP_SQ, product) if factor == product else self.add(ca.OP_MUL, product, factor)
        return product if n > 0 else self.add(ca.OP_INV, product)


def _read(function: ca.Function, name: str, first: list[int], found: _Collected) -> list[tuple[int, int]]:
    """Collects all values in order; returns (output, value)."""
    places_out = [sum(function.nnz_out(k) for k in range(i)) for i in range(function.n_out())]
    results: list[tuple[int, int]] = []
    now: dict[int, int] = {}  # work vector position -> value
    known, add = {*UNARY, *BINARY}, found.add
    code_of, input_of, output_of = function.instruction_id, function.instruction_input, function.instruction_output
    for k in range(function.n_instructions()):
        code, of, to = code_of(k), input_of(k), output_of(k)
        if code in known:
            now[to[0]] = add(code, *[now[i] for i in of])
        elif code == ca.OP_OUTPUT:
            results.append((places_out[to[0]] + to[1], now[of[0]]))
        elif code == ca.OP_INPUT:
            now[to[0]] = found.input(first[of[0]] + of[1])
        elif code == ca.OP_CONST:
            now[to[0]] = found.number(function.instruction_constant(k))
        elif code in _COPY:
            now[to[0]] = now[of[0]]
        elif code == ca.OP_CONSTPOW:
            now[to[0]] = found.power(now[of[0]], now[of[1]])
        else:
            raise ExportError(f"'{name}' cannot be written as C: {_name(code)} has no C here.")
    return results


def _name(code: int) -> str:
    found = [n for n in dir(ca) if n.startswith("OP_") and getattr(ca, n) == code]
    return f"the operation {found[0][3:].lower()}" if found else f"operation number {code}"


def _needed(values: tuple[Value, ...], results: list[tuple[int, int]]) -> list[bool]:
    needed = [False] * len(values)
    for _, v in results:
        needed[v] = True
    for i in range(len(values) - 1, -1, -1):
        if needed[i]:
            for a in values[i].args:
                needed[a] = True
    return needed


def _fixed(values: tuple[Value, ...], seldom: set[int]) -> list[bool]:
    """Which values depend on seldom changing inputs and constants only."""
    fixed: list[bool] = []
    for code, args, _, place in values:
        known = place in seldom if code == ca.OP_INPUT else True
        for a in args:
            known = known and fixed[a]
        fixed.append(known)
    return fixed
