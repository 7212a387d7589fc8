"""Independent coordinates: dimensions, closed forms, exact derivatives, and motions from chart to chart."""

from __future__ import annotations

import functools
import itertools
import pickle

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import OptionError, StartValueError, UnknownVariableError
from components import (
    AngleSource,
    Force,
    Free,
    Gear,
    Inertia,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    RollingDisk,
    RotationalSpring,
    Spherical,
    TorqueSource,
    TranslationalGround,
    TranslationalSpring,
    Universal,
    World,
)  # fmt: skip
from examples.bicycle import Bicycle
from tests.scenes import DoublePendulum, FourBar, Pendulum, bennett_linkage

G = 9.81


def joined(scene, *joints):
    """Connect joints: (joint, one connector, the other)."""
    for joint, a, b in joints:
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)
    return scene


def slider_crank(crank: float = 0.3, rod: float = 1.0) -> ac.System:
    """Crank of 1 kg, rod of 2 kg, piston of 1.5 kg that slides along x; gravity along -z."""
    scene = ac.System()
    scene.world, scene.slide = World((0, 0, -G)), Prismatic("x")
    scene.a, scene.b, scene.c = (Revolute("y") for _ in range(3))
    scene.crank, scene.rod = RigidBody.rod(1.0, (crank, 0, 0)), RigidBody.rod(2.0, (rod, 0, 0))
    scene.piston = RigidBody.box(1.5, (0.1, 0.1, 0.1))
    return joined(
        scene,
        (scene.a, scene.world.frame, scene.crank.frame),
        (scene.b, scene.crank.tip, scene.rod.frame),
        (scene.c, scene.rod.tip, scene.piston.frame),
        (scene.slide, scene.world.frame, scene.piston.frame),
    )


def free_body() -> ac.System:
    scene = ac.System()
    scene.world, scene.free, scene.body = World(None), Free(), RigidBody(1.0, (1.0, 2.0, 2.5))
    return joined(scene, (scene.free, scene.world.frame, scene.body.frame))


def rolling_ball() -> ac.System:
    scene = ac.System()
    scene.world, scene.contact, scene.ball = World(), RollingBall(0.1), RigidBody(1.0, (0.003, 0.004, 0.005), (0, 0, 0.02))
    return joined(scene, (scene.contact, scene.world.frame, scene.ball.frame))


def geared_pendulums() -> ac.System:
    """Two arms that a gear holds together."""
    scene = Pendulum()
    scene.pivot, scene.arm, scene.gear = Revolute("y"), RigidBody.rod(2.0, (0, 0, -0.5)), Gear(-2.0)
    joined(scene, (scene.pivot, scene.world.at((1, 0, 0)), scene.arm.frame))
    scene.connect(scene.hinge.flange, scene.gear.flange_a)
    scene.connect(scene.pivot.flange, scene.gear.flange_b)
    return scene


def geared_motor() -> ac.System:
    """A rotor drives the shoulder of a double pendulum through a gear and an elastic shaft."""
    scene = DoublePendulum()
    scene.motor, scene.rotor, scene.gear, scene.shaft = TorqueSource(0.2), Inertia(0.01), Gear(20.0), RotationalSpring(50.0)
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    scene.connect(scene.rotor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.shaft.flange_a)
    scene.connect(scene.shaft.flange_b, scene.shoulder.flange)
    return scene


def spatial_loop() -> ac.System:
    """Two swings joined by a bar: ball joints in a loop, five freedoms."""
    scene = ac.System()
    scene.world, scene.A, scene.B, scene.C, scene.D = World(), Spherical(), Spherical(), Spherical(), Universal()
    scene.one = RigidBody(1.0, (0.1, 0.12, 0.05), (0, 0, -0.5))
    scene.two = RigidBody(1.0, (0.1, 0.12, 0.05), (0, 0, -0.5), position=(1, 0, 0))
    scene.bar = RigidBody(1.0, (0.1, 0.2, 0.25), (0.5, 0, 0), position=(0, 0, -1))
    return joined(
        scene,
        (scene.A, scene.world.frame, scene.one.frame),
        (scene.B, scene.world.at((1, 0, 0)), scene.two.frame),
        (scene.C, scene.one.at((0, 0, -1)), scene.bar.frame),
        (scene.D, scene.bar.at((1.1, 0, 0)), scene.two.at((0, 0, -1.2))),
    )


def swings(length: float = 0.7) -> ac.System:
    """Two equal links on the ceiling and a bar between their ends that stays level."""
    scene = ac.System()
    scene.world = World((0, 0, -G))
    scene.left, scene.right = (RigidBody.rod(1.0, (0, 0, -length)) for _ in range(2))
    scene.bar = RigidBody.rod(2.0, (1, 0, 0))
    scene.a, scene.b, scene.c, scene.d = (Revolute("y") for _ in range(4))
    return joined(
        scene,
        (scene.a, scene.world.frame, scene.left.frame),
        (scene.b, scene.left.tip, scene.bar.frame),
        (scene.c, scene.bar.tip, scene.right.tip),
        (scene.d, scene.world.at((1, 0, 0)), scene.right.frame),
    )


