"""What rounding makes of a function's results."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.instructions import UNARY, Instructions, instructions

_EPS = float(np.finfo(float).eps)
_ENLARGED = 2.0**-40
_SAMPLES = 7
_erf = np.vectorize(math.erf, otypes=[float])

_EXACT: dict[int, Callable[..., np.ndarray]] = {
    ca.OP_ASSIGN: lambda a, _: a, ca.OP_LIFT: lambda a, _: a, ca.OP_NEG: np.negative, ca.OP_TWICE: lambda a: a + a, ca.OP_FABS: np.abs,
    ca.OP_FMIN: np.fmin, ca.OP_FMAX: np.fmax,
}  # fmt: skip
"""Operations without rounding."""
_ROUNDED: dict[int, Callable[..., np.ndarray]] = {
    ca.OP_SQ: np.square, ca.OP_INV: np.reciprocal, ca.OP_SQRT: np.sqrt, ca.OP_EXP: np.exp, ca.OP_LOG: np.log, ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos, ca.OP_TAN: np.tan, ca.OP_ASIN: np.arcsin, ca.OP_ACOS: np.arccos, ca.OP_ATAN: np.arctan, ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh, ca.OP_ASINH: np.arcsinh, ca.OP_ACOSH: np.arccosh, ca.OP_ATANH: np.arctanh,
    ca.OP_LOG1P: np.log1p, ca.OP_EXPM1: np.expm1, ca.OP_ERF: _erf, ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide, ca.OP_POW: np.power, ca.OP_CONSTPOW: np.power, ca.OP_ATAN2: np.arctan2, ca.OP_HYPOT: np.hypot,
    ca.OP_FMOD: np.fmod, ca.OP_REMAINDER: np.remainder,
}  # fmt: skip
_DECISIONS: dict[int, Callable[..., np.ndarray]] = {
    ca.OP_LT: np.less, ca.OP_LE: np.less_equal, ca.OP_EQ: np.equal, ca.OP_NE: np.not_equal, ca.OP_NOT: np.logical_not,
    ca.OP_AND: np.logical_and, ca.OP_OR: np.logical_or, ca.OP_SIGN: np.sign, ca.OP_FLOOR: np.floor, ca.OP_CEIL: np.ceil,
}  # fmt: skip
"""Operations that jump: they are decided by the values without disturbance, so that a jump is never taken for rounding."""


@dataclass(frozen=True)
class Rounding:
    """The size of rounding in each entry of the first result of an SX `function`.

    The function's own operations are carried out on numbers, each result disturbed by a random part of 2^-40, many times what
    rounding does; the spread of the results, made smaller again by as much, is what rounding does to first order. Arguments are
    disturbed too, by rounding and by what is asked for besides. Chaitin-Chatelin and Fraysse, Lectures on Finite Precision Computations.
    """

    function: ca.Function

    @functools.cached_property
    def _instructions(self) -> Instructions:
        return instructions(self.function)

    def __call__(self, t: float, x: np.ndarray, *fixed: np.ndarray, spread: np.ndarray | None = None) -> np.ndarray:
        """Sizes (entries of the result,) at t, x and further arguments that are exact; `spread` (nx,): how uncertain x is besides."""
        size = np.abs(x) if spread is None else np.abs(x) + spread / _EPS
        return self.around((np.array([t]), x, *fixed), (abs(t), size))[1].ravel()

    def around(self, arguments: Sequence[np.ndarray], uncertain: Sequence[np.ndarray | float]) -> tuple[np.ndarray, np.ndarray]:
        """Values and sizes of rounding (entries of the result, k) at k points: `arguments` (n,) or (n, k), of which the first are known to
        rounding of what is `uncertain` (n,) only.
        """
        f = self.function
        draw = np.random.default_rng(1).uniform
        columns: list[np.ndarray] = []
        for k, argument in enumerate(arguments):
            at = argument if argument.ndim == 2 else argument[:, None]
            size = np.reshape(uncertain[k], (-1, 1)) if k < len(uncertain) else np.zeros((at.shape[0], 1))
            shift = _ENLARGED * size * draw(-1.0, 1.0, (at.shape[0], _SAMPLES))
            columns.append(np.concatenate([at[:, None], at[:, None] + shift[:, :, None]], axis=1))
        factors = 1 + _ENLARGED * draw(-1.0, 1.0, (f.n_instructions(), _SAMPLES + 1))
        factors[:, 0] = 1.0
        points = max((column.shape[2] for column in columns), default=1)
        work = np.zeros((f.sz_w() + 1, _SAMPLES + 1, points))
        result = np.zeros((f.nnz_out(0), _SAMPLES + 1, points))
        with np.errstate(all="ignore"):
            table, numbers = self._instructions
            for k, (code, to, one, other) in enumerate(table):
                of = (one,) if code in UNARY else (one, other)
                if code == ca.OP_INPUT:
                    work[to] = columns[one][other]
                elif code == ca.OP_OUTPUT:
                    if to == 0:
                        result[other] = work[one]
                elif code == ca.OP_CONST:
                    work[to] = numbers[k]
                elif code in _ROUNDED:
                    work[to] = _ROUNDED[code](*(work[i] for i in of)) * factors[k][:, None]
                elif code in _EXACT:
                    work[to] = _EXACT[code](*(work[i] for i in of))
                elif code in _DECISIONS:
                    work[to] = _DECISIONS[code](*(work[i][0] for i in of))
                elif code == ca.OP_IF_ELSE_ZERO:
                    work[to] = np.where(work[one][0] != 0, work[other], 0.0)
                elif code == ca.OP_COPYSIGN:
                    work[to] = np.copysign(work[one], work[other][0])
                else:
                    return (nothing := np.full((result.shape[0], points), np.nan)), nothing
            spreads = np.max(np.abs(result[:, 1:] - result[:, :1]), axis=1)
        return result[:, 0], np.where(np.isfinite(spreads), spreads, np.nan) * (_EPS / _ENLARGED)


def rounding_of(
    function: ca.Function, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray, spread: np.ndarray | None = None
) -> np.ndarray:
    """What rounding makes of the results of function(t, x, u, p); `spread` (nx,): what it has made of x besides."""
    return _kept(function)(t, x, u, p, spread=spread)


@functools.lru_cache(maxsize=16)
def _kept(function: ca.Function) -> Rounding:
    return Rounding(function if function.is_a("SXFunction") else function.expand())
