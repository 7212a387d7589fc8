"""Freedoms that constraints leave to first order and take to second, wherever the loops are closed around: a plate on four parallel rods turns
about these as little as one on three may, for the sums of the rows without slope are squares of that turn.

There is no force to first order in what is stopped so, and none that is finite. Connelly and Whiteley, Second-order rigidity and prestress
stability for tensegrity frameworks, SIAM J. Discrete Math. 9 (1996): a self-stress takes what its quadratic form takes.
"""

from __future__ import annotations

import numpy as np

from acausal.loops.walk import Walk
from acausal.numerics.independent import inverse, rank_of

_STEP = 0.03
_TRIALS = 3
_SQUARE = 1e-6
"""Quadratic forms below this, as parts of the largest, are zero."""
_NEAR, _CLOSED = 1e-5, 1e-11
_HALVES = 30
_STARTS, _FLAT = 8, 1e-9
"""Random directions from which those are looked for in which all forms vanish, and what is left of forms of size 1 there."""


def held_to_second_order(walk: Walk, z: np.ndarray, scale: np.ndarray, around: bool = True) -> bool:
    """Whether more is free at a configuration z with closed loops than can move, and at all others that it can move to as well.

    `scale` (m,): usual lengths of the rows in the velocities. The motions that every self-stress allows to second order are followed for a
    few hundredths of the loops' size to either side: rows that depend on one another where only branches cross are independent there. Where
    everything is allowed, branches of this kind may cross: those `around` are asked.
    """
    _, J, A, N = walk.at(z)
    A = A / scale[:, None]
    U, s, Vt = np.linalg.svd(A)
    rank, closing = int(np.sum(s > walk.rank)), rank_of(J, walk.rank)
    stresses, free = U[:, rank:].T, Vt[rank:]
    if not (stresses.size and free.size):
        return False
    forms = np.array([free @ walk.bent(z, y / scale) @ N @ free.T for y in stresses])
    forms = 0.5 * (forms + forms.transpose(0, 2, 1))
    _, bends, axes = np.linalg.svd(forms.reshape(-1, len(free)))
    taken = int(np.sum(bends > _SQUARE * max(float(bends[0]), 1.0)))
    if taken == len(free) or not (taken or around):
        return False
    rng, along, bent = np.random.default_rng(4), axes[taken:] @ free, axes[:taken] @ forms @ axes[:taken].T
    if taken and _cross(bent, rng):
        return False
    for _ in range(_TRIALS):
        ahead = rng.normal(size=len(along)) @ along
        ahead /= np.max(np.abs(ahead))
        for sense in (1.0, -1.0):
            there = _settled(walk, z + N @ (sense * _STEP * ahead), closing)
            if (
                there is None
                or int(np.sum(np.linalg.svd(walk.at(there)[2] / scale[:, None], compute_uv=False) > walk.rank)) > rank
            ):
                return False
            if not taken and not held_to_second_order(walk, there, scale, around=False):
                return False
    return True


def _cross(forms: np.ndarray, rng: np.random.Generator) -> bool:
    """Whether quadratic forms (k, n, n), not all zero, vanish together in some direction, as branches that cross have: Newton's method from some."""
    _, sizes, span = np.linalg.svd(forms.reshape(len(forms), -1), full_matrices=False)
    forms = span[sizes > _SQUARE * sizes[0]].reshape(-1, *forms.shape[1:])
    for _ in range(_STARTS):
        v = rng.normal(size=forms.shape[1])
        for _step in range(_HALVES):
            v /= np.linalg.norm(v)
            slopes = forms @ v
            if np.linalg.norm(slopes @ v) < _FLAT:
                return True
            v = v - np.linalg.lstsq(2 * slopes, slopes @ v, rcond=_SQUARE)[0]
    return False


def _settled(walk: Walk, z: np.ndarray, rank: int) -> np.ndarray | None:
    """The closed loops next to z, by steps that know the rank first; then squares are brought to nothing by halves of their roots."""
    there = walk.closed(z, _NEAR, rank)
    if there is None:
        return None
    for _ in range(_HALVES):
        c, J = walk.closing(there)
        there = there - inverse(J, walk.dependent)(c)
    return there if np.all(np.abs(walk.closing(there)[0]) < _CLOSED) else None
