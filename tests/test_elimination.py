"""Coordinates that follow from others in closed form are no states: gears, racks, sources, rolling along a line."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import acausal as ac
from components import (
    AngleSource,
    CamFollower,
    Fixed,
    Gear,
    Prismatic,
    RackAndPinion,
    Revolute,
    RigidBody,
    RollingDisk,
    SpeedSource,
    TranslationalGround,
    TranslationalSpring,
    World,
)
from tests.exported import printed, program

RADIUS, PINION, BLOCK, STIFFNESS = 0.2, 0.03, 2.0, 10.0


def rack(radius=RADIUS) -> ac.System:
    """A pinion on a hinge moves a sprung block along a rack: x'' (m + J / r^2) = -k x."""
    scene = ac.System()
    scene.world, scene.hinge, scene.slide = World(None), Revolute("y"), Prismatic("x")
    scene.wheel, scene.block = RigidBody(1.0, (PINION, PINION, PINION)), RigidBody.ball(BLOCK, 0.1)
    scene.rack, scene.spring, scene.wall = RackAndPinion(radius), TranslationalSpring(STIFFNESS), TranslationalGround()
    for joint, body in ((scene.hinge, scene.wheel), (scene.slide, scene.block)):
        scene.connect(scene.world.frame, joint.frame_a)
        scene.connect(joint.frame_b, body.frame)
    scene.connect(scene.hinge.flange, scene.rack.pinion)
    scene.connect(scene.slide.flange, scene.rack.rack, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.wall.flange)
    return scene


def upright_disk() -> ac.System:
    """A disk on a sledge and hinge that rolls along a line, pulled by a slanted gravity: x'' = 2/3 g_x."""
    scene = ac.System()
    scene.world, scene.stand = World((1.0, 0, -9.81)), Fixed((0, 0, 0.3))
    scene.slide, scene.hinge, scene.contact = Prismatic("x"), Revolute("y"), RollingDisk(0.3, "y")
    scene.disk = RigidBody.disk(1.0, 0.3, "y")
    scene.connect(scene.world.frame, scene.stand.frame_a, scene.contact.frame_a)
    scene.connect(scene.stand.frame_b, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.disk.frame, scene.contact.frame_b)
    return scene


def slider_crank(drive=None) -> ac.System:
    scene = ac.System()
    scene.world, scene.slider, scene.hinges = World(), Prismatic("x"), [Revolute("y") for _ in range(3)]
    scene.crank, scene.bar, scene.block = (
        RigidBody.rod(1.0, (0.3, 0, 0)),
        RigidBody.rod(1.0, (1.0, 0, 0)),
        RigidBody.ball(0.5, 0.1),
    )
    ends = [
        (scene.world.frame, scene.hinges[0], scene.crank.frame),
        (scene.crank.tip, scene.hinges[1], scene.bar.frame),
        (scene.bar.tip, scene.hinges[2], scene.block.frame),
        (scene.world.frame, scene.slider, scene.block.frame),
    ]
    for a, joint, b in ends:
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)
    if drive is not None:
        scene.drive = drive
        scene.connect(scene.drive.flange, scene.hinges[0].flange)
    return scene


def test_a_rack_leaves_one_coordinate_and_nothing_to_keep():
    scene = rack()
    model = ac.build(scene)
    assert model.state_names == ("hinge.q", "hinge.v")
    assert model.functions.invariants is None and model.functions.projection is None
    run = model.simulate(3.0, {scene.slide.q: 0.1}, rtol=1e-12)
    rate = np.sqrt(STIFFNESS / (BLOCK + PINION / RADIUS**2))
    assert np.max(np.abs(run[scene.slide.q] - 0.1 * np.cos(rate * run.t))) < 1e-11
    assert np.array_equal(run[scene.slide.q], RADIUS * run[scene.hinge.q])
    assert np.max(np.abs(run[scene.slide.v] + 0.1 * rate * np.sin(rate * run.t))) < 1e-11
    assert run.energy_error() < 1e-11
    assert np.max(np.abs(model.linearize().eigenvalues - np.array([1j, -1j]) * rate)) < 1e-12


def test_a_radius_that_stays_adjustable_changes_what_follows():
    radius = ac.Parameter(RADIUS, "m")
    scene = rack(radius)
    scene.radius = radius
    model = ac.build(scene)
    assert len(model.state_names) == 2
    times = np.linspace(0.0, 2.0, 5)
    change = model.sensitivities(times, [radius, scene.slide.q], {scene.slide.q: 0.1}, rtol=1e-11)[scene.slide.q]
    mass = BLOCK + PINION / RADIUS**2
    rate = np.sqrt(STIFFNESS / mass)
    by_rate = -0.1 * times * np.sin(rate * times)
    assert np.max(np.abs(change[:, 0] - by_rate * rate * PINION / RADIUS**3 / mass)) < 1e-9
    assert np.max(np.abs(change[:, 1] - np.cos(rate * times))) < 1e-9


def test_gears_in_a_row_leave_one_coordinate():
    scene = ac.System()
    scene.world, scene.shafts = World(None), [Revolute("z") for _ in range(4)]
    scene.wheels, scene.gears = [RigidBody(1.0, (0.1, 0.1, 0.1)) for _ in range(4)], [Gear(2.0), Gear(-3.0), Gear(0.5)]
    for shaft, wheel in zip(scene.shafts, scene.wheels, strict=True):
        scene.connect(scene.world.frame, shaft.frame_a)
        scene.connect(shaft.frame_b, wheel.frame)
    for k, gear in enumerate(scene.gears):
        scene.connect(scene.shafts[k].flange, gear.flange_a)
        scene.connect(gear.flange_b, scene.shafts[k + 1].flange)
    model = ac.build(scene)
    assert len(model.state_names) == 2 and model.degrees_of_freedom == 1
    run = model.simulate(1.0, {scene.shafts[0].v: 6.0})
    assert np.allclose([run[s.v][-1] for s in scene.shafts], [6.0, 3.0, -1.0, -2.0], rtol=1e-14)
    assert np.allclose(run.kinetic_energy, 0.05 * (36 + 9 + 1 + 4), rtol=1e-14)


def test_a_disk_that_rolls_along_a_line_keeps_its_own_phase():
    """The slip is integrated; place and angle at the start stay free, their difference is a constant of integration."""
    scene = upright_disk()
    model = ac.build(scene)
    assert len(model.state_names) == 2
    assert model.parameter_names == ("constant[0]",)
    run = model.simulate(2.0, {scene.hinge.q: 0.5, scene.slide.q: 1.0, scene.slide.v: 0.2}, rtol=1e-12)
    x = 1.0 + 0.2 * run.t + run.t**2 / 3
    assert np.max(np.abs(run[scene.slide.q] - x)) < 1e-12
    assert np.max(np.abs(run[scene.hinge.q] - 0.5 - (x - 1.0) / 0.3)) < 1e-11
    friction = run[scene.contact.frame_a.force] @ np.array([1.0, 0, 0])
    assert np.max(np.abs(np.abs(friction) - 1.0 / 3.0)) < 1e-10
    table = str(model.constraints())
    assert "slide.q - 0.3 hinge.q" in table
    start = model.initial_state({scene.hinge.q: 0.5, scene.slide.q: 1.0})
    assert np.allclose(start.p, 0.85, atol=1e-14)
    rates = np.array(model.functions.explicit_dynamics(0.0, start.x, [], start.p)).ravel()
    assert np.allclose(rates, [0.0, 2.0 / 0.9], atol=1e-12)


def test_derivatives_by_the_start_pass_through_the_constant():
    scene = upright_disk()
    model = ac.build(scene)
    start = {scene.hinge.q: 0.5, scene.slide.q: 1.0}
    change = model.sensitivities([0.0, 1.0], [scene.hinge.q, scene.slide.q], start)
    assert np.allclose(change[scene.slide.q], [[0, 1], [0, 1]], atol=1e-12)
    assert np.allclose(change[scene.hinge.q], [[1, 0], [1, 0]], atol=1e-12)
    place = model.trajectory_function([0.0, 1.0], scene.slide.q, [scene.slide.q], start)
    assert np.allclose(np.array(place([2.0])), [[2.0, 2.0 + 1 / 3]], atol=1e-8)


@pytest.mark.parametrize("make", [rack, upright_disk, lambda: slider_crank(AngleSource(lambda t: 0.4 + 3.0 * t + t**2))])
def test_residual_form_vanishes_along_the_motion(make):
    scene = make()
    model = ac.build(scene)
    f = model.functions
    rng = np.random.default_rng(3)
    start = model.initial_state(t0=0.3)
    x = start.x + (0 if f.invariants is not None else rng.uniform(-0.3, 0.3, start.x.size))
    rates, force = f.explicit_dynamics(0.3, x, [], start.p), f.multipliers(0.3, x, [], start.p)
    residual = np.array(f.residual_dynamics(0.3, x, rates, force, [], start.p))
    assert np.max(np.abs(residual)) < 1e-10
    wrong = np.array(rates).ravel()
    wrong[-1] += 1e-3
    assert np.max(np.abs(np.array(f.residual_dynamics(0.3, x, wrong, force, [], start.p)))) > 1e-6


def test_a_driven_crank_is_no_state_and_the_rest_follows():
    scene = slider_crank(AngleSource(lambda t: 0.4 + 3.0 * t))
    model = ac.build(scene)
    free = ac.build(slider_crank())
    assert len(model.state_names) == len(free.state_names) - 2
    run = model.simulate(2.0, rtol=1e-11)
    a = 0.4 + 3.0 * run.t
    place = 0.3 * np.cos(a) + np.sqrt(1.0 - 0.09 * np.sin(a) ** 2)
    assert np.max(np.abs(run[scene.slider.q] - place)) < 1e-9
    assert np.max(np.abs(run[scene.hinges[0].q] - a)) < 1e-13
    assert run.energy_error() < 1e-9


def test_a_given_speed_is_integrated_from_any_start():
    scene = slider_crank(SpeedSource(3.0))
    model = ac.build(scene)
    assert len(model.state_names) == len(ac.build(slider_crank()).state_names) - 2
    run = model.simulate(2.0, {scene.hinges[0].q: 0.7}, rtol=1e-11)
    assert np.max(np.abs(run[scene.hinges[0].q] - 0.7 - 3.0 * run.t)) < 1e-13


def test_where_everything_is_given_the_states_stay():
    """A hinge whose angle is given has no freedom; it is simulated all the same."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rod, scene.drive = (
        World(),
        Revolute("y"),
        RigidBody.rod(1.0, (0, 0, -1)),
        AngleSource(lambda t: t**2),
    )
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.drive.flange, scene.hinge.flange)
    run = ac.build(scene).simulate(1.0)
    assert np.max(np.abs(run[scene.hinge.q] - run.t**2)) < 1e-9


