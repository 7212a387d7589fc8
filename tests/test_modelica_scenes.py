"""Modelica's own multibody examples, each against an independent truth."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from examples.engine import COMPRESSION, CRANK, EXPANSION, ROD, STEEL, STROKE, Engine, steel_bar, steel_cylinder
from examples.robot_r3 import Robot
from tests import modelica_scenes as scenes
from tests.one_freedom import Moving, OneFreedom, turn_x, turn_y, turn_z

Q, RATE = ca.SX.sym("q"), ca.SX.sym("rate")


def moving(body, origin, rotation) -> Moving:
    """One of our bodies at a pose given in closed form; only its mass, centre and inertia are read."""
    return Moving(body.mass, body.central_inertia, origin + rotation @ ca.DM(body.centre_of_mass), rotation)


def compare(scene, start, angle, rate, reference, end, tolerance):
    """Simulate and compare an angle and its rate with the reference's; returns the run."""
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    times = np.linspace(0, end, 41)
    run = model.simulate(end, start, rtol=1e-11, samples=41)
    exact = reference.motion(start[angle], start[rate], times)
    np.testing.assert_allclose(run[angle], exact[0], atol=tolerance)
    np.testing.assert_allclose(run[rate], exact[1], atol=tolerance * np.max(np.abs(exact[1])))
    assert run.constraint_error() < 1e-13
    assert run.energy_error() < 1e-9
    return run


def slider_crank(effort=0.0) -> OneFreedom:
    """The engine by hand: crank about x, rod at the angle asin(crank sin q / rod) from the vertical, piston along y."""
    x = (1.0, 0.0, 0.0)
    lean = -ca.asin(CRANK * ca.sin(Q) / ROD)
    pin = ca.vertcat(0.15, CRANK * ca.cos(Q), CRANK * ca.sin(Q))
    top = ca.vertcat(0.15, CRANK * ca.cos(Q) + ROD * ca.cos(lean), 0)
    turn = turn_x(Q)
    bodies = [
        moving(steel_cylinder((0.1, 0, 0), 0.05), ca.DM.zeros(3), turn),
        moving(steel_bar((0, CRANK, 0), 0.02, 0.05, x), turn @ ca.DM([0.1, 0, 0]), turn),
        moving(steel_cylinder((0.1, 0, 0), 0.03), turn @ ca.DM([0.1, CRANK, 0]), turn),
        moving(steel_bar((0, -CRANK, 0), 0.02, 0.05, x), turn @ ca.DM([0.2, CRANK, 0]), turn),
        moving(steel_bar((0, ROD, 0), 0.02, 0.06, x), pin, turn_x(lean)),
        moving(steel_cylinder((0, -0.1, 0), 0.1), top + ca.DM([0, 0.1, 0]), ca.SX.eye(3)),
    ]
    return OneFreedom(Q, RATE, bodies, scenes.DOWN, effort, inertia=1.0)


def test_engine_moves_as_its_closed_form():
    scene = Engine(gas=False)
    start = {scene.bearing.q: 0.0, scene.bearing.v: 10.0, scene.cylinder.q: ac.near(0.05)}
    run = compare(scene, start, scene.bearing.q, scene.bearing.v, slider_crank(), 5.0, 1e-9)
    angle = run[scene.bearing.q]
    s = 0.35 - CRANK * np.cos(angle) - np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2)
    np.testing.assert_allclose(run[scene.cylinder.q], s, atol=1e-14)


def gas_effort(law) -> ca.SX:
    """Generalised force of the gas: pressure times area times ds / dq."""
    s = 0.35 - CRANK * ca.cos(Q) - ca.sqrt(ROD**2 - (CRANK * ca.sin(Q)) ** 2)
    pressure = 1e5 * sum(c * (1 - s / STROKE) ** (4 - k) for k, c in enumerate(law))
    return pressure * ca.pi * 0.1**2 / 4 * ca.jacobian(s, Q)


def test_engine_with_gas_against_half_turns_joined_at_the_dead_centres():
    """The law of the gas jumps where the piston turns: each half-turn is integrated by itself, over the angle."""
    halves = [slider_crank(gas_effort(law)).acceleration() for law in (EXPANSION, COMPRESSION)]
    t, rate = 0.0, 10.0
    for turn in range(4):
        f = halves[turn % 2]
        y = solve_ivp(
            lambda q, y, f=f: [1 / y[1], float(f(q, y[1])) / y[1]], (turn * np.pi, (turn + 1) * np.pi), [t, rate],
            method="DOP853", rtol=1e-12, atol=1e-13,
        ).y  # fmt: skip
        t, rate = float(y[0, -1]), float(y[1, -1])
    scene = Engine()
    run = ac.build(scene).simulate(t, scene.start(), rtol=1e-12, samples=11)
    assert run[scene.bearing.q][-1] == pytest.approx(4 * np.pi, abs=1e-5)
    assert run[scene.bearing.v][-1] == pytest.approx(rate, rel=1e-5)
    assert run.energy_error() < 1e-5


