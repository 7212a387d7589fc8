"""Numbers of scenes, drawn: one of three lengths, a mass and a time of any decade, places and turns."""

from __future__ import annotations

import numpy as np

SEEDS = range(3)
"""One for each size."""


class Drawn:
    """All numbers of one scene, by its seed: L [m], M [kg], T [s] are its units, g [m/s^2] a gravity in them."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([seed, 14])
        self.L = (1.0, 1e-3, 1e3)[seed % 3]
        self.M, self.T = 10 ** self.rng.uniform(-3, 3), 10 ** self.rng.uniform(-2, 2)
        self.g = 9.81 * self.L / self.T**2
        self.speed = self.L / self.T

    def within(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def turn(self) -> np.ndarray:
        """A rotation (3, 3)."""
        Q = np.linalg.qr(self.rng.normal(size=(3, 3)))[0]
        return Q * np.linalg.det(Q)

    def place(self) -> np.ndarray:
        """Of the size of the scene (3,) [m]."""
        return self.L * self.rng.normal(size=3)

    def order(self, count: int) -> list[int]:
        return [int(k) for k in self.rng.permutation(count)]