@pytest.mark.parametrize(
    ("make", "positions", "velocities"),
    [
        (DoublePendulum, 2, 2), (FourBar, 1, 1), (slider_crank, 1, 1), (bennett_linkage, 1, 1), (free_body, 6, 6),
        (rolling_ball, 5, 3), (geared_pendulums, 1, 1), (spatial_loop, 5, 5),
    ],
)  # fmt: skip
def test_dimension_is_that_of_positions_and_of_velocities(make, positions, velocities):
    minimal = ac.build(make()).minimal()
    assert len(minimal.chart.choice.positions) == positions
    assert len(minimal.chart.choice.rates) == velocities
    assert len(minimal.state_names) == positions + velocities
    y = minimal.start + 0.1 * np.random.default_rng(0).normal(size=positions + velocities)
    x = np.array(minimal.expand(0, y, [], [])).ravel()
    assert np.max(np.abs(np.array(minimal.restrict(x)).ravel() - y)) < 1e-13
    assert float(minimal.residual(0, y, [], [])) < 1e-13


def test_without_constraints_nothing_changes():
    model = ac.build(DoublePendulum())
    minimal = model.minimal()
    x = np.random.default_rng(0).normal(size=4)
    assert minimal.state_names == model.state_names
    rates = [np.array(f(0, x, [], [])) for f in (minimal.explicit_dynamics, model.functions.explicit_dynamics)]
    assert np.array_equal(*rates)
    assert minimal.explicit_dynamics.n_instructions() == model.functions.explicit_dynamics.n_instructions()


@pytest.mark.parametrize("steps", [4, 8])
def test_slider_crank_has_the_acceleration_of_its_closed_form(steps):
    """I(q) q'' + I'(q) q'^2 / 2 = -V'(q): kinetic energy and height of all centres by the crank's angle, by hand."""
    r, rod, m1, m2, m3 = 0.3, 1.0, 1.0, 2.0, 1.5
    q, v = ca.SX.sym("q"), ca.SX.sym("v")
    tilt = ca.asin(r * ca.sin(q) / rod)
    middle = ca.vertcat(r * ca.cos(q) + rod / 2 * ca.cos(tilt), -r * ca.sin(q) / 2)
    piston = r * ca.cos(q) + rod * ca.cos(tilt)
    rate = ca.jacobian(middle, q)
    inertia = (
        m1 * r**2 / 3 + m2 * ca.sumsqr(rate) + m2 * rod**2 / 12 * ca.jacobian(tilt, q) ** 2 + m3 * ca.jacobian(piston, q) ** 2
    )
    potential = -G * (m1 * r / 2 * ca.sin(q) + m2 * r / 2 * ca.sin(q))
    a = -(ca.jacobian(potential, q) + ca.jacobian(inertia, q) * v**2 / 2) / inertia
    by_hand = ca.Function("a", [q, v], [a, ca.jacobian(a, q)])
    scene = slider_crank(r, rod)
    minimal = ac.build(scene).minimal({scene.a.q: 0.5}, prefer=[scene.a.q], steps=steps)
    assert minimal.state_names == ("a.q", "a.v")
    slope = minimal.explicit_dynamics.factory("slope", ["t", "y", "u", "p"], ["jac:y_dot:y"])
    for angle in np.linspace(-1.0, 2.0, 7):
        expected, expected_slope = by_hand(angle, 3.0)
        assert abs(float(minimal.explicit_dynamics(0, [angle, 3.0], [], [])[1] - expected)) < 1e-11
        assert abs(float(slope(0, [angle, 3.0], [], [])[1, 0] - expected_slope)) < 1e-10


def simulated(make, start, end, prefer=(), **options):
    """The motion in charts, and the largest difference from the model's own."""
    scene = make()
    model = ac.build(scene)
    given = {eval(key, {"s": scene}): value for key, value in start.items()}
    minimal = model.minimal(given, prefer=[eval(key, {"s": scene}) for key in prefer])
    motion = minimal.simulate(end, rtol=1e-10, **options)
    own = motion.x[list(model.functions.space.places)]  # charts know all coordinates of the tree
    return motion, float(np.max(np.abs(own - model.simulate(end, given, rtol=1e-12).x)))


