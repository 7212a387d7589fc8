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
    DCMotor,
    ElasticGear,
    EndStop,
    ForceSource,
    Freewheel,
    Ground,
    Inertia,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    SlidingMass,
    TorqueSource,
    TranslationalGround,
    TranslationalSpring,
    VelocitySource,
    VoltageSource,
    World,
)
from tests.drawn import SEEDS, Drawn
from tests.pairings import each_value

SIZES = [1.0, 1e-9, 1e6]
"""Of lengths, times and masses stay."""


def changes(run: Any) -> list[float]:
    """Times of changes of mode after the start."""
    return [change.time for change in run.solution.modes.changes if change.row >= 0]


def jumps(run: Any) -> list[float]:
    """Times of impacts."""
    return [change.time for change in run.solution.modes.changes if change.jumped]


@each_value(("size", SIZES), ("restitution", [1.0, 0.8, 0.3]))
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
    run = ac.build(scene).simulate(3.0, {scene.ball.s: 0.0, scene.ball.v: speed}, rtol=1e-12)
    assert jumps(run) == pytest.approx(strikes, rel=1e-11)
    sign = (-1) ** len(strikes)
    assert run[scene.ball.v][-1] == pytest.approx(sign * speed * restitution ** len(strikes), rel=1e-11)
    lost = [0.15 * speed**2 * (1 - restitution**2) * restitution ** (2 * k) for k in range(len(strikes))]
    assert [change.energy_lost for change in run.transitions] == pytest.approx(lost, rel=1e-10, abs=1e-13 * speed**2)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("seed", SEEDS)
