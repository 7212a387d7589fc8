"""Events: moments at which an expression of a scene's variables passes through zero, and what is set there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca

from acausal.errors import OptionError
from acausal.language.expression import Expression, Scalar
from acausal.language.origin import origin

_CONDITIONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)
_DIRECTIONS = {"both": 0, "rising": 1, "falling": -1}


@dataclass(frozen=True, eq=False)
class when:
    """A zero of `expression`, or of what has that name, that is looked for along a motion, e.g. `ac.when(scene.ball.position[2] - 0.1,
    "falling", stop=True)`; also one that a part's `laws()` give.

    `direction`: "rising", "falling" or "both". `stop`: whether the motion ends there. An expression that is zero at the start counts
    if it then leaves zero in the direction asked for; "both" takes a start at zero for no event. Where zero is touched but not
    crossed, it counts for any direction, and nothing is set.

    `set`: values that variables get there, all at once, from those just before: coordinates and velocities that do not follow from others, states of scalar
    parts, and `ac.Discrete`s: `set={scene.ball.v: -0.8 * scene.ball.v}`. What a jump leads across zero counts, too. Raises `OptionError` for another
    direction, and what is no expression.
    """

    expression: Expression | str
    direction: str = "both"
    stop: bool = False
    set: Mapping[Expression | str, Scalar] | None = None
    line: str = field(default="", repr=False)
    """Where it was written."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "line", self.line or origin())
        if not isinstance(self.stop, bool):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            raise OptionError(f"when: stop is {self.stop!r}. Give True or False.")
        if not isinstance(self.direction, str) or self.direction not in _DIRECTIONS:  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            raise OptionError(f'when: the direction is "rising", "falling" or "both", not {self.direction!r}.')
        if self.set is not None:
            if not isinstance(self.set, Mapping) or not self.set:  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
                raise OptionError(
                    f"when: set is {self.set!r} ({self.line}). Give variables and their new values: set={{scene.ball.v: 0.0}}."
                )
            if self.stop:
                raise OptionError(
                    f"when: `stop` and `set` do not go together ({self.line}). Begin a new run with the values that are set."
                )
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
