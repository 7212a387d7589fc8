"""Passes of singular positions in a run, looked at when it has ended.

With several freedoms a motion that misses such a position, by however little, goes on in another direction than one that leads straight through it.
What it misses it by is known to more digits than its rates tell, from where it would go straight on and where the position is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from acausal.collocation.problem import Solution
from acausal.errors import AccuracyWarning
from acausal.integrators.passage import Passage, passage_of
from acausal.loops.examined import Examined
from acausal.outputs.functions import Functions
from acausal.simulate.piece import Piece
from acausal.simulate.trajectory import Trajectory
from acausal.wording import callers_level

_PARTS, _POINTS = 32, 4096
"""Places of a step, and of all steps, at which is looked for the nearest one."""
_NEAR, _MOST = 0.1, 256
"""Clearances there of passes that are looked at, and how many of these."""
_CUTS, _SURE, _ROUNDS = 64, 1 / 32, 2
"""Places between two times at which is looked for the nearest one; part of the time between them in which it is known to lie before steps are refined;
how often is looked again between the neighbours of the nearest one."""
_STRAIGHT, _GROWTH, _UNTOLD = 1e-13, 4.0, 1e-9
"""Misses that are nothing but rounding, as parts of the size of the loops, at the first pass; times as much at each further one; at most."""
_NEARER = np.array([1.0, 4.0])
"""Times as near as usual, places that states are interpolated from."""
_LONG = 20.0
"""Times a miss: a step that sees nothing of it."""


@dataclass(frozen=True)
class _Pass:
    """The state x (nx,) at time t [s] nearest to a singular position, in a step of size h."""

    t: float
    x: np.ndarray
    h: float


def warn_if_missed(functions: Functions, run: Trajectory) -> bool:
    """Say so when a step led straight through a singular position that the motion misses; whether one did."""
    constraints = functions.outputs.system.constraints
    parts = [part for part in constraints.examined if part.may_miss]
    if not parts or functions.space.coordinates is not None:
        return False
    straight = _STRAIGHT
    for piece in run.pieces:
        passage = passage_of(piece.problem)
        if passage is None or piece.chart is not None:
            continue
        for found in _passes(piece, passage):
            miss = max((_missed(part, functions, passage, found) for part in parts), default=0.0)
            if miss > straight:
                joints = ", ".join(f"'{rows.edge.name}'" for part in parts for rows in part.group.loops)
                warnings.warn(
                    f"At t = {found.t:.6g} s the motion misses a singular position of the loops closed by {joints} by {miss:.2g} of their size, and a "
                    f"step of {found.h:.2g} s led through it: where branches of the motion cross, or nearly do, a motion that passes by turns aside, however "
                    "near it is. The motion after it is not reliable: begin where it misses the position by more, or by nothing at all.",
                    AccuracyWarning, stacklevel=callers_level(),
                )  # fmt: skip
                return True
            straight = min(_GROWTH * straight, _UNTOLD)
    return False


def _missed(part: Examined, functions: Functions, passage: Passage, found: _Pass) -> float:
    """What a pass misses a singular position of `part` by, as part of the size of its loops; 0 where the step is short enough to see it."""
    nearest = np.array([found.t]), found.x[None, :]
    tau = float(passage.crossing(*nearest, np.array([found.h]))[0])
    if not tau > 0:
        return 0.0
    p, misses = passage.problem.parameters, list[float]()
    for ahead in tau / _NEARER:  # interpolated from far away, or rounded more
        times, X = passage.points(*nearest, np.array([ahead]))
        q = functions.space.expanded(times[0], X[0].T, p)[list(part.group.q_places)]
        values = p[: functions.outputs.system.p_values.size]
        missed = part.missed(passage.middle(q), passage.slope(q, float(ahead)), found.t, values)
        if missed is not None:
            misses.append(missed[0] if missed[1] * found.h > _LONG * missed[0] else 0.0)
    return min(misses, default=0.0)


def _passes(piece: Piece, passage: Passage) -> Iterator[_Pass]:
    """Where a motion comes next to singular positions."""
    solution = piece.solution
    begin, h = solution.t[:-1][solution.known], np.diff(solution.t)[solution.known]
    parts = min(_PARTS, max(1, _POINTS // max(1, h.size)))
    t = np.append((begin[:, None] + h[:, None] * np.arange(parts) / parts).ravel(), solution.t[-1] if h.size else [])
    if t.size < 2:
        return
    clear = passage.clearances(t, (solution.coarse or solution.dense)(t).T)
    inner = np.flatnonzero((clear[1:-1] <= clear[:-2]) & (clear[1:-1] < clear[2:])) + 1
    near = inner[clear[inner] < _NEAR][:_MOST]
    if not near.size:
        return
    for at, x in _least(passage, solution, t[near - 1], t[near + 1]):
        step = min(int(np.searchsorted(begin, at, side="right")) - 1, h.size - 1)
        yield _Pass(at, x, float(h[step]))


def _least(passage: Passage, solution: Solution, a: np.ndarray, b: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """Times and states (nx,) of the least clearances between times a and b (n,), where these are next to singular positions. Each call of the dense output
    refines steps anew: they are looked at together, first as they are, and to the last digits only what is that near."""

    def nearest(a: np.ndarray, b: np.ndarray, dense: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        looks = a[:, None] + (b - a)[:, None] * np.arange(1, _CUTS + 1) / (_CUTS + 1)
        X = dense(looks.ravel()).T
        number, best = np.arange(a.size), np.argmin(passage.clearances(looks.ravel(), X).reshape(looks.shape), axis=1)
        return looks[number, best], X.reshape(*looks.shape, -1)[number, best]

    about, aside = nearest(a, b, solution.coarse or solution.dense)[0], (b - a) * _SURE
    a, b = np.maximum(a, about - aside), np.minimum(b, about + aside)
    times, X = nearest(a, b, solution.dense)
    crossing = np.array([passage.is_crossing(at, x) for at, x in zip(times, X, strict=True)])
    times, X, aside = times[crossing], X[crossing], (b - a)[crossing]
    for _ in range(_ROUNDS if times.size else 0):
        aside = aside / _CUTS
        times, X = nearest(times - aside, times + aside, solution.dense)
    return zip(times.tolist(), X, strict=True)
