"""Belts around pulleys: what they transmit, how they swing, where they slip; by closed forms, at any size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal as ac
from acausal.errors import ParameterError, StartValueError
from components import Belt, Coulomb, Prismatic, Pulley, RigidBody, Spring, TorqueSource, World
from tests.pairings import each_value

SIZES = [1e-3, 1.0, 1e3]
R, J, D = (0.1, 0.2), (0.02, 0.05), 0.7


def drive(size: float = 1.0, torque: Any = 3.0, crossed: bool = False, apart: float = D, **belt: Any) -> Any:
    """Two wheels on one belt, the first one driven; lengths by size, time as it is."""
    scene: Any = ac.System()
    scene.world = World(None)
    scene.wheels = [RigidBody(1.0, tuple(np.full(3, inertia * size**2))) for inertia in J]
    places = ((0, 0, 0), (apart * size, 0, 0))
    sides = (("-x", "z"), ("x", "z" if crossed else "-z"))
    scene.belt = Belt([Pulley(scene.world.at(p), r * size, *side, wheel) for p, r, side, wheel in zip(places, R, sides, scene.wheels, strict=True)], **belt)  # fmt: skip
    scene.motor = TorqueSource(torque * size**2)
    scene.connect(scene.motor.flange, scene.belt.hinges[0].flange)
    return scene


@each_value(("size", SIZES), ("crossed", [False, True]))
def test_a_belt_carries_a_torque_over_and_its_pulls_show_it(size: float, crossed: bool) -> None:
    """(J1 / r1^2 + J2 / r2^2) a = M / r1; the pulls differ by J2 a / r2^2 about the preload."""
    scene = drive(size, crossed=crossed, preload=200.0 * size)
    model = ac.build(scene)
    assert len(model.state_names) == 2
    run = model.simulate(1.0, rtol=1e-11)
    a = 3.0 / R[0] / (J[0] / R[0] ** 2 + J[1] / R[1] ** 2)
    first, second = (run[hinge.v] for hinge in scene.belt.hinges)
    assert np.max(np.abs(first - a / R[0] * run.t)) < 1e-11 * a / R[0]
    turned = run[scene.wheels[1].frame.angular_velocity][:, 1]
    assert np.max(np.abs(second - a / R[1] * run.t)) < 1e-11 * a / R[1]
    assert np.max(np.abs(turned - (-1 if crossed else 1) * a / R[1] * run.t)) < 1e-11 * a / R[1]
    pull = J[1] * a / R[1] ** 2 / 2
    assert np.max(np.abs(run[scene.belt.tension] / size - (200 + pull, 200 - pull))) < 1e-10
    sine = (R[0] + R[1] if crossed else R[1] - R[0]) / D
    wraps = np.pi + 2 * np.arcsin(sine) * np.array([1, 1] if crossed else [-1, 1])
    assert np.max(np.abs(np.array([run[wrap][0] for wrap in scene.belt.wraps]) - wraps)) < 1e-13
    assert np.max(np.abs(run[scene.belt.length] / size - 2 * D * np.sqrt(1 - sine**2) - wraps @ R)) < 1e-13
    assert run.energy_error() < 1e-12


@each_value(("size", SIZES), ("idle", [False, True]))
def test_wheels_on_an_elastic_belt_swing_against_each_other(size: float, idle: bool) -> None:
    """w^2 = 2 k (r1^2 / J1 + r2^2 / J2), k of each of two sections; a pulley that only leads one of them changes nothing."""
    scene: Any = ac.System()
    scene.world = World(None)
    scene.wheels = [RigidBody(1.0, tuple(np.full(3, inertia * size**2))) for inertia in J]
    one, two = (Pulley(scene.world.at((x * size, 0, 0)), r * size, side, along, wheel) for x, r, side, along, wheel in zip((0, D), R, ("-x", "x"), ("z", "-z"), scene.wheels, strict=True))  # fmt: skip
    idler = [Pulley(scene.world.at((0.3 * size, 0, -0.5 * size)), 0.05 * size, "-z", "-x")] if idle else []
    scene.belt = Belt([*idler, one, two], preload=100.0, stiffness=400.0)
    start: Any = {scene.belt.hinges[0].v: 1.0, scene.belt.hinges[1].v: 0.0}
    run = ac.build(scene).simulate(0.5, start, rtol=1e-12)
    w = np.sqrt(2 * 400.0 * (R[0] ** 2 / J[0] + R[1] ** 2 / J[1]))
    common = J[0] / R[0] ** 2 / (J[0] / R[0] ** 2 + J[1] / R[1] ** 2)
    exact = common + (1 - common) * np.cos(w * run.t)
    assert np.max(np.abs(run[scene.belt.hinges[0].v] - exact)) < 1e-9
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize("size", SIZES)
def test_a_belt_slips_where_one_side_pulls_as_many_times_as_much_as_eytelwein_says(size: float) -> None:
    """Driven too hard it slips on the smaller wheel, until the speeds of the rims meet again."""
    mu, static, preload = 0.3, 0.4, 50.0
    scene = drive(size, 16.0 * ac.time * (2.0 - ac.time), preload=preload * size, friction=Coulomb(mu, static))
    run = ac.build(scene).simulate(4.0, rtol=1e-11)
    wrap = run[scene.belt.wraps[0]][0]
    most, slips = (2 * preload * np.tanh(m * wrap / 2) for m in (static, mu))
    share = J[1] / R[1] ** 2 / (J[0] / R[0] ** 2 + J[1] / R[1] ** 2) / R[0]
    begin, *_ = (t.time for t in run.transitions)
    assert abs(16 * begin * (2 - begin) * share - most) < 1e-9 * most
    T, slip = run[scene.belt.tension] / size, run[scene.belt.slip] / size
    sliding = slip > 1e-6
    assert sliding.any() and not sliding[-1]
    assert np.max(np.abs(T[sliding, 0] / T[sliding, 1] - np.exp(mu * wrap))) < 1e-10
    assert np.max(np.abs(T[sliding] - (preload + slips / 2, preload - slips / 2))) < 1e-10
    assert np.max(np.abs(slip[run.t < begin])) < 1e-12
    assert run.energy_error() < 1e-10


def test_a_pulley_that_tightens_a_belt_moves_with_it() -> None:
    """On a slide with a spring, without loss: energies are kept."""
    scene: Any = ac.System()
    scene.world, scene.rail, scene.block = World(None), Prismatic("z"), RigidBody.ball(0.5, 0.02)
    scene.wheels = [RigidBody(1.0, tuple(np.full(3, inertia))) for inertia in J]
    one, two = (Pulley(scene.world.at((x, 0, 0)), r, side, along, wheel) for x, r, side, along, wheel in zip((0, D), R, ("-x", "x"), ("z", "-z"), scene.wheels, strict=True))  # fmt: skip
    scene.connect(scene.world.at((0.3, 0, -0.5)), scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.block.frame)
    scene.belt = Belt([one, two, Pulley(scene.block.frame, 0.05, "-z", "-x")], preload=80.0, stiffness=500.0)
    scene.spring = Spring(300.0, 0.1)
    scene.connect(scene.spring.point_a, scene.world.at((0.3, 0, -1.0)))
    scene.connect(scene.spring.point_b, scene.block.frame)
    run = ac.build(scene).simulate(1.0, {scene.belt.hinges[0].v: 2.0, scene.rail.q: -0.02}, rtol=1e-11)
    assert run.energy_error() < 1e-10
    assert np.ptp(run[scene.rail.q]) > 0.01


def belt(*given: Any, **named: Any) -> Belt:
    return Belt(*given, **named)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda f, w: belt([Pulley(f, 0.1, wheel=w)], 1.0), ("two or more",)),
        (lambda f, w: belt([Pulley(f, 0.1), Pulley(f, 0.1)], 1.0), ("No pulley", "wheel=body")),
        (lambda f, w: belt([Pulley(f, 0.1, wheel=w), 0.1], 1.0), ("pulley is 0.1",)),
        (lambda f, w: belt([Pulley(f, 0.1, wheel=w), Pulley(f, 0.1)], -1.0), ("preload is -1",)),
        (lambda f, w: belt([Pulley(f, 0.1, wheel=w), Pulley(f, 0.1)], 1.0, stiffness=0.0), ("stiffness is 0",)),
        (lambda f, w: belt([Pulley(f, 0.1, wheel=w), Pulley(f, 0.1)], 1.0, friction=0.3), ("Coulomb(0.3)",)),
        (lambda f, w: belt([Pulley(f, 0.1, wheel=w), Pulley(f, 0.1)], 1.0, friction=Coulomb(0.3)), ("two pulleys that both have wheels",)),
    ],
)  # fmt: skip
def test_what_is_no_belt_is_refused_in_words(make: Any, words: tuple[str, ...]) -> None:
    with pytest.raises(ParameterError) as caught:
        make(World().frame, RigidBody.disk(1.0, 0.1))
    assert all(word in str(caught.value) for word in words), caught.value
    assert "test_belts.py" in str(caught.value)


@pytest.mark.parametrize(("crossed", "apart"), [(True, 0.29), (False, 0.09)])
def test_pulleys_that_overlap_are_told_by_part_and_line(crossed: bool, apart: float) -> None:
    scene = drive(crossed=crossed, apart=apart, preload=100.0)
    with pytest.raises(
        StartValueError, match=r"'belt.pieces\[0\]' \(.*test_belts.py:\d+\).*no meaning at the start.*Move them apart"
    ):
        ac.build(scene).simulate(1.0)