def test_a_start_that_contradicts_the_rack_is_told():
    scene = rack()
    with pytest.raises(ac.errors.StartValueError, match=r"hinge\.q"):
        ac.build(scene).simulate(1.0, {scene.hinge.q: 1.0, scene.slide.q: 1.0})


def test_steps_and_exported_programs_know_the_constants(tmp_path):
    scene = upright_disk()
    model = ac.build(scene)
    start = {scene.hinge.q: 0.5, scene.slide.q: 1.0}
    first = model.initial_state(start)
    x, residual = model.step("gauss", 4)(0.0, first.x, [], first.p, 0.5)
    assert np.max(np.abs(np.array(residual))) < 1e-12
    assert np.allclose(np.array(x).ravel(), [0.5 + 0.25 / 0.9, 1.0 / 0.9], atol=1e-12)
    folder = model.export_simulator(tmp_path, start)
    _, rows = printed(program(folder), 2, 3, 1e-10)
    assert abs(rows[-1, 1] - (0.5 + 4 / 0.9)) < 1e-8


def test_whole_and_eliminated_states_belong_together():
    scene = upright_disk()
    model = ac.build(scene)
    space = model.functions.space
    first = model.initial_state({scene.hinge.q: 0.5, scene.slide.q: 1.0, scene.hinge.v: 2.0})
    whole = dict(zip(model.functions.tree_state_names, space.expanded(0.0, first.x, first.p), strict=True))
    assert whole == pytest.approx({"slide.q": 1.0, "hinge.q": 0.5, "slide.v": 0.6, "hinge.v": 2.0}, abs=1e-14)
    assert np.array_equal(space.restricted(np.array(list(whole.values()))), first.x)
    assert float(model.functions.output(scene.slide.q)(0.0, first.x, [], first.p)) == pytest.approx(1.0, abs=1e-14)


