"""What follows from accelerations and forces next to singular positions of loops, where these are known to few digits: it lies between what it is to either side."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from acausal.integrators.passage import POINTS, Passage

Run = TypeVar("Run")
"""A motion at its times."""


@dataclass(frozen=True, eq=False)
class Beside(Generic[Run]):
    """Times number `some` (k,) of a motion, next to positions that it leads straight through, and the motion `far` and `near` to either side of each, `part` (k,)
    as far."""

    passage: Passage
    some: np.ndarray
    far: Run
    near: Run
    part: np.ndarray
    rates: Callable[[Run], np.ndarray]
    """Those of all states (rows, n)."""

    def between(self, values: np.ndarray, read: Callable[[Run], np.ndarray], forces: bool) -> np.ndarray:
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
        return self.passage.bends(*self._values(self.rates))

    def _values(self, read: Callable[[Run], np.ndarray]) -> list[np.ndarray]:
        return [read(run).reshape(-1, self.some.size, POINTS) for run in (self.far, self.near)]
