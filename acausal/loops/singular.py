"""Singular positions of loops, looked for on a walk along the freedom that the loops leave.

A position is singular where the constraints have fewer independent rows than around it: there, branches of the motion cross.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from acausal.loops.walk import Walk
from acausal.numerics.thresholds import SINGULAR

_STRIDE = 0.35
_LENGTH = 5.0
_MOST_STEPS = 60


def _steps(walk: Walk, start: np.ndarray, scale: np.ndarray, rank: int, ahead: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """The smallest of `rank` singular values of A, its rows divided by `scale` (m,), and the place, from step to step.

    It goes on in the same direction, first `ahead` (nv,), where there are several. A step ends short of where the singular
    value, extrapolated, is zero: it shrinks by the same factor from step to step before a singular position, and levels off
    before one that is missed.
    """
    here, walked, stride, before = start, 0.0, _STRIDE, np.inf
    for _ in range(_MOST_STEPS):
        A, N = walk.at(here)[2:]
        _, s, Vt = np.linalg.svd(A / scale[:, None])
        smallest, free = float(s[rank - 1]), Vt[rank:].T
        yield smallest, here
        along = free @ (free.T @ ahead)
        if walked > _LENGTH or not np.max(np.abs(along), initial=0.0) > 1e-6:
            return
        slope = (before - smallest) / stride if np.isfinite(before) else 0.0
        stride = min(_STRIDE, 0.6 * smallest / slope) if slope > 0 else _STRIDE
        ahead = along / np.max(np.abs(along))
        found = walk.closed(here + N @ (stride * ahead))
        if found is None:
            return
        here, walked, before = found, walked + stride, smallest


def row_scale(jacobians: Sequence[np.ndarray]) -> np.ndarray:
    """Largest lengths (m,) of the rows of A (m, nv) at some configurations."""
    scale = np.max([np.linalg.norm(A, axis=1) for A in jacobians], axis=0)
    return np.maximum(scale, 1e-6 * np.max(scale))


def singular_values_along(walk: Walk, start: np.ndarray, scale: np.ndarray, rank: int) -> list[tuple[float, np.ndarray]]:
    """What `_steps` meet on a walk from the assembled configuration `start`, most of a turn of a hinge to either side, as far as the first
    singular position. At most 120 steps with two singular value decompositions each.
    """
    ahead = np.random.default_rng(1).normal(size=walk.freedoms)
    found: list[tuple[float, np.ndarray]] = []
    for sense in (1.0, -1.0):
        for smallest, place in _steps(walk, start, scale, rank, sense * ahead):
            found.append((smallest, place))
            if smallest < SINGULAR:
                return found
    return found
