"""Stops, play, clutches, brakes and freewheels on flanges, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import acausal as ac
from components import (
    Backlash,
    Brake,
    Clutch,
    EndStop,
    Freewheel,
    Inertia,
    Revolute,
    RigidBody,
    SlidingMass,
    TorqueSource,
    TranslationalGround,
    TranslationalSpring,
    VelocitySource,
    World,
)

SIZES = [1.0, 1e-9, 1e6]
"""Of lengths, times and masses stay."""


def changes(run: Any) -> list[float]:
    """Times of changes of mode after the start."""
    return [change.time for change in run.solution.modes.changes if change.row >= 0]


def jumps(run: Any) -> list[float]:
    """Times of impacts."""
    return [change.time for change in run.solution.modes.changes if change.jumped]


def quiet(model: Any, *given: Any, **more: Any) -> Any:
    """A run whose impacts lose energy, of which the balance does not know yet."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return model.simulate(*given, **more)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.3])
def test_ball_between_two_stops_strikes_when_it_must(restitution: float, size: float) -> None:
    """Speeds fall by the restitution at each strike, and so times grow: v_k = v e^k, T_k = L / v_k."""
    length, speed = 0.5 * size, 2.0 * size
    scene = ac.System()
    scene.ball = SlidingMass(0.3)
    scene.stop = EndStop(scene.ball.flange_b, lower=-0.2 * size, upper=0.3 * size, restitution=restitution)
    strikes, t = [], 0.3 * size / speed
    while t < 3.0:
        strikes.append(t)
        t += length / (speed * restitution ** len(strikes))
    run = quiet(ac.build(scene), 3.0, {scene.ball.s: 0.0, scene.ball.v: speed}, rtol=1e-12)
    assert jumps(run) == pytest.approx(strikes, rel=1e-11)
    sign = (-1) ** len(strikes)
    assert run[scene.ball.v][-1] == pytest.approx(sign * speed * restitution ** len(strikes), rel=1e-11)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("turned", [False, True])
def test_oscillator_with_friction_loses_the_same_amplitude_each_half_period_and_stops(size: float, turned: bool) -> None:
    """Amplitudes fall by 2 F / k each half period pi / omega, until the spring is held (classical, Coulomb)."""
    mass, stiffness, friction, first = 0.7, 30.0, 1.9 * size, 1.0 * size
    scene = ac.System()
    parts = {"mass": SlidingMass(mass), "spring": TranslationalSpring(stiffness), "wall": TranslationalGround()}
    for name in reversed(parts) if turned else parts:
        setattr(scene, name, parts[name])
    scene.rub = Brake(scene.mass.flange_a, friction)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.mass.flange_b)
    run = ac.build(scene).simulate(6.0, {scene.mass.s: first, scene.mass.v: 0.0}, rtol=1e-12)
    half, loss = math.pi * math.sqrt(mass / stiffness), 2 * friction / stiffness
    amplitudes = [first]
    while amplitudes[-1] * stiffness > friction:
        amplitudes.append(amplitudes[-1] - loss)
    assert changes(run) == pytest.approx([half * k for k in range(1, len(amplitudes))], rel=1e-11)
    last = amplitudes[-1] * (-1) ** (len(amplitudes) - 1)
    assert run[scene.mass.s][-1] == pytest.approx(last, abs=1e-10 * size)
    assert run[scene.rub.grip][-1] == pytest.approx(stiffness * last, abs=1e-9 * size)
    assert run.energy_error() < 1e-10


def test_mass_on_a_belt_sticks_and_slips_with_its_period() -> None:
    mass, stiffness, sliding, holding, belt = 1.0, 4.0, 2.0, 3.0, 0.5
    scene = ac.System()
    scene.mass, scene.spring, scene.wall = SlidingMass(mass), TranslationalSpring(stiffness), TranslationalGround()
    scene.belt = VelocitySource(belt)
    scene.rub = Clutch(scene.belt.flange, scene.mass.flange_a, capacity=sliding, holding=holding)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.mass.flange_b)
    run = ac.build(scene).simulate(40.0, {scene.mass.s: 0.0, scene.mass.v: belt, scene.belt.flange.s: 0.0}, rtol=1e-12)
    omega, ahead = math.sqrt(stiffness / mass), (holding - sliding) / stiffness
    slip = 2 * (math.pi - math.atan(omega * ahead / belt)) / omega
    period = slip + 2 * ahead / belt
    slipping = changes(run)[0::2]
    assert slipping[0] == pytest.approx(holding / stiffness / belt, rel=1e-11)
    assert np.diff(slipping) == pytest.approx(period, rel=1e-11)
    assert len(slipping) == 1 + int((40.0 - slipping[0]) / period)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("swapped", [False, True])
