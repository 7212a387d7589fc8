"""Assembly: from a rough guess to a configuration and velocity that meet every constraint to rounding.

Levenberg's damped Gauss-Newton steps within a trust region (More 1978), by singular values, so that redundant rows and singular
configurations do no harm. Wishes take part three times: as a penalty on the way from the guess, which chooses the branch;
not at all while the constraints are closed; and then along the freedom that is left, with the constraints kept closed.

All is done in numbers without unit: unknowns and rows are divided by their `Sizes`. So a mechanism drawn in other units, if by a power of
two, goes through the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acausal.numerics.independent import Independent, damped, inverse
from acausal.numerics.sizes import Sizes
from acausal.numerics.thresholds import CLOSED, DEPENDENT, ROUNDING, STRIDE

Residual = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""y (n,) -> residual (m,) and Jacobian (m, n)."""

_PENALTY = 0.3
"""Weight of wishes against constraints on the way from the guess."""
_PATIENCE = 2
"""Gauss-Newton steps before Newton's method is tried."""
_DAMPING = 10.0 ** np.arange(-14.0, 4.0, 0.5)
_SAID = 1e-9
"""What may be left of residuals of rows that follow from others."""
_MET = 1e-12
"""Wishes that are met."""
_COARSE = 1e-3
"""Residuals, as parts of their sizes, that no rounding explains."""
_LIMITED = 0.25
"""A step of this part of the longest one was cut short: dampings are half a decade apart."""
_STRAIGHT = 1e-3
"""Where a step gains what was promised but for this part, the rows are linear on its way, and the next may be longer than a stride."""


@dataclass(frozen=True)
class Assembled:
    """Result of a search: `y`, the residuals `left` (m,), the largest `gap` of them, the same as part of its row's size, whether all are
    zero to rounding, and the steps it took.
    """

    y: np.ndarray
    left: np.ndarray
    gap: float
    part: float
    converged: bool
    iterations: int


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is seen and answered
def assemble(
    constraints: Residual,
    guess: np.ndarray,
    wishes: Residual | None = None,
    *,
    sizes: Sizes | None = None,
    tolerance: float = CLOSED,
    limit: int = 100,
    stride: float = STRIDE,
    nearest: Residual | None = None,
    approach: bool = True,
) -> Assembled:
    """A y near `guess` with `constraints(y)` = 0, and with the sum of squares of `wishes(y)` as small as then possible nearby.

    `sizes`: of unknowns and rows, ones unless given. `stride`: largest change of an unknown in one iteration, as part of its size.
    Converges quadratically near a solution. `nearest`: go on to where the squares of this residual are least nearby, to
    about 1e-6, among what meets the wishes, if all of them can be met.
    `approach`: wishes choose the branch too. Converged when every row is within `tolerance` of its size or within rounding; else y
    is a point of locally least squares. Cost of an iteration: one singular value decomposition (m, n).
    """
    unit = np.ones(guess.size) if sizes is None else sizes.unknowns
    rows = _Rows(constraints, unit, sizes, tolerance)
    soft = None if wishes is None else _in_units(wishes, unit)
    z, spent = guess / unit, 0
    if soft is not None and approach:
        z, spent = _approached(rows, soft, z, stride)
    found = _closed(rows, z, limit, stride, spent)
    if found.converged and soft is not None:
        found = _settled(rows, soft, found, _Effort(limit, stride, 1e-10, 40))
        if nearest is not None and found.iterations:
            found = _nearest_of_those(rows, soft, found, _in_units(nearest, unit), _Effort(20, stride, 1e-6, 8))
    elif found.converged and nearest is not None and found.iterations:
        found = _settled(rows, _in_units(nearest, unit), found, _Effort(20, stride, 1e-6, 8))
    return rows.result(found)


