"""Assembly: from a rough guess to a configuration and velocity that meet every constraint to rounding.

Levenberg's damped Gauss-Newton steps within a trust region (More 1978), by singular values, so that redundant rows and singular
configurations do no harm. Wishes take part three times: as a penalty on the way from the guess, which chooses the branch;
not at all while the constraints are closed; and then along the freedom that is left, with the constraints kept closed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Residual = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""y (n,) -> residual (m,) and Jacobian (m, n)."""

_RANK = 1e-9
_PENALTY = 0.3
"""Weight of wishes against constraints on the way from the guess."""
_PATIENCE = 2
"""Gauss-Newton steps before Newton's method is tried."""
_DAMPING = 10.0 ** np.arange(-14.0, 4.0, 0.5)


@dataclass(frozen=True)
class Assembled:
    """Result of a search: `y`, the largest residual `gap` that is left, whether it is zero to rounding, and the steps it took."""

    y: np.ndarray
    gap: float
    converged: bool
    iterations: int


def assemble(
    constraints: Residual,
    guess: np.ndarray,
    wishes: Residual | None = None,
    *,
    tolerance: float = 1e-12,
    limit: int = 100,
    stride: float = 0.7,
    nearest: np.ndarray | None = None,
    approach: bool = True,
) -> Assembled:
    """A y near `guess` with `constraints(y)` = 0, and with the sum of squares of `wishes(y)` as small as then possible nearby.

    `stride`: largest change of an entry in one iteration (coordinates: 0.7 rad or m; velocities: any). Converges
    quadratically near a solution. `nearest` (n,): without wishes, go on to the y nearest to it, to about 1e-6.
    `approach`: wishes choose the branch too. Not converged when the residual stops shrinking above `tolerance` (times the largest entry
    of y where that is above 1); y is then a point of locally least squares. Cost of an iteration: one singular value
    decomposition (m, n).
    """
    y, spent = np.array(guess, dtype=float), 0
    if wishes is not None and approach:
        y, spent = _approached(constraints, wishes, y, stride)
    found = _closed(constraints, y, tolerance, limit, stride, spent)
    if not found.converged or (wishes is None and (nearest is None or not found.iterations)):
        return found
    if wishes is not None:
        return _settled(constraints, wishes, found, _Effort(tolerance, limit, stride, 1e-10, 40))
    unit = np.eye(y.size)
    return _settled(constraints, lambda y: (y - nearest, unit), found, _Effort(tolerance, 20, stride, 1e-6, 8))


def _largest(values: np.ndarray) -> float:
    """max |values|, 0 without any; NaN where one is."""
    return float(np.abs(values).max(initial=0.0))


def _step(c: np.ndarray, J: np.ndarray, radius: float) -> np.ndarray:
    """The least dy that minimises |c + J dy|, damped as little as keeps all its entries within `radius`."""
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    if s.size == 0 or s[0] == 0.0:
        return np.zeros(J.shape[1])
    a = U.T @ c
    kept = s > _RANK * max(1.0, s[0])
    step = -(a[kept] / s[kept]) @ Vt[kept]
    if _largest(step) <= radius:
        return step
    damping = s[0] ** 2 * _DAMPING
    steps = -((s * a)[:, None] / (s[:, None] ** 2 + damping)).T @ Vt
    inside = np.abs(steps).max(axis=1) <= radius
    return steps[int(np.argmax(inside))] if inside.any() else steps[-1] * (radius / _largest(steps[-1]))