def test_readable_equations_say_what_follows():
    import sympy

    t = sympy.Symbol("t")
    hinge, slide = sympy.Function("q_hinge")(t), sympy.Function("q_slide")(t)
    equations = ac.build(rack()).equations()
    (motion,) = equations.motion
    assert motion.lhs == hinge.diff(t, 2)
    assert abs(float(motion.rhs.coeff(hinge)) + STIFFNESS / (BLOCK + PINION / RADIUS**2)) < 1e-12
    assert equations.constraints == (sympy.Eq(slide, hinge / 5),)
    rolling = ac.build(upright_disk()).equations()
    assert [str(e) for e in rolling.constraints] == ["Eq(q_slide(t), c_1 + 3*q_hinge(t)/10)"]
    assert "frac{d^{2}}{d t^{2}} q_{hinge}" in rolling.latex()


def test_states_given_as_numbers_are_those_that_a_model_keeps():
    scene = upright_disk()
    model = ac.build(scene)
    linear = model.linearize([0.3, 1.0])  # angle and rate; the place of the sledge follows, and is free beside them
    assert linear.states == ("slide.q", "hinge.q", "hinge.v")
    assert np.allclose(linear.A, [[0, 0, 0.3], [0, 0, 1], [0, 0, 0]], atol=1e-13)


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e3, 1e9])
def test_what_follows_does_not_depend_on_the_unit_of_length(unit: float):
    """A radius is larger than one in some units, and smaller in others."""
    scene = rack(RADIUS * unit)
    assert ac.build(scene).state_names == ac.build(rack()).state_names


