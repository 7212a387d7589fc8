"""Equations that follow from others but for lower derivatives: constraints that the structure alone does not show.

In a loop of capacitors that is not grounded, u1 = a - b, u2 = b - c, u3 = c - a determine a, b, c by structure, but not by
number: their sum is the constraint u1 + u2 + u3 = 0. Sparse Gaussian elimination over the equations with numeric coefficients
finds such sums; each replaces one equation. Modelica compilers treat equations with integer coefficients in the same way, to keep
Pantelides' algorithm from being misled (e.g. Otter & Elmqvist, Modelica 2017, Transformation of DAEs to index 1 form, sec. 3).
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from dataclasses import dataclass, field

from acausal.scalar.affine import Affine
from acausal.scalar.chains import Level

_ZERO = 1e-12
Row = dict[Level, float]


@dataclass
class Elimination:
    """Rows while they are eliminated; `steps` are (row, pivot row, factor): factor times the pivot row was added."""

    rows: dict[int, Row]
    sizes: dict[int, Row] = field(default_factory=dict)
    """The largest numbers that went into each entry."""
    users: dict[Level, set[int]] = field(default_factory=dict)
    steps: list[tuple[int, int, float]] = field(default_factory=list)

    def run(self) -> list[int]:
        """Numbers of the rows of which nothing is left. Fewest entries first, pivots by size, which keeps the numbers from growing."""
        scale: Row = {}
        for k, row in self.rows.items():
            self.sizes[k] = {level: abs(a) for level, a in row.items()}
            for level, a in row.items():
                self.users.setdefault(level, set()).add(k)
                scale[level] = max(scale.get(level, 0.0), abs(a))
        heap = [(len(row), k) for k, row in self.rows.items()]
        heapq.heapify(heap)
        done: set[int] = set()
        empty: list[int] = []
        while heap:
            size, k = heapq.heappop(heap)
            row = self.rows[k]
            if k in done or size != len(row):
                continue
            done.add(k)
            if not row:
                empty.append(k)
                continue
            largest = max(abs(a) / scale[level] for level, a in row.items())
            able = (level for level, a in row.items() if abs(a) / scale[level] >= 0.5 * largest)
            pivot = min(able, key=lambda level: (len(self.users[level]), -abs(row[level]) / scale[level], level))
            for level in row:
                self.users[level].discard(k)
            for other in sorted(self.users[pivot]):
                self._add(other, k, pivot)
                heapq.heappush(heap, (len(self.rows[other]), other))
        return empty

    def _add(self, other: int, k: int, pivot: Level) -> None:
        row, sizes, source = self.rows[other], self.sizes[other], self.rows[k]
        factor = -row[pivot] / source[pivot]
        self.steps.append((other, k, factor))
        for level, a in source.items():
            sizes[level] = max(sizes.get(level, 0.0), abs(factor) * self.sizes[k][level])
            total = row.get(level, 0.0) + factor * a
            if level == pivot or abs(total) <= _ZERO * sizes[level]:
                row.pop(level, None)
                self.users[level].discard(other)
            else:
                row[level] = total
                self.users[level].add(other)

    def weights(self, k: int) -> dict[int, float]:
        """How often each equation is in what row k has become."""
        found = {k: 1.0}
        for target, source, factor in reversed(self.steps):
            if target in found:
                found[source] = found.get(source, 0.0) + factor * found[target]
        return found


def replace_dependent(equations: Mapping[int, Affine], highest: Mapping[int, int]) -> dict[int, Affine]:
    """New versions of equations of which a combination holds no highest derivative. `highest`: root -> highest order in use."""
    rows = {k: {lv: a for lv, a in e.coefficients.items() if highest[lv[0]] == lv[1]} for k, e in equations.items()}
    elimination = Elimination({k: row for k, row in rows.items() if row})
    replaced: dict[int, Affine] = {}
    for k in elimination.run():
        total = Affine({}, 0.0, 0.0)
        for other, weight in sorted(elimination.weights(k).items()):
            total.add_multiple(equations[other], weight)
        for level in [lv for lv in total.coefficients if highest[lv[0]] == lv[1]]:
            del total.coefficients[level]  # rounding
        replaced[k] = total
    return replaced