def test_engine_with_six_cylinders_moves_as_its_closed_form():
    """Six planar loops on one crank; each piston on the slider-crank's closed form, in its own direction."""
    x = (1.0, 0.0, 0.0)
    bodies = [moving(steel_cylinder((1.2, 0, 0), 0.05), ca.DM.zeros(3), turn_x(Q))]
    for phase, lean in zip(scenes.PHASES, scenes.LEANS, strict=True):
        angle = Q + phase - lean
        swing = -ca.asin(CRANK * ca.sin(angle) / ROD)
        up, turn = turn_x(ca.SX(lean)), turn_x(Q + phase)
        height = CRANK * ca.cos(angle) + ROD * ca.cos(swing)
        bodies += [
            moving(steel_bar((0, CRANK, 0), 0.02, 0.05, x), ca.DM.zeros(3), turn),
            moving(steel_bar((0, ROD, 0), 0.02, 0.06, x), turn @ ca.DM([0, CRANK, 0]), turn_x(lean + swing)),
            moving(steel_cylinder((0, -0.1, 0), 0.1), up @ ca.vertcat(0, height + 0.1, 0), up),
        ]
    scene = scenes.engine_v6()
    near = {pin.q: ac.near(lean - phase) for pin, phase, lean in zip(scene.crank_pins, scenes.PHASES, scenes.LEANS, strict=True)}
    start = {scene.bearing.q: 0.0, scene.bearing.v: 10.0, **near, **{cylinder.q: ac.near(0.15) for cylinder in scene.cylinders}}
    run = compare(
        scene, start, scene.bearing.q, scene.bearing.v, OneFreedom(Q, RATE, bodies, scenes.DOWN, inertia=1.0), 1.0, 1e-9
    )
    for cylinder, phase, lean in zip(scene.cylinders, scenes.PHASES, scenes.LEANS, strict=True):
        angle = run[scene.bearing.q] + phase - lean
        s = 0.35 - CRANK * np.cos(angle) - np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2)
        np.testing.assert_allclose(run[cylinder.q], s, atol=1e-13)


def bar_between(r0: ca.DM, d: ca.SX) -> ca.SX:
    """Rotation about y, then z, that carries the vector r0 (3,) to d; the branch that is the identity at d = r0."""
    rho = np.hypot(float(r0[0]), float(r0[1]))
    b = np.pi - ca.asin(d[1] / rho) - np.arctan2(float(r0[1]), float(r0[0]))  # r0 points along -x
    u = ca.cos(b) * r0[0] - ca.sin(b) * r0[1]
    a = ca.atan2(r0[2] * d[0] - u * d[2], u * d[0] + r0[2] * d[2])
    return turn_y(a) @ turn_z(b)


def spatial_fourbar(with_rod: bool) -> OneFreedom:
    """Crank about x, slider along x, and between them a rod of constant length: the slider's place is a square root."""
    crank_end = turn_x(Q) @ ca.DM([0, 0.5, 0.1])
    slide = ca.sqrt(1.1 - (crank_end[1] - 0.2) ** 2 - crank_end[2] ** 2)
    slider_end = ca.vertcat(slide, 0.2, 0)
    bodies = [
        moving(steel_cylinder((0, 0.5, 0.1), 0.05), ca.DM.zeros(3), turn_x(Q)),
        moving(steel_cylinder((0, 0.2, 0), 0.05), slider_end - ca.DM([0, 0.2, 0]), ca.SX.eye(3)),
    ]
    if with_rod:
        r0 = ca.DM([-1, 0.3, 0.1])
        rotation = bar_between(r0, crank_end - slider_end)
        np.testing.assert_allclose(np.array(ca.DM(ca.substitute(rotation, Q, 0))), np.eye(3), atol=1e-14)
        bodies.append(moving(steel_cylinder((-1, 0.3, 0.1), 0.05), slider_end, rotation))
    return OneFreedom(Q, RATE, bodies, scenes.DOWN)


