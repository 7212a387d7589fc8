"""Whether two closed configurations with freedom left are one branch: whether one can move to the other without being taken apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from acausal.numerics.assembly import Residual, assemble, freedom
from acausal.numerics.sizes import Sizes
from acausal.start.coordinates import Coordinates

_STEP = 0.15
"""Of a walk, in rad and sizes of the mechanism."""
_CURVE, _WALK = 400, 80
"""Most steps along a curve each way, and towards a goal."""


@dataclass(frozen=True)
class Walks:
    """Walks over the configurations that meet `constraints`."""

    constraints: Residual
    coordinates: Coordinates
    sizes: Sizes

    def reachable(self, y: np.ndarray) -> list[np.ndarray]:
        """Where one freedom leads, both ways, in steps; with more freedoms only `y` itself."""
        points = [y]
        if self._free(y).shape[1] != 1:
            return points
        for sense in (1.0, -1.0):
            for k, point in enumerate(self._along(y, sense)):
                points.append(point)
                if k > 2 and self._apart(point, y) < _STEP:
                    return points
        return points

    def leads(self, points: list[np.ndarray], goal: np.ndarray) -> bool:
        """Whether a walk from the nearest of `points` straight at the goal gets there; a detour is not looked for."""
        y = min(points, key=lambda point: self._apart(point, goal))
        left = self._apart(y, goal)
        for _ in range(_WALK):
            if left < 0.02:
                return True
            wanted = self.coordinates.canonical(goal, y) - y
            Z = self._free(y)
            step = self._moved(y, self._back(Z, wanted), min(_STEP, left))
            if step is None or self._apart(step, goal) >= left * (1 - 1e-3):
                return False
            y, left = step, self._apart(step, goal)
        return False

    def _free(self, y: np.ndarray) -> np.ndarray:
        """Directions (n, freedoms) in which the constraints hold, orthonormal in unknowns without unit."""
        return self.sizes.unknowns[:, None] * freedom(self.sizes.scaled(self.constraints(y)[1]), self.sizes.dependent)

    def _back(self, Z: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The part of a direction that is in the columns of Z."""
        return Z @ (Z.T @ (direction / self.sizes.unknowns**2))

    def _apart(self, a: np.ndarray, b: np.ndarray) -> float:
        return float(np.max(self.coordinates.differences(a, b), initial=0.0))

    def _along(self, y: np.ndarray, sense: float) -> Iterator[np.ndarray]:
        ahead = sense * self._free(y)[:, 0]
        for _ in range(_CURVE):
            Z = self._free(y)
            ahead = self._back(Z, ahead)
            step = self._moved(y, ahead, _STEP)
            if step is None:
                return
            y = step
            yield y

    def _moved(self, y: np.ndarray, direction: np.ndarray, length: float) -> np.ndarray | None:
        """One step of a length in a direction, and closed again; None where there is no way on."""
        size = float(np.max(np.abs(direction) / self.coordinates.scale, initial=0.0))
        if size < 1e-9:
            return None
        found = assemble(self.constraints, y + direction * (length / size), sizes=self.sizes, limit=20, stride=length)
        return found.y if found.converged and self._apart(found.y, y) < 4 * length else None