def test_oscillator_with_friction_loses_the_same_amplitude_each_half_period_and_stops(seed: int) -> None:
    """Amplitudes fall by 2 F / k each half period pi / omega, until the spring is held (classical, Coulomb)."""
    of = Drawn(seed)
    mass, stiffness = of.M, of.M / of.T**2 * of.within(1, 30)
    friction = of.M * of.L / of.T**2
    first = friction / stiffness * of.within(2, 30) * of.rng.choice([1, -1])
    parts = [SlidingMass(mass), TranslationalSpring(stiffness), TranslationalGround()]
    block, spring, wall = parts
    scene = ac.System()
    scene.row = [parts[k] for k in of.order(3)]
    scene.rub = Brake(block.flange_a, friction)
    scene.connect(wall.flange, spring.flange_a)
    scene.connect(spring.flange_b, block.flange_b)
    half, loss = math.pi * math.sqrt(mass / stiffness), 2 * friction / stiffness
    places = [first]
    while abs(places[-1]) * stiffness > friction:
        places.append(-np.sign(places[-1]) * (abs(places[-1]) - loss))
    run = ac.build(scene).simulate(len(places) * half, {block.s: first, block.v: 0.0}, rtol=1e-12)
    assert changes(run) == pytest.approx([half * k for k in range(1, len(places))], rel=1e-11)
    assert run[block.s][-1] == pytest.approx(places[-1], abs=1e-10 * abs(first))
    assert run[scene.rub.grip][-1] == pytest.approx(stiffness * places[-1], abs=1e-10 * stiffness * abs(first))
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize("seed", SEEDS)
def test_mass_on_a_belt_sticks_and_slips_with_its_period(seed: int) -> None:
    of = Drawn(seed)
    mass, stiffness, sliding = of.M, of.M / of.T**2 * of.within(1, 10), of.M * of.L / of.T**2
    holding, belt = sliding * of.within(1.1, 3), of.speed * of.within(0.1, 2) * of.rng.choice([1, -1])
    parts = [SlidingMass(mass), TranslationalSpring(stiffness), TranslationalGround(), VelocitySource(belt)]
    block, spring, wall, drive = parts
    scene = ac.System()
    scene.row = [parts[k] for k in of.order(4)]
    ends = [drive.flange, block.flange_a]
    scene.rub = Clutch(*(ends[k] for k in of.order(2)), capacity=sliding, holding=holding)
    scene.connect(wall.flange, spring.flange_a)
    scene.connect(spring.flange_b, block.flange_b)
    omega, ahead = math.sqrt(stiffness / mass), (holding - sliding) / stiffness
    first = holding / stiffness / abs(belt)
    period = 2 * (math.pi - math.atan(omega * ahead / abs(belt))) / omega + 2 * ahead / abs(belt)
    run = ac.build(scene).simulate(first + 20.5 * period, {block.s: 0.0, block.v: belt, drive.flange.s: 0.0}, rtol=1e-12)
    assert changes(run)[0::2] == pytest.approx(first + period * np.arange(21), rel=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_clutch_engages_after_its_time_and_loses_what_it_must(seed: int) -> None:
    """t = dw J / capacity and E = J dw^2 / 2 with J = J_a J_b / (J_a + J_b)."""
    of = Drawn(seed)
    J, w = of.M * of.L**2 * 10 ** of.rng.uniform(-1, 1, 2), of.rng.uniform(-9, 9, 2) / of.T
    capacity = of.M * of.L**2 / of.T**2 * of.within(0.1, 9)
    wheels = [Inertia(float(j)) for j in J]
    scene = ac.System()
    scene.wheels = [wheels[k] for k in of.order(2)]
    ends = wheels[0].flange_b, wheels[1].flange_a
    scene.clutch = Clutch(*(ends[k] for k in of.order(2)), capacity=capacity)
    both, slip = J[0] * J[1] / np.sum(J), w[0] - w[1]
    stop = abs(slip) * both / capacity
    start = {wheel.w: float(speed) for wheel, speed in zip(wheels, w, strict=True)} | {wheel.phi: 0.0 for wheel in wheels}
    run = ac.build(scene).simulate(2 * stop, start, rtol=1e-12)
    assert changes(run) == pytest.approx([stop], rel=1e-11)
    for wheel in wheels:
        assert run[wheel.w][-1] == pytest.approx(J @ w / np.sum(J), abs=1e-12 * np.max(np.abs(w)))
    assert run.energy_loss[-1] == pytest.approx(0.5 * both * slip**2, rel=1e-11)
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
    run = ac.build(scene).simulate(1.0, start, rtol=1e-12)
    met = math.sqrt(2 * (0.04 + 0.02) / (2.0 / 0.4))
    assert jumps(run) == pytest.approx([met], rel=1e-11)
    assert run[scene.second.w][-1] == pytest.approx(2.0 * 1.0 / 1.6, rel=1e-12)
    assert run[scene.play.at_lower][-1] == pytest.approx(2.0 * 1.2 / 1.6, rel=1e-11)
    assert run.transitions[0].energy_lost == pytest.approx(0.5 * (5.0 * met) ** 2 * 0.4 * 1.2 / 1.6, rel=1e-11)
    assert run.energy_error() < 1e-11


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


def test_freewheel_engages_without_any_impact() -> None:
    """Time and again, where two speeds meet."""
    scene = ac.System()
    scene.first, scene.second, scene.motor = Inertia(0.37), Inertia(0.91), TorqueSource(lambda t: 2 * np.sin(7.3 * t) + 0.13)
    scene.drag, scene.wall = RotationalDamper(0.05), RotationalGround()
    scene.hub = Freewheel(scene.first.flange_b, scene.second.flange_a)
    scene.connect(scene.motor.flange, scene.first.flange_a)
    scene.connect(scene.second.flange_b, scene.drag.flange_b)
    scene.connect(scene.wall.flange, scene.drag.flange_a)
    start = {scene.first.w: 0.3, scene.second.w: 0.3, scene.first.phi: 0.0, scene.second.phi: 0.0}
    run = ac.build(scene).simulate(20.0, start, rtol=1e-12)
    assert len(changes(run)) > 40
    assert not jumps(run)
    assert np.min(run[scene.second.w] - run[scene.first.w]) > -1e-14
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize(("speed", "engaged"), [(0.0, 1.0), (1.0, 1.0), (3.0, 2.0)])
def test_pawl_holds_while_it_is_in(speed: float, engaged: float) -> None:
    """A shaft is turned back by 1 rad/s^2; from 1 s to 2 s the pawl is in: then it stops there, and what is held stays so."""
    scene = ac.System()
    scene.wall, scene.shaft, scene.load, scene.pawl = RotationalGround(), Inertia(2.0), TorqueSource(-2.0), ac.Input("1")
    scene.hub = Freewheel(scene.wall.flange, scene.shaft.flange_a, gate=scene.pawl)
    scene.connect(scene.load.flange, scene.shaft.flange_b)
    inputs = {scene.pawl: ac.samples([0, 1, 2], [0, 1, 0], kind="constant")}
    run = ac.build(scene).simulate(4.0, {scene.shaft.w: speed, scene.shaft.phi: 0.0}, inputs=inputs, rtol=1e-12)
    assert run[scene.shaft.w][-1] == pytest.approx(0.0 if speed <= engaged else speed - 4.0, abs=1e-12)
    assert jumps(run) == ([1.0] if speed == 0 else [])


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


@pytest.mark.parametrize("size", [1.0, 1e-6])
def test_clutch_that_closes_again_while_it_slips_goes_on_slipping(size: float) -> None:
    """Pressed by a mass on a spring: half of the time there is no pressure."""
    scene = ac.System()
    scene.first, scene.second, scene.plate = Inertia(size), Inertia(size), SlidingMass(1.0)
    scene.wall, scene.spring = TranslationalGround(), TranslationalSpring(100.0)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.plate.flange_a)
    scene.clutch = Clutch(scene.first.flange_b, scene.second.flange_a, capacity=10 * size * scene.plate.s)
    start = {scene.first.w: 10.0, scene.second.w: 0.0, scene.plate.s: 0.5, scene.plate.v: 0.0}
    run = ac.build(scene).simulate(2.8, {**start, scene.first.phi: 0.0, scene.second.phi: 0.0}, rtol=1e-12)
    crossings = math.pi / 10 * (np.arange(9) + 0.5)
    assert changes(run) == pytest.approx(crossings[crossings < 2.8], rel=1e-11)
    # 1/2 in the first quarter, then 1 in each half period of pressure
    slowed = 0.5 + 4.0 - 0.5 * (1 - math.sin(28.0)) if math.cos(28.0) > 0 else 0.5 + 4.0
    assert run[scene.first.w][-1] == pytest.approx(10 - slowed, rel=1e-11)
    assert run.energy_error() < 1e-8  # of a quadrature


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


