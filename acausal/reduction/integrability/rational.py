"""Expressions as exact rational functions: sines and cosines by tangents of half angles, unit quaternions by stereographic projection.

Zero tests in the field of rational functions with rational coefficients are exact: an identity that holds there is proven, one that does
not is refuted. Where an expression has no place in it (an irrational number, a root that is no square, a coordinate both as an angle and as a
length, holonomic constraints that are neither linear nor spheres), `NotRational` says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

_LARGEST_DENOMINATOR = 100_000


class NotRational(Exception):
    """An expression is not a rational function in the chart; only raised and caught in this package."""


def rational(value: float) -> Fraction:
    """The short fraction that a number of 53 bits stands for. Raises `NotRational` where there is none."""
    found = Fraction(value).limit_denominator(_LARGEST_DENOMINATOR)
    if not math.isfinite(value) or abs(float(found) - value) > 4e-16 * abs(value):
        raise NotRational(f"{value!r} is no short fraction")
    return found


@dataclass(frozen=True)
class Linear:
    """constant + sum of coefficients times coordinates: what an angle may be made of."""

    terms: dict[int, Fraction]
    constant: Fraction = Fraction(0)

    def plus(self, other: Linear, factor: Fraction = Fraction(1)) -> Linear:
        """self + factor other."""
        terms = dict(self.terms)
        for k, value in other.terms.items():
            terms[k] = terms.get(k, Fraction(0)) + factor * value
        return Linear({k: value for k, value in terms.items() if value}, self.constant + factor * other.constant)

    def times(self, factor: Fraction) -> Linear:
        """factor self."""
        return Linear({}).plus(self, factor)


@dataclass
class Chart:
    """Coordinates z of the manifold: `generators` of a field `K` of rational functions.

    `spheres`: entries of y that are unit vectors; the first one's pole is left out. `dependent`: entries that follow linearly from others.
    `z_of` numbers the generators: those of plain coordinates and angles by their entry of y, those of spheres by all entries but the first.
    `angles`: entries whose generator is the tangent of half the entry; found while expressions are read.
    """

    K: Any
    generators: list[Any]
    z_of: dict[int, int]
    spheres: list[list[int]]
    dependent: dict[int, Linear]
    start: np.ndarray
    angles: set[int] = field(default_factory=set)
    lengths: set[int] = field(default_factory=set)

    @classmethod
    def of(cls, y: ca.SX, holonomic: ca.SX, start: np.ndarray, most: int) -> Chart:
        """Raises `NotRational` where holonomic constraints are neither spheres nor linear with short fractions, nor follow from those, and for
        more than `most` coordinates.
        """
        from sympy.polys.domains import QQ
        from sympy.polys.fields import field as function_field

        n = y.numel()
        spheres, linear, others = _spheres_and_lines(y, holonomic)
        dependent = _solved(linear)
        left_out = {sphere[0] for sphere in spheres} | set(dependent)
        own = [j for j in range(n) if j not in left_out]
        if len(own) > most:
            raise NotRational(f"there are {len(own)} coordinates")
        K, *generators = function_field([f"z{j}" for j in own], QQ)
        chart = cls(K, generators, {j: k for k, j in enumerate(own)}, spheres, dependent, np.array(start, dtype=float))
        if others and any(rational_functions(holonomic[others], y, chart)):
            raise NotRational("a holonomic constraint is neither linear nor a sphere")
        return chart

    @property
    def size(self) -> int:
        """Dimension of the manifold."""
        return len(self.generators)

    def coordinate(self, j: int) -> Any:
        """Entry j of y: a rational function on a sphere, else linear."""
        if j in self.dependent:
            return self.dependent[j]
        for sphere in self.spheres:
            if j in sphere:
                s = [self.generators[self.z_of[k]] for k in sphere[1:]]
                square = sum((a * a for a in s), self.K.zero)
                return (1 - square) / (1 + square) if j == sphere[0] else 2 * self.generators[self.z_of[j]] / (1 + square)
        return Linear({j: Fraction(1)})

    def element(self, value: Any) -> Any:
        """As a rational function; coordinates in it are lengths from now on."""
        if not isinstance(value, Linear):
            return value
        self.lengths |= set(value.terms)
        terms = (self._number(c) * self.generators[self.z_of[j]] for j, c in value.terms.items())
        return sum(terms, self._number(value.constant))

    def _number(self, value: Fraction) -> Any:
        from sympy.polys.domains import QQ

        return self.K(QQ(value.numerator, value.denominator))

    def turn(self, value: Any) -> tuple[Any, Any]:
        """Cosine and sine of a sum of whole multiples of coordinates, which are angles from now on."""
        if not isinstance(value, Linear) or value.constant or any(c.denominator != 1 for c in value.terms.values()):
            raise NotRational("an angle is not a sum of whole multiples of coordinates")
        self.angles |= set(value.terms)
        c, s = self.K.one, self.K.zero
        for j, count in value.terms.items():
            u = self.generators[self.z_of[j]]
            c1, s1 = (1 - u * u) / (1 + u * u), 2 * u / (1 + u * u)
            for _ in range(abs(int(count))):
                c, s = (c * c1 - s * s1, s * c1 + c * s1) if count > 0 else (c * c1 + s * s1, s * c1 - c * s1)
        return c, s

    def check(self) -> None:
        """Raises `NotRational` for a coordinate that is used both as an angle and as a length."""
        if self.angles & self.lengths:
            raise NotRational("a coordinate is an angle and a length at once")

    def z_start(self) -> np.ndarray:
        """The generators' values at the start."""
        z = np.zeros(self.size)
        for j, k in self.z_of.items():
            sphere = next((s for s in self.spheres if j in s), None)
            z[k] = (
                self.start[j] / (1 + self.start[sphere[0]])
                if sphere
                else np.tan(self.start[j] / 2)
                if j in self.angles
                else self.start[j]
            )
        return z

    def slopes(self) -> list[list[Any]]:
        """dy_i / dz_k (n, size) in the field."""
        rows: list[list[Any]] = []
        for j in range(self.start.size):
            value = self.coordinate(j)
            if isinstance(value, Linear):
                row = [self.K.zero] * self.size
                for i, c in value.terms.items():
                    u = self.generators[self.z_of[i]]
                    row[self.z_of[i]] = self._number(c) * (2 / (1 + u * u) if i in self.angles else self.K.one)
            else:
                row = [value.diff(z) for z in self.generators]
            rows.append(row)
        return rows


