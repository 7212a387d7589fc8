"""What an integrator gets and what it gives back."""

from __future__ import annotations

import enum
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import finite, whole_number
from acausal.collocation.modes import ModesMet, WithModes
from acausal.errors import OptionError, RoundingWarning
from acausal.numerics.staged import Function
from acausal.wording import callers_level

Progress = Callable[[float], None]
_FINEST = 1e-15
"""Relative error below which nothing is gained."""


@dataclass(frozen=True)
class Guards:
    """Zeros that are wanted: `function` (t, x, u, p) -> values (n,); for each which crossings count (1 rising, -1 falling, 0 both), and
    whether it ends the motion.
    """

    function: ca.Function
    directions: tuple[int, ...]
    stops: tuple[bool, ...]


@dataclass(frozen=True)
class Crossing:
    """A zero of guard number `guard` at `time` [s]: 1 rising, -1 falling, 0 touched without crossing."""

    time: float
    guard: int
    direction: int


class Through(enum.Enum):
    """How motions go that come near singular positions: all past them, some straight through, or all; with the numbers of `Through` in the runtime."""

    NEVER = 0
    SOMETIMES = 1
    ALWAYS = 2


@dataclass(frozen=True)
class Exact:
    """What makes `rhs` and `project` of a problem once more, for arithmetic with twice as many digits. Where all motions lead straight through it is used
    only where rounding is in the way of the tolerance.
    """

    rhs: Callable[[], ca.Function]
    project: Callable[[], ca.Function]
    through: Through
    usual: np.ndarray
    """(nx,): 1 / how much a position or velocity of loops is, beside others; 0 for other states."""


