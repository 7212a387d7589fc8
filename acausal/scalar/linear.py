"""Linear blocks solved in symbols: sparse Gaussian elimination with pivots that cannot vanish, and a small dense rest by QR.

Pivots are numbers first, then expressions of parameters alone; each among the largest entries of its row (columns scaled), in the row with
fewest entries (H. M. Markowitz, The elimination form of the inverse, 1957). Without the condition on size a long ladder of resistors would
be solved by shooting from one end to the other, with errors that grow exponentially. A pivot is large at *all* sample points: parameters at
their values, at others, and at the limits that parts allow, so that a resistor may be shorted later. What has no such pivot (coefficients
that change with the motion, or that a parameter can make zero) is left for CasADi's QR, which needs none. Entries that cancel at all points
are zero; those that are zero at the present values only are not.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.elimination import solved_by_qr
from acausal.numerics.thresholds import DEPENDENT
from acausal.numerics.vanishing import equilibrated, equilibrated_rank, equilibration, ranks

_LARGE, _SMALL = 0.5, 1e-3
_ZERO = 1e-11
_GENERAL = 3
"""The first sample points: parameters as they are, and in general position."""
_LARGEST = 60
"""Unknowns of a block for which limits of parameters without a solution are told apart."""
_PART, _MAIN, _SOME = 1e-6, 0.1, float(np.finfo(float).tiny)
"""Parts in the determinant that a pivot has at least, and for which nothing else is asked of it."""
_EXACT = 1e-6
"""What parts of a row or column, which are one in all, may be off by."""
_MOST_BY_QR = 12
"""Rows that QR takes where elimination would also do with pivots that are large at the present values only."""


class SingularMatrixError(Exception):
    """The block has no inverse at the present values: rows and columns of the null vectors."""

    def __init__(self, rows: list[int], columns: list[int]) -> None:
        super().__init__(rows, columns)
        self.rows = rows
        self.columns = columns


@dataclass
class Entry:
    """A coefficient, its values at the sample points (k,), and the sums of the sizes of the terms that went into them.

    `kind`: 0 a number, 1 constant during a run, 2 changing. `known`: whether these values are its own, and not those of any numbers for states of
    whatever size and unit: others are left out where sizes are compared.
    """

    value: ca.SX
    sample: np.ndarray
    size: np.ndarray
    kind: int
    known: bool

    @property
    def vanishes(self) -> bool:
        """Whether its terms cancel wherever they have values."""
        known = np.isfinite(self.sample) & np.isfinite(self.size)
        return bool(known.any() and (np.abs(self.sample) <= _ZERO * self.size)[known].all())


Row = dict[int, Entry]
Sizes = tuple[np.ndarray, np.ndarray]
"""What rows (k, n) and columns (k, n) of a matrix are divided by at the sample points."""
Sample = Callable[[list[ca.SX]], Sequence[float] | np.ndarray]
"""Values of expressions at the sample points (n, k); of the present values of parameters first."""


def solve_linear(
    matrix: ca.SX, right: ca.SX, sample: Sample, constants: set[int], measured: Collection[int] = (), draw: Sample | None = None
) -> list[ca.SX]:
    """x of matrix x = right. `constants`: hashes of symbols that do not change; `measured`: of others whose samples are of their size. `draw`: values at
    the present ones of parameters, with many sizes of what is not known.

    Raises SingularMatrixError.
    """
    n = right.numel()
    rows, sizes = _rows(matrix, sample, constants, constants.union(measured))
    b = [right[i] for i in range(n)]
    solved, open_rows = _triangular(rows, n, b, _MOST_BY_QR, sizes)
    x: dict[int, ca.SX] = {}
    if open_rows:
        _solve_rest(
            rows, sorted(open_rows), sorted(set(range(n)) - {j for _, j, _ in solved}), b, x, matrix, sample, draw or sample
        )
    for i, j, row in reversed(solved):
        total = b[i]
        for k, entry in row.items():
            if k != j:
                total = total - entry.value * x[k]
        x[j] = total / row[j].value
    return [x[j] for j in range(n)]


def dependent_rows(matrix: ca.SX, sample: Sample, constants: set[int]) -> list[dict[int, ca.SX]]:
    """Weights of rows of a matrix (n, m) whose sum is zero, at whatever values of parameters; independent sums."""
    n, m = matrix.shape
    rows, sizes = _rows(matrix, lambda values: np.array(sample(values))[:, :_GENERAL], constants, constants)
    names = ca.SX.sym("row", n)
    sums = ca.vertsplit(names) if n else []
    _, open_rows = _triangular(rows, m, sums, n, sizes)
    found: list[dict[int, ca.SX]] = []
    for i in sorted(open_rows):
        if not rows[i]:
            weights = ca.sparsify(ca.jacobian(sums[i], names))
            found.append({k: weights[0, k] for k in weights.sparsity().get_col()})
    return found


def _triangular(
    rows: list[Row], n: int, b: list[ca.SX], most: int, sizes: Sizes | None
) -> tuple[list[tuple[int, int, Row]], set[int]]:
    """(row, pivot, entries) in the order of elimination, and rows without a pivot; `rows` and right-hand sides `b` change.

    Where more than `most` rows are left pivots that are large at the present values only are taken, too.
    """
    solved: list[tuple[int, int, Row]] = []
    users: list[set[int]] = [set() for _ in range(n)]
    for i, row in enumerate(rows):
        for j in row:
            users[j].add(i)
    scale, inverse = _column_sizes(rows, n), _inverses(rows, n, sizes)
    open_rows = set(range(len(rows)))
    for points in (slice(None), slice(0, 1)):
        if len(open_rows) <= most and points.stop:
            break
        heap = [(len(rows[i]), i) for i in open_rows]
        heapq.heapify(heap)
        while heap:
            size, i = heapq.heappop(heap)
            if i not in open_rows or size != len(rows[i]):
                continue
            j = _pivot(rows[i], users, scale, inverse[:, :, i], points)
            if j is None:
                continue
            open_rows.discard(i)
            solved.append((i, j, rows[i]))
            for k in rows[i]:
                users[k].discard(i)
            for other in sorted(users[j]):
                b[other] = _eliminate(rows, i, j, other, users, b)
                heapq.heappush(heap, (len(rows[other]), other))
    return solved, open_rows


def _rows(matrix: ca.SX, sample: Sample, constants: set[int], measured: set[int]) -> tuple[list[Row], Sizes | None]:
    """Rows at the sample points at which the matrix has an inverse, and what they are divided by there."""
    rows: list[Row] = [{} for _ in range(matrix.shape[0])]
    where = list(zip(*matrix.sparsity().get_triplet(), strict=True))
    values = [matrix[i, j] for i, j in where]
    samples = np.array([np.atleast_1d(numbers) for numbers in sample(values)])
    some, sizes = _regular(where, samples, *matrix.shape)
    for (i, j), value, numbers in zip(where, values, samples[:, some], strict=True):
        if value.is_zero():
            continue
        free = {s.element_hash() for s in ca.symvar(value)}
        kind = 0 if value.is_constant() else 1 if free <= constants else 2
        rows[i][j] = Entry(value, numbers, np.abs(numbers), kind, free <= measured)
    return rows, sizes


def _regular(where: list[tuple[int, int]], samples: np.ndarray, n: int, columns: int) -> tuple[np.ndarray, Sizes | None]:
    """The sample points (k,) at which the matrix (n, n) has an inverse, and the first one, with what its rows and columns are divided by there; all, and
    None, for matrices that are large or not square.
    """
    if n > _LARGEST or n != columns:
        return np.arange(samples.shape[1]), None
    A = np.zeros((samples.shape[1], n, n))
    A[:, *np.transpose(where).reshape(2, -1)] = samples.T
    of_rows, of_columns = equilibration(A)
    regular = ranks(A / of_rows[..., None] / of_columns[..., None, :]) == n
    regular[0] = True
    return np.flatnonzero(regular), (of_rows[regular], of_columns[regular])


def _column_sizes(rows: list[Row], n: int) -> list[np.ndarray]:
    """The largest entry of each column at each point, rows brought to one size; 1 where there is none."""
    found: list[np.ndarray | float] = [0.0] * n
    for row, size in zip(rows, _row_sizes(rows, n), strict=True):
        for j, entry in row.items():
            if entry.known:
                found[j] = np.fmax(found[j], np.abs(entry.sample) / size)
    return [np.where((size > 0) & np.isfinite(size), size, 1.0) for size in found]


def _row_sizes(rows: list[Row], n: int) -> np.ndarray:
    """What is much in each row at each point, so that it does not matter in which units rows and unknowns are written.

    Entries on the way from one row to the others, breadth first, have size 1. Twice, to find a way past those that are zero at some points.
    """
    entries = [[(j, np.abs(e.sample)) for j, e in row.items() if e.known] for row in rows]
    users: list[list[tuple[int, np.ndarray]]] = [[] for _ in range(n)]
    for i, own in enumerate(entries):
        for j, size in own:
            users[j].append((i, size))
    points = next((e.sample.size for row in rows for e in row.values()), 1)
    of_rows, of_columns = np.full((len(rows), points), np.nan), np.full((n, points), np.nan)
    for _ in range(2):
        seen, met = set[int](), set[int]()
        for root in range(len(rows)):
            reached = [] if root in seen else [root]
            seen.add(root)
            of_rows[root] = _filled(of_rows[root], np.ones(points), np.ones(points))
            for i in reached:  # grows on the way
                for j, size in entries[i]:
                    of_columns[j] = _filled(of_columns[j], size, of_rows[i])
                    for k, other in users[j] if j not in met else []:
                        of_rows[k] = _filled(of_rows[k], other, of_columns[j])
                        reached += [] if k in seen else [k]
                        seen.add(k)
                    met.add(j)
    return np.nan_to_num(of_rows, nan=1.0)


def _filled(sizes: np.ndarray, entries: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Those that are missing, so that entries beside `others` have size 1."""
    with np.errstate(all="ignore"):
        new = entries / others
    return np.where(np.isnan(sizes) & (new > 0) & (new < np.inf), new, sizes)


