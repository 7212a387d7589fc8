"""Modelica's robot: the arm against Lagrange's equations, its motors against their transfer function, the move against statics."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from components import Constant, Inertia, Resistor, RotationalGround, RotationalSpring, SlidingMass, TorqueSource, VoltageSource
from components.amplifier import OperationalAmplifier
from components.electrical import Capacitor, Ground
from components.sensors import CurrentSensor, ForceSensor, RelativeRotationSensor, TorqueSensor
from components.signals import Gain, SignalForce, SignalTorque
from components.translational import ForceSource
from examples.robot_r3 import ACCELERATION, BEGIN, DRIVES, END, PATH, SPEED, Arm, Motor, Robot
from tests.one_freedom import turn_x, turn_y

GRAVITY = ca.DM([0, -9.81, 0])


def arm_by_lagrange() -> ca.Function:
    """(q, v, tau) -> v' of the six links, from their poses alone: d/dt dT/dv - dT/dq + dV/dq = tau."""
    q, v, tau = ca.SX.sym("q", 6), ca.SX.sym("v", 6), ca.SX.sym("tau", 6)
    scene = Arm()
    ends = ((0, 0.324, 0.3), (0, 0.65, 0), (0, 0.414, -0.155), (0, 0.186, 0), (0, 0.125, 0), (0, 0, 0))
    turns = (turn_y, turn_x, turn_x, turn_y, turn_x, turn_y)
    R, p, T, V = ca.SX.eye(3), ca.SX([0, 0.351, 0]), ca.SX(0), ca.SX(0)
    for k, (turn, end) in enumerate(zip(turns, ends, strict=True)):
        R = R @ turn(q[k])
        for body in [scene.links[k]] + ([scene.load] if k == 5 else []):
            centre = p + R @ ca.DM(body.centre_of_mass)
            velocity = ca.jtimes(centre, q, v)
            spin = ca.inv_skew(R.T @ ca.reshape(ca.jtimes(ca.vec(R), q, v), 3, 3))
            T += (body.mass * ca.dot(velocity, velocity) + ca.dot(spin, ca.DM(body.central_inertia) @ spin)) / 2
            V -= body.mass * ca.dot(GRAVITY, centre)
        p = p + R @ ca.DM(end)
    momentum = ca.gradient(T, v)
    M = ca.jacobian(momentum, v)
    rest = tau - ca.jtimes(momentum, q, v) + ca.gradient(T, q) - ca.gradient(V, q)
    return ca.Function("lagrange", [q, v, tau], [ca.solve(M, rest), M, ca.gradient(V, q)])


def test_arm_accelerates_as_lagrange_says():
    scene = Arm()
    scene.motors = [TorqueSource(ac.Input("N*m")) for _ in range(6)]
    for motor, joint in zip(scene.motors, scene.joints, strict=True):
        scene.connect(motor.flange, joint.flange)
    model = ac.build(scene)
    rates, reference = model.functions.explicit_dynamics, arm_by_lagrange()
    rng = np.random.default_rng(7)
    for _ in range(20):
        q, v, tau = rng.uniform(-3, 3, 6), rng.normal(size=6), rng.normal(size=6) * 100
        x_rate = np.array(rates(0, np.concatenate([q, v]), tau, [])).ravel()
        exact = np.array(reference(q, v, tau)[0]).ravel()
        np.testing.assert_allclose(x_rate[:6], v, atol=1e-15)
        np.testing.assert_allclose(x_rate[6:], exact, atol=1e-11 * np.max(np.abs(exact)))


def test_motor_follows_its_current_as_a_lag_of_second_order():
    """Rotor held: i'' + 2 D w i' + w^2 i = w^2 wanted, so that the step's overshoot and phase are known."""
    k, w, D = 1.1616, 4590.0, 0.6
    scene = ac.System()
    scene.motor, scene.wanted, scene.wall = Motor(k, w, D, 0.0013), Constant(2.0), RotationalGround()
    scene.connect(scene.wanted.output, scene.motor.wanted)
    scene.connect(scene.motor.flange, scene.wall.flange)
    model = ac.build(scene)
    assert model.system.x.numel() == 2
    run = model.simulate(2e-3, rtol=1e-11, samples=21)
    b = w * np.sqrt(1 - D * D)
    exact = 2.0 * (1 - np.exp(-D * w * run.t) * (np.cos(b * run.t) + D * w / b * np.sin(b * run.t)))
    np.testing.assert_allclose(run[scene.motor.la.i], exact, atol=1e-9)
    assert run.energy_error() < 1e-9


def test_path_is_the_quickest_within_its_limits():
    """One axis is at its largest speed and one at its largest acceleration; the others keep theirs; it ends where it should."""
    a, (_, rise, turn, arrival) = PATH.corners()
    t = np.linspace(0, arrival, 4001)
    s, rate = (np.array(ca.DM(PATH.fraction(ca.DM(t), k))).ravel() for k in (0, 1))
    assert (s[0], s[-1], rate[-1]) == pytest.approx((0, 1, 0), abs=1e-14)
    np.testing.assert_allclose(np.gradient(s, t)[1:-1], rate[1:-1], atol=2e-3)
    assert 0 < rise < turn < arrival
    change = np.abs(END - BEGIN)
    assert np.max(change * np.max(rate) / SPEED) == pytest.approx(1)
    assert np.max(change * a / ACCELERATION) == pytest.approx(1)


