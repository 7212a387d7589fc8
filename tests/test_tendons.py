"""Ways of ropes as slides: springs, muscles and winches over eyelets and pulleys."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import ParameterError
from components import (
    ElasticStop,
    ForceSource,
    HuntCrossley,
    Particle,
    PositionSource,
    Prismatic,
    Pulley,
    RigidBody,
    Tendon,
    TranslationalGround,
    TranslationalSpring,
    World,
)

G = 9.81


@pytest.mark.parametrize("radius", [None, 0.3])
@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_weight_swings_on_an_elastic_rope_over_a_pulley_by_its_involute(radius: float | None, size: float) -> None:
    """By Lagrange's equations of the length of the rope, differenced; over an eyelet and over a wheel of this radius."""
    m, k, rest = 2.0, 300.0, 2.1
    scene = ac.System()
    scene.world, scene.weight = World(gravity=(0, 0, -G * size)), Particle(m)
    turn = scene.world.frame if radius is None else Pulley(scene.world.frame, radius * size, middle="z", along="x")
    scene.rope, scene.x, scene.z = Tendon(over=(turn,)), Prismatic("x"), Prismatic("z")
    scene.connect(scene.world.at((-1.0 * size, 0, 0)), scene.rope.frame_a)
    scene.connect(scene.world.frame, scene.x.frame_a)
    scene.connect(scene.x.frame_b, scene.z.frame_a)
    scene.connect(scene.z.frame_b, scene.weight.point, scene.rope.frame_b)
    scene.spring, scene.ground = TranslationalSpring(k, rest * size), TranslationalGround()
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.rope.flange)
    begin = np.array([0.9, -0.4 if radius else -0.65])
    start = {scene.x.q: begin[0] * size, scene.z.q: begin[1] * size, scene.x.v: 0.0, scene.z.v: 0.0}
    run = ac.build(scene).simulate(0.4, start, rtol=1e-11)

    R = radius or 0.0

    def length(p: np.ndarray) -> float:
        """Straight piece, arc, straight piece; over the top of the circle."""
        straight = [np.sqrt(q @ q - R * R) for q in (np.array([-1.0, 0.0]), p)]
        angles = [np.arctan2(q[0], q[1]) for q in (np.array([-1.0, 0.0]), p)]  # from the top, towards x
        arc = angles[1] - np.arctan2(straight[1], R) - (angles[0] + np.arctan2(straight[0], R)) if R else 0.0
        return sum(straight) + R * arc

    def rates(_t: float, y: np.ndarray) -> np.ndarray:
        h = 1e-6
        slope = np.array([(length(y[:2] + d) - length(y[:2] - d)) / (2 * h) for d in h * np.eye(2)])
        return np.concatenate([y[2:], -k * (length(y[:2]) - rest) / m * slope - [0, G]])

    y = solve_ivp(rates, (0, 0.4), [*begin, 0, 0], rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose([run[scene.x.q][-1] / size, run[scene.z.q][-1] / size], y[:2], atol=1e-7)
    assert run[scene.rope.flange.s][-1] / size == pytest.approx(length(y[:2]), abs=1e-7)
    assert run.energy_error() < 1e-9


def test_jumper_falls_until_the_rope_is_taut_and_swings_on_it() -> None:
    m, k, rest = 80.0, 120.0, 12.0
    scene = ac.System()
    scene.world, scene.rope, scene.z, scene.jumper = World(), Tendon(), Prismatic("z"), Particle(m)
    scene.connect(scene.world.at((1.0, 0, 0)), scene.rope.frame_a)
    scene.connect(scene.world.at((1.0, 0, 0)), scene.z.frame_a)
    scene.connect(scene.z.frame_b, scene.jumper.point, scene.rope.frame_b)
    scene.elastic = ElasticStop(scene.rope.flange, upper=rest, law=HuntCrossley(k, exponent=1))
    fall, speed = np.sqrt(2 * rest / G), np.sqrt(2 * rest * G)
    rate, sag = np.sqrt(k / m), m * G / k
    lowest = fall + (np.pi - np.arctan(speed / rate / sag)) / rate
    run = ac.build(scene).simulate(lowest, {scene.z.q: -1e-9, scene.z.v: 0.0}, rtol=1e-11)
    assert run[scene.z.v][-1] == pytest.approx(0.0, abs=1e-6)
    assert run[scene.z.q][-1] == pytest.approx(-rest - sag - np.hypot(sag, speed / rate), rel=1e-8)


def test_winch_lifts_with_half_the_force_and_half_the_speed_over_a_loose_pulley() -> None:
    scene = ac.System()
    scene.world, scene.rail, scene.block = World(), Prismatic("z"), RigidBody.box(10.0, (0.2, 0.2, 0.2))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.block.frame)
    scene.rope = Tendon(over=(Pulley(scene.block.at((0, 0, 0.2)), 0.1, middle="-z", along="x"),))
    scene.connect(scene.world.at((-0.1, 0, 5.0)), scene.rope.frame_a)
    scene.connect(scene.world.at((0.1, 0, 5.0)), scene.rope.frame_b)
    scene.winch = PositionSource(lambda t: 9.0 - 0.5 * t)
    scene.connect(scene.winch.flange, scene.rope.flange)
    run = ac.build(scene).simulate(2.0, rtol=1e-10)
    np.testing.assert_allclose(run[scene.rail.v], 0.25, rtol=1e-9)
    np.testing.assert_allclose(run[scene.winch.flange.f], 10.0 * G / 2, rtol=1e-9)
    assert run.label(scene.rope.flange.s) == "rope.flange.s [m]"


def test_wheels_belong_on_cables() -> None:
    world = World()
    with pytest.raises(ParameterError, match="take a Cable"):
        Tendon(over=(Pulley(world.frame, 0.1, wheel=RigidBody.disk(1.0, 0.1, "y")),))
    with pytest.raises(ParameterError, match="Tendon's over"):
        Tendon(over=(ForceSource(1.0),))