@pytest.mark.parametrize("jump", [0.0, 0.5, 1 / 3])
def test_belt_whose_speed_jumps_drags_what_stuck_to_it(jump: float) -> None:
    """Holding is stronger than sliding: a jump ends it all the same."""
    scene = ac.System()
    scene.mass, scene.belt = SlidingMass(1.0), VelocitySource(ac.Input("m/s"))
    scene.rub = Clutch(scene.belt.flange, scene.mass.flange_a, capacity=0.5, holding=0.8)
    course = ac.samples([0, jump], [0, 1], kind="constant") if jump else 1.0
    start = {scene.mass.s: 0.0, scene.mass.v: 0.0, scene.belt.flange.s: 0.0}
    run = ac.build(scene).simulate(4.0, start, inputs={scene.belt.velocity: course}, rtol=1e-12)
    assert changes(run) == pytest.approx([jump + 2.0], rel=1e-11)
    assert run[scene.mass.v][-1] == pytest.approx(1.0, rel=1e-12)
    assert run[scene.mass.s][-1] == pytest.approx(1.0 + 4.0 - jump - 2.0, rel=1e-11)


def test_load_between_sliding_and_holding_is_held_where_inputs_jump() -> None:
    """What sticks to a belt by an input is known to the tolerance only, which is no slip."""
    scene = ac.System()
    scene.mass, scene.belt, scene.load = SlidingMass(1.0), VelocitySource(ac.Input("m/s")), ForceSource(ac.Input("N"))
    scene.rub = Clutch(scene.belt.flange, scene.mass.flange_a, capacity=0.5, holding=0.8)
    scene.connect(scene.load.flange, scene.mass.flange_b)
    inputs = {
        scene.belt.velocity: 0.05 * ac.time**2,
        scene.load.force: ac.samples([0, 1, 2, 3], [0, 0.7, 0, 0.1], kind="constant"),
    }
    start = {scene.mass.s: 0.0, scene.mass.v: 0.0, scene.belt.flange.s: 0.0}
    run = ac.build(scene).simulate(5.0, start, inputs=inputs, rtol=1e-6)
    assert not changes(run)
    assert run[scene.mass.v][-1] == pytest.approx(1.25, rel=1e-6)


