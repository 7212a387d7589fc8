"""Singular positions of loops, looked for on a walk along the freedom that the loops leave.

A position is singular where the constraints have fewer independent rows than around it: there, branches of the motion cross. Towards it
the smallest singular value falls like the distance, and beyond it rises as fast. From near by the place itself is found, and whether branches
meet there (see `crossing`). A walk may step across it unseen; where one freedom is left, it then finds the determinant of the constraints and
the direction of the motion with the other sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from acausal.loops.crossing import Crossing, Trail, crossing_near
from acausal.loops.walk import Walk
from acausal.numerics.independent import Independent
from acausal.numerics.thresholds import CLOSED, SINGULAR

_STRIDE = 0.35
_LENGTH, _WHOLE = 5.0, 20.0
"""How far a walk goes; how far at most with one freedom."""
_AHEAD, _REACH, _BEYOND = 0.1, 3.0, 0.05
"""How far crossings may be ahead where they are looked for, and times as far away; how far the walk goes on behind one."""
_MOST_STEPS = 60
_UNCHANGED, _CHANGED, _LONGEST = 0.07, 0.15, 64.0
"""Changes in a step below which the next one is twice as long, and above which half; and how many times as long as usual it is at most."""
_RETURNS, _SAME = 8, 1e-3
"""Steps along the way to where it is nearest to its start, and how near it is there if it comes back."""
_SHARPER = 0.6
"""Of the larger of two values to either side: less between them may be a tip, at which it is 0.45 at most in the golden section."""
_GOLDEN = 0.382
_MOST_CUTS = 40


@dataclass(frozen=True)
class _Place:
    """A configuration z; the smallest singular value there, and the sign of the determinant, 0 where there is none."""

    z: np.ndarray
    smallest: float
    side: float
    along: np.ndarray
    """(nv,), the part of the motion in which the loops let go."""
    freedoms: int
    rows: np.ndarray
    """A / scale (m, nv)."""


@dataclass(frozen=True)
class _Look:
    """How places of a walk are seen: with rows of A divided by `scale` (m,), `rank` of them independent in general, `kept` for example."""

    walk: Walk
    scale: np.ndarray
    rank: int
    kept: tuple[int, ...]

    def at(self, z: np.ndarray, ahead: np.ndarray) -> _Place:
        """Seen in motion along `ahead` (nv,)."""
        A = self.walk.at(z)[2] / self.scale[:, None]
        plain = Independent.of(A)
        if plain is not None and plain.rows.size == self.rank == len(A):
            smallest, along, freedoms = plain.smallest, plain.free(ahead), plain.freedoms
        else:
            _, s, Vt = np.linalg.svd(A)
            free = Vt[self.rank :]
            smallest, along, freedoms = float(s[self.rank - 1]), (free @ ahead) @ free, len(free)
        side = float(np.linalg.slogdet(np.vstack([A[list(self.kept)], along]))[0]) if freedoms == 1 else 0.0
        return _Place(z, smallest, side, along, freedoms, A)

    def crossing(self, place: _Place, reach: float, known: Sequence[Crossing]) -> Crossing | None:
        """Near a closed configuration: one that is known, or else looked for. Short strides make no place a far one."""
        reach = max(reach, _BEYOND)
        near = (one for one in known if np.max(np.abs(one.z - place.z)) < reach)
        return next(near, None) or crossing_near(self.walk, place.z, self.scale, self.kept, reach)

    def between(self, a: _Place, b: _Place, part: float, ahead: np.ndarray) -> _Place | None:
        """A closed configuration on the way from one place to another."""
        z = self.walk.closed(
            (1 - part) * a.z + part * b.z, CLOSED
        )  # what is less closed may lie between two branches that pass each other
        return None if z is None else self.at(z, ahead)


def row_scale(jacobians: Sequence[np.ndarray]) -> np.ndarray:
    """Largest lengths (m,) of the rows of A (m, nv) at some configurations."""
    scale = np.max([np.linalg.norm(A, axis=1) for A in jacobians], axis=0)
    largest = float(np.max(scale, initial=0.0))
    return np.maximum(scale, 1e-6 * largest) if largest > 0 else np.ones(scale.size)  # rows without slope have no length


def singular_values_along(walk: Walk, start: np.ndarray, scale: np.ndarray, rank: int, kept: tuple[int, ...]) -> Trail:
    """Smallest singular values of A, and where, on a walk from the assembled configuration `start`, most of a turn of a hinge to either side, with one
    freedom until it is back: those of its places, and the least ones between them; and the crossings that it comes to.

    `scale` (m,): of the rows of A; `rank`: its independent rows in general, `kept` for example. At most 120 steps with two singular value
    decompositions each, and some more where the singular value has a sharp least.
    """
    look = _Look(walk, scale, rank, kept)
    ahead = np.random.default_rng(1).normal(size=walk.rate.size)
    trail = Trail()
    for sense in (1.0, -1.0):
        trail = _one_way(look, start, sense * ahead, trail)
        if trail.back:
            break
    return trail


def _one_way(look: _Look, start: np.ndarray, ahead: np.ndarray, trail: Trail) -> Trail:
    """A `trail` with what is found from step to step.

    The walk goes on in the same direction, first `ahead` (nv,), where there are several freedoms, and with one until it is back. A step ends short of
    where the singular value, extrapolated, is zero: it shrinks by the same factor from step to step before a crossing, and levels off before one
    that is missed. Crossings are stepped over as soon as they are known. Steps are the longer the less the rows change in them: screws turn many times.
    """
    here, walked, stride, before, times = look.at(start, ahead), 0.0, _STRIDE, np.inf, 1.0
    last: list[_Place] = []
    for _ in range(_MOST_STEPS):
        slope = (before - here.smallest) / stride if np.isfinite(before) else 0.0
        left = here.smallest / slope if slope > 0 else np.inf
        beside = left < _AHEAD or here.smallest < SINGULAR
        near = look.crossing(here, _REACH * min(left, _AHEAD), trail.crossings) if beside else None
        last = [*last[-2:], here]
        found = Trail.at(here.smallest, here.z, near)
        if near is None:
            found = found.and_then(_least(look, last, ahead, trail.crossings))
        trail = trail.and_then(found)
        whole = here.freedoms == 1
        back = whole and walked > 1 and _is_back(look, here, start)
        if back or walked > (_WHOLE if whole else _LENGTH) or not np.max(np.abs(here.along), initial=0.0) > 1e-6:
            return replace(trail, back=back)
        stride = min(times * _STRIDE, 0.6 * left) if slope > 0 else times * _STRIDE
        if near is not None and near.crosses:
            last, stride = [], min(_STRIDE, _BEYOND + 2 * float(np.max(np.abs(near.z - here.z))))
        ahead = here.along / np.max(np.abs(here.along))
        there = look.walk.closed(here.z + look.walk.at(here.z)[3] @ (stride * ahead))
        if there is None:
            break
        before, walked, rows = here.smallest, walked + stride / times, here.rows
        here = look.at(there, ahead)
        if whole:
            changed = _changed(rows, here.rows) * times * _STRIDE / stride
            times = min(2 * times, _LONGEST) if changed < _UNCHANGED else max(0.5 * times, 1.0) if changed > _CHANGED else times
    return trail


def _changed(before: np.ndarray, after: np.ndarray) -> float:
    """How much the columns of rows (m, nv) have changed, as a part of their lengths: those of hinges as much as these turn, however short their arms."""
    lengths = np.linalg.norm(before, axis=0)
    return float(np.max(np.linalg.norm(after - before, axis=0) / np.where(lengths > 0, lengths, np.inf), initial=0.0))


def _is_back(look: _Look, here: _Place, start: np.ndarray) -> bool:
    """Whether the way goes through its start again, but for whole turns, within a stride from here: a screw that has turned once is only near it."""
    for _ in range(_RETURNS):
        away = look.walk.apart(here.z, start)
        if not np.max(np.abs(away)) < _STRIDE:
            return False
        if np.max(np.abs(away)) < _SAME:
            return True
        along = look.walk.at(here.z)[3] @ here.along
        there = look.walk.closed(here.z - (away @ along) / float(along @ along) * along)
        if there is None:
            return False
        here = look.at(there, here.along)
    return False


def _least(look: _Look, last: list[_Place], along: np.ndarray, known: Sequence[Crossing]) -> Trail:
    """Where the singular value is least between the last places, if it has a tip there or the determinant changes sign: a singular position, or
    close to one.
    """
    if len(last) > 1 and last[-1].side * last[-2].side < 0:
        a, c = last[-2:]
        b = look.between(a, c, 0.5, along)
    elif len(last) > 2 and _is_tip(*last):
        a, b, c = last
    else:
        return Trail()
    p, q, r = 0.0, 0.5, 1.0
    least: _Place | None = None
    for _ in range(_MOST_CUTS):
        if b is None:
            break
        near = (
            look.crossing(b, _REACH * float(np.max(np.abs(c.z - a.z))), known)
            if least is None or b.smallest < least.smallest
            else None
        )
        if near is not None:
            return Trail.at(b.smallest, b.z, near)
        least = min((b,) if least is None else (least, b), key=lambda place: place.smallest)
        if b.smallest < SINGULAR or not (a.side * c.side < 0 or _is_tip(a, b, c)):
            break
        # golden section of the larger part
        before = q - p > r - q
        new = look.between(a, b, 1 - _GOLDEN, along) if before else look.between(b, c, _GOLDEN, along)
        if new is None:
            break
        where = q - _GOLDEN * (q - p) if before else q + _GOLDEN * (r - q)
        four = [(p, a), (where, new), (q, b), (r, c)] if before else [(p, a), (q, b), (where, new), (r, c)]
        middle = 1 if four[1][1].smallest < four[2][1].smallest else 2
        (p, a), (q, b), (r, c) = four[middle - 1 : middle + 2]
    return Trail() if least is None else Trail.at(least.smallest, least.z)


def _is_tip(a: _Place, b: _Place, c: _Place) -> bool:
    return b.smallest <= min(a.smallest, c.smallest) and b.smallest < _SHARPER * max(a.smallest, c.smallest)