def _inverses(rows: list[Row], n: int, sizes: Sizes | None) -> np.ndarray:
    """Inverses (k, n, n) of the matrix at the points; NaN where there is none, and for matrices that are large, not square, or not known in size.

    What is left of the matrix after some pivots has parts of these as inverses. So an entry times that of the inverse which belongs to it is always the
    part that it has in the determinant, whatever the units. E. H. Bristol, On a new measure of interaction for multivariable process control, IEEE
    Trans. Autom. Control 11 (1966). Where it is small the others grow by this pivot, and digits are lost: an acceleration is found by the inertia
    that is most of what is geared together, not by one that is nothing.
    """
    points = next((e.sample.size for row in rows for e in row.values()), 1)
    found = np.full((points, n, len(rows)), np.nan)
    if sizes is None or not all(entry.known for row in rows for entry in row.values()):
        return found
    A = np.zeros((points, n, n))
    for i, row in enumerate(rows):
        for j, entry in row.items():
            A[:, i, j] = entry.sample
    of_rows, of_columns = sizes
    for k in np.flatnonzero(np.isfinite(A).all(axis=(1, 2))):
        try:
            found[k] = np.linalg.inv(A[k] / of_rows[k][:, None] / of_columns[k]) / of_columns[k][:, None] / of_rows[k]
        except np.linalg.LinAlgError:
            continue
        parts = A[k] * found[k].T
        if not (np.abs(parts.sum(axis=0) - 1) < _EXACT).all() or not (np.abs(parts.sum(axis=1) - 1) < _EXACT).all():
            found[k] = np.nan
    return found