@np.errstate(over="ignore", invalid="ignore")
def corrected(
    constraints: Residual, z: np.ndarray, enough: Callable[[np.ndarray, np.ndarray], bool], dependent: float, rank: int | None
) -> np.ndarray | None:
    """A z next to one that nearly meets the constraints, by Newton's method with each Jacobian, of this `rank` if it is known, used twice;
    None where five of them are not `enough` (residuals and z).
    """
    c, J = constraints(z)
    for _ in range(5):
        if not (np.isfinite(J).all() and np.isfinite(c).all()):
            return None
        back = inverse(J, dependent, rank)
        z = z - back(c)
        z = z - back(constraints(z)[0])
        c, J = constraints(z)
        if enough(c, z):
            return z  # also without rows, where only velocities are constrained
    return None


def held(residual: Residual, still: Sequence[int]) -> Residual:
    """The same residual, with derivatives as if the unknowns `still` could not change, so that no step moves them."""
    if not still:
        return residual
    still = list(still)

    def rows(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = residual(z)
        J = J.copy()
        J[:, still] = 0.0
        return r, J

    return rows


def brought_near(constraints: Residual, guess: np.ndarray, turning: np.ndarray, sizes: Sizes) -> np.ndarray:
    """The guess, shifted only: what does not turn goes as far as it takes to meet the constraints as well as can be.

    A search goes a stride at a time, since turns bend its way, and gets nowhere from a sketch that is many times its size away.
    """
    moved = np.flatnonzero(~turning)

    def shifted(part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y = guess.copy()
        y[moved] = part
        c, J = constraints(y)
        return c, J[:, moved]

    own = replace(sizes, unknowns=sizes.unknowns[moved], rounding=None)
    result = guess.copy()
    result[moved] = assemble(shifted, guess[moved], sizes=own, stride=np.inf).y
    return result


def _in_units(residual: Residual, unit: np.ndarray) -> Residual:
    """The same residual of unknowns divided by `unit`."""

    def scaled(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, J = residual(z * unit)
        return c, J * unit

    return scaled


@dataclass(frozen=True)
class _Rows:
    """Constraints without units: z (n,) -> residuals and Jacobian."""

    constraints: Residual
    unit: np.ndarray
    sizes: Sizes | None
    tolerance: float

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, J = self.constraints(z * self.unit)
        if self.sizes is None:
            return c, J
        return c / self.sizes.rows, self.sizes.scaled(J)

    @property
    def dependent(self) -> float:
        return DEPENDENT if self.sizes is None else self.sizes.dependent

    def within(self, step: np.ndarray) -> np.ndarray:
        """The step, or as much of it as no unknown's limit forbids."""
        limit = None if self.sizes is None else self.sizes.limit
        return step if limit is None else step / max(1.0, _largest(step / limit))

    def enough(self, c: np.ndarray, z: np.ndarray) -> bool:
        """Whether residuals c are zero but for rounding; False for what is no number."""
        if _largest(c) <= self.tolerance:
            return True
        if self.sizes is None:
            return _largest(c) <= self.tolerance * max(1.0, _largest(z))
        if self.sizes.rounding is None or not _largest(c) < _COARSE:
            return False
        noise = self.sizes.rounding(z * self.unit) / self.sizes.rows
        return bool(np.all(np.abs(c) <= np.maximum(self.tolerance, ROUNDING * noise)))

    def result(self, found: _Closed) -> Assembled:
        """With units."""
        y = found.z * self.unit
        left = found.c if self.sizes is None else found.c * self.sizes.rows
        part, gap = _largest(found.c), _largest(left)
        if not part < np.inf:
            part = gap = np.inf
        return Assembled(y, left, gap, part, found.converged, found.iterations)


@dataclass(frozen=True)
class _RowsAndWishes(_Rows):
    """Constraints, followed by what is wished for and can be met."""

    wishes: Residual

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (c, J), (r, Jw) = super().__call__(z), self.wishes(z)
        return np.concatenate([c, r]), np.vstack([J, Jw])

    def enough(self, c: np.ndarray, z: np.ndarray) -> bool:
        met = self.wishes(z)[0]
        return _largest(met) <= _MET and super().enough(c[: c.size - met.size], z)


@dataclass(frozen=True)
class _Closed:
    """Unknowns and residuals without units."""

    z: np.ndarray
    c: np.ndarray
    converged: bool
    iterations: int


def _largest(values: np.ndarray) -> float:
    """max |values|, 0 without any; NaN where one is."""
    return float(np.abs(values).max(initial=0.0))


def _step(c: np.ndarray, J: np.ndarray, radius: float, dependent: float = DEPENDENT) -> np.ndarray:
    """The least dz that minimises |c + J dz|, damped as little as keeps all its entries within `radius`."""
    plain = _plain_step(c, J, radius, dependent)
    if plain is not None:
        return plain
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    if s.size == 0 or s[0] == 0.0:
        return np.zeros(J.shape[1])
    Vt[:, ~J.any(axis=0)] = 0.0  # but for rounding: what no row depends on stays exactly as it is
    a = U.T @ c
    kept = s > dependent * max(1.0, s[0])
    step = -(a[kept] / s[kept]) @ Vt[kept]
    if _largest(step) <= radius:
        return step
    damping = s[0] ** 2 * _DAMPING
    steps = -((s * a)[:, None] / (s[:, None] ** 2 + damping)).T @ Vt
    inside = np.abs(steps).max(axis=1) <= radius
    return steps[int(np.argmax(inside))] if inside.any() else steps[-1] * (radius / _largest(steps[-1]))


def _plain_step(c: np.ndarray, J: np.ndarray, radius: float, dependent: float) -> np.ndarray | None:
    """The same for a large J where it is plain which rows, or else columns, are independent; None for others."""
    columns = Independent.of(J.T, dependent) if J.shape[0] > J.shape[1] else None
    if columns is not None and columns.rows.size == J.shape[1]:
        step = -columns.solve(J.T @ c)
    else:
        found = Independent.of(J, dependent)
        step = None if found is None else -found.least(c)
        if step is None or not _largest(c + J @ step) <= _SAID * _largest(c):
            return None
    if _largest(step) <= radius:
        return step
    (solve, most), inside = damped(J), None
    few, many = 0, _DAMPING.size - 1
    while few < many:
        middle = (few + many) // 2
        step = -solve(c, most * _DAMPING[middle])
        if _largest(step) <= radius:
            many, inside = middle, step
        else:
            few = middle + 1
    step = -solve(c, most * _DAMPING[few]) if inside is None else inside
    return step * min(1.0, radius / _largest(step))


def _descend(
    residual: Residual,
    z: np.ndarray,
    enough: Callable[[np.ndarray, np.ndarray], bool],
    limit: int,
    stride: float,
    slowest: float,
    dependent: float = DEPENDENT,
    within: Callable[[np.ndarray], np.ndarray] = lambda step: step,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Towards least squares of `residual`, until it is small `enough` or its square shrinks by less than `slowest` in one step.

    Returns z, residual, Jacobian, iterations. Ends where there is no derivative.
    """
    c, J = residual(z)
    square, radius, reach = float(c @ c), stride, stride
    for iteration in range(limit):
        if not square < np.inf or enough(c, z) or not np.isfinite(J).all():
            return z, c, J, iteration
        step = within(_step(c, J, radius, dependent))
        left = c + J @ step
        promised = square - float(left @ left)
        length = _largest(step)
        slow = slowest if length < _LIMITED * reach else 0.0  # from far away every stride is a small part of the way
        if promised <= slow * square or length <= 1e-15 * (1 + _largest(z)):
            return z, c, J, iteration
        next_c, next_J = residual(z + step)
        next_square = float(next_c @ next_c)
        gained = (square - next_square) / promised if next_square < np.inf and np.isfinite(next_J).all() else -1.0
        if gained < 0.25:
            radius = 0.25 * length
        elif gained > 0.75:
            if abs(gained - 1) < _STRAIGHT and length > _LIMITED * reach:
                reach *= 8.0
                radius = reach
            radius = min(reach, max(radius, 2 * length))
        if gained > 1e-4:
            z, c, J, square = z + step, next_c, next_J, next_square
    return z, c, J, limit


def _approached(rows: _Rows, wishes: Residual, z: np.ndarray, stride: float) -> tuple[np.ndarray, int]:
    """From the guess to where constraints and wishes compromise, roughly."""

    def both(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, J = rows(z)
        r, Jw = wishes(z)
        return np.concatenate([c, _PENALTY * r]), np.vstack([J, _PENALTY * Jw])

    z, _, _, iterations = _descend(both, z, lambda c, _: _largest(c) <= CLOSED, 30, stride, 0.02)
    return z, iterations


def _closed(rows: _Rows, z: np.ndarray, limit: int, stride: float, spent: int = 0) -> _Closed:
    z, c, J, iterations = _descend(rows, z, rows.enough, limit, stride, 1e-4, rows.dependent, rows.within)
    if not rows.enough(c, z):
        return _Closed(z, c, False, spent + iterations)
    # quadratic convergence: after one more step nothing is left
    if np.isfinite(J).all():
        last = z + _step(c, J, np.inf, rows.dependent)
        last_c = rows(last)[0]
        if _largest(last_c) <= _largest(c) and _largest(last - z) <= 1e-6 * (1 + _largest(z)):
            z, c = last, last_c
    return _Closed(z, c, True, spent + iterations)


@dataclass(frozen=True)
class _Effort:
    """How far to go: most steps, longest step, one that is short enough, freedoms for Newton's method."""

    limit: int
    stride: float
    last: float
    freedoms: int


def _settled(rows: _Rows, wishes: Residual, found: _Closed, effort: _Effort) -> _Closed:
    """Least squares of the wishes along the freedom that the constraints leave.

    Gauss-Newton, and Newton's method where that is slow since wishes stay unmet; after each step the constraints are closed again.
    """
    r, Jw = wishes(found.z)
    square, radius = float(r @ r), effort.stride
    spent = found.iterations
    J = rows(found.z)[1]
    if not (np.isfinite(J).all() and np.isfinite(Jw).all()):
        return found
    for iteration in range(effort.limit):
        Z = _directions(J, rows.dependent, effort.freedoms)
        step, promised = _along_freedom(r, Jw, J, Z, radius)
        if promised <= 1e-15 * square or square < 1e-28:
            break
        if iteration >= _PATIENCE and isinstance(Z, np.ndarray) and Z.shape[1] <= effort.freedoms:
            better = _newton_step(rows, wishes, found.z, r, Jw, J, Z)
            if better is not None:
                part = min(1.0, radius / max(_largest(better[0]), 1e-300))
                step, promised = part * better[0], (2 - part) * part * better[1]
        step = rows.within(step)
        length = _largest(step)
        short = length <= effort.last * (1 + _largest(found.z))
        trial = _closed(rows, found.z + step, 12, max(length, 1e-3))
        spent += 1 + trial.iterations
        next_r, next_Jw = wishes(trial.z)
        next_square = float(next_r @ next_r)
        gained = (square - next_square) / promised if trial.converged and next_square < np.inf else -1.0
        next_J = rows(trial.z)[1] if gained > 1e-4 else J
        if not (np.isfinite(next_J).all() and np.isfinite(next_Jw).all()):
            gained = -1.0  # nothing leads on from there
        if gained < 0.25:
            radius = 0.25 * length
        elif gained > 0.75:
            radius = min(effort.stride, max(radius, 2 * length))
        if gained > 1e-4:
            found, r, Jw, J, square = trial, next_r, next_Jw, next_J, next_square
        if short:
            break
    return _Closed(found.z, found.c, True, spent)


def _nearest_of_those(rows: _Rows, wishes: Residual, found: _Closed, nearest: Residual, effort: _Effort) -> _Closed:
    """Where `nearest` is least among what meets the constraints and the wishes; as `found` where these are not met, or leave nothing."""
    both = _RowsAndWishes(rows.constraints, rows.unit, rows.sizes, rows.tolerance, wishes)
    c, J = both(found.z)
    if not (both.enough(c, found.z) and np.isfinite(J).all()):
        return found
    best = _settled(both, nearest, _Closed(found.z, c, True, found.iterations), effort)
    return replace(best, c=best.c[: found.c.size])


def _directions(J: np.ndarray, dependent: float, few: int) -> np.ndarray | Independent:
    """That no row feels; where there are many, rows that say which these are."""
    plain = Independent.of(J, dependent)
    if plain is None:
        return freedom(J, dependent)
    return plain.basis if plain.freedoms <= few else plain


def _along_freedom(
    r: np.ndarray, Jw: np.ndarray, J: np.ndarray, free: np.ndarray | Independent, radius: float
) -> tuple[np.ndarray, float]:
    """Gauss-Newton step along what is free, no entry longer than `radius`, and by how much the square should shrink."""
    step = None
    if isinstance(free, Independent):
        step = free.least_along(r, Jw, radius, _DAMPING)
        free = free.basis if step is None else free
    if step is None:
        assert isinstance(free, np.ndarray)
        along = Jw @ free
        step = free @ _step(r, along, np.inf)
        if _largest(step) > radius:
            step = free @ _step(r, along, radius / max(1.0, float(np.abs(free).sum(axis=1).max(initial=0.0))))
    left = r + Jw @ step
    return step, float(r @ r) - float(left @ left)


def _newton_step(
    rows: _Rows, wishes: Residual, z: np.ndarray, r: np.ndarray, Jw: np.ndarray, J: np.ndarray, Z: np.ndarray
) -> tuple[np.ndarray, float] | None:
    """Newton step in the columns of Z for |wishes|^2 / 2 with the constraints' curvature, and by how much the square should shrink.

    The Hessian of Lagrange's function by differences of its gradient. None where it is not positive definite.
    """
    multipliers = np.linalg.lstsq(J.T, Jw.T @ r, rcond=rows.dependent)[0] if J.shape[0] else np.zeros(0)
    gradient = Jw.T @ r - J.T @ multipliers
    H = np.empty((Z.shape[1], Z.shape[1]))
    h = 1e-6 * (1 + _largest(z))
    for k in range(Z.shape[1]):
        beside = z + h * Z[:, k]
        s, Js = wishes(beside)
        H[:, k] = Z.T @ (Js.T @ s - rows(beside)[1].T @ multipliers - gradient) / h
    if not np.isfinite(H).all():
        return None
    levels, axes = np.linalg.eigh((H + H.T) / 2)
    if not levels.size or not levels[0] > 1e-6 * levels[-1]:
        return None
    slope = axes.T @ (Z.T @ gradient)
    return -Z @ (axes @ (slope / levels)), float(np.sum(slope**2 / levels))


def range_and_null_space(J: np.ndarray, tolerance: float = DEPENDENT) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal columns (m, r) that span the range of J (m, n), and those (n, n - r) that span its null space.

    Singular values below `tolerance` times the largest, or times 1 where that is less, count as zero: J is of rows and unknowns
    without units.
    """
    if not J.size:
        return np.zeros((J.shape[0], 0)), np.eye(J.shape[1])
    U, s, Vt = np.linalg.svd(J, full_matrices=True)
    rank = int(np.sum(s > tolerance * max(1.0, s[0])))
    return U[:, :rank], Vt[rank:].T


def freedom(J: np.ndarray, tolerance: float = DEPENDENT) -> np.ndarray:
    """Null space of J, (n, freedoms), orthonormal; see `range_and_null_space`."""
    plain = Independent.of(J, tolerance)
    if plain is not None:
        return plain.basis
    return range_and_null_space(J, tolerance)[1]