def test_clutch_engages_after_its_time_and_loses_what_it_must(size: float, swapped: bool) -> None:
    """t = dw J / capacity and E = J dw^2 / 2 with J = J_a J_b / (J_a + J_b)."""
    first, second, speed, capacity = 0.2 * size, 0.5 * size, 100.0, 7.0 * size
    scene = ac.System()
    if swapped:
        scene.second = Inertia(second)
    scene.first = Inertia(first)
    if not swapped:
        scene.second = Inertia(second)
    ends = scene.first.flange_b, scene.second.flange_a
    scene.clutch = Clutch(*(reversed(ends) if swapped else ends), capacity=capacity)
    run = ac.build(scene).simulate(
        3.0, {scene.first.w: speed, scene.second.w: 0.0, scene.first.phi: 0.0, scene.second.phi: 0.0}, rtol=1e-12
    )
    both = first * second / (first + second)
    assert changes(run) == pytest.approx([speed * both / capacity], rel=1e-11)
    for part in (scene.first, scene.second):
        assert run[part.w][-1] == pytest.approx(first * speed / (first + second), rel=1e-12)
    kinetic = 0.5 * first * run[scene.first.w] ** 2 + 0.5 * second * run[scene.second.w] ** 2
    assert kinetic[0] - kinetic[-1] == pytest.approx(0.5 * both * speed**2, rel=1e-11)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("parameter", [False, True])
def test_inertias_with_backlash_strike_each_other_forever_without_loss(parameter: bool) -> None:
    """Equal inertias exchange their speeds, so that play is crossed in width / speed each time."""
    scene = ac.System()
    scene.width = ac.Parameter(1.0, "rad") if parameter else 0.06
    scene.bounce = ac.Parameter(0.2, "1") if parameter else 1.0
    scene.first, scene.second = Inertia(0.4), Inertia(0.4)
    scene.play = Backlash(scene.first.flange_b, scene.second.flange_a, scene.width, restitution=scene.bounce)
    start = {scene.first.w: 3.0, scene.second.w: 0.0, scene.first.phi: 0.0, scene.second.phi: 0.0}
    values = {scene.width: 0.06, scene.bounce: 1.0} if parameter else {}
    run = ac.build(scene).simulate(1.0, start, parameters=values, rtol=1e-12)
    assert jumps(run) == pytest.approx(0.01 + 0.02 * np.arange(50), rel=1e-11)
    play = run[scene.second.phi] - run[scene.first.phi]
    assert np.max(np.abs(play)) <= 0.03 * (1 + 1e-12)
    assert run[scene.first.w][-1] + run[scene.second.w][-1] == pytest.approx(3.0, rel=1e-12)


def test_torque_through_play_reaches_the_load_after_it_is_crossed() -> None:
    """Without bouncing both go on together, with the momentum of the first."""
    scene = ac.System()
    scene.first, scene.second, scene.motor = Inertia(0.4), Inertia(1.2), TorqueSource(2.0)
    scene.play = Backlash(scene.first.flange_b, scene.second.flange_a, 0.08)
    scene.connect(scene.motor.flange, scene.first.flange_a)
    start = {scene.first.w: 0.0, scene.second.w: 0.0, scene.first.phi: -0.02, scene.second.phi: 0.0}
    run = quiet(ac.build(scene), 1.0, start, rtol=1e-12)
    met = math.sqrt(2 * (0.04 + 0.02) / (2.0 / 0.4))
    assert jumps(run) == pytest.approx([met], rel=1e-11)
    assert run[scene.second.w][-1] == pytest.approx(2.0 * 1.0 / 1.6, rel=1e-12)
    assert run[scene.play.at_lower][-1] == pytest.approx(2.0 * 1.2 / 1.6, rel=1e-11)


