"""Forces for prescribed motions against closed forms, power balance, and the simulation that they drive."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.integrate
from scipy.interpolate import make_interp_spline

import acausal as ac
from acausal.analysis.actuation import actuated
from acausal.errors import MotionError, OptionError, StartValueError, UnknownVariableError
from acausal.outputs.functions import operations
from components import (
    ForceSource,
    Gear,
    Inertia,
    PositionSource,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    Spherical,
    Spring,
    Torque,
    TorqueSource,
    Universal,
    World,
)
from examples.robot_r3 import Arm as Arm6
from tests.analysis_scenes import Arm, Motor
from tests.formulations import composed, script
from tests.random_sketches import random_sketch
from tests.scenes import DoublePendulum, FourBar, Pendulum, bennett_linkage, chain

G = 9.81
T = np.linspace(0.0, 2.0, 101)
FEW = T[::5]


def test_a_pendulum_needs_the_torque_of_its_equation():
    scene = Pendulum(length=0.7, mass=1.3)
    found = ac.build(scene).inverse_dynamics(T, {scene.hinge.q: 0.4 * np.sin(3 * ac.time)}, [scene.hinge])
    q, q_ddot = 0.4 * np.sin(3 * T), -3.6 * np.sin(3 * T)
    exact = 1.3 * 0.7**2 / 3 * q_ddot + 1.3 * G * 0.35 * np.sin(q)
    np.testing.assert_allclose(found.force(scene.hinge), exact, atol=1e-12)
    np.testing.assert_allclose(found[scene.hinge.v], 1.2 * np.cos(3 * T), atol=1e-12)
    assert found.names == ("hinge.force",) and not found.free


def test_the_torques_found_make_the_arm_move_so():
    scene = Arm()
    model = ac.build(scene)
    a, b = 0.5 * np.sin(2 * T), 0.3 + 0.2 * T**2
    motions = {scene.shoulder.q: 0.5 * np.sin(2 * ac.time), scene.elbow.q: lambda t: 0.3 + 0.2 * t**2}
    found = model.inverse_dynamics(T, motions, scene.torques)
    run = model.simulate(2.0, found.start, inputs=found.inputs, rtol=1e-11, samples=T.size)
    np.testing.assert_allclose(run[scene.shoulder.q], a, atol=1e-9)
    np.testing.assert_allclose(run[scene.elbow.q], b, atol=1e-9)
    at_joints = model.inverse_dynamics(T, motions, [scene.elbow, scene.shoulder])
    np.testing.assert_allclose(at_joints.forces[::-1], found.forces, atol=1e-12)
    np.testing.assert_array_equal(found.series, np.column_stack([found.force(u) for u in scene.torques]))
    sampled = model.inverse_dynamics(T, {scene.shoulder.q: a, scene.elbow.q: b}, scene.torques)
    np.testing.assert_allclose(sampled.forces, found.forces, atol=2e-4)


def energy(found, model: ac.Model) -> np.ndarray:
    """Kinetic and potential, (m,)."""
    none = np.zeros((0, found.t.size))
    u = none if not model.input_names else np.zeros((len(model.input_names), found.t.size))
    return sum(
        np.array(f(found.t[None, :], found.x, u, none)).ravel()
        for f in (model.functions.kinetic_energy, model.functions.potential_energy)
    )  # type: ignore[return-value]


@pytest.mark.parametrize("make", [FourBar, bennett_linkage])
def test_the_work_of_the_force_is_the_energy_of_the_loop(make):
    scene = make()
    model = ac.build(scene)
    joint = scene.a if make is FourBar else scene.joints[0]
    begin = float(model.initial_state().x[model.state_names.index("a.q" if make is FourBar else "joints[0].q")])
    found = model.inverse_dynamics(T, {joint.q: begin + 0.4 * np.sin(2 * ac.time) ** 2}, [joint])
    work = make_interp_spline(T, found.force(joint) * found[joint.v], k=5).antiderivative()(T)
    change = energy(found, model) - energy(found, model)[0]
    np.testing.assert_allclose(work, change, atol=1e-7 * np.max(np.abs(change)))


def test_redundant_forces_in_a_loop_are_the_least():
    scene = FourBar()
    model = ac.build(scene)
    joints = [scene.a, scene.b, scene.c, scene.d]  # one of them closes the loop
    motion = {scene.a.q: 0.3 * ac.time}
    times = T[::10]
    all_of_them, one = model.inverse_dynamics(times, motion, joints), model.inverse_dynamics(times, motion, [scene.a])
    rates = np.array([all_of_them[j.v] / all_of_them[scene.a.v] for j in joints])
    # the same power, with forces along the rates: no smaller set does it
    np.testing.assert_allclose(np.sum(all_of_them.forces * rates, axis=0), one.forces[0], atol=1e-11)
    np.testing.assert_allclose(all_of_them.forces, rates * one.forces[0] / np.sum(rates**2, axis=0), atol=1e-11)


def test_a_tip_is_led_along_a_line():
    scene = Arm()
    tip = scene.lower.tip.position
    line = {tip[0]: 0.9 - 0.1 * ac.time**2, tip[2]: 0.2}
    start = {scene.shoulder.q: -0.5, scene.elbow.q: 1.0}
    found = ac.build(scene).inverse_dynamics(FEW, line, scene.torques, start)
    np.testing.assert_allclose(found[tip], np.column_stack([0.9 - 0.1 * FEW**2, 0 * FEW, 0.2 + 0 * FEW]), atol=1e-12)
    assert np.all(found[scene.elbow.q] > 0)
    other = ac.build(scene).inverse_dynamics(FEW, line, scene.torques, {scene.shoulder.q: 0.5, scene.elbow.q: -1.0})
    assert np.all(other[scene.elbow.q] < 0)


def test_a_force_on_a_coordinate_does_the_work_of_its_rate():
    scene = Pendulum(length=0.8, mass=2.0)
    push = scene.rod.tip.position[0]
    found = ac.build(scene).inverse_dynamics([0.0], {scene.hinge.q: -0.6}, [push])
    assert found.force(push)[0] == pytest.approx(2.0 * G / 2 * np.tan(0.6), rel=1e-12)


def cart(source: bool = False) -> ac.System:
    """A cart on a rail with a hanging rod; the cart is pushed, or its place is given."""
    scene = ac.System()
    scene.force = ac.Input("N")
    scene.world, scene.rail, scene.hinge = World(), Prismatic("x"), Revolute("y")
    scene.cart, scene.rod = RigidBody.box(1.0, (0.4, 0.2, 0.1)), RigidBody.rod(0.3, (0, 0, -0.6))
    scene.motor = PositionSource(lambda t: 0.2 * np.sin(2 * t) ** 2) if source else ForceSource(scene.force)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.cart.frame)
    scene.connect(scene.cart.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.motor.flange, scene.rail.flange)
    return scene


def test_what_is_not_prescribed_moves_by_its_own_dynamics():
    scene, led = cart(), cart(source=True)
    motion = {scene.rail.q: 0.2 * np.sin(2 * ac.time) ** 2}
    found = ac.build(scene).inverse_dynamics(T, motion, [scene.force], {scene.hinge.q: 0.3})
    assert found.free == ("hinge.q", "hinge.v") and "own dynamics" in str(found)
    run = ac.build(led).simulate(2.0, {led.hinge.q: 0.3}, rtol=1e-11, samples=T.size)
    np.testing.assert_allclose(found[scene.hinge.q], run[led.hinge.q], atol=1e-8)
    np.testing.assert_allclose(found.forces[0], -run[led.motor.flange.f], atol=1e-7)


def test_a_voltage_is_found_through_an_inductor():
    R, L, k, J, d = 1.2, 3e-3, 0.05, 2e-4, 1e-3
    scene = Motor(ac.Input("V"), R, L, k, J, d)
    found = ac.build(scene).inverse_dynamics(FEW, {scene.rotor.w: 5 * np.sin(ac.time)}, [scene.voltage])
    w, w1, w2 = 5 * np.sin(FEW), 5 * np.cos(FEW), -5 * np.sin(FEW)
    i, i1 = (J * w1 + d * w) / k, (J * w2 + d * w1) / k
    np.testing.assert_allclose(found.forces[0], R * i + L * i1 + k * w, atol=1e-9)
    np.testing.assert_allclose(found[scene.inductor.i], i, atol=1e-10)


def test_a_ball_is_rolled_along_a_path_by_the_least_torque():
    scene = ac.System()
    scene.torque = [ac.Input("N*m") for _ in range(3)]
    scene.world, scene.contact, scene.ball = World(), RollingBall(0.1), RigidBody.ball(0.5, 0.1)
    scene.motor = Torque(scene.torque)
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    scene.connect(scene.motor.frame, scene.ball.frame)
    place, times = scene.ball.frame.position, T[::10]
    path = {place[0]: 0.3 * np.sin(ac.time), place[1]: 0.1 * ac.time**2}
    found = ac.build(scene).inverse_dynamics(times, path, scene.torque)
    need = 7 / 5 * 0.5 * 0.1  # (2/5 m r^2 + m r^2) / r
    exact = [-need * 0.2 + 0 * times, need * -0.3 * np.sin(times), 0 * times]
    np.testing.assert_allclose(found.forces, exact, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found.x[:4], axis=0), 1.0, atol=1e-12)


def test_the_function_gives_the_series():
    scene = Arm()
    model = ac.build(scene)
    motions = {scene.shoulder.q: 0.5 * np.sin(2 * ac.time), scene.elbow.q: 0.3 + 0.2 * ac.time**2}
    found = model.inverse_dynamics(FEW, motions, [scene.shoulder, scene.elbow])
    function = model.inverse_dynamics_function([scene.shoulder.q, scene.elbow.q], [scene.shoulder, scene.elbow])
    a = np.vstack([-2 * np.sin(2 * FEW), 0.4 + 0 * FEW])
    forces = np.array(function(FEW[None, :], found.x, a, np.zeros((2, FEW.size)), np.zeros((0, FEW.size))))
    np.testing.assert_allclose(forces, found.forces, atol=1e-11)
    loop = FourBar()
    model = ac.build(loop)
    found = model.inverse_dynamics([0.0], {loop.a.q: 0.2 + 0.5 * ac.time**2}, [loop.a, loop.c, loop.d])
    function = model.inverse_dynamics_function([loop.a.q], [loop.a, loop.c, loop.d])
    np.testing.assert_allclose(np.array(function(0, found.x[:, 0], 1.0, [], [])), found.forces, atol=1e-11)


def sprung(count: int) -> ac.System:
    """A chain of joints of all kinds with a spring to the ground."""
    scene = chain(count, lambda k: (Revolute("x"), Universal(), Prismatic("z"), Spherical())[k % 4])
    scene.spring = Spring(30.0, 0.2)
    scene.connect(scene.world.at((1, 0, 0)), scene.spring.point_a)
    scene.connect(scene.links[-1].frame, scene.spring.point_b)
    return scene


@pytest.mark.parametrize("count", [1, 3, 4, 7])
def test_forces_of_a_fully_driven_tree_cost_less_than_its_accelerations_and_give_those_asked_for(count):
    scene = sprung(count)
    model = ac.build(scene)
    function = model.inverse_dynamics_function([joint.v for joint in scene.joints], scene.joints)
    assert function.n_instructions() < 0.6 * model.operations or count < 7
    forward = actuated(model.functions, scene.joints).functions.explicit_dynamics
    rng, n = np.random.default_rng(count), function.size1_in(2)
    x = model.initial_state(
        {joint.v: rng.normal(size=joint.v.size).tolist() if joint.v.size > 1 else rng.normal() for joint in scene.joints}
    ).x
    a = rng.normal(size=n)
    u = np.array(function(0, x, a, [], [])).ravel()
    got = np.array(forward(0, x, u, [])).ravel()[-n:]
    np.testing.assert_allclose(got, a, atol=1e-9)


def geared(ratio: float, rotor: float) -> Arm6:
    """The six-axis robot with a motor, its rotor and a gear at each joint."""
    scene = Arm6()
    scene.motors = [TorqueSource(ac.Input("N*m")) for _ in scene.joints]
    scene.rotors = [Inertia(rotor) for _ in scene.joints]
    scene.gears = [Gear(ratio) for _ in scene.joints]
    for motor, shaft, gear, joint in zip(scene.motors, scene.rotors, scene.gears, scene.joints, strict=True):
        scene.connect(motor.flange, shaft.flange_a)
        scene.connect(shaft.flange_b, gear.flange_a)
        scene.connect(gear.flange_b, joint.flange)
    return scene


@pytest.mark.parametrize(("ratio", "rotor"), [(100.0, 1e-3), (-0.5, 30.0), (1e4, 1e-9)])
def test_rotors_of_a_fully_driven_robot_cost_next_to_nothing(ratio, rotor):
    """Newton and Euler once, whatever is geared to the joints: accelerations are given, so nothing has to be solved."""
    scene = geared(ratio, rotor)
    model = ac.build(scene)
    f, n = model.functions, 6
    torques = model.inverse_dynamics_function([joint.q for joint in scene.joints], model.system.flat.inputs)
    forces = model.inverse_dynamics_function([joint.q for joint in scene.joints], scene.joints)
    assert max(torques.n_instructions(), forces.n_instructions()) < 660 and operations(f.residual_dynamics) < 600
    rng = np.random.default_rng(5)
    for _ in range(4):
        x, u = rng.normal(size=2 * n), rng.normal(size=n) * 100 / ratio
        x_dot = np.array(f.explicit_dynamics(0, x, u, [])).ravel()
        np.testing.assert_allclose(
            np.array(torques(0, x, x_dot[n:], 0 * u, [])).ravel(), u, rtol=1e-8, atol=1e-8 * 100 / abs(ratio)
        )
        assert np.max(np.abs(np.array(f.residual_dynamics(0, x, x_dot, [], u, [])))) < 1e-9 * 100


def test_motions_that_cannot_be_made_are_said():
    scene = DoublePendulum()
    model = ac.build(scene)
    both = {scene.shoulder.q: np.sin(ac.time), scene.elbow.q: 0.1}
    with pytest.raises(MotionError, match="2 motions, 1 force"):
        model.inverse_dynamics(T, both, [scene.elbow])
    tip = scene.lower.tip.position
    with pytest.raises(MotionError, match="cannot follow"):
        model.inverse_dynamics(T, {tip[0]: 1.5 + ac.time, tip[2]: -0.2}, [scene.elbow, scene.shoulder], {scene.elbow.q: -1.0})
    loop = FourBar()
    with pytest.raises(MotionError, match=r"cannot follow: .*d\.q"):
        ac.build(loop).inverse_dynamics(T, {loop.a.q: 0.2 * ac.time, loop.d.q: 0.5}, [loop.a, loop.d])


def test_wrong_questions_are_answered_in_words():
    scene = DoublePendulum()
    model = ac.build(scene)
    good, joints = {scene.shoulder.q: 0.3}, [scene.shoulder]
    with pytest.raises(OptionError, match="ascending"):
        model.inverse_dynamics([1.0, 0.5], good, joints)
    with pytest.raises(OptionError, match="must be a list"):
        model.inverse_dynamics(T, good, scene.shoulder)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="is empty"):
        model.inverse_dynamics(T, good, [])
    with pytest.raises(OptionError, match="stands twice"):
        model.inverse_dynamics(T, good, [scene.shoulder, scene.shoulder])
    with pytest.raises(OptionError, match="not an input"):
        model.inverse_dynamics(T, good, [ac.Input()])
    with pytest.raises(OptionError, match="position or an angle"):
        model.inverse_dynamics(T, good, [scene.shoulder.v])
    with pytest.raises(OptionError, match="nothing to work on"):
        model.inverse_dynamics(T, good, [scene.upper.tip.position[1]])
    with pytest.raises(OptionError, match="give motions="):
        model.inverse_dynamics(T, [scene.shoulder.q], joints)  # type: ignore[arg-type]
    for motion in (None, "up"):
        with pytest.raises(OptionError, match="Give a number, an expression"):
            model.inverse_dynamics(T, {scene.shoulder.q: motion}, joints)  # type: ignore[dict-item]
    with pytest.raises(OptionError, match="not 'soon'"):
        model.inverse_dynamics("soon", good, joints)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="must be a list"):
        model.inverse_dynamics_function(scene.shoulder.q, joints)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="not a variable"):
        model.inverse_dynamics(T, {3: 0.3}, joints)  # type: ignore[dict-item]
    with pytest.raises(OptionError, match=r"ac\.time and parameters only"):
        model.inverse_dynamics(T, {scene.shoulder.q: scene.elbow.q}, joints)
    with pytest.raises(OptionError, match="cannot be differentiated"):
        model.inverse_dynamics(T, {scene.shoulder.q: lambda t: math.sin(t)}, joints)
    with pytest.raises(OptionError, match="at least 6"):
        model.inverse_dynamics([0.0, 1.0], {scene.shoulder.q: [0.0, 1.0]}, joints)
    with pytest.raises(OptionError, match="1 finite numbers"):
        model.inverse_dynamics(T, {scene.shoulder.q: np.full(T.size, np.nan)}, joints)
    with pytest.raises(OptionError, match="has 2 entries"):
        model.inverse_dynamics(T, {scene.shoulder.q: [0.0, 1.0]}, joints)
    with pytest.raises(OptionError, match="at most as many"):
        model.inverse_dynamics_function([scene.shoulder.q, scene.elbow.q], joints)
    with pytest.raises((UnknownVariableError, StartValueError)):
        model.inverse_dynamics(T, {Pendulum().hinge.q: 0.3}, joints)
    with pytest.raises(UnknownVariableError, match="not among the unknowns"):
        model.inverse_dynamics([0.0], {scene.shoulder.q: 0.3}, joints).force(scene.elbow)


@pytest.mark.parametrize(
    "drawn",
    [
        (["Prismatic", "Screw"], ["loop", "loop"], 3, False, 1),  # a row that nothing moves is off by rounding
        (["Screw", "Revolute", "Screw"], ["spherical"], 2, False, 5),
        (["Revolute"], ["planar", "spherical"], 2, False, 11),
    ],
)
def test_powers_of_forces_are_what_energies_and_losses_grow_by(drawn):
    """Random linkages, led along by as many of their joints as they have freedoms."""
    sketch = random_sketch(*drawn)
    scene = composed(script(sketch))
    model = ac.build(scene)
    single = [getattr(scene, f"j{k}") for k, j in enumerate(sketch.joints) if j.kind in ("Revolute", "Prismatic", "Screw")]
    driven: list[Any] = []
    for joint in single:  # those that the others do not move
        try:
            model.linearize(states=[v for one in (*driven, joint) for v in (one.q, one.v)])
        except OptionError as error:
            if "depend on one another" in str(error) or "cannot change" in str(error):
                continue
        driven.append(joint)
        if len(driven) == model.degrees_of_freedom:
            break
    assert len(driven) == model.degrees_of_freedom
    began = model.simulate(1e-6, samples=2)
    times = np.linspace(0.0, 0.4, 201)
    motions = {j.q: began[j.q][0] + 0.05 * (1 - np.cos((3 + k) * ac.time)) for k, j in enumerate(driven)}
    found = model.inverse_dynamics(times, motions, driven)
    power = np.sum([found.force(j) * found[j.v] for j in driven], axis=0)
    u = np.zeros((0, times.size))
    p = np.repeat(model.initial_state().p[:, None], times.size, axis=1)
    functions = model.functions
    kinetic, potential, loss = (
        np.array(f(times[None, :], found.x, u, p)).ravel()
        for f in (functions.kinetic_energy, functions.potential_energy, functions.output(functions.outputs.power_loss))
    )
    gained = kinetic + potential - kinetic[0] - potential[0]
    assert np.max(np.abs(gained)) > 1e-3
    put_in = scipy.integrate.cumulative_simpson(power - loss, x=times, initial=0)
    assert put_in == pytest.approx(gained, abs=1e-6 * np.max(np.abs(gained)))


def test_speeds_in_the_world_of_what_is_not_prescribed_are_those_given():
    """A load hangs on a crab that is led along; its speed over ground is given, and the found force moves both alike."""
    scene = ac.System()
    scene.world, scene.rail, scene.hinge = World(), Prismatic("x"), Spherical()
    scene.crab, scene.load = RigidBody.box(2.0, (0.2, 0.2, 0.2)), RigidBody.rod(1.0, (0, 0, -0.8), radius=0.1)
    scene.force = ac.Input("N")
    scene.drive = ForceSource(scene.force)
    scene.connect(scene.drive.flange, scene.rail.flange)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.crab.frame)
    scene.connect(scene.crab.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.load.frame)
    model, tip, spin = ac.build(scene), scene.load.tip, scene.load.frame.angular_velocity
    given = {tip.velocity: (0.7, 0.2, 0.0), spin[2]: 1.5}
    path = 0.3 * ac.time + 0.2 * ac.time**2
    run = None
    for more in ({}, {scene.rail.q: 1.0, scene.rail.v: 5.0}):  # where the rail goes is said by the motion
        found = model.inverse_dynamics(np.linspace(0, 1, 201), {scene.rail.q: path}, [scene.force], given | more)
        assert found[tip.velocity][0] == pytest.approx([0.7, 0.2, 0.0], abs=1e-13)
        assert found[spin][0] == pytest.approx([0.25, -0.5, 1.5], abs=1e-13)
        run = run or model.simulate(1.0, given | {scene.rail.q: 0.0, scene.rail.v: 0.3}, inputs=found.inputs, samples=201)
        assert np.max(np.abs(run[scene.rail.q] - 0.3 * run.t - 0.2 * run.t**2)) < 1e-8
        assert np.max(np.abs(run[tip.position] - found[tip.position])) < 1e-8
