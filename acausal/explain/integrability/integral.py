"""Integrals: functions of position that velocity constraints keep constant, in closed form where one is found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import casadi as ca
import numpy as np

from acausal.explain.integrability.frobenius import Growth
from acausal.explain.integrability.pfaffian import PfaffianSystem, common, row_space

_ZERO = 1e-10


@dataclass(frozen=True, repr=False, eq=False)
class Integral:
    """expression = constant along every motion that the rows `names` admit.

    `expression`: (1, 1) in the coordinates y. `coefficients` (n,): of y, where it is linear, else None. `text`: with the coordinates' names.
    `names`: the velocity constraints that it follows from. `fixed_parameters`: it holds for the values of parameters that it was found with;
    otherwise for all.
    """

    expression: ca.SX
    coefficients: np.ndarray | None
    names: tuple[str, ...]
    text: str
    fixed_parameters: bool = False

    def __str__(self) -> str:
        return f"{self.text} = constant"

    __repr__ = __str__


def linear_integral(system: PfaffianSystem, coefficients: np.ndarray, names: Sequence[str]) -> Integral:
    """Sum of coefficients (n,) times coordinates, the largest made 1."""
    row = coefficients / coefficients[int(np.argmax(np.abs(coefficients) > 0.999 * np.max(np.abs(coefficients))))]
    terms = [(float(c), name) for c, name in zip(row, system.coordinate_names, strict=True) if c]
    expression = sum((float(c) * system.y[j] for j, c in enumerate(row) if c), ca.SX(0))
    return Integral(expression, row, tuple(names), _sum_of(sorted(terms, key=lambda term: term[0] != 1)))


def _sum_of(terms: Sequence[tuple[float, str]]) -> str:
    text = ""
    for c, name in terms:
        size = f"{abs(c):.12g} " if abs(abs(c) - 1) > 1e-12 else ""
        text += f" {'-' if c < 0 else '+'} {size}{name}" if text else f"{'-' if c < 0 else ''}{size}{name}"
    return text


def linear_integrals(system: PfaffianSystem, growth: Growth) -> tuple[Integral, ...]:
    """All integrals that are linear in the coordinates, those of holonomic constraints left out.

    Their gradients are the same everywhere: what is forbidden at all points alike.
    """
    numbers = system.numbers()
    known = common([numbers(point)[0] for point in growth.points])
    rows = _echelon(growth.linear, known)
    sources = [source_names(system, growth, ca.dot(ca.DM(row), system.y)) for row in rows]
    return tuple(linear_integral(system, row, names) for row, names in zip(rows, sources, strict=True))


def straightened(system: PfaffianSystem, growth: Growth) -> PfaffianSystem:
    """With the linear relations that follow from the holonomic constraints added to them, where their coefficients are short fractions.

    Wheels under one frame do not lean: what says so in sines and roots is a plane in the coordinates. Only for the exact test, which
    proves that what it reads is the same manifold.
    """
    numbers = system.numbers()
    rows = _echelon(common([numbers(point)[0] for point in growth.points]), np.zeros((0, system.y.numel())))
    lines: list[ca.SX] = []
    for row in rows:
        offsets = np.array([row @ point for point in growth.points])
        numbers_of_row = np.append(row, offsets[0])
        short = np.array([float(Fraction(float(c)).limit_denominator(1000)) for c in numbers_of_row])
        if np.ptp(offsets) < _ZERO and np.max(np.abs(short - numbers_of_row)) < _ZERO:
            lines.append(ca.dot(ca.DM(short[:-1]), system.y) - float(short[-1]))
    return replace(system, holonomic=ca.densify(ca.vertcat(system.holonomic, *lines)))


def _echelon(rows: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The rows with as many zeros as elimination gives; multiples of `known` ones may be added, which only restate holonomic constraints."""
    both = np.vstack([known, rows])
    pivots: list[int] = []
    for i in range(both.shape[0]):
        # a known row takes its pivot first, so that its coordinate goes from the others
        j = int(np.argmax(np.abs(both[i]) > 0.999 * np.max(np.abs(both[i]))))
        both[i] /= both[i, j]
        for k in range(both.shape[0]):
            if k != i:
                both[k] -= both[k, j] * both[i]
        both[np.abs(both) < _ZERO] = 0.0
        pivots.append(j)
    return both[known.shape[0] :]


def source_names(system: PfaffianSystem, growth: Growth, expression: ca.SX) -> tuple[str, ...]:
    """The rows whose combination, with holonomic ones, is the gradient of an integral."""
    dc, W, _ = system.numbers()(growth.points[0])
    gradient = np.array(_gradient(system, expression)(growth.points[0])).ravel()
    rows = list(growth.independent)
    weights = np.linalg.lstsq(np.vstack([W[rows], row_space(dc)]).T, gradient, rcond=None)[0][: len(rows)]
    return tuple(system.names[i] for i, w in zip(rows, weights, strict=True) if abs(w) > 1e-9 * np.max(np.abs(weights)))


def is_integral(system: PfaffianSystem, growth: Growth, expression: ca.SX) -> bool:
    """Whether the expression's gradient is among the forbidden directions at all points."""
    gradient = _gradient(system, expression)
    for point, forbidden in zip(growth.points, growth.forbidden, strict=True):
        row = np.array(gradient(point)).ravel()
        if not np.all(np.isfinite(row)) or np.linalg.norm(row - (row @ forbidden.T) @ forbidden) > 1e-8 * np.linalg.norm(row):
            return False
    return True


def _gradient(system: PfaffianSystem, expression: ca.SX) -> ca.Function:
    return ca.Function("gradient", [system.y], [ca.densify(ca.jacobian(expression, system.y))])
