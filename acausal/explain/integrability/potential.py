"""A function from its differential, by sympy: exactness, integrating factors, integration term by term.

A one-form w is exact where dw = 0. Where it is not but w ^ dw = 0, it is scaled so that its coefficient at one coordinate x_p is 1; then a
factor exp(f) with df = sum of (dw_k / dx_p) dx_k makes it exact, if that is closed itself (the factor does not depend on x_p).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

_LONGEST = 200
"""Operations in a row that sympy is given."""


def potential(row: Sequence[Any], variables: Sequence[Any]) -> Any | None:
    """F(variables) with dF proportional to the row of sympy expressions; None where no factor is found or an integral has no closed form."""
    import sympy

    if sum(sympy.count_ops(entry) for entry in row) > _LONGEST:
        return None
    for p, pivot in enumerate(row):
        if vanishes(pivot):
            continue
        scaled = [entry / pivot for entry in row]
        if closed(scaled, variables):
            return _integrated(scaled, variables)
        slopes = [sympy.diff(entry, variables[p]) for entry in scaled]
        factor = _integrated(slopes, variables) if closed(slopes, variables) else None
        if factor is not None:
            exact = [sympy.simplify(sympy.exp(factor) * entry) for entry in scaled]
            if closed(exact, variables):
                return _integrated(exact, variables)
    return None


def closed(row: Sequence[Any], variables: Sequence[Any]) -> bool:
    """Whether the derivative of each entry by the variable of another is that of the other by its own."""
    import sympy

    pairs = [(i, k) for i in range(len(row)) for k in range(i)]
    return all(vanishes(sympy.diff(row[i], variables[k]) - sympy.diff(row[k], variables[i])) for i, k in pairs)


def vanishes(expression: Any) -> bool:
    """Whether it is zero at random points, of either sign: quick, and enough where results are checked."""
    import sympy

    expression = sympy.sympify(expression)
    symbols = sorted(expression.free_symbols, key=str)
    if not symbols:
        return bool(abs(complex(expression)) < 1e-12)
    function: Any = sympy.lambdify(symbols, expression, modules="numpy")
    points = np.random.default_rng(5).uniform(0.3, 1.2, (len(symbols), 4)) * np.array([1, 1, -1, 1])
    # complex: a root or a logarithm of something negative is no reason to stop
    values = np.broadcast_to(function(*points.astype(complex)), 4)
    return bool(np.max(np.abs(values)) < 1e-10)


def _integrated(row: Sequence[Any], variables: Sequence[Any]) -> Any | None:
    """Sum of integrals over one variable after the other, of what is not yet in it."""
    import sympy

    total = sympy.Integer(0)
    for entry, variable in zip(row, variables, strict=True):
        part = _integral(sympy.simplify(entry - sympy.diff(total, variable)), variable)
        if part is None:
            return None
        total = total + part
    return sympy.expand(total)


def _integral(integrand: Any, variable: Any) -> Any | None:
    """By rules; rational functions of a sine and a cosine as such of the tangent of the half angle. Both end by themselves."""
    import sympy
    from sympy.integrals.manualintegrate import manualintegrate
    from sympy.integrals.rationaltools import ratint

    found = manualintegrate(integrand, variable)
    if not found.has(sympy.Integral):
        return found
    u, sine, cosine = sympy.Symbol("u"), sympy.sin(variable), sympy.cos(variable)
    plain = sympy.expand_trig(integrand.rewrite(sympy.tan, sympy.sin).subs(sympy.tan(variable), sine / cosine))
    put = {sine: 2 * u / (1 + u**2), cosine: (1 - u**2) / (1 + u**2)}
    rational = sympy.cancel(plain.subs(put) * 2 / (1 + u**2))
    if rational.has(variable) or not rational.is_rational_function(u):
        return None
    found = ratint(rational, u)
    return None if found.has(sympy.RootSum, sympy.Integral) else found.subs(u, sine / (1 + cosine))
