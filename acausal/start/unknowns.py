"""What a search is about: unknowns, values asked for, what has to close, and what was found."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from acausal.numerics.sizes import Drawn


@dataclass(frozen=True)
class Target:
    """A variable or expression with a start value, column by column; `place`: of its value among all start values."""

    name: str
    unit: str
    expression: ca.SX
    exact: bool
    periodic: bool
    place: slice

    @property
    def size(self) -> int:
        """Number of values."""
        return self.place.stop - self.place.start


@dataclass(frozen=True)
class Closing:
    """Constraints that hold whatever the start values are: residuals (n, 1), and what each belongs to.

    `owners`: pairs of words and number of rows, in order. `signs` (k, 1): positive on the branch that is meant; `meant`: pairs of a joint, its line and
    why it must be inside of its domain, and number of signs, in order, without words for hinges of loops.
    """

    residual: ca.SX
    owners: tuple[tuple[str, int], ...]
    signs: ca.SX
    meant: tuple[tuple[tuple[str, str] | None, int], ...]
    drawn: Drawn
    """How well the rows are known."""


@dataclass(frozen=True)
class Found:
    """What a search came to: `y` (n,), where it began, the largest residual left, and as part of its row's size, whether it is zero to
    rounding, steps and restarts.
    """

    y: np.ndarray
    first: np.ndarray
    gap: float
    part: float
    converged: bool
    iterations: int = 0
    restarts: int = 0


@dataclass(frozen=True)
class Unknowns:
    """Symbols of a search: `y` (n,), whose first entries are `turning` angles and quaternions or rates of these, and the `data`.

    `q`: places in the data of configurations on which rows that are linear in y depend; `scattered` (nq,): which of them turn.
    """

    y: ca.SX
    data: ca.SX
    turning: np.ndarray
    linear: bool = False
    """Whether y are velocities."""
    q: range = range(0)
    scattered: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def only(self, places: list[int]) -> Unknowns:
        """Some of y."""
        return replace(self, y=self.y[places, :], turning=self.turning[places])
