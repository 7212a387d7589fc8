"""From CasADi `SX` to sympy, instruction by instruction."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import casadi as ca

from acausal.errors import ExportError


def to_sympy(expression: ca.SX, symbols: Sequence[tuple[ca.SX, Sequence[Any]]]) -> list[Any]:
    """The entries of `expression`, column by column, as sympy expressions.

    `symbols`: pairs of an `SX` column of symbols and what stands for each entry. Numbers that are short fractions become exact.
    Raises `ExportError` for an operation without a sympy form.
    """
    import sympy

    arguments = [column for column, _ in symbols]
    function = ca.Function("expression", arguments, [ca.densify(expression)], {"cse": False})
    values = [list(names) for _, names in symbols]
    results: list[Any] = [sympy.Integer(0)] * function.numel_out(0)
    work: dict[int, Any] = {}
    table = operations()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        out, inputs = function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_INPUT:
            work[out[0]] = values[inputs[0]][inputs[1]]
        elif operation == ca.OP_OUTPUT:
            results[out[1]] = work[inputs[0]]
        elif operation == ca.OP_CONST:
            work[out[0]] = _number(function.instruction_constant(k))
        elif operation in table:
            work[out[0]] = table[operation](*(work[i] for i in inputs))
        else:
            raise ExportError(f"An operation (CasADi number {operation}) has no sympy form.")
    return results


def _number(value: float) -> Any:
    import sympy

    short = Fraction(value).limit_denominator(999)
    return sympy.Rational(short) if abs(float(short) - value) <= 1e-15 * abs(value) else sympy.Float(value, 15)


def operations() -> dict[int, Any]:
    """sympy's form of each operation of CasADi."""
    import sympy

    sp: Any = sympy  # its annotations leave conditions out
    return {
        ca.OP_ASSIGN: lambda a: a,
        ca.OP_ADD: lambda a, b: a + b,
        ca.OP_SUB: lambda a, b: a - b,
        ca.OP_MUL: lambda a, b: a * b,
        ca.OP_DIV: lambda a, b: a / b,
        ca.OP_NEG: lambda a: -a,
        ca.OP_SQ: lambda a: a**2,
        ca.OP_TWICE: lambda a: 2 * a,
        ca.OP_INV: lambda a: 1 / a,
        ca.OP_POW: lambda a, b: a**b,
        ca.OP_CONSTPOW: lambda a, b: a**b,
        ca.OP_SQRT: sp.sqrt,
        ca.OP_EXP: sp.exp,
        ca.OP_LOG: sp.log,
        ca.OP_SIN: sp.sin,
        ca.OP_COS: sp.cos,
        ca.OP_TAN: sp.tan,
        ca.OP_ASIN: sp.asin,
        ca.OP_ACOS: sp.acos,
        ca.OP_ATAN: sp.atan,
        ca.OP_ATAN2: sp.atan2,
        ca.OP_SINH: sp.sinh,
        ca.OP_COSH: sp.cosh,
        ca.OP_TANH: sp.tanh,
        ca.OP_FABS: sp.Abs,
        ca.OP_SIGN: sp.sign,
        ca.OP_FMIN: sp.Min,
        ca.OP_FMAX: sp.Max,
        ca.OP_FLOOR: sp.floor,
        ca.OP_CEIL: sp.ceiling,
        ca.OP_ASINH: sp.asinh,
        ca.OP_ACOSH: sp.acosh,
        ca.OP_ATANH: sp.atanh,
        ca.OP_LOG1P: lambda a: sp.log(1 + a),
        ca.OP_EXPM1: lambda a: sp.exp(a) - 1,
        ca.OP_ERF: sp.erf,
        ca.OP_LT: lambda a, b: sp.Piecewise((1, a < b), (0, True)),
        ca.OP_LE: lambda a, b: sp.Piecewise((1, a <= b), (0, True)),
        ca.OP_EQ: lambda a, b: sp.Piecewise((1, sp.Eq(a, b)), (0, True)),
        ca.OP_NE: lambda a, b: sp.Piecewise((1, sp.Ne(a, b)), (0, True)),
        ca.OP_NOT: lambda a: sp.Piecewise((1, sp.Eq(a, 0)), (0, True)),
        ca.OP_AND: lambda a, b: sp.Piecewise((1, sp.And(sp.Ne(a, 0), sp.Ne(b, 0))), (0, True)),
        ca.OP_OR: lambda a, b: sp.Piecewise((1, sp.Or(sp.Ne(a, 0), sp.Ne(b, 0))), (0, True)),
        ca.OP_IF_ELSE_ZERO: lambda a, b: sp.Piecewise((b, sp.Ne(a, 0)), (0, True)),
        ca.OP_HYPOT: lambda a, b: sp.sqrt(a**2 + b**2),
    }
