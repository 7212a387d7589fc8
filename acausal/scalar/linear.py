"""Linear blocks solved in symbols: sparse Gaussian elimination with pivots that cannot vanish, and a small dense rest by QR.

Pivots are numbers first, then expressions of parameters alone; each among the largest entries of its row (columns scaled) at a sample
point, in the row with fewest entries (H. M. Markowitz, The elimination form of the inverse, 1957). Without the condition on size a long
ladder of resistors would be solved by shooting from one end to the other, with errors that grow exponentially. What has no such
pivot (coefficients that change with the motion) is left for CasADi's QR. Entries that cancel at the sample point are zero.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

_LARGE, _SMALL = 0.5, 1e-3
_ZERO = 1e-11


class SingularMatrixError(Exception):
    """The block has no inverse at the sample point: rows and columns of the null vectors."""

    def __init__(self, rows: list[int], columns: list[int]) -> None:
        super().__init__(rows, columns)
        self.rows = rows
        self.columns = columns


@dataclass
class Entry:
    """A coefficient and its value at the sample point; `kind`: 0 a number, 1 constant during a run, 2 changing."""

    value: ca.SX
    sample: float
    kind: int


Row = dict[int, Entry]


def solve_linear(matrix: ca.SX, right: ca.SX, sample: Callable[[list[ca.SX]], list[float]], constants: set[int]) -> list[ca.SX]:
    """x of matrix x = right. `sample`: values of expressions at the sample point; `constants`: hashes of symbols that do not change.

    Raises SingularMatrixError.
    """
    n = right.numel()
    rows = _rows(matrix, sample, constants)
    b = [right[i] for i in range(n)]
    solved: list[tuple[int, int, Row]] = []
    heap = [(len(row), i) for i, row in enumerate(rows)]
    heapq.heapify(heap)
    users: list[set[int]] = [set() for _ in range(n)]
    scale = [1e-300] * n
    for row in rows:
        for j, entry in row.items():
            scale[j] = max(scale[j], abs(entry.sample))
    for i, row in enumerate(rows):
        for j in row:
            users[j].add(i)
    open_rows = set(range(n))
    while heap:
        size, i = heapq.heappop(heap)
        if i not in open_rows or size != len(rows[i]):
            continue
        j = _pivot(rows[i], users, scale)
        if j is None:
            continue
        open_rows.discard(i)
        solved.append((i, j, rows[i]))
        for k in rows[i]:
            users[k].discard(i)
        for other in sorted(users[j]):
            b[other] = _eliminate(rows, i, j, other, users, b)
            heapq.heappush(heap, (len(rows[other]), other))
    x: dict[int, ca.SX] = {}
    if open_rows:
        _solve_rest(rows, sorted(open_rows), sorted(set(range(n)) - {j for _, j, _ in solved}), b, x, matrix, sample)
    for i, j, row in reversed(solved):
        total = b[i]
        for k, entry in row.items():
            if k != j:
                total = total - entry.value * x[k]
        x[j] = total / row[j].value
    return [x[j] for j in range(n)]


def _rows(matrix: ca.SX, sample: Callable[[list[ca.SX]], list[float]], constants: set[int]) -> list[Row]:
    rows: list[Row] = [{} for _ in range(matrix.shape[0])]
    where = list(zip(*matrix.sparsity().get_triplet(), strict=True))
    values = [matrix[i, j] for i, j in where]
    for (i, j), value, number in zip(where, values, sample(values), strict=True):
        if value.is_zero():
            continue
        free = {s.element_hash() for s in ca.symvar(value)}
        kind = 0 if value.is_constant() else 1 if free <= constants else 2
        rows[i][j] = Entry(value, number, kind)
    return rows


def _pivot(row: Row, users: list[set[int]], scale: list[float]) -> int | None:
    sizes = {j: abs(e.sample) / scale[j] for j, e in row.items()}
    largest = max(sizes.values(), default=0.0)
    for threshold in (_LARGE, _SMALL):
        able = [j for j, e in row.items() if e.kind < 2 and sizes[j] >= threshold * largest > 0]
        if able:
            return min(able, key=lambda j: (row[j].kind, len(users[j]), -sizes[j], j))
    return None


def _eliminate(rows: list[Row], i: int, j: int, other: int, users: list[set[int]], b: list[ca.SX]) -> ca.SX:
    """Takes row i off another so that its entry in column j goes; returns the new right-hand side."""
    pivot, target = rows[i][j], rows[other]
    entry = target.pop(j)
    users[j].discard(other)
    factor = Entry(entry.value / pivot.value, entry.sample / pivot.sample, max(entry.kind, pivot.kind))
    for k, e in rows[i].items():
        if k == j:
            continue
        old = target.get(k)
        taken = factor.sample * e.sample
        number = (0.0 if old is None else old.sample) - taken
        if abs(number) <= _ZERO * (abs(taken) + (0.0 if old is None else abs(old.sample))):
            target.pop(k, None)
            users[k].discard(other)
            continue
        value = -(factor.value * e.value) if old is None else old.value - factor.value * e.value
        kind = max(factor.kind, e.kind, 0 if old is None else old.kind)
        target[k] = Entry(value, number, 0 if value.is_constant() else kind)
        users[k].add(other)
    return b[other] - factor.value * b[i]


def _solve_rest(
    rows: list[Row],
    left: list[int],
    columns: list[int],
    b: list[ca.SX],
    x: dict[int, ca.SX],
    matrix: ca.SX,
    sample: Callable[[list[ca.SX]], list[float]],
) -> None:
    place = {j: k for k, j in enumerate(columns)}
    numbers = np.zeros((len(left), len(columns)))
    core = ca.SX(len(left), len(columns))
    for k, i in enumerate(left):
        for j, entry in rows[i].items():
            numbers[k, place[j]] = entry.sample
            core[k, place[j]] = entry.value
    sizes = np.abs(numbers).max(axis=1, initial=0.0)
    if not sizes.all() or np.linalg.matrix_rank(numbers / sizes[:, None], tol=1e-10) < len(left):
        raise SingularMatrixError(*_null_vectors(matrix, sample))
    rest = ca.vertcat(*(b[i] for i in left))
    found = rest / core if len(left) == 1 else ca.solve(core, rest)
    for j, k in place.items():
        x[j] = found[k]


def _null_vectors(matrix: ca.SX, sample: Callable[[list[ca.SX]], list[float]]) -> tuple[list[int], list[int]]:
    """Rows and columns that take part in the null vectors of the matrix at the sample point."""
    where = list(zip(*matrix.sparsity().get_triplet(), strict=True))
    numbers = np.zeros(matrix.shape)
    for (i, j), value in zip(where, sample([matrix[i, j] for i, j in where]), strict=True):
        numbers[i, j] = value
    numbers /= np.maximum(np.abs(numbers).max(axis=1, initial=0.0), 1e-300)[:, None]
    U, s, Vt = np.linalg.svd(numbers)
    null = s < 1e-9 * max(1.0, float(s[0]))
    rows = np.flatnonzero(np.abs(U[:, null]).max(axis=1, initial=0.0) > 1e-6)
    columns = np.flatnonzero(np.abs(Vt[null]).max(axis=0, initial=0.0) > 1e-6)
    return [int(i) for i in rows], [int(j) for j in columns]
