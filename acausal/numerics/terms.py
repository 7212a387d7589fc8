"""What rounding errors an expression can have: the sum of the sizes of everything that is rounded on the way to it."""

from __future__ import annotations

import functools
from collections.abc import Callable

import casadi as ca
import numpy as np

from acausal.numerics.thresholds import CORNER

_COPIES = (ca.OP_ASSIGN, ca.OP_LIFT)


def rounded(expression: ca.SX) -> ca.SX:
    """For each entry (n, 1) the sum of the sizes of its terms, carried through functions by their slopes; times 1e-16 it bounds the
    rounding error to first order (Wilkinson's running error analysis). It has the entry's unit. Cost: a few operations for each one.
    """
    return _carried(expression, _size, _result)


def squares_of_terms(expression: ca.SX) -> ca.SX:
    """For each entry (n, 1) the sum of the squares of its terms, carried through sums, products and quotients: without absolute values, which would be
    switches where steps of a motion end, and without slopes, which have borders."""

    def result(code: int, arguments: list[_Sized]) -> _Sized:
        values, squares = [value for value, _ in arguments], [square for _, square in arguments]
        return _applied(code, *values), _square_of_result(code, values, squares)

    return _carried(expression, _square, result)


_Sized = tuple[ca.SX, ca.SX]
"""A value, and how large it is."""


def _carried(expression: ca.SX, size: Callable[[ca.SX], ca.SX], result: Callable[[int, list[_Sized]], _Sized]) -> ca.SX:
    """How large each entry (n, 1) is: by the sizes of its symbols and constants, and what operations make of them."""
    symbols = ca.symvar(expression)
    function = ca.Function("rows", [ca.vertcat(ca.SX(0, 1), *symbols)], [ca.densify(expression)])
    work: dict[int, _Sized] = {}
    found = ca.SX.zeros(expression.numel())
    for k in range(function.n_instructions()):
        code, inputs, outputs = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_OUTPUT:
            found[outputs[1]] = work[inputs[0]][1]
        elif code in (ca.OP_INPUT, ca.OP_CONST):
            value = symbols[inputs[1]] if code == ca.OP_INPUT else ca.SX(function.instruction_constant(k))
            work[outputs[0]] = value, size(value)
        else:
            work[outputs[0]] = result(code, [work[i] for i in inputs])
    return found


def _square_of_result(code: int, values: list[ca.SX], squares: list[ca.SX]) -> ca.SX:
    if code in _COPIES or code == ca.OP_NEG:
        return squares[0]
    if code in (ca.OP_ADD, ca.OP_SUB):
        return _sum(*squares)
    if code == ca.OP_MUL:  # as nothing is said of a factor of one, which is left out
        shares = [_product(_square(values[1 - i]), squares[i]) for i in (0, 1) if not values[i].is_constant()]
        return functools.reduce(_sum, shares)
    if code == ca.OP_TWICE:
        return _product(_FOUR, squares[0])
    own = _square(_applied(code, *values))
    return _sum(own, _applied(ca.OP_DIV, squares[0], _square(values[1]))) if code == ca.OP_DIV else own


def finite(sizes: np.ndarray) -> np.ndarray:
    """Sizes of terms, zero where a slope has no value, or only one that was rounded off."""
    result = sizes.copy()
    result[~(result < CORNER)] = 0.0
    return result


def _result(code: int, arguments: list[tuple[ca.SX, ca.SX]]) -> tuple[ca.SX, ca.SX]:
    """Value and size of one operation from those of its arguments."""
    if code in _COPIES:
        return arguments[0]
    values, sizes = [value for value, _ in arguments], [size for _, size in arguments]
    result = _applied(code, *values)
    if code in (ca.OP_ADD, ca.OP_SUB):
        return result, _sum(*sizes)
    if code in (ca.OP_MUL, ca.OP_DIV) and values[1].is_constant():
        return result, _applied(code, sizes[0], _size(values[1]))  # as nothing is said of a factor of one, which is left out
    if code == ca.OP_MUL and values[0].is_constant():
        return result, _product(_size(values[0]), sizes[1])
    if code == ca.OP_MUL:
        return result, _sum(_product(_size(values[0]), sizes[1]), _product(_size(values[1]), sizes[0]))
    if code == ca.OP_SQ:
        return result, _product(_product(_TWO, _size(values[0])), sizes[0])
    if code in (ca.OP_NEG, ca.OP_TWICE):
        return result, sizes[0] if code == ca.OP_NEG else _sum(sizes[0], sizes[0])
    if code in (ca.OP_SIN, ca.OP_COS):  # at most 1 each
        return result, _sum(_ONE, sizes[0])
    slopes = _slopes(code, len(values)).call(values)
    carried = (_product(_size(slope), size) for slope, size in zip(slopes, sizes, strict=True))
    return result, _sum(_size(result), functools.reduce(_sum, carried))


def _applied(code: int, *values: ca.SX) -> ca.SX:
    """What an operation makes of its arguments. By its code: CasADi asks what an operator's operands may be read as for ten times as long."""
    return ca.SX.unary(code, values[0]) if len(values) == 1 else ca.SX.binary(code, values[0], values[1])


_size = functools.partial(_applied, ca.OP_FABS)
_sum = functools.partial(_applied, ca.OP_ADD)
_product = functools.partial(_applied, ca.OP_MUL)
_square = functools.partial(_applied, ca.OP_SQ)
_ONE, _TWO, _FOUR = ca.SX(1), ca.SX(2), ca.SX(4)


@functools.cache
def _slopes(code: int, count: int) -> ca.Function:
    """Derivatives of an operation by its arguments."""
    arguments = [ca.SX.sym(f"a{i}") for i in range(count)]
    result = _applied(code, *arguments)
    return ca.Function("slopes", arguments, [ca.densify(ca.gradient(result, a)) for a in arguments])