@pytest.mark.parametrize("swapped", [False, True])
def test_freewheel_drives_and_is_overrun(swapped: bool) -> None:
    """cos drives both while its torque is positive; then the load runs on at its speed until the drive is as fast again."""
    first, second, torque = 1.0, 2.0, 3.0
    scene = ac.System()
    for name, inertia in (("second", second), ("first", first)) if swapped else (("first", first), ("second", second)):
        setattr(scene, name, Inertia(inertia))
    scene.motor = TorqueSource(lambda t: torque * np.cos(t) + 0.3)
    scene.hub = Freewheel(scene.first.flange_b, scene.second.flange_a)
    scene.connect(scene.motor.flange, scene.first.flange_a)
    start = {scene.first.w: 0.0, scene.second.w: 0.0, scene.first.phi: 0.0, scene.second.phi: 0.0}
    run = ac.build(scene).simulate(7.8, start, rtol=1e-12)
    released = math.acos(-0.1)
    speed = (torque * math.sin(released) + 0.3 * released) / (first + second)

    def behind(t: float) -> float:
        return torque * (math.sin(t) - math.sin(released)) + 0.3 * (t - released)

    low, high = 5.0, 2 * math.pi + 1.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if behind(middle) < 0 else (low, middle)
    assert changes(run) == pytest.approx([released, low], rel=1e-11)
    end = speed + (torque * (math.sin(7.8) - math.sin(low)) + 0.3 * (7.8 - low)) / (first + second)
    assert run[scene.first.w][-1] == pytest.approx(end, rel=1e-11)
    assert run[scene.second.w][-1] == pytest.approx(end, rel=1e-11)
    assert not jumps(run)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("angle", [0.05, 0.2])
def test_screw_holds_where_friction_does(angle: float) -> None:
    """A load on a thread drives with weight * lead / 2 pi; a brake of a constant torque holds it, or is overcome."""
    weight, lead, held = 2.0 * 9.81, 0.01, 0.02
    scene = ac.System()
    scene.spindle, scene.load = Inertia(1e-3), TorqueSource(-weight * lead * angle / 0.1 / (2 * math.pi))
    scene.friction = Brake(scene.spindle.flange_b, held)
    scene.connect(scene.load.flange, scene.spindle.flange_a)
    run = ac.build(scene).simulate(2.0, {scene.spindle.phi: 0.0, scene.spindle.w: 0.0}, rtol=1e-12)
    drive = weight * lead * angle / 0.1 / (2 * math.pi)
    assert run[scene.spindle.w][-1] == pytest.approx(-max(drive - held, 0.0) / 1e-3 * 2.0, abs=1e-12)


@pytest.mark.parametrize("size", SIZES)
def test_brake_by_an_input_that_jumps_holds_what_it_can(size: float) -> None:
    """Free to 1 s, then stopped by 3 - 1, held until the brake opens at 4 s."""
    scene = ac.System()
    scene.rotor, scene.motor, scene.pedal = Inertia(0.5 * size), TorqueSource(1.0 * size), ac.Input("N*m")
    scene.brake = Brake(scene.rotor.flange_b, scene.pedal)
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    run = ac.build(scene).simulate(
        6.0, {scene.rotor.phi: 0.0, scene.rotor.w: 0.0}, inputs={scene.pedal: ac.samples([0, 1, 4], [0, 3 * size, 0], kind="constant")}, rtol=1e-12
    )  # fmt: skip
    assert changes(run) == pytest.approx([1.5], rel=1e-11)
    assert run[scene.rotor.w][-1] == pytest.approx(4.0, rel=1e-12)
    assert run[scene.rotor.phi][-1] == pytest.approx(1.0 + 0.5 + 4.0, rel=1e-12)


@pytest.mark.parametrize(
    "capacity", [lambda t: 3 * (t - 1), lambda t: 3 * np.maximum(t - 1, 0), lambda t: 3 * np.where(t < 1, 0, t - 1)]
)
def test_brake_that_closes_slowly_holds_at_last(capacity: Callable[[Any], Any]) -> None:
    """Nothing, or less than nothing, is open."""
    scene = ac.System()
    scene.rotor, scene.motor = Inertia(1.0), TorqueSource(1.0)
    scene.brake = Brake(scene.rotor.flange_b, capacity)
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    run = ac.build(scene).simulate(4.0, {scene.rotor.phi: 0.0, scene.rotor.w: 0.0}, rtol=1e-12)
    assert run[scene.rotor.w][-1] == 0
    assert changes(run)[-1] == pytest.approx(1 + (1 + math.sqrt(7)) / 3, rel=1e-11)


def test_brake_that_opens_at_rest_closes_again() -> None:
    """The capacity is a sine: open while it is negative."""
    scene = ac.System()
    scene.rotor, scene.motor = Inertia(1.0), TorqueSource(0.25)
    scene.brake = Brake(scene.rotor.flange_b, lambda t: np.sin(t))
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    run = ac.build(scene).simulate(8.0, {scene.rotor.phi: 0.0, scene.rotor.w: 0.0}, rtol=1e-12)
    slips = math.pi - math.asin(0.25)
    after = 0.25 * (8.0 - slips) - (math.cos(slips) - math.cos(math.pi)) + math.cos(8.0) - 1
    assert run[scene.rotor.w][-1] == pytest.approx(after, rel=1e-11)
    assert run[scene.brake.grip][0] == 0


