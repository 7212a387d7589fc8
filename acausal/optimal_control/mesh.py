"""Points of a motion at which a program's unknowns stand: Radau collocation on intervals of any lengths."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arguments import whole_number
from acausal.collocation.tableau import Tableau, radau_iia
from acausal.errors import OptionError

_PLUGINS = ("ipopt",)
"""Solvers that take the derivatives of a program as they are."""
_APART = 1e-9
"""Places that are nearer to each other are one."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """`nodes` (intervals + 1,): from 0 to 1, parts of the duration; each interval holds the points of a `tableau` whose last one is its end."""

    nodes: np.ndarray
    tableau: Tableau

    @property
    def intervals(self) -> int:
        """Their number."""
        return self.nodes.size - 1

    @property
    def lengths(self) -> np.ndarray:
        """(intervals,), parts of the duration."""
        return np.diff(self.nodes)

    @property
    def points(self) -> np.ndarray:
        """(intervals, stages): parts of the duration."""
        return self.nodes[:-1, None] + self.lengths[:, None] * self.tableau.c

    @functools.cached_property
    def slopes(self) -> np.ndarray:
        """(stages, 1 + stages): slopes at the points, by values at the beginning and at the points, of polynomials on [0, 1]."""
        return _slopes(np.append(0.0, self.tableau.c))[1:]

    def refined(self, wanting: np.ndarray) -> Mesh:
        """With `wanting` (intervals,) pieces in place of each interval."""
        pieces = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(self.nodes[:-1], self.nodes[1:], wanting, strict=True)]
        return Mesh(np.append(np.concatenate(pieces), 1.0), self.tableau)


def _slopes(points: np.ndarray) -> np.ndarray:
    """(n, n): derivatives at points (n,) of the polynomials that are 1 at one of them and 0 at the others."""
    n = points.size
    difference = points[:, None] - points + np.eye(n)
    weights = 1 / np.prod(difference, axis=1)
    found = weights[None, :] / weights[:, None] / difference
    np.fill_diagonal(found, 0.0)
    np.fill_diagonal(found, -found.sum(axis=1))
    return found


def through(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients (n, ...), highest power first, of the polynomial through values (n, ...) at points (n,)."""
    return np.linalg.solve(np.vander(points), values)


@dataclass(frozen=True)
class Mesher:
    """What is asked of a transcription: the number of `intervals`, the `order` of collocation, "free" or "constant" `controls`, the `solver`. Raises
    `OptionError` where that makes no sense.
    """

    intervals: int
    order: int
    controls: str
    solver: str

    def __post_init__(self) -> None:
        if self.solver not in _PLUGINS:
            raise OptionError(f"solve: there is no solver {self.solver!r}. Use {', '.join(map(repr, _PLUGINS))}.")
        if self.controls not in ("free", "constant"):
            raise OptionError(f"solve: there are no controls {self.controls!r}. Use 'free' or 'constant'.")
        whole_number(self.order, "solve: the order", 1, 31)
        if self.order % 2 == 0:
            raise OptionError(f"solve: Radau collocation has odd order, not {self.order}.")
        whole_number(self.intervals, "solve: intervals", 1)

    def mesh(self, places: Sequence[float]) -> Mesh:
        """With nodes at these parts of the duration."""
        inside = sorted({one for one in places if _APART < one < 1 - _APART})
        marks = [0.0, *(one for one, before in zip(inside, [0.0, *inside], strict=False) if one - before > _APART), 1.0]
        pieces = np.maximum(1, np.round(self.intervals * np.diff(marks))).astype(int)
        return Mesh(np.array(marks), radau_iia((self.order + 1) // 2)).refined(pieces)