A, B, HEIGHTS, MASSES, INERTIA, RATIO = (0.13, 0.08), (1.1, 0.4), (0.03, -0.08, 0.05, 0.09, -0.02, 0.01), (1.3, 0.7), 0.4, -2.0
TABLE = CubicSpline(np.linspace(0, 2 * np.pi, 7), (*HEIGHTS, HEIGHTS[0]), bc_type="periodic")


@functools.cache
def two_cams() -> np.ndarray:
    """Angles of the shaft at 41 times, without units, of the one equation that it obeys."""

    def rates(_: float, y: np.ndarray) -> list[float]:
        u, m = 2 * y[0] + B[0], np.array(MASSES)
        f = A[0] * np.sin(y[0]) + A[1] * np.cos(u)
        slope = np.array([A[0] * np.cos(y[0]) - 2 * A[1] * np.sin(u), TABLE(y[0] / RATIO, 1) / RATIO])
        bend = np.array([-A[0] * np.sin(y[0]) - 4 * A[1] * np.cos(u), TABLE(y[0] / RATIO, 2) / RATIO**2])
        push = -m @ (slope * (9.81 + bend * y[1] ** 2)) - 40 * f * slope[0]
        return [y[1], push / (INERTIA * (1 + 0.1 / RATIO**2) + m @ slope**2)]

    return solve_ivp(rates, (0, 2), [0.3, 3.0], "DOP853", np.linspace(0, 2, 41), rtol=1e-12, atol=1e-13, max_step=0.01).y[0]


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("first", [True, False])
def test_what_cams_lift_is_no_state(size: float, first: bool) -> None:
    """Two followers, one of them on a shaft that a gear turns and by a periodic spline."""
    scene = ac.System()
    scene.world, scene.gear = World(gravity=(0, 0, -9.81)), Gear(RATIO)
    by_table = CubicSpline(TABLE.x, size * TABLE(TABLE.x), bc_type="periodic")
    scene.lifts = CamFollower(lambda phi: size * (A[0] * np.sin(phi) + A[1] * np.cos(2 * phi + B[0]))), CamFollower(by_table)
    shafts, slides, inertia = [Revolute("y"), Revolute("y")], [Prismatic("z"), Prismatic("z")], INERTIA * size**2
    bodies = [RigidBody(1.0, (i, i, i)) for i in (inertia, 0.1 * inertia)] + [RigidBody(m, (inertia,) * 3) for m in MASSES]
    scene.joints, scene.bodies = [*shafts, *slides][:: 1 if first else -1], bodies[:: 1 if first else -1]
    for joint, body in zip(scene.joints, scene.bodies, strict=True):
        scene.connect(scene.world.frame, joint.frame_a)
        scene.connect(joint.frame_b, body.frame)
    scene.spring, scene.ground = TranslationalSpring(40.0 / size), TranslationalGround()
    scene.connect(shafts[0].flange, scene.gear.flange_a, scene.lifts[0].shaft)
    scene.connect(shafts[1].flange, scene.gear.flange_b, scene.lifts[1].shaft)
    for lift, slide in zip(scene.lifts, slides, strict=True):
        scene.connect(lift.follower, slide.flange)
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, slides[0].flange)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1 and len(model.state_names) == 2
    run = model.simulate(2 * np.sqrt(size), {shafts[0].q: 0.3, shafts[0].v: 3.0 / np.sqrt(size)}, rtol=1e-12, samples=41)
    assert run[shafts[0].q] == pytest.approx(two_cams(), abs=1e-9)
    assert run[slides[1].q] == pytest.approx(size * TABLE(two_cams() / RATIO), abs=1e-9 * size)
    assert run.energy_error() < 1e-9
