"""Guides with corners: what passes one would be struck there, and a run takes it through with its speed along the guide."""

from __future__ import annotations

import warnings

import numpy as np

from acausal.errors import AccuracyWarning
from acausal.outputs.functions import Functions
from acausal.simulate.looks import inputs_at_steps
from acausal.simulate.trajectory import Trajectory
from acausal.wording import callers_level

_BESIDE = 1e-6
"""Of a step: so near to its end velocities are looked at on both sides."""
_TURNS = 1e-3
"""Sine by which no smooth guide turns a velocity in such a time."""
_SLOW = 1e-4
"""Of the largest speed: where it turns round nothing is told."""


def warn_if_cornered(functions: Functions, run: Trajectory) -> bool:
    """Warn of the first corner that was passed; whether there was one. Steps end at the switches of a guide's function, and so at its corners."""
    if not functions.guides or run.steps.t.size < 3:
        return False
    t, x, u = run.steps.t, run.steps.x, inputs_at_steps(run)
    inner = np.flatnonzero((np.diff(t)[:-1] > 0) & (np.diff(t)[1:] > 0)) + 1
    seen, row = functions.series(functions.along_guides), 0
    before, after = (
        seen.glance(
            t[inner] + _BESIDE * (t[inner + k] - t[inner]),
            x[:, inner] + _BESIDE * (x[:, inner + k] - x[:, inner]),
            u[:, inner],
            run.problem.parameters,
        )
        for k in (-1, 1)
    )
    for guide in functions.guides:
        place = row + 3
        old, new = before[row:place], after[row:place]
        speed = np.maximum(np.linalg.norm(old, axis=0), np.linalg.norm(new, axis=0))
        turned = np.linalg.norm(np.cross(old, new, axis=0), axis=0)  # what only slows down goes on straight
        at = np.flatnonzero((turned > _TURNS * speed**2) & (speed > _SLOW * np.max(speed, initial=0.0)))
        row = place + len(guide.names)
        if at.size:
            k, corner = int(at[0]), inner[at[:1]]
            q = seen.glance(t[corner], x[:, corner], u[:, corner], run.problem.parameters)[place:row, 0]
            where = ", ".join(f"{name} = {value:.6g}" for name, value in zip(guide.names, q, strict=True))
            warnings.warn(
                f"At t = {t[inner[k]]:.6g} s {guide.who} passes a corner, at {where}: the velocity of what slides there jumps from {old[:, k]} to {new[:, k]} m/s, and nothing "
                "strikes it. A real one would be struck, or leave its guide. Round the corner, such as by a spline through points beside it.",
                AccuracyWarning, stacklevel=callers_level(),
            )  # fmt: skip
            return True
    return False
