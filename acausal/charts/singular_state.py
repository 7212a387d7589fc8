"""Whether the loops are singular at a state: whether their constraints depend on one another more than elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.numerics.sizes import Drawn, unknown_sizes
from acausal.numerics.thresholds import CROSSING
from acausal.outputs.functions import Functions
from acausal.wording import compact

_NOTHING = 1e-12
"""Of what is much for a row, what is rounding."""


def singularity(functions: Functions, t: float, x: np.ndarray, p: np.ndarray) -> tuple[float, np.ndarray]:
    """How independent the loops' constraints are at a state x (nx,), time t [s], parameters p (np,): of the singular values of their rows,
    each divided by its usual length, the smallest of as many as constraints are independent elsewhere, and the velocities (nv,) that it
    nearly leaves free, speeds measured by the arms of turns. 1 without loops.
    """
    s = functions.outputs.system
    rank = s.constraints.rank.rank
    if rank == 0:
        return 1.0, np.zeros(s.tree_velocities)

    def rows(t: float, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.array(functions.constraint_jacobian(t, x, s.u_defaults, p))

    samples = [rows(s.constraints.time, np.concatenate([q, s.rate_start]), s.p_values) for q in s.samples]
    here = rows(t, x, p)
    if not np.isfinite(here).all():
        return 1.0, np.zeros(s.tree_velocities)
    largest = np.max(np.abs([here, *samples]), axis=0)
    turns = s.mechanics.tree.turning[1]
    units = unknown_sizes(largest, turns, np.zeros(len(here)), Drawn.exact(len(here)))
    _, values, directions = np.linalg.svd(scaled_rows(here * units, [J * units for J in samples]))
    return abs(float(values[rank - 1])), directions[rank - 1]


def singular_loops(functions: Functions, t: float, x: np.ndarray, p: np.ndarray, limit: float = CROSSING) -> str:
    """What is singular at a state, in words; empty where the `singularity` is at least `limit`."""
    smallest, direction = singularity(functions, t, x, p)
    if not smallest < limit:
        return ""
    s = functions.outputs.system
    velocities = functions.tree_state_names[s.nq : s.nq + s.tree_velocities]
    moving = [velocities[i] for i in np.argsort(-np.abs(direction)) if abs(direction[i]) > 0.1]
    loops = compact(f"'{rows.edge.name}'" for rows in s.constraints.loops)
    return (
        f"The loops closed by {loops} are in a {'singular' if smallest < CROSSING else 'nearly singular'} position at t = {t:.6g} s (smallest "
        f"singular value {smallest:.2g}): {compact(moving)} may change besides the usual motion, and branches of the motion cross. No "
        "coordinates are independent on all of them."
    )


def scaled_rows(J: np.ndarray, samples: Sequence[np.ndarray], much: np.ndarray | float = 0.0) -> np.ndarray:
    """J (m, n), each row divided by its largest length there and in `samples`; those that are rounding errors beside what is `much` (m,) for each become zero."""
    size = np.max([np.linalg.norm(rows, axis=1) for rows in (J, *samples)], axis=0)
    size[size <= _NOTHING * much] = np.inf
    return J / size[:, None]
