"""Programs of `SX` functions for the runtime's interpreter (acausal/runtime/interpreter.h): numbers where `emit` writes C."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from acausal.emit.statements import ANSWER, BINARY, LEAVES, UNARY, Statements, Value, statements
from acausal.emit.statements import SYSTEM as SYSTEM_VALUE
from acausal.numerics.staged import Function, LinearSystem
from acausal.numerics.uncollected import uncollected

END, LOAD, STORE, NUMBER, SINCOS = range(5)
CODES = {code: k for k, code in enumerate((*UNARY, *BINARY), 5)}
MUL_ADD, MUL_SUB, SUB_MUL, MUL_MUL, MOVE, SYSTEM = range(5 + len(CODES), 11 + len(CODES))
WIDTH = 5
_NOTHING = (0,) * WIDTH
_PRODUCTS = (ca.OP_MUL, ca.OP_SQ)
_TURNS = (ca.OP_SIN, ca.OP_COS)
_SUMS = {ca.OP_ADD: (MUL_ADD, MUL_ADD), ca.OP_MUL: (MUL_MUL, MUL_MUL), ca.OP_SUB: (MUL_SUB, SUB_MUL)}
"""operation -> what it is of a product and another value, of another value and a product"""

_Row = tuple[int, ...]
"""A statement: `WIDTH` integers."""


@dataclass(frozen=True)
class Program:
    """A function as statements (n, 5) of int32: operation, result, operands; places in bytes of a frame, for values of some lanes.

    `preparation` fills what depends on parameters only, numbers included. `frame`: values in it.
    """

    preparation: np.ndarray
    run: np.ndarray
    inputs: int
    outputs: int
    frame: int


class _Step(NamedTuple):
    """An operation on values: results are made in `to`, operands `of`; `place` of an input or output."""

    code: int
    to: tuple[int, ...] = ()
    of: tuple[int, ...] = ()
    place: int = 0


_step: Callable[[type[_Step], tuple[Any, ...]], _Step] = tuple.__new__
"""A step of all it has: there are tens of thousands."""


@uncollected
def program(function: Function, name: str, lanes: int, *, parameters: tuple[int, ...] = ()) -> Program:
    """The program of a function. `parameters`: numbers of the arguments that seldom change.

    Raises `ExportError` for functions that cannot be expanded to `SX`.
    """
    found = statements(function, name, parameters)
    numbers = _numbers(found)
    lasting = {v: k for k, v in enumerate((*found.kept, *numbers))}
    rooms = _Rooms.of(found, lasting)
    rare, end = _placed(_steps(found, found.rare, lasting, ()), lasting, rooms)
    often, end_often = _placed(_steps(found, found.often, lasting, found.results), lasting, rooms)
    literals = [_number(lasting[v], found.values[v]) for v in numbers]
    settled = [_row(MOVE, slot, lasting[v]) for v in numbers for slot in rooms.slots.get(v, ())]
    return Program(
        _scaled([*literals, *rare, *settled, _row(END)], lanes),
        _scaled([*often, _row(END)], lanes),
        found.inputs,
        found.outputs,
        max(end, end_often),
    )


@dataclass(frozen=True)
class _Rooms:
    """Places where systems stand, behind lasting values: of each system the first one, of each operand those it is put to, `end` behind all."""

    first: tuple[int, ...]
    slots: dict[int, list[int]]
    shapes: tuple[LinearSystem, ...]
    end: int

    @staticmethod
    def of(found: Statements, lasting: dict[int, int]) -> _Rooms:
        """Of the systems of a function."""
        first: list[int] = []
        slots: dict[int, list[int]] = {}
        at = len(lasting)
        for value in found.values:
            if value.code == SYSTEM_VALUE:
                for k, v in enumerate(value.args):
                    slots.setdefault(v, []).append(at + k)
                first.append(at)
                at += found.systems[value.place].room
        return _Rooms(tuple(first), slots, found.systems, at)

    def answer(self, system: int, place: int) -> int:
        """Where it is found."""
        return self.first[system] + self.shapes[system].operands + place


def _numbers(found: Statements) -> list[int]:
    """Constants that are operands or results."""
    used = {a for i in (*found.rare, *found.often) for a in found.values[i].args} | {v for _, v in found.results}
    return sorted(i for i in used if found.values[i].code == ca.OP_CONST)


def _steps(found: Statements, order: Sequence[int], lasting: dict[int, int], results: Sequence[tuple[int, int]]) -> list[_Step]:
    """The operations in order: inputs right before they are needed, products in the sums that alone need them, results as they are made."""
    values = found.values
    inside = [i for i in order if values[i].code not in LEAVES]
    pairs = found.pairs(inside)
    into = _absorbed(values, inside, {*lasting, *(v for _, v in results)})
    absorbed = {product for product, _ in into.values()}
    outputs: dict[int, list[int]] = {}
    for place, v in results:
        outputs.setdefault(v, []).append(place)
    steps: list[_Step] = []
    made = set(lasting)

    def stores(v: int) -> None:
        steps.extend(_Step(STORE, (), (v,), place) for place in outputs[v])

    def bring(v: int) -> None:
        made.add(v)
        steps.append(_Step(LOAD, (v,), (), values[v].place))
        if v in outputs:
            stores(v)

    for v in lasting:
        if v in outputs:
            stores(v)
    for v in outputs:
        if values[v].code == ca.OP_INPUT and v not in made:
            bring(v)
    for i in inside:
        if i in absorbed or (i in made and i not in lasting):
            continue
        value = values[i]
        if value.code == ANSWER:
            steps.append(_Step(ANSWER, (i,), (), value.place))
            made.add(i)
            for place in outputs.get(i, ()):
                steps.append(_Step(STORE, (), (i,), place))
            continue
        code, of, to = SYSTEM if value.code == SYSTEM_VALUE else CODES[value.code], value.args, (i,)
        if i in into:
            product, (code, rest) = into[i]
            of = (*_factors(values[product]), rest)
        elif value.code in _TURNS and value.args[0] in pairs:
            code, to = SINCOS, pairs[value.args[0]]
        for a in of:
            if a not in made:
                bring(a)
        steps.append(_step(_Step, (code, to, of, value.place)))
        for v in to:
            made.add(v)
            if v in outputs:
                stores(v)
    return steps


def _factors(product: Value) -> tuple[int, int]:
    return (product.args[0], product.args[-1])


def _absorbed(values: Sequence[Value], inside: Sequence[int], asked: set[int]) -> dict[int, tuple[int, tuple[int, int]]]:
    """value -> (product that nothing else needs, (operation on both, other operand))."""
    uses = [0] * len(values)
    for i in inside:
        for a in values[i].args:
            uses[a] += 1
    single = {i for i in inside if uses[i] == 1 and values[i].code in _PRODUCTS and i not in asked}
    found: dict[int, tuple[int, tuple[int, int]]] = {}
    taken: set[int] = set()
    for i in inside:
        if i in taken:
            continue
        code = values[i].code
        if code not in _SUMS:
            continue
        one, other = values[i].args
        if one in single and one not in found:
            found[i] = one, (_SUMS[code][0], other)
            taken.add(one)
        elif other in single and other not in found:
            found[i] = other, (_SUMS[code][1], one)
            taken.add(other)
    return found


def _placed(steps: list[_Step], lasting: dict[int, int], rooms: _Rooms) -> tuple[list[_Row], int]:
    """Statements with places in the frame; a place is used again once its value is dead, but for those of systems. Also the places that are needed."""
    last: dict[int, int] = {}
    for k, (_, to, of, _) in enumerate(steps):
        for v in of:
            last[v] = k
        for v in to:
            last[v] = k
    for v in (*lasting, *rooms.slots):
        last[v] = len(steps)  # stays
    place, slots = dict(lasting), rooms.slots
    free: list[int] = []
    size = rooms.end
    system = -1
    rows: list[_Row] = []
    for k, (code, to, of, where) in enumerate(steps):
        if code == SYSTEM:
            system = where
            shape = rooms.shapes[system]
            rows.append(_row(SYSTEM, rooms.first[system], shape.rows, shape.columns, int(shape.damped)))
            continue
        if code == ANSWER:
            place[to[0]] = rooms.answer(system, where)
            last[to[0]] = len(steps)
            continue
        operands = [place[v] for v in of]
        for v in of:
            if last[v] == k:
                free.append(place[v])
                last[v] = -1  # once, where a value is both operands
        for v in to:
            if v not in place:
                if v in slots:
                    place[v] = slots[v][0]
                elif free:
                    place[v] = free.pop()
                else:
                    place[v] = size
                    size += 1
        if code == LOAD:
            rows.append(_row(LOAD, place[to[0]], where))
        elif code == STORE:
            rows.append(_row(STORE, where, operands[0]))
        elif code == SINCOS:
            rows.append(_row(SINCOS, place[to[0]], operands[0], place[to[1]]))
        else:
            rows.append(_row(code, place[to[0]], *operands))
        for v in to:
            if last[v] == k:
                free.append(place[v])
            elif v in slots:
                rows += [_row(MOVE, slot, place[v]) for slot in slots[v] if slot != place[v]]
    return rows, size


def _row(*statement: int) -> _Row:
    return statement + _NOTHING[len(statement) :]


def _number(place: int, value: Value) -> _Row:
    return _row(NUMBER, place, *struct.unpack("=ii", struct.pack("=d", value.number)))


def _scaled(rows: Sequence[_Row], lanes: int) -> np.ndarray:
    """Places in bytes."""
    table = np.fromiter(chain.from_iterable(rows), np.int32, WIDTH * len(rows)).reshape(-1, WIDTH)
    table[:, 1] *= 8 * lanes
    table[(table[:, 0] != NUMBER) & (table[:, 0] != SYSTEM), 2:] *= 8 * lanes
    return table
