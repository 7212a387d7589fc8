"""The instructions of an `SX` function, all at once: asked for one by one they cost more than all that is made of them."""

from __future__ import annotations

import functools
import struct

import casadi as ca
import numpy as np

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
"""Codes of operations on one operand, and on two; of copies none."""
_SIZE = 16
"""Bytes of an instruction where CasADi writes functions down: operation, result and two operands, or operation, result and a number."""

Instructions = tuple[list[list[int]], list[float]]
"""Rows (operation, result, operand, operand), as numbers of places of work; of inputs argument and entry, of outputs (output, place, entry); and the number of each constant."""


@functools.lru_cache(maxsize=32)
def written(function: ca.Function) -> str:
    """A function as CasADi writes it down: what it is told apart by, and where its instructions are read."""
    return function.serialize()


def operations(function: ca.Function) -> set[int]:
    """Codes of all operations of an `SX` function, loads and stores among them."""
    return {row[0] for row in instructions(function)[0]}


def instructions(function: ca.Function) -> Instructions:
    """Those of an `SX` function, as CasADi writes it down; asked for one by one where it writes in another way than 3.8 does."""
    count = function.n_instructions()
    if not count:
        return [], []
    text = np.frombuffer(written(function).encode(), np.uint8) - ord("a")
    content = (text[0::2] + 16 * text[1::2]).tobytes() if text.size % 2 == 0 else b""
    # they stand behind their number, and a byte for each
    number, first, last = struct.pack("=q", count), _one(function, 0), _one(function, count - 1)
    at = content.find(number)
    while at >= 0:
        begin = at + len(number) + count
        end = begin + _SIZE * count
        if content[begin : begin + _SIZE] == first and content[end - _SIZE : end] == last:
            table = np.frombuffer(content[begin:end], np.int32).reshape(count, 4)
            return table.tolist(), np.frombuffer(content[begin:end], np.float64)[1::2].tolist()
        at = content.find(number, at + 1)
    return one_by_one(function)


def one_by_one(function: ca.Function) -> Instructions:
    """The same."""
    found = b"".join(_one(function, k) for k in range(function.n_instructions()))
    return np.frombuffer(found, np.int32).reshape(-1, 4).tolist(), np.frombuffer(found, np.float64)[1::2].tolist()


def _one(function: ca.Function, k: int) -> bytes:
    code, of, to = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
    if code == ca.OP_CONST:
        return struct.pack("=iid", code, to[0], function.instruction_constant(k))
    if code == ca.OP_OUTPUT:
        return struct.pack("=iiii", code, to[0], of[0], to[1])
    return struct.pack("=iiii", code, to[0], *(*of, *of, 0, 0)[:2])
