"""Points of a motion at which a program's unknowns stand: Radau collocation on intervals of any lengths."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from acausal.collocation.tableau import Tableau


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