@pytest.mark.parametrize(
    ("make", "start", "end", "prefer", "charts"),
    [
        (slider_crank, {"s.a.q": 0.5, "s.a.v": 15.0}, 2.0, ["s.slide.q"], 8),
        (bennett_linkage, {"s.joints[0].v": 3.0}, 2.0, [], 2),
        (free_body, {"s.free.v": (0.1, 8.0, 0.1, 0.1, 0.2, 0.3)}, 3.0, [], 3),
        (rolling_ball, {"s.contact.v": (3.0, -2.0, 1.0)}, 3.0, [], 2),
        (DoublePendulum, {"s.shoulder.q": 2.0}, 3.0, [], 1),
        (geared_pendulums, {"s.hinge.q": 1.0}, 3.0, [], 1),
        (geared_motor, {"s.shoulder.q": 1.0}, 1.0, [], 1),
        (spatial_loop, {"s.A.v": (1.0, 2.0, 3.0)}, 1.0, [], 2),
    ],
)  # fmt: skip
def test_motion_is_that_of_the_model(make, start, end, prefer, charts):
    large = make in (bennett_linkage, spatial_loop)  # their compilation takes longer than the motion
    motion, error = simulated(make, start, end, prefer, compiled=not large)
    assert error < 3e-8
    assert len(motion.charts) >= charts
    assert motion.constraint_error() < 1e-12
    assert motion.energy_error() < 1e-9 or make is geared_motor


