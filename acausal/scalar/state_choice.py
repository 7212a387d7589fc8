"""Which variables a constraint determines: dummy derivatives, chosen once by the size of constant coefficients, rows and columns brought to one size.

S. E. Mattsson & G. Soderlind, Index reduction in differential-algebraic equations using dummy derivatives, SIAM J. Sci. Comput. 14
(1993). Where the coefficients of a constraint are constant, an unknown and its derivatives are solved from it and are no states.
Where they change with the motion no choice is good for ever: then all its variables stay states, and the constraint and its lower
derivatives are invariants, kept by projection as for loops of joints (Hairer & Wanner II, VII.2).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from acausal.graphs import Graph
from acausal.numerics.vanishing import equilibration

Entries = Mapping[int, float | None]
"""Unknown -> coefficient of its highest derivative; None where it changes with the motion."""


def choose_dummies(
    entries: Mapping[int, Entries], counts: Sequence[int], outer: set[int], preference: Callable[[int], tuple[float, ...]]
) -> dict[int, int]:
    """Equation -> the unknown that it determines with as many derivatives as the equation has; other equations are invariants.

    `entries`: of the equations that are differentiated. `outer`: unknowns that stay states. `preference`: small for unknowns that
    are wanted as states.
    """
    changing = {j for row in entries.values() for j, a in row.items() if a is None}
    rows = {
        i: {j: a for j, a in row.items() if a is not None and j not in changing and j not in outer and a != 0}
        for i, row in entries.items()
    }
    usual = _usual(rows)
    pivots: dict[int, int] = {}
    order: list[tuple[int, dict[int, float]]] = []
    chosen: dict[int, int] = {}
    for i in sorted(rows, key=lambda i: (-counts[i], len(rows[i]), i)):
        row = _reduced(rows[i], pivots, order)
        if not row:
            continue
        sizes = {j: abs(a) / usual[j] for j, a in row.items()}
        largest = max(sizes.values())
        j = max((j for j in row if sizes[j] >= 0.1 * largest), key=preference)
        pivots[j] = len(order)
        order.append((j, row))
        chosen[i] = j
    return chosen


def _usual(rows: Mapping[int, Mapping[int, float]]) -> dict[int, float]:
    """What is much for the coefficients of each unknown, beside those of others in the same rows: whatever the units of rows and unknowns."""
    found: dict[int, float] = {}
    links = [((i, 0), (j, 1)) for i, row in rows.items() for j in row]
    for part in Graph([], links).parts():
        at = {j: k for k, j in enumerate(sorted(j for j, side in part if side))}
        A = np.zeros((len(part) - len(at), len(at)))
        for own, i in zip(A, sorted(i for i, side in part if not side), strict=True):
            own[[at[j] for j in rows[i]]] = [*rows[i].values()]
        found.update(zip(at, equilibration(A)[1].tolist(), strict=True))
    return found


def _reduced(row: dict[int, float], pivots: Mapping[int, int], order: list[tuple[int, dict[int, float]]]) -> dict[int, float]:
    """The row less multiples of earlier ones, without their pivots."""
    row = dict(row)
    sizes = {j: abs(a) for j, a in row.items()}
    todo = [pivots[j] for j in row if j in pivots]
    heapq.heapify(todo)
    while todo:
        pivot, other = order[heapq.heappop(todo)]
        if pivot not in row:
            continue
        factor = -row[pivot] / other[pivot]
        for j, a in other.items():
            if j not in row and j in pivots and j != pivot:
                heapq.heappush(todo, pivots[j])
            sizes[j] = max(sizes.get(j, 0.0), abs(factor * a))
            total = row.get(j, 0.0) + factor * a
            if j == pivot or abs(total) <= 1e-12 * sizes[j]:
                row.pop(j, None)
            else:
                row[j] = total
    return row
