"""Of several configurations that close, the one nearest to the sketch.

A descent from the sketch ends somewhere near it, but not always at the nearest place. Branches meet where the constraints' derivatives
lose rank, so they lie apart along the directions in which these are softest: searches that begin on either side of the sketch along
these directions, as far from it as what was found, and in some others, find what is nearer. All numbers are without unit.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from acausal.numerics.independent import Independent

_ROUNDS = 3
"""Searches all about the sketch, each with what the last one found."""
_SOFTEST, _OTHERS = 4, 4
"""Directions, each with both senses, and random ones."""
_FEW, _ROUGH = 4, 1.0
"""So many searches that all come to the same are enough, unless the sketch is as far away as this."""
_FARTHEST, _LEAST = 2.0, 0.1
"""Beginnings are within these distances of the sketch."""
_ALONE = 4.0
"""Beside a change of the derivatives this many times as large as that from the sketch nothing may lose rank, so that there is no other."""
_SAME = 1e-6
"""Distances, and misses of what is wished for, that differ by this part are the same ..."""
_APART = 1e-4
"""... and coordinates that differ by this."""


@dataclass(frozen=True)
class Candidate:
    """A configuration z (n,) that closes; by how much it misses what is wished for, and how far each coordinate is from the sketch (k,)."""

    z: np.ndarray
    missed: float
    apart: np.ndarray

    @property
    def distance(self) -> float:
        """From the sketch."""
        return float(np.linalg.norm(self.apart))

    def is_as(self, other: Candidate) -> bool:
        """Whether it is the same configuration."""
        return bool(np.all(np.abs(self.apart - other.apart) <= _APART))

    def is_as_near_as(self, other: Candidate) -> bool:
        """Whether neither misses less, nor is nearer."""
        pairs = ((self.missed, other.missed), (self.distance, other.distance))
        return all(abs(mine - theirs) <= _SAME * (1 + theirs) for mine, theirs in pairs)

    def precedes(self, other: Candidate) -> bool:
        """Whether it misses less, or is nearer; of two that are as near, as mirror images are, the one with the smaller sum of the cubes of the distances,
        which no order of the coordinates has to do with; where these are as large, the one whose coordinates come to more, the first first.
        """
        if not self.is_as_near_as(other):
            off = abs(self.missed - other.missed) > _SAME * (1 + other.missed)
            return self.missed < other.missed if off else self.distance < other.distance
        cubes, theirs = (float(np.sum(one.apart**3)) for one in (self, other))
        if abs(cubes - theirs) > _APART * (1 + abs(cubes)):
            return cubes < theirs
        ahead = self.apart - other.apart
        telling = np.flatnonzero(np.abs(ahead) > _APART)
        return bool(telling.size) and bool(ahead[telling[0]] > 0)


def nearest_rival(
    found: Candidate,
    sketch: np.ndarray,
    close: Callable[[np.ndarray], Candidate | None],
    slopes: Callable[[np.ndarray], np.ndarray],
    dependent: float,
    *,
    wished: bool = False,
) -> Candidate:
    """The best of what was `found` from the `sketch` (n,) and of what `close` finds from beginnings about that; None: nothing closes.

    `slopes`: z -> derivatives of the constraints (m, n), whose singular values below `dependent` count as zero. `wished`: the search that found it knows
    of those that are as near which way wishes lead. Cost: four searches, twelve
    or more where these come to different places; one comparison of slopes where the sketch is so near that there can be no other.
    """
    first, at_sketch = found, slopes(sketch)
    for _ in range(_ROUNDS):
        J = slopes(found.z)
        s, soft = _softest(J, dependent)
        if found.missed <= _SAME and s.size and _ALONE * float(np.linalg.norm(J - at_sketch)) < s[0]:
            break
        best, others = found, found.distance > _ROUGH
        for k, direction in enumerate(_directions(soft, sketch.size)):
            if k >= _FEW and not others:
                break
            reach = min(max(best.distance, _LEAST), _FARTHEST)
            rival = close(sketch + reach * direction)
            others |= rival is not None and not rival.is_as(best)
            kept = wished and best is first
            if rival is not None and rival.precedes(best) and not (kept and rival.is_as_near_as(best)):
                best = rival
        if best is found:
            break
        found = best
    return found


def _softest(J: np.ndarray, dependent: float) -> tuple[np.ndarray, np.ndarray]:
    """Singular values that are not zero, the least first, and their directions in rows; of large matrices some of them."""
    if not J.size or not np.isfinite(J).all():
        return np.zeros(0), np.zeros((0, J.shape[1]))
    plain = Independent.of(J, dependent)
    if plain is not None:
        return plain.softest(_SOFTEST)[:2]
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    rank = int(np.sum(s > dependent * max(1.0, s[0])))
    return s[:rank][::-1], Vt[:rank][::-1]


def _directions(soft: np.ndarray, size: int) -> Iterator[np.ndarray]:
    for v in soft[:_SOFTEST]:
        yield v
        yield -v
    yield from _scattered(size)


@functools.cache
def _scattered(size: int) -> tuple[np.ndarray, ...]:
    """The same random directions (size,), of length 1 or less, whenever they are needed."""
    rng = np.random.default_rng(6)
    directions = rng.normal(size=(_OTHERS, size))
    lengths = rng.uniform(0.3, 1.0, _OTHERS) / np.linalg.norm(directions, axis=1)
    return tuple(directions * lengths[:, None])
