"""What parts that act on given flanges have in common: along lines and on shafts they are the same parts."""

from __future__ import annotations

import functools
from abc import ABC
from collections.abc import Callable
from typing import Any, ClassVar

import casadi as ca
import numpy as np

import acausal.language.expression as language
from acausal.errors import IncompatibleError
from acausal.language.component import Component, add_connection, check_compatible
from acausal.language.connector import FLOWS, Connector, Rotational, Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Scalar, checked, scalar
from acausal.language.origin import origin

Flange = Rotational | Translational


class AbstractOnFlanges(Component, ABC):
    """A part that is made on one flange or between two, given to it, and is connected to them by that: rotational or translational, as they are.

    `moved`, `speed`: of flange_b against flange_a; of the one flange there is, against zero.
    """

    rotates: bool
    """Whether it is on shafts: then [N*m], [rad], [rad/s], else [N], [m], [m/s]."""
    ends: ClassVar[str] = "Give the flange of a joint, a shaft or a mass: scene.hinge.flange."

    def _take(self, **given: Any) -> None:
        """Flanges of its own, by name, each connected to the one given. Raises `IncompatibleError`."""
        name = type(self).__name__
        for flange in given.values():
            if not isinstance(flange, Rotational | Translational):
                what = repr(flange)
                raise IncompatibleError(f"{name}(...) stands on flanges, and was given {what} ({origin()}). {self.ends}")
        first = next(iter(given.values()))
        for flange in list(given.values())[1:]:
            check_compatible(first, flange)
        for own, flange in given.items():
            mine = type(flange)(self, own)
            setattr(self, own, mine)
            add_connection(self, flange, mine)
        self.rotates = isinstance(first, Rotational)

    @property
    def _ends(self) -> list[Connector]:
        return [self.__dict__[name] for name in ("flange", "flange_a", "flange_b") if name in self.__dict__]

    @property
    def effort_unit(self) -> str:
        """Of what it exerts."""
        return "N*m" if self.rotates else "N"

    @property
    def moved(self) -> Expression:
        """[m or rad]."""
        places = [getattr(end, FLOWS[type(end)][0]) for end in self._ends]
        return places[1] - places[0] if len(places) == 2 else 1.0 * places[0]

    @property
    def speed(self) -> Expression:
        """[m/s or rad/s]."""
        places = [der(getattr(end, FLOWS[type(end)][0])) for end in self._ends]
        return places[1] - places[0] if len(places) == 2 else 1.0 * places[0]

    def _exerts(self, effort: Expression) -> list[Equation]:
        """That `effort` drives the flange, or flange_b, forward, and flange_a back."""
        flows = [getattr(end, FLOWS[type(end)][1]) for end in self._ends]
        back = [equal(flow, effort) for flow in flows[:-1]]
        return [*back, equal(flows[-1], -1.0 * effort)]


def gate_of(value: Scalar | Callable[[Any], Any], what: str) -> Expression:
    """What lets a part that goes one way only begin to hold, where it is positive; checked."""
    found = scalar(language.of_time(value), what)
    return found if isinstance(found, Expression) else Expression(ca.SX(found), frozenset())


def asked(value: float | Expression, check: Callable[[float], None]) -> float | Expression:
    """The same value; `check` raises `ParameterError` for numbers that it must not have, now and as other values of parameters."""
    if isinstance(value, Expression):
        return checked(value, functools.partial(_of_array, check=check))
    check(value)
    return value


def _of_array(found: np.ndarray, check: Callable[[float], None]) -> None:
    check(found.item())
