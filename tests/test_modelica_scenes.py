"""Modelica's own multibody examples, each against an independent truth."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from examples.engine import COMPRESSION, CRANK, EXPANSION, ROD, STEEL, STROKE, Engine, steel_bar, steel_cylinder
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
