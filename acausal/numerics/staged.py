"""Functions that solve systems of linear equations on their way, in numbers where somebody can (see acausal/runtime/systems.h), and in symbols elsewhere."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.graphs import Graph
from acausal.numerics.elimination import eliminated, undamped
from acausal.numerics.folding import folded_function

REFINEMENTS = 4
"""Where rows depend on one another and are damped (in units of each row's compliance, by a millionth of what they leave independent): then answers are those of least norm, in
whatever order rows are."""


_FEW, _FEW_DAMPED = 3, 1
"""Rows of systems that are as soon solved in symbols."""


@dataclass(frozen=True)
class LinearSystem:
    """The shape of M X = B: `rows` n, `columns` m of B; `damped`: a column of damping tells of which rows some may depend on one another.

    Its operands are a column: which rows are active (n; a row that is not is one of the unit matrix), M by rows, the damping if there is one, B by rows. Its answers are X by rows.
    """

    rows: int
    columns: int
    damped: bool

    @property
    def operands(self) -> int:
        """How many there are."""
        n = self.rows
        return n + n * n + self.damped * n + n * self.columns

    @property
    def answers(self) -> int:
        """How many there are."""
        return self.rows * self.columns

    @property
    def room(self) -> int:
        """Values that stand one after the other where it is solved in numbers: operands, answers, and what is needed on the way."""
        n, m = self.rows, self.columns
        return self.operands + self.answers + n * n + n * m + 2 * self.damped * n * m + n

    def parts(self, operands: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Which are active (n, 1), M (n, n), damping (n or 0, 1) and B (n, m)."""
        n, m = self.rows, self.columns
        active, M, damping, B = ca.vertsplit(operands, [0, n, n + n * n, n + n * n + self.damped * n, self.operands])
        return active, ca.reshape(M, n, n).T, damping, ca.reshape(B, m, n).T

    def solved(self, operands: ca.SX) -> ca.SX:
        """The answers, in symbols."""
        _, M, damping, B = self.parts(operands)
        return ca.vec(_solved(M, B, damping if self.damped else None).T)


@dataclass(frozen=True, eq=False)
class Systems:
    """Linear systems that expressions hold the answers of, as symbols, in an order in which each needs those before it only."""

    shapes: tuple[LinearSystem, ...] = ()
    operands: tuple[ca.SX, ...] = ()
    answers: tuple[ca.SX, ...] = ()

    def with_one(self, active: ca.SX, M: ca.SX, B: ca.SX, damping: ca.SX | None = None) -> tuple[Systems, ca.SX]:
        """With M X = B, and its answers X (n, m): one system for each part of the rows that has nothing to do with others, but for small ones, which are solved here."""
        found, X = self, ca.SX.zeros(B.shape)
        for own, columns in _parts(M, B):
            own_damping = None if damping is None or damping[own].is_zero() else damping[own]
            some = M[own, own], B[own, columns], own_damping
            if len(own) <= (_FEW if own_damping is None else _FEW_DAMPED):
                X[own, columns] = _solved(*some)
            else:
                found, X[own, columns] = found._with(active[own], *some)
        return found, X

    def _with(self, active: ca.SX, M: ca.SX, B: ca.SX, damping: ca.SX | None) -> tuple[Systems, ca.SX]:
        n, m = B.shape
        shape = LinearSystem(n, m, damping is not None)
        parts = [active, ca.vec(ca.densify(M).T), *([] if damping is None else [damping]), ca.vec(ca.densify(B).T)]
        answers = ca.vertcat(*(ca.SX.sym(f"answer_{len(self.shapes)}_{k}") for k in range(n * m)))
        operands = ca.densify(ca.vertcat(*parts))
        return self + Systems((shape,), (operands,), (answers,)), ca.reshape(answers, m, n).T * ca.DM(_reached(M, B))

    def with_operands(self, make: Callable[[ca.SX], ca.SX]) -> Systems:
        """With other operands."""
        return Systems(self.shapes, tuple(map(make, self.operands)), self.answers)

    def __add__(self, other: Systems) -> Systems:
        return Systems((*self.shapes, *other.shapes), (*self.operands, *other.operands), (*self.answers, *other.answers))

    def needed_by(self, value: ca.SX) -> Systems:
        """Those that an expression needs."""
        wanted, kept = value, list[int]()
        for k in reversed(range(len(self.shapes))):
            if ca.depends_on(wanted, self.answers[k]):
                kept.insert(0, k)
                wanted = ca.veccat(wanted, self.operands[k])
        return Systems(
            tuple(self.shapes[k] for k in kept), tuple(self.operands[k] for k in kept), tuple(self.answers[k] for k in kept)
        )

    def unrolled(self, value: ca.SX) -> ca.SX:
        """An expression with the answers in symbols."""
        known = self.needed_by(value)
        for shape, operands, answers in reversed(list(zip(known.shapes, known.operands, known.answers, strict=True))):
            value = ca.substitute(value, answers, shape.solved(operands))
        return value


def _solved(M: ca.SX, B: ca.SX, damping: ca.SX | None) -> ca.SX:
    return eliminated(M, B) if damping is None else undamped(M, damping, B, REFINEMENTS)


def _parts(M: ca.SX, B: ca.SX) -> Iterator[tuple[list[int], list[int]]]:
    """Rows that are linked, and columns of B that are not zero there; nothing where all of B is."""
    rows, columns = ca.sparsify(M).sparsity().get_triplet()
    given = _entries(ca.sparsify(B).sparsity())
    for part in Graph(range(M.shape[0]), zip(rows, columns, strict=True)).parts():
        own = sorted(part)
        some = np.flatnonzero(given[own].any(axis=0)).tolist()
        if some:
            yield own, some


def _linked(M: np.ndarray) -> np.ndarray:
    """Of the pattern of a matrix (n, n) that of its inverse."""
    found = M | np.eye(M.shape[0], dtype=bool)
    for _ in range(int(np.ceil(np.log2(M.shape[0] + 1)))):
        found = found.astype(np.float32) @ found.astype(np.float32) > 0
    return found


def _entries(sparsity: ca.Sparsity) -> np.ndarray:
    return np.array(ca.DM(sparsity, 1).full(), dtype=bool)


def _reached(M: ca.SX, B: ca.SX) -> np.ndarray:
    """Which answers (n, m) are not zero whatever numbers stand in M and B: those that entries of B lead to."""
    M, B = ca.sparsify(M), ca.sparsify(B)
    return (_linked(_entries(M.sparsity())).astype(float) @ _entries(B.sparsity()) > 0).astype(float)


@dataclass(frozen=True, eq=False)
class Staged:
    """A function whose results hold answers of linear systems.

    `function`: (arguments, answers of each system) -> (results, operands of each system), both columns; operands of a system depend on answers of those before it only.
    """

    function: ca.Function
    shapes: tuple[LinearSystem, ...]

    @staticmethod
    def of(
        name: str, arguments: Sequence[ca.SX], results: Sequence[ca.SX], systems: Systems, fold: bool = True
    ) -> ca.Function | Staged:
        """A plain function where the results need no system. `fold`: common subexpressions; no, where they come from a function that has been folded, or go to kernels, which do."""
        known = systems.needed_by(ca.veccat(*results))
        make = folded_function if fold else ca.Function
        function = make(name, [*arguments, *known.answers], [*results, *known.operands])
        return Staged(function, known.shapes) if known.shapes else function

    def size1_out(self, k: int) -> int:
        """Rows of a result."""
        return self.function.size1_out(k)

    def size1_in(self, k: int) -> int:
        """Rows of an argument."""
        return self.function.size1_in(k)

    def n_in(self) -> int:
        """Number of arguments."""
        return self.function.n_in() - len(self.shapes)

    def name(self) -> str:
        """As it was given."""
        return self.function.name()

    @functools.cached_property
    def plain(self) -> ca.Function:
        """The same in symbols."""
        arguments = symbols_of(self)
        results, systems = called(self, arguments)
        return ca.Function(self.name(), arguments, [systems.unrolled(result) for result in results])


Function = ca.Function | Staged


def plain(function: Function) -> ca.Function:
    """In symbols."""
    return function.plain if isinstance(function, Staged) else function


def systems_of(function: Function) -> tuple[ca.Function, tuple[LinearSystem, ...]]:
    """(arguments, answers) -> (results, operands), and the systems between them."""
    return (function.function, function.shapes) if isinstance(function, Staged) else (function, ())


def symbols_of(function: Function) -> list[ca.SX]:
    """Columns for its arguments."""
    return [ca.SX.sym(f"a{k}", function.size1_in(k)) for k in range(function.n_in())]


def composed(
    name: str, functions: Sequence[Function], make: Callable[[list[ca.SX], list[list[ca.SX]]], list[ca.SX]], fold: bool = False
) -> Function:
    """A function of the same arguments, made from the results of some: `make`(arguments, results of each). `fold`: what is common to them is found here."""
    arguments = symbols_of(functions[0])
    results: list[list[ca.SX]] = []
    known = Systems()
    for function in functions:
        found, systems = called(function, arguments)
        results.append(found)
        known = known + systems
    return Staged.of(name, arguments, [ca.densify(value) for value in make(arguments, results)], known, fold)


def called(function: Function, arguments: Sequence[ca.SX]) -> tuple[list[ca.SX], Systems]:
    """The results at these arguments, and the systems whose answers they hold."""
    core, shapes = systems_of(function)
    answers = [ca.vertcat(*(ca.SX.sym(f"answer{k}") for k in range(shape.answers))) for shape in shapes]
    found = core.call([*arguments, *answers])
    count = core.n_out() - len(shapes)
    return list(found[:count]), Systems(shapes, tuple(found[count:]), tuple(answers))


def dependence(function: Function, argument: int) -> ca.Sparsity:
    """Which entries of the derivative of the first result by an argument may be other than zero."""
    core, shapes = systems_of(function)
    count = core.n_out() - len(shapes)
    if not shapes:
        return core.jac_sparsity(0, argument)
    found = _entries(core.jac_sparsity(0, argument))
    unknown = [ca.DM.nan(core.size1_in(k)) for k in range(core.n_in())]
    operands = core.call(unknown)[count:]  # what is a number there is one anywhere
    by_argument: list[np.ndarray] = []
    given = core.n_in() - len(shapes)
    for k, shape in enumerate(shapes):
        n = shape.rows
        own = _entries(core.jac_sparsity(count + k, argument)).astype(float)
        for j, before in enumerate(by_argument):
            own += _entries(core.jac_sparsity(count + k, given + j)).astype(float) @ before
        rows = np.concatenate(
            [np.arange(n), np.arange(n).repeat(n), np.arange(shape.damped * n), np.arange(n).repeat(shape.columns)]
        )
        by_row = np.zeros((n, own.shape[1]))
        np.add.at(by_row, rows, own)
        M = np.array(operands[k].full()[n : n + n * n] != 0).reshape(n, n)
        by_argument.append(((_linked(M).astype(float) @ by_row) > 0).repeat(shape.columns, axis=0).astype(float))
        found |= (_entries(core.jac_sparsity(0, given + k)).astype(float) @ by_argument[k]) > 0
    return ca.sparsify(ca.DM(found.astype(float))).sparsity()


def operations_of(function: Function) -> int:
    """Instructions of one evaluation, about, some rows of systems being active."""
    core, shapes = systems_of(function)
    return core.n_instructions() + operations_of_systems(shapes)


def operations_of_systems(shapes: Sequence[LinearSystem]) -> int:
    """About, some rows being active."""
    return sum(shape.rows**2 * shape.columns for shape in shapes)