def test_events_are_found_and_stop_in_whatever_chart_they_lie():
    scene = slider_crank()
    model, start = ac.build(scene), {scene.a.q: 0.5, scene.a.v: 15.0}
    events = [ac.when(scene.slide.q - 1.0), ac.when(scene.a.q - 20.0, stop=True)]
    motion, run = (m.simulate(2.0, start, rtol=1e-10, events=events) for m in (model.minimal(prefer=[scene.slide.q]), model))
    assert len({chart.choice for chart in motion.charts}) > 1 and len(motion.charts) == len(motion.pieces)
    assert len(motion.events) == len(run.events) > 6 and motion.t[-1] == motion.events[-1].time < 2.0
    for one, other in zip(motion.events, run.events, strict=True):
        assert one.when is other.when and one.direction == other.direction and abs(one.time - other.time) < 1e-8
        assert np.max(np.abs(one.x - other.x)) < 1e-6
    again = pickle.loads(pickle.dumps(motion))
    assert np.array_equal(again.x, motion.x) and len(again.pieces) == len(motion.pieces)
    np.testing.assert_allclose(again.at(0.7).x, motion.at(0.7).x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_what_bends_and_jumps_ends_steps_in_whatever_chart_it_lies(rtol):
    """A piston that meets a constant load and a one-sided spring on its way."""
    scene = slider_crank()
    x = scene.slide.q
    scene.load = Force((np.where(x > 0.9, -5.0, 0.0) - 400 * np.maximum(x - 1.1, 0), 0, 0))
    scene.connect(scene.load.point, scene.piston.frame)
    model, start = ac.build(scene), {scene.a.q: 0.4, scene.a.v: 8.0}
    exact = model.simulate(2.0, start, rtol=1e-13)[x]
    run = model.minimal(start, prefer=[x]).simulate(2.0, start, rtol=rtol)
    assert len(run.charts) > 3 and exact.max() > 1.2 and exact.min() < 0.8
    assert np.max(np.abs(run[x] - exact)) < 10 * rtol


def test_an_interrupt_keeps_the_motion_through_charts():
    scene = slider_crank()
    model = ac.build(scene)

    def stop(part: float) -> None:
        if part > 1e-5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        model.minimal({scene.a.q: 0.5, scene.a.v: 15.0}, prefer=[scene.slide.q]).simulate(1e5, progress=stop)
    run = caught.value.run  # type: ignore[attr-defined]
    assert len(run.charts) > 1 and 1 < run.t[-1] < 1e4 and np.isfinite(run[scene.slide.q]).all()


def test_an_old_motion_of_charts_answers_with_a_warning():
    motion = ac.build(DoublePendulum()).minimal().simulate(0.1, samples=2, compiled=False)
    with pytest.warns(DeprecationWarning, match="the motion itself"):
        assert motion.trajectory is motion


def test_crank_turns_fully_with_the_rocker_preferred():
    motion, error = simulated(FourBar, {"s.a.q": -0.5, "s.a.v": 8.0}, 5.0, ["s.d.q"])
    assert motion.x[0, -1] > 6 * np.pi
    used = {chart.independent[0] for chart in motion.charts}
    assert "d.q" in used and len(used) > 1
    assert any(not chart.preferred for chart in motion.charts)
    assert error < 3e-8


def vehicle(base: float = 1.2, radius: float = 0.25, unit: float = 1.0) -> ac.System:
    """A cart on two axles, the front one on a turntable, each wheel of four on a hub of its own; lengths and gravity in `unit`."""
    R = radius * unit
    scene = ac.System()
    scene.world = World((0, 0, -G * unit))
    scene.frame = RigidBody(5.0, tuple(unit**2 * i for i in (0.1, 0.4, 0.5)), position=(0, 0, R))
    scene.bogie, scene.pivot = (
        RigidBody(2.0, tuple(unit**2 * i for i in (0.1, 0.05, 0.12)), position=(base * unit, 0, R)),
        Revolute("z"),
    )
    joined(scene, (scene.pivot, scene.frame.at((base * unit, 0, 0)), scene.bogie.frame))
    scene.wheels, scene.hubs, scene.contacts = [], [], []
    for body, width in ((scene.frame, 0.4), (scene.frame, -0.4), (scene.bogie, 0.3), (scene.bogie, -0.3)):
        wheel, hub, contact = RigidBody.disk(1.0, R, axis="y", position=(0, 0, R)), Revolute("y"), RollingDisk(R)
        scene.wheels, scene.hubs, scene.contacts = [*scene.wheels, wheel], [*scene.hubs, hub], [*scene.contacts, contact]
        joined(scene, (hub, body.at((0, width * unit, 0)), wheel.frame), (contact, scene.world.frame, wheel.frame))
    return scene


@functools.cache
def standing() -> tuple[ac.System, ac.Model]:
    scene = vehicle()
    return scene, ac.build(scene)


@pytest.mark.parametrize("end", [0.1, 0.2, 1.0, 10.0])
def test_a_vehicle_that_stands_still_costs_next_to_nothing(end):
    """Its states are nothing but what rounding makes of them, and no step is too long for these."""
    scene, model = standing()
    run = model.simulate(end, rtol=1e-9, samples=3, progress=False)
    assert run.statistics.evaluations < 3000
    assert np.max(np.abs(run[scene.pivot.q])) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("make", [vehicle, Bicycle])
def test_a_vehicle_is_followed_for_a_thousand_turns_of_its_wheels_on_one_chart(make):
    scene = make()
    model = ac.build(scene)
    hub = scene.rear_hub if isinstance(scene, Bicycle) else scene.hubs[0]
    start = (
        scene.start(5.0, 0.05) if isinstance(scene, Bicycle) else {scene.pivot.q: 0.2, scene.pivot.v: 0.0, hub.v: ac.near(60.0)}
    )
    minimal = model.minimal(start)
    end = 400.0 if isinstance(scene, Bicycle) else 110.0
    motion = minimal.simulate(end, rtol=1e-9, compiled=False)  # its compilation takes longer than the motion
    assert abs(motion[hub.q][-1]) > 1000 * 2 * np.pi
    assert {chart.choice for chart in motion.charts} == {minimal.chart.choice} and len(motion.charts) <= 2
    assert motion.constraint_error() < 1e-10
    assert motion.energy_error() < 1e-8


@pytest.mark.parametrize("power", [-15, -5, 15])
def test_charts_are_the_same_in_all_units_of_length(power):
    unit = 4.0**power
    for make, prefer in ((lambda u: slider_crank(0.3 * u, 1.0 * u), "slide"), (lambda u: vehicle(unit=u), "pivot")):
        charts = []
        for u in (1.0, unit):
            scene = make(u)
            charts.append(ac.build(scene).minimal(prefer=[getattr(scene, prefer).q]).chart)
        one, other = charts
        assert one.choice == other.choice
        assert abs(one.conditioning - other.conditioning) < 1e-9 * one.conditioning


@pytest.mark.parametrize("order", [(1e-7, 1e6), (1e9, 1e-9)])
def test_a_mechanism_beside_one_that_is_much_larger_moves_on_its_own_chart(order):
    """Two four-bars with no gravity in one scene: each angle as where one is alone, whatever its size."""
    scene = ac.System()
    scene.world, scene.bars, scene.hinges = World(None), [], []
    for size in order:
        at = size * np.array([(0, 0, 0), (0.3, 0, 0), (1.1, 0, 0.9), (1.2, 0, 0)])
        bars = [RigidBody.rod(1.0, tuple(b - a), position=tuple(a)) for a, b in itertools.pairwise(at)]
        parts = [scene.world, *bars, scene.world]
        scene.bars += bars
        scene.hinges += [Revolute.between(a, b, at=tuple(p), axis="y") for a, b, p in zip(parts, parts[1:], at, strict=False)]
    start = {scene.hinges[0].v: 2.0, scene.hinges[4].v: 2.0}
    minimal = ac.build(scene).minimal(start)
    assert len(minimal.state_names) == 4
    run = minimal.simulate(3.0, rtol=1e-10, samples=9)
    for one, other in zip(scene.hinges[:4], scene.hinges[4:], strict=True):
        assert np.max(np.abs(run[one.q] - run[other.q])) < 1e-8 < np.ptp(run[one.q])


def test_motion_in_the_virtual_machine():
    motion, error = simulated(slider_crank, {"s.a.q": 0.5, "s.a.v": 6.0}, 0.5, ["s.slide.q"], compiled=False)
    assert error < 3e-8
    assert len(motion.charts) > 1


def test_rodrigues_parameters_are_the_axis_times_the_tangent_of_a_quarter_of_the_angle():
    scene = free_body()
    q0 = np.array([0.5, -0.5, 0.1, 0.7])
    q0 /= np.linalg.norm(q0)
    minimal = ac.build(scene).minimal({scene.free.q: (*q0, 0, 0, 0)})
    axis, angle = np.array([2.0, -1.0, 2.0]) / 3, 2.3
    y = np.zeros(12)
    y[:3] = axis * np.tan(angle / 4)
    q = np.array(minimal.expand(0, y, [], [])).ravel()[:4]
    c, s = np.cos(angle / 2), axis * np.sin(angle / 2)
    expected = np.array([q0[0] * c - q0[1:] @ s, *(q0[0] * s + c * q0[1:] + np.cross(q0[1:], s))])
    assert np.max(np.abs(q - expected)) < 1e-15
    y[6:9] = 3.0 * axis  # turning on about the same axis: the angle grows at 3 rad/s
    rate = np.array(minimal.explicit_dynamics(0, y, [], [])).ravel()[:3]
    assert np.max(np.abs(rate - axis * 3.0 / 4 / np.cos(angle / 4) ** 2)) < 1e-14


@pytest.mark.parametrize(
    ("make", "start", "prefer", "reach"), [(FourBar, {"s.a.q": -0.5}, ["s.a.q"], 3.0), (bennett_linkage, {}, [], 0.6), (spatial_loop, {}, [], 0.2)]
)  # fmt: skip
def test_first_and_second_derivatives_are_those_of_the_implicit_function(make, start, prefer, reach):
    """g(x(y)) = 0 twice differentiated: G x' = 0 and G x'' + g''(x', x') = 0."""
    scene = make()
    model = ac.build(scene)
    minimal = model.minimal({eval(k, {"s": scene}): v for k, v in start.items()}, prefer=[eval(k, {"s": scene}) for k in prefer])
    s, n = model.system, len(minimal.state_names)
    y, d, xs, a = ca.SX.sym("y", n), ca.SX.sym("d", n), ca.SX.sym("x", s.x.numel()), ca.SX.sym("a", s.x.numel())
    x = minimal.expand(0, y, [], [])
    first = ca.jtimes(x, y, d)
    along = ca.Function("along", [y, d], [x, first, ca.jtimes(first, y, d)])
    g = model.functions.invariants(0, xs, [], [])
    slope = ca.jtimes(g, xs, a)
    G_along = ca.Function("G", [xs, a], [g, slope, ca.jtimes(slope, xs, a)])
    rng = np.random.default_rng(1)
    for far in (0.0, 0.3, 0.6, 1.0):
        point = minimal.start + far * reach * rng.choice((-1.0, 1.0), n)
        direction = rng.normal(size=n)
        x0, x1, x2 = (np.array(part) for part in along(point, direction))
        gap, first_gap, curvature = (np.array(part) for part in G_along(x0, x1))
        assert np.max(np.abs(gap)) < 1e-13
        assert np.max(np.abs(first_gap)) < 1e-12 * (1 + np.max(np.abs(x1)))
        assert np.max(np.abs(np.array(G_along(x0, x2)[1]) + curvature)) < 1e-10 * (1 + np.max(np.abs(x2)))


def test_charts_change_into_one_another_and_back():
    scene = spatial_loop()
    minimal = ac.build(scene).minimal({scene.A.v: (1.0, 2.0, 3.0)})
    away = minimal.start + 0.2 * np.random.default_rng(0).normal(size=10)
    other = minimal.rechart(np.array(minimal.expand(0, away, [], [])).ravel())
    there, back = minimal.change(other), other.change(minimal)
    assert np.max(np.abs(np.array(there(0, away, [], [])).ravel() - other.start)) < 1e-13
    assert np.max(np.abs(np.array(back(0, other.start, [], [])).ravel() - away)) < 1e-13
    J, K = (f.factory("J", ["t", "y", "u", "p"], ["jac:y_other:y"]) for f in (there, back))
    assert np.max(np.abs(np.array(K(0, other.start, [], []) @ J(0, away, [], [])) - np.eye(10))) < 1e-12
    # the same motion in both: y_other' = J y'
    rates = [np.array(m.explicit_dynamics(0, y, [], [])) for m, y in ((minimal, away), (other, other.start))]
    assert np.max(np.abs(np.array(J(0, away, [], [])) @ rates[0] - rates[1])) < 1e-10


def test_linearisation_has_the_frequency_of_the_closed_form_and_is_the_projected_one():
    """Swings, hanging: (2 m l^2 / 3 + M l^2) q'' = -(m l + M l) g q for two links m and a bar M."""
    model = ac.build(swings(0.7))
    minimal = model.minimal()
    A = minimal.explicit_dynamics.factory("A", ["t", "y", "u", "p"], ["jac:y_dot:y"])(0, minimal.start, [], [])
    frequency = np.sqrt((1.0 + 2.0) * G / ((2 / 3 + 2.0) * 0.7))
    assert np.max(np.abs(np.sort(np.linalg.eigvals(np.array(A)).imag) - [-frequency, frequency])) < 1e-12
    full = model.functions.explicit_dynamics.factory("A", ["t", "x", "u", "p"], ["jac:x_dot:x"])(0, minimal.chart.x, [], [])
    T = minimal.expand.factory("T", ["t", "y", "u", "p"], ["jac:x:y"])(0, minimal.start, [], [])
    R = minimal.restrict.factory("R", ["x"], ["jac:y:x"])(minimal.chart.x)
    assert np.max(np.abs(np.array(R @ full @ T - A))) < 1e-12


def test_optimal_control_of_a_loop_needs_no_invariants():
    """A torque on the crank of a four-bar, from rest to rest in a second with the least effort; simulated with that torque."""
    scene = FourBar()
    torque = ac.Input("N*m")
    scene.motor = TorqueSource(torque)
    scene.connect(scene.motor.flange, scene.a.flange)
    model = ac.build(scene)
    minimal = model.minimal({scene.a.q: -0.5}, prefer=[scene.a.q])
    f, n, end = minimal.explicit_dynamics, 20, 1.0
    h = end / n
    opti = ca.Opti()
    Y, U = opti.variable(2, n + 1), opti.variable(1, 2 * n + 1)
    for k in range(n):  # Hermite-Simpson
        a, b, u = Y[:, k], Y[:, k + 1], [U[2 * k + i] for i in range(3)]
        fa, fb = f(0, a, u[0], []), f(0, b, u[2], [])
        middle = f(0, (a + b) / 2 + h / 8 * (fa - fb), u[1], [])
        opti.subject_to(b == a + h / 6 * (fa + 4 * middle + fb))
    opti.subject_to(Y[:, 0] == [-0.5, 0])
    opti.subject_to(Y[:, -1] == [-2.0, 0])
    opti.minimize(h / 6 * sum(U[2 * k] ** 2 + 4 * U[2 * k + 1] ** 2 + U[2 * k + 2] ** 2 for k in range(n)))
    opti.set_initial(Y[0, :], np.linspace(-0.5, -2.0, n + 1))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    solution = opti.solve()
    assert solution.stats()["iter_count"] < 30
    knots, values = np.linspace(0, end, 2 * n + 1), np.array(solution.value(U)).ravel()

    def parabolas(t: float) -> float:
        k = min(int(t / h), n - 1)
        return float(np.polyval(np.polyfit(knots[2 * k : 2 * k + 3], values[2 * k : 2 * k + 3], 2), t))

    run = model.simulate(end, {scene.a.q: -0.5}, inputs={torque: parabolas}, rtol=1e-9)
    assert abs(run[scene.a.q][-1] + 2.0) < 1e-3
    assert abs(run[scene.a.v][-1]) < 1e-2
    smooth = {torque: lambda t: 20 * np.sin(5 * t)}
    motion, other = minimal.simulate(end, inputs=smooth), model.simulate(end, {scene.a.q: -0.5}, inputs=smooth)
    assert np.max(np.abs(motion[scene.a.q] - other[scene.a.q])) < 1e-7


def test_parameters_and_time_move_the_chart():
    """A driven slider-crank whose rod is a parameter: the piston's place at other times and lengths than the reference's."""
    scene = slider_crank(0.3, ac.Parameter(1.0, "m"))
    scene.drive = AngleSource(lambda t: 2.0 * t + 0.5)
    scene.connect(scene.drive.flange, scene.a.flange)
    minimal = ac.build(scene).minimal()
    assert minimal.state_names == ()
    for t, rod in ((0.0, 1.0), (0.6, 1.1), (1.2, 0.8)):
        q = 2.0 * t + 0.5
        x = dict(zip(minimal.chart.dependent, np.array(minimal.expand(t, [], [], [rod])).ravel(), strict=True))
        assert abs(x["a.q"] - q) < 1e-14
        assert abs(x["slide.q"] - 0.3 * np.cos(q) - np.sqrt(rod**2 - (0.3 * np.sin(q)) ** 2)) < 1e-13
        assert float(minimal.residual(t, [], [], [rod])) < 1e-13
    with pytest.raises(OptionError, match="every motion is prescribed"):
        minimal.simulate(1.0)


def test_one_hinge_that_is_driven_leaves_nothing():
    scene = Pendulum()
    scene.drive = AngleSource(np.sin(ac.time))
    scene.connect(scene.drive.flange, scene.hinge.flange)
    minimal = ac.build(scene).minimal()
    assert str(minimal).startswith("Pendulum: 0 states") and minimal.chart.dependent == ("hinge.q", "hinge.v")
    x = np.array(minimal.expand(0.7, [], [], [])).ravel()
    assert np.max(np.abs(x - [np.sin(0.7), np.cos(0.7)])) < 1e-14


def test_a_plate_on_a_ball_between_plates_swings_as_a_heavier_one_however_the_ball_is_turned():
    """The height of the ball is the same wherever it rolls, so its constraint changes with no coordinate, but for rounding."""
    plate, ball, radius, stiffness = 3.0, 0.8, 0.37, (20.0, 47.0)
    scene = ac.System()
    scene.world, scene.lower, scene.upper = World(), RollingBall(radius), RollingBall(radius)
    scene.ball, scene.plate = RigidBody.ball(ball, radius), RigidBody.box(plate, (0.5, 0.5, 0.02))
    scene.x, scene.y, scene.ground = Prismatic("x"), Prismatic("y"), TranslationalGround()
    scene.springs = [TranslationalSpring(k) for k in stiffness]
    joined(
        scene,
        (scene.lower, scene.world.frame, scene.ball.frame),
        (scene.upper, scene.plate.at((0, 0, -0.01), rotation=("x", np.pi)), scene.ball.frame),
        (scene.x, scene.world.at((0, 0, 2 * radius + 0.01)), scene.y.frame_a),
    )
    scene.connect(scene.y.frame_b, scene.plate.frame)
    for spring, slide in zip(scene.springs, (scene.x, scene.y), strict=True):
        scene.connect(scene.ground.flange, spring.flange_a)
        scene.connect(spring.flange_b, slide.flange)
    model, start = ac.build(scene), {scene.lower.q[k]: value for k, value in enumerate((0.5, 0.7, -0.1, 0.5))}
    run = model.minimal(start | {scene.x.v: 0.3, scene.y.q: 0.1}).simulate(1.0, rtol=1e-10)
    pace = np.sqrt(np.array(stiffness) / (plate + ball / 4 * (1 + 2 / 5)))
    assert np.allclose(np.ravel(run[scene.x.q]), 0.3 / pace[0] * np.sin(pace[0] * run.t), atol=1e-9)
    assert np.allclose(np.ravel(run[scene.y.q]), 0.1 * np.cos(pace[1] * run.t), atol=1e-9)
    for asked in (model.linearize(start), model.minimal(start).linearize()):
        assert len(asked.states) == 10
        found = np.linalg.eigvals(asked.A).imag
        assert np.allclose(np.sort(found[found > 0.1]), pace, rtol=1e-12)


def test_off_the_chart_everything_is_nan():
    scene = slider_crank()
    minimal = ac.build(scene).minimal({scene.a.q: 0.5}, prefer=[scene.slide.q])
    assert minimal.state_names == ("slide.q", "slide.v")
    for function in (minimal.expand, minimal.explicit_dynamics, minimal.residual):
        assert np.isnan(np.array(function(0, [1.31, 0.0], [], []))).any()  # the piston reaches 1.3 m at most
    assert float(minimal.residual(0, [1.29, 0.0], [], [])) < 1e-13


def test_far_from_the_reference_values_are_exact_or_nan():
    """The piston of a slider-crank over four turns: never on the other branch, and right for more than half a turn to either side."""
    scene = slider_crank()
    minimal = ac.build(scene).minimal({scene.a.q: 0.5}, prefer=[scene.a.q])
    q = np.linspace(-12, 12, 481)
    none = np.zeros((0, 1))
    x = np.array(minimal.expand(0, np.vstack([q, 0 * q]), none, none))
    known = np.isfinite(x).all(axis=0)
    a, slide, b = (x[minimal.atlas.functions.state_names.index(name)] for name in ("a.q", "slide.q", "b.q"))
    assert known[np.abs(q - 0.5) < 4.0].all()
    assert np.max(np.abs(slide - 0.3 * np.cos(q) - np.sqrt(1 - (0.3 * np.sin(q)) ** 2))[known]) < 1e-12
    assert np.max(np.abs(a + b)[known]) < 0.31


def test_a_velocity_may_be_preferred_too():
    scene = FourBar()
    assert ac.build(scene).minimal(prefer=[scene.a.v]).state_names == ("a.q", "a.v")


class Blade(ac.Component):
    """What two slides and a hinge carry moves along itself only."""

    x, y, turn = ac.Translational.port(), ac.Translational.port(), ac.Rotational.port()
    push = ac.Variable("N")

    def equations(self):
        c, s = np.cos(self.turn.phi), np.sin(self.turn.phi)
        yield ac.equal(s * ac.der(self.x.s), c * ac.der(self.y.s))
        yield ac.equal(self.x.f, -s * self.push)
        yield ac.equal(self.y.f, c * self.push)
        yield ac.equal(self.turn.tau, 0.0)


@pytest.mark.parametrize("heading", [0.3, 1.2])
def test_conditioning_is_that_of_velocities_where_these_are_less_free_than_positions(heading):
    scene = ac.System()
    scene.world, scene.body, scene.blade = World((0, 0, 0)), RigidBody(1.0, (1, 1, 1)), Blade()
    scene.x, scene.y, scene.turn = Prismatic("x"), Prismatic("y"), Revolute("z")
    scene.connect(scene.world.frame, scene.x.frame_a)
    scene.connect(scene.x.frame_b, scene.y.frame_a)
    scene.connect(scene.y.frame_b, scene.turn.frame_a)
    scene.connect(scene.turn.frame_b, scene.body.frame)
    for joint, flange in ((scene.x, scene.blade.x), (scene.y, scene.blade.y), (scene.turn, scene.blade.turn)):
        scene.connect(joint.flange, flange)
    model, start = ac.build(scene), {scene.turn.q: heading}
    c, s = np.cos(heading), np.sin(heading)
    for prefer, part in (((), max(c, s)), ((scene.x.v,), c), ((scene.y.v,), s)):
        chart = model.minimal(start, prefer=prefer).chart
        assert chart.preferred
        assert chart.conditioning == pytest.approx(part, rel=1e-12)


def test_conditioning_goes_to_zero_where_a_chart_ends():
    scene = slider_crank()
    model = ac.build(scene)
    minimal = model.minimal({scene.a.q: 0.5}, prefer=[scene.slide.q])
    values = [float(minimal.conditioning(0, model.initial_state({scene.a.q: a}).x, [], [])) for a in (0.5, 0.1, 0.01, 0.001)]
    assert values[0] == pytest.approx(minimal.chart.conditioning, rel=1e-9)
    assert np.allclose(np.array(values[1:]) / values[0], [0.2, 0.02, 0.002], rtol=0.2)


def test_singular_start_names_the_loop_and_a_motion_through_one_is_that_of_the_model():
    scene = swings()
    model = ac.build(scene)
    flat = np.array([np.pi / 2] * 3 + [0.0] * 3) * 0
    for name, value in (("a.q", np.pi / 2), ("d.q", np.pi / 2), ("b.q", -np.pi / 2)):
        if name in model.state_names:
            flat[model.state_names.index(name)] = value
    minimal = model.minimal()
    with pytest.raises(StartValueError, match="singular") as caught:
        minimal.rechart(flat)
    assert "'" in str(caught.value) and ".v" in str(caught.value)
    start = {scene.a.v: 12.0}
    motion, own = model.minimal(start).simulate(2.0, rtol=1e-12, samples=21), model.simulate(2.0, start, rtol=1e-12, samples=21)
    assert motion.energy_error() < 1e-13
    assert np.max(np.abs(motion[scene.d.q] - own[scene.d.q])) < 1e-10


def other_scene() -> ac.Variable:
    return FourBar().a.q


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda m, s: m.minimal(prefer=[s.c.q]), OptionError, "c.q is not a state.*a.q"),
        (lambda m, s: m.minimal(prefer=[3]), OptionError, "not a variable of the scene"),
        (lambda m, s: m.minimal(prefer=[other_scene()]), UnknownVariableError, "a.q"),
        (lambda m, s: m.minimal(prefer=s.a.q), OptionError, "must be a list"),
        (lambda m, s: m.minimal(steps=3), OptionError, "whole number from 4"),
        (lambda m, s: m.minimal(steps=2.5), OptionError, "whole number"),
        (lambda m, s: m.minimal().rechart([0.0, 1.0]), StartValueError, "6 finite numbers"),
        (lambda m, s: m.minimal().rechart("home"), StartValueError, "6 finite numbers, not 'home'"),
        (lambda m, s: m.minimal().rechart(np.full(6, np.nan)), StartValueError, "finite"),
        (lambda m, s: m.minimal().rechart(np.arange(6.0)), StartValueError, "violate the constraints by"),
        (lambda m, s: m.minimal().change("home"), OptionError, "not a minimal model"),
        (lambda m, s: m.minimal().change(ac.build(FourBar()).minimal()), OptionError, "another model"),
        (lambda m, s: m.minimal().simulate(1.0, samples=1), OptionError, "samples"),
        (lambda m, s: m.minimal().simulate(1.0, rtol=-1.0), OptionError, "rtol"),
        (lambda m, s: m.minimal().simulate(-1.0), OptionError, "end"),
    ],
)
def test_nonsense_is_answered_in_words(call, kind, words):
    scene = FourBar()
    with pytest.raises(kind, match=words):
        call(ac.build(scene), scene)
