"""What follows from accelerations and forces next to singular positions of loops, where these are known to few digits: it lies between what it is to either side."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acausal.integrators.passage import Passage, passage_of

if TYPE_CHECKING:
    from acausal.simulate.trajectory import Trajectory

Read = Callable[["Trajectory"], np.ndarray]
"""Values (rows, n) of a motion at its times."""


@dataclass(frozen=True, eq=False)
class Beside:
    """Times number `some` (k,) of a motion, next to positions that it leads straight through, and the motion `far` and `near` to either side of each, `part` (k,)
    as far."""

    passage: Passage
    some: np.ndarray
    far: Trajectory
    near: Trajectory
    part: np.ndarray

    def between(self, values: np.ndarray, read: Read, forces: bool) -> np.ndarray:
        """`values` (rows, n) at all times, and at some of them what lies between; not where `forces` become infinite in between."""
        far, near = self._values(read)
        good = self.passage.is_smooth(far, near, self.part) if forces else np.full(self.some.size, True)
        found = self.passage.middle(np.where(self._bends[:, None], near, far))
        values = values.copy()
        values[:, self.some[good]] = found[:, good]
        return values

    @functools.cached_property
    def _bends(self) -> np.ndarray:
        """(k,): where the motion bends so much that near points tell more."""
        return self.passage.bends(*self._values(lambda run: run.state_rates))

    def _values(self, read: Read) -> list[np.ndarray]:
        return [read(run).reshape(-1, self.some.size, run.t.size // self.some.size) for run in (self.far, self.near)]


def beside(run: Trajectory, aside: np.ndarray) -> Beside | None:
    """None where no time of a motion has places `aside` (n, 3) [s] to go to either side from."""
    passage, some = passage_of(run.problem), np.flatnonzero(aside[:, 0] > 0)
    if passage is None or not some.size:
        return None

    def moved(tau: np.ndarray) -> Trajectory:
        times, X = passage.points(run.t[some], run.x.T[some], tau)
        return run.given(times.ravel(), X.reshape(times.size, -1).T, run.problem.inputs(times.ravel()))

    far, near = aside[some, 0], aside[some, 1]
    return Beside(passage, some, moved(far), moved(near), near / far)
