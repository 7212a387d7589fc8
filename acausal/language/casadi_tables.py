"""CasADi's `interpolant` and `bspline` as formulas: sums of pieces, with exact derivatives, which are code like any other expression."""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.language.interpolant import polynomials_of

_SIZES = {"J": 8, "d": 8}
_CODES = {"J": "<q", "d": "<d"}
_AGREED = 1e-10
"""Part of its largest value within which a formula is what CasADi computes."""
_PLACES, _DECADES = 24, 6.0
"""Places at which an expression may have a value, and decades that they are apart from 1."""


@dataclass(frozen=True)
class Contents:
    """What stands in an expression: `calls` of functions, whose formulas it does not show, and a constant `nan`."""

    calls: bool
    nan: bool

    @staticmethod
    def of(value: ca.SX) -> Contents:
        """Of an expression, whose symbols need not be known."""
        function = ca.Function("formula", [], [value], {"allow_free": True})
        codes = [function.instruction_id(k) for k in range(function.n_instructions())]
        constants = (function.instruction_constant(k) for k, code in enumerate(codes) if code == ca.OP_CONST)
        return Contents(ca.OP_CALL in codes, any(math.isnan(number) for number in constants))


def is_no_number(value: ca.SX) -> bool:
    """Whether an entry of an expression with a constant nan is nan at all of some places of either sign and of sizes far apart."""
    function = ca.Function("formula", [ca.vertcat(ca.SX(0, 1), *ca.symvar(value))], [ca.densify(value)])
    rng, shape = np.random.default_rng(11), (_PLACES, function.size1_in(0))
    places = rng.choice([-1.0, 1.0], shape) * 10.0 ** rng.uniform(-_DECADES, _DECADES, shape)
    return bool(np.isnan([np.array(function(place)).ravel() for place in places]).all(axis=0).any())


def without_calls(value: ca.SX) -> ca.SX | None:
    """The same with formulas in place of calls of `interpolant` and `bspline`; None where something else is called."""
    found: dict[int, ca.SX] = {}
    formulas: dict[int, Table | None] = {}
    roots = ca.vertsplit(ca.vec(ca.densify(value)))
    for node in _in_order(roots):
        key = node.element_hash()
        if node.is_output():
            call = node.dep(0)
            function = call.which_function()
            number = function.__hash__()
            if number not in formulas:
                formulas[number] = _table(function)
            table = formulas[number]
            if table is None:
                return None
            found[key] = table.at([found[call.dep(k).element_hash()] for k in range(call.n_dep())])
        elif node.is_leaf():
            found[key] = node
        else:
            parts = [found[node.dep(k).element_hash()] for k in range(node.n_dep())]
            found[key] = ca.SX.unary(node.op(), *parts) if len(parts) == 1 else ca.SX.binary(node.op(), *parts)
    return ca.reshape(ca.vertcat(*(found[root.element_hash()] for root in roots)), *value.shape)


def _in_order(roots: Sequence[ca.SX]) -> Iterator[ca.SX]:
    """All nodes, each behind what it is made of; arguments of a call in place of the call."""
    done: set[int] = set()
    queue = [(root, False) for root in reversed(roots)]
    while queue:
        node, ready = queue.pop()
        key = node.element_hash()
        if key in done:
            continue
        if ready or node.is_leaf():
            done.add(key)
            yield node
            continue
        queue.append((node, True))
        made_of = node.dep(0) if node.is_output() else node
        queue += [(made_of.dep(k), False) for k in range(made_of.n_dep())]


@dataclass(frozen=True)
class Table:
    """A tensor product of piecewise polynomials: `coefficients` (pieces, powers) for each argument in turn, `begins` of the pieces."""

    begins: tuple[np.ndarray, ...]
    coefficients: np.ndarray

    @property
    def variables(self) -> int:
        """The number of arguments."""
        return len(self.begins)

    def at(self, x: Sequence[ca.SX]) -> ca.SX:
        """The value, by Horner's rule in the pieces that the arguments are in."""
        return self._value(list(x), 0, self.coefficients)

    def _value(self, x: list[ca.SX], k: int, coefficients: np.ndarray) -> ca.SX:
        if k == len(x):
            return ca.SX(float(coefficients))
        begins = self.begins[k]
        pieces = [[self._value(x, k + 1, entry) for entry in piece] for piece in coefficients]
        begin = chosen([ca.SX(float(b)) if np.isfinite(b) else ca.SX(0) for b in begins], begins[1:], x[k])
        s, value = x[k] - begin, ca.SX(0)
        for power in range(coefficients.shape[1]):
            value = value * s + chosen([piece[power] for piece in pieces], begins[1:], x[k])
        return value


def chosen(entries: Sequence[ca.SX], between: np.ndarray, x: ca.SX) -> ca.SX:
    """The entry of the piece that x is in, found by halving."""
    if len(entries) == 1 or all(ca.is_equal(entry, entries[0]) for entry in entries):
        return entries[0]
    half = len(entries) // 2
    return ca.if_else(
        x < float(between[half - 1]), chosen(entries[:half], between[: half - 1], x), chosen(entries[half:], between[half:], x)
    )


