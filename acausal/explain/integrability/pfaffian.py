"""Pfaffian systems: constraints that are linear in velocities, as one-forms on a manifold of configurations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.errors import AssemblyError, ModelError
from acausal.numerics.assembly import Residual, assemble
from acausal.numerics.thresholds import DEPENDENT

_SAMPLES = 3
_TRIES = 40


@dataclass(frozen=True, repr=False)
class PfaffianSystem:
    """holonomic(y) = 0 and forms(y) y' = 0.

    `y` (n, 1): coordinates, the time last where it enters (`timed`), so that a rheonomic constraint is one like any other.
    `holonomic` (c, 1): functions of y. `forms` (m, n). `coordinate_names` (n) and `names` (m). `start` (n,): where to look for points
    with holonomic = 0. `sizes` (n): what the coordinates were divided by, so that all are about 1; none where they were not. Raises `ModelError` for shapes that do not fit and symbols that are not among y.
    """

    y: ca.SX
    holonomic: ca.SX
    forms: ca.SX
    coordinate_names: tuple[str, ...]
    names: tuple[str, ...]
    start: np.ndarray
    timed: bool = False
    sizes: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        n, m = self.y.numel(), len(self.names)
        if self.forms.shape != (m, n) or len(self.coordinate_names) != n or self.start.shape != (n,):
            raise ModelError(
                f"A system of {m} named rows in {n} coordinates needs forms of shape ({m}, {n}), {n} coordinate names and a start of shape ({n},); "
                f"given are {self.forms.shape}, {len(self.coordinate_names)} names and {self.start.shape}."
            )
        own = {self.y[i].element_hash() for i in range(n)}
        foreign = [s for s in ca.symvar(ca.vertcat(self.holonomic, ca.vec(self.forms))) if s.element_hash() not in own]
        if foreign:
            raise ModelError(
                f"{', '.join(s.name() for s in foreign[:4])} stand in the constraints {', '.join(self.names[:4])} but are not among the coordinates "
                f"{', '.join(self.coordinate_names[:8])}. Add them, or put numbers in."
            )

    def __str__(self) -> str:
        rows = [
            f"{len(self.names)} velocity constraints, {self.holonomic.numel()} holonomic ones, {self.y.numel()} coordinates: {', '.join(self.coordinate_names)}"
        ]
        for i, name in enumerate(self.names):
            terms = [f"({self.forms[i, j]}) d{self.coordinate_names[j]}" for j in _used(self.forms[i, :])]
            rows.append(f"  {name}: {' + '.join(terms) or '0'} = 0")
        return "\n".join(rows)

    def restricted(self, rows: Sequence[int]) -> PfaffianSystem:
        """The same manifold with only these velocity constraints."""
        chosen = list(rows)
        return PfaffianSystem(
            self.y, self.holonomic, self.forms[chosen, :], self.coordinate_names, tuple(self.names[i] for i in chosen), self.start, self.timed,
            self.sizes,
        )  # fmt: skip

    def measured(self, sizes: np.ndarray) -> PfaffianSystem:
        """The same in coordinates y / sizes (n,), rows divided by their largest entry near the start: ranks then meet no units."""
        plain = self.y * ca.SX(ca.DM(sizes))
        holonomic, forms = ca.substitute([self.holonomic, self.forms @ ca.diag(ca.SX(ca.DM(sizes)))], [self.y], [plain])
        start = self.start / sizes
        beside = start + np.random.default_rng(1).uniform(0.1, 0.4, start.size)
        rows = np.array(ca.Function("rows", [self.y], [ca.densify(forms)])(beside)).reshape(forms.shape)
        slope = ca.jacobian(holonomic, self.y)
        slopes = np.array(ca.Function("slopes", [self.y], [ca.densify(slope)])(beside)).reshape(slope.shape)
        return PfaffianSystem(
            self.y, _divided(holonomic, slopes), ca.sparsify(_divided(forms, rows)), self.coordinate_names, self.names, start, self.timed,
            tuple(sizes.tolist()),
        )  # fmt: skip

    def seen_plain(self, expression: ca.SX) -> ca.SX:
        """An expression in these coordinates, in the ones before they were divided."""
        return ca.substitute(expression, self.y, self.y / ca.SX(ca.DM(self.sizes))) if self.sizes else expression

    def seen_measured(self, expression: ca.SX) -> ca.SX:
        """The way back."""
        return ca.substitute(expression, self.y, self.y * ca.SX(ca.DM(self.sizes))) if self.sizes else expression

    def blocks(self) -> Iterator[tuple[tuple[int, ...], PfaffianSystem]]:
        """Parts that share no coordinate, each with at least one velocity constraint; and which constraints of the whole they hold.

        Coordinates that no velocity constraint reaches, not even through holonomic ones, are in none; the time may be in several.
        """
        c, last = self.holonomic.numel(), self.y.numel() - 1
        place = {self.y[i].element_hash(): i for i in range(self.y.numel())}
        slopes = ca.jacobian(self.holonomic, self.y)
        members = [set(_used(slopes[k, :])) for k in range(c)]
        for i in range(len(self.names)):
            row = self.forms[i, :]
            members.append(set(_used(row)) | {place[s.element_hash()] for s in ca.symvar(row)})
        clock = {last} if self.timed else set[int]()
        for group in _connected([m - clock for m in members]):
            rows = tuple(k - c for k in group if k >= c)
            if rows and any(members[k] for k in group):
                own = sorted(set[int]().union(*(members[k] for k in group)))
                yield rows, PfaffianSystem(
                    self.y[own], self.holonomic[[k for k in group if k < c], :], self.forms[list(rows), own],
                    tuple(self.coordinate_names[i] for i in own), tuple(self.names[i] for i in rows), self.start[own], self.timed and last in own,
                    tuple(self.sizes[i] for i in own) if self.sizes else (),
                )  # fmt: skip

    def points(self, count: int = _SAMPLES, seed: int = 0) -> list[np.ndarray]:
        """Random configurations (n,) on the manifold, a walk of two strides along it away from the start, so that they lie on its branch.

        Raises `AssemblyError` where they are not found.
        """
        residual = self._residual()
        rng = np.random.default_rng(seed)
        found: list[np.ndarray] = []
        start = self._assembled(residual)
        for attempt in range(_TRIES + 2 * count):
            # shorter strides where long ones leave the manifold's reach
            reach = 0.9 ** min(attempt - len(found), _TRIES)
            point = assemble(residual, start)
            for _stride in range(2):
                if point.converged:
                    step = reach * rng.uniform(0.15, 0.3, self.start.size) * rng.choice([-1.0, 1.0], self.start.size)
                    free = null_space(residual(point.y)[1])
                    point = assemble(residual, point.y + free @ (free.T @ step))
            if point.converged:
                found.append(point.y)
            if len(found) == count:
                return found
        raise AssemblyError(
            f"Only {len(found)} of {count} configurations near {np.array2string(self.start, precision=3)} satisfy the holonomic constraints "
            f"between {', '.join(self.coordinate_names[:8])}. Give a start nearer to an assembled position."
        )

    def _assembled(self, residual: Residual) -> np.ndarray:
        """Where an assembled configuration is found from: the start, or beside it where that is a singular one, as ropes that leave from where they end."""
        rng, start = np.random.default_rng(0), self.start
        for attempt in range(_TRIES):
            if assemble(residual, start).converged:
                return start
            start = self.start + rng.normal(scale=0.1 * 1.35**attempt, size=self.start.size)
        return self.start

    def _residual(self) -> Residual:
        closing = ca.Function("closing", [self.y], [self.holonomic, ca.densify(ca.jacobian(self.holonomic, self.y))])
        n = self.y.numel()

        def residual(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            c, J = closing(y)
            return np.array(c).ravel(), np.array(J).reshape(-1, n)

        return residual

    def numbers(self) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """y -> gradients of the holonomic functions (c, n), forms (m, n), and their exterior derivatives (m, n, n)."""
        m, n = self.forms.shape
        slopes = ca.densify(ca.jacobian(self.forms.T, self.y)) if m else ca.SX(0, n)
        function = ca.Function(
            "pfaffian", [self.y], [ca.densify(ca.jacobian(self.holonomic, self.y)), ca.densify(self.forms), slopes]
        )

        def at(y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            dc, W, S = (np.array(part) for part in function(y))
            # S[a n + j, i] is the derivative of coefficient j of form a by y_i
            change = S.reshape(m, n, n)
            return dc.reshape(-1, n), W.reshape(m, n), change.transpose(0, 2, 1) - change

        return at


def _divided(rows: ca.SX, values: np.ndarray) -> ca.SX:
    """Rows (m, k) over the largest of their values (m, n), to a power of two."""
    largest = np.max(np.abs(np.where(np.isfinite(values), values, 0.0)), axis=1, initial=0.0)
    factor = np.ldexp(1.0, -np.frexp(np.where(largest > 0, largest, 1.0))[1])
    return ca.diag(ca.SX(ca.DM(factor))) @ rows if rows.numel() else rows


def row_space(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal rows (r, n) that span those of `matrix`; singular values below `DEPENDENT` of the largest count as zero, rows scaled to 1."""
    lengths = np.linalg.norm(matrix, axis=1)
    rows = matrix[lengths > DEPENDENT * np.max(lengths, initial=0.0)]
    if rows.size == 0:
        return np.zeros((0, matrix.shape[1]))
    _, s, Vt = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None], full_matrices=False)
    return Vt[: int(np.sum(s > DEPENDENT * s[0]))]


def null_space(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal columns (n, n - r) that the rows of `matrix` send to zero."""
    rows = row_space(matrix)
    return np.linalg.svd(rows)[2][rows.shape[0] :].T if rows.size else np.eye(matrix.shape[1])


def common(spaces: Sequence[np.ndarray]) -> np.ndarray:
    """Orthonormal rows that span what the row spaces of all these matrices (m, n) have in common."""
    return null_space(np.hstack([null_space(space) for space in spaces]).T).T


def _used(row: ca.SX) -> list[int]:
    """Entries of a row that are not zero by structure."""
    return [j for j in range(row.numel()) if not row[j].is_zero()]


def _connected(members: Sequence[set[int]]) -> list[list[int]]:
    """Groups of rows that share entries, by merging; rows in ascending order."""
    owner: dict[int, int] = {}
    root = list(range(len(members)))

    def find(k: int) -> int:
        while root[k] != k:
            root[k] = root[root[k]]
            k = root[k]
        return k

    for k, entries in enumerate(members):
        for entry in entries:
            first = owner.setdefault(entry, k)
            root[find(k)] = find(first)
    groups: dict[int, list[int]] = {}
    for k in range(len(members)):
        groups.setdefault(find(k), []).append(k)
    return list(groups.values())
