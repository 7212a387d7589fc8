"""Gears whose teeth rub by what they carry: powers that come out, what holds, and motions against equations in each way of driving."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import ParameterError
from components import (
    Brake,
    ForceSource,
    Inertia,
    LossyGear,
    RackAndPinion,
    Revolute,
    RigidBody,
    SlidingMass,
    TorqueSource,
    World,
)


class Drive(ac.System):
    """Two rotors with a torque on each, and a gear between."""

    def __init__(self, ratio, e, b, torques, inertias) -> None:
        self.motor, self.load = map(Inertia, inertias)
        self.gear = LossyGear(ratio, e(self.motor.w) if callable(e) else e, b)
        self.driven, self.resisted = map(TorqueSource, torques)
        self.connect(self.driven.flange, self.motor.flange_a)
        self.connect(self.motor.flange_b, self.gear.flange_a)
        self.connect(self.gear.flange_b, self.load.flange_a)
        self.connect(self.load.flange_b, self.resisted.flange)


class Adjustable(Drive):
    """The same by parameters."""

    def __init__(self) -> None:
        self.ratio, self.e, self.b = ac.Parameter(2.0), ac.Parameter(0.8), ac.Parameter(0.7)
        self.torques = ac.Parameter(1.0, "N*m"), ac.Parameter(-1.0, "N*m")
        self.inertias = ac.Parameter(1.0, "kg*m^2"), ac.Parameter(1.0, "kg*m^2")
        super().__init__(self.ratio, self.e, self.b, self.torques, self.inertias)

    def values(self, ratio: float, e: float, b: float, torques: np.ndarray, inertias: np.ndarray) -> dict[ac.Parameter, float]:
        given = dict(zip((*self.torques, *self.inertias), [*torques, *inertias], strict=True))
        return {self.ratio: ratio, self.e: e, self.b: b, **given}


def acceleration(sense: float, ratio: float, e: float, b: float, torques: np.ndarray, inertias: np.ndarray) -> float | None:
    """Of flange_a where it turns in this sense: the teeth give b the part e of what a gives, or a the part b of what b gives. None where neither can be."""
    for part, drives in ((e, True), (1 / b, False)):
        a = (torques[0] * part + torques[1] / ratio) / (inertias[0] * part + inertias[1] / ratio**2)
        given = (torques[0] - inertias[0] * a) * sense  # by a, times the sense: a power
        if (given > 0) == (drives or b < 0):
            return a
    return None


def speed(w: float, end: float, *drive) -> float:
    """Of flange_a at the end, under constant torques."""
    a = acceleration(np.sign(w), *drive)
    assert a is not None
    stops = -w / a if a * w < 0 else np.inf
    if stops > end:
        return w + a * end
    for sense in (1.0, -1.0):
        a = acceleration(sense, *drive)
        if a is not None and a * sense > 0:
            return a * (end - stops)
    return 0.0


def test_speeds_by_what_comes_out_of_what_is_put_in_whichever_way_it_is_driven():
    scene = Adjustable()
    model, rng = ac.build(scene), np.random.default_rng(11)
    held = back = 0
    for unit in (1.0, 1e-9, 1e6):
        for _ in range(4):
            b = rng.choice([rng.uniform(0.3, 0.95), rng.uniform(-0.6, -0.1)])
            drive = (
                rng.choice([-1, 1]) * rng.uniform(2, 9),
                rng.uniform(0.3, 0.95),
                b,
                unit * rng.normal(0, 3, 2),
                unit * rng.uniform(0.5, 2, 2),
            )
            w = rng.choice([-1, 1]) * rng.uniform(0.2, 2)
            run = model.simulate(2.0, {scene.motor.phi: 0, scene.motor.w: w}, parameters=scene.values(*drive), rtol=1e-10)
            expected = speed(w, 2.0, *drive)
            assert run[scene.motor.w][-1] == pytest.approx(expected, abs=1e-9), (drive, w)
            assert run.energy_error() < 1e-9
            held, back = held + (expected == 0), back + (expected * w < 0)
    assert held >= 2 and back >= 2


def test_two_in_a_row_without_anything_between_are_one_with_the_products_of_both():
    drive = 2.0 * -3.0, 0.8 * 0.9, 0.7 * 0.6, np.array([2.0, -40.0]), np.array([0.2, 3.0])
    scene = ac.System()
    scene.motor, scene.load = map(Inertia, drive[4])
    scene.gears = [LossyGear(2.0, 0.8, 0.7), LossyGear(-3.0, 0.9, 0.6)]
    scene.torques = [TorqueSource(torque) for torque in drive[3]]
    scene.connect(scene.torques[0].flange, scene.motor.flange_a)
    scene.connect(scene.motor.flange_b, scene.gears[0].flange_a)
    scene.connect(scene.gears[0].flange_b, scene.gears[1].flange_a)
    scene.connect(scene.gears[1].flange_b, scene.load.flange_a)
    scene.connect(scene.load.flange_b, scene.torques[1].flange)
    model = ac.build(scene)
    for w in (3.0, -3.0):
        assert model.simulate(2.0, {scene.motor.w: w})[scene.motor.w][-1] == pytest.approx(speed(w, 2.0, *drive), abs=1e-9)


@pytest.mark.parametrize(("e", "b"), [(0.9, None), (0.6, 0.3), (0.8, 0.9)])
def test_power_comes_out_by_the_efficiency_of_that_way(e, b):
    """Of a winch that lifts and lowers a load at constant speed."""
    for forward in (1.0, -1.0):
        scene = ac.System()
        scene.gear, scene.drum, scene.weight = LossyGear(25.0, e, b), RackAndPinion(0.2), SlidingMass(30.0)
        scene.rotor, scene.force = Inertia(0.1), ac.Input("N*m")
        scene.motor = TorqueSource(scene.force)
        scene.connect(scene.motor.flange, scene.rotor.flange_a)
        scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
        scene.connect(scene.gear.flange_b, scene.drum.pinion)
        scene.connect(scene.drum.rack, scene.weight.flange_a)
        scene.gravity = ForceSource(-30.0 * 9.81)
        scene.connect(scene.gravity.flange, scene.weight.flange_b)
        lifted = 30.0 * 9.81 * 0.2 / 25.0  # on the motor's side, without losses
        torque = lifted / e if forward > 0 else lifted * (e if b is None else b)
        run = ac.build(scene).simulate(1.0, {scene.rotor.w: forward * 10.0}, inputs={scene.force: torque})
        np.testing.assert_allclose(run[scene.rotor.w], forward * 10.0, rtol=1e-9)


def test_worm_holds_its_load_whatever_that_is_and_gives_way_to_its_motor():
    """From the torque on that its teeth lose, against the load; both are as large as the load."""
    e, load = 0.4, 1e5
    lifts = load / 40.0 / e
    scene = Drive(40.0, e, -0.2, (lambda t: lifts * t, -load), (0.5, 0.1))
    run = ac.build(scene).simulate(1.5, {scene.motor.w: 0.0})
    [slips] = run.transitions
    assert slips.time == pytest.approx(1.0, rel=1e-9) and run[scene.motor.w][-1] > 1.0


def test_arm_needs_of_its_motor_what_the_teeth_leave_over_or_give_back():
    """Inverse dynamics: the gear is driven by whichever side has the power."""
    ratio, e, b, rotor = 20.0, 0.8, 0.6, 1e-3
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World(), Revolute("y"), RigidBody.rod(2.0, (1.0, 0, 0))
    scene.gear, scene.rotor, scene.torque = LossyGear(ratio, e, b), Inertia(rotor), ac.Input("N*m")
    scene.motor = TorqueSource(scene.torque)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.hinge.flange)
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    t = np.linspace(0.1, 3.0, 12)
    found = ac.build(scene).inverse_dynamics(t, {scene.hinge.q: 0.9 * np.sin(2 * ac.time)}, [scene.torque]).series[:, 0]
    q, v, a = 0.9 * np.sin(2 * t), 1.8 * np.cos(2 * t), -3.6 * np.sin(2 * t)
    out = (2 / 3 * a - 9.81 * np.cos(q)) / ratio
    part = np.where(out * v > 0, e, 1 / b)
    assert 0 < np.mean(out * v > 0) < 1
    np.testing.assert_allclose(found, out / part + rotor * ratio * a, rtol=1e-9)


def test_efficiency_by_speed_and_a_bearing_that_rubs_beside_it():
    scene = Drive(2.0, lambda w: 0.5 + 0.4 / (1.0 + w**2), None, (3.0, -1.5), (1.0, 1.0))
    scene.bearing = Brake(scene.motor.flange_a, capacity=0.5)
    run = ac.build(scene).simulate(1.0, {scene.motor.w: 1.0}, rtol=1e-10)

    def rate(_t: float, w: np.ndarray) -> np.ndarray:
        e = 0.5 + 0.4 / (1 + w**2)
        return (2.5 * e - 0.75) / (e + 0.25)

    expected = solve_ivp(rate, (0, 1), [1.0], rtol=1e-11, atol=1e-12).y[0, -1]
    assert run[scene.motor.w][-1] == pytest.approx(expected, rel=1e-9)


def test_without_losses_it_is_a_gear():
    drive = (-3.0, 1.0, None, (2.0, 0.5), (0.3, 0.7))
    scene = Drive(*drive)
    run = ac.build(scene).simulate(1.0, {scene.motor.w: 0.4})
    assert run[scene.motor.w][-1] == pytest.approx(0.4 + (2.0 - 0.5 / 3.0) / (0.3 + 0.7 / 9), rel=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((2, 1.2), "nothing gains power"),
        ((2, 0.0), "could not drive it"),
        ((2, 0.9, 1.0), "loses nothing"),
        ((0, 0.9), "transmitted"),
    ],
)
def test_efficiencies_that_nothing_has_are_refused(given, said):
    with pytest.raises(ParameterError, match=said):
        LossyGear(*given)
    scene = Adjustable()
    with pytest.raises(ParameterError, match="back_efficiency is 1"):
        ac.build(scene).simulate(1.0, parameters={scene.b: 1.0})