@pytest.mark.parametrize(("build", "with_rod"), [(scenes.fourbar1, True), (scenes.fourbar2, False)])
def test_spatial_fourbar_moves_as_its_closed_form(build, with_rod):
    scene = build()
    start = {scene.j1.q: 0.0, scene.j1.v: np.radians(300), scene.j2.q: ac.near(-0.2)}
    run = compare(scene, start, scene.j1.q, scene.j1.v, spatial_fourbar(with_rod), 1.5, 1e-8)
    angle = run[scene.j1.q]
    y, z = 0.5 * np.cos(angle) - 0.1 * np.sin(angle), 0.5 * np.sin(angle) + 0.1 * np.cos(angle)
    np.testing.assert_allclose(run[scene.j2.q], np.sqrt(1.1 - (y - 0.2) ** 2 - z**2) - 1.2, atol=1e-13)


def test_planar_fourbar_with_damper_moves_as_its_closed_form():
    along = (0.0, 0.0, 1.0)
    A, C = 0.4 * ca.vertcat(ca.cos(Q), ca.sin(Q), 0), ca.DM([-0.15, 1, 0])
    L2, L4 = np.hypot(0.1, 1.1), np.hypot(0.65, 0.1)
    d = C - A
    D = ca.norm_2(d)
    x = (D**2 + L2**2 - L4**2) / (2 * D)
    side = ca.vertcat(d[1], -d[0], 0) / D  # the pin lies to the right of the line from crank to rocker
    E = A + d / D * x + side * ca.sqrt(L2**2 - x**2)
    np.testing.assert_allclose(np.array(ca.DM(ca.substitute(E, Q, 0))).ravel(), (0.5, 1.1, 0), atol=1e-14)

    def pointing(r0, r):
        return turn_z(ca.atan2(r[1], r[0]) - np.arctan2(r0[1], r0[0]))

    bodies = [
        moving(steel_bar((0.4, 0, 0), 0.05, 0.05, along), ca.DM.zeros(3), turn_z(Q)),
        moving(steel_bar((0.1, 1.1, 0), 0.05, 0.05, along), A, pointing((0.1, 1.1), E - A)),
        moving(steel_bar((0.65, 0.1, 0), 0.05, 0.05, along), C, pointing((0.65, 0.1), E - C)),
    ]
    scene = scenes.planar_fourbar()
    start = {scene.a.q: 0.0, scene.a.v: 0.0, scene.b.q: ac.near(0.0), scene.c.q: ac.near(0.0)}
    reference = OneFreedom(Q, RATE, bodies, scenes.DOWN, -0.1 * RATE)
    compare(scene, start, scene.a.q, scene.a.v, reference, 5.0, 1e-8)


def test_line_force_with_two_masses_moves_as_its_closed_form():
    foot, eye = ca.DM([0, -0.9, 0]), ca.vertcat(0.7 * ca.cos(Q), 0.3 + 0.7 * ca.sin(Q), 0)
    length = ca.norm_2(eye - foot)
    e = (eye - foot) / length
    bodies = [
        moving(scenes.square_bar((0.7, 0, 0), 0.035), ca.DM([0, 0.3, 0]), turn_z(Q)),
        *(Moving(1.0, np.zeros((3, 3)), p, ca.SX.eye(3)) for p in (foot + 0.2 * e, eye - 0.2 * e)),
    ]
    slope = ca.jacobian(length, Q)
    scene = scenes.line_force_with_two_masses()
    start = {scene.hinge.q: 0.0, scene.hinge.v: 0.0}
    compare(
        scene, start, scene.hinge.q, scene.hinge.v, OneFreedom(Q, RATE, bodies, scenes.DOWN, -3.0 * slope**2 * RATE), 3.0, 1e-8
    )


def test_steel_parts_weigh_what_the_library_says():
    """Mass of a cylinder and a bar; moments about the axes of the bar (width along x, height along z)."""
    assert steel_cylinder((0, -0.1, 0), 0.1).mass == pytest.approx(STEEL * np.pi * 0.05**2 * 0.1)
    bar = steel_bar((0, -0.2, 0), 0.02, 0.06, (1.0, 0.0, 0.0))
    assert bar.mass == pytest.approx(STEEL * 0.2 * 0.02 * 0.06)
    square = np.array([0.2**2 + 0.06**2, 0.02**2 + 0.06**2, 0.2**2 + 0.02**2])
    np.testing.assert_allclose(bar.central_inertia, np.diag(bar.mass / 12 * square), atol=1e-15)


