"""Events: moments at which an expression of a scene's variables passes through zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import listed, truth
from acausal.errors import OptionError
from acausal.language.expression import Expression

_CONDITIONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)
_DIRECTIONS = {"both": 0, "rising": 1, "falling": -1}


@dataclass(frozen=True, eq=False)
class when:
    """A zero of `expression`, or of what has that name, that is looked for along a motion, e.g. `ac.when(scene.ball.position[2] - 0.1,
    "falling", stop=True)`.

    `direction`: "rising", "falling" or "both". `stop`: whether the motion ends there. An expression that is zero at the start counts
    if it then leaves zero in the direction asked for; "both" takes a start at zero for no event. Where zero is touched but not
    crossed, it counts for any direction. Raises `OptionError` for another direction.
    """

    expression: Expression | str
    direction: str = "both"
    stop: bool = False

    def __post_init__(self) -> None:
        truth(self.stop, "when: stop")
        if not isinstance(self.direction, str) or self.direction not in _DIRECTIONS:  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            raise OptionError(f'when: the direction is "rising", "falling" or "both", not {self.direction!r}.')
        if isinstance(self.expression, str):
            return
        if not isinstance(self.expression, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            raise OptionError(f"when: {self.expression!r} is not an expression of a scene's variables.")
        if self.expression.sx.is_scalar() and self.expression.sx.op() in _CONDITIONS:
            raise OptionError(
                f"when: {self.expression!r} is a condition and does not pass through zero. In place of a > b give a - b, with the "
                'direction: ac.when(a - b, "rising").'
            )

    @property
    def sign(self) -> int:
        """1 rising, -1 falling, 0 both."""
        return _DIRECTIONS[self.direction]


@dataclass(frozen=True)
class Event:
    """`when.expression` is zero at `time` [s], in states `x` (nx,); `direction`: "rising", "falling", or "touching" without crossing."""

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
