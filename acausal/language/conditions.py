"""Conditions on parameters: what parts asked of their numbers when they were made, asked again for other values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, cast

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Condition, Parameter
from acausal.language.origin import ASKED, is_ingredient

_KEPT = 32
"""Values that stay known to be allowed."""


class ParameterConditions:
    """All conditions on these parameters, in their order (np,). One CasADi function gives what is to be checked.

    `asked`: by the parts of the scene, and by what they are made of.
    """

    def __init__(self, parameters: Sequence[Parameter], asked: Sequence[Condition]) -> None:
        known = set(parameters)
        every = {id(c): c for c in (*asked, *(c for parameter in parameters for c in parameter.conditions))}
        found = {key: c for key, c in every.items() if c.value.leaves <= known}
        self._parameters = tuple(parameters)
        self._conditions: tuple[Condition, ...] = tuple(
            sorted(found.values(), key=lambda c: c.value.sx.numel())
        )  # simple ones first
        p = ca.vertcat(ca.SX(0, 1), *(parameter.sx for parameter in parameters))
        self._allowed = set[bytes]()
        self._values = ca.Function("conditions", [p], [ca.densify(c.value.sx) for c in self._conditions])

    def check(self, values: np.ndarray) -> None:
        """Raises `ParameterError` where these values (np,) break a condition."""
        key = values.tobytes()
        if not self._conditions or key in self._allowed:
            return
        for condition, value in zip(self._conditions, self._values.call([ca.DM(values)]), strict=True):
            try:
                condition.check(np.array(value))
            except ParameterError as error:
                given = [
                    f"{p.name} = {v:g}" for p, v in zip(self._parameters, values, strict=True) if p in condition.value.leaves
                ]
                raise ParameterError(f"With the parameters of this call ({', '.join(given)}): {error}") from None
        if len(self._allowed) >= _KEPT:
            self._allowed.clear()
        self._allowed.add(key)

    def allow(self, values: np.ndarray) -> bool:
        """Whether these values (np,) keep all conditions."""
        try:
            self.check(values)
        except ParameterError:
            return False
        return True


def asked_by(component: object) -> Iterator[Condition]:
    """What a component asks of parameters, and what it is made of asks: laws, curves, surfaces, shapes."""
    queue, seen = [component], set[int]()
    while queue:
        one = queue.pop()
        if isinstance(one, list | tuple):
            queue += cast("Sequence[object]", one)
        elif isinstance(one, dict):
            queue += cast("dict[Any, object]", one).values()
        elif (one is component or is_ingredient(one)) and id(one) not in seen:
            seen.add(id(one))
            own = dict(vars(one))
            yield from own.pop(ASKED, ())
            queue += own.values()
