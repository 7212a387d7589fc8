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
    best motions near the guesses of a program, and whether there are any.
    """

    parts: Sequence[Part]
    problem: Whole
    unknowns: np.ndarray
    again: Callable[[Whole], tuple[np.ndarray, bool]]

    @functools.cached_property
    def costs(self) -> tuple[float, ...]:
        """Of each phase; infinite where none is found."""
        parts = list[Part]()
        for k, (part, before) in enumerate(zip(self.parts, self.problem.parts, strict=True)):
            own, stages = self.problem.unknowns(self.unknowns, k), before.mesh.tableau.stages
            mesh = replace(before.settled(own), loose=before.mesh.loose, tableau=radau_iia(stages + 1))
            parts.append(replace(part, mesh=mesh, guess=before.motion(own)))
        program = whole(parts, self.problem.links)
        w, success = self.again(program)
        return tuple(program.own_cost(w, k) if success else float("inf") for k in range(len(parts)))
