"""Closed forms of integrals from the exact integrable rows: first on the leaves where linear integrals have given values, then everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca

from acausal.explain.integrability.derived import DerivedSystem
from acausal.explain.integrability.frobenius import Growth
from acausal.explain.integrability.integral import Integral, is_integral, source_names
from acausal.explain.integrability.pfaffian import PfaffianSystem
from acausal.explain.integrability.potential import potential, vanishes


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
        function_of = potential(row, leaf.variables)
        if function_of is None:
            continue
        plain = _plain(function_of.subs(leaf.constants)).subs(_charted(derived, names))
        # a logarithm may have come out with an argument that is negative here; its derivative does not mind the sign
        for expression in (plain, plain.replace(sympy.log, lambda a: sympy.log(sympy.Abs(a)))):
            function = _to_sx(expression, names, system.y)
            if function is not None and is_integral(system, growth, function):
                sizes = [sympy.Rational(size) for size in system.sizes] or [sympy.Integer(1)] * len(names)
                labels = {n: sympy.Symbol(label) / s for n, label, s in zip(names, system.coordinate_names, sizes, strict=True)}
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
    # on the leaf some rows follow from others
    left = _eliminated([[row[k] for k in keep] for row in left]) if known else left
    return _Leaf(constants, [own[k] for k in keep], left)


def _eliminated(rows: list[list[Any]]) -> list[list[Any]]:
    """Reduced echelon form with zeros told from values at random points: sines and cosines need no simplification on the way."""
    done: list[list[Any]] = []
    while rows:
        row = rows.pop(0)
        k = next((k for k, entry in enumerate(row) if not vanishes(entry)), None)
        if k is None:
            continue
        row = [entry / row[k] for entry in row]
        rows, done = ([[a - other[k] * b for a, b in zip(other, row, strict=True)] for other in group] for group in (rows, done))
        done.append(row)
    return done


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

    known: dict[Any, Any] = {
        sympy.Abs: ca.fabs, sympy.sin: ca.sin, sympy.cos: ca.cos, sympy.tan: ca.tan, sympy.exp: ca.exp, sympy.log: ca.log,
        sympy.atan: ca.atan, sympy.asin: ca.asin, sympy.acos: ca.acos, sympy.sinh: ca.sinh, sympy.cosh: ca.cosh, sympy.tanh: ca.tanh,
    }  # fmt: skip
    if not all(f.func in known for f in expression.atoms(sympy.Function)):
        return None
    modules = {"sqrt": ca.sqrt} | {function.__name__: own for function, own in known.items()}
    function: Any = sympy.lambdify(list(names), expression, modules=[modules])
    return ca.SX(function(*(y[j] for j in range(y.numel()))))
