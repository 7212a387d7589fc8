"""Reading expressions as rational functions in a chart, instruction by instruction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

from acausal.explain.integrability.rational import Chart, Linear, NotRational, rational


def rational_functions(expressions: ca.SX, y: ca.SX, chart: Chart) -> list[Any]:
    """Entries of an `SX`, column by column, as elements of the chart's field, instruction by instruction. Raises `NotRational`."""
    function = ca.Function("exact", [y], [ca.densify(expressions)])
    results: list[Any] = [chart.K.zero] * function.numel_out(0)
    work: dict[int, Any] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        out, inputs = function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_INPUT:
            work[out[0]] = chart.coordinate(inputs[1])
        elif operation == ca.OP_OUTPUT:
            results[out[1]] = chart.element(work[inputs[0]])
        elif operation == ca.OP_CONST:
            work[out[0]] = Linear({}, rational(float(function.instruction_constant(k))))
        else:
            work[out[0]] = _apply(operation, [work[i] for i in inputs], chart)
    chart.check()
    return results


def _apply(operation: int, values: Sequence[Any], chart: Chart) -> Any:
    linear = _linear(operation, values)
    if linear is not None:
        return linear
    if operation in (ca.OP_SIN, ca.OP_COS, ca.OP_TAN):
        c, s = chart.turn(values[0])
        return c if operation == ca.OP_COS else s if operation == ca.OP_SIN else _quotient(s, c)
    a, *more = (chart.element(value) for value in values)
    b = more[0] if more else None
    if operation == ca.OP_SQRT:
        return _root(a, chart)
    if operation == ca.OP_DIV:
        return _quotient(a, b)
    if operation == ca.OP_INV:
        return _quotient(chart.K.one, a)
    if operation == ca.OP_CONSTPOW or operation == ca.OP_POW:
        power = values[1]
        if isinstance(power, Linear) and not power.terms and power.constant.denominator == 1:
            return a ** int(power.constant) if power.constant >= 0 else _quotient(chart.K.one, a ** int(-power.constant))
        raise NotRational("a power is no whole number")
    simple = {ca.OP_ADD: lambda: a + b, ca.OP_SUB: lambda: a - b, ca.OP_MUL: lambda: a * b, ca.OP_NEG: lambda: -a,
              ca.OP_SQ: lambda: a * a, ca.OP_TWICE: lambda: 2 * a, ca.OP_ASSIGN: lambda: a}.get(operation)  # fmt: skip
    if simple is None:
        raise NotRational(f"operation {operation} has no rational form")
    return simple()


def _quotient(a: Any, b: Any) -> Any:
    if not b:
        raise NotRational("a divisor vanishes everywhere")
    return a / b


def _linear(operation: int, values: Sequence[Any]) -> Linear | None:
    """The operation where it keeps linear expressions linear."""
    if not all(isinstance(value, Linear) for value in values):
        return None
    a, b = values[0], values[-1]
    if operation in (ca.OP_ADD, ca.OP_SUB):
        return a.plus(b, Fraction(1 if operation == ca.OP_ADD else -1))
    if operation in (ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        return a.times(Fraction({ca.OP_NEG: -1, ca.OP_TWICE: 2, ca.OP_ASSIGN: 1}[operation]))
    if operation == ca.OP_MUL and (not a.terms or not b.terms):
        return b.times(a.constant) if not a.terms else a.times(b.constant)
    if operation == ca.OP_DIV and not b.terms and b.constant:
        return a.times(1 / b.constant)
    return None


def _root(a: Any, chart: Chart) -> Any:
    """The root of a square, positive at the start."""
    parts: list[Any] = []
    for polynomial in (a.numer, a.denom):
        constant, factors = polynomial.sqf_list()
        n, d = math.isqrt(abs(constant.numerator)), math.isqrt(abs(constant.denominator))
        if constant < 0 or n * n != constant.numerator or d * d != constant.denominator or any(p % 2 for _, p in factors):
            raise NotRational("a root is taken of what is no square")
        root = chart.K(polynomial.ring(constant.__class__(n) / constant.__class__(d)))
        for factor, power in factors:
            root = root * chart.K(factor) ** (power // 2)
        parts.append(root)
    found = parts[0] / parts[1]
    return found if _value(found, chart.z_start()) > 0 else -found


def _value(element: Any, z: np.ndarray) -> float:
    """A rational function at a point, next to it where that is a zero of numerator or denominator."""
    point = [_exactly(float(v) + 0.01 * (k + 1)) for k, v in enumerate(z)]
    top, bottom = (part.evaluate(list(zip(part.ring.gens, point, strict=True))) for part in (element.numer, element.denom))
    return float(top) / float(bottom)


def _exactly(value: float) -> Any:
    from sympy.polys.domains import QQ

    short = Fraction(value).limit_denominator(10_000)
    return QQ(short.numerator, short.denominator)