@pytest.mark.parametrize("torque", [1.4, 1.6])
def test_elastic_gear_holds_its_load_up_to_the_friction_that_holds(torque: float) -> None:
    """Twisted by the torque; above, the load begins to turn."""
    scene = ac.System()
    scene.motor, scene.rotor, scene.load = TorqueSource(0.1 * torque), Inertia(0.01), Inertia(2.0)
    scene.gear, scene.rub = ElasticGear(10.0, 50.0, 2.0), Brake(scene.load.flange_b, capacity=1.0, holding=1.5)
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.load.flange_a)
    start = {scene.rotor.w: 0.0, scene.load.w: 0.0, scene.rotor.phi: 0.1 * torque / 50.0, scene.load.phi: 0.0}
    run = ac.build(scene).simulate(20.0, start, rtol=1e-10)
    if torque < 1.5:
        assert np.max(np.abs(run[scene.load.w])) == 0
        assert run[scene.rub.grip][-1] == pytest.approx(-torque, rel=1e-8)
    else:
        assert run[scene.load.w][-1] == pytest.approx((torque - 1.0) / 3.0 * 20.0, rel=1e-2)
    assert run.energy_error() < 1e-8


def test_motor_against_a_brake_by_an_input_takes_the_current_of_what_it_holds() -> None:
    """Held, its speed is zero, and so its current voltage / resistance; free, it runs up to voltage / constant."""
    scene = ac.System()
    scene.motor, scene.mains, scene.ground, scene.rotor = DCMotor(0.5, 2.0, 1e-3), VoltageSource(6.0), Ground(), Inertia(0.05)
    scene.brake = Brake(scene.rotor.flange_b, ac.Input("N*m"))
    scene.connect(scene.mains.pin_a, scene.motor.pin_a)
    scene.connect(scene.mains.pin_b, scene.motor.pin_b, scene.ground.pin)
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    course = ac.samples([0, 4], [0, 4.0], kind="constant")
    run = ac.build(scene).simulate(
        8.0, {scene.rotor.w: 0.0, scene.rotor.phi: 0.0}, inputs={scene.brake.capacity: course}, rtol=1e-10
    )
    assert np.max(run[scene.rotor.w]) == pytest.approx(12.0, rel=1e-4)
    assert run[scene.rotor.w][-1] == 0
    assert run[scene.brake.grip][-1] == pytest.approx(-0.5 * 6.0 / 2.0, rel=1e-8)


@pytest.mark.parametrize("swapped", [False, True])
def test_freewheel_takes_part_in_an_impact_that_it_can_hold(swapped: bool) -> None:
    """The load bounces off a stop and would run slower than the drive: both turn back together, by Poisson's law."""
    scene = ac.System()
    for name, inertia in (("load", 2.0), ("drive", 1.0)) if swapped else (("drive", 1.0), ("load", 2.0)):
        setattr(scene, name, Inertia(inertia))
    scene.hub = Freewheel(scene.drive.flange_b, scene.load.flange_a)
    scene.stop = EndStop(scene.load.flange_b, upper=1.0, restitution=0.5)
    start = {scene.drive.w: 1.0, scene.load.w: 1.0, scene.drive.phi: 0.0, scene.load.phi: 0.0}
    run = ac.build(scene).simulate(3.0, start, rtol=1e-12)
    assert jumps(run) == pytest.approx([1.0], rel=1e-12)
    assert run[scene.drive.w][-1] == pytest.approx(-0.5, rel=1e-12)
    assert run[scene.load.w][-1] == pytest.approx(-0.5, rel=1e-12)


def test_values_of_parameters_count_after_the_build() -> None:
    scene = ac.System()
    scene.lower, scene.bounce, scene.ball = ac.Parameter(-0.1, "m"), ac.Parameter(0.5, "1"), SlidingMass(1.0)
    scene.drag, scene.start = ac.Parameter(0.0, "N"), ac.Parameter(0.0, "N")
    scene.stop = EndStop(scene.ball.flange_a, lower=scene.lower, upper=0.2, restitution=scene.bounce)
    scene.rub = Brake(scene.ball.flange_b, scene.drag, holding=scene.start)
    model = ac.build(scene)
    for lower, bounce, drag in ((-0.1, 0.5, 0.0), (-0.3, 1.0, 0.0), (-0.2, 0.25, 0.5)):
        values = {scene.lower: lower, scene.bounce: bounce, scene.drag: drag, scene.start: 2 * drag}
        run = model.simulate(0.4, {scene.ball.s: 0.0, scene.ball.v: -1.0}, parameters=values, rtol=1e-12)
        met = -lower if drag == 0 else (1 - math.sqrt(1 + 2 * drag * lower)) / drag
        speed = bounce * (1 - drag * met)
        assert jumps(run)[0] == pytest.approx(met, rel=1e-11)
        assert run[scene.ball.v][-1] == pytest.approx(max(speed - drag * (0.4 - met), 0.0), rel=1e-10)
    for wrong, words in (
        ({scene.bounce: 1.2}, r"restitution is 1\.2"),
        ({scene.lower: 0.3}, "upper is 0.1 below its lower"),
        ({scene.drag: 3.0}, "holding is 3 below its capacity"),
    ):
        with pytest.raises(ac.errors.ParameterError, match=words):
            model.simulate(1.0, {scene.ball.s: 0.0, scene.ball.v: -1.0}, parameters=wrong)


