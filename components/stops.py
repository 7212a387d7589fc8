"""Stops and play: what keeps a flange within limits, and is nothing in between."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import final

from acausal.errors import ParameterError
from acausal.language.equation import Equation
from acausal.language.expression import Expression, Reaction, Scalar, scalar
from acausal.language.impact_laws import Restitution, impact_law
from acausal.language.mode_laws import ModeLaw, OneSided
from acausal.language.origin import origin
from components.flanges import AbstractOnFlanges, Flange, asked


class AbstractLimits(AbstractOnFlanges):
    """Keeps lower <= moved <= upper, where either may be None.

    `at_lower`, `at_upper` [N or N*m] >= 0: how hard it pushes there, forward and back. `effort`: the first less the second.
    """

    at_lower: Reaction | None = None
    at_upper: Reaction | None = None

    def _limit(self, lower: Scalar | None, upper: Scalar | None, restitution: Restitution) -> None:
        name, unit = type(self).__name__, "rad" if self.rotates else "m"
        self._lower = None if lower is None else scalar(lower, f"{name}'s lower", unit=unit)
        self._upper = None if upper is None else scalar(upper, f"{name}'s upper", unit=unit)
        self.restitution = impact_law(restitution, f"{name}'s restitution")
        if self._lower is not None:
            self.at_lower = Reaction(self.effort_unit, "how hard it pushes forward")
        if self._upper is not None:
            self.at_upper = Reaction(self.effort_unit, "how hard it pushes back")

    @property
    def effort(self) -> Expression:
        """What drives the flange forward, flange_b where there are two [N or N*m]."""
        forward = 0.0 if self.at_lower is None else self.at_lower
        return 1.0 * forward - (0.0 if self.at_upper is None else self.at_upper)  # pyright: ignore[reportReturnType]  # one of them is there

    @final
    def equations(self) -> Iterable[Equation]:
        yield from self._exerts(self.effort)

    @final
    def laws(self) -> Iterable[ModeLaw]:
        if self.at_lower is not None and self._lower is not None:
            yield OneSided(self.at_lower, self.moved - self._lower, self.restitution)
        if self.at_upper is not None and self._upper is not None:
            yield OneSided(self.at_upper, self._upper - self.moved, self.restitution)


@final
class EndStop(AbstractLimits):
    """Hard ends for a flange: lower <= s <= upper (phi on shafts), either may be left out. [m], [rad].

    Where it strikes one with a speed it leaves with `restitution` (0 ... 1) times that speed; with 0 it rests there until something drives it away. `at_lower`
    and `at_upper` [N or N*m], both >= 0, are how hard the ends push. A flange that begins beyond one is refused.

        scene.stop = EndStop(scene.slide.flange, lower=-0.2, upper=0.3, restitution=0.5)
    """

    def __init__(
        self, flange: Flange, lower: Scalar | None = None, upper: Scalar | None = None, restitution: Restitution = 0.0
    ) -> None:
        self._take(flange=flange)
        if lower is None and upper is None:
            raise ParameterError(f"EndStop has neither 'lower' nor 'upper' ({origin()}). Give one of its ends, or both.")
        self._limit(lower, upper, restitution)
        if self._lower is not None and self._upper is not None:
            above(self._upper, self._lower, "EndStop")


@final
class Backlash(AbstractLimits):
    """Play between two flanges: free within, hard at both ends: |s_b - s_a| <= width / 2 (phi on shafts). `width` [m or rad] > 0.

    Teeth strike with `restitution` (0 ... 1): they part with so much of the speed with which they meet. `at_lower` drives flange_b forward where it is
    behind by width / 2, `at_upper` back where it is ahead [N or N*m], both >= 0; a Gear beside it adds a ratio.

        scene.play = Backlash(scene.motor.flange_b, scene.load.flange_a, width=0.01)
    """

    def __init__(self, flange_a: Flange, flange_b: Flange, width: Scalar, restitution: Restitution = 0.0) -> None:
        self._take(flange_a=flange_a, flange_b=flange_b)
        self.width = scalar(width, "Backlash's width", positive=True, unit="rad" if self.rotates else "m")
        self._limit(-0.5 * self.width, 0.5 * self.width, restitution)


def above(upper: float | Expression, lower: float | Expression, name: str) -> None:
    """Raises `ParameterError` unless upper > lower, also by the values of parameters."""
    asked(upper - lower, functools.partial(_check_order, name=name))


def _check_order(play: float, name: str) -> None:
    if not play > 0:
        how = f"{-play:g} below" if play < 0 else "at"
        raise ParameterError(f"{name}'s upper is {how} its lower ({origin()}). Exchange them, or leave one out.")
