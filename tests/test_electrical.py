"""Circuits against closed forms and independent programs: RC, RLC, loops of capacitors, cut sets of inductors, diodes, a motor with its arm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import acausal as ac
from components import (
    PID,
    Capacitor,
    Constant,
    CurrentSource,
    Diode,
    ElectromotiveForce,
    Gear,
    Ground,
    Inductor,
    Inertia,
    Resistor,
    RotationSensor,
    SignalVoltage,
    VoltageSource,
)
from tests.scenes import Pendulum

G = 9.81


def series(*parts: ac.Component, **named: ac.Component) -> ac.System:
    """A ring of two-pin parts; pin_b of the first is grounded."""
    scene = ac.System()
    for k, part in enumerate(parts):
        setattr(scene, f"part{k}", part)
    for name, part in named.items():
        setattr(scene, name, part)
    ring = [*parts, *named.values()]
    scene.ground = Ground()
    scene.connect(scene.ground.pin, ring[0].pin_b)
    scene.connect(ring[0].pin_a, ring[1].pin_a)
    for left, right in zip(ring[1:], [*ring[2:], ring[0]], strict=True):
        scene.connect(left.pin_b, right.pin_a if right is not ring[0] else right.pin_b)
    return scene


def test_capacitor_charges_through_a_resistor():
    scene = series(VoltageSource(5.0), resistor=Resistor(2e3), capacitor=Capacitor(1e-3))
    model = ac.build(scene)
    assert model.state_names == ("capacitor.v",)
    run = model.simulate(6.0, {scene.capacitor.v: 1.0}, rtol=1e-12)
    assert np.max(np.abs(run[scene.capacitor.v] - (5 - 4 * np.exp(-run.t / 2)))) < 1e-11
    assert np.max(np.abs(run[scene.resistor.i] - 2e-3 * np.exp(-run.t / 2))) < 1e-13
    assert run.energy_error() < 1e-10


def test_ringing_circuit_is_a_damped_oscillator():
    R, L, C = 2.0, 0.5, 0.1
    scene = series(VoltageSource(3.0), Resistor(R), coil=Inductor(L), capacitor=Capacitor(C))
    model = ac.build(scene)
    assert sorted(model.state_names) == ["capacitor.v", "coil.i"]
    run = model.simulate(5.0, rtol=1e-12)
    d, w = R / (2 * L), np.sqrt(1 / (L * C) - (R / (2 * L)) ** 2)
    exact = 3 * (1 - np.exp(-d * run.t) * (np.cos(w * run.t) + d / w * np.sin(w * run.t)))
    assert np.max(np.abs(run[scene.capacitor.v] - exact)) < 1e-10
    assert run.energy_error() < 1e-10


def test_parameters_stay_adjustable():
    R = ac.Parameter(2.0, "Ohm")
    scene = series(VoltageSource(1.0), resistor=Resistor(R), capacitor=Capacitor(ac.Parameter(0.5, "F")))
    model = ac.build(scene)
    for value in (2.0, 0.5):
        run = model.simulate(3.0, parameters={R: value}, rtol=1e-11)
        assert np.max(np.abs(run[scene.capacitor.v] - (1 - np.exp(-run.t / (0.5 * value))))) < 1e-9


@pytest.mark.parametrize("as_parameter", [False, True])
def test_capacitors_in_a_floating_loop_have_one_state_less(as_parameter):
    """Three capacitors in a triangle that hangs on resistors: u1 + u2 + u3 = 0 is hidden in the potentials."""
    sizes, loads = (1.0, 2.0, 3.0), (5.0, 3.0, 2.0)
    scene = ac.System()
    scene.caps = [Capacitor(ac.Parameter(c, "F") if as_parameter else c) for c in sizes]
    scene.loads = [Resistor(r) for r in loads]
    scene.ground = Ground()
    for k in range(3):
        scene.connect(scene.caps[k].pin_b, scene.caps[(k + 1) % 3].pin_a)
        scene.connect(scene.caps[k].pin_a, scene.loads[k].pin_a)
        scene.connect(scene.loads[k].pin_b, scene.ground.pin)
    model = ac.build(scene)
    assert len(model.state_names) == 2
    run = model.simulate(4.0, {scene.caps[0].v: 1.0, scene.caps[1].v: 0.5}, rtol=1e-11)
    # nodes a, b, c: capacitor Laplacian p' = -diag(1/R) p, with the sum of all currents zero
    B = np.array([[1, -1, 0], [0, 1, -1], [-1, 0, 1.0]])
    K, Y = B.T @ np.diag(sizes) @ B, np.diag(1 / np.array(loads))

    def rate(t, u):
        p = np.linalg.lstsq(np.vstack([B, Y.sum(axis=0)]), np.append(u, 0.0), rcond=None)[0]
        return B @ np.linalg.lstsq(K, -Y @ p, rcond=None)[0]

    other = solve_ivp(rate, (0, 4), [1.0, 0.5, -1.5], "DOP853", run.t, rtol=1e-12, atol=1e-13)
    for k in range(3):
        assert np.max(np.abs(run[scene.caps[k].v] - other.y[k])) < 1e-9
    assert run.energy_error() < 1e-9


def test_capacitor_across_a_source_needs_its_rate():
    scene = series(VoltageSource(lambda t: np.sin(3 * t)), capacitor=Capacitor(0.2))
    scene.extra = Capacitor(0.1)
    scene.other = Resistor(1.0)
    scene.connect(scene.part0.pin_a, scene.other.pin_a)
    scene.connect(scene.other.pin_b, scene.extra.pin_a)
    scene.connect(scene.extra.pin_b, scene.ground.pin)
    model = ac.build(scene)
    assert model.state_names == ("extra.v",)
    run = model.simulate(2.0, rtol=1e-10)
    assert np.max(np.abs(run[scene.capacitor.i] - 0.6 * np.cos(3 * run.t))) < 1e-12


def test_inductors_in_a_cut_set_have_one_state_less():
    """Three coils meet in a node: their currents sum to zero."""
    scene = ac.System()
    scene.coils = [Inductor(L) for L in (0.1, 0.2, 0.3)]
    scene.loads = [Resistor(r) for r in (1.0, 2.0, 3.0)]
    scene.source, scene.ground = VoltageSource(lambda t: np.cos(t)), Ground()
    scene.connect(*(coil.pin_b for coil in scene.coils))
    for coil, load in zip(scene.coils, scene.loads, strict=True):
        scene.connect(coil.pin_a, load.pin_a)
    scene.connect(scene.loads[0].pin_b, scene.source.pin_a)
    scene.connect(scene.source.pin_b, scene.loads[1].pin_b, scene.loads[2].pin_b, scene.ground.pin)
    model = ac.build(scene)
    assert len(model.state_names) == 2
    run = model.simulate(3.0, rtol=1e-11)
    A = np.array([[0.1 + 0.2, 0.2], [0.2, 0.2 + 0.3]])  # mesh currents: out of coil 2's branch, coil 1 and coil 3

    def rate(t, i):
        i1, i3 = i
        i2 = -i1 - i3
        # V - R1 i1 - L1 i1' = node = -R2 i2 - L2 i2' = -R3 i3 - L3 i3'
        b = [np.cos(t) - 1.0 * i1 + 2.0 * i2, 2.0 * i2 - 3.0 * i3]
        return np.linalg.solve(A, b)

    other = solve_ivp(rate, (0, 3), [0.0, 0.0], "DOP853", run.t, rtol=1e-12, atol=1e-13)
    assert np.max(np.abs(run[scene.coils[0].i] - other.y[0])) < 1e-9
    assert np.max(np.abs(run[scene.coils[2].i] - other.y[1])) < 1e-9
    assert run.energy_error() < 1e-9


def test_diode_in_series_with_a_resistor():
    """A nonlinear loop: each instant against a scalar root-finder; the circuit has a capacitor elsewhere."""
    V, R = (lambda t: 2 * np.sin(t)), 50.0
    scene = series(VoltageSource(V), resistor=Resistor(R), diode=Diode(1e-9, 0.025))
    model = ac.build(scene)
    assert len(model.state_names) == 1
    run = model.simulate(6.0, rtol=1e-10)

    def current(t):
        return 1e-9 * np.expm1(brentq(lambda v: V(t) - v - R * 1e-9 * np.expm1(v / 0.025), -3, 1, xtol=1e-15) / 0.025)

    exact = np.array([current(t) for t in run.t])
    assert np.max(np.abs(run[scene.resistor.i] - exact)) < 1e-10
    assert run.constraint_error() < 1e-12
    assert np.max(np.abs(run[scene.diode.v] + run[scene.resistor.v] - V(run.t))) < 1e-11


def test_rectifier_with_capacitor():
    """Diode, capacitor and load against an independent integration of the capacitor's voltage."""
    V = lambda t: 5 * np.sin(10 * t)  # noqa: E731
    scene = series(VoltageSource(V), Resistor(1.0), diode=Diode(1e-6, 0.05), capacitor=Capacitor(0.1))
    scene.load = Resistor(20.0)
    scene.connect(scene.load.pin_a, scene.capacitor.pin_a)
    scene.connect(scene.load.pin_b, scene.capacitor.pin_b)
    run = ac.build(scene).simulate(2.0, rtol=1e-9)

    def rate(t, u):
        drop = V(t) - u[0]
        v = brentq(lambda v: drop - v - 1e-6 * np.expm1(v / 0.05), -11, 1, xtol=1e-14)
        return [(1e-6 * np.expm1(v / 0.05) - u[0] / 20) / 0.1]

    other = solve_ivp(rate, (0, 2), [0.0], "LSODA", run.t, rtol=1e-10, atol=1e-12)
    assert np.max(np.abs(run[scene.capacitor.v] - other.y[0])) < 1e-6
    assert run.energy_error() < 1e-6


