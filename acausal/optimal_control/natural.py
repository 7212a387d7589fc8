"""How large a scene is of which no link tells it."""

from __future__ import annotations

import numpy as np

from acausal.optimal_control.stage import Stage
from acausal.outputs.state_units import state_units

_NOTHING = 1e-12
"""Of the largest of its kind: an inertia, a way that is none but for rounding."""


def natural_length(stage: Stage, z: np.ndarray, states: np.ndarray, acting: np.ndarray, ways: np.ndarray) -> float:
    """In units of what is much for lengths among `states` (nx,) so far: the length of a rod of the mass of what moves that is as hard to turn as what turns; where nothing turns, the longest
    of the ways (nx,) that states are to go; or how far they go by themselves from this point z (width + 1 + free,) on in its time; or by what acts (m,) on them at most; or how far apart they are; 1
    where all that vanishes.
    """
    nv = stage.sizes[1]
    nq, duration = stage.functions.space.nq, float(z[stage.width])
    kinds = np.array([unit.split("/")[0] for unit in state_units(stage.functions)])
    places, speeds = np.flatnonzero(kinds[:nq] == "m"), nq + np.flatnonzero(kinds[nq : nq + nv] == "m")
    if not speeds.size:
        return 1.0
    gap, slope = (np.array(part) for part in stage.driving(z, [0.0, 0.0]))
    inertia = np.abs(np.diag(slope[:nv, :nv]))
    energy = inertia * states[nq : nq + nv] ** 2
    turning, moving = energy[kinds[nq : nq + nv] == "rad"], energy[speeds - nq]
    if np.max(turning, initial=0.0) > 0 and np.max(moving) > 0:
        return float(np.sqrt(12 * np.max(turning) / np.max(moving)))
    heavy = np.where(inertia > 0, inertia, np.inf)[speeds - nq]
    freely = np.abs(z[speeds]) + np.abs(gap[speeds - nq, 0]) / heavy * duration
    driven = np.max(np.abs(slope[speeds - nq, nv:]) * acting, axis=1, initial=0.0) / heavy * duration
    for far in (
        ways[places] / states[places],
        freely / states[speeds],
        driven / states[speeds],
        np.abs(z[places]) / states[places],
    ):
        if np.max(far, initial=0.0) > _NOTHING * np.max(np.abs(z[places]) / states[places], initial=0.0):
            return float(np.max(far))
    return 1.0
