"""Closed forms of integrals from the exact integrable rows, by sympy: exactness, integrating factors, term by term.

A row w is exact where dw = 0. Where it is not but w ^ dw = 0, it is scaled so that its coefficient at one coordinate x_p is 1; then a factor
exp(f) with df = sum of (dw_k / dx_p) dx_k makes it exact, if that is closed itself (the factor does not depend on x_p).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca

from acausal.reduction.integrability.derived import DerivedSystem
from acausal.reduction.integrability.frobenius import Growth
from acausal.reduction.integrability.integral import Integral, is_integral, source_names
from acausal.reduction.integrability.pfaffian import PfaffianSystem

_LONGEST = 200
"""Operations in a row that sympy is given to integrate by rules."""
_SHORT = 40
"""Operations in an integrand that its slower methods are given."""


def closed_forms(
    system: PfaffianSystem, derived: DerivedSystem, growth: Growth, linear: Sequence[Integral]
) -> tuple[Integral, ...]:
    """Integrals beyond the `linear` ones, as many as are found; each is checked at the points of `growth`."""
    import sympy

    names = [sympy.Symbol(f"y{j}", real=True) for j in range(system.y.numel())]
    variables, rows = _rows(derived, names)
    known = [[_fraction(i.coefficients[names.index(v)]) if v in names else sympy.Integer(0) for v in variables]
             for i in linear if i.coefficients is not None]  # fmt: skip
    leaf = _leaf(variables, rows, known)
    found: list[Integral] = []
    for row in leaf.rows:
        potential = _potential(row, leaf.variables)
        if potential is None:
            continue
        plain = _plain(potential.subs(leaf.constants)).subs(_charted(derived, names))
        # a logarithm may have come out with an argument that is negative here; its derivative does not mind the sign
        for expression in (plain, plain.replace(sympy.log, lambda a: sympy.log(sympy.Abs(a)))):
            function = _to_sx(expression, names, system.y)
            if function is not None and is_integral(system, growth, function):
                labels = {name: sympy.Symbol(label) for name, label in zip(names, system.coordinate_names, strict=True)}
                found.append(Integral(function, None, source_names(system, growth, function), str(expression.subs(labels))))
                break
    return tuple(found)


def _rows(derived: DerivedSystem, names: Sequence[Any]) -> tuple[list[Any], list[list[Any]]]:
    """Variables, one for each generator of the chart, and the exact rows in their differentials: angles instead of tangents."""
    import sympy

    chart = derived.chart
    entry_of = {k: j for j, k in chart.z_of.items()}
    on_spheres = {j for sphere in chart.spheres for j in sphere}
    variables = [g.as_expr() if entry_of[k] in on_spheres else names[entry_of[k]] for k, g in enumerate(chart.generators)]
    rows: list[list[Any]] = []
    for exact in derived.rows:
        row: list[Any] = []
        for k, entry in enumerate(exact):
            z = chart.generators[k].as_expr()
            expression = entry.as_expr() * ((1 + z**2) / 2 if entry_of[k] in chart.angles else 1)
            for i, generator in enumerate(chart.generators):
                other = generator.as_expr()
                if entry_of[i] in chart.angles:
                    expression = _of_angle(expression, other, variables[i])
                elif variables[i] != other:
                    expression = expression.subs(other, variables[i])
            row.append(sympy.factor_terms(sympy.cancel(expression)))
        rows.append(row)
    return variables, rows


def _of_angle(expression: Any, z: Any, angle: Any) -> Any:
    """z = tan(angle / 2) put in: z^2 = (1 - cos) / (1 + cos), so what is even in z needs no sine, and what is odd one sine."""
    import sympy

    if not expression.has(z):
        return expression
    square, cosine = sympy.Symbol("square", positive=True), sympy.Symbol("cosine")
    back = expression.subs(z, -z)
    even, odd = sympy.cancel((expression + back) / 2), sympy.cancel((expression - back) / (2 * z))
    even, odd = (
        sympy.cancel(part.subs(z, sympy.sqrt(square)).subs(square, (1 - cosine) / (1 + cosine)))
        for part in (even, odd / (1 + cosine))
    )
    return (even + odd * sympy.sin(angle)).subs(cosine, sympy.cos(angle))


@dataclass(frozen=True)
class _Leaf:
    """Where linear integrals have given values: `constants` (symbol, expression), `put` for the variables that follow, and the rows left."""

    constants: list[tuple[Any, Any]]
    variables: list[Any]
    rows: list[list[Any]]


def _leaf(variables: Sequence[Any], rows: Sequence[Sequence[Any]], known: Sequence[Sequence[Any]]) -> _Leaf:
    """`known`: coefficients of linear integrals by variable, each with one that no other has."""
    import sympy

    left, own = [list(row) for row in rows], list(variables)
    constants: list[tuple[Any, Any]] = []
    for i, coefficients in enumerate(known):
        p = next(
            k for k, c in enumerate(coefficients) if c != 0 and all(other[k] == 0 for other in known if other is not coefficients)
        )
        coefficients = [c / coefficients[p] for c in coefficients]
        constant = sympy.Symbol(f"constant{i}", real=True)
        rest = sum(c * v for k, (c, v) in enumerate(zip(coefficients, variables, strict=True)) if k != p)
        constants.append((constant, variables[p] + rest))
        left = [
            [(e - row[p] * c).subs(variables[p], constant - rest) for e, c in zip(row, coefficients, strict=True)] for row in left
        ]
        own[p] = None
    keep = [k for k, v in enumerate(own) if v is not None]
    if not known:
        return _Leaf(constants, own, left)
    # on the leaf some rows follow from others
    reduced, pivots = sympy.Matrix([[row[k] for k in keep] for row in left]).rref(simplify=True)
    return _Leaf(constants, [own[k] for k in keep], [list(reduced.row(i)) for i in range(len(pivots))])


def _potential(row: Sequence[Any], variables: Sequence[Any]) -> Any | None:
    """F with dF proportional to the row; None where no factor is found or an integral has no closed form."""
    import sympy

    if sum(sympy.count_ops(entry) for entry in row) > _LONGEST:
        return None
    for p, pivot in enumerate(row):
        if pivot == 0:
            continue
        scaled = [sympy.simplify(entry / pivot) for entry in row]
        if _closed(scaled, variables):
            return _integrated(scaled, variables)
        slopes = [sympy.simplify(sympy.diff(entry, variables[p])) for entry in scaled]
        factor = _integrated(slopes, variables) if _closed(slopes, variables) else None
        if factor is not None:
            exact = [sympy.simplify(sympy.exp(factor) * entry) for entry in scaled]
            if _closed(exact, variables):
                return _integrated(exact, variables)
    return None


def _closed(row: Sequence[Any], variables: Sequence[Any]) -> bool:
    import sympy

    pairs = [(i, k) for i in range(len(row)) for k in range(i)]
    return all(sympy.simplify(sympy.diff(row[i], variables[k]) - sympy.diff(row[k], variables[i])) == 0 for i, k in pairs)


def _integrated(row: Sequence[Any], variables: Sequence[Any]) -> Any | None:
    """Sum of integrals over one variable after the other, of what is not yet in it."""
    import sympy
    from sympy.integrals.manualintegrate import manualintegrate

    total = sympy.Integer(0)
    for entry, variable in zip(row, variables, strict=True):
        rest = sympy.simplify(entry - sympy.diff(total, variable))
        part = manualintegrate(rest, variable)
        if part.has(sympy.Integral) and rest.count_ops() < _SHORT:
            part = sympy.integrate(rest, variable)
        if part.has(sympy.Integral):
            return None
        total = total + part
    return sympy.expand(total)


def _charted(derived: DerivedSystem, names: Sequence[Any]) -> dict[Any, Any]:
    """What the generators of spheres are in the coordinates."""
    chart = derived.chart
    return {
        chart.generators[chart.z_of[j]].as_expr(): names[j] / (1 + names[sphere[0]])
        for sphere in chart.spheres
        for j in sphere[1:]
    }


def _fraction(value: float) -> Any:
    import sympy

    short = Fraction(float(value)).limit_denominator(1_000_000)
    return sympy.Rational(short.numerator, short.denominator)


def _plain(expression: Any) -> Any:
    """Without functions that CasADi does not have; |a| becomes a, whose sign does not change along a motion or is checked with the result."""
    import sympy as sp

    swaps: list[tuple[Any, Any]] = [
        (sp.Abs, lambda a: a), (sp.sec, lambda a: 1 / sp.cos(a)), (sp.csc, lambda a: 1 / sp.sin(a)), (sp.cot, lambda a: sp.cos(a) / sp.sin(a))
    ]  # fmt: skip
    for function, plain in swaps:
        expression = expression.replace(function, plain)
    return expression


def _to_sx(expression: Any, names: Sequence[Any], y: ca.SX) -> ca.SX | None:
    """None for a function that CasADi does not have."""
    import sympy

    known: dict[str, Any] = {"Abs": ca.fabs} | {
        name: getattr(ca, name)
        for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "atan", "asin", "acos", "sinh", "cosh", "tanh")
    }
    if not all(type(f).__name__ in known for f in expression.atoms(sympy.Function)):
        return None
    function: Any = sympy.lambdify(list(names), expression, modules=[known])
    return ca.SX(function(*(y[j] for j in range(y.numel()))))
