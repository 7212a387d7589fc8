"""What cannot hold together, of what is said at one time: of expressions that are multiples of one another, beside a constant, such as a joint's place and that of a body on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.optimal_control.asked import GIVEN, ROOM, Asked, Limits, when

_PARALLEL = 1e-9
"""Of the largest slope: by how much two differ that are one."""


@dataclass(frozen=True, eq=False)
class _Said:
    """An entry between two numbers `at` a time (None: always), which is to be `range` in words (none where a mode says so by its name); `sloped` (n,) along unknowns, all of it divided by its `size` > 0 or < 0, so that the largest slope
    is 1: then it is between `lower` and `upper` and its constant is left out.
    """

    at: float | None
    name: str
    range: str
    sloped: np.ndarray
    lower: float
    upper: float
    room: float
    known: bool
    """Whether it is what was said of the start."""

    def meets(self, other: _Said) -> bool:
        """Whether both are said of one time; what is known of the start is compared with bounds elsewhere."""
        if self.at is None or other.at is None:
            return not (self.known or other.known)
        return self.at == other.at

    def along(self, other: _Said) -> bool:
        return bool(np.max(np.abs(self.sloped - other.sloped)) <= _PARALLEL)

    def apart(self, other: _Said) -> bool:
        room = max(self.room, other.room)
        return self.lower > other.upper + room or other.lower > self.upper + room


def check_together(asked: Asked) -> None:
    """Raises `OptionError` for two things that are said of one time and cannot both be."""
    entries = list(_entries(asked))
    for k, one in enumerate(entries):
        for other in entries[:k]:
            if one.meets(other) and one.along(other) and one.apart(other):
                raise OptionError(_words(*((one, other) if one.at is not None else (other, one))))


def _words(one: _Said, other: _Said) -> str:
    """`one` is said of a time, if any of both is."""
    if other.at is None and one.name == other.name:
        return f"{one.name} is to be {one.range} {when(one.at)}, but is bounded to {other.range} all the time. Move one of them."
    if other.at is None and not other.range:
        return f"{one.name} is to be {one.range} {when(one.at)}, but in its mode {other.name} all the time, which cannot both be. Move one of them, or say other modes."
    if other.at is None:
        return f"{one.name} is to be {one.range} {when(one.at)}, but {other.name} is bounded to {other.range} all the time, which cannot both be. Move one of them."
    known = other.range if one.name == other.name else f"{other.name} {other.range}"
    return f"{one.name} is to be {one.range} {when(one.at)}, and {known}, too, which cannot both be. Leave one of them out, or move it."


def _entries(asked: Asked) -> Iterable[_Said]:
    """Those whose slopes are constant."""
    stage, known = asked.stage, _at_ends(asked)
    of_mode = {name for _, name in stage.bounds}
    given = ca.vertcat(stage.unknowns, stage.data)
    said = [(at, limits, False) for at, limits in (*((None, limits) for limits in asked.path), *asked.here)]
    for at, limits, of_start in (*said, *((at, limits, True) for at, limits in known)):
        count = len(limits.said) if limits.name == GIVEN else limits.value.numel()  # what else stands there are guesses
        value = stage.put(limits.value)[:count, :]
        straight = [r for r, bent in enumerate(ca.which_depends(value, given, 2, True)) if not bent] if count else []
        if not straight:
            continue
        value = ca.densify(value[straight, :])
        rest, slopes = (
            np.array(part)
            for part in ca.Function("straight", [given], [value, ca.densify(ca.jacobian(value, given))])(np.zeros(given.numel()))
        )
        for r, slope, constant in zip(straight, slopes, rest.ravel().tolist(), strict=True):
            size = float(slope[np.argmax(np.abs(slope))])
            if size != 0 and np.isfinite(slope).all() and np.isfinite(constant):
                lower, upper = sorted((np.array([limits.lower[r], limits.upper[r]]) - constant) / size)
                much = [abs(v / size) for v in (limits.lower[r], limits.upper[r], constant) if np.isfinite(v)]
                words = "" if at is None and limits.name in of_mode else limits.range(r)
                yield _Said(at, limits.entry(r), words, slope / size, lower, upper, ROOM * max(much), of_start)


def _at_ends(asked: Asked) -> list[tuple[float, Limits]]:
    """What is known of states at the start, and at the end where they return."""
    if asked.start is None:
        return []
    x, names = asked.stage.functions.space.x, asked.stage.functions.state_names
    found = [(0.0, x[k], asked.start[k], names[k]) for k in range(x.numel())]
    if asked.periodic is not None:
        found += [(1.0, x[k], asked.start[k] + asked.periodic[k], f"{names[k]} (as at the start)") for k in range(x.numel())]
    return [(at, Limits(value, np.array([v]), np.array([v]), name)) for at, value, v, name in found if np.isfinite(v)]