def test_rolling_wheel_by_newton_and_euler():
    """I a + m r x (a x r) = -w x I w - m r x (w x r' - g) in world axes; r from the contact up the wheel's plane to the centre."""
    e, w = ca.SX.sym("e", 3), ca.SX.sym("w", 3)
    up = ca.DM([0, 0, 1]) - e * e[2]
    r = 0.3 * up / ca.norm_2(up)
    r_rate = ca.jtimes(r, e, ca.cross(w, e))
    inertia = 0.12 * ca.SX.eye(3) - 0.06 * e @ e.T
    around = inertia + 2.0 * (ca.dot(r, r) * ca.SX.eye(3) - r @ r.T)
    moment = -ca.cross(w, inertia @ w) - 2.0 * ca.cross(r, ca.cross(w, r_rate) + ca.DM([0, 0, 9.81]))
    state = ca.vertcat(e, w)
    f = ca.Function("f", [state], [ca.vertcat(ca.cross(w, e), ca.solve(around, moment), ca.cross(w, r)[:2])])
    times = np.linspace(0, 4, 41)
    y = solve_ivp(
        lambda t, y: np.array(f(y[:6])).ravel(),
        (0, 4),
        [0, 1, 0, 1, 5, 0, 0.2, 0.2],
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
        t_eval=times,
    ).y
    scene = scenes.rolling_wheel()
    model = ac.build(scene)
    assert model.system.x.numel() == 8
    run = model.simulate(4.0, {scene.contact.q: (0, 0, 0, 0.2, 0.2), scene.contact.v: (1, 5, 0)}, rtol=1e-11, samples=41)
    np.testing.assert_allclose(run[scene.wheel.frame.rotation][:, :, 1], y[:3].T, atol=1e-8)
    np.testing.assert_allclose(run[scene.wheel.frame.angular_velocity], y[3:6].T, atol=1e-7)
    np.testing.assert_allclose(run[scene.wheel.frame.position][:, :2], y[6:].T, atol=1e-8)
    assert run.energy_error() < 1e-10


