"""A problem of optimal control by the unknowns of a stage: what is limited, when, and what is minimised."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.optimal_control.smooth import Smooth
from acausal.optimal_control.stage import Stage


@dataclass(frozen=True, eq=False)
class Limits:
    """`value` (n, 1) of a stage's unknowns, between `lower` and `upper` (n,); `name`: what it is, in words. `said`: of the entries of start values what users said of the first ones."""

    value: ca.SX
    lower: np.ndarray
    upper: np.ndarray
    name: str
    said: tuple[str, ...] = ()

    def entry(self, r: int) -> str:
        """What one of the entries is, in words."""
        if r < len(self.said):
            return self.said[r]
        return self.name if self.value.numel() == 1 else f"{self.name}[{r}]"

    def range(self, r: int) -> str:
        """Where one of the entries is to be, in words."""
        lower, upper = self.lower[r], self.upper[r]
        if lower == upper:
            return f"{lower:g}"
        if np.isfinite([lower, upper]).all():
            return f"between {lower:g} and {upper:g}"
        return f"at least {lower:g}" if np.isfinite(lower) else f"at most {upper:g}"

    def outside(self, found: float, r: int, size: float = 0.0) -> bool:
        """Whether an entry with this value is clearly not where it is to be; `size`: what is much for it, beside these numbers."""
        lower, upper = self.lower[r], self.upper[r]
        room = ROOM * max(size, *(abs(v) for v in (found, lower, upper) if np.isfinite(v)))
        return not lower - room <= found <= upper + room

    def excess(self, values: np.ndarray) -> np.ndarray:
        """By how much values (entries, n) are outside, not negative."""
        lower, upper = self.lower[:, None], self.upper[:, None]
        with np.errstate(invalid="ignore"):  # a side without a limit is not left by what has no number, either
            below = np.where(np.isfinite(lower), lower - values, 0.0)
            above = np.where(np.isfinite(upper), values - upper, 0.0)
        return np.maximum(0.0, np.maximum(below, above))

    def share(self, values: np.ndarray) -> np.ndarray:
        """The same (entries, n), relative to what each entry is at most; infinite where a value is no number."""
        known = np.isfinite(values)
        told = np.where(known, values, 0.0)
        return np.where(known, self.excess(told) / self.sizes(told)[:, None], np.inf)

    def sizes(self, values: np.ndarray) -> np.ndarray:
        """(entries,): what is much for each, by values (entries, n) and finite bounds that are not zero."""
        bounds = np.abs(np.vstack([self.lower, self.upper]))
        found = np.maximum(np.max(np.abs(values), axis=1), np.max(np.where(np.isfinite(bounds), bounds, 0.0), axis=0))
        return np.where(found > 0, found, 1.0)


def when(at: float | None) -> str:
    """In words: at a part of the duration, None all the time."""
    if at is None:
        return "all the time"
    return {0.0: "at the start", 1.0: "at the end"}.get(at, f"when {at:g} of the time has passed")


@dataclass(frozen=True, eq=False)
class Total:
    """A sum of integrals, averages and values at the `starts` and `ends` (1, 1), with `per_second` times the duration."""

    integrals: ca.SX
    averages: ca.SX
    starts: ca.SX
    ends: ca.SX
    per_second: float


ROOM = 1e-6
"""Of what a bound and a value are: how far apart they are before they contradict each other."""
AS_AT_START = "as at the start: "
"""How the names of rows begin that say of a state that it returns."""
FREE, CONSTANT, LINEAR = "free", "constant", "linear"
"""What inputs are in each interval: polynomials through its points, numbers, or straight lines that go on from one to the next."""
GIVEN = "start values"
"""The name of what is given at the start and holds with what is free there."""


@dataclass(frozen=True, eq=False)
class Asked:
    """A problem, by unknowns of a `stage`. `path`: at every point; `here`: at parts of the duration; `start` (nx,): all states, NaN what is open;
    `cost`: what is minimised; `totals`: what else stays between two numbers, with names. `periodic`: by what the states
    (nx,) are more at the end than at the start, NaN what is open. `controls`: what inputs are in each interval. `duration` and `geometry`:
    (2,) and (free parameters, 2) bounds.
    """

    stage: Stage
    path: Sequence[Limits]
    here: Sequence[tuple[float, Limits]]
    start: np.ndarray | None
    periodic: np.ndarray | None
    cost: Total
    totals: Sequence[tuple[Total, float, float, str]]
    controls: str
    duration: np.ndarray
    geometry: np.ndarray

    @property
    def held(self) -> bool:
        """Whether inputs are constant in each interval."""
        return self.controls == CONSTANT

    @functools.cached_property
    def points(self) -> dict[tuple[int, ...], Smooth]:
        """What was made of a point for programs, by how these take it."""
        return {}

    @functools.cached_property
    def linear(self) -> bool:
        """Whether all but the cost, and but for a free time, is linear in the unknowns of a point."""
        stage = self.stage
        said = [*self.path, *(limits for _, limits in self.here)]
        rows = ca.veccat(stage.rates, stage.balance, stage.invariants[0], *(limits.value for limits in said))
        unknowns = ca.vertcat(stage.unknowns[: stage.width], stage.geometry)
        return not any(ca.which_depends(stage.put(rows), unknowns, 2, True))

    @functools.cached_property
    def proportional(self) -> bool:
        """Whether inputs act, and are paid for, in proportion alone: the best ones are at bounds then, or along singular arcs."""
        stage = self.stage
        said, cost = [*self.path, *(limits for _, limits in self.here)], self.cost
        paid = (cost.integrals, cost.averages, cost.starts, cost.ends)
        rows = ca.veccat(stage.rates, stage.balance, *(limits.value for limits in said), *paid)
        inputs = stage.unknowns[stage.width - stage.sizes[3] : stage.width]
        return bool(inputs.numel()) and not any(ca.which_depends(stage.put(rows), inputs, 2, True))

    @property
    def entries(self) -> list[tuple[int, Limits, int]]:
        """Of what has limits all the time each entry: these, its number there, and before them the number of the unknown that it is; -1 where it is none."""
        known = {self.stage.unknowns[k].element_hash(): k for k in range(self.stage.width)}
        entries = [(one, r) for one in self.path for r in range(one.value.numel())]
        return [(known.get(one.value[r].element_hash(), -1) if one.value[r].is_symbolic() else -1, one, r) for one, r in entries]
