"""What was found about a group of loops, and by how much it holds elsewhere: at another time, configuration, or with other parameters.

Rows are independent where the smallest of their singular values is not zero, and others follow from them where the next one is: both are
numbers without unit, and say how far a decision is from being another one.
"""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from acausal.loops.crossing import Crossing, crossing_near
from acausal.loops.loop_groups import LoopGroup
from acausal.loops.redundancy import RankReport
from acausal.loops.second_order import held_to_second_order
from acausal.loops.walk import Walk
from acausal.numerics.independent import Independent, free_directions
from acausal.numerics.sizes import positive
from acausal.numerics.thresholds import RANK, SINGULAR

_LOOKS = 8
"""Places of a walk that are looked at again with other values."""
_KEPT = 8
"""Values of parameters for which a walk is kept, and configurations for which a margin is."""
_NARROW = 0.2
"""Singular values on a walk, which may step over still smaller ones, from which on digits are lost between its places."""
_SHRUNK = 0.5
"""What may be lost of a margin before an examination is made again."""
_ALONG = 0.7
"""How far a configuration may be from the nearest place of a walk that came by: two strides."""
_NEXT = 0.1
"""How far a singular position may be from a state that is said to be next to it: rad, or sizes of the loop."""


@contextlib.contextmanager
def _at_time(walk: Walk, time: float) -> Generator[Walk]:
    """A walk, which others use at its own time, at another one."""
    before, walk.time = walk.time, time
    try:
        yield walk
    finally:
        walk.time = before


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
    rates: np.ndarray
    """How much each velocity is."""
    timed: bool
    """Whether the time enters."""
    empty: tuple[str, ...] = ()
    """Rows that only hold rounding errors, whatever the parameters and the time."""
    walk: Walk | None = None
    """With the values of parameters and the time at which this was found."""
    scale: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Usual lengths of the rows (m,)."""
    trail: tuple[tuple[float, np.ndarray], ...] = ()
    """Smallest singular values on a walk, and where."""
    crossings: tuple[Crossing, ...] = ()
    """Places near the walk where branches cross, or nearly do."""
    back: bool = False
    """Whether the walk came back to its start: a motion that begins elsewhere is another circuit's."""
    parameters: tuple[int, ...] = ()
    """Places of the parameters on which the group depends."""
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """All parameters where this was found."""
    lock: threading.Lock = field(default_factory=threading.Lock, compare=False)
    """Kernels serve one thread at a time."""

    @functools.cached_property
    def usual(self) -> Margin:
        """At the first configuration with closed loops that has as many independent rows as usual; the smallest of the walk where none has."""
        found = [self.margin(q, self.walk.time, self.values) for q in self.samples if self.walk is not None]
        return next((m for m in found if m.independent >= SINGULAR), found[0])

    @property
    def least(self) -> float:
        """The smallest singular value that was met."""
        return min((smallest for smallest, _ in self.trail), default=1.0)

    @property
    def narrow(self) -> bool:
        """Whether motions may pass closely by a singular position: with one freedom, the walk meets what they do; with several it may miss that."""
        if self.singular and self.group.v.numel() - self.rank.rank == 1:
            return any(crossing.misses for crossing in self.crossings)
        return self.least < _NARROW

    @property
    def may_miss(self) -> bool:
        """Whether motions through singular positions have others beside them that miss these."""
        return self.singular and (self.group.v.numel() - self.rank.rank > 1 or self.narrow)

    def met(self, q: np.ndarray) -> bool:
        """Whether the walk came by at a configuration (nq,) of the group with closed loops, as far as it can tell."""
        walk = self.walk
        if walk is None or not self.back:
            return True
        places = (circuit for circuit in self._circuits if circuit.size)
        near = (np.max(np.abs(walk.apart(circuit / walk.unit, q / walk.unit)), axis=1).min() < _ALONG for circuit in places)
        return any(near) or any(not circuit.size for circuit in self._circuits)

    def learn(self, other: Examined | None) -> None:
        """That another circuit is decided as this one is; None, or one that does not close: that no more is to be known of any."""
        self._circuits.append(np.zeros((0, 0)) if other is None or not other.back else other._places)

    @property
    def _places(self) -> np.ndarray:
        return np.array([q for _, q in self.trail])

    @functools.cached_property
    def _circuits(self) -> list[np.ndarray]:
        return [self._places]

    def missed(self, q: np.ndarray, ahead: np.ndarray, time: float, values: np.ndarray) -> tuple[float, float] | None:
        """How far a motion of the group's coordinates q (nq,) next to a singular position, straight `ahead` [1/s], misses it, and its speed there
        [1/s]: as parts of the size of the loops. None where no such position is found.
        """
        if not (np.isfinite(q).all() and np.isfinite(ahead).all()):
            return None
        with self.lock, _at_time(self._walk(values), time) as walk:
            near = crossing_near(walk, q / walk.unit, self.scale, self.rank.kept, _NEXT)
        return None if near is None else near.missed(q / walk.unit, ahead / walk.unit)

    def stopped(self, q: np.ndarray, time: float, values: np.ndarray) -> bool:
        """Whether more is free at a configuration (nq,) with closed loops than can move, there and wherever it leads to."""
        if self.walk is None or not self.singular:
            return False
        with self.lock, _at_time(self._walk(values), time) as walk:
            return held_to_second_order(walk, q / walk.unit, self.scale)

    def beside(self, q: np.ndarray, ahead: np.ndarray, time: float, values: np.ndarray) -> np.ndarray | None:
        """A configuration (nq,) with closed loops a little `ahead` (nq,) of one; None where nothing moves or none is found."""
        if self.walk is None:
            return None
        with self.lock, _at_time(self._walk(values), time) as walk:
            way = ahead / walk.unit
            size = float(np.max(np.abs(way), initial=0.0))
            there = walk.closed(q / walk.unit + _NEXT * way / size) if 0 < size < np.inf else None
        return None if there is None else there * walk.unit

    def margin(self, q: np.ndarray, time: float, values: np.ndarray) -> Margin:
        """At a configuration (nq,) of the group with closed loops, for these values of all parameters (np,); as it was found before."""
        key = q.tobytes() + np.array(time).tobytes() + values[list(self.parameters)].tobytes()
        with self.lock:
            if key in self._margins:
                return self._margins[key]
            walk = self._walk(values)
            scale = positive(np.where(walk.empty, np.max(self.scale), self.scale))  # 1 where all are empty
            if self.timed and time != walk.time and walk.empty.any():  # what is empty now may not be then
                walk = Walk(walk.symbolic, values, q, time)
            with _at_time(walk, time):
                A = walk.at(q / walk.unit)[2] / scale[:, None]
            if len(self._margins) >= _KEPT:
                self._margins.clear()
            found = self._margins[key] = self._margin(A, walk, float(np.max(walk.noise / scale, initial=0.0)))
        return found

    @functools.cached_property
    def standing(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of the group's positions and velocities that its loops hold for good, though others move."""
        walk, none = self.walk, np.zeros(0, dtype=int)
        if walk is None or self.timed or len(self.samples) < 2:
            return none, none
        positions = np.flatnonzero(np.ptp([q / walk.unit for q in self.samples], axis=0) < RANK)
        if not positions.size:
            return none, none
        rng, scale = np.random.default_rng(6), positive(np.where(walk.empty, np.max(self.scale), self.scale))
        moves = np.zeros(self.group.v.numel())
        for q in self.samples:
            free, _ = free_directions(walk.at(q / walk.unit)[2] / scale[:, None], walk.rank)
            moves = np.fmax(moves, np.abs(free(rng.normal(size=moves.size))))
        return positions, np.flatnonzero(moves < RANK)

    def _walk(self, values: np.ndarray) -> Walk:
        """With these values of the parameters, as far as the group depends on them; some are kept."""
        assert self.walk is not None
        key = values[list(self.parameters)].tobytes()
        if key not in self._walks:
            if len(self._walks) >= _KEPT:
                self._walks.clear()
            own = np.array_equal(values[list(self.parameters)], self.values[list(self.parameters)])
            self._walks[key] = self.walk if own else Walk(self.walk.symbolic, values, self.walk.guess, self.walk.time)
        return self._walks[key]

    @functools.cached_property
    def _margins(self) -> dict[bytes, Margin]:
        return {}

    @functools.cached_property
    def _walks(self) -> dict[bytes, Walk]:
        return {}

    def _margin(self, A: np.ndarray, walk: Walk, noise: float = 0.0) -> Margin:
        if not np.isfinite(A).all():
            return Margin(0.0, np.inf, 0, walk.rank)
        plain = Independent.of(A, max(walk.rank, noise)) if self.rank.rank == len(A) else None
        if plain is not None and plain.rows.size == len(A):
            return Margin(plain.smallest, 0.0, len(A), max(walk.rank, noise))
        every, r = np.linalg.svd(A, compute_uv=False), self.rank.rank
        kept = every if r == len(A) else np.linalg.svd(A[list(self.rank.kept)], compute_uv=False) if r else np.ones(1)
        least = max(walk.rank, noise)
        rank = int(np.add.reduce(every > least))
        return Margin(float(kept[-1]), float(every[r]) if r < every.size else 0.0, rank, least)

    def decided(self, margin: Margin) -> bool:
        """Whether the same rows follow from the others, and those are independent but for singular positions that are known."""
        return margin.rank <= self.rank.rank and (self.singular or margin.independent >= SINGULAR)

    def holds(self, values: np.ndarray) -> bool:
        """Whether everything is decided alike with other values of parameters (np,), surely: no singular value changes by more than the rows
        do (Weyl 1912), and at some places of the walk these change by less than half of the smallest one.
        """
        if np.array_equal(values[list(self.parameters)], self.values[list(self.parameters)]):
            return True
        if self.singular or not self.trail or self.walk is None:
            return False
        with self.lock:
            there, here = self._rows(self._walk(values)), self._usual_rows
        allowed, r = _SHRUNK * self.least, self.rank.rank
        margins = [self._margin(A, self.walk) for A in there]
        follow = all(margin.rank == r and margin.follows <= self.walk.follows for margin in margins)
        return (
            follow and len(there) == len(here) and all(np.linalg.norm(A - B) < allowed for A, B in zip(there, here, strict=True))
        )

    @functools.cached_property
    def _looks(self) -> list[np.ndarray]:
        """The most critical places of the walk (nq,), and others along it."""
        order = sorted(range(len(self.trail)), key=lambda k: self.trail[k][0])
        spread = np.linspace(0, len(order) - 1, _LOOKS).astype(int)
        return [self.trail[k][1] for k in sorted({*order[: _LOOKS // 2], *spread.tolist()})]

    @functools.cached_property
    def _usual_rows(self) -> list[np.ndarray]:
        assert self.walk is not None
        return self._rows(self.walk)

    def _rows(self, walk: Walk) -> list[np.ndarray]:
        """At the places that are looked at, closed for the values of the walk; fewer where one cannot be closed."""
        rows: list[np.ndarray] = []
        for q in self._looks:
            z = walk.closed(q / walk.unit)
            if z is None:
                break
            rows.append(walk.at(walk.polished(z))[2] / self.scale[:, None])
        return rows
