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
