"""What an `SX` function computes, as statements in static single assignment, each once: what C source and programs are made from."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import casadi as ca
import numpy as np

from acausal.errors import ExportError
from acausal.numerics.instructions import BINARY, UNARY, instructions
from acausal.numerics.staged import Function, LinearSystem, systems_of
from acausal.numerics.uncollected import uncollected

_UNARY, _BINARY = frozenset(UNARY), frozenset(BINARY)
LEAVES = (ca.OP_INPUT, ca.OP_CONST)
_COPY = (ca.OP_ASSIGN, ca.OP_LIFT)
SYSTEM, ANSWER = -1, -2
"""No operations of CasADi: a system of linear equations, whose operands are its arguments and whose number is its place; and its answer at a place, of its argument."""


@dataclass(frozen=True)
class Values:
    """How each value is made from others: operation and arguments; a constant's number; the place of an input. Columns, since there are tens of thousands."""

    codes: list[int]
    args: list[tuple[int, ...]]
    numbers: dict[int, float]
    places: dict[int, int]


@dataclass(frozen=True)
class Statements:
    """A function as values, in an order in which each follows what it needs.

    Inputs are the stored entries of all arguments one after the other, outputs those of all results. `rare` and `often`: values that
    are needed and depend on seldom changing inputs only, or on others too; `kept`: those among the rare that the others or the results need.
    """

    values: Values
    results: list[tuple[int, int]]
    """(output, value)"""
    rare: list[int]
    often: list[int]
    kept: list[int]
    inputs: int
    outputs: int
    systems: tuple[LinearSystem, ...] = ()

    def pairs(self, part: list[int]) -> dict[int, tuple[int, int]]:
        """argument -> (its sine, its cosine), of those that are both made in a part of the statements."""
        codes, args = self.values.codes, self.values.args
        sines = {args[i][0]: i for i in part if codes[i] == ca.OP_SIN}
        cosines = {args[i][0]: i for i in part if codes[i] == ca.OP_COS}
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
    first = list(accumulate((function.nnz_in(k) for k in range(function.n_in())), initial=0))
    seldom = {place for i in parameters for place in range(first[i], first[i + 1])}
    values, results = _read(function, name, first)
    given, outputs = function.n_in() - len(systems), sum(function.nnz_out(i) for i in range(function.n_out() - len(systems)))
    if systems:
        values, results = _with_systems(values, results, systems, first[given], outputs)
    needed, fixed = _needed(values, results), _fixed(values, seldom)
    rare, often = (np.flatnonzero(part).tolist() for part in (needed & fixed, needed & ~fixed))
    wanted = {v for _, v in results}.union(*[values.args[i] for i in often])
    kept = sorted(i for i in wanted.intersection(rare) if values.codes[i] not in LEAVES)
    return Statements(values, results, rare, often, kept, first[given], outputs, systems)


def _with_systems(
    values: Values, results: list[tuple[int, int]], systems: Sequence[LinearSystem], inputs: int, outputs: int
) -> tuple[Values, list[tuple[int, int]]]:
    """Values and results of which the inputs from `inputs` on have become answers, and the results from `outputs` on operands: what needs a system stands behind it."""
    begins = list(accumulate((system.answers for system in systems), initial=inputs))
    stage = [0] * len(values.codes)  # number of the first system that is needed, counted from behind: 0 for none
    for i, place in values.places.items():
        if place >= inputs:
            stage[i] = bisect_right(begins, place)
    for i, args in enumerate(values.args):
        for a in args:
            if stage[a] > stage[i]:
                stage[i] = stage[a]
    staged: list[list[int]] = [[] for _ in range(len(systems) + 1)]
    for i, k in enumerate(stage):
        staged[k].append(i)
    codes, args = list[int](), list[tuple[int, ...]]()
    numbers, places = dict[int, float](), dict[int, int]()
    new = [0] * len(values.codes)
    of_result = dict(results)
    at, system = outputs, -1
    for k, members in enumerate(staged):
        for i in members:
            code, new[i] = values.codes[i], len(codes)
            if code == ca.OP_INPUT:
                places[len(codes)] = values.places[i] - (begins[k - 1] if k else 0)
            elif code == ca.OP_CONST:
                numbers[len(codes)] = values.numbers[i]
            answer = code == ca.OP_INPUT and k
            codes.append(ANSWER if answer else code)
            args.append((system,) if answer else tuple([new[a] for a in values.args[i]]))
        if k < len(systems):
            system = len(codes)
            places[system] = k
            codes.append(SYSTEM)
            args.append(tuple([new[of_result[at + j]] for j in range(systems[k].operands)]))
            at += systems[k].operands
    return Values(codes, args, numbers, places), [(place, new[v]) for place, v in results if place < outputs]