@pytest.mark.parametrize("course", ["input", "time"])
def test_what_sticks_to_a_belt_follows_its_speed(course: str) -> None:
    scene = ac.System()
    scene.mass, scene.belt = SlidingMass(2.0), VelocitySource(ac.Input("m/s") if course == "input" else lambda t: 0.3 * t * t)
    scene.rub = Clutch(scene.belt.flange, scene.mass.flange_a, capacity=1.5)
    inputs = {scene.belt.velocity: 0.3 * ac.time**2} if course == "input" else {}
    start = {scene.mass.s: 0.0, scene.mass.v: 0.0, scene.belt.flange.s: 0.0}
    run = ac.build(scene).simulate(2.0, start, inputs=inputs, rtol=1e-12)
    # sticks while 2 * 0.6 t < 1.5, then 0.75 a second
    assert changes(run) == pytest.approx([1.25], rel=1e-11)
    assert run[scene.mass.v][-1] == pytest.approx(0.3 * 1.25**2 + 0.75 * 0.75, rel=1e-11)


def test_stop_that_an_input_moves_strikes_as_hard_as_it_moves() -> None:
    scene = ac.System()
    scene.mass, scene.place = SlidingMass(2.0), ac.Input("m")
    scene.anvil = EndStop(scene.mass.flange_a, lower=scene.place, restitution=0.6)
    run = quiet(
        ac.build(scene), 1.0, {scene.mass.s: 0.25, scene.mass.v: 0.0}, inputs={scene.place: 0.5 * ac.time + 0.2 * ac.time**2}, rtol=1e-12
    )  # fmt: skip
    met = (math.sqrt(0.25 + 4 * 0.2 * 0.25) - 0.5) / 0.4
    assert jumps(run) == pytest.approx([met], rel=1e-11)
    assert run[scene.mass.v][-1] == pytest.approx(1.6 * (0.5 + 0.4 * met), rel=1e-11)


def test_stop_of_a_hinge_holds_a_pendulum_that_leans_on_it() -> None:
    """By the joint's flange, with the weight's torque."""
    scene = ac.System()
    scene.world, scene.hinge = World(gravity=(0, 0, -9.81)), Revolute("y")
    scene.rod = RigidBody(mass=2.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0))
    scene.stop = EndStop(scene.hinge.flange, upper=0.3)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.at((0.5, 0, 0)))
    run = quiet(ac.build(scene), 3.0, {scene.hinge.q: 0.2, scene.hinge.v: 0.0}, rtol=1e-12)
    q = run[scene.hinge.q]
    assert q[-1] == pytest.approx(0.3, abs=1e-14) or q[-1] < 0.3
    assert np.max(q) <= 0.3 + 1e-14


def test_stop_at_a_joint_in_a_loop_stops_the_loop() -> None:
    """A parallelogram swings as a pendulum whose hinge has a stop."""
    scene = ac.System()
    scene.world = World(gravity=(0, 0, -9.81))
    scene.left, scene.right = (
        RigidBody(1.0, (0.01, 0.01, 0.01), position=(0, 0, -0.5)),
        RigidBody(1.0, (0.01, 0.01, 0.01), position=(1, 0, -0.5)),
    )
    scene.bar = RigidBody(1.0, (0.01, 0.01, 0.01), position=(0.5, 0, -1))
    scene.joints = [
        Revolute.between(scene.world, scene.left, at=(0, 0, 0), axis="y"), Revolute.between(scene.left, scene.bar, at=(0, 0, -1), axis="y"),
        Revolute.between(scene.world, scene.right, at=(1, 0, 0), axis="y"), Revolute.between(scene.right, scene.bar, at=(1, 0, -1), axis="y"),
    ]  # fmt: skip
    scene.stop = EndStop(scene.joints[2].flange, lower=-0.1, upper=0.2, restitution=1.0)
    run = quiet(ac.build(scene), 4.0, {scene.joints[0].q: 0.0, scene.joints[0].v: 2.0}, rtol=1e-12)
    q = run[scene.joints[0].q]
    assert np.max(q) == pytest.approx(0.2, abs=1e-2) and np.max(q) <= 0.2 + 1e-13
    assert np.min(q) >= -0.1 - 1e-13
    assert len(jumps(run)) > 10
    assert run.energy_error() < 1e-10