def test_robot_arrives_and_its_gears_give_way_as_statics_says():
    """The integrators bring every motor to its place; behind it a spring c at the motor sags by gravity's torque / (c ratio^2)."""
    scene = Robot()
    model = ac.build(scene)
    assert model.system.x.numel() == 36  # 6 joints and 3 rotors on springs, twice; of each drive controller, capacitor, winding
    end = PATH.corners()[1][-1] + 8.0
    run = model.simulate(end, scene.start(), rtol=1e-8, samples=201)
    q = np.array([run[joint.q][-1] for joint in scene.arm.joints])
    pull = np.array(arm_by_lagrange()(q, np.zeros(6), np.zeros(6))[2]).ravel()
    for axis, drive, joint, goal, torque in zip(scene.axes, DRIVES, q, END, pull, strict=True):
        assert float(run[axis.motor.rotor.phi][-1]) / drive.ratio == pytest.approx(goal, abs=1e-8)
        sag = -torque / (drive.ratio**2 * drive.spring) if drive.spring else 0.0
        assert joint - goal == pytest.approx(sag, abs=1e-8)
        assert run[axis.motor.la.i][-1] == pytest.approx(torque / (drive.ratio * drive.k), abs=1e-5)
    assert run.energy_error() < 1e-8


def test_amplifier_inverts_and_integrates():
    """Gain -R2 / R1 with a resistor back, -1 / (R C) times the integral with a capacitor back."""
    scene = ac.System()
    scene.source, scene.ground = VoltageSource(lambda t: np.sin(t)), Ground()
    scene.r1, scene.r2, scene.r3, scene.c = Resistor(100.0), Resistor(250.0), Resistor(1e3), Capacitor(1e-3)
    scene.inverter, scene.integral = OperationalAmplifier(), OperationalAmplifier()
    scene.connect(scene.source.pin_a, scene.r1.pin_a, scene.r3.pin_a)
    scene.connect(scene.source.pin_b, scene.ground.pin, scene.inverter.plus, scene.integral.plus)
    for amplifier, given, back in ((scene.inverter, scene.r1, scene.r2), (scene.integral, scene.r3, scene.c)):
        scene.connect(given.pin_b, amplifier.minus, back.pin_a)
        scene.connect(back.pin_b, amplifier.output)
    run = ac.build(scene).simulate(3.0, rtol=1e-11, samples=31)
    np.testing.assert_allclose(run[scene.inverter.output.v], -2.5 * np.sin(run.t), atol=1e-12)
    np.testing.assert_allclose(run[scene.integral.output.v], -(1 - np.cos(run.t)), atol=1e-10)
    assert run.energy_error() < 1e-10


def test_sensors_measure_and_take_nothing():
    """Two inertias on a spring with gauges in the line: torque of the spring, twist; a current fed back; a force."""
    scene = ac.System()
    scene.motor, scene.a, scene.b = TorqueSource(0.3), Inertia(0.1), Inertia(0.2)
    scene.gauge, scene.spring, scene.twist = TorqueSensor(), RotationalSpring(5.0), RelativeRotationSensor()
    scene.push, scene.rod, scene.mass = ForceSource(2.0), ForceSensor(), SlidingMass(4.0)
    scene.follower, scene.half, scene.other = SignalForce(), Gain(0.5), SlidingMass(1.0)
    scene.copy, scene.third, scene.last = SignalTorque(), Gain(1.0), Inertia(1.0)
    scene.battery, scene.load, scene.hall, scene.ground = VoltageSource(12.0), Resistor(4.0), CurrentSensor(), Ground()
    scene.connect(scene.motor.flange, scene.a.flange_a)
    scene.connect(scene.a.flange_b, scene.gauge.flange_a, scene.twist.flange_a)
    scene.connect(scene.gauge.flange_b, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.b.flange_a, scene.twist.flange_b)
    scene.connect(scene.push.flange, scene.rod.flange_a)
    scene.connect(scene.rod.flange_b, scene.mass.flange_a)
    scene.connect(scene.rod.force, scene.half.input)
    scene.connect(scene.half.output, scene.follower.signal)
    scene.connect(scene.follower.flange, scene.other.flange_a)
    scene.connect(scene.hall.current, scene.third.input)
    scene.connect(scene.third.output, scene.copy.signal)
    scene.connect(scene.copy.flange, scene.last.flange_a)
    scene.connect(scene.battery.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.hall.pin_a)
    scene.connect(scene.hall.pin_b, scene.battery.pin_b, scene.ground.pin)
    run = ac.build(scene).simulate(2.0, rtol=1e-11, samples=21)
    np.testing.assert_allclose(run[scene.gauge.torque.value], -5.0 * run[scene.twist.angle.value], atol=1e-12)
    np.testing.assert_allclose(run[scene.twist.speed.value], run[scene.b.w] - run[scene.a.w], atol=1e-12)
    np.testing.assert_allclose(0.1 * run[scene.a.w] + 0.2 * run[scene.b.w], 0.3 * run.t, atol=1e-10)
    np.testing.assert_allclose(run[scene.mass.v], 0.5 * run.t, atol=1e-10)
    np.testing.assert_allclose(run[scene.other.v], 1.0 * run.t, atol=1e-10)
    np.testing.assert_allclose(run[scene.last.w], 3.0 * run.t, atol=1e-10)
