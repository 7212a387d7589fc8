"""Laws of impact: what becomes of the speed with which a gap closes. A number in their place is Poisson's."""

from __future__ import annotations

import functools
from abc import ABC
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, checked, scalar
from acausal.language.origin import origin


@dataclass(frozen=True, eq=False)
class AbstractImpactLaw(ABC):
    """`restitution` from 0 (no bounce) to 1 (no loss); must say by which `number` the integrators know it. `in_sequence`: it strikes alone, one contact after the other
    as long as any closes, not together with all that touch; where several close in the same instant and move one another, the run ends with their names, since
    no law says which comes first.
    """

    restitution: Scalar
    in_sequence: bool = False
    number: ClassVar[int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "restitution", _from_0_to_1(self.restitution, f"{type(self).__name__}'s restitution"))
        if not isinstance(self.in_sequence, bool):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"{type(self).__name__}'s in_sequence is {self.in_sequence!r} ({origin()}). Give True or False.")

    @property
    def kind(self) -> int:
        """As in impacts.h."""
        return self.number + 4 * self.in_sequence


@final
@dataclass(frozen=True, eq=False)
class Poisson(AbstractImpactLaw):
    """The normal impulse while bodies part is `restitution` times that while they meet. With friction it gains no energy.

    Hard(restitution=ac.Poisson(1.0, in_sequence=True))
    """

    number = 0


@final
@dataclass(frozen=True, eq=False)
class Newton(AbstractImpactLaw):
    """Bodies part with at least `restitution` times the speed with which they meet. Where friction moves the normal, this may gain energy: then the run ends, with its
    transitions.

    Hard(restitution=ac.Newton(0.5))
    """

    number = 1


@final
@dataclass(frozen=True, eq=False)
class Energetic(AbstractImpactLaw):
    """The normal force gives back `restitution`^2 of the work that it takes, along the path on which friction stops or turns the slip (Stronge). It strikes
    alone, as with `in_sequence`.

        Hard(restitution=ac.Energetic(0.5), friction=Coulomb(0.3))
    """

    number = 2


Restitution = Scalar | AbstractImpactLaw


def impact_law(value: Restitution, what: str) -> AbstractImpactLaw:
    """`what`: of which part it is, for messages: "Hard's restitution". Raises `ParameterError` for numbers, also values of parameters, that are not from 0 to 1."""
    return value if isinstance(value, AbstractImpactLaw) else Poisson(_from_0_to_1(value, what))


def _from_0_to_1(value: Scalar, what: str) -> float | Expression:
    given = scalar(value, what, non_negative=True, unit="1")
    checked_below(1.0, given, functools.partial(_check_left, what=what))
    return given


def _check_left(left: np.ndarray, what: str) -> None:
    if left.item() < 0:
        raise ParameterError(f"{what} is {1 - left.item():g} ({origin()}). Give a number from 0 (no bounce) to 1 (no loss).")


def checked_below(most: Scalar, value: Scalar, check: Callable[[np.ndarray], None]) -> None:
    """Asks `check` of most - value, and again for other values of parameters."""
    difference = most - value  # pyright: ignore[reportOperatorIssue, reportUnknownVariableType]  # numbers or expressions
    if isinstance(difference, Expression):
        checked(difference, check)
    else:
        check(np.array(difference))
