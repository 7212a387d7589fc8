"""Singular positions of loops with several freedoms, looked for by going where the constraints are ever less independent.

Where one freedom is left a walk comes through all positions; where more are left it passes singular ones by. Their distance is what the
smallest singular value measures, so each is reached by following its slope.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.loops.singular import row_scale
from acausal.loops.walk import Walk
from acausal.numerics.thresholds import SINGULAR

_STRIDE = 0.35
_MOST_STEPS = 60
_MOST_HALVINGS = 6
_LEAST_FALL = 0.1
"""Of what the slope promises."""
_PROBE = 1e-6
_GAP = 1e-3
"""Loops are closed to this times the square of the singular value: what is open moves places by the gap over it."""
_CLOSED = 1e-8


def descends_to_singular_position(walk: Walk, starts: Sequence[np.ndarray], jacobians: list[np.ndarray], rank: int) -> bool:
    """Whether the smallest of the `rank` singular values falls to zero from one of the assembled configurations `starts` with these
    `jacobians`.
    """
    scale = row_scale(jacobians)[:, None]
    return any(_falls(walk, start, scale, rank) for start in starts)


def _falls(walk: Walk, z: np.ndarray, scale: np.ndarray, rank: int) -> bool:
    for _ in range(_MOST_STEPS):
        U, s, Vt = np.linalg.svd(walk.at(z)[2] / scale)
        smallest = float(s[rank - 1])
        if smallest < SINGULAR:
            return True
        found = _lower(walk, z, scale, smallest, _slope(walk, z, scale, U[:, rank - 1], Vt[rank - 1], Vt[rank:]), rank)
        if found is None:
            return False
        z = found
    return False


def _slope(walk: Walk, z: np.ndarray, scale: np.ndarray, left: np.ndarray, right: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Of the singular value with these vectors, (nv,), along the directions `free` (f, nv) in which the loops let go."""
    _, _, A, N = walk.at(z)
    changes = np.array([left @ ((walk.at(z + N @ (_PROBE * along))[2] - A) / scale) @ right for along in free]) / _PROBE
    return changes @ free


def _lower(walk: Walk, z: np.ndarray, scale: np.ndarray, here: float, slope: np.ndarray, rank: int) -> np.ndarray | None:
    """A closed configuration where the singular value is lower than `here`, down the slope."""
    steepness = float(np.linalg.norm(slope))
    if not 0 < steepness < np.inf:
        return None
    down = walk.at(z)[3] @ (-slope / steepness)
    stride = min(_STRIDE, here / steepness)
    for _ in range(_MOST_HALVINGS):
        there = walk.closed(z + stride * down, min(_CLOSED, _GAP * here**2))
        if there is not None:
            value = float(np.linalg.svd(walk.at(there)[2] / scale, compute_uv=False)[rank - 1])
            if value < here - _LEAST_FALL * stride * steepness:
                return there
        stride *= 0.5
    return None
