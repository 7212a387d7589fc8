"""Redundant constraints, found numerically at several assembled configurations.

A row that follows from the others only on the constraint manifold (a planar loop in a skewed plane, Bennett's linkage)
cannot be seen symbolically. QR with column pivoting of the transposed, row-scaled Jacobians, stacked over configurations.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from acausal.numerics.independent import Independent
from acausal.numerics.thresholds import INDEPENDENT, RANK

_MOST_CHOICES = 300


@dataclass(frozen=True)
class RankReport:
    """Rows to keep; rank at the first configuration and everywhere else; whether the first one is singular."""

    kept: tuple[int, ...]
    rank: int
    rank_at_start: int

    @property
    def singular_at_start(self) -> bool:
        """Whether the first configuration has fewer independent rows than its neighbours."""
        return self.rank_at_start < self.rank


def independent_rows(jacobians: list[np.ndarray], tolerance: float = RANK, empty: float = 1e-12) -> RankReport:
    """Independent rows of velocity constraints from their Jacobians (m, n) at several configurations.

    Rows below `empty` of the largest only hold rounding errors, singular values below `tolerance` count as zero.
    """
    m = jacobians[0].shape[0]
    if m == 0:
        return RankReport((), 0, 0)
    scaled = _scaled(jacobians, empty)
    ranks = [_rank(J, tolerance) for J in scaled]
    rank = max(ranks)
    generic = [J for J, r in zip(scaled, ranks, strict=True) if r == rank]
    kept = _best_rows(generic, rank) if 0 < rank < m else tuple(range(rank))
    return RankReport(tuple(sorted(kept)), rank, ranks[0])


def undecided(jacobians: list[np.ndarray], rank: int, follows: float, empty: float = 1e-12) -> float:
    """Of rows at closed configurations, `rank` of them independent, the singular value that is too small for another independent row, or for the
    last of these wherever one looks, and larger than `follows`: for rows that follow from the others. 0 where there is none.
    """
    m, scaled = jacobians[0].shape[0], _scaled(jacobians, empty)
    if m == 0:
        return 0.0
    if rank == m and all((plain := Independent.of(J)) is not None and plain.rows.size == m for J in scaled[:1]):
        return 0.0  # beyond doubt
    every = [np.linalg.svd(J, compute_uv=False) for J in scaled]
    last = max((s[rank - 1] for s in every), default=1.0) if rank else 1.0
    next_ = max((s[rank] for s in every if rank < s.size), default=0.0)
    return float(next_ if next_ > follows else last if last < INDEPENDENT else 0.0)


def needed_rows(kept: tuple[int, ...], jacobians: list[np.ndarray], tolerance: float = RANK) -> tuple[int, ...]:
    """The rows `kept` where they say all that the others do, also at these configurations, in which loops may be open.

    Otherwise all rows, but for those that only hold rounding errors or are sums of others with the same coefficients everywhere.
    """
    scale = np.max([np.linalg.norm(J, axis=1) for J in jacobians], axis=0)
    rows = np.flatnonzero(scale > 1e-12 * np.max(scale, initial=1.0))
    scaled = [J[rows] / scale[rows, None] for J in jacobians]
    if max(_rank(J, tolerance) for J in scaled) <= len(kept):
        return kept
    together = np.hstack(scaled)
    return tuple(int(rows[k]) for k in sorted(_pivots([together], _rank(together, tolerance))))


def _scaled(jacobians: list[np.ndarray], empty: float) -> list[np.ndarray]:
    """With rows of length 1 at most, nothing of those below `empty` of the largest."""
    scale = np.max([np.linalg.norm(J, axis=1) for J in jacobians], axis=0)
    scale[scale < empty * np.max(scale, initial=1.0)] = np.inf
    scale[scale == 0] = 1.0
    return [J / scale[:, None] for J in jacobians]


def _rank(J: np.ndarray, tolerance: float) -> int:
    plain = Independent.of(J, tolerance)
    if plain is not None:
        return plain.rows.size
    return int(np.sum(np.linalg.svd(J, compute_uv=False) > tolerance)) if J.size else 0


def _best_rows(jacobians: list[np.ndarray], rank: int) -> tuple[int, ...]:
    """The choice of rows whose worst smallest singular value over all configurations is largest; greedy where there are many."""
    m = jacobians[0].shape[0]
    if math.comb(m, rank) > _MOST_CHOICES:
        plain = _pivots([np.hstack(jacobians)], rank)
        if all(_rank(J[list(plain)], INDEPENDENT) == rank for J in jacobians):
            return plain
        # rows that depend on one another here and there, each time otherwise, are independent in all places taken together
        return max(plain, _pivots(jacobians, rank), key=lambda rows: _worst(jacobians, list(rows)))
    choices = [list(rows) for rows in itertools.combinations(range(m), rank)]
    worst = [_worst(jacobians, rows) for rows in choices]
    return tuple(choices[int(np.argmax(np.array(worst) > 0.999 * max(worst)))])


def _worst(jacobians: list[np.ndarray], rows: list[int]) -> float:
    """The smallest singular value of these rows over all configurations."""
    return min(float(np.linalg.svd(J[rows], compute_uv=False)[-1]) for J in jacobians)


def _pivots(jacobians: list[np.ndarray], rank: int) -> tuple[int, ...]:
    """Greedy choice of rows with the largest remaining part, where this is smallest (Gram-Schmidt with pivoting in each matrix); earlier rows win ties."""
    rests = [J.copy() for J in jacobians]
    chosen: list[int] = []
    for _ in range(rank):
        every = [np.linalg.norm(rest, axis=1) for rest in rests]
        norms = np.min(every, axis=0)
        best = int(np.argmax(norms > 0.999 * np.max(norms)))
        chosen.append(best)
        for k, (rest, own) in enumerate(zip(rests, every, strict=True)):
            direction = rest[best] / own[best] if own[best] > 0 else rest[best]
            for _twice in range(2):
                rest = rest - np.outer(rest @ direction, direction)
            rest[chosen] = 0.0
            rests[k] = rest
    return tuple(chosen)