def test_stop_that_an_input_moves_strikes_as_hard_as_it_moves() -> None:
    scene = ac.System()
    scene.mass, scene.place = SlidingMass(2.0), ac.Input("m")
    scene.anvil = EndStop(scene.mass.flange_a, lower=scene.place, restitution=0.6)
    run = ac.build(scene).simulate(
        1.0, {scene.mass.s: 0.25, scene.mass.v: 0.0}, inputs={scene.place: 0.5 * ac.time + 0.2 * ac.time**2}, rtol=1e-12
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
    run = ac.build(scene).simulate(3.0, {scene.hinge.q: 0.2, scene.hinge.v: 0.0}, rtol=1e-12)
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
    run = ac.build(scene).simulate(4.0, {scene.joints[0].q: 0.0, scene.joints[0].v: 2.0}, rtol=1e-12)
    q = run[scene.joints[0].q]
    assert np.max(q) == pytest.approx(0.2, abs=1e-2) and np.max(q) <= 0.2 + 1e-13
    assert np.min(q) >= -0.1 - 1e-13
    assert len(jumps(run)) > 10
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize("seed", range(4))
def test_what_bounces_with_friction_comes_to_rest_in_its_instant(seed: int) -> None:
    """Down with (W - F) / m and up with (W + F) / m: of its speed e sqrt((W - F) / (W + F)) is left at each strike, and of the time, too."""
    draw = np.random.default_rng(seed)
    mass, length, weight = (10 ** draw.uniform(-3, 3) for _ in range(3))
    part, bounce = draw.uniform(0.05, 0.9), draw.uniform(0.2, 0.8)
    scene = ac.System()
    scene.load, scene.pull = SlidingMass(mass), ForceSource(-weight)
    scene.rub = Brake(scene.load.flange_a, part * weight)
    scene.stop = EndStop(scene.load.flange_b, lower=0.0, restitution=bounce)
    scene.connect(scene.pull.flange, scene.load.flange_a)
    down, up = (1 - part) * weight / mass, (1 + part) * weight / mass
    speed, left = math.sqrt(2 * down * length), bounce * math.sqrt(down / up)
    rests = speed / down + bounce * speed * (1 / up + 1 / math.sqrt(up * down)) / (1 - left)
    run = ac.build(scene).simulate(1.1 * rests, {scene.load.s: length, scene.load.v: 0.0}, rtol=1e-12)
    assert list(run.transitions)[-1].time == pytest.approx(rests, rel=1e-11)
    assert run.modes(scene.stop).words[-1] == "closed"
    assert run[scene.load.s][-1] == pytest.approx(0.0, abs=1e-14 * length)
    assert run[scene.load.v][-1] == 0.0
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("alone", [True, False])
def test_brakes_on_what_is_held_and_clutches_on_one_shaft_take_nothing(alone: bool) -> None:
    """Whether anything else may slip or not."""
    scene = ac.System()
    scene.wall, scene.held, scene.block, scene.rotor = TranslationalGround(), SlidingMass(2.0), SlidingMass(1.0), Inertia(1.0)
    scene.connect(scene.wall.flange, scene.held.flange_a)
    scene.idle, scene.closed = Brake(scene.held.flange_b, 3.0), Clutch(scene.rotor.flange_a, scene.rotor.flange_b, 4.0)
    if not alone:
        scene.rub = Brake(scene.block.flange_a, 0.5)
    run = ac.build(scene).simulate(1.0, {scene.block.v: 1.0, scene.rotor.w: 2.0})
    assert run[scene.block.s][-1] == pytest.approx(1.0 if alone else 0.75) and run[scene.rotor.phi][-1] == pytest.approx(2.0)
    assert not run[scene.idle.grip].any() and not run[scene.closed.grip].any() and run.energy_error() < 1e-12
