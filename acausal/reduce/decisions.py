"""Decisions of the reduction, asked again at the values of parameters of each call: pivots, ranks, what follows from what."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from acausal.errors import ParameterError
from acausal.reduce.state_space import StateSpace
from acausal.scalar.decisions import LinearDecisions, linear_decisions
from acausal.wording import compact


@dataclass(frozen=True, repr=False)
class Decisions:
    """Of a model, verified at the values of parameters that it was built with."""

    space: StateSpace

    def check(self, values: np.ndarray) -> None:
        """Raises `ParameterError` naming the parameters whose values (np,) the model was not made for."""
        system = self.space.system
        changed = np.flatnonzero(values != system.p_values)
        if not changed.size:
            return
        words = self._complaint(values)
        if not words:
            return
        alone = [k for k in changed if not self._complaint(np.where(np.arange(values.size) == k, system.p_values, values))]
        given: list[str] = []
        for k in alone or changed:
            parameter = system.flat.parameters[k]
            name = system.flat.names.get(parameter, parameter.name)
            given.append(f"{name} = {values[k]:g} {parameter.unit}".rstrip() + f" (built with {system.p_values[k]:g})")
        raise ParameterError(
            f"With {compact(given, 4)} {words}. The model was made for other values: build the scene with these, or give one that is less "
            "extreme."
        )

    def _complaint(self, values: np.ndarray) -> str:
        return self._linear.complaint(values) or self.space.complaint(values)

    @functools.cached_property
    def _linear(self) -> LinearDecisions:
        return linear_decisions(self.space.system.scalar.blocks, self.space.system.p)
