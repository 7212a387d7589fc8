"""Sizes: what is much for each unknown and for each row of equations, found from the equations themselves.

An angle is as it is. A length is measured by the lever arms of angles in the rows that it shares with them, any other unknown by the
terms of its rows; a row by what its unknowns can change in it. All of these scale exactly with the units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import casadi as ca
import numpy as np

from acausal.numerics.thresholds import CLOSED, CORNER, DEPENDENT, ROUNDING

_SAFETY = 1e3
_SLOW = 1e-4
"""Of the fastest rate: what slower ones are measured by."""
FAINT = 1e-6
"""A derivative by an unknown counts beside others by the same unknown where it is above this part of them."""


@dataclass(frozen=True)
class Sizes:
    """`unknowns` (n,) and `rows` (m,), all positive. `rounding`: y (n,) -> (m,), sums of the sizes of the rows' terms.

    `dependent`: singular values of J * unknowns / rows below this count as zero.
    """

    unknowns: np.ndarray
    rows: np.ndarray
    rounding: Callable[[np.ndarray], np.ndarray] | None = None
    dependent: float = DEPENDENT
    rate: float = 1.0
    """Of rates: the factor in `unknowns` and `rows` that makes them much."""
    limit: np.ndarray | None = None
    """How much each unknown may change at once, as part of its size (n,)."""

    def beside(self, fastest: float) -> Sizes:
        """Of rates beside the fastest of all: measured by a small part of it where they are slower, and known as well as it is."""
        more, rounding = max(1.0, _SLOW * fastest / self.rate), self.rounding
        unsure = CLOSED / ROUNDING * fastest / self.rate * self.rows
        return replace(
            self,
            unknowns=self.unknowns * more,
            rows=self.rows * more,
            rounding=None if rounding is None else lambda y: rounding(y) + unsure,
            rate=self.rate * more,
        )

    def of(self, rows: Sequence[int]) -> Sizes:
        """Only some of the rows."""
        kept, rounding = list(rows), self.rounding
        return replace(self, rows=self.rows[kept], rounding=None if rounding is None else lambda y: rounding(y)[kept])

    def only(self, unknowns: np.ndarray, whole: Callable[[np.ndarray], np.ndarray]) -> Sizes:
        """Only some of the unknowns, of which `whole` makes all."""
        rounding, limit = self.rounding, self.limit
        return replace(
            self,
            unknowns=self.unknowns[unknowns],
            rounding=None if rounding is None else lambda part: rounding(whole(part)),
            limit=None if limit is None else limit[unknowns],
        )

    def scaled(self, J: np.ndarray) -> np.ndarray:
        """A Jacobian (m, n) without units."""
        return J * self.unknowns / self.rows[:, None]


@dataclass(frozen=True)
class Drawn:
    """How well rows (m,) of closed loops are known: `far` [m], the distances in their constants; which are `shifts`, which `turns`."""

    far: np.ndarray
    shifts: np.ndarray
    turns: np.ndarray

    @staticmethod
    def joined(parts: Sequence[Drawn]) -> Drawn:
        """One after the other."""
        none = Drawn.exact(0)
        return Drawn(*(np.concatenate([getattr(part, f.name) for part in (none, *parts)]) for f in fields(Drawn)))

    @staticmethod
    def exact(count: int) -> Drawn:
        """Rows of other things."""
        return Drawn(np.zeros(count), np.zeros(count, dtype=bool), np.zeros(count, dtype=bool))

    @property
    def sizes(self) -> np.ndarray:
        """Sizes of terms that may have met in constants: the distances for shifts, 1 for turns."""
        return np.where(self.shifts, self.far, np.where(self.turns, 1.0, 0.0))

    def of(self, rows: Sequence[int]) -> Drawn:
        """Only some of the rows."""
        kept = list(rows)
        return Drawn(self.far[kept], self.shifts[kept], self.turns[kept])

    def unsure(self, lengths: np.ndarray) -> np.ndarray:
        """Which of the lengths (m, n) in rows of shifts may be nothing but what rounding of the distances leaves."""
        return self.shifts[:, None] & (lengths <= CLOSED * self.far[:, None])

    def terms(self, sizes: np.ndarray) -> np.ndarray:
        """What the constants add to the terms of rows of these `sizes` (m,), as part of these: distances beside the loop's own length."""
        own = np.min(sizes[self.shifts & (sizes <= self.far)], initial=np.inf)  # rows of rounding errors have larger sizes
        return np.where(self.shifts, self.far / sizes, self.far / own)

    def dependent(self, sizes: np.ndarray, least: float = DEPENDENT) -> float:
        """Singular values below this count as zero: constants are not known better."""
        return max(least, _SAFETY * float(np.finfo(float).eps) * float(np.max(self.terms(sizes), initial=0.0)))


def power_of_four(sizes: np.ndarray | float) -> np.ndarray:
    """The power of four nearest to each size: what is rounded to it scales exactly in other units, and small differences hardly change it.

    From one power to the next at 2.3 times: 2 times, half way, happens.
    """
    return 4.0 ** np.floor(0.5 * np.log2(sizes) + 0.4)


def positive(sizes: np.ndarray) -> np.ndarray:
    """1 where a size is zero or no number."""
    return np.where((sizes > 0) & (sizes < np.inf), sizes, 1.0)