def test_bridge_of_four_diodes():
    """A block of several nonlinear equations; no current goes back, and the energy is accounted for."""
    scene = ac.System()
    scene.source, scene.diodes = VoltageSource(lambda t: 5 * np.sin(10 * t)), [Diode(1e-6, 0.05) for _ in range(4)]
    scene.inner, scene.smoother, scene.load, scene.ground = Resistor(0.5), Capacitor(0.05), Resistor(10.0), Ground()
    a, b, c, d = scene.diodes
    scene.connect(scene.source.pin_a, scene.inner.pin_a)
    scene.connect(scene.inner.pin_b, a.pin_a, b.pin_b)
    scene.connect(scene.source.pin_b, c.pin_a, d.pin_b)
    scene.connect(a.pin_b, c.pin_b, scene.smoother.pin_a, scene.load.pin_a)
    scene.connect(b.pin_a, d.pin_a, scene.smoother.pin_b, scene.load.pin_b, scene.ground.pin)
    model = ac.build(scene)
    assert model.state_names[0] == "smoother.v"
    run = model.simulate(1.0, rtol=1e-8)
    assert run.constraint_error() < 1e-11
    assert run.energy_error() < 1e-7
    assert np.min(run[a.i]) > -2e-6
    assert 2 < run[scene.smoother.v][-1] < 4
    for diode in scene.diodes:
        assert np.max(np.abs(run[diode.i] - 1e-6 * np.expm1(run[diode.v] / 0.05))) < 1e-9


