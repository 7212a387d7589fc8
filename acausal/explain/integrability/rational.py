"""Expressions as exact rational functions: sines and cosines by tangents of half angles, unit quaternions by stereographic projection.

Zero tests in the field of rational functions with rational coefficients are exact: an identity that holds there is proven, one that does
not is refuted. Where an expression has no place in it (an irrational number, a root that is no square, a coordinate both as an angle and as a
length, holonomic constraints that are neither linear nor spheres), `NotRational` says so.
"""

from __future__ import annotations

import math
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
    `others`: holonomic constraints that are neither; whoever uses the chart checks that they follow. `angles`: entries whose generator is the tangent of half the entry; found while expressions are read.
    """

    K: Any
    generators: list[Any]
    z_of: dict[int, int]
    spheres: list[list[int]]
    dependent: dict[int, Linear]
    start: np.ndarray
    others: list[int]
    angles: set[int] = field(default_factory=set)
    lengths: set[int] = field(default_factory=set)

    @classmethod
    def of(cls, y: ca.SX, holonomic: ca.SX, start: np.ndarray, most: int) -> Chart:
        """Of holonomic constraints that are spheres, or linear with short fractions; the numbers of all `others` are kept.

        Raises `NotRational` where spheres and lines meet, and for more than `most` coordinates.
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
        return cls(K, generators, {j: k for k, j in enumerate(own)}, spheres, dependent, np.array(start, dtype=float), others)

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
