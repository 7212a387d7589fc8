"""What an integrator gets and what it gives back."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

Progress = Callable[[float], None]


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


@dataclass(frozen=True)
class Problem:
    """x' = rhs(t, x, u, p), with invariants g(t, x, p) = 0 that hold along exact solutions.

    `rhs`: (t, x[nx], u[nu], p[np]) -> x'[nx]. `invariants`: (t, x, p) -> g. `project`: (t, x, p) -> x, one Newton correction
    towards g = 0. `inputs`: times (n,) -> u (nu, n). `parameters`: (np,). `constant_inputs`: (nu,) where inputs do not change. `compiled`: the same
    functions as C (a `CompiledProblem`); without it they run on CasADi's virtual machine. `guards`: zeros to be located. `met`:
    (nx,) largest magnitudes of states before the start.
    """

    rhs: ca.Function
    invariants: ca.Function | None
    project: ca.Function | None
    inputs: Callable[[np.ndarray], np.ndarray]
    parameters: np.ndarray
    constant_inputs: np.ndarray | None = None
    compiled: Any = None
    guards: Guards | None = None
    met: np.ndarray | None = None


@dataclass(frozen=True)
class Tolerances:
    """Error control: `rtol` and `atol` per step, or a fixed `step` [s]. atol 0: by the sizes of the states alone."""

    rtol: float
    atol: float
    step: float | None = None
    max_steps: int = 1_000_000

    def with_step(self, step: float | None) -> Tolerances:
        """The same with a fixed step, unless `step` is None."""
        return self if step is None else replace(self, step=step)


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
    NOT_CONVERGED = "the implicit equations of a step could not be solved"
    INTERRUPTED = "interrupted by the user"
    MAX_STEPS = "the largest number of steps was reached"
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
    """Counts and cost of an integration. `evaluations` of the rates at one point; `iterations`
    of the stage equations; `factorisations` of Jacobians; `seconds` of wall time."""

    method: str
    order: int
    steps: int
    rejected: int
    evaluations: int
    iterations: int
    seconds: float
    factorisations: int = 0


@dataclass(frozen=True)
class Solution:
    """Step points `t` (n,), states there `x` (nx, n), and `dense`: times (m,) -> states (nx, m).

    `crossings` of guards in order of time; `stopped`: whether the last one ended the motion before its time; `located`: whether
    crossings have been looked for.
    """

    t: np.ndarray
    x: np.ndarray
    dense: Callable[[np.ndarray], np.ndarray]
    statistics: Statistics
    status: Status
    crossings: tuple[Crossing, ...] = ()
    stopped: bool = False
    located: bool = False
