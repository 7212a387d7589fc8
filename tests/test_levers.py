"""Slides led by one another over cams, of sizes and masses as far apart as one likes: each moves as it does where all are of one size."""

from __future__ import annotations

import numpy as np
import pytest

import acausal as ac
from components import Prismatic, RigidBody, TranslationalGround, TranslationalSpring, World


class Led(ac.Component):
    """b / size_b = x + c sin(x) with x = a / size_a, without losses."""

    a, b = ac.Translational.port(), ac.Translational.port()
    pull = ac.Variable("N*m")

    def __init__(self, a: float, b: float, c: float) -> None:
        self.sizes, self.c = (a, b), c

    def equations(self):
        one, other = self.sizes
        x = self.a.s / one
        yield ac.equal(self.b.s / other, x + self.c * np.sin(x))
        yield ac.equal(self.a.f, self.pull / one * (1 + self.c * np.cos(x)))
        yield ac.equal(self.b.f, -1.0 * self.pull / other)

    def stored_energy(self) -> float:
        return 0.0


def motion(sizes: np.ndarray) -> np.ndarray:
    """(times, slides): places on slides in their own sizes, with kinetic and potential energies that do not depend on these."""
    scene = ac.System()
    scene.world, scene.ground = World((0, 0, 0)), TranslationalGround()
    scene.slides = [Prismatic("x") for _ in sizes]
    scene.blocks = [RigidBody.ball(1 / size**2, 0.1 * size) for size in sizes]
    scene.springs = [TranslationalSpring(1 / size**2) for size in sizes]
    scene.leds = [Led(sizes[k], sizes[k + 1], 0.3 + 0.1 * k) for k in range(len(sizes) - 1)]
    for slide, block, spring in zip(scene.slides, scene.blocks, scene.springs, strict=True):
        scene.connect(scene.world.frame, slide.frame_a)
        scene.connect(slide.frame_b, block.frame)
        scene.connect(slide.flange, spring.flange_a)
        scene.connect(spring.flange_b, scene.ground.flange)
    for k, led in enumerate(scene.leds):
        scene.connect(led.a, scene.slides[k].flange)
        scene.connect(led.b, scene.slides[k + 1].flange)
    run = ac.build(scene).simulate(3.0, {scene.slides[0].q: 0.7 * sizes[0]}, rtol=1e-11, samples=16)
    assert run.energy_error() < 1e-9
    return np.stack([run[slide.q] / size for slide, size in zip(scene.slides, sizes, strict=True)], axis=1)


@pytest.mark.parametrize("n", [3, 5])
def test_levers_of_any_ratio_move_as_those_of_one_size(n):
    """Rows of forces and accelerations in units of their own: none is lost beside another, and none makes the block look singular."""
    alike = motion(np.ones(n))
    decades = [
        np.array([0.0, 2.5, 4.1, -0.2, 3.6]),
        np.array([0.6, -0.2, 4.0, -4.1, 2.0]),
        np.array([-4.6, -3.1, 4.5, -3.4, 3.5]),
    ]
    for apart in decades:
        np.testing.assert_allclose(motion(10 ** apart[:n]), alike, rtol=0, atol=1e-9)


def network(seed: int, sizes: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Four states that follow what four linear equations with changing coefficients give, in units of these sizes."""
    g, n = np.random.default_rng(seed), 4
    C, D, T = g.uniform(-0.4, 0.4, (n, n)) * (g.random((n, n)) < 0.7), g.uniform(0.1, 1, n), g.uniform(0.5, 2, n)

    class Network(ac.Component):
        x, y = ac.Variable(size=n), ac.Variable(size=n)

        def equations(self):
            x = [self.x[i] / sizes[i] for i in range(n)]
            y = [self.y[i] / sizes[n + i] for i in range(n)]
            for i in range(n):
                others = sum((C[i, j] * y[j] for j in range(n) if C[i, j]), 0.0 * y[0])
                yield ac.equal(rows[i] * ((1 + D[i] * x[i] * x[i]) * y[i] + others * np.cos(x[i]) - x[i]), 0.0)
                yield ac.equal(ac.der(self.x)[i], -1.0 * sizes[i] * T[i] * y[i])

    scene = ac.System()
    scene.network = Network()
    run = ac.build(scene).simulate(3.0, {scene.network.x: 0.3 * np.arange(1, n + 1) * sizes[:n]}, rtol=1e-11, samples=13)
    return np.concatenate((run[scene.network.x].T / sizes[:n, None], run[scene.network.y].T / sizes[n:, None]))


@pytest.mark.parametrize("seed", [7, 8, 15, 29, 39, 44, 48, 52, 57])
def test_many_linear_unknowns_of_any_units_are_those_of_one_size(seed: int) -> None:
    """Rows and unknowns over twelve powers of ten."""
    g = np.random.default_rng(seed + 99)
    found = network(seed, 10 ** g.uniform(-6, 6, 8), 10 ** g.uniform(-6, 6, 4))
    np.testing.assert_allclose(found, network(seed, np.ones(8), np.ones(4)), rtol=0, atol=1e-8)
