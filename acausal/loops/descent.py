"""Singular positions of loops with several freedoms, looked for by going where the constraints are ever less independent.

Where one freedom is left a walk comes through all positions; where more are left it passes singular ones by. Their distance is what the
smallest singular value measures, so each is reached by following its slope.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.loops.crossing import Trail, crossing_near
from acausal.loops.walk import Walk
from acausal.numerics.independent import Independent
from acausal.numerics.thresholds import SINGULAR

_STRIDE = 0.35
_MOST_STEPS = 60
_MOST_HALVINGS = 6
_LEAST_FALL = 0.1
"""Of what the slope promises."""
_GAP = 1e-3
"""Loops are closed to this times the square of the singular value: what is open moves places by the gap over it."""
_CLOSED = 1e-8
_CLOSE, _REACH = 0.02, 10.0
"""Singular values from which a crossing is looked for, and how far away, times these."""


def singular_values_down(walk: Walk, starts: Sequence[np.ndarray], scale: np.ndarray, rank: int, kept: tuple[int, ...]) -> Trail:
    """The least singular values that are reached from the assembled configurations `starts`, and where; none after a crossing.

    `scale` (m,): of the rows of A; `rank`: how many are independent in general, `kept` for example.
    """
    found = Trail()
    for start in starts:
        found = found.and_then(_lowest(walk, start, scale, rank, kept))
        if found.singular:
            break
    return found


def _lowest(walk: Walk, z: np.ndarray, scale: np.ndarray, rank: int, kept: tuple[int, ...]) -> Trail:
    rows = scale[:, None]
    here = _smallest(walk, z, rows, rank)
    for _ in range(_MOST_STEPS):
        near = crossing_near(walk, z, scale, kept, _REACH * here) if here < _CLOSE else None
        if near is not None:
            return Trail.at(here, z, near)
        if here < SINGULAR:
            break
        moves = _moves(walk, z, rows, rank)
        found = next((place for move in moves if (place := _lower(walk, z, rows, here, move, rank)) is not None), None)
        if found is None:
            break
        z, here = found, _smallest(walk, found, rows, rank)
    return Trail.at(here, z)


def _smallest(walk: Walk, z: np.ndarray, scale: np.ndarray, rank: int) -> float:
    A = walk.at(z)[2] / scale
    plain = Independent.of(A)
    if plain is not None and plain.rows.size == rank == len(A):
        return plain.smallest
    return float(np.linalg.svd(A, compute_uv=False)[rank - 1])


def _least(A: np.ndarray, rank: int) -> tuple[np.ndarray, float, np.ndarray]:
    """Weights (m,) of the sum of rows that nearly vanishes, its length, and its direction followed by all that no row feels (1 + f, nv)."""
    plain = Independent.of(A)
    if plain is not None and plain.rows.size == rank == len(A):
        s, directions, weights = plain.softest(1)
        return weights[0], float(s[0]), np.vstack([directions, plain.basis.T])
    U, s, Vt = np.linalg.svd(A)
    return U[:, rank - 1], float(s[rank - 1]), Vt[rank - 1 :]


def _moves(walk: Walk, z: np.ndarray, scale: np.ndarray, rank: int) -> list[np.ndarray]:
    """Changes of z to where the sum of rows that nearly vanishes does: by Newton's method, and down the slope of its size.

    To first order in a move, the sum changes along itself, where it is to vanish, and along the directions in which the loops let go,
    where it is to stay nothing; whatever else of it changes, other weights of the rows make up for.
    """
    _, _, A, N = walk.at(z)
    weights, s, along = _least(A / scale, rank)
    free = along[1:]
    changes = along @ walk.bent(z, weights / scale[:, 0]) @ (N @ free.T)
    if not np.isfinite(changes).all():
        return []
    slope = changes[0]
    wanted = np.append(-s, np.zeros(free.shape[0]))
    newton = np.linalg.lstsq(changes, wanted, rcond=1e-6)[0]
    down = -s * slope / max(float(slope @ slope), np.finfo(float).tiny)
    return [N @ (move @ free) for move in (newton, down)]


def _lower(walk: Walk, z: np.ndarray, scale: np.ndarray, here: float, move: np.ndarray, rank: int) -> np.ndarray | None:
    """A closed configuration where the singular value is lower than `here`, along a move that would make it nothing."""
    part = min(1.0, _STRIDE / max(float(np.max(np.abs(move))), np.finfo(float).tiny))
    for _ in range(_MOST_HALVINGS):
        there = walk.closed(z + part * move, min(_CLOSED, _GAP * here**2))
        if there is not None and _smallest(walk, there, scale, rank) < (1 - _LEAST_FALL * part) * here:
            return there
        part *= 0.5
    return None
