"""Modes of a problem as functions of numbers: what the runtime decides by which rows hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np


@dataclass(frozen=True, eq=False)
class ModeFunctions:
    """`masks`: how many of the inputs u are masks, the last ones: one for each of `one_sided` rows, then two for each of `frictions`.

    `guards`: (t, x, u, p) -> positive as long as the masks are right: one for each one-sided row, two for each friction. `decision`: (t, x, u, p) -> what
    modes are decided by, see modes.h. `invariants`, `projection`: (t, x, masks, p) -> everything that stays zero in a mode, and one Newton step
    towards it. `words`: what each row is called.
    """

    one_sided: int
    frictions: int
    guards: ca.Function
    decision: ca.Function
    invariants: ca.Function
    projection: ca.Function
    words: tuple[str, ...]

    @property
    def masks(self) -> int:
        """How many there are."""
        return self.one_sided + 2 * self.frictions


@dataclass(frozen=True)
class Change:
    """Of mode: after so many `steps` of those that are kept, at `time` [s]; `row`: of the guards, which led to it, -1 for the start and jumps of inputs. `impulses` (n,) of all
    rows; `jumped`: whether the step that follows has no length, and leads to the state after an impact.
    """

    step: int
    time: float
    row: int
    impulses: np.ndarray
    jumped: bool


@dataclass(frozen=True)
class ModesMet:
    """Masks (masks, n) from each of the times `begins` (n,) on, and changes in order of time."""

    begins: np.ndarray
    masks: np.ndarray
    changes: tuple[Change, ...]

    def at(self, times: np.ndarray) -> np.ndarray:
        """Masks (masks, m) at times (m,)."""
        return self.masks[:, np.clip(np.searchsorted(self.begins, times, side="right") - 1, 0, self.begins.size - 1)]


@dataclass(frozen=True)
class WithModes:
    """Inputs whose last ones are the masks that a motion had: times (n,) -> (nu, n)."""

    inputs: Callable[[np.ndarray], np.ndarray]
    met: ModesMet

    def __call__(self, times: np.ndarray) -> np.ndarray:
        u = self.inputs(times)
        u[u.shape[0] - self.met.masks.shape[0] :] = self.met.at(times)
        return u

    def copied(self, through: Callable[[Callable[[np.ndarray], np.ndarray]], Callable[[np.ndarray], np.ndarray]]) -> WithModes:
        """For copies and files, see `Inputs`."""
        copied = getattr(self.inputs, "copied", None)
        return WithModes(self.inputs if copied is None else copied(through), self.met)
