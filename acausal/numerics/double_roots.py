"""Where two solutions of equations meet: found to all digits, from next to it.

There a sum of the equations has no slope in the directions that the others let go. Newton's steps come half as near each time, and end where nothing
but rounding is left of the equations, which is its root away from the place. That the sum has no slope there is known as well as any equation.
"""

from __future__ import annotations

import numpy as np

from acausal.numerics.assembly import Residual
from acausal.numerics.sizes import Sizes

_FLAT = 1e-4
"""Slopes below this part of the largest vanish at the place."""
_STRIDE = 1e-3
"""How far to either side it is seen how slopes change."""
_STEPS = 6
_FOUND = 1e-14
"""Slopes that are left."""
_EPS = float(np.finfo(float).eps)
_ROUNDED = 8 * _EPS
"""Of the sizes of its terms, what is left of an equation that fits, as of lengths that are meant to; terms below `_EPS` are none."""


def where_solutions_meet(constraints: Residual, y: np.ndarray, sizes: Sizes) -> np.ndarray | None:
    """The place next to a y (n,) that meets `constraints` but for rounding; None where there is none, or solutions only pass each other closely."""
    if sizes.rounding is None:
        return None

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, J = constraints(z * sizes.unknowns)
        return c / sizes.rows, sizes.scaled(J)

    z = first = y / sizes.unknowns
    for step in range(_STEPS + 1):
        c, J = at(z)
        if not np.isfinite(J).all():
            return None
        U, s, Vt = np.linalg.svd(J)
        few = int(np.sum(s > _FLAT * s[0])) if s.size else 0
        sums, along = U[:, few:].T, Vt[few:]
        slopes = sums @ J @ along.T
        steep = float(np.max(np.abs(slopes), initial=0.0))
        if steep <= _FOUND:
            return z * sizes.unknowns if step and _fits(c, z, sizes) else None
        if step == _STEPS:
            return None
        changes = [(at(z + _STRIDE * v)[1] - at(z - _STRIDE * v)[1]) / (2 * _STRIDE) for v in along]
        bends = np.column_stack([(sums @ bend @ along.T).ravel() for bend in changes])
        move = np.linalg.lstsq(bends, -slopes.ravel(), rcond=1e-6)[0] @ along
        if not np.max(np.abs(z + move - first), initial=0.0) < _FLAT:
            return None
        z = z + move
        for _ in range(2):
            z = z - Vt[:few].T @ ((U[:, :few].T @ at(z)[0]) / s[:few])
    return None


def _fits(c: np.ndarray, z: np.ndarray, sizes: Sizes) -> bool:
    """Whether nothing but rounding is left of residuals without unit."""
    assert sizes.rounding is not None
    terms = sizes.rounding(z * sizes.unknowns) / sizes.rows
    return bool(np.all(np.abs(c) <= _ROUNDED * np.maximum(terms, _EPS)))