def test_sensitivities_through_a_nonlinear_loop():
    """Also of the unknown of the loop at the start; against central differences."""
    R = ac.Parameter(50.0, "Ohm")
    scene = series(VoltageSource(lambda t: 2 * np.sin(t) + 0.5), Resistor(R), diode=Diode(), capacitor=Capacitor(0.1))
    model = ac.build(scene)
    start = {scene.capacitor.v: 0.1}
    found = model.sensitivities([0.0, 1.0], [R], start, rtol=1e-10)
    above, below = (model.simulate(1.0, start, parameters={R: 50 + d}, rtol=1e-11) for d in (0.01, -0.01))
    for variable in (scene.capacitor.v, scene.diode.v):
        for k in (0, -1):
            difference = (above[variable][k] - below[variable][k]) / 0.02
            assert abs(found[variable][k, 0] - difference) < 1e-6 * (1e-3 + abs(difference))


@pytest.mark.parametrize("volt", [1.0, 1e-6, 1e3])
def test_a_start_meets_the_law_of_a_diode_whatever_the_voltages(volt):
    """Also where the law is immense at what is much, and where a search begins; against a root-finder, in any unit."""
    scene = series(VoltageSource(0.5 * volt), Resistor(50.0), diode=Diode(1e-9 * volt, 0.025 * volt), capacitor=Capacitor(0.1))
    model = ac.build(scene)
    for charge in (0.1, -10.0, -100.0, 5.0, 40.0):
        exact = brentq(lambda v, c=charge: 0.5 - c - v - 50e-9 * np.expm1(v / 0.025), -60, 3, xtol=1e-15)
        for sketch in (None, -3.0, 1.0, 20.0):
            start = {scene.capacitor.v: charge * volt} | ({} if sketch is None else {scene.diode.v: ac.near(sketch * volt)})
            try:
                found = model.initial_state(start)
            except (ac.errors.StartValueError, ac.errors.AssemblyError):
                assert sketch is not None and sketch > 0  # currents of e^40 and more: said, not answered wrongly
                continue
            assert abs(found.x[1] / volt - exact) < 1e-9 * max(1.0, abs(exact))


