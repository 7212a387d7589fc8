"""How large the rounding of a computed column is, to first order: what each intermediate value's rounding does to it, added up.

Higham, *Accuracy and Stability of Numerical Algorithms*, 3.3; Linnainmaa (1976), by reverse differentiation. Whether a residual is zero is
asked of the rounding of its own terms, never of a number with a unit. Errors that the instructions themselves correct (iterative refinement)
count as little as they should.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class _Step:
    """One instruction: its operation, the steps that make its operands, a constant or the place of an input."""

    operation: int
    operands: tuple[int, ...]
    constant: float = 0.0
    place: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Rounding:
    """Of a function with one output: bounds of its rounding errors, to first order, where its arguments are known to given errors."""

    function: ca.Function

    def __call__(self, arguments: Sequence[np.ndarray | float], errors: Sequence[np.ndarray | float]) -> np.ndarray:
        """(size of the output,), for arguments and their absolute errors of the same shapes; NaN where a value is none.

        Cost: that of one reverse sweep for all outputs, interpreted.
        """
        given = [np.ravel(a) for a in arguments]
        known = [np.broadcast_to(np.ravel(e), a.shape) for a, e in zip(given, errors, strict=True)]
        steps, outputs = self._steps
        values: list[float] = []
        slopes: list[Sequence[float]] = []
        for step in steps:
            value, slope = _evaluated(step, given, values)
            values.append(value)
            slopes.append(slope)
        size = self.function.numel_out(0)
        total = np.zeros(size)
        adjoint: list[np.ndarray | None] = [None] * len(steps)
        for k, source in outputs:
            seed = np.zeros(size)
            seed[k] = 1.0
            before = adjoint[source]
            adjoint[source] = seed if before is None else before + seed
        for k in range(len(steps) - 1, -1, -1):
            own, step = adjoint[k], steps[k]
            if own is None:
                continue
            adjoint[k] = None
            error = known[step.place[0]][step.place[1]] if step.operation == ca.OP_INPUT else _EPS * abs(values[k])
            if error and step.operation not in _EXACT:
                total += np.abs(own) * error
            for i, slope in zip(step.operands, slopes[k], strict=True):
                if slope:
                    before = adjoint[i]
                    adjoint[i] = slope * own if before is None else before + slope * own
        return total

    @functools.cached_property
    def _steps(self) -> tuple[list[_Step], list[tuple[int, int]]]:
        """Each value once, and (entry of the output, step that makes it)."""
        f = self.function
        steps: list[_Step] = []
        outputs: list[tuple[int, int]] = []
        made: dict[int, int] = {}
        for k in range(f.n_instructions()):
            operation, out, inputs = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
            if operation == ca.OP_OUTPUT:
                outputs.append((out[1], made[inputs[0]]))
                continue
            if operation == ca.OP_INPUT:
                step = _Step(operation, (), place=(inputs[0], inputs[1]))
            elif operation == ca.OP_CONST:
                step = _Step(operation, (), f.instruction_constant(k))
            else:
                step = _Step(operation, tuple(made[i] for i in inputs))
            made[out[0]] = len(steps)
            steps.append(step)
        return steps, outputs


def _evaluated(step: _Step, given: Sequence[np.ndarray], values: Sequence[float]) -> tuple[float, Sequence[float]]:
    if step.operation == ca.OP_INPUT:
        return float(given[step.place[0]][step.place[1]]), ()
    if step.operation == ca.OP_CONST:
        return step.constant, ()
    try:
        return _RULES[step.operation](*(values[i] for i in step.operands))
    except (ArithmeticError, ValueError):
        return math.nan, [math.nan] * len(step.operands)


def _power(a: float, b: float) -> tuple[float, list[float]]:
    value = a**b
    return value, [b * value / a if a else 0.0 if b > 1 else math.inf, value * math.log(a) if a > 0 else 0.0]


def _hypot(a: float, b: float) -> tuple[float, list[float]]:
    size = math.hypot(a, b)
    return size, [a / size, b / size] if size else [1.0, 1.0]


def _piece(value: float, count: int) -> tuple[float, list[float]]:
    return value, [0.0] * count


def _sqrt(a: float) -> tuple[float, list[float]]:
    value = math.sqrt(a)
    return value, [0.5 / value if value else 0.0]


def _arctangent(a: float, b: float) -> tuple[float, list[float]]:
    square = a * a + b * b
    return math.atan2(a, b), [b / square, -a / square] if square else [0.0, 0.0]


_EXACT = {ca.OP_ASSIGN, ca.OP_NEG, ca.OP_TWICE, ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX, ca.OP_IF_ELSE_ZERO}
_RULES: dict[int, Callable[..., tuple[float, list[float]]]] = {
    ca.OP_ASSIGN: lambda a: (a, [1.0]),
    ca.OP_ADD: lambda a, b: (a + b, [1.0, 1.0]),
    ca.OP_SUB: lambda a, b: (a - b, [1.0, 1.0]),
    ca.OP_MUL: lambda a, b: (a * b, [b, a]),
    ca.OP_DIV: lambda a, b: (a / b, [1 / b, a / b / b]),
    ca.OP_NEG: lambda a: (-a, [1.0]),
    ca.OP_SQ: lambda a: (a * a, [2 * a]),
    ca.OP_TWICE: lambda a: (2 * a, [2.0]),
    ca.OP_INV: lambda a: (1 / a, [1 / a / a]),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_SQRT: _sqrt,
    ca.OP_EXP: lambda a: (math.exp(a), [math.exp(a)]),
    ca.OP_LOG: lambda a: (math.log(a), [1 / a]),
    ca.OP_LOG1P: lambda a: (math.log1p(a), [1 / (1 + a)]),
    ca.OP_EXPM1: lambda a: (math.expm1(a), [math.exp(a)]),
    ca.OP_SIN: lambda a: (math.sin(a), [math.cos(a)]),
    ca.OP_COS: lambda a: (math.cos(a), [math.sin(a)]),
    ca.OP_TAN: lambda a: (math.tan(a), [1 + math.tan(a) ** 2]),
    ca.OP_ASIN: lambda a: (math.asin(a), [1 / math.sqrt(1 - a * a)]),
    ca.OP_ACOS: lambda a: (math.acos(a), [1 / math.sqrt(1 - a * a)]),
    ca.OP_ATAN: lambda a: (math.atan(a), [1 / (1 + a * a)]),
    ca.OP_ATAN2: _arctangent,
    ca.OP_SINH: lambda a: (math.sinh(a), [math.cosh(a)]),
    ca.OP_COSH: lambda a: (math.cosh(a), [math.sinh(a)]),
    ca.OP_TANH: lambda a: (math.tanh(a), [1 - math.tanh(a) ** 2]),
    ca.OP_ASINH: lambda a: (math.asinh(a), [1 / math.hypot(a, 1)]),
    ca.OP_ACOSH: lambda a: (math.acosh(a), [1 / math.sqrt(a * a - 1)]),
    ca.OP_ATANH: lambda a: (math.atanh(a), [1 / (1 - a * a)]),
    ca.OP_HYPOT: _hypot,
    ca.OP_FABS: lambda a: (abs(a), [1.0]),
    ca.OP_FMIN: lambda a, b: (min(a, b), [float(a <= b), float(b < a)]),
    ca.OP_FMAX: lambda a, b: (max(a, b), [float(a >= b), float(b > a)]),
    ca.OP_SIGN: lambda a: _piece(math.copysign(1.0, a) if a else 0.0, 1),
    ca.OP_FLOOR: lambda a: _piece(math.floor(a), 1),
    ca.OP_CEIL: lambda a: _piece(math.ceil(a), 1),
    ca.OP_FMOD: lambda a, b: (math.fmod(a, b), [1.0, math.trunc(a / b)]),
    ca.OP_REMAINDER: lambda a, b: (math.remainder(a, b), [1.0, round(a / b)]),
    ca.OP_COPYSIGN: lambda a, b: (math.copysign(a, b), [1.0, 0.0]),
    ca.OP_LT: lambda a, b: _piece(float(a < b), 2),
    ca.OP_LE: lambda a, b: _piece(float(a <= b), 2),
    ca.OP_EQ: lambda a, b: _piece(float(a == b), 2),
    ca.OP_NE: lambda a, b: _piece(float(a != b), 2),
    ca.OP_NOT: lambda a: _piece(float(not a), 1),
    ca.OP_AND: lambda a, b: _piece(float(bool(a) and bool(b)), 2),
    ca.OP_OR: lambda a, b: _piece(float(bool(a) or bool(b)), 2),
    ca.OP_IF_ELSE_ZERO: lambda a, b: (b if a else 0.0, [0.0, float(bool(a))]),
    ca.OP_ERF: lambda a: (math.erf(a), [2 / math.sqrt(math.pi) * math.exp(-a * a)]),
}
