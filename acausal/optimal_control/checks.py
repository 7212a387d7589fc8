"""What makes a problem senseless before any search: said by part."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.transcription import Asked, Limits

_ROOM = 1e-6
"""Of what a bound and a value are: how far apart they are before they contradict each other."""


def check_problem(asked: Asked, first: Guess, name: Callable[[object], str]) -> None:
    """Raises `OptionError` for what contradicts itself, and for what is to be found and nothing depends on. `name`: of inputs and parameters."""
    _check_effect(asked, name)
    _check_bounds(asked, first)


def _check_effect(asked: Asked, name: Callable[[object], str]) -> None:
    stage = asked.stage
    said = [limits.value for limits in (*asked.path, *(own for _, own in asked.here))]
    moved = ca.veccat(stage.put(stage.rates), stage.put(stage.balance), stage.put(stage.invariants[0]))
    paid = ca.veccat(asked.integrals, asked.averages, asked.starts, asked.ends)
    moving = {s.element_hash() for s in ca.symvar(moved)}
    used = moving | {s.element_hash() for s in ca.symvar(stage.put(ca.veccat(paid, *said)))}
    for entry in stage.mode.inputs:
        if entry.sx.element_hash() not in moving:
            raise OptionError(
                f"The input {name(entry)} has no effect on the motion. Connect what it drives, or give it a value: OptimalControl(..., inputs={{{name(entry)}: 0}})."
            )
    for k, parameter in enumerate(stage.free):
        if stage.geometry[k].element_hash() not in used:
            raise OptionError(f"optimise: nothing in the problem depends on {name(parameter)}. Leave it out.")


def _check_bounds(asked: Asked, first: Guess) -> None:
    """Values that are given and bounds on the same thing; bounds of what is known at the start."""
    given = [(at, own) for at, own in asked.here if own.name != "start values"]  # among these are guesses
    for limits in asked.path:
        for at, own in given:
            _check_pair(limits, own, at)
        if asked.start is not None and np.isfinite(asked.start).all():
            _check_start(asked, limits, first)


def _check_pair(limits: Limits, own: Limits, at: float) -> None:
    known = {limits.value[r].element_hash(): r for r in range(limits.value.numel())}
    for e in range(own.value.numel()):
        r = known.get(own.value[e].element_hash())
        if r is None:
            continue
        room = _ROOM * max(abs(v) for v in (own.lower[e], own.upper[e], limits.lower[r], limits.upper[r]) if np.isfinite(v))
        if own.lower[e] > limits.upper[r] + room or own.upper[e] < limits.lower[r] - room:
            where = {0.0: "at the start", 1.0: "at the end"}.get(at, f"when {at:g} of the time has passed")
            raise OptionError(
                f"{own.name} is to be {_range(own, e)} {where}, but is bounded to {_range(limits, r)} all the time. Move one of them."
            )


def _check_start(asked: Asked, limits: Limits, first: Guess) -> None:
    """Of positions alone: rates may change at once where they are bounded from then on."""
    stage = asked.stage
    value = stage.put(limits.value)
    places = {stage.functions.space.x[k].element_hash() for k in range(stage.functions.space.nq)}
    if any(s.element_hash() not in places for s in ca.symvar(value)):
        return
    z = np.concatenate([first.values[0], [first.duration], first.free])
    found = np.array(ca.Function("value", [stage.unknowns, stage.data], [value])(z, [0.0, 0.0])).ravel()
    room = _ROOM * np.max(
        np.abs(
            np.concatenate([found, limits.lower, limits.upper])[np.isfinite(np.concatenate([found, limits.lower, limits.upper]))]
        ),
        initial=0.0,
    )
    off = np.flatnonzero((found < limits.lower - room) | (found > limits.upper + room))
    if off.size:
        r = int(off[0])
        raise OptionError(
            f"{limits.name} is {found[r]:.6g} at the start, but is bounded to {_range(limits, r)} all the time. Start elsewhere, or move the bound."
        )


def _range(limits: Limits, r: int) -> str:
    lower, upper = limits.lower[r], limits.upper[r]
    if lower == upper:
        return f"{lower:g}"
    return (
        f"between {lower:g} and {upper:g}"
        if np.isfinite([lower, upper]).all()
        else f"at least {lower:g}"
        if np.isfinite(lower)
        else f"at most {upper:g}"
    )
