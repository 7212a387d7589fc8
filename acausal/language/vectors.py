"""Products and lengths of vectors, of numbers and of what a scene makes of them."""

from __future__ import annotations

import casadi as ca

from acausal.errors import ExpressionError
from acausal.language.expression import Expression, Scalar, leaves, sx
from acausal.language.origin import origin

_LEAST = 1e-300
"""Added to squares of lengths, where it changes nothing but the slope at zero, which is 0 / 0 otherwise."""


def dot(a: Scalar, b: Scalar) -> Expression:
    """a . b, scalar, of two vectors of one length (n,). Raises `ExpressionError` for others."""
    x, y = _columns("dot", a, b)
    return Expression(ca.dot(x, y), leaves(a, b))


def cross(a: Scalar, b: Scalar) -> Expression:
    """a x b, (3, 1), of two vectors (3,) in the same axes. Raises `ExpressionError` for others."""
    x, y = _columns("cross", a, b)
    if x.numel() != 3:
        raise ExpressionError(f"ac.cross takes vectors of three, not of {x.numel()} ({origin()}).")
    return Expression(ca.cross(x, y), leaves(a, b))


def norm(a: Scalar) -> Expression:
    """|a|, scalar, of a vector (n,): its length. At zero its slope is 0 and not, as that of CasADi's `norm_2`, 0 / 0."""
    (x,) = _columns("norm", a)
    return Expression(ca.sqrt(ca.sumsqr(x) + _LEAST), leaves(a))


def _columns(name: str, *values: Scalar) -> list[ca.SX]:
    """As columns of one length."""
    entries = [sx(value) for value in values]
    shapes = {entry.shape for entry in entries}
    columns = [entry.T if entry.shape[0] == 1 else entry for entry in entries]
    if any(column.shape[1] != 1 for column in columns) or len({column.shape for column in columns}) > 1:
        raise ExpressionError(
            f"ac.{name} takes vectors of one length, not of shape {' and '.join(map(str, sorted(shapes)))} ({origin()}). "
            "Take a column of a matrix, R[:, 0], or list the entries, (x, y, z)."
        )
    return [ca.densify(column) for column in columns]
