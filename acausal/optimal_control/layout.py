"""Where the unknowns of a transcription stand, and its rows as they are added."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.numerics.folding import folded_function
from acausal.optimal_control.mesh import Mesh
from acausal.optimal_control.separable import Term
from acausal.optimal_control.stage import Stage


class Rows:
    """Constraint rows as they are added."""

    def __init__(self) -> None:
        self.lower: list[float] = []
        self.upper: list[float] = []
        self.labels: list[tuple[str, float]] = []
        self.linear: list[tuple[int, int, float]] = []

    def add(self, lower: float, upper: float, name: str, at: float) -> int:
        """The number of a new one."""
        self.lower.append(lower)
        self.upper.append(upper)
        self.labels.append((name, at))
        return len(self.lower) - 1


@dataclass(frozen=True, eq=False)
class Layout:
    """Where unknowns stand: states at the start, then all of each point, then the duration, free parameters, and nodes where some are loose."""

    stage: Stage
    mesh: Mesh
    held: bool

    @functools.cached_property
    def places(self) -> np.ndarray:
        """(intervals, stages, width)."""
        K, s, width, nu = self.mesh.intervals, self.mesh.tableau.stages, self.stage.width, self.stage.sizes[3]
        nx = self.stage.sizes[0]
        if not self.held or not nu:
            return nx + np.arange(K * s * width).reshape(K, s, width)
        own, size = width - nu, s * (width - nu) + nu
        found = np.empty((K, s, width), dtype=int)
        begin = nx + size * np.arange(K)[:, None, None]
        found[:, :, :own] = begin + own * np.arange(s)[None, :, None] + np.arange(own)
        found[:, :, own:] = begin + own * s + np.arange(nu)
        return found

    @property
    def tail(self) -> int:
        """Of the duration; free parameters follow."""
        return int(self.places.max()) + 1

    @property
    def extra(self) -> np.ndarray:
        """Of the duration and of free parameters."""
        return self.tail + np.arange(1 + len(self.stage.free))

    @property
    def nodes(self) -> np.ndarray:
        """Of all nodes, where some are loose; otherwise none."""
        return self.extra[-1] + 1 + np.arange(self.mesh.nodes.size if self.mesh.loose else 0)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.extra[-1]) + 1 + self.nodes.size

    def node(self, k: int) -> np.ndarray:
        """Places of all unknowns (width + 1 + free,) of the point that ends interval k - 1; -1 for what the start has not."""
        if k == 0:
            nx = self.stage.sizes[0]
            return np.concatenate([np.arange(nx), np.full(self.stage.width - nx, -1), self.extra])
        return np.append(self.places[k - 1, -1], self.extra)


def is_unknown(stage: Stage, value: ca.SX) -> bool:
    return value.is_symbolic() and any(value.element_hash() == stage.unknowns[k].element_hash() for k in range(stage.width))


def column_at(layout: Layout, k: int, value: ca.SX, number: list[int], weights: float = 1.0) -> Term:
    """A column of values at the node k, of the unknowns that stand in it."""
    stage = layout.stage
    used = stage.used([value]) or [stage.width]  # a number is one of the duration, too
    if np.any(layout.node(k)[used] < 0):
        raise OptionError(
            "At the start only positions, velocities and other states are known: forces, accelerations and inputs begin just after it. "
            "Bound them all the time, or ask for them a little later, ocp.at(0.01, {...})."
        )
    function = folded_function("end", [stage.unknowns[used], stage.data], [ca.densify(value)])
    places = layout.node(k)[used][:, None]
    data = np.array([[layout.mesh.nodes[k]], [0.0]])
    return Term(function, places, np.ones(places.shape), data, np.array(number)[:, None], np.full((len(number), 1), weights))