def motor_arm() -> Pendulum:
    """A pendulum arm on a motor with gear: circuit of source, winding and electromotive force."""
    scene = Pendulum()
    scene.source, scene.resistance, scene.winding = VoltageSource(6.0), Resistor(0.8), Inductor(2e-3)
    scene.emf, scene.rotor, scene.gear, scene.ground = ElectromotiveForce(0.05), Inertia(1e-4), Gear(30.0), Ground()
    scene.connect(scene.source.pin_a, scene.resistance.pin_a)
    scene.connect(scene.resistance.pin_b, scene.winding.pin_a)
    scene.connect(scene.winding.pin_b, scene.emf.pin_a)
    scene.connect(scene.emf.pin_b, scene.source.pin_b, scene.ground.pin)
    scene.connect(scene.emf.flange, scene.rotor.flange_a)
    scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.hinge.flange)
    return scene


def test_motor_with_gear_moves_an_arm():
    """States q, v and the current; the rotor's inertia joins the joint's; against equations by hand."""
    scene = motor_arm()
    model = ac.build(scene)
    assert model.state_names == ("hinge.q", "hinge.v", "winding.i")
    assert model.functions.invariants is None
    run = model.simulate(1.0, {scene.hinge.q: 0.2}, rtol=1e-11)
    k, n, J = 0.05, 30.0, 1 / 3 + 1e-4 * 30**2

    def rate(t, x):
        q, v, i = x
        return [v, (n * k * i - G / 2 * np.sin(q)) / J, (6.0 - 0.8 * i - k * n * v) / 2e-3]

    other = solve_ivp(rate, (0, 1), [0.2, 0, 0], "Radau", run.t, rtol=1e-9, atol=1e-11)
    assert np.max(np.abs(run[scene.hinge.q] - other.y[0])) < 1e-6
    assert np.max(np.abs(run[scene.winding.i] - other.y[2])) < 1e-5
    assert np.max(np.abs(run[scene.rotor.w] - 30 * run[scene.hinge.v])) < 1e-12
    assert run.energy_error() < 1e-8


