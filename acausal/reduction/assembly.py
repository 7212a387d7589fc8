"""Assembly: from a rough guess to a configuration and velocity that meet every constraint to rounding.

Damped Gauss-Newton on min |J_near dq + r_near|^2 subject to the constraints, by singular values, so that redundant rows
and singular configurations do no harm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

Residual = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""y (n,) -> residual (m,) and Jacobian (m, n)."""

_RANK = 1e-9


@dataclass(frozen=True)
class Assembled:
    """Result of a search: `y`, the largest residual `gap` that is left, and whether it is zero to rounding."""

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
) -> Assembled:
    """Nearest y to `guess` with `constraints(y)` = 0, and with `wishes(y)` as small as then possible.

    `stride`: largest change of an entry in one iteration (coordinates: 0.7 rad or m; velocities: any).
    Converges quadratically near a solution. Not converged when the residual stops shrinking above `tolerance`
    (times the largest entry of y where that is above 1).
    """
    y = np.array(guess, dtype=float)
    best = Assembled(y.copy(), np.inf, False, 0)
    polish = 0
    for iteration in range(limit):
        c, J = constraints(y)
        gap, size = _largest(c), _largest(y)
        if not gap < np.inf:
            break
        enough = tolerance * max(1.0, size)
        step = _step(c, J, wishes(y) if wishes is not None else None, y - guess)
        settled = _largest(step) <= 1e-10 * (1 + size)
        if gap < best.gap or gap <= enough:
            best = Assembled(y.copy(), gap, gap <= enough, iteration)
        if gap <= enough and (settled or wishes is None):
            polish += 1
            if settled:  # quadratic convergence: after this step nothing is left
                last = y + step
                return best if _largest(constraints(last)[0]) > gap else replace(best, y=last)
            if polish > 2:
                break
        moved, ok = _line_search(constraints, y, step, gap, enough, stride)
        if not ok:
            break
        y = moved
    return best


def _largest(values: np.ndarray) -> float:
    """max |values|, 0 without any; NaN where one is."""
    return float(np.abs(values).max(initial=0.0))


def _step(c: np.ndarray, J: np.ndarray, wish: tuple[np.ndarray, np.ndarray] | None, moved: np.ndarray) -> np.ndarray:
    """Least change that meets the linearised constraints, then the wishes, then stays near the guess."""
    U, s, Vt = np.linalg.svd(J, full_matrices=True) if J.shape[0] else (np.zeros((0, 0)), np.zeros(0), np.eye(J.shape[1]))
    rank = int(np.sum(s > _RANK * max(1.0, s[0] if s.size else 0.0)))
    step = -Vt[:rank].T @ ((U[:, :rank].T @ c) / s[:rank])
    Z = Vt[rank:].T
    if Z.shape[1] == 0:
        return step
    if wish is None:
        return step
    r, Jw = wish
    JZ = Jw @ Z
    damping = 1e-6
    normal = JZ.T @ JZ + damping**2 * np.eye(Z.shape[1])
    z = -np.linalg.solve(normal, JZ.T @ (r + Jw @ step) + damping**2 * (Z.T @ (moved + step)))
    return step + Z @ z


def _line_search(
    constraints: Residual, y: np.ndarray, step: np.ndarray, gap: float, tolerance: float, stride: float
) -> tuple[np.ndarray, bool]:
    largest = _largest(step)
    factor = min(1.0, stride / largest) if largest > 0 else 1.0
    for _ in range(12):
        trial = y + factor * step
        value = _largest(constraints(trial)[0])
        if value < np.inf and (value < gap * (1 - 1e-3 * factor) or value <= tolerance):
            return trial, True
        factor *= 0.5
    return y, False
