"""Events as they were met by a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.arguments import listed
from acausal.errors import OptionError
from acausal.language.when import when


@dataclass(frozen=True)
class Event:
    """`when.expression` is zero at `time` [s], in states `x` (nx,), before anything is set; `direction`: "rising", "falling", or "touching" without crossing."""

    when: when
    time: float
    direction: str
    x: np.ndarray


def events_asked(events: Any, call: str) -> tuple[when, ...]:
    """A list of events. Raises `OptionError` for anything else."""
    found = tuple(listed(events, f"{call}: `events`", 'events=[ac.when(scene.hinge.q, "rising")]'))
    for event in found:
        if not isinstance(event, when):
            raise OptionError(f'{call}: {event!r} in `events` is no event. Use ac.when(expression, "rising").')
    return found
