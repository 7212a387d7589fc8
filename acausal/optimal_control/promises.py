"""What was asked for, looked up in a motion that was found: rows that were left out since they follow from others are among it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.optimal_control.transcription import GIVEN, ROOM, Transcribed
from acausal.outputs.state_units import state_units


def broken_promises(transcribed: Transcribed, w: np.ndarray) -> list[str]:
    """Conditions at places of the motion, and what repeats itself, that the unknowns of a program do not meet, in words."""
    return [*_conditions(transcribed, w), *_repetition(transcribed, w)]


def _conditions(transcribed: Transcribed, w: np.ndarray) -> list[str]:
    stage, mesh, layout = transcribed.asked.stage, transcribed.mesh, transcribed.layout
    full, found = w * transcribed.units, list[str]()
    for at, limits in transcribed.asked.here:
        if limits.name == GIVEN:
            continue
        node = layout.node(int(np.argmin(np.abs(mesh.nodes - at))))
        z, much = (np.where(node >= 0, part[node], 0.0) for part in (full, transcribed.units))
        value, slope = (np.array(part) for part in stage.slopes(stage.put(limits.value))(z, [at, 0.0]))
        size = float(np.max(np.abs(slope * much[: stage.sizes[0]]), initial=0.0))
        found += [
            f"{limits.entry(r)} is {one:.6g} and not {limits.range(r)} when {at:g} of the time has passed"
            for r, one in enumerate(value.ravel().tolist())
            if limits.outside(one, r, size)
        ]
    return found


def _repetition(transcribed: Transcribed, w: np.ndarray) -> list[str]:
    """States that follow from others may come back on another branch of a loop, angles full turns on."""
    asked = transcribed.asked
    if asked.periodic is None:
        return []
    stage, motion = asked.stage, transcribed.motion(w)
    nx, nq = stage.sizes[0], stage.functions.space.nq
    off = motion.values[-1, :nx] - motion.values[0, :nx] - asked.periodic
    angles = np.array([unit == "rad" for unit in state_units(stage.functions)[:nx]]) & (np.arange(nx) < nq)
    off = np.where(angles, off - 2 * np.pi * np.round(off / (2 * np.pi)), off)
    varies = np.ptp(motion.values[:, :nx], axis=0)
    room = 10 * ROOM * np.maximum(transcribed.units[:nx], varies)
    names = stage.functions.state_names
    return [f"{names[k]} ends {off[k]:.3g} from where it began" for k in range(nx) if abs(off[k]) > room[k]]


def no_number(transcribed: Transcribed, w: np.ndarray) -> list[str]:
    """What has no finite value or no finite slope at these unknowns: the cost, or rows by name."""
    program, none = transcribed.program, ca.DM(0, 1)
    value, gradient = (np.array(part).ravel() for part in program.derivatives["grad_f"](w, none))
    found = [] if np.isfinite(value).all() and np.isfinite(gradient).all() else ["what is minimised"]
    rows, J = program.derivatives["jac_g"](w, none)
    bad = set(np.flatnonzero(~np.isfinite(np.array(rows).ravel())).tolist())
    bad |= set(np.array(J.sparsity().row())[~np.isfinite(np.array(J.nonzeros()))].tolist())
    return [*found, *dict.fromkeys(transcribed.labels[r][0] for r in sorted(bad))]
