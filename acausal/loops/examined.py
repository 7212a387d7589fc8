"""What was found about a group of loops, and by how much it holds elsewhere: at another time, configuration, or with other parameters.

Rows are independent where the smallest of their singular values is not zero, and others follow from them where the next one is: both are
numbers without unit, and say how far a decision is from being another one.
"""

from __future__ import annotations

import functools
import threading
from dataclasses import dataclass, field

import numpy as np

from acausal.loops.loop_groups import LoopGroup
from acausal.loops.redundancy import RankReport
from acausal.loops.singular import row_scale
from acausal.loops.walk import Walk
from acausal.numerics.thresholds import SINGULAR

_LOOKS = 8
"""Places of a walk that are looked at again with other values."""
_SHRUNK = 0.5
"""A margin below this part of what it was asks for another examination."""


@dataclass(frozen=True)
class Margin:
    """`independent`: smallest singular value of the kept rows, each divided by its usual length; `follows`: the largest one that counts as
    zero; `rank`: how many do not, of the singular values above `zero`."""

    independent: float
    follows: float
    rank: int
    zero: float


@dataclass(frozen=True)
class Examined:
    """What is known of a group: assembled configurations of its coordinates, independent rows, the rows to be used."""

    group: LoopGroup
    samples: list[np.ndarray]
    opened: list[np.ndarray]
    """Configurations beside these."""
    rank: RankReport
    chosen: tuple[int, ...]
    damped: bool
    singular: bool
    A: np.ndarray
    """Rows in the velocities at the start."""
    timed: bool
    """Whether the time enters."""
    empty: tuple[str, ...] = ()
    """Rows that only hold rounding errors, whatever the parameters."""
    walk: Walk | None = None
    """With the values of parameters and the time at which this was found."""
    scale: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Usual lengths of the rows (m,)."""
    trail: tuple[tuple[float, np.ndarray], ...] = ()
    """Smallest singular values on a walk, and where."""
    lock: threading.Lock = field(default_factory=threading.Lock, compare=False)
    """Kernels serve one thread at a time."""

    @property
    def least(self) -> float:
        """The smallest singular value that was met."""
        return min((smallest for smallest, _ in self.trail), default=1.0)

    def margin(self, q: np.ndarray, time: float, other: Walk | None = None, scale: np.ndarray | None = None) -> Margin:
        """At a configuration (nq,) with closed loops; of an `other` walk, with other values of parameters."""
        walk = other or self.walk
        assert walk is not None
        with self.lock:
            walk.time = time
            A = walk.at(q / walk.unit)[2] / (self.scale if scale is None else scale)[:, None]
        return self._margin(A, walk)

    def _margin(self, A: np.ndarray, walk: Walk) -> Margin:
        if not np.isfinite(A).all():
            return Margin(0.0, np.inf, 0, walk.rank)
        every, r = np.linalg.svd(A, compute_uv=False), self.rank.rank
        kept = np.linalg.svd(A[list(self.rank.kept)], compute_uv=False) if r else np.ones(1)
        rank = int(np.sum(every > walk.rank))
        return Margin(float(kept[-1]), float(every[r]) if r < every.size else 0.0, rank, walk.rank)

    def decided(self, margin: Margin) -> bool:
        """Whether the same rows follow from the others, and those are independent but for singular positions that are known."""
        return margin.rank <= self.rank.rank and (self.singular or margin.independent >= SINGULAR)

    def with_values(self, values: np.ndarray) -> Walk | None:
        """A walk with other values of parameters where everything is decided alike by margins not much smaller; None where that is not
        clear from the places that were looked at.
        """
        if self.singular or not self.trail or self.walk is None:
            return None
        walk = Walk(self.walk.symbolic, values, self.samples[0], self.walk.time)
        with self.lock:
            here = self._margins(walk)
            usual = self._usual
        if len(here) < len(usual):
            return None
        alike = all(
            a.rank == b.rank and a.independent > _SHRUNK * b.independent and a.independent > SINGULAR
            for a, b in zip(here, usual, strict=True)
        )
        return walk if alike else None

    @functools.cached_property
    def _looks(self) -> list[np.ndarray]:
        """The most critical places of the walk (nq,), and others along it."""
        order = sorted(range(len(self.trail)), key=lambda k: self.trail[k][0])
        spread = np.linspace(0, len(order) - 1, _LOOKS).astype(int)
        return [self.trail[k][1] for k in sorted({*order[: _LOOKS // 2], *spread.tolist()})]

    @functools.cached_property
    def _usual(self) -> list[Margin]:
        assert self.walk is not None
        return self._margins(self.walk)

    def _margins(self, walk: Walk) -> list[Margin]:
        """At the places that are looked at, closed for the values of the walk, as far as they can be closed."""
        rows: list[np.ndarray] = []
        for q in self._looks:
            z = walk.closed(q / walk.unit)
            if z is None:
                return []
            rows.append(walk.at(z)[2])
        scale = row_scale(rows)
        return [self._margin(A / scale[:, None], walk) for A in rows]
