"""The same motions with more points between the nodes: what a mesh leaves of the cost shows beside them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acausal.collocation.tableau import radau_iia
from acausal.optimal_control.whole import Part, Whole, whole


@dataclass(frozen=True, eq=False)
class Sharper:
    """The motions of a `problem` that `unknowns` (n,) tell, with one point more in each interval; nodes that were loose still are. `again`: unknowns of the
    best motions near the guesses of a program, and about how far their cost is from the least one; infinite where there are none.
    """

    parts: Sequence[Part]
    problem: Whole
    unknowns: np.ndarray
    again: Callable[[Whole], tuple[np.ndarray, float]]

    @functools.cached_property
    def costs(self) -> tuple[float, ...]:
        """Of each phase; infinite where none is found."""
        program, w, off = self._found
        return tuple(program.own_cost(w, k) if off < np.inf else float("inf") for k in range(len(self.parts)))

    @property
    def off(self) -> float:
        """About how far all these costs together are from the least one, in their turn."""
        return self._found[2]

    @functools.cached_property
    def _found(self) -> tuple[Whole, np.ndarray, float]:
        parts = list[Part]()
        for k, (part, before) in enumerate(zip(self.parts, self.problem.parts, strict=True)):
            own, stages = self.problem.unknowns(self.unknowns, k), before.mesh.tableau.stages
            mesh = replace(before.settled(own), loose=before.mesh.loose, tableau=radau_iia(stages + 1))
            parts.append(replace(part, mesh=mesh, guess=before.motion(own)))
        program = whole(parts, self.problem.links)
        return program, *self.again(program)