def unknown_sizes(
    largest: np.ndarray, turning: np.ndarray, terms: np.ndarray, drawn: Drawn, instead: np.ndarray | None = None,
    loudest: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """What is much for each unknown (n,): 1 where `turning` (n,), which are angles and quaternions.

    `largest` (m, n): magnitudes of the derivatives of the rows, the largest at several places; `terms` (m,): sizes of the rows' terms,
    which count where rows have no lever arms; `loudest` (m,): their largest at the places of `largest`, where that is not one place. Unknowns without any of these have the sizes `instead` (n,) where these are positive, or
    the distances in the loops.
    """
    n = turning.size
    sizes = np.where(turning, 1.0, 0.0)
    if turning.all():
        return np.ones(n)
    faint = drawn.shifts[:, None] & ~turning & (largest < CLOSED)  # shifts by shifts: sines of angles
    largest = np.where(faint, 0.0, largest)
    heard = (largest > FAINT * np.max(largest, axis=0, initial=0.0)) & ~turning
    arms = np.max(largest[:, turning], axis=1, initial=0.0)
    arms = np.where(
        arms > CLOSED * (terms if loudest is None else loudest), arms, 0.0
    )  # others are rounding errors of rows that do not change with angles
    for sources in (arms, terms):
        ratio = np.where(heard, sources[:, None] / np.where(heard, largest, 1.0), 0.0).max(axis=0, initial=0.0)
        ratio = np.where(np.isfinite(ratio), ratio, 0.0)
        unknown = (sizes == 0) & ~turning
        sizes[unknown] = ratio[unknown]
    sizes = sizes if instead is None else np.where(sizes > 0, sizes, instead)
    known = sizes[~turning & (sizes > 0)]
    return positive(np.where(sizes > 0, sizes, known.max() if known.size else np.max(drawn.far, initial=0.0)))


def curvature(rows: ca.SX, y: ca.SX, places: np.ndarray) -> ca.SX:
    """Second derivatives (m, k + 1) of rows (m, 1): along each of the k unknowns at `places` (n,), then with all of them changing differently."""
    together = np.where(places, np.random.default_rng(4).uniform(0.5, 1.0, places.size), 0.0)
    moving = np.flatnonzero(places)
    used, _ = ca.jacobian_sparsity(rows, y).sub(list(range(rows.numel())), moving.tolist())
    # along unknowns of which no two are in one row at once
    coloured = used.uni_coloring(used.T)
    result = ca.SX(rows.numel(), moving.size + 1)
    result[:, moving.size] = _bend(rows, y, together)
    for colour in range(coloured.shape[1]):
        own = np.array(coloured.row())[coloured.colind()[colour] : coloured.colind()[colour + 1]]
        along = np.zeros(places.size)
        along[moving[own]] = 1.0
        bent = _bend(rows, y, along)
        for k in own.tolist():
            for i in used.row()[used.colind()[k] : used.colind()[k + 1]]:
                result[i, k] = bent[i]
    return result


def _bend(rows: ca.SX, y: ca.SX, along: np.ndarray) -> ca.SX:
    return ca.jtimes(ca.jtimes(rows, y, ca.DM(along)), y, ca.DM(along))


def bent_size(terms: np.ndarray, bends: np.ndarray, used: np.ndarray | None = None) -> np.ndarray:
    """How far unknowns (k,) go that no row changes with to first order, until rows with these `terms` (m,) and second derivatives `bends`
    (m, k + 1) change as much as their terms; 0 where nothing is bent.

    Each by itself where rows bend along it: in a direction of all, differences that happen to be small look straight. `used` (m, k): which stand in
    which rows. Those that do though no row has a slope or bend that is a number, as in a distance that is zero, go as far as the terms, or else by 1.
    """
    curved = (bends != 0) & (np.abs(bends) < CORNER)
    ratio = np.sqrt(2 * np.divide(terms[:, None], np.abs(bends), out=np.zeros(bends.shape), where=curved))
    reach = np.max(ratio, axis=0, initial=0.0)
    found = np.where(reach[:-1] > 0, reach[:-1], reach[-1])
    if used is None:
        return found
    own = np.max(np.where(np.isfinite(terms), terms, 0.0)[:, None] * used, axis=0, initial=0.0)
    return np.where((found > 0) | ~used.any(axis=0), found, np.where(own > 0, own, 1.0))


def row_sizes(largest: np.ndarray, unknowns: np.ndarray, terms: np.ndarray, drawn: Drawn | None = None) -> np.ndarray:
    """What is much in each row (m,): what an unknown of its size changes in it at most, and where that is only rounding its `terms`.

    All shifts of loops are measured alike, so that what is least of their gaps has a meaning; turns are sines of angles, of which 1 is much
    also where all axes are nearly parallel.
    """
    changes = np.max(largest * unknowns, axis=1, initial=0.0)
    real = changes > CLOSED * terms
    sizes = np.where(real, changes, terms)
    if drawn is not None:
        sizes[drawn.shifts & real] = np.max(sizes[drawn.shifts & real], initial=0.0)
        sizes[drawn.turns & real] = 1.0
    return positive(sizes)