@dataclass(frozen=True)
class Problem:
    """x' = rhs(t, x, u, p), with invariants g(t, x, u, p) = 0 that hold along exact solutions.

    `rhs`: (t, x[nx], u[nu], p[np]) -> x'[nx]. `invariants`: (t, x, u, p) -> g. `project`: (t, x, u, p) -> x, one Newton correction
    towards g = 0. `inputs`: times (n,) -> u (nu, n). `parameters`: (np,). `constant_inputs`: (nu,) where inputs do not change. `native`: kernels of the
    same functions (a `NativeProblem`), made by whoever integrates where they are missing. `guards`: zeros to be located. `met`:
    (nx,) largest magnitudes of states before the start. `clearance`: (t, x, p) -> 0 where branches of the motion cross, about 1 far away;
    None where they never do. `positions`: how many states are, the first ones. `read`: ascending times [s] that will be read of the motion.
    `knots`: ascending times [s] at which inputs jump or bend, beside those that are known of tables and formulas. `exact`: what is used where
    `clearance` is small.
    """

    rhs: Function
    invariants: ca.Function | None
    project: ca.Function | None
    inputs: Callable[[np.ndarray], np.ndarray]
    parameters: np.ndarray
    constant_inputs: np.ndarray | None = None
    native: Any = None
    guards: Guards | None = None
    met: np.ndarray | None = None
    clearance: ca.Function | None = None
    positions: int = 0
    read: np.ndarray = field(default_factory=lambda: np.zeros(0))
    knots: np.ndarray = field(default_factory=lambda: np.zeros(0))
    exact: Exact | None = None
    discretes: np.ndarray | None = None
    """(n,): discrete values at the start; no number where they follow from it."""

    def with_modes(self, met: ModesMet | None) -> Problem:
        """With inputs as a motion had them, its masks included."""
        return self if met is None else replace(self, inputs=WithModes(self.inputs, met))

    def __reduce__(self) -> tuple[Any, ...]:
        """For copies and files: without the kernels, which belong to this process."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Problem, tuple((values | {"native": None}).values())


@dataclass(frozen=True)
class Accuracy:
    """How exact a motion is to be: `rtol` and `atol` of each step, none longer than `max_step` [s], or a fixed `step` [s]. atol 0: by the sizes
    of the states alone."""

    rtol: float
    atol: float = 0.0
    step: float | None = None
    max_steps: int = 1_000_000
    max_step: float | None = None

    def with_step(self, step: float | None) -> Accuracy:
        """The same with a fixed step, unless `step` is None."""
        return self if step is None else replace(self, step=step)

    @staticmethod
    def asked(rtol: Any, atol: Any = None, step: Any = None, max_steps: Any = 1_000_000, max_step: Any = None) -> Accuracy:
        """Of what a user gives. Raises `OptionError` for what makes no sense; more than double precision holds is a `RoundingWarning`."""
        rtol, atol = finite(rtol, "rtol"), 0.0 if atol is None else finite(atol, "atol")
        step = None if step is None else finite(step, "the step [s]")
        if not (0 < rtol < 1 and atol >= 0) or (step is not None and not step > 0):
            raise OptionError(f"Need 0 < rtol < 1, atol >= 0 and step > 0, not rtol={rtol}, atol={atol}, step={step}.")
        max_step = None if max_step is None else finite(max_step, "max_step [s]")
        if max_step is not None and (not max_step > 0 or step is not None):
            raise OptionError(
                f"max_step must be positive, and goes with steps that adapt, not with a fixed `step`: max_step={max_step}, step={step}."
            )
        if rtol < _FINEST:
            message = f"rtol={rtol:g} asks for more than double precision holds; {_FINEST:g} is used. Errors stay at rounding."
            warnings.warn(message, RoundingWarning, stacklevel=callers_level())
        return Accuracy(max(rtol, _FINEST), atol, step, whole_number(max_steps, "max_steps", 1), max_step)


@dataclass(frozen=True)
class Directions:
    """Directions of derivatives, one a column: of the start state dx (nx, n), of constant inputs du (nu, n), of parameters dp (np, n)."""

    dx: np.ndarray
    du: np.ndarray
    dp: np.ndarray


class Newton(enum.Enum):
    """When the stage equations are solved by simplified Newton in place of fixed-point iteration."""

    NEVER = 0
    WHERE_SLOW = 1
    ALWAYS = 2


class StatusKind(enum.Enum):
    """How an integration ended."""

    SUCCESS = "reached the end"
    STEP_UNDERFLOW = "the step size became too small"
    NON_FINITE = "a rate became infinite or not a number"
    BRANCHES_TOUCH = "branches of the motion touch at a singular position of loops"
    NOT_CONVERGED = "the implicit equations of a step could not be solved"
    INTERRUPTED = "interrupted by the user"
    MAX_STEPS = "the largest number of steps was reached"
    SLIDES = "the rates switch back and forth without end"
    OVERLAPS = "bodies overlap at the start, or after a jump"
    NO_MODE = "nothing that may happen where bodies touch obeys all laws"
    CHATTERS = "contacts change without end in one instant"
    TIED = "bodies strike one after the other, and it is not said which first"
    GAINS = "an impact gains energy"
    FALLS = "what should stay apart has gone through one another"
    OUTSIDE = "a part has come to where it has no meaning"
    NO_DERIVATIVES = "derivatives of the motion are not known from here on"
    CANNOT_SET = "an event sets what cannot be so"
    BUILTIN_FAILED = "CasADi's integrator gave up"


@dataclass(frozen=True)
class Status:
    """Kind, the time reached [s], a sentence, and the index of the state that failed first if known."""

    kind: StatusKind
    time: float
    message: str = ""
    worst: int | None = None


@dataclass(frozen=True)
class Statistics:
    """Counts and cost of an integration. `evaluations` of the rates at one point; `iterations` of the stage equations; `factorisations` of
    Jacobians; `seconds` of wall time, without those that kernels take to be made. `kernels`: who carried them out, and since when. `compiling`:
    seconds in which kernels were made for this call, waited for or in the background. `work`: operations on lanes, as the choice between methods
    counts them: the same on every machine of as many lanes.
    """

    method: str
    order: int
    steps: int
    rejected: int
    evaluations: int
    iterations: int
    seconds: float
    factorisations: int = 0
    kernels: str = ""
    compiling: float = 0.0
    work: float = 0.0


def together(parts: Sequence[Statistics]) -> Statistics:
    """Of integrations one after the other; methods and kernels of the last one."""
    if len(parts) == 1:
        return parts[0]
    counts = ("steps", "rejected", "evaluations", "iterations", "seconds", "factorisations", "compiling")
    return replace(parts[-1], **{name: sum(getattr(part, name) for part in parts) for name in counts})


@dataclass(frozen=True)
class Kept:
    """From each of the times of a solution to the next one: how many `steps` there are (n - 1,), and whether there is one, `known` (n - 1,)
    everywhere. Others are made again where they are read."""

    steps: np.ndarray
    known: np.ndarray


@dataclass(frozen=True)
class Solution:
    """Step points `t` (n,), states there `x` (nx, n), and `dense`: times (m,) -> states (nx, m).

    `crossings` of guards in order of time; `stopped`: whether the last one ended the motion before its time; `located`: whether
    crossings have been looked for. `kept`: what of a long run; None where it is all.
    """

    t: np.ndarray
    x: np.ndarray
    dense: Callable[[np.ndarray], np.ndarray]
    statistics: Statistics
    status: Status
    crossings: tuple[Crossing, ...] = ()
    stopped: bool = False
    located: bool = False
    kept: Kept | None = None
    modes: ModesMet | None = None
    """Of problems with modes."""
    coarse: Callable[[np.ndarray], np.ndarray] | None = None
    """`dense` for a first look, where that is cheaper."""

    def beside(self, times: np.ndarray, side: int) -> np.ndarray:
        """Just before (-1) or after (1) these times, or so many times as far, but not outside: inputs and switches of time may jump there."""
        ends = self.t[[0, -1]]
        return np.clip(times + side * _ASIDE * np.max(np.abs(ends)), *ends)

    @property
    def known(self) -> np.ndarray:
        """(n - 1,): from which times to the next ones there is a polynomial."""
        return np.ones(self.t.size - 1, dtype=bool) if self.kept is None else self.kept.known

    def __reduce__(self) -> tuple[Any, ...]:
        """For copies and files: the integrator's memory stays behind, polynomials through its dense output take its place."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Solution, tuple((values | {"dense": Interpolant.of(self), "coarse": None}).values())


