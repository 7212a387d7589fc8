"""Where branches of a motion cross, or would cross if lengths were slightly others.

There a sum of the constraints has no slope in any direction in which the others let go. The sum itself, the *gap*, is zero where the branches
cross; beside them it is what lengths are off by, and no error of the place changes it to first order, so it is known to rounding. With
lengths that fit to d of their size, motions miss the place by about the root of d: what tells one from the other is the gap, since where loops
are only closed to some tolerance every near miss looks like a crossing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.loops.walk import Walk
from acausal.numerics.independent import inverse, rank_of
from acausal.numerics.thresholds import SINGULAR

_TOGETHER = 1e-3
"""Sums of rows that have less slope vanish at the same place."""
_STEPS = 15
_EXACT = 1e-10
"""Slopes that are left: their square is what they make of gaps."""
_BENT = 1e-8
"""Squares of bends, as parts of the largest, below which there is another such place beside one."""
_ROUNDED = 8 * float(np.finfo(float).eps)
"""What the lengths of a loop that are meant to fit are off by, of the sizes of the terms: each is the result of some operations."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """A place z, the `weights` (k, n) of the closing residuals in sums without slope there, and these sums, the `gaps` (k,), without unit;
    `sizes` (k,) of their terms; `along` (nz, f), the directions in which the others let go, and `bends` (k, f, f) of the sums in these. `least`:
    smallest singular value of motions that pass by.
    """

    z: np.ndarray
    weights: np.ndarray
    gaps: np.ndarray
    sizes: np.ndarray
    along: np.ndarray
    bends: np.ndarray
    least: float

    @property
    def rounding(self) -> np.ndarray:
        """Of the gaps (k,)."""
        return _ROUNDED * self.sizes

    @property
    def crosses(self) -> bool:
        """Whether branches meet, as far as rounding lets one see."""
        return bool(np.any(np.abs(self.gaps) <= self.rounding))

    @property
    def misses(self) -> bool:
        """Whether some pass each other."""
        return bool(np.any(np.abs(self.gaps) > self.rounding))

    def missed(self, z: np.ndarray, ahead: np.ndarray) -> tuple[float, float]:
        """How far a motion from next to the place, straight `ahead` (nz,), misses it and all others like it around, or would by what lengths are
        off by; and what of `ahead` leads through.
        """
        levels, axes = np.linalg.eigh(np.sum(self.bends @ self.bends, axis=0))
        bent = levels > _BENT * levels[-1]
        across = (levels[bent] / levels[-1])[:, None] ** 0.25 * (axes[:, bent].T @ np.linalg.pinv(self.along))
        here, on = across @ (z - self.z), across @ ahead
        aside = here - (here @ on) / max(float(on @ on), np.finfo(float).tiny) * on
        off = float(np.linalg.norm(aside)) if len(across) > 2 else 0.0  # two branches that cross are two lines there
        steepest = np.max(np.abs(np.linalg.eigvalsh(self.bends)), axis=1)
        apart = np.where(np.abs(self.gaps) > self.rounding, np.sqrt(2 * np.abs(self.gaps) / steepest), 0.0)
        return max(off, float(np.max(apart))), float(np.linalg.norm(on))


@dataclass(frozen=True)
class Trail:
    """What was found on a walk: smallest singular values and where, places where branches cross or nearly do, and whether they do."""

    places: tuple[tuple[float, np.ndarray], ...] = ()
    crossings: tuple[Crossing, ...] = ()
    singular: bool = False
    back: bool = False
    """Whether it came back to its start, so that it met all of a closed curve."""

    @staticmethod
    def at(smallest: float, z: np.ndarray, near: Crossing | None = None) -> Trail:
        """One place, and a crossing near it; where branches miss each other, loops that are closed to a tolerance may lie between them."""
        if near is None:
            return Trail(((smallest, z),), (), smallest < SINGULAR)
        return Trail(((0.0, near.z) if near.crosses else (max(smallest, near.least), z),), (near,), near.crosses)

    def and_then(self, other: Trail) -> Trail:
        """Both walks."""
        new = tuple(found for found in other.crossings if found not in self.crossings)
        return Trail(self.places + other.places, self.crossings + new, self.singular or other.singular, self.back or other.back)


def crossing_near(walk: Walk, z: np.ndarray, scale: np.ndarray, kept: tuple[int, ...], reach: float) -> Crossing | None:
    """From a configuration z with closed loops and rows A that nearly depend on one another, by Newton's method for slopes that vanish.

    `scale` (m,): of the rows of A, of which those `kept` are independent in general. None where none is within `reach`, where other rows
    stay independent, or rolling is in the sum.
    """
    rows, at = list(kept), closing_rows(walk)
    usual = walk.symbolic.group.invariants.numel() + int(np.sum(at[rows] >= 0))
    rank, first = max(usual, rank_of(walk.closing(z)[1], walk.rank)), z  # where it is less already, z is next to the place
    for step in range(_STEPS):
        _, _, A, N = walk.at(z)
        U, s, Vt = np.linalg.svd(A[rows] / scale[rows, None])
        k = max(1, int(np.sum(s < _TOGETHER)))
        few = len(rows) - k
        weights, slopes, along = np.zeros((k, len(A))), s[few:], Vt[few:]
        weights[:, rows] = U[:, few:].T
        changes = np.array([along @ walk.bent(z, w / scale) @ (N @ along.T) for w in weights])
        if slopes[0] < _EXACT and step:  # slopes as small are no place that is known to rounding
            others = np.linalg.svd(A / scale[:, None], compute_uv=False)[len(rows) - 1] > _TOGETHER
            return None if others else _found(walk, z, weights / scale, N @ along.T, changes, at)
        wanted = np.zeros(changes.shape[:2])
        wanted[range(k), range(k)] = -slopes
        if not np.isfinite(changes).all():
            return None
        move = N @ (np.linalg.lstsq(changes.reshape(-1, changes.shape[2]), wanted.ravel(), rcond=1e-6)[0] @ along)
        z = z + move
        for _twice in range(2):
            c, J = walk.closing(z)
            if not np.isfinite(J).all():
                return None
            z = z - inverse(J, walk.dependent, max(rank - k, 0))(c)
        if not np.max(np.abs(z - first)) < reach:
            return None
    return None


def closing_rows(walk: Walk) -> np.ndarray:
    """For each row in the velocities its place among the closing residuals, -1 for rolling."""
    group, first = walk.symbolic.group, walk.symbolic.group.invariants.numel()
    found: list[int] = []
    for rows in group.loops:
        n = rows.position.numel()
        found += [first + k if k < n else -1 for k in range(len(rows.names))]
        first += n
    return np.array(found, dtype=int)


def _found(
    walk: Walk, z: np.ndarray, weights: np.ndarray, along: np.ndarray, changes: np.ndarray, at: np.ndarray
) -> Crossing | None:
    """`weights` (k, m) of the rows in the velocities; `changes` of their sums' slopes `along` (nz, f) the directions that are let go."""
    if np.any(np.abs(weights[:, at < 0]) > 1e-6):
        return None
    sums = np.zeros((len(weights), walk.symbolic.group.closing.numel()))
    sums[:, at[at >= 0]] = (weights / walk.sizes_of_velocities[1])[:, at >= 0]
    gaps, sizes = sums @ walk.gaps(z), np.abs(sums) @ walk.terms(z)
    bends = (changes + changes.transpose(0, 2, 1)) / 2
    least = np.min(np.abs(np.linalg.eigvalsh(bends)), axis=1)
    return Crossing(z, sums, gaps, sizes, along, bends, float(np.min(np.sqrt(2 * np.abs(gaps) * least))))
