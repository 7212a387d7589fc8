"""Conditions on parameters: what parts asked of their numbers when they were made, asked again for other values."""

from __future__ import annotations

from collections.abc import Sequence, Set

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Condition, Parameter

_KEPT = 32
"""Values that stay known to be allowed."""


class ParameterConditions:
    """All conditions on these parameters, in their order (np,). One CasADi function gives what is to be checked.

    `lines`: where the parts of the scene were made; what was asked by a part that is not among them does not count.
    """

    def __init__(self, parameters: Sequence[Parameter], lines: Set[str]) -> None:
        known = set(parameters)
        asked = {id(c): c for parameter in parameters for c in parameter.conditions}
        found = {key: c for key, c in asked.items() if c.value.leaves <= known and (not c.line or c.line in lines)}
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
