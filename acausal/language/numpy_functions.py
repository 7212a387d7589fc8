"""Numpy's functions of vectors that take expressions, beside the elementary ones; a vector is a column."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ExpressionError
from acausal.language.expression import Expression, Scalar, leaves, sx
from acausal.language.origin import origin
from acausal.language.vectors import cross, norm


def _dot(a: Scalar, b: Scalar) -> Expression:
    x, y = sx(a), sx(b)
    product = ca.dot(x, y) if x.shape == y.shape and x.shape[1] == 1 else x @ y
    return Expression(product, leaves(a, b))


def _sum(a: Scalar) -> Expression:
    return Expression(ca.sum1(ca.vec(sx(a))), leaves(a))


def _where(condition: Scalar, a: Scalar, b: Scalar) -> Expression:
    return Expression(ca.if_else(sx(condition), sx(a), sx(b)), leaves(condition, a, b))


def _clip(a: Scalar, least: Scalar, most: Scalar) -> Expression:
    return Expression(ca.fmin(ca.fmax(sx(a), sx(least)), sx(most)), leaves(a, least, most))


def _joined(parts: Sequence[Scalar]) -> Expression:
    return Expression(ca.vertcat(*(sx(part) for part in parts)), leaves(list(parts)))


def _interp(x: Scalar, points: Sequence[float], values: Sequence[float]) -> Expression:
    p, v = np.asarray(points, dtype=float), np.asarray(values, dtype=float)
    inside = ca.fmin(ca.fmax(sx(x), p[0]), p[-1])
    return Expression(ca.pw_lin(inside, ca.DM(p), ca.DM(v)), leaves(x))


_KNOWN: dict[Any, Callable[..., Expression]] = {
    np.linalg.norm: norm, np.cross: cross, np.dot: _dot, np.vdot: _dot, np.inner: _dot, np.sum: _sum, np.where: _where, np.clip: _clip,
    np.concatenate: _joined, np.hstack: _joined, np.interp: _interp, np.transpose: lambda a: Expression(sx(a).T, leaves(a)),
    np.trace: lambda a: Expression(ca.trace(sx(a)), leaves(a)), np.diag: lambda a: Expression(ca.diag(sx(a)), leaves(a)),
    np.outer: lambda a, b: Expression(ca.vec(sx(a)) @ ca.vec(sx(b)).T, leaves(a, b)),
    np.linalg.inv: lambda a: Expression(ca.inv(ca.densify(sx(a))), leaves(a)), np.linalg.det: lambda a: Expression(ca.det(ca.densify(sx(a))), leaves(a)),
    np.linalg.solve: lambda a, b: Expression(ca.solve(ca.densify(sx(a)), ca.densify(sx(b))), leaves(a, b)),
}  # fmt: skip


def applied(function: Any, arguments: Sequence[Any], options: dict[str, Any]) -> Expression:
    """What a function of numpy makes of expressions. Raises `ExpressionError` for functions and options that are not known here."""
    known = _KNOWN.get(function)
    name = f"numpy.{getattr(function, '__name__', function)}"
    if known is None or options:
        what = f" with {', '.join(options)}=" if known is not None else ""
        raise ExpressionError(
            f"{name}{what} is not defined for symbolic expressions ({origin()}); of vectors ac.dot, ac.cross and ac.norm are, and CasADi's functions."
        )
    try:
        return known(*arguments)
    except (RuntimeError, TypeError, ValueError, NotImplementedError) as error:
        raise ExpressionError(
            f"{name} cannot take {', '.join(map(repr, arguments))} ({origin()}): {str(error).splitlines()[0]}"
        ) from None
