"""Shafts in a row, each of two halves that could slide on one another, in bearings and with Cardan joints between them: most of what closes the loops
follows from the rest, other rows here than there, and the halves stand still.
"""

from __future__ import annotations

import numpy as np
import pytest

import acausal as ac
from components import Cylindrical, Prismatic, Revolute, RigidBody, Universal, World


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


class ShaftLine(ac.System):
    """Four shafts on a crooked line; the last half is free along its axis. `size` of the shafts [m], all of them shifted by so many sizes."""

    def __init__(self, seed: int, size: float, shift: np.ndarray) -> None:
        rng = np.random.default_rng(seed)
        ways = [unit(np.array([1.0, 0, 0]) + 0.2 * rng.normal(size=3)) for _ in range(4)]
        ends = size * (shift + np.cumsum([np.zeros(3), *ways], axis=0))
        self.ways, self.forks = ways, []
        self.world = World((0, 0, 0))
        self.halves: list[RigidBody] = []
        self.joints: list[Prismatic | Revolute | Cylindrical | Universal] = []
        centres: list[np.ndarray] = []

        def joined(
            one: int | None, joint: Prismatic | Revolute | Cylindrical | Universal, other: int, point: np.ndarray, R: np.ndarray
        ) -> None:
            a = (
                self.world.at(tuple(point), rotation=R)
                if one is None
                else self.halves[one].at(tuple(point - centres[one]), rotation=R)
            )
            self.joints = [*self.joints, joint]
            self.connect(a, joint.frame_a)
            self.connect(joint.frame_b, self.halves[other].at(tuple(point - centres[other]), rotation=R))

        for k, way in enumerate(ways):
            first = unit(np.cross(way, rng.normal(size=3)))
            R = np.column_stack([first, np.cross(way, first), way])
            inertia = size**2 * (R @ np.diag([1.0, 1.0, rng.uniform(0.5, 1.5)]) @ R.T)
            centres += [0.75 * ends[k] + 0.25 * ends[k + 1], 0.25 * ends[k] + 0.75 * ends[k + 1]]
            self.halves = [*self.halves, *(RigidBody(1.0, inertia, position=tuple(centre)) for centre in centres[-2:])]
            joined(2 * k, Prismatic("z"), 2 * k + 1, (ends[k] + ends[k + 1]) / 2, R)
            if k == 0:
                joined(None, Revolute("z"), 0, ends[0], R)
            else:
                fork = unit(np.cross(ways[k - 1], rng.normal(size=3)))
                led = unit(np.cross(way, fork))
                self.forks = [*self.forks, (fork, led)]
                joined(2 * k - 1, Universal("x", "y"), 2 * k, ends[k], np.column_stack([fork, led, np.cross(fork, led)]))
            joined(None, Cylindrical("z") if k == 3 else Revolute("z"), 2 * k + 1, ends[k + 1], R)


@pytest.mark.parametrize(("seed", "size", "far"), [(0, 1.0, 0.0), (1, 1e-3, 30.0), (2, 1e3, 4.0)])
def test_shafts_turn_as_their_forks_lead_them_wherever_they_lie(seed: int, size: float, far: float) -> None:
    scene = ShaftLine(seed, size, far * np.array([0.3, -0.9, 0.4]))
    model = ac.build(scene)
    assert model.degrees_of_freedom == 2
    run = model.simulate(1.0, {scene.joints[1].v: 5.0}, rtol=1e-10, max_steps=60, samples=21)
    assert run.energy_error() < 1e-12
    turned = [run[half.frame.rotation] for half in scene.halves]
    for k, (fork, led) in enumerate(scene.forks):
        square = np.cross(scene.ways[k + 1], turned[2 * k + 1] @ fork)
        assert np.abs(turned[2 * k + 2] @ led - square / np.linalg.norm(square, axis=1)[:, None]).max() < 1e-12
        assert np.abs(turned[2 * k + 2] - turned[2 * k + 3]).max() < 1e-12
