"""Mobility of loops, in words: free, movable thanks to exact dimensions, locked, or closing in one position only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.errors import LockedError
from acausal.loops.loops import LoopRows
from acausal.numerics.thresholds import CLOSED, NEARLY
from acausal.wording import compact, counted


def locked(loops: Sequence[LoopRows], freedoms: int, A: np.ndarray) -> LockedError:
    """As many independent constraints A (m, nv) as freedoms: the loops close here, and nothing can move."""
    return LockedError(
        f"The mechanism is locked: {counted(freedoms, 'freedom')} of its joints and {counted(freedoms, 'independent constraint')} from closing "
        f"{_joints(loops)} meet, so it closes in single positions and cannot move.{nearly_redundant(loops, A)} Remove a joint or "
        "give one of them more freedom."
    )


def nearly_fitting(loops: Sequence[LoopRows], A: np.ndarray, between: float) -> LockedError:
    """Constraints A (m, nv) of which one neither follows from the others nor is independent of them, by a singular value `between`."""
    return LockedError(
        f"Whether the loops closed by {_joints(loops)} can move is not to be told: one of their constraints neither follows from the others nor is "
        f"independent of them, but by {between:.1g} of its size.{nearly_redundant(loops, A)} Linkages that move because their "
        "dimensions fit do so only where these fit to all digits; what stops a motion to second order only, a fourth parallel rod for instance, is to "
        "be left out."
    )


def shaky(loops: Sequence[LoopRows], freedoms: int, rank: int) -> LockedError:
    """Fewer independent constraints than freedoms, but no other position closes the loops."""
    return LockedError(
        f"The mechanism is locked: closing {_joints(loops)} leaves {freedoms - rank} of {freedoms} freedoms to first order, but no second "
        "position was found in which the loops close. Its parts are just long enough, as in a triangle that lies flat: it can "
        "shake and not move. Make a part longer or shorter, or remove a joint."
    )


def stopped(loops: Sequence[LoopRows]) -> LockedError:
    """More is free to first order than can move, at the sketch and wherever it leads to."""
    return LockedError(
        f"The loops closed by {_joints(loops)} move, but more is free to first order than can move, wherever they are: what stops it, stops it to "
        "second order only, by forces that nothing determines. Leave out what holds nothing that the others do not hold along this motion, a fourth "
        "parallel rod for instance, or let a part that bends take its place."
    )


def nearly_redundant(loops: Sequence[LoopRows], A: np.ndarray) -> str:
    """A sentence on constraints that would follow from the others if dimensions were slightly different; empty if there are none."""
    names = [name for rows in loops for name in rows.names]
    size = np.linalg.norm(A, axis=1)
    torques = np.array([rows.wrench_basis[3:, k].is_zero() for rows in loops for k in range(len(rows.names))])
    size[torques] = 1.0  # sines of angles, beside shifts against the largest shift
    size[~torques] = np.max(size[~torques], initial=0.0) or 1.0
    U, s, _ = np.linalg.svd(A / size[:, None])
    few = [k for k in range(min(A.shape)) if CLOSED * s[0] < s[k] < NEARLY * s[0]]
    if not few:
        return ""
    weight = np.max(np.abs(U[:, few]), axis=1)
    worst = [names[i] for i in np.argsort(-weight) if weight[i] > 0.3][:4]
    return (
        f" {len(few)} of the constraints nearly follow{'s' if len(few) == 1 else ''} from the others (to {float(s[few[-1]] / s[0]):.1g}), among "
        f"them {', '.join(worst)}: if axes are meant to be parallel or lengths to fit, they do not quite; make them exact, or let a ball "
        "joint or a sleeve (Cylindrical) take the place of a hinge."
    )


def _joints(loops: Sequence[LoopRows]) -> str:
    return compact((f"'{rows.edge.name}'" for rows in loops), 4)