_ASIDE = 8 * float(np.finfo(float).eps)
"""Of the times of a run: what is nearer is the same instant."""
_NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(33) / 32)
_WEIGHTS = np.where(np.arange(33) % 2, -1.0, 1.0) * np.where((np.arange(33) == 0) | (np.arange(33) == 32), 0.5, 1.0)


@dataclass(frozen=True)
class Interpolant:
    """Dense output as numbers: states `values` (steps, points, nx) at Chebyshev points of the steps between times `t` (steps + 1,).

    Interpolation by the barycentric formula; 33 points are more than the degree of any collocation polynomial asks for. `number`: of each step
    among those with values, -1 where there are none.
    """

    t: np.ndarray
    values: np.ndarray
    number: np.ndarray

    @staticmethod
    def of(solution: Solution) -> Interpolant:
        """Of a solution, as accurate as its dense output."""
        if isinstance(solution.dense, Interpolant):
            return solution.dense
        found = Interpolant.through(solution.dense, solution.t, solution.known)
        if solution.t.size > 1:  # dense output at the end of a step may be that after an impact
            found.values[:, -1] = solution.x.T[1:][solution.known]
        return found

    @staticmethod
    def through(function: Callable[[np.ndarray], np.ndarray], t: np.ndarray, known: np.ndarray) -> Interpolant:
        """Of a function, times (m,) -> values (nx, m), that is smooth between times t; only where it is `known`."""
        if t.size < 2:
            return Interpolant(t, function(t).T[None, :, :], np.zeros(1, dtype=int))
        begin, end = t[:-1, None][known], t[1:, None][known]
        times = np.minimum(begin + (end - begin) * _NODES, end)
        values = function(times.ravel()).T.reshape(times.shape[0], _NODES.size, -1)
        return Interpolant(t, values, np.where(known, np.cumsum(known) - 1, -1))

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """States (nx, m) at times (m,). Raises `OptionError` where they were not kept."""
        if self.t.size < 2:
            return np.repeat(self.values[0, :1].T, times.size, axis=1)
        step = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, self.t.size - 2)
        step = np.where(
            (self.number[step] < 0) & (times == self.t[step]), np.maximum(step - 1, 0), step
        )  # the end of the step before
        lost = np.flatnonzero(self.number[step] < 0)
        if lost.size:
            raise OptionError(
                f"The motion at t = {times[lost[0]]:.6g} s is not in this copy: of a long run, copies have the steps with samples and events only. Ask for "
                "it where the run was made, or for more `samples`."
            )
        length = np.diff(self.t)[step]
        away = np.where(length > 0, (times - self.t[step]) / np.where(length > 0, length, 1.0), 1.0)[:, None] - _NODES
        hit = away == 0
        weights = np.where(hit.any(axis=1)[:, None], hit, _WEIGHTS / np.where(hit, 1.0, away))
        return np.einsum("mk,mki->im", weights / weights.sum(axis=1, keepdims=True), self.values[self.number[step]])
