"""What was asked for, looked up in a motion that was found: rows that were left out since they follow from others are among it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.optimal_control.asked import GIVEN, ROOM, Asked, when
from acausal.optimal_control.transcription import Transcribed
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
            f"{limits.entry(r)} is {one:.6g} and not {limits.range(r)} {when(at)}"
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


_AWAY = 1e3
"""Units, beyond which nothing goes that is bounded."""
_KINKED = {
    ca.OP_FABS: "an absolute value",
    ca.OP_SIGN: "a sign",
    ca.OP_FMIN: "a minimum",
    ca.OP_FMAX: "a maximum",
    ca.OP_IF_ELSE_ZERO: "a case",
}
"""Of CasADi's instructions."""


def far_away(transcribed: Transcribed, w: np.ndarray) -> list[str]:
    """States and inputs without bounds that went far beyond what is much for them, the farthest first, with their values and times."""
    stage, motion, bounds = transcribed.asked.stage, transcribed.motion(w), transcribed.program.bounds
    nx, inputs = stage.sizes[0], stage.sizes[3]
    first, names = stage.width - inputs, list(stage.functions.state_names)
    found = list[tuple[float, str]]()
    for k in (*range(nx), *range(first, stage.width)):
        at = transcribed.places[:, :, k].ravel()
        j = int(np.argmax(np.abs(w[at])))
        if not np.isfinite(bounds[:, at[j]]).all() and abs(w[at[j]]) > _AWAY:
            name = names[k] if k < nx else stage.functions.outputs.name(stage.mode.inputs[k - first])
            when_there = stage.t0 + motion.times[1 + j] * motion.duration
            found.append((abs(float(w[at[j]])), f"{name} came to {motion.values[1 + j, k]:.3g} at {when_there:.3g} s"))
    return [words for _, words in sorted(found, reverse=True)]


def pressed(transcribed: Transcribed, w: np.ndarray) -> dict[str, tuple[float, float]]:
    """What came to its limits, of those that leave room, by names: from when to when, parts of the duration."""
    program, places = transcribed.program, transcribed.places
    g = np.array(program.values(w)[1]).ravel()
    (lower, upper), (least, most) = program.limits, program.bounds
    rows = (lower < upper) & ((g <= lower + ROOM) | (g >= upper - ROOM))
    unknowns = (least < most) & ((w <= least + ROOM) | (w >= most - ROOM))
    points = transcribed.settled(w).points
    said = [
        (limits.entry(r), float(at))
        for k, limits, r in transcribed.asked.entries
        if k >= 0
        for at in points[unknowns[places[:, :, k]]]
    ]
    found: dict[str, tuple[float, float]] = {}
    for name, at in (*said, *(transcribed.labels[r] for r in np.flatnonzero(rows).tolist())):
        first, last = found.get(name, (at, at))
        found[name] = min(first, at), max(last, at)
    return found


def held(transcribed: Transcribed) -> list[str]:
    """What is bounded to one value all the time, with this."""
    return [
        f"{limits.entry(r)} at {limits.range(r)}"
        for _, limits, r in transcribed.asked.entries
        if limits.lower[r] == limits.upper[r]
    ]


def kinks(asked: Asked) -> list[str]:
    """What is minimised or bounded by what has no slope at some value, with what that is."""
    total = asked.cost
    said = [("what is minimised", ca.veccat(total.integrals, total.averages, total.starts, total.ends))]
    said += [(limits.name, limits.value) for limits in (*asked.path, *(one for _, one in asked.here))]
    found = list[str]()
    for name, value in said:
        f = ca.Function("value", ca.symvar(value), [value])
        used = {f.instruction_id(k) for k in range(f.n_instructions())}
        found += [f"{name} ({words})" for op, words in _KINKED.items() if op in used]
    return found


def no_number(transcribed: Transcribed, w: np.ndarray) -> list[str]:
    """What has no finite value or no finite slope at these unknowns: the cost, or rows by name."""
    program, none = transcribed.program, ca.DM(0, 1)
    value, gradient = (np.array(part).ravel() for part in program.derivatives["grad_f"](w, none))
    found = [] if np.isfinite(value).all() and np.isfinite(gradient).all() else ["what is minimised"]
    rows, J = program.derivatives["jac_g"](w, none)
    bad = set(np.flatnonzero(~np.isfinite(np.array(rows).ravel())).tolist())
    bad |= set(np.array(J.sparsity().row())[~np.isfinite(np.array(J.nonzeros()))].tolist())
    return [*found, *dict.fromkeys(transcribed.labels[r][0] for r in sorted(bad))]