def test_controlled_motor_reaches_its_target():
    scene = motor_arm()
    scene.source = SignalVoltage()  # takes the battery's place
    scene = Pendulum()
    scene.amplifier, scene.resistance, scene.emf, scene.gear = (
        SignalVoltage(),
        Resistor(0.8),
        ElectromotiveForce(0.05),
        Gear(30.0),
    )
    scene.rotor, scene.ground, scene.sensor = Inertia(1e-4), Ground(), RotationSensor()
    scene.target, scene.controller = Constant(0.5), PID(60.0, 40.0, 6.0, filter_time=1e-3)
    scene.connect(scene.amplifier.pin_a, scene.resistance.pin_a)
    scene.connect(scene.resistance.pin_b, scene.emf.pin_a)
    scene.connect(scene.emf.pin_b, scene.amplifier.pin_b, scene.ground.pin)
    scene.connect(scene.emf.flange, scene.rotor.flange_a)
    scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.hinge.flange, scene.sensor.flange)
    scene.connect(scene.target.output, scene.controller.setpoint)
    scene.connect(scene.sensor.angle, scene.controller.measurement)
    scene.connect(scene.controller.output, scene.amplifier.signal)
    model = ac.build(scene)
    assert model.state_names == ("hinge.q", "hinge.v", "controller.x", "controller.f")
    run = model.simulate(20.0, rtol=1e-8)
    assert abs(run[scene.hinge.q][-1] - 0.5) < 1e-4
    # at rest the motor holds the arm: 30 k i = m g l / 2 sin q
    assert abs(30 * 0.05 * run[scene.emf.i][-1] - G / 2 * np.sin(run[scene.hinge.q][-1])) < 1e-3
    assert run.energy_error() < 1e-6


def test_current_source_and_resistors_without_a_state_beside_a_capacitor():
    """A ladder of 60 resistors, solved without loss of digits: potentials of a long line against a numeric solution."""
    n = 60
    scene = ac.System()
    scene.rungs, scene.rails = [Resistor(1.0) for _ in range(n)], [Resistor(1.0) for _ in range(n)]
    scene.source, scene.ground, scene.capacitor = CurrentSource(1.0), Ground(), Capacitor(1.0)
    scene.connect(scene.source.pin_b, scene.ground.pin, scene.capacitor.pin_b, *(rung.pin_b for rung in scene.rungs))
    scene.connect(scene.source.pin_a, scene.rails[0].pin_a)
    for k in range(n):
        scene.connect(scene.rails[k].pin_b, scene.rungs[k].pin_a)
        if k + 1 < n:
            scene.connect(scene.rungs[k].pin_a, scene.rails[k + 1].pin_a)
    scene.connect(scene.rungs[-1].pin_a, scene.capacitor.pin_a)
    model = ac.build(scene)
    assert model.state_names == ("capacitor.v",)
    y = model.functions.output(*(rung.v for rung in scene.rungs))(0.0, [0.3], [], [])
    M = 3 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    M[0, 0], M[-1], b = 2.0, np.eye(n)[-1], np.zeros(n)
    b[0], b[-1] = 1.0, 0.3
    assert np.max(np.abs(np.array(y).ravel() - np.linalg.solve(M, b))) < 1e-14


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e6])
def test_what_nonlinear_equations_give_leaves_states_at_rest(size):
    """A capacitor behind a diode begins without voltage where nothing says otherwise, whatever the diode's own voltage is by that."""
    scene = ac.System()
    scene.ground, scene.source, scene.load, scene.diode = (
        Ground(),
        VoltageSource(10.0 * size),
        Resistor(100.0),
        Diode(1e-9 * size, 0.025 * size),
    )
    scene.store, scene.leak = Capacitor(1e-3), Resistor(1000.0)
    scene.connect(scene.ground.pin, scene.source.pin_b, scene.store.pin_b, scene.leak.pin_b)
    scene.connect(scene.source.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.store.pin_a, scene.leak.pin_a)
    model = ac.build(scene)
    found = model.simulate(0.01)
    assert found[scene.store.v][0] == 0.0
    drop = brentq(lambda v: 100 * 1e-9 * np.expm1(v / 0.025) + v - 10, 0, 1, xtol=1e-15)
    assert abs(found[scene.diode.v][0] / size - drop) < 1e-12
    given = model.simulate(0.01, {scene.diode.v: 0.45 * size})  # then the capacitor has what is left of it
    assert abs(given[scene.store.v][0] / size - (10 - 0.45 - 100 * 1e-9 * np.expm1(0.45 / 0.025))) < 1e-9