def _descend(
    residual: Residual, y: np.ndarray, tolerance: float, limit: int, stride: float, slowest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Towards least squares of `residual`, until it is within `tolerance` or its square shrinks by less than `slowest` in one step.

    Returns y, residual, Jacobian, iterations.
    """
    c, J = residual(y)
    square, radius = float(c @ c), stride
    for iteration in range(limit):
        if not square < np.inf or _largest(c) <= tolerance * max(1.0, _largest(y)):
            return y, c, J, iteration
        step = _step(c, J, radius)
        left = c + J @ step
        promised = square - float(left @ left)
        length = _largest(step)
        if promised <= slowest * square or length <= 1e-15 * (1 + _largest(y)):
            return y, c, J, iteration
        next_c, next_J = residual(y + step)
        next_square = float(next_c @ next_c)
        gained = (square - next_square) / promised if next_square < np.inf else -1.0
        if gained < 0.25:
            radius = 0.25 * length
        elif gained > 0.75:
            radius = min(stride, max(radius, 2 * length))
        if gained > 1e-4:
            y, c, J, square = y + step, next_c, next_J, next_square
    return y, c, J, limit


def _approached(constraints: Residual, wishes: Residual, y: np.ndarray, stride: float) -> tuple[np.ndarray, int]:
    """From the guess to where constraints and wishes compromise, roughly."""

    def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, J = constraints(y)
        r, Jw = wishes(y)
        return np.concatenate([c, _PENALTY * r]), np.vstack([J, _PENALTY * Jw])

    y, _, _, iterations = _descend(both, y, 1e-12, 30, stride, 0.02)
    return y, iterations


def _closed(constraints: Residual, y: np.ndarray, tolerance: float, limit: int, stride: float, spent: int = 0) -> Assembled:
    y, c, J, iterations = _descend(constraints, y, tolerance, limit, stride, 1e-4)
    gap, enough = _largest(c), tolerance * max(1.0, _largest(y))
    if not gap <= enough:
        return Assembled(y, gap if gap < np.inf else np.inf, False, spent + iterations)
    # quadratic convergence: after one more step nothing is left
    last = y + _step(c, J, np.inf)
    last_gap = _largest(constraints(last)[0])
    if last_gap <= gap and _largest(last - y) <= 1e-6 * (1 + _largest(y)):
        y, gap = last, last_gap
    return Assembled(y, gap, True, spent + iterations)


@dataclass(frozen=True)
class _Effort:
    """How far to go: gap that counts as closed, most steps, longest step, one that is short enough, freedoms for Newton's method."""

    tolerance: float
    limit: int
    stride: float
    last: float
    freedoms: int


def _settled(constraints: Residual, wishes: Residual, found: Assembled, effort: _Effort) -> Assembled:
    """Least squares of the wishes along the freedom that the constraints leave.

    Gauss-Newton, and Newton's method where that is slow since wishes stay unmet; after each step the constraints are closed again.
    """
    r, Jw = wishes(found.y)
    square, radius = float(r @ r), effort.stride
    spent = found.iterations
    J = constraints(found.y)[1]
    Z = freedom(J)
    for iteration in range(effort.limit):
        step, promised = _along_freedom(r, Jw, Z, radius)
        if promised <= 1e-15 * square or square < 1e-28:
            break
        if iteration >= _PATIENCE and Z.shape[1] <= effort.freedoms:
            better = _newton_step(constraints, wishes, found.y, r, Jw, J, Z)
            if better is not None:
                part = min(1.0, radius / max(_largest(better[0]), 1e-300))
                step, promised = part * better[0], (2 - part) * part * better[1]
        length = _largest(step)
        if length <= effort.last * (1 + _largest(found.y)):
            break
        trial = _closed(constraints, found.y + step, effort.tolerance, 12, max(length, 1e-3))
        spent += 1 + trial.iterations
        next_r, next_Jw = wishes(trial.y)
        next_square = float(next_r @ next_r)
        gained = (square - next_square) / promised if trial.converged and next_square < np.inf else -1.0
        if gained < 0.25:
            radius = 0.25 * length
        elif gained > 0.75:
            radius = min(effort.stride, max(radius, 2 * length))
        if gained > 1e-4:
            found, r, Jw, square = trial, next_r, next_Jw, next_square
            J = constraints(found.y)[1]
            Z = freedom(J)
    return Assembled(found.y, found.gap, True, spent)


def _along_freedom(r: np.ndarray, Jw: np.ndarray, Z: np.ndarray, radius: float) -> tuple[np.ndarray, float]:
    """Gauss-Newton step in the columns of Z, no entry longer than `radius`, and by how much the square should shrink."""
    along = Jw @ Z
    step = Z @ _step(r, along, np.inf)
    if _largest(step) > radius:
        step = Z @ _step(r, along, radius / max(1.0, float(np.abs(Z).sum(axis=1).max(initial=0.0))))
    left = r + Jw @ step
    return step, float(r @ r) - float(left @ left)


def _newton_step(
    constraints: Residual, wishes: Residual, y: np.ndarray, r: np.ndarray, Jw: np.ndarray, J: np.ndarray, Z: np.ndarray
) -> tuple[np.ndarray, float] | None:
    """Newton step in the columns of Z for |wishes|^2 / 2 with the constraints' curvature, and by how much the square should shrink.

    The Hessian of Lagrange's function by differences of its gradient. None where it is not positive definite.
    """
    multipliers = np.linalg.lstsq(J.T, Jw.T @ r, rcond=_RANK)[0] if J.shape[0] else np.zeros(0)
    gradient = Jw.T @ r - J.T @ multipliers
    H = np.empty((Z.shape[1], Z.shape[1]))
    h = 1e-6 * (1 + _largest(y))
    for k in range(Z.shape[1]):
        beside = y + h * Z[:, k]
        s, Js = wishes(beside)
        H[:, k] = Z.T @ (Js.T @ s - constraints(beside)[1].T @ multipliers - gradient) / h
    levels, axes = np.linalg.eigh((H + H.T) / 2)
    if not levels.size or not levels[0] > 1e-6 * levels[-1]:
        return None
    slope = axes.T @ (Z.T @ gradient)
    return -Z @ (axes @ (slope / levels)), float(np.sum(slope**2 / levels))


def range_and_null_space(J: np.ndarray, tolerance: float = _RANK) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal columns (m, r) that span the range of J (m, n), and those (n, n - r) that span its null space.

    Singular values below `tolerance` times the largest, or times 1 where that is less, count as zero.
    """
    if not J.size:
        return np.zeros((J.shape[0], 0)), np.eye(J.shape[1])
    U, s, Vt = np.linalg.svd(J, full_matrices=True)
    rank = int(np.sum(s > tolerance * max(1.0, s[0])))
    return U[:, :rank], Vt[rank:].T


def freedom(J: np.ndarray, tolerance: float = _RANK) -> np.ndarray:
    """Null space of J, (n, freedoms), orthonormal; see `range_and_null_space`."""
    return range_and_null_space(J, tolerance)[1]