def _read(function: ca.Function, name: str, first: list[int]) -> tuple[Values, list[tuple[int, int]]]:
    """All values in order, equal ones once, and (output, value)."""
    places_out = list(accumulate((function.nnz_out(k) for k in range(function.n_out())), initial=0))
    results: list[tuple[int, int]] = []
    codes, args = list[int](), list[tuple[int, ...]]()
    numbers, places = dict[int, float](), dict[int, int]()
    known: dict[int, dict[tuple[int, ...] | str, int]] = defaultdict(dict)
    now = [0] * function.sz_w()

    def once(code: int, of: tuple[int, ...] | str) -> int:
        """The value that is made so; of leaves `of` tells them apart."""
        at = known[code].setdefault(of, len(codes))
        if at == len(codes):
            codes.append(code)
            args.append(() if code in LEAVES or isinstance(of, str) else of)
        return at

    def constant(number: float) -> int:
        at = once(ca.OP_CONST, number.hex())  # 0 and -0 are equal, but not the same
        numbers[at] = number
        return at

    def power(base: int, exponent: int) -> int:
        """x^n; for small integers and halves by products and roots. NaN for halves of x = -inf."""
        n = numbers.get(exponent, 0.0)
        if not 0 < abs(n) <= 8 or (2 * n) % 1:
            return once(ca.OP_POW, (base, exponent))
        if abs(n) % 1:
            base = once(ca.OP_ADD, (base, constant(0.0)))  # powers of -0 are those of 0
        factors = [once(ca.OP_SQRT, (base,))] if abs(n) % 1 else []
        factors += [base] * int(abs(n))
        product = factors[0]
        for factor in factors[1:]:
            product = once(ca.OP_SQ, (product,)) if factor == product else once(ca.OP_MUL, (product, factor))
        return product if n > 0 else once(ca.OP_INV, (product,))

    table, constants = instructions(function)
    for k, (code, to, one, other) in enumerate(table):
        if code in _BINARY:
            of = now[one], now[other]
        elif code in _UNARY:
            of = (now[one],)
        else:
            if code == ca.OP_OUTPUT:
                results.append((places_out[to] + other, now[one]))
            elif code == ca.OP_INPUT:
                now[to] = once(code, (first[one] + other,))
                places[now[to]] = first[one] + other
            elif code == ca.OP_CONST:
                now[to] = constant(constants[k])
            elif code in _COPY:
                now[to] = now[one]
            elif code == ca.OP_CONSTPOW:
                now[to] = power(now[one], now[other])
            else:
                raise ExportError(f"'{name}' cannot be written as C: {_name(code)} has no C here.")
            continue
        at = known[code].setdefault(of, len(codes))  # as `once`, without a call
        if at == len(codes):
            codes.append(code)
            args.append(of)
        now[to] = at
    return Values(codes, args, numbers, places), results


def _name(code: int) -> str:
    found = [n for n in dir(ca) if n.startswith("OP_") and getattr(ca, n) == code]
    return f"the operation {found[0][3:].lower()}" if found else f"operation number {code}"


def _needed(values: Values, results: list[tuple[int, int]]) -> np.ndarray:
    needed, args = bytearray(len(values.codes)), values.args
    for _, v in results:
        needed[v] = 1
    for i in range(len(args) - 1, -1, -1):
        if needed[i]:
            for a in args[i]:
                needed[a] = 1
    return np.frombuffer(needed, bool)


def _fixed(values: Values, seldom: set[int]) -> np.ndarray:
    """Which values depend on seldom changing inputs and constants only."""
    fixed = bytearray(b"\1") * len(values.codes)
    for i, place in values.places.items():
        if values.codes[i] == ca.OP_INPUT and place not in seldom:
            fixed[i] = 0
    for i, args in enumerate(values.args):
        for a in args:
            if not fixed[a]:
                fixed[i] = 0
                break
    return np.frombuffer(fixed, bool)
