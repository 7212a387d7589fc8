"""The derived system of a Pfaffian system, exactly: which combinations of the constraints are rates of positions.

Linear algebra over the field of rational functions; every zero test is an exact identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from acausal.explain.integrability.pfaffian import PfaffianSystem
from acausal.explain.integrability.rational import Chart, NotRational
from acausal.explain.integrability.reading import rational_functions

_MOST_COORDINATES = 7
_MOST_TERMS = 150

Rows = list[list[Any]]
"""Elements of a field of rational functions."""


@dataclass(frozen=True)
class DerivedSystem:
    """`rows`: reduced echelon form of the integrable part, one-forms in dz of `chart`; `growth`: dimensions of the admissible velocities, of these
    with their brackets, of the result with its brackets, ... (the derived flag). `alone`: whether each constraint by itself is integrable.
    """

    chart: Chart
    rows: Rows
    growth: tuple[int, ...]
    alone: tuple[bool, ...]

    @property
    def hidden(self) -> int:
        """Number of functions of position that the velocity constraints keep constant."""
        return len(self.rows)


def derived_system(system: PfaffianSystem) -> DerivedSystem | None:
    """Proven, by repeated derivation until nothing changes; None where the constraints are too large or not rational in a chart."""
    try:
        chart = Chart.of(system.y, system.holonomic, system.start, _MOST_COORDINATES)
        if any(rational_functions(system.holonomic[chart.others], system.y, chart)):
            return None  # a constraint that does not follow from spheres and lines
        m, n = system.forms.shape
        entries = rational_functions(system.forms, system.y, chart)
        slopes = chart.slopes()
        rows = [
            [sum((entries[i + m * j] * slopes[j][k] for j in range(n)), chart.K.zero) for k in range(chart.size)]
            for i in range(m)
        ]
        integrable, growth = _derive(chart, rows)
        return DerivedSystem(chart, integrable, growth, tuple(len(_derive(chart, [row])[1]) == 1 for row in rows))
    except NotRational:
        return None


def _derive(chart: Chart, rows: Rows) -> tuple[Rows, tuple[int, ...]]:
    """The integrable part of these rows, and the dimensions of what they admit, grown by brackets."""
    growth: list[int] = []
    while True:
        rows, pivots = echelon(rows, chart.size)
        growth.append(chart.size - len(rows))
        free = [k for k in range(chart.size) if k not in pivots]
        slopes = [[_along(chart, rows, pivots, i, row[j]) - _along(chart, rows, pivots, j, row[i])
                   for i in free for j in free if i < j] for row in rows]  # fmt: skip
        weights = left_null_space(slopes, chart)
        if len(weights) == len(rows):
            return rows, tuple(growth)
        rows = [
            [sum((w * row[k] for w, row in zip(weight, rows, strict=True)), chart.K.zero) for k in range(chart.size)]
            for weight in weights
        ]


def _along(chart: Chart, rows: Rows, pivots: Sequence[int], i: int, value: Any) -> Any:
    """Derivative along the admissible field whose free entry i is 1."""
    total = value.diff(chart.generators[i])
    for row, p in zip(rows, pivots, strict=True):
        if row[i]:
            total = total - row[i] * value.diff(chart.generators[p])
    return total


def echelon(rows: Rows, size: int) -> tuple[Rows, list[int]]:
    """Reduced row echelon form and its pivot columns; the shortest entry of all is the next pivot. Raises `NotRational` when entries grow large."""
    rest = [list(row) for row in rows]
    done: Rows = []
    pivots: list[int] = []
    while True:
        candidates = [(_terms(row[k]), -k, i) for i, row in enumerate(rest) for k in range(size) if row[k]]
        if not candidates:
            order = sorted(range(len(done)), key=lambda i: pivots[i])
            return [done[i] for i in order], [pivots[i] for i in order]
        if max(candidates)[0] > _MOST_TERMS:
            raise NotRational("expressions grow too large")
        _, k, i = min(candidates)
        k = -k
        pivot = rest.pop(i)
        pivot = [entry / pivot[k] for entry in pivot]
        for group in (rest, done):
            for r, row in enumerate(group):
                if row[k]:
                    group[r] = [a - row[k] * b for a, b in zip(row, pivot, strict=True)]
        done.append(pivot)
        pivots.append(k)


def left_null_space(rows: Rows, chart: Chart) -> Rows:
    """Weights whose combinations of the rows vanish."""
    m = len(rows)
    width = len(rows[0]) if rows else 0
    unit = [[chart.K.one if i == j else chart.K.zero for j in range(m)] for i in range(m)]
    whole, pivots = echelon([[row[k] for row in rows] for k in range(width)], m)
    found: Rows = []
    for free in [k for k in range(m) if k not in pivots]:
        weight = list(unit[free])
        for row, p in zip(whole, pivots, strict=True):
            weight[p] = -row[free]
        found.append(weight)
    return found


def _terms(entry: Any) -> int:
    return len(entry.numer) + len(entry.denom)
