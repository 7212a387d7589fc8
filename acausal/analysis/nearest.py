"""The nearest root: equations solved from a guess, to the rounding of their terms, moving as little as possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from acausal.numerics.assembly import Assembled, assemble, freedom
from acausal.numerics.sizes import Sizes
from acausal.numerics.thresholds import ROUNDING

_ZERO = 1e3
_NEXT_TO_NOTHING = 1e-11
"""Of what the sizes of the unknowns make of a row."""
_AROUND = 0.1
_SAMPLES = 5
_RANK = 1e-8


@dataclass(frozen=True)
class Rows:
    """Equations: z (n,) -> `residual` (m,), z -> `jacobian` (m, n), and (z, sizes of z) -> `rounding` (m,), that of the residuals."""

    residual: Callable[[np.ndarray], np.ndarray]
    jacobian: Callable[[np.ndarray], np.ndarray]
    rounding: Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Root:
    """`z` (n,), the residuals there (m,), the same as parts of what the sizes of the unknowns make of them, whether they are zero to
    rounding, and `free` (n, k): directions in which they stay so.
    """

    z: np.ndarray
    residual: np.ndarray
    parts: np.ndarray
    converged: bool
    free: np.ndarray


@dataclass(frozen=True)
class NearestRoot:
    """Equations `hard` (z) = 0, and among the roots the one with the least `soft` (z), then with the least change of z.

    `scale` (n,): sizes of the unknowns, which make changes comparable; `limit` (n,): the largest change in one step.
    """

    hard: Rows
    soft: Rows | None
    scale: np.ndarray
    limit: np.ndarray

    def usual(self, z: np.ndarray) -> np.ndarray:
        """What the sizes of the unknowns make of each row (m,), by differences: derivatives may vanish where the search begins."""
        shake, r = np.random.default_rng(0), self.hard.residual(z)
        around = [self.hard.residual(z + _AROUND * self.scale * shake.uniform(-1.0, 1.0, z.size)) for _ in range(_SAMPLES)]
        change = np.abs(np.column_stack([beside - r for beside in around])) / _AROUND
        return np.median(np.where(np.isfinite(change), change, 0.0), axis=1)

    def __call__(self, guess: np.ndarray, usual: np.ndarray | None = None, begin: np.ndarray | None = None) -> Root:
        """The one nearest to `guess` (n,), where the search begins, unless `begin` (n,) is given; `usual` where it is known from nearby."""
        near, guess = guess, guess if begin is None else begin
        usual = self.usual(guess) if usual is None else usual
        J, r = self.hard.jacobian(guess), self.hard.residual(guess)
        slope = np.max(np.abs(np.where(np.isfinite(J), J, 0.0) * self.scale), axis=1, initial=0.0)
        rounding = self._zero(guess)
        rows = np.fmax(np.fmax(slope, usual), rounding)
        rows = np.where(rows > 0, rows, np.where(np.abs(r) > 0, np.abs(r), 1.0))
        rows = np.where(
            np.fmax(slope, usual) > rounding, rows, rows / _RANK
        )  # nothing moves such a row, and rounding is no slope
        sizes = Sizes(self.scale, rows, lambda z: self._zero(z) / ROUNDING, _RANK, limit=self.limit / self.scale)
        found = self._searched(guess, near, sizes)
        if not found.part < np.inf:
            return Root(found.y, found.left, found.left, False, np.zeros((guess.size, 0)))
        J = sizes.scaled(self.hard.jacobian(found.y))
        # where a slope is infinite nothing is known to be free
        free = self.scale[:, None] * freedom(J, _RANK) if np.isfinite(J).all() else np.zeros((guess.size, 0))
        return Root(found.y, found.left, found.left / rows, found.converged, free)

    def _zero(self, z: np.ndarray) -> np.ndarray:
        """What counts as zero in each row (m,)."""
        return _ZERO * self.hard.rounding(z, self.scale)

    def _told(self, found: Assembled, sizes: Sizes) -> Assembled:
        """Converged, too, where what is left would move the unknowns by no more than rounding does: rows may be sums of terms that
        rounding of their arguments does not tell of.
        """
        if found.converged or not found.part < _NEXT_TO_NOTHING:
            return found
        J, c = sizes.scaled(self.hard.jacobian(found.y)), found.left / sizes.rows
        if not np.isfinite(J).all():
            return found
        step, allowed = np.linalg.lstsq(J, -c, rcond=_RANK)[0], _ZERO * np.finfo(float).eps
        moved = np.max(np.abs(step) / (1 + np.abs(found.y / self.scale)), initial=0.0)
        left = np.max(np.abs(c + J @ step), initial=0.0)
        return replace(found, converged=bool(moved <= allowed and left <= ROUNDING))

    def _searched(self, guess: np.ndarray, near: np.ndarray, sizes: Sizes) -> Assembled:
        """For the wishes first, then with these held, for the least distance."""

        def hard(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self.hard.residual(z), self.hard.jacobian(z)

        def back(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return (z - near) / self.scale, np.diag(1 / self.scale)

        soft, exact = self.soft, partial(assemble, tolerance=0.0, stride=np.inf, approach=False)
        if soft is None:
            return self._told(exact(hard, guess, back, sizes=sizes), sizes)
        most = np.max(np.abs(soft.jacobian(guess) * self.scale), axis=1, initial=0.0)
        size = np.where(most > 0, most, 1.0)
        found = exact(hard, guess, lambda z: (soft.residual(z) / size, soft.jacobian(z) / size[:, None]), sizes=sizes)
        found = self._told(found, sizes)
        if not found.converged:
            return found
        met, n = soft.residual(found.y), sizes.rows.size

        def held(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            (c, J), r = hard(z), soft.residual(z) - met
            return np.concatenate([c, r]), np.vstack([J, soft.jacobian(z)])

        def rounding(z: np.ndarray) -> np.ndarray:
            return np.concatenate([self._zero(z), _ZERO * soft.rounding(z, self.scale)]) / ROUNDING

        nearest = exact(held, found.y, back, sizes=replace(sizes, rows=np.concatenate([sizes.rows, size]), rounding=rounding))
        return replace(nearest, left=nearest.left[:n]) if nearest.converged else found


def largest_gaps(names: Sequence[str], residual: np.ndarray, parts: np.ndarray) -> str:
    """At most four rows in words, those with the largest `parts` (n,) first; what is not finite counts as larger than any number."""
    size = np.nan_to_num(np.abs(parts), nan=np.inf)
    worst = [i for i in np.argsort(-size, kind="stable") if size[i] > 1e-3 * min(np.max(size), 1e300)][:4]
    return ", ".join(f"{names[i]} (off by {residual[i]:.3g})" for i in worst)