def wheel_set_by_hand(torques, force, start, times) -> np.ndarray:
    """Speed v and yaw rate w of the axle's middle, place and heading (x, y, yaw): Newton along the axle's way, Euler about its middle.

    (M + 2 I / R^2) v' = m d w^2 + (tau_l + tau_r) / R + F_along; (J + 2 I b^2 / R^2) w' = -m d v w + b (tau_r - tau_l) / R + d F_across.
    """
    R, b, d, m, spin = 0.1, 0.25, 0.2, 0.01, 0.01
    M, J = 2 * 0.5 + m, 2 * (0.02 + 0.5 * b * b) + 0.001 + m * d * d

    def derivative(t, y):
        v, w, _, _, yaw = y
        left, right = torques(t)
        fx, fy, _ = force(t)
        c, s = np.cos(yaw), np.sin(yaw)
        dv = (m * d * w * w + (left + right) / R + c * fx + s * fy) / (M + 2 * spin / R**2)
        dw = (-m * d * v * w + b * (right - left) / R + d * (c * fy - s * fx)) / (J + 2 * spin * b * b / R**2)
        return [dv, dw, v * c, v * s, w]

    pieces, y = [np.array(start)[:, None]], np.array(start)
    for begin, end in itertools.pairwise(times):
        y = solve_ivp(derivative, (begin, end), y, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        pieces.append(y[:, None])
    return np.hstack(pieces)


def _swinging(t):
    return 2 * np.sin(2 * np.pi * t), 2 * np.cos(2 * np.pi * t)


def _table(t):
    share = np.clip(t - 1, 0, 1)
    return 1 - share, 2 * share, 0.0


@pytest.mark.parametrize("kind", ["driven", "pulled", "coasting"])
def test_wheel_set_by_newton_and_euler(kind):
    torques, force = (
        (_swinging if kind == "driven" else lambda t: (0.0, 0.0)),
        (_table if kind == "pulled" else lambda t: (0.0, 0.0, 0.0)),
    )
    as_symbols = {
        "driven": {"torques": lambda t: (2 * ca.sin(2 * np.pi * t), 2 * ca.cos(2 * np.pi * t))},
        "pulled": {"force": lambda t: (1 - ca.fmin(ca.fmax(t - 1, 0), 1), 2 * ca.fmin(ca.fmax(t - 1, 0), 1), 0)},
        "coasting": {},
    }[kind]
    scene = scenes.rolling_wheel_set(**as_symbols)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 2
    times = np.linspace(0, 3, 31)
    speed, turning = (1.0, 0.8) if kind == "coasting" else (0.0, 0.0)
    start = {
        scene.level.q: (0.1, 0.1, 0.0),
        scene.hinges[0].v: (speed - 0.25 * turning) / 0.1,
        scene.hinges[1].v: (speed + 0.25 * turning) / 0.1,
    }
    run = model.simulate(3.0, start, rtol=1e-11, samples=31)
    y = wheel_set_by_hand(torques, force, [speed, turning, 0.1, 0.1, 0.0], times)
    np.testing.assert_allclose(run[scene.level.q], y[2:].T, atol=1e-7)
    np.testing.assert_allclose(run[scene.hinges[0].v], (y[0] - 0.25 * y[1]) / 0.1, atol=1e-6)
    np.testing.assert_allclose(run[scene.hinges[1].v], (y[0] + 0.25 * y[1]) / 0.1, atol=1e-6)
    assert run.constraint_error() < 1e-13
    assert run.energy_error() < 1e-9


def test_wheel_set_without_its_small_body_runs_around_a_circle():
    """The small body on the middle of the axle: speed and yaw rate are constant, the radius is their ratio."""
    scene = scenes.rolling_wheel_set(ahead=0.0)
    run = ac.build(scene).simulate(
        3.0, {scene.level.q: (0, 0, 0), scene.hinges[0].v: 8.0, scene.hinges[1].v: 12.0}, rtol=1e-11, samples=31
    )
    yaw = 0.8 * run.t
    exact = np.stack([1.25 * np.sin(yaw), 1.25 * (1 - np.cos(yaw)), yaw], axis=1)
    np.testing.assert_allclose(run[scene.level.q], exact, atol=1e-10)


def test_free_body_on_two_springs_by_lagrange():
    """Springs without natural length: forces are linear in the places of their ends; Newton and Euler with a rotation matrix."""
    k, m, arm = 20.0, 1.0, np.array([0.2, 0, 0])
    scene = scenes.free_body()
    angles = [np.pi / 18] * 3
    R0 = np.array(ca.DM(turn_x(ca.SX(angles[0])) @ turn_y(ca.SX(angles[1])) @ turn_z(ca.SX(angles[2]))))

    def derivative(t, y):
        p, v, R, w = y[:3], y[3:6], y[6:15].reshape(3, 3), y[15:]
        pulls = [(-k * (p - R @ arm), -R @ arm), (k * (np.array([0.8, 0, 0]) - p - R @ arm), R @ arm)]
        a = sum(f for f, _ in pulls) / m + np.array(scenes.DOWN)
        turning = sum(np.cross(at, f) for f, at in pulls)  # I = 1 about every axis
        return np.concatenate([v, a, np.cross(w, R.T).T.ravel(), turning])

    times = np.linspace(0, 10, 21)
    begin = np.array([0.2, -0.5, 0.1])
    y0 = np.concatenate([begin + R0 @ arm, np.zeros(3), R0.ravel(), np.zeros(3)])
    y = solve_ivp(derivative, (0, 10), y0, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=times).y
    run = ac.build(scene).simulate(
        10.0, {scene.body.frame.position: begin, scene.body.frame.rotation: R0}, rtol=1e-11, samples=21
    )
    centre = run[scene.body.frame.position] + run[scene.body.frame.rotation] @ arm
    np.testing.assert_allclose(centre, y[:3].T, atol=1e-8)
    np.testing.assert_allclose(run[scene.body.frame.rotation].reshape(-1, 9), y[6:15].T, atol=1e-8)
    assert run.energy_error() < 1e-10


def test_sliding_mass_on_a_spring_swings_as_a_cosine():
    """Elementary.SpringMassSystem: s = 0.1 + m g / c (1 - cos(sqrt(c / m) t)), the spring on the joint's flange or between points."""
    scene = scenes.spring_mass_system()
    run = ac.build(scene).simulate(5.0, {scene.p1.q: 0.1, scene.p2.q: 0.1}, rtol=1e-12, samples=51)
    exact = 0.1 + 9.81 / 30 * (1 - np.cos(np.sqrt(30.0) * run.t))
    np.testing.assert_allclose(run[scene.p1.q], exact, atol=1e-11)
    np.testing.assert_allclose(run[scene.p2.q], exact, atol=1e-11)


def test_spring_constant_for_a_level_bar_is_the_published_one():
    """Elementary.InitSpringConstant's documentation: 49.05 N/m; the spring's pull 0.1 c holds half of the bar's weight."""
    stiffness = ac.Parameter(100.0, "N/m")
    scene = scenes.init_spring_constant(stiffness)
    found = ac.build(scene).equilibrium({scene.hinge.q: ac.exactly(0.0)}, free=[stiffness])
    assert found[stiffness] == pytest.approx(49.05, rel=1e-13)


def test_double_pendulum_starts_where_its_tip_is_told_to():
    """Elementary.DoublePendulumInitTip: the tip at (0.7, 0.3) at rest; energy goes where the damper takes it."""
    scene = scenes.double_pendulum()
    tip = scene.tip
    start = {tip.position[0]: 0.7, tip.position[1]: 0.3, tip.velocity[0]: 0.0, tip.velocity[1]: 0.0}
    run = ac.build(scene).simulate(5.0, start, rtol=1e-11, samples=51)
    np.testing.assert_allclose(run[tip.position][0], (0.7, 0.3, 0), atol=1e-13)
    np.testing.assert_allclose([run[scene.revolute1.v][0], run[scene.revolute2.v][0]], 0, atol=1e-13)
    bend = 2 * np.arccos(np.hypot(0.7, 0.3) / 2 / 0.5)  # of two equal bars whose ends are that far apart
    assert abs(run[scene.revolute2.q][0]) == pytest.approx(bend, abs=1e-13)
    assert run.energy_error() < 1e-10


def test_three_driven_loops_by_circles_and_the_torque_that_drives_them():
    """Loops.PlanarLoops_analytic: each pin is where two circles meet; the source's torque is m q'' + m' q'^2 / 2 + V'."""
    pin, pins, bodies = ca.vertcat(-0.5 * ca.sin(Q), 0.5 * ca.cos(Q), 0), [], []
    scene = scenes.planar_loops(lambda t: 0.7 * np.sin(2 * np.pi * t))
    for k, (right, span) in enumerate(zip(scenes.PLANAR_LOOPS, scene.spans, strict=True)):
        foot = ca.DM([0.5 * (k + 1), 0, 0])
        d = foot - pin
        D, L1, L2 = ca.norm_2(d), np.linalg.norm(span), np.linalg.norm(right)
        along = (D**2 + L1**2 - L2**2) / (2 * D)
        up = ca.vertcat(-d[1], d[0], 0) / D
        new = pin + d / D * along + up * ca.sqrt(L1**2 - along**2)
        angle = ca.atan2(new[1] - pin[1], new[0] - pin[0]) - np.arctan2(span[1], span[0])
        bodies.append(moving(scene.couplers[k], pin, turn_z(angle)))
        pins.append(new)
        pin = new
    run = ac.build(scene).simulate(2.0, rtol=1e-10, samples=41)
    place = ca.Function("place", [Q], pins)
    for k in range(3):
        exact = np.array([np.array(place(q)[k]).ravel() for q in run[scene.rev.q]])
        np.testing.assert_allclose(run[scene.pins[k].frame_a.position], exact, atol=1e-12)
    effort = ca.SX.sym("effort")
    f = OneFreedom(Q, RATE, bodies, scenes.DOWN, effort).acceleration(effort)
    torque = []
    for t in run.t:
        w = 2 * np.pi
        q, rate, acceleration = 0.7 * np.sin(w * t), 0.7 * w * np.cos(w * t), -0.7 * w * w * np.sin(w * t)
        none, one = (float(f(q, rate, e)) for e in (0.0, 1.0))
        torque.append((acceleration - none) / (one - none))
    np.testing.assert_allclose(-run[scene.drive.flange.tau], torque, atol=1e-9 * np.max(np.abs(torque)))
    assert run.energy_error() < 1e-9


@pytest.mark.parametrize(("make", "least"), [
    (lambda: Engine(gas=False), 2), (scenes.engine_v6, 2), (scenes.fourbar1, 2), (scenes.fourbar2, 2), (scenes.planar_fourbar, 2),
    (scenes.line_force_with_two_masses, 2), (scenes.rolling_wheel, 8), (scenes.rolling_wheel_set, 7), (scenes.free_body, 12), (Robot, 36),
])  # fmt: skip
def test_independent_states_are_as_few_as_modelicas(make, least):
    """What Modelica's tools are told or find to integrate: its examples say which states are always to be taken."""
    assert len(ac.build(make()).minimal().state_names) == least
