"""Points of a motion at which a program's unknowns stand: Radau collocation on intervals of any lengths."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import comb

from acausal.arguments import whole_number
from acausal.collocation.tableau import Tableau, radau_iia
from acausal.errors import OptionError
from acausal.optimal_control.asked import CONSTANT, FREE, LINEAR
from acausal.optimal_control.separable import FATROP, IPOPT

_PLUGINS = (IPOPT, FATROP, "piqp")
"""Ipopt, what eliminates one interval after the other, and what solves quadratic programs step by step."""
_APART = 1e-9
"""Places that are nearer to each other are one."""
_ROOM = 0.45
"""Of the interval beside it: how far a loose node goes."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """`nodes` (intervals + 1,): from 0 to 1, parts of the duration; each interval holds the points of a `tableau` whose last one is its end. Nodes at
    `marks` stay where they are; those that are `loose` (numbers) are found with the motion. `inside`: whether bounds hold between the points, too.
    """

    nodes: np.ndarray
    tableau: Tableau
    marks: tuple[float, ...] = (0.0, 1.0)
    loose: tuple[int, ...] = ()
    inside: bool = False

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

    @property
    def bounds(self) -> np.ndarray:
        """(2, intervals + 1): between which the nodes stay, so that none comes near to another."""
        move = np.zeros((2, self.nodes.size))
        for k in self.loose:
            move[:, k] = -_ROOM * self.lengths[k - 1], _ROOM * self.lengths[k]
        return self.nodes + move

    @property
    def movable(self) -> np.ndarray:
        """(intervals + 1,): which nodes are at none of the `marks`."""
        return np.min(np.abs(self.nodes[:, None] - np.array(self.marks)), axis=1) > _APART

    def between(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For parts of the duration (m,): the interval of each (m,), where a node belongs to the one that it ends; and by which values at the beginning and at the
        points of this (m, 1 + stages), and at the points alone (m, stages), count in the polynomials through them.
        """
        k = np.clip(np.searchsorted(self.nodes, times, side="left") - 1, 0, self.intervals - 1)
        part, c = (times - self.nodes[k]) / self.lengths[k], self.tableau.c
        return k, _values(np.append(0.0, c), part), _values(c, part)

    def refined(self, wanting: np.ndarray) -> Mesh:
        """With `wanting` (intervals,) pieces in place of each interval."""
        pieces = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(self.nodes[:-1], self.nodes[1:], wanting, strict=True)]
        return Mesh(np.append(np.concatenate(pieces), 1.0), self.tableau, self.marks, inside=self.inside)


def _slopes(points: np.ndarray) -> np.ndarray:
    """(n, n): derivatives at points (n,) of the polynomials that are 1 at one of them and 0 at the others."""
    n = points.size
    difference = points[:, None] - points + np.eye(n)
    weights = 1 / np.prod(difference, axis=1)
    found = weights[None, :] / weights[:, None] / difference
    np.fill_diagonal(found, 0.0)
    np.fill_diagonal(found, -found.sum(axis=1))
    return found


def _values(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(m, n): values at places (m,) of the polynomials that are 1 at one of the points (n,) and 0 at the others."""
    off = np.eye(points.size, dtype=bool)
    parts = (at[:, None, None] - points) / np.where(off, 1.0, points[:, None] - points)
    return np.prod(np.where(off, 1.0, parts), axis=2)


def hull(points: np.ndarray) -> np.ndarray:
    """(n, n): from values at points (n,) of [0, 1] to the coefficients of Bernstein of the polynomial through them, which lies between the least and
    the largest of these. Farin: Curves and Surfaces for CAGD (2002), section 5.
    """
    n = points.size - 1
    k = np.arange(n + 1)
    return np.linalg.inv(comb(n, k) * points[:, None] ** k * (1 - points[:, None]) ** (n - k))


def through(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients (n, ...), highest power first, of the polynomial through values (n, ...) at points (n,)."""
    return np.linalg.solve(np.vander(points), values)


@dataclass(frozen=True)
class Mesher:
    """What is asked of a transcription: the number of `intervals`, the `order` of collocation, "free", "constant" or "linear" `controls`, the `solver`. Raises
    `OptionError` where that makes no sense.
    """

    intervals: int
    order: int
    controls: str
    solver: str

    def __post_init__(self) -> None:
        if self.solver not in _PLUGINS:
            raise OptionError(f"solve: there is no solver {self.solver!r}. Use {', '.join(map(repr, _PLUGINS))}.")
        if self.controls not in (FREE, CONSTANT, LINEAR):
            raise OptionError(f"solve: there are no controls {self.controls!r}. Use 'free', 'constant' or 'linear'.")
        whole_number(self.order, "solve: the order", 1, 31)
        if self.order % 2 == 0:
            raise OptionError(f"solve: Radau collocation has odd order, not {self.order}.")
        if self.controls == LINEAR and self.order == 1:
            raise OptionError(
                "solve: collocation of order 1 has one point in each interval, and a line needs two. Leave the order out."
            )
        whole_number(self.intervals, "solve: intervals", 1)

    def mesh(self, places: Sequence[float]) -> Mesh:
        """With nodes at these parts of the duration."""
        inside = sorted({one for one in places if _APART < one < 1 - _APART})
        marks = [0.0, *(one for one, before in zip(inside, [0.0, *inside], strict=False) if one - before > _APART), 1.0]
        pieces = np.maximum(1, np.round(self.intervals * np.diff(marks))).astype(int)
        return Mesh(np.array(marks), radau_iia((self.order + 1) // 2), tuple(marks)).refined(pieces)
