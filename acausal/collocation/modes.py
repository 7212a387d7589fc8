"""Modes of a problem as functions of numbers: what the runtime decides by which rows hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.staged import Function


@dataclass(frozen=True, eq=False)
class SetFunctions:
    """What is set at zeros of `guards`: (t, x, u, p) -> (n,), passed in `directions` (n,): 1 upwards, -1 downwards, 0 both.

    `values`: (t, x, u, p) -> the discrete values at the start, then new ones for all `targets`, those of guard k from `first[k]` to `first[k + 1]`:
    numbers of states, or nx and more for discrete values; then rates of all guards, 0 where they are not known. `words`: of each guard, then of each target.
    """

    guards: ca.Function
    values: ca.Function
    directions: tuple[int, ...]
    first: tuple[int, ...]
    targets: tuple[int, ...]
    words: tuple[str, ...]
    target_words: tuple[str, ...]
    remembered: tuple[str, ...]
    """What each discrete value is called."""
    locks: tuple[str, ...] = ()
    """What each row is called that something may be held by: (t, x, u, p) gives these gaps before the guards' rates, then the terms that they are made of; 0 where nothing is."""

    def no_beginning(self, k: int) -> str:
        """That a discrete value begins with what is no number, in words."""
        return (
            f"{self.remembered[k]} begins with what is no number: its start has no value there, as by a division by zero or a root of what is negative. "
            "Begin elsewhere, or say what it begins with in `start`."
        )


@dataclass(frozen=True, eq=False)
class ModeFunctions:
    """`masks`: how many of the inputs u are masks, the last ones: one for each of `one_sided` laws, then two for each of `lines`, frictions in one
    direction, six for each of `planes`, those in two, eight for each of `patches`, and three for each of `magnitudes` that limits depend on; where rows are `redundant` their damping, and the
    reactions that are carried on: since when, n of them, and their rates; and `discretes`, which are `set`.

    `guards`: (t, x, u, p) -> positive as long as the masks are right: one for each one-sided row, two for each friction and each magnitude. `decision`: (t, x, u, p) -> what
    modes are decided by, see modes.h, but for `terms`, the sizes of what gaps are made of and -1 where there is none, at its end. `invariants`, `projection`: (t, x, u, p) -> everything that stays zero in a mode, and one Newton step
    towards it. `words`: what each law is called.
    """

    one_sided: int
    lines: int
    planes: int
    patches: int
    magnitudes: int
    redundant: bool
    guards: Function
    decision: Function
    terms: ca.Function
    invariants: ca.Function
    projection: Function
    words: tuple[str, ...]
    discretes: int = 0
    set: SetFunctions | None = None
    valves: int = 0
    """How many of the first rows follow at once in some modes, and through states in others: of those masks behind the ones of magnitudes say in which parts, see runtime/index.h."""

    @property
    def masks(self) -> int:
        """How many there are."""
        friction = 2 * self.lines + 6 * self.planes + 8 * self.patches + 3 * self.magnitudes
        index = 1 + 2 * self.valves**2 if self.valves else 0
        return self.one_sided + friction + self.redundant * (2 + 2 * self.reactions) + index + self.discretes

    @property
    def set_count(self) -> int:
        """How many guards there are at which something is set."""
        return 0 if self.set is None else len(self.set.directions)

    @property
    def all_words(self) -> tuple[str, ...]:
        """What each law is called, then who sets something."""
        return self.words if self.set is None else (*self.words, *self.set.words)

    @property
    def rows(self) -> tuple[Function, ...]:
        """Of all guards, in their order."""
        return (self.guards,) if self.set is None else (self.guards, self.set.guards)

    @property
    def laws(self) -> int:
        """How many there are."""
        return self.one_sided + self.lines + self.planes + self.patches

    @property
    def reactions(self) -> int:
        """How many there are."""
        return self.one_sided + self.lines + 2 * self.planes + 3 * self.patches


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


@dataclass(frozen=True, eq=False)
class ModesMet:
    """Changes of mode in order of time, the start's decision first: `masks` (masks, m) from each of the times `begins` (m,) on, and what `Change` has
    of each, `steps` (m,), `rows` (m,), `impulses` (m, n) and `jumped` (m,); `heat` (m, n): what reactions lose where the rest of impacts without end is passed at once.
    """

    begins: np.ndarray
    masks: np.ndarray
    steps: np.ndarray
    rows: np.ndarray
    impulses: np.ndarray
    heat: np.ndarray
    jumped: np.ndarray

    @staticmethod
    def none(begin: float, masks: int, rows: int) -> ModesMet:
        """Of a motion that did not begin."""
        nothing = np.zeros(1, dtype=int)
        return ModesMet(
            np.array([begin]), np.zeros((masks, 1)), nothing, nothing - 1, np.zeros((1, rows)), np.zeros((1, rows)), nothing == 1
        )

    @property
    def changes(self) -> tuple[Change, ...]:
        """One by one."""
        columns = (self.steps.tolist(), self.begins.tolist(), self.rows.tolist(), self.impulses, self.jumped.tolist())
        return tuple(Change(*entry) for entry in zip(*columns, strict=True))

    def at_ends(self, count: int) -> np.ndarray:
        """Masks (masks, n) at so many ends of steps: those before and after an impact are two of them, at the same time."""
        ends = self.steps.copy()
        ends[np.isin(self.steps, self.steps[self.jumped])] += 1
        return self.masks[:, np.maximum(np.searchsorted(ends, np.arange(count), side="right") - 1, 0)]

    def at(self, times: np.ndarray) -> np.ndarray:
        """Masks (masks, n) at times (n,), after what happens there."""
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
