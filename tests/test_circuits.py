"""Linkages that can be put together in several ways, each a closed curve of configurations: what is singular on one of them may not be on another."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import acausal as ac
from components import Revolute, RigidBody, World
from tests.test_singular_loops import connected

CRANK, FOOT, COUPLER, ROCKER = 0.28, np.array([1.0, 0.0]), 0.98, 0.89
KNEE, FAR = np.array([0.53, -0.48]), np.array([0.64, -1.3])


def meeting(a: np.ndarray, b: np.ndarray, one: float, other: float) -> np.ndarray:
    """The point to the left of the way from a to b that is so far from them."""
    way = b - a
    part = (one**2 - other**2 + way @ way) / (2 * (way @ way))
    return a + part * way + np.sqrt(max(one**2 / (way @ way) - part**2, 0.0)) * np.array([-way[1], way[0]])


def directions(angle: float, shin: float, thigh: float) -> tuple[list[float], float]:
    """Of crank, coupler, rocker, shin and thigh, by the angle of the crank; how far the knee is from the last foot."""
    pin = CRANK * np.array([np.cos(angle), np.sin(angle)])
    top = meeting(pin, FOOT, COUPLER, ROCKER)
    along = (top - pin) / COUPLER
    knee = pin + KNEE[0] * along + KNEE[1] * np.array([-along[1], along[0]])
    end = meeting(knee, FAR, shin, thigh) if shin else knee
    ways = pin, top - pin, top - FOOT, end - knee, end - FAR
    return [float(np.arctan2(way[1], way[0])) for way in ways], float(np.linalg.norm(knee - FAR))


class SixBar(ac.System):
    """A crank and rocker, whose coupler carries two more bars that are as long together as the way is at most, once a turn."""

    def __init__(self) -> None:
        found = minimize_scalar(
            lambda angle: -directions(angle, 0, 0)[1], bounds=(0.0, 1.8), method="bounded", options={"xatol": 1e-10}
        )
        shin = 0.85
        thigh = directions(float(found.x), 0, 0)[1] - shin
        self.begin = directions(3.4, shin, thigh)[0]
        self.world = World((0, -1.0, 0))
        lengths = zip((1.2, 1.0, 1.8, 1.4, 1.1), (CRANK, COUPLER, ROCKER, shin, thigh), strict=True)
        self.bars = [RigidBody.rod(mass, (length, 0, 0)) for mass, length in lengths]
        self.hinges = [Revolute("z") for _ in range(7)]
        crank, coupler, rocker, one, two = self.bars
        ends = [
            (self.world.frame, crank.frame),
            (crank.tip, coupler.frame),
            (coupler.tip, rocker.tip),
            (self.world.at((*FOOT, 0)), rocker.frame),
            (coupler.at((*KNEE, 0)), one.frame),
            (one.tip, two.tip),
            (self.world.at((*FAR, 0)), two.frame),
        ]
        connected(self, [(hinge, *pair) for hinge, pair in zip(self.hinges, ends, strict=True)])

    @property
    def start(self) -> dict[ac.Expression, float | ac.near]:
        """On the circuit that passes the position where both bars are in line."""
        a, b, c, d, e = self.begin
        h = self.hinges
        return {h[0].q: a, h[3].q: ac.near(c), h[6].q: ac.near(e), h[1].q: ac.near(b - a), h[4].q: ac.near(d - b), h[0].v: -12.0}


def test_a_motion_on_another_circuit_than_the_sketch_passes_what_is_singular_there():
    """The sketch closes on a circuit without singular positions; loops are examined once for each circuit."""
    scene = SixBar()
    model = ac.build(scene)
    assert not model.system.constraints.singular
    runs = [model.simulate(0.6, scene.start, rtol=1e-9, samples=3) for _ in range(2)]
    assert all(run.functions.outputs.system.constraints.singular for run in runs)
    assert runs[0].functions is runs[1].functions
    for rtol in (1e-6, 1e-9, 1e-12):
        run = model.simulate(1.6, scene.start, rtol=rtol, samples=3)
        assert run.at(run.solution.t).energy_error() < max(rtol, 1e-10)
        assert run.statistics.steps < 200
    again = model.simulate(0.1, {scene.hinges[0].v: 1.0}, samples=2)
    assert again.functions is model.functions


@pytest.mark.parametrize("angle", [-2.5, -1.0, 0.5, 2.0])
def test_starts_on_the_circuit_of_the_sketch_are_known(angle: float):
    scene = SixBar()
    model = ac.build(scene)
    assert model.simulate(0.05, {scene.hinges[0].q: angle}, samples=2).functions is model.functions