def _pivot(row: Row, users: list[set[int]], scale: list[np.ndarray], inverse: np.ndarray, points: slice) -> int | None:
    """The column of an entry that is large in its row at all of these points and has a part in the determinant; None where there is none.

    `inverse` (k, n): what belongs to the row in the inverse at each point.
    """
    if not row:
        return None
    sizes = {j: np.abs(e.sample[points]) / scale[j][points] for j, e in row.items() if e.known}
    if not sizes:
        return None
    largest = np.max(list(sizes.values()), axis=0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        shares = {j: float(np.min(np.nan_to_num(size / largest))) for j, size in sizes.items()}
        parts = {j: float(np.min(np.nan_to_num(np.abs(row[j].sample * inverse[:, j])[points], nan=1.0))) for j in sizes}
    for share, part in ((_LARGE, _PART), (_SMALL, _PART), (_SOME, _MAIN)):
        able = [j for j in shares if row[j].kind < 2 and shares[j] >= share and parts[j] >= part]
        if able:
            return min(able, key=lambda j: (row[j].kind, len(users[j]), -shares[j], j))
    return None


def _eliminate(rows: list[Row], i: int, j: int, other: int, users: list[set[int]], b: list[ca.SX]) -> ca.SX:
    """Takes row i off another so that its entry in column j goes; returns the new right-hand side."""
    pivot, target = rows[i][j], rows[other]
    entry = target.pop(j)
    users[j].discard(other)
    with np.errstate(all="ignore"):
        ratio = entry.sample / pivot.sample
    factor, kind = entry.value / pivot.value, max(entry.kind, pivot.kind)
    for k, e in rows[i].items():
        if k == j:
            continue
        old = target.get(k)
        with np.errstate(all="ignore"):
            taken, size = ratio * e.sample, np.abs(ratio) * e.size
            number, size = (-taken, size) if old is None else (old.sample - taken, old.size + size)
        value = -(factor * e.value) if old is None else old.value - factor * e.value
        kinds = 0 if value.is_constant() else max(kind, e.kind, 0 if old is None else old.kind)
        known = entry.known and pivot.known and e.known and (old is None or old.known)
        new = Entry(value, number, size, kinds, known)
        if value.is_zero() or new.vanishes:
            target.pop(k, None)
            users[k].discard(other)
            continue
        target[k] = new
        users[k].add(other)
    return b[other] - factor * b[i]


def _solve_rest(
    rows: list[Row],
    left: list[int],
    columns: list[int],
    b: list[ca.SX],
    x: dict[int, ca.SX],
    matrix: ca.SX,
    sample: Sample,
    draw: Sample,
) -> None:
    place = {j: k for k, j in enumerate(columns)}
    numbers = np.zeros((len(left), len(columns)))
    core = ca.SX(len(left), len(columns))
    for k, i in enumerate(left):
        for j, entry in rows[i].items():
            numbers[k, place[j]] = entry.sample[0]
            core[k, place[j]] = entry.value
    if equilibrated_rank(numbers) < len(left):
        null_rows, null_columns = _null_vectors(matrix, sample)
        if null_rows and not _regular_somewhere(matrix, draw):
            raise SingularMatrixError(null_rows, null_columns)
    rest = ca.vertcat(*(b[i] for i in left))
    found = rest / core if len(left) == 1 else solved_by_qr(core, rest)
    for j, k in place.items():
        x[j] = found[k]


def _regular_somewhere(matrix: ca.SX, draw: Sample) -> bool:
    """Whether the matrix has an inverse at one of the points that are drawn: elsewhere some of its terms were too small beside others to be seen."""
    A, where = np.zeros(matrix.shape), list(zip(*matrix.sparsity().get_triplet(), strict=True))
    for values in np.transpose(draw([matrix[i, j] for i, j in where])):
        A[tuple(np.transpose(where))] = values
        if np.isfinite(A).all() and equilibrated_rank(A) == A.shape[0]:
            return True
    return False


def _null_vectors(matrix: ca.SX, sample: Sample) -> tuple[list[int], list[int]]:
    """Rows and columns that take part in the null vectors of the matrix at the present values."""
    where = list(zip(*matrix.sparsity().get_triplet(), strict=True))
    numbers = np.zeros(matrix.shape)
    for (i, j), value in zip(where, sample([matrix[i, j] for i, j in where]), strict=True):
        numbers[i, j] = np.atleast_1d(value)[0]
    U, s, Vt = np.linalg.svd(equilibrated(numbers))
    null = s <= DEPENDENT * s[0]
    rows = np.flatnonzero(np.abs(U[:, null]).max(axis=1, initial=0.0) > 1e-6)
    columns = np.flatnonzero(np.abs(Vt[null]).max(axis=0, initial=0.0) > 1e-6)
    return [int(i) for i in rows], [int(j) for j in columns]
