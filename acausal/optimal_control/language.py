"""What is minimised, and what is left open, in the words of a problem of optimal control."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from acausal.arguments import finite
from acausal.errors import OptionError
from acausal.language.expression import Expression

Integrand = Expression | float


@dataclass(frozen=True, eq=False)
class Cost:
    """A sum of integrals and averages over the motion and of values at its ends; `duration`: times the length of the motion [s].

    Made by `integral`, `average`, `at_start`, `at_end` and a problem's `duration`; costs and numbers add up, and can be multiplied by numbers.
    """

    integrals: tuple[Integrand, ...] = ()
    averages: tuple[Integrand, ...] = ()
    starts: tuple[Integrand, ...] = ()
    ends: tuple[Integrand, ...] = ()
    duration: float = field(default=0.0)

    def __repr__(self) -> str:
        kinds = (("integral", self.integrals), ("average", self.averages), ("at_start", self.starts), ("at_end", self.ends))
        terms = [f"{name}({value})" for name, values in kinds for value in values]
        return " + ".join([*terms, *([f"{self.duration:g} duration"] if self.duration else [])]) or "0"

    def __add__(self, other: Cost | float) -> Cost:
        if not isinstance(other, Cost):
            return self + Cost(ends=(finite(other, "What is added to a cost, beside ac.integral, ac.at_end and such,"),))
        return Cost(
            self.integrals + other.integrals,
            self.averages + other.averages,
            self.starts + other.starts,
            self.ends + other.ends,
            self.duration + other.duration,
        )

    __radd__ = __add__

    def __pow__(self, power: object) -> Cost:
        raise OptionError(
            "A cost is a sum of integrals and of values at the ends, and no function of them. Take the power of what is integrated: ac.integral(scene.force**2)."
        )

    def __mul__(self, factor: float) -> Cost:
        k = finite(factor, "The factor of a cost")
        a, b, c, d = (tuple(k * part for part in kind) for kind in (self.integrals, self.averages, self.starts, self.ends))
        return Cost(a, b, c, d, k * self.duration)

    __rmul__ = __mul__

    def __neg__(self) -> Cost:
        return self * -1.0

    def __sub__(self, other: Cost | float) -> Cost:
        return self + -1.0 * other

    def __rsub__(self, other: float) -> Cost:
        return other + -self

    def __truediv__(self, divisor: float) -> Cost:
        return self * (1.0 / finite(divisor, "The divisor of a cost"))


def integral(integrand: Integrand) -> Cost:
    """Over the whole motion, by time [unit of the integrand times s]."""
    return Cost(integrals=(_checked(integrand, "integral"),))


def average(integrand: Integrand) -> Cost:
    """The integral divided by the length of the motion [unit of the integrand]."""
    return Cost(averages=(_checked(integrand, "average"),))


def at_start(value: Integrand) -> Cost:
    """The value of an expression of positions and velocities at the beginning of the motion."""
    return Cost(starts=(_checked(value, "at_start"),))


def at_end(value: Integrand) -> Cost:
    """The value of an expression at the end of the motion."""
    return Cost(ends=(_checked(value, "at_end"),))


def _checked(given: Any, what: str) -> Integrand:
    if isinstance(given, Expression):
        return given
    if isinstance(given, Cost) or not isinstance(given, int | float | np.number):
        raise OptionError(
            f"{what}: {given!r} is no expression. Write it in variables of the scene, ac.{what}(scene.force**2), or as a number."
        )
    return finite(given, what)


@dataclass(frozen=True)
class free:
    """Something to be found between `lower` and `upper`; `guess`: where to begin, between them where it is not given."""

    lower: float = -float("inf")
    upper: float = float("inf")
    guess: float | None = None

    def checked(self, what: str) -> free:
        """Itself, with a guess. Raises `OptionError` where the bounds cross or leave the guess out, and for what are no numbers."""
        for one in (self.lower, self.upper, *(() if self.guess is None else (self.guess,))):
            if isinstance(one, bool) or not isinstance(one, int | float | np.number):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
                raise OptionError(
                    f"{what} is free between {self.lower!r} and {self.upper!r}: give numbers, ac.free(lower, upper, guess)."
                )
        if not self.lower < self.upper:
            raise OptionError(
                f"{what} is free between {self.lower:g} and {self.upper:g}: the lower bound must be below the upper one."
            )
        if self.guess is not None:
            if not self.lower <= self.guess <= self.upper:
                raise OptionError(f"{what}: its guess {self.guess:g} is not between {self.lower:g} and {self.upper:g}.")
            return self
        if abs(self.lower) == abs(self.upper) == float("inf"):
            return replace(self, guess=0.0)
        if float("inf") in (abs(self.lower), abs(self.upper)):
            return replace(self, guess=self.lower if abs(self.upper) == float("inf") else self.upper)
        both = self.lower * self.upper > 0
        return replace(
            self,
            guess=(abs(self.lower * self.upper) ** 0.5 * (1 if self.lower > 0 else -1))
            if both
            else (self.lower + self.upper) / 2,
        )
