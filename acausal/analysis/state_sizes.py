"""Natural sizes of states at a point: what is much for each, so that decisions about them meet numbers without unit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.dynamics.slopes import slopes_of_places
from acausal.numerics.thresholds import RANK
from acausal.reduce.reduce import ReducedSystem
from acausal.start.coordinates import coordinates, reach, turning_states

ROUNDING = 1e3
"""So many times the rounding of its own terms is zero."""
UNCHANGED = 3e-8
"""What changes by less over a stride does not change: what is left of third order is about 1e-9."""
_STRIDE = 1e-3
"""Change of the fastest state, in units of its size, that is a little."""
_ROUNDED = 1e-6
"""Of what others make of a scalar state, a value that says nothing of its size: it may be rounding."""
_NO_DECAY = 1e-12
"""Of the pace at which states change one another, a decay of their own that is rounding."""
_AT_REST = 1e-11
"""A rate is none that is less than this part of what the sizes of the states make of it."""


@dataclass(frozen=True)
class Sizes:
    """Of the states x (nx,), all above zero, and what the states make of their rates (nx,).

    Powers of two, so that to divide by them rounds nothing. Angles: 1. Lengths: the reach of the mechanism there. Velocities: by the slowest
    way in which the forces change them, sqrt(stiffness / mass), or stiffness / damping where that is less.
    """

    x: np.ndarray
    rates: np.ndarray
    places: np.ndarray
    """The same with velocities by the coordinates that they move, whatever the forces (nx,)."""

    @property
    def fastest(self) -> float:
        """The rate of the state that changes by its size in the shortest time [1/s]."""
        rate = float(np.max(self.rates / self.x, initial=0.0))
        return rate if 0 < rate < np.inf else 1.0


def sizes_at(s: ReducedSystem, x_dot: Differentiable, at: OperatingPoint) -> Sizes:
    """At a point, from the rates of all states and their derivatives there."""
    nq, last = s.nq, s.nq + s.tree_velocities
    rates, slopes = x_dot.value(at), x_dot.along(at, np.eye(at.x.size))
    f, J = _finite(rates), _finite(slopes)
    if last < at.x.size:  # what balances is there, though nothing is left of it
        terms = _finite(x_dot.terms(at))
        f[last:] = np.where(f < _ROUNDED * terms, terms, f)[last:]
    size = np.zeros(at.x.size)
    size[:nq] = _coordinates(s, x_dot, at, rates, slopes)
    push = f[nq:last] + J[nq:last, :nq] @ size[:nq]
    # how fast a velocity must be to move some coordinate by its size in a time of 1
    far = _known(np.min(_over(size[:nq, None], J[:nq, nq:last], np.inf), axis=0, initial=np.inf))
    damping = np.diag(J)[nq:last]
    slow = _over(push, damping + np.sqrt(push / far), 0.0)
    size[nq:last] = np.maximum(slow, np.abs(at.x[nq:last]))
    size[nq:last] = np.where(size[nq:last] > 0, size[nq:last], far * np.max(size[nq:last] / far, initial=0.0))
    size[last:] = np.abs(at.x[last:])
    size[last:] = np.maximum(size[last:], _settling(f, J, size)[last:])
    known = np.where(size < _ROUNDED * _settling(f, J, size), 0.0, size)[last:]
    size[last:] = np.where(known > 0, known, _in_proportion(J[last:, last:], known))
    for _ in range(at.x.size):  # a state that nothing has reached yet gets the size of what reaches it first
        still = size == 0
        if not np.any(still) or np.all(still):
            break
        more = np.where(still, _settling(f, J, size), size)
        if np.array_equal(more, size):
            break
        size = more
    places = size.copy()
    places[nq:last] = far
    size = _known(size)
    return Sizes(size, J @ size, _known(places))


def before_and_after(x_dot: Differentiable, at: OperatingPoint, sizes: Sizes) -> tuple[float, list[OperatingPoint]]:
    """The pace [1/s] of the motion x' = `x_dot` through a point, and points a little later and earlier on it, to second order in time,
    inputs held. At rest they differ in time only.
    """
    rate = x_dot.value(at)
    still = np.abs(rate) <= _AT_REST * sizes.rates + ROUNDING * x_dot.rounding(at, sizes.x)
    rate = np.where(still, 0.0, rate)
    second = x_dot.along(at, rate[:, None], dt=1.0)[:, 0]
    pace = float(np.max(np.abs(rate) / sizes.x, initial=0.0))
    h = _STRIDE / (pace or sizes.fastest)
    return pace, [replace(at, t=at.t + step, x=at.x + step * rate + step**2 / 2 * second) for step in (h, -h)]


def _coordinates(s: ReducedSystem, x_dot: Differentiable, at: OperatingPoint, f: np.ndarray, J: np.ndarray) -> np.ndarray:
    """1 for angles; lengths by the reach, or where there is none by how far the forces push against stiffness."""
    nq, last = s.nq, s.nq + s.tree_velocities
    if not nq:
        return np.zeros(0)
    q = at.x[: s.mechanics.tree.q.numel()]
    found = coordinates(s.mechanics, s.p, at.p, q, s.scalar.position)
    length, size, turning = reach(s.mechanics, s.p, at.p, q, found.all), np.ones(nq), turning_states(s)[0]
    if not 0 < length < np.inf:
        push, terms = f[nq:last], x_dot.terms(at)[nq:last]  # what balances is there, though nothing is left of it
        length = _yielded(np.where(np.abs(push) < _ROUNDED * terms, terms, push), J[nq:last, :nq][:, ~turning])
    else:
        size[: q.size] /= slopes_of_places(s.mechanics.tree, s.p, q, at.p, at.t)
    return np.where(turning, 1.0, size * (length if 0 < length < np.inf else 1.0))


def _yielded(push: np.ndarray, stiffness: np.ndarray) -> float:
    """The largest of the changes that balance a push (n,), as far as a stiffness (n, m) does."""
    most = np.max(np.abs(stiffness), axis=1, initial=0.0)
    held = (most > 0) & np.isfinite(most) & np.isfinite(push)
    if not held.any():
        return 0.0
    rows = stiffness[held] / most[held, None]
    return float(np.max(np.abs(np.linalg.lstsq(rows, push[held] / most[held], rcond=RANK)[0]), initial=0.0))


def _settling(f: np.ndarray, J: np.ndarray, size: np.ndarray) -> np.ndarray:
    """How far the rates carry states in the time of their own decay, or of the whole where they have none."""
    rates = f + J @ size
    own = np.diag(J).copy()
    own[own <= _NO_DECAY * np.sqrt(np.max(J * J.T, axis=1, initial=0.0))] = 0.0
    fastest = float(np.max(_over(rates, size, 0.0), initial=0.0))
    return _finite(rates * _over(np.ones(own.size), own, 1 / fastest if fastest > 0 else 0.0))


def _in_proportion(J: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Sizes (nx,) of which some are `known`, and not zero: in what hangs together, so that states change one another alike. 0 where none is known.

    Proportions are those of a balanced matrix (Osborne, Journal of the ACM 7, 1960), whatever the units.
    """
    import scipy.linalg
    from scipy.sparse.csgraph import connected_components

    if known.all() or not known.any():
        return known
    with np.errstate(invalid="ignore"):  # scipy makes integers of proportions, too, that nobody asks for
        _, (scale, _) = cast(
            tuple[np.ndarray, tuple[np.ndarray, np.ndarray]], scipy.linalg.matrix_balance(J, permute=False, separate=True)
        )
    count, part = connected_components(J > 0, directed=False)
    most = np.zeros(count)
    np.maximum.at(most, part, known / scale)
    return scale * most[part]


def _over(above: np.ndarray, below: np.ndarray, otherwise: float) -> np.ndarray:
    """The quotient, and where there is nothing below, `otherwise`."""
    return np.where(below > 0, above / np.where(below > 0, below, 1.0), otherwise)


def _finite(values: np.ndarray) -> np.ndarray:
    size = np.abs(values)
    return np.where(np.isfinite(size), size, 0.0)


def _known(size: np.ndarray) -> np.ndarray:
    """With 1 in place of what is not there."""
    return np.where((size > 0) & np.isfinite(size), size, 1.0)


def power_of_two(size: np.ndarray) -> np.ndarray:
    """The nearest ones above; 1 in place of zero."""
    share, exponent = np.frexp(_known(size))
    return np.ldexp(np.where(share == 0.5, 0.5, 1.0), exponent)