def _spheres_and_lines(y: ca.SX, holonomic: ca.SX) -> tuple[list[list[int]], list[tuple[list[Fraction], Fraction]], list[int]]:
    """Members of each sphere; coefficients and constant of each linear constraint; numbers of the other constraints."""
    spheres: list[list[int]] = []
    others: list[int] = []
    lines: list[tuple[list[Fraction], Fraction]] = []
    for k in range(holonomic.numel()):
        hessian, slope = ca.hessian(holonomic[k], y)
        if ca.depends_on(hessian, y):
            others.append(k)
            continue
        zero = [ca.substitute(part, y, ca.SX.zeros(y.numel())) for part in (hessian, slope, holonomic[k])]
        H, g, c = (np.array(ca.DM(ca.evalf(ca.densify(part)))) for part in zero)
        if not np.any(H):
            lines.append(([rational(float(a)) for a in g[:, 0]], rational(float(c[0, 0]))))
            continue
        members = [int(i) for i in np.flatnonzero(np.diag(H))]
        scale = H[members[0], members[0]] if members else 0.0
        wanted = np.zeros_like(H)
        wanted[members, members] = scale
        if np.any(g) or scale == 0 or not np.array_equal(H, wanted) or abs(c[0, 0] + scale / 2) > 1e-15 * abs(scale):
            raise NotRational("a holonomic constraint is neither linear nor a sphere")
        spheres.append(members)
    if len({j for s in spheres for j in s}) != sum(len(s) for s in spheres):
        raise NotRational("spheres share coordinates")
    if any(row[j] for row, _ in lines for s in spheres for j in s):
        raise NotRational("a linear constraint meets a sphere")
    return spheres, lines, others


def _solved(lines: list[tuple[list[Fraction], Fraction]]) -> dict[int, Linear]:
    """Entries that follow from the others, by elimination; the entry with the smallest coefficient goes, so that multiples stay whole."""
    found: dict[int, Linear] = {}
    for coefficients, constant in lines:
        row = Linear({}, constant)
        for j, c in enumerate(coefficients):
            row = row.plus(found.get(j, Linear({j: Fraction(1)})), c)
        if not row.terms:
            continue
        pivot = min(row.terms, key=lambda j: abs(row.terms[j]))
        rest = Linear({j: c for j, c in row.terms.items() if j != pivot}, row.constant).times(-1 / row.terms[pivot])
        for j, old in found.items():
            if pivot in old.terms:
                c = old.terms[pivot]
                found[j] = Linear({i: d for i, d in old.terms.items() if i != pivot}, old.constant).plus(rest, c)
        found[pivot] = rest
    return found


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
