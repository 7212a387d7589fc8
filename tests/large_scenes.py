"""Scenes of many loops that hang together: rows of cranks, nets of rods."""

from __future__ import annotations

import numpy as np

import acausal as ac
from components import Particle, Revolute, RigidBody, Rod, World


class CrankRow(ac.System):
    """`count` + 1 cranks side by side that hang from the ground, the tips of neighbours joined by couplers: so many four-bars in a row."""

    def __init__(self, count: int, length: float = 1.0) -> None:
        self.world = World((0, -9.81 * length, 0))
        self.cranks = [RigidBody.rod(1.0, (0, -length, 0)) for _ in range(count + 1)]
        self.couplers = [RigidBody.rod(0.5, (length, 0, 0)) for _ in range(count)]
        self.feet, self.heads = [Revolute("z") for _ in range(count + 1)], [Revolute("z") for _ in range(2 * count)]
        ends = [(self.feet[k], self.world.at((k * length, 0, 0)), self.cranks[k].frame) for k in range(count + 1)]
        for k, coupler in enumerate(self.couplers):
            ends += [
                (self.heads[2 * k], self.cranks[k].tip, coupler.frame),
                (self.heads[2 * k + 1], coupler.tip, self.cranks[k + 1].tip),
            ]
        for joint, one, other in ends:
            self.connect(one, joint.frame_a)
            self.connect(joint.frame_b, other)


class RodNet(ac.System):
    """`count` x `count` particles of 10 g on a square grid that hangs from the ground, joined by rods of this `length`.

    `rough`: how far the sketch is from closed, as part of the length.
    """

    def __init__(self, count: int, length: float = 0.1, rough: float = 0.03) -> None:
        rng = np.random.default_rng(0)
        grid = [(i, j) for i in range(count) for j in range(count)]
        places = [length * (np.array([j, 0.0, -i - 1.0]) + rough * rng.normal(size=3)) for i, j in grid]
        self.world = World((0, 0, -98.1 * length))
        self.knots = [Particle(0.01, position=tuple(place)) for place in places]
        point = {at: knot.point for at, knot in zip(grid, self.knots, strict=True)}
        held = {j: self.world.at((length * j, 0, 0)) for j in range(count)}
        ends = [(point[i - 1, j] if i else held[j], point[i, j]) for i, j in grid]
        ends += [(point[i, j - 1], point[i, j]) for i, j in grid if j]
        self.rods = [Rod(length) for _ in ends]
        for rod, (one, other) in zip(self.rods, ends, strict=True):
            self.connect(one, rod.frame_a)
            self.connect(rod.frame_b, other)
