"""What makes a problem senseless before any search: said by part."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.optimal_control.asked import GIVEN, Asked, Limits, when
from acausal.optimal_control.contradictions import check_together
from acausal.optimal_control.guess import Guess, closed


def check_problem(asked: Asked, first: Guess, name: Callable[[object], str]) -> None:
    """Raises `OptionError` for what contradicts itself, and for what is to be found and nothing depends on. `name`: of inputs and parameters."""
    _check_effect(asked, name)
    _check_what_stands(asked)
    _check_bounds(asked, first)


def check_given(asked: Asked, given: Sequence[Limits], units: np.ndarray, first: Guess) -> None:
    """Raises `OptionError` for what is said of the start and cannot be where parts are closed or stick: there the nearest states count that can. `units` (nx,): what is much for
    each state.
    """
    stage = asked.stage
    if asked.start is None or not np.isfinite(asked.start).all():
        return
    x = closed(stage, asked.start[None, :], np.zeros(1), first.duration, first.free, units)[0]
    z = np.concatenate([x, np.zeros(stage.width - x.size), [first.duration], first.free])
    for limits in given:
        value, slope = (np.array(part) for part in stage.slopes(stage.put(limits.value))(z, [0.0, 0.0]))
        much = np.max(np.abs(slope) * units, axis=1, initial=0.0)
        for r, one in enumerate(value.ravel().tolist()):
            if np.isfinite(one) and limits.outside(one, r, float(much[r])):
                raise OptionError(
                    f"{limits.entry(r)} is to be {limits.range(r)} at the start, but with what is closed or sticks in this phase it is {one:.6g}. Start where that holds, or say other modes."
                )


def _check_effect(asked: Asked, name: Callable[[object], str]) -> None:
    stage = asked.stage
    limited = [limits.value for limits in (*asked.path, *(own for _, own in asked.here))]
    moved = ca.veccat(stage.put(stage.rates), stage.put(stage.balance), stage.put(stage.invariants[0]))
    sums = (asked.cost, *(total for total, *_ in asked.totals))
    paid = ca.veccat(*(part for one in sums for part in (one.integrals, one.averages, one.starts, one.ends)))
    moving = {s.element_hash() for s in ca.symvar(moved)}
    used = moving | {s.element_hash() for s in ca.symvar(stage.put(ca.veccat(paid, *limited)))}
    given = {k for k, limits, r in asked.entries if limits.lower[r] == limits.upper[r]}
    first = stage.width - stage.sizes[3]
    for k, entry in enumerate(stage.mode.inputs):
        if entry.sx.element_hash() not in moving and first + k not in given:
            raise OptionError(
                f"The input {name(entry)} has no effect on the motion. Connect what it drives, or give it a value: OptimalControl(..., inputs={{{name(entry)}: 0}})."
            )
    for k, parameter in enumerate(stage.free):
        if stage.geometry[k].element_hash() not in used:
            raise OptionError(f"optimise: nothing in the problem depends on {name(parameter)}. Leave it out.")


def _check_what_stands(asked: Asked) -> None:
    """What nothing moves, and is asked to be elsewhere."""
    for at, limits in (*((None, one) for one in asked.path), *asked.here):
        value = asked.stage.put(limits.value)
        for r in range(value.numel()):
            if value[r].is_constant() and limits.name != GIVEN:
                found = float(value[r])
                if limits.outside(found, r):
                    raise OptionError(
                        f"{limits.entry(r)} is {found:.6g} however the scene moves, but is to be {limits.range(r)} {when(at)}. Leave it out, or change the scene."
                    )


def _check_bounds(asked: Asked, first: Guess) -> None:
    """Values that are given and bounds on the same thing; bounds of what is known at the start."""
    check_together(asked)
    if asked.start is not None and np.isfinite(asked.start).all():
        for limits in asked.path:
            _check_start(asked, limits, first)


def _check_start(asked: Asked, limits: Limits, first: Guess) -> None:
    """Of states alone: all else may change at once."""
    assert asked.start is not None
    for words in outside_at_start(asked, limits, asked.start, first):
        raise OptionError(f"{words} Start elsewhere, or move the bound.")


def outside_at_start(asked: Asked, limits: Limits, x: np.ndarray, first: Guess) -> list[str]:
    """In words, which entries of what states alone tell are beyond their bounds at the start x (nx,)."""
    stage = asked.stage
    value = stage.put(limits.value)
    states = {stage.functions.space.x[k].element_hash() for k in range(stage.sizes[0])}
    if not value.numel() or any(s.element_hash() not in states for s in ca.symvar(value)):
        return []
    z = np.concatenate([first.values[0], [first.duration], first.free])
    z[: stage.sizes[0]] = x
    found = np.array(ca.Function("value", [stage.unknowns, stage.data], [value])(z, [0.0, 0.0])).ravel()
    return [
        f"{limits.entry(r)} is {one:.6g} at the start, but is bounded to {limits.range(r)} all the time."
        for r, one in enumerate(found.tolist())
        if limits.outside(one, r)
    ]