def _table(function: ca.Function) -> Table | None:
    """Of a function that is an interpolant or a B-spline of one value, and is found to be what it computes; else None."""
    if function.n_in() != 1 or function.n_out() != 1 or function.numel_out(0) != 1:
        return None
    text = _labelled(function)
    linear = function.class_name() == "LinearInterpolant"
    names = (
        ("Interpolant::grid", "Interpolant::offset", "Interpolant::values")
        if linear
        else ("BSplineCommon::knots", "BSplineCommon::offset", "BSpline::coeffs")
    )
    lists = [_numbers(text, name) for name in names]
    degrees = [1] * function.numel_in(0) if linear else _numbers(text, "BSplineCommon::degree")
    if not degrees or any(entry is None for entry in lists):
        return None
    knots, offset, values = (entry for entry in lists if entry is not None)
    axes = [np.array(knots[int(a) : int(b)]) for a, b in itertools.pairwise(offset)]
    if linear:
        axes = [np.concatenate([axis[:1], axis, axis[-1:]]) for axis in axes]
    counts = [axis.size - int(degree) - 1 for axis, degree in zip(axes, degrees, strict=True)]
    if np.prod(counts) != len(values) or min(counts) < 1:
        return None
    table = product(axes, [int(d) for d in degrees], np.array(values).reshape(counts, order="F"), going_on=linear)
    return table if table is not None and _agrees(table, function, axes) else None


def product(axes: Sequence[np.ndarray], degrees: Sequence[int], coefficients: np.ndarray, *, going_on: bool) -> Table | None:
    """Of knots along each argument and coefficients of B-splines, one index for each argument: beyond, the outermost pieces go on, or it is zero.

    None for coefficients of another shape.
    """
    from scipy.interpolate import BSpline

    counts = [axis.size - degree - 1 for axis, degree in zip(axes, degrees, strict=True)]
    if list(coefficients.shape) != counts:
        return None
    found, begins = coefficients, list[np.ndarray]()
    for k, (axis, degree, count) in enumerate(zip(axes, degrees, counts, strict=True)):
        real = np.diff(axis) > 0
        each = [polynomials_of(BSpline(axis, unit, degree)).c[:, real].T for unit in np.eye(count)]
        basis, starts = np.stack(each, axis=2), axis[:-1][real]
        if not going_on:
            none = np.zeros_like(basis[:1])
            basis = np.concatenate([none, basis, none])
            starts = np.concatenate([[-np.inf], starts, [np.nextafter(axis[-1], np.inf)]])
        # arguments done stand as pairs (pieces, powers) in front
        found = np.moveaxis(np.tensordot(basis, found, axes=([2], [2 * k])), (0, 1), (2 * k, 2 * k + 1))
        begins.append(starts)
    return Table(tuple(begins), found)


def _agrees(table: Table, function: ca.Function, axes: list[np.ndarray]) -> bool:
    """At random places inside and a little outside."""
    x = ca.SX.sym("x", len(axes))
    own = ca.Function("own", [x], [table.at(ca.vertsplit(x))])
    rng = np.random.default_rng(0)
    ends = [(axis[0], axis[-1]) for axis in axes]
    places = np.array([rng.uniform(a - 0.1 * (b - a), b + 0.1 * (b - a), 50) for a, b in ends])
    wanted, found = np.array(function(places)).ravel(), np.array(own(places)).ravel()
    return bool(np.max(np.abs(wanted - found)) <= _AGREED * np.max(np.abs(wanted)))


def _labelled(function: ca.Function) -> bytes:
    """What CasADi writes of a function, with names; two letters hold a byte."""
    text = function.serialize({"debug": True})
    letters = np.frombuffer(text.encode("latin-1"), dtype=np.uint8).astype(int) - ord("a")
    letters = letters[1 if len(letters) % 2 else 0 :]
    return bytes(((letters[::2] & 15) | ((letters[1::2] & 15) << 4)).astype(np.uint8))


def _numbers(text: bytes, name: str) -> list[float] | None:
    """A list of numbers by its name: `V`, its length, then a letter for its kind before each number."""
    label = name.encode()
    places = (
        [k + len(label) for k in range(len(text) - len(label)) if text.startswith(label, k)] if text.count(label) == 1 else []
    )
    if len(places) != 1 or text[places[0] : places[0] + 2] != b"VJ":
        return None
    (count,) = struct.unpack_from("<q", text, places[0] + 2)
    at, found = places[0] + 10, list[float]()
    for _ in range(count):
        kind = chr(text[at])
        if kind not in _CODES:
            return None
        found.append(float(struct.unpack_from(_CODES[kind], text, at + 1)[0]))
        at += 1 + _SIZES[kind]
    return found
