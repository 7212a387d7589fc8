"""Decisions of the reduction, asked again at the values of parameters of each call: pivots, ranks, what follows from what."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from acausal.dynamics.virtual_inertia import TreeInertia
from acausal.errors import ParameterError
from acausal.reduce.state_space import StateSpace
from acausal.scalar.decisions import LinearDecisions, linear_decisions
from acausal.wording import compact

_FAR = 30.0
"""Times as large or small, values are of another size."""
_KEPT = 32
"""Values that stay known."""


@dataclass(frozen=True, repr=False)
class Decisions:
    """Of a model, verified at the values of parameters that it was built with."""

    space: StateSpace

    def near(self, values: np.ndarray) -> bool:
        """Whether values (np,) are of the size of those of the build, by which unknowns and rows are measured."""
        built = self.space.system.p_values
        changed = values != built
        a, b = np.abs(values[changed]), np.abs(built[changed])
        return bool(np.all((a <= _FAR * b) & (b <= _FAR * a)))

    def hold(self, values: np.ndarray) -> bool:
        """Whether everything holds at these values (np,), as it does at those of the build."""
        if np.array_equal(values, self.space.system.p_values):
            return True
        key = values.tobytes()
        if key not in self._known:
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[key] = not self.complaint(values)
        return self._known[key]

    def check(self, values: np.ndarray) -> None:
        """Raises `ParameterError` naming the parameters whose values (np,) the model was not made for."""
        system = self.space.system
        if self.hold(values):
            return
        changed = np.flatnonzero(values != system.p_values)
        words = self.complaint(values)
        alone = [k for k in changed if not self.complaint(np.where(np.arange(values.size) == k, system.p_values, values))]
        given: list[str] = []
        for k in alone or changed:
            parameter = system.flat.parameters[k]
            name = system.flat.names.get(parameter, parameter.name)
            given.append(f"{name} = {values[k]:g} {parameter.unit}".rstrip() + f" (built with {system.p_values[k]:g})")
        raise ParameterError(
            f"With {compact(given, 4)} {words}. The model was made for other values: build the scene with these, or give one that is less "
            "extreme."
        )

    @functools.cached_property
    def _known(self) -> dict[bytes, bool]:
        """Values that were looked at, and whether everything holds there."""
        return {}

    def complaint(self, values: np.ndarray) -> str:
        """What does not hold at these values (np,), in words; empty where everything does."""
        return self._linear.complaint(values) or self.space.complaint(values) or self._lost_inertia(values)

    def _lost_inertia(self, values: np.ndarray) -> str:
        """Which motions meet no inertia in the tree at these values (np,) but do at those of the build, in words."""
        system = self.space.system
        if not self._inertia.depends_on(np.flatnonzero(values != system.p_values).tolist()):
            return ""
        lost = sorted(set(self._inertia.massless(values)) - self._massless)
        where = (system.mechanics.tree.links[i].where for i in lost)
        return f"no inertia resists the motion of {compact(where, 4)}" if lost else ""

    @functools.cached_property
    def _inertia(self) -> TreeInertia:
        system = self.space.system
        return TreeInertia(system.mechanics.tree, system.p, system.constraints.q_start)

    @functools.cached_property
    def _massless(self) -> set[int]:
        """Links whose motion meets no inertia in the tree at the values of the build: loops give them one."""
        return set(self._inertia.massless(self.space.system.p_values))

    @functools.cached_property
    def _linear(self) -> LinearDecisions:
        return linear_decisions(self.space.system.scalar.blocks, self.space.system.p)
