"""Forces that read the scene: what they do is what they say, whatever they read, and wherever the graph cuts the loops."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, quad, solve_ivp
from scipy.interpolate import (
    Akima1DInterpolator,
    BivariateSpline,
    CubicSpline,
    NdBSpline,
    PchipInterpolator,
    RBFInterpolator,
    RectBivariateSpline,
    RegularGridInterpolator,
    SmoothBivariateSpline,
    UnivariateSpline,
    interp1d,
    make_interp_spline,
)  # fmt: skip

import acausal as ac
from acausal.language.expression import formula
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic
from components import (
    AngleSource,
    Bushing,
    Cable,
    ConvexShape,
    Coulomb,
    Force,
    ForceSensor,
    Gain,
    HeightField,
    Inertia,
    Integrator,
    JointFriction,
    NonlinearSpring,
    ParametricCurve,
    Particle,
    PotentialField,
    Prismatic,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    RotationSensor,
    SlidingMass,
    Spherical,
    Spring,
    SpringDamper,
    Torque,
    TorqueSource,
    World,
)  # fmt: skip
from tests.bad_input.messages import four_bar, pendulum_with
from tests.pairings import each_value
from tests.scenes import Pendulum

G = 9.81
READINGS: dict[str, Callable[[Any], Any]] = {
    "position": lambda s: -3 * s.rod.tip.position,
    "another point": lambda s: s.world.at((1, 0, 0)).position - s.rod.at((0, 0, -0.3)).position,
    "velocity": lambda s: -2 * s.rod.tip.velocity,
    "rotation": lambda s: s.rod.tip.rotation @ np.array([1.0, 2.0, 3.0]),
    "angular velocity": lambda s: s.rod.frame.angular_velocity + 1.0,
    "coordinate": lambda s: (3 * s.hinge.q, 0, s.hinge.v),
    "flange": lambda s: (s.hinge.flange.phi, 0, ac.der(s.hinge.flange.phi)),
    "derivatives": lambda s: ac.der(s.rod.tip.position) + ac.der(s.hinge.q),
    "CasADi's functions": lambda s: (
        ca.norm_2(s.rod.tip.velocity),
        0,
        ca.if_else(s.hinge.q > 0, s.hinge.q**3, ca.tanh(s.hinge.v) * s.hinge.q**3),
    ),
    "input and time": lambda s: (s.wind * ca.sin(ac.time), 0, s.hinge.q * ac.time),
    "signals": lambda s: (s.gain.output.value, 0, s.sum.output.value),
    "acceleration": lambda s: -0.3 * s.rod.tip.acceleration + 0.1,
    "angular acceleration": lambda s: (0.2 * s.rod.frame.angular_acceleration[1], 0, 0.1 * ac.der(s.hinge.v)),
    "reaction": lambda s: 0.2 * s.hinge.frame_b.force,
    "size of a reaction": lambda s: (0.3 * ac.norm(s.hinge.frame_b.force) * ca.tanh(s.hinge.v), 0, 0),
    "rate of a signal": lambda s: (ac.der(s.gain.output.value), 0, ac.der(s.sum.output.value)),
}


def pushed(reading: Callable[[Any], Any]) -> ac.System:
    """A pendulum with a sensor, an amplifier and an integrator, and a force on its tip."""
    scene = Pendulum()
    scene.wind, scene.sensor, scene.gain, scene.sum = ac.Input("N", default=2.0), RotationSensor(), Gain(3.0), Integrator()
    scene.connect(scene.hinge.flange, scene.sensor.flange)
    scene.connect(scene.sensor.angle, scene.gain.input)
    scene.connect(scene.gain.output, scene.sum.input)
    scene.push = Force(reading(scene))
    scene.connect(scene.rod.tip, scene.push.point)
    return scene


@pytest.mark.parametrize("reading", READINGS.values(), ids=READINGS)
def test_a_force_is_what_its_expression_is_and_its_work_is_counted(reading):
    scene = pushed(reading)
    run = ac.build(scene).simulate(1.0, {scene.hinge.q: 0.5}, rtol=1e-9)
    value = reading(scene)
    entries = value if isinstance(value, tuple) else [value[k] for k in range(3)]
    said = np.column_stack([np.broadcast_to(run[e] if isinstance(e, ac.Expression | ca.SX) else e, run.t.shape) for e in entries])
    assert np.max(np.abs(run[scene.push.point.force] + said)) < 1e-12 * (1 + np.max(np.abs(said)))
    assert run.energy_error() < 1e-6
    assert np.max(np.abs(said)) > 0.1


@pytest.mark.parametrize("joint", "abcd")
def test_a_force_may_read_any_joint_of_a_loop(joint):
    """The angle of a hinge, and the same from the rotation of the body behind it against that before it."""
    runs = []
    for by_rotation in (False, True):
        scene = four_bar()
        hinge = getattr(scene, joint)
        R = hinge.frame_a.rotation.T @ hinge.frame_b.rotation
        angle = ca.atan2(R[0, 2], R[0, 0]) if by_rotation else hinge.q
        scene.push = Force((2 * ca.sin(angle), 0.0, 1.0))
        scene.connect(scene.coupler.at((0.3, 0, 0)), scene.push.point)
        start = {scene.a.q: 1.0, **{h.q: ac.near(q) for h, q in ((scene.b, -2.134), (scene.c, -0.789), (scene.d, -1.923))}}
        runs.append(ac.build(scene).simulate(1.0, start, rtol=1e-10)[scene.coupler.tip.position])
    assert np.max(np.abs(runs[0] - runs[1])) < 1e-7


def test_a_force_may_read_all_joints_of_a_loop():
    """Angles go on where they pass half a turn: the crank turns and the force's work is counted all the way."""
    scene = four_bar()
    angles = [hinge.q for hinge in (scene.a, scene.b, scene.c, scene.d)]
    scene.push = Force((0, 0, sum(0.1 * (k + 1) * angle for k, angle in enumerate(angles))))
    scene.connect(scene.coupler.tip, scene.push.point)
    run = ac.build(scene).simulate(2.0, {scene.a.v: 14.0}, rtol=1e-10)
    for angle in angles:
        assert np.max(np.abs(np.diff(run[angle]))) < 0.5
    assert np.ptp(run[scene.a.q]) > 7
    assert run.energy_error() < 1e-7


class Follower(AbstractForce):
    """Pushes with a joint's angle, and against the rate at which another frame rises."""

    point = ac.Point.port()

    def __init__(self, joint: Revolute, frame: ac.Frame) -> None:
        self.joint, self.frame = joint, frame

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        push = ca.vertcat(self.joint.q.sx, 0, -2 * placement.rate(self.frame.position.sx[2]))
        return (Action(self.point, symbolic(placement.pose(self.point).rotation).T @ push, ca.SX.zeros(3)),)

    def potential_energy(self, placement: Placement) -> ca.SX:
        return ca.SX(0)

    def power_loss(self, placement: Placement) -> ca.SX:
        return ca.SX(0)  # what it supplies is found from what it does


@pytest.mark.parametrize("joint", "abcd")
def test_forces_of_one_s_own_read_joints_and_rates_of_loops(joint):
    scene = four_bar()
    hinge = getattr(scene, joint)
    scene.push = Follower(hinge, scene.rocker.tip)
    scene.connect(scene.push.point, scene.coupler.tip)
    run = ac.build(scene).simulate(0.5, {scene.a.q: 1.0}, rtol=1e-10)
    force = -run[scene.push.point.force]
    assert np.max(np.abs(force[:, 0] - run[hinge.q])) < 1e-13
    assert np.max(np.abs(force[:, 2] + 2 * run[scene.rocker.tip.velocity][:, 2])) < 1e-12
    assert run.energy_error() < 1e-9


@pytest.mark.parametrize(
    "law",
    [
        lambda s: Spring(100 * s.ball.q[1] ** 2, 0.1),
        lambda s: Spring(50 * (2 + np.sin(3 * ac.time)), 0.1),
        lambda s: Spring(50.0, 0.3 + 0.1 * s.rod.frame.angular_velocity[0] ** 2),
        lambda s: Spring(s.wind, 0.1),
        lambda s: NonlinearSpring(lambda length: s.ball.q[2] * length**2 + ca.exp(-length)),
    ],
    ids=["position", "time", "velocity", "input", "law"],
)
def test_springs_that_change_keep_the_balance_of_energy(law):
    scene = ac.System()
    scene.wind = ac.Input("N/m", default=30.0)
    scene.world, scene.ball, scene.rod = World(), Spherical(), RigidBody.rod(1.0, (0, 0, -1), radius=0.1)
    scene.connect(scene.world.frame, scene.ball.frame_a)
    scene.connect(scene.ball.frame_b, scene.rod.frame)
    scene.spring = law(scene)
    scene.connect(scene.world.at((1, 0.2, 0)), scene.spring.point_a)
    scene.connect(scene.rod.tip, scene.spring.point_b)
    run = ac.build(scene).simulate(1.0, {scene.ball.v: (1.0, 2.0, 3.0)}, rtol=1e-10)
    assert run.energy_error() < 1e-8


def test_torques_read_the_scene_too():
    """A torque that holds back the turn about the vertical: spin about it falls as exp(-c t / I)."""
    scene = ac.System()
    scene.world, scene.body = World(None), RigidBody(1.0, (0.1, 0.2, 0.25))
    scene.brake = Torque(-0.5 * scene.body.frame.angular_velocity)
    scene.connect(scene.brake.frame, scene.body.frame)
    run = ac.build(scene).simulate(1.0, {scene.body.frame.angular_velocity: (0, 0, 2.0)}, rtol=1e-10)
    assert np.max(np.abs(run[scene.body.frame.angular_velocity][:, 2] - 2 * np.exp(-2 * run.t))) < 1e-8


def test_parameters_inside_laws_are_found_and_stay_adjustable():
    stiffness = ac.Parameter(50.0)
    runs = []
    for k, given in ((stiffness, {stiffness: 8.0}), (8.0, {})):
        scene = ac.System()
        scene.world, scene.bob, scene.spring = (
            World(),
            Particle(1.0),
            NonlinearSpring(lambda length, k=k: ca.fabs(0.5 * k * length**2)),
        )
        scene.connect(scene.world.frame, scene.spring.point_a)
        scene.connect(scene.spring.point_b, scene.bob.point)
        run = ac.build(scene).simulate(1.0, {scene.bob.point.position: (1, 0, 0)}, parameters=given)
        runs.append(run[scene.bob.point.position])
    assert np.max(np.abs(runs[0] - runs[1])) < 1e-12


class Law(ac.Component):
    """A law on a shaft without a word of energy."""

    flange = ac.Rotational.port()

    def equations(self):
        yield ac.equal(
            self.flange.tau, ca.if_else(self.flange.phi > 0, 30.0, 20.0) * self.flange.phi**5 + 0.5 * ac.der(self.flange.phi)
        )


def test_what_flows_into_a_part_that_says_nothing_of_energy_is_counted_as_lost():
    scene = pendulum_with(Law())
    run = ac.build(scene).simulate(1.0, {scene.hinge.q: 0.5}, rtol=1e-9)
    assert run.energy_error() < 1e-7
    assert np.ptp(run.energy) > 0.1


TIMES = np.linspace(0.0, 2.0, 9)
VALUES = 0.3 * np.sin(2 * TIMES) * TIMES


@pytest.mark.parametrize(
    "spline",
    [
        CubicSpline(TIMES, VALUES), PchipInterpolator(TIMES, VALUES), Akima1DInterpolator(TIMES, VALUES), make_interp_spline(TIMES, VALUES, k=5), make_interp_spline(TIMES, VALUES, k=7),
        CubicSpline(TIMES, np.append(VALUES[:-1], VALUES[0]), bc_type="periodic"), PchipInterpolator(TIMES, VALUES, extrapolate=False),
    ],
    ids=lambda s: type(s).__name__,
)  # fmt: skip
def test_splines_are_what_scipy_makes_of_them(spline):
    angle = AngleSource(spline).angle
    times = np.linspace(-0.5, 2.5, 301)
    found = np.array(ca.Function("angle", [ac.time.sx], [angle.sx])(times)).ravel()
    wanted = spline(times)
    assert np.array_equal(np.isnan(found), np.isnan(wanted))
    assert np.nanmax(np.abs(found - wanted)) < 1e-14


@pytest.mark.parametrize("degree", [6, 9, 11])
def test_splines_of_any_degree_are_formulas(degree):
    """Also where scipy's own way to their pieces ends the process."""
    samples = np.linspace(0, 2, 23)
    spline, times = make_interp_spline(samples, 0.3 * np.sin(2 * samples) * samples, k=degree), np.linspace(0, 2, 101)
    angle = AngleSource(spline).angle.sx
    for m in range(3):
        found = np.array(ca.Function("angle", [ac.time.sx], [angle])(times)).ravel()
        wanted = spline(times, m)
        assert np.max(np.abs(found - wanted)) < 1e-11 * np.max(np.abs(wanted))
        angle = ca.jacobian(angle, ac.time.sx)


def test_a_spline_drives_a_hinge():
    spline = CubicSpline(TIMES, VALUES)
    scene = pendulum_with(AngleSource(spline))
    scene.free, scene.lower = Revolute("y"), RigidBody.rod(1.0, (0, 0, -1))
    scene.connect(scene.rod.tip, scene.free.frame_a)
    scene.connect(scene.free.frame_b, scene.lower.frame)
    run = ac.build(scene).simulate(1.9)
    assert np.max(np.abs(run[scene.hinge.q] - spline(run.t))) < 1e-14


def sliding(law: Callable[[Any], Any], mass: float = 2.0) -> ac.System:
    """A block on an inclined slide, and a force along it."""
    scene = ac.System()
    scene.world, scene.slide, scene.block = World(), Prismatic((2.0, 0, -1.0)), RigidBody.box(mass, (0.1, 0.1, 0.1))
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.block.frame)
    scene.brake = Force([law(scene) * x for x in ALONG])
    scene.connect(scene.brake.point, scene.block.frame)
    return scene


ALONG, ACROSS = np.array((2.0, 0, -1.0)) / np.sqrt(5), np.array((1.0, 0, 2.0)) / np.sqrt(5)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("by", ["component", "length of what is across", "component with its sign"])
def test_friction_follows_the_normal_force(by, size):
    """a = g (sin - mu cos) down an incline, at any mass."""
    laws: dict[str, Callable[[Any], Any]] = {
        "component": lambda s: -0.3 * ca.fabs(ac.dot(s.slide.frame_b.force, ACROSS)),
        "length of what is across": lambda s: (
            -0.3 * ac.norm(s.slide.frame_b.force - ALONG * ac.dot(s.slide.frame_b.force, ALONG)) * ca.tanh(s.slide.v / 1e-3)
        ),
        "component with its sign": lambda s: 0.3 * ac.dot(ACROSS, s.slide.frame_b.force),
    }
    scene = sliding(laws[by], 2.0 * size)
    run = ac.build(scene).simulate(1.0, {scene.slide.v: 1.0}, rtol=1e-9)
    assert np.max(np.abs(run[scene.slide.v] - 1 - 9.81 * (1 - 0.3 * 2) / np.sqrt(5) * run.t)) < 1e-11
    assert run.energy_error() < 1e-12


def test_a_law_without_a_solution_ends_the_run_in_words():
    """A brake that presses harder the harder it brakes: y = 1 + y^2 has no real solution."""
    scene = ac.System()
    scene.world, scene.ball = World(None), Particle(1.0)
    scene.push = Force(((1 + 2 * scene.ball.point.acceleration[0] ** 2), 0, 0))
    scene.connect(scene.push.point, scene.ball.point)
    with pytest.raises(ac.errors.SimulationError, match="not a number"):
        ac.build(scene).simulate(1.0)


def test_what_accelerates_with_a_body_adds_its_mass():
    """A force -m a of an acceleration is a mass more, also in a loop."""
    ends = []
    for added in (False, True):
        scene = four_bar()
        if added:
            scene.load = Force(-2.0 * (scene.coupler.tip.acceleration + np.array((0, 0, 9.81))))
            scene.connect(scene.load.point, scene.coupler.tip)
        else:
            scene.load = Particle(2.0)
            scene.connect(scene.load.point, scene.coupler.tip)
        run = ac.build(scene).simulate(1.0, {scene.a.q: 1.0}, rtol=1e-11)
        ends.append((run[scene.coupler.tip.position][-1], run[scene.a.frame_a.force][-1]))
    for one, two in zip(*ends, strict=True):
        assert np.max(np.abs(one - two)) < 1e-8 * (1 + np.max(np.abs(one)))


def test_a_bearing_brakes_by_the_force_that_it_carries():
    """A torque source on the hinge's own flange and a torque on the rod are the same friction."""
    ends = []
    for on_flange in (False, True):
        scene = Pendulum()
        size = -0.05 * ac.norm(scene.hinge.frame_b.force) * ca.tanh(scene.hinge.v / 0.1)
        scene.brake = TorqueSource(size) if on_flange else Torque((0, size, 0))
        scene.connect(
            scene.brake.flange if on_flange else scene.brake.frame, scene.hinge.flange if on_flange else scene.rod.frame
        )
        run = ac.build(scene).simulate(2.0, {scene.hinge.q: 1.0}, rtol=1e-10)
        assert run.energy_error() < 1e-9
        ends.append(run[scene.hinge.q])
    assert np.max(np.abs(ends[0] - ends[1])) < 1e-8
    assert np.max(np.abs(ends[0][-1])) < 0.9


@each_value(("size", [1.0, 1e-6, 1e5]), ("share", [-0.7, 0.4, 3.0]))
def test_a_force_follows_what_a_sensor_measures(share, size):
    """What a sledge m passes on to a mass M, f = M a, with the push F + c f, and with F + c f^2 / F: (m + M) a = F + c M a, and (M c / F) f^2 - (m + M) f + M F = 0."""
    m, M, F = 2.0, 3.0, 4.0 * size
    for square in (False, True):
        scene = ac.System()
        scene.world, scene.slide, scene.sledge = World(None), Prismatic("x"), RigidBody(m, inertia=(1.0, 1.0, 1.0))
        scene.sensor, scene.mass, scene.part = ForceSensor(), SlidingMass(M), ac.Parameter(0.0, "1")
        f = scene.sensor.force.value
        scene.push = Force((F + scene.part * (f * f / F if square else f), 0, 0))
        scene.connect(scene.world.frame, scene.slide.frame_a)
        scene.connect(scene.slide.frame_b, scene.sledge.frame, scene.push.point)
        scene.connect(scene.slide.flange, scene.sensor.flange_a)
        scene.connect(scene.sensor.flange_b, scene.mass.flange_a)
        c = 0.1 * share if square else share
        run = ac.build(scene).simulate(2.0, {scene.slide.q: 0.0, scene.slide.v: 0.0}, parameters={scene.part: c}, rtol=1e-10)
        a = F / (m + M - c * M)
        if square:
            a = ((m + M) - np.sqrt((m + M) ** 2 - 4 * M * M * c)) / (2 * M * c) * F / M
        assert run[f] == pytest.approx(np.full(run.t.size, M * a), rel=1e-11)
        assert run[scene.slide.q][-1] == pytest.approx(2 * a, rel=1e-11)


def test_a_brake_presses_by_the_pull_of_a_cable():
    """From the world over an eyelet on a cart to a weight that swings: against Lagrange's equations with the pull as a multiplier."""
    scene = ac.System()
    scene.world, scene.slide, scene.cart = World((0, 0, -G)), Prismatic("x"), RigidBody.box(3.0, (0.2, 0.2, 0.2))
    scene.weight = Particle(1.0, position=(0.5, 0, -1.0))
    scene.cable = Cable(2.4, over=[scene.cart.at((0.1, 0, 0))])
    scene.brake = Force((-0.15 * scene.cable.tension * np.tanh(scene.slide.v / 0.1), 0, 0))
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.cart.frame, scene.brake.point)
    scene.connect(scene.world.at((-1, 0, 0.5)), scene.cable.frame_a)
    scene.connect(scene.cable.frame_b, scene.weight.point)
    at = scene.weight.point
    start = {scene.slide.q: 0.2, at.position[0]: 0.5, at.position[1]: 0.1}
    run = ac.build(scene).simulate(0.8, start, rtol=1e-11, samples=5)
    e, inverse, pushed = np.array([1.0, 0, 0]), np.array([1 / 3, 1, 1, 1]), np.array([0, 0, 0, -G])

    def rates(_, y):
        v, eyelet = y[5:8], np.array([y[0] + 0.1, 0, 0])
        one, other, w = eyelet - np.array([-1, 0, 0.5]), y[2:5] - eyelet, v - e * y[1]
        near, far = np.linalg.norm(one), np.linalg.norm(other)
        J = np.r_[(one / near - other / far) @ e, other / far]
        curved = y[1] ** 2 * (1 - (one[0] / near) ** 2) / near + (w @ w - (other @ w / far) ** 2) / far
        by = -J - 0.15 * np.tanh(y[1] / 0.1) * np.array([1.0, 0, 0, 0])
        tension = -(curved + J @ (inverse * pushed)) / (J @ (inverse * by))
        a = inverse * (pushed + by * tension)
        return np.r_[y[1], a[0], v, a[1:]]

    y = [run[x][0] for x in (scene.slide.q, scene.slide.v, at.position, at.velocity)]
    found = solve_ivp(rates, (0, 0.8), np.hstack(y), "DOP853", run.t, rtol=1e-12, atol=1e-13).y
    assert np.max(np.abs(found[2:5].T - run[at.position])) < 1e-10
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize("arm", [0.05, 0.02])
def test_laws_go_through_where_a_component_that_they_read_vanishes(arm):
    """There nothing is left of it but what rounding makes of the terms that cancel: rates are smooth all around."""
    scene = four_bar()
    F = scene.a.frame_b.force
    scene.brake = TorqueSource(-arm * np.tanh(scene.a.v / 0.3) * np.sqrt(F[0] ** 2 + F[2] ** 2 + 1e-6))
    scene.connect(scene.brake.flange, scene.a.flange)
    run = ac.build(scene).simulate(1.0, {scene.a.q: 1.0, scene.a.v: 3.0}, rtol=1e-9, events=[ac.when(F[0]), ac.when(F[2])])
    assert run.events
    for event in run.events:
        x = run.solution.dense(np.array([event.time]))[:, 0]
        half = x.size // 2
        along = np.concatenate([x[half:], np.zeros(half)])
        places = [x + d * along for d in np.logspace(-13, -7, 60)]
        rates = np.array([run.functions.explicit_dynamics(0, place, [], run.problem.parameters) for place in places])[:, half:]
        assert np.ptp(rates, axis=0).max() < 1e-4


@pytest.mark.parametrize("reading", READINGS.values(), ids=READINGS)
def test_a_source_on_a_flange_reads_what_a_force_may_read(reading):
    """It turns the hinge as a torque of the same expression does, and its work is counted."""
    ends = []
    for on_flange in (False, True):
        scene = pushed(lambda _: (0.0, 0.0, 0.0))
        size = reading(scene)[0]
        scene.turn = TorqueSource(size) if on_flange else Torque((0, size, 0))
        scene.connect(scene.turn.flange if on_flange else scene.turn.frame, scene.hinge.flange if on_flange else scene.rod.frame)
        run = ac.build(scene).simulate(0.5, {scene.hinge.q: 0.5, scene.hinge.v: 1.0}, rtol=1e-9)
        assert run.energy_error() < 1e-6
        ends.append(run[scene.hinge.q])
    assert np.max(np.abs(ends[0] - ends[1])) < 1e-7


@pytest.mark.parametrize(
    "part",
    [
        lambda s, e: RotationalSpring(3.0 * e), lambda s, e: RotationalSpring(3.0, e), lambda s, e: RotationalDamper(e), lambda s, e: Inertia(e),
    ],
    ids=["stiffness", "angle", "damping", "inertia"],
)  # fmt: skip
@pytest.mark.parametrize("reading", ["time", "position", "velocity", "acceleration", "interpolant"])
def test_parts_on_shafts_that_change_keep_the_balance_of_energy(part, reading):
    """Who makes a stiffness or an inertia change does work, and that is counted."""
    scene = Pendulum()
    table = ca.interpolant("table", "bspline", [np.linspace(-4, 4, 12)], np.cos(np.linspace(-4, 4, 12)))
    values = {
        "time": ca.sin(3 * ac.time), "position": scene.hinge.q, "velocity": scene.hinge.v, "acceleration": 0.1 * ac.der(scene.hinge.v),
        "interpolant": table(scene.hinge.q),
    }  # fmt: skip
    scene.part, scene.held = part(scene, 2.0 + 0.3 * values[reading]), RotationalGround()
    scene.connect(scene.hinge.flange, scene.part.flange_b)
    if not isinstance(scene.part, Inertia):
        scene.connect(scene.part.flange_a, scene.held.flange)
    run = ac.build(scene).simulate(1.0, {scene.hinge.q: 1.0}, rtol=1e-9)
    assert run.energy_error() < 1e-7
    assert np.ptp(run[scene.hinge.q]) > 0.05


@each_value(("kind", ["linear", "bspline"]), ("dimensions", [1, 2, 3]))
def test_interpolants_of_casadi_are_formulas(kind, dimensions):
    """The same numbers as CasADi's own function, also outside of the table."""
    rng = np.random.default_rng(dimensions)
    axes = [np.sort(rng.uniform(-1, 2, n)) for n in (9, 5, 4)[:dimensions]]
    table = ca.interpolant("table", kind, axes, rng.normal(size=int(np.prod([a.size for a in axes]))))
    x = ca.SX.sym("x", dimensions)
    shown = formula(2 * table(x) + ca.sin(x[0]), "it")
    places = rng.uniform(-1.5, 2.5, (dimensions, 200))
    found, wanted = (np.array(ca.Function("f", [x], [e])(places)).ravel() for e in (shown, 2 * table(x) + ca.sin(x[0])))
    assert np.max(np.abs(found - wanted)) < 1e-10 * np.max(np.abs(wanted))


def test_energies_and_powers_of_single_forces_are_read_and_add_up():
    scene = ac.System()
    scene.world, scene.particle, scene.hinges = World(), Particle(0.5), [Revolute("y"), Revolute("x")]
    scene.upper, scene.lower = RigidBody.rod(1.0, (1, 0, 0)), RigidBody.rod(1.0, (1, 0, 0.2))
    for hinge, before, body in (
        (scene.hinges[0], scene.world.frame, scene.upper),
        (scene.hinges[1], scene.upper.tip, scene.lower),
    ):
        scene.connect(before, hinge.frame_a)
        scene.connect(hinge.frame_b, body.frame)
    k, natural, c = 20.0, 1.0, 0.7
    scene.strut, scene.push = SpringDamper(k, natural, c), Force(lambda t: (ca.sin(t), 0, 1.0))
    scene.mount = Bushing((3.0, 4.0, 5.0, 6.0, 7.0, 8.0), (0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    scene.bearing = JointFriction(scene.hinges[0], Coulomb(0.2), radius=0.1)
    scene.connect(scene.lower.tip, scene.strut.point_a)
    scene.connect(scene.particle.point, scene.strut.point_b)
    scene.connect(scene.push.point, scene.upper.tip)
    scene.connect(scene.world.at((1, 1, 0)), scene.mount.frame_a)
    scene.connect(scene.lower.frame, scene.mount.frame_b)
    begin = {
        scene.hinges[0].v: 1.0,
        scene.hinges[1].v: 2.0,
        scene.particle.point.position: (3.0, 1, 0),
        scene.particle.point.velocity: (0, 0, 0),
    }
    run = ac.build(scene).simulate(1.0, begin, rtol=1e-10, samples=2001)
    lost = sum(run[part.dissipated_power()] for part in (scene.strut, scene.push, scene.mount, scene.bearing))
    np.testing.assert_allclose(run.energy + cumulative_simpson(lost, x=run.t, initial=0), run.energy[0], atol=1e-5)
    far = run[scene.particle.point.position] - run[scene.lower.tip.position]
    moves = run[scene.particle.point.velocity] - run[scene.lower.tip.velocity]
    length = np.linalg.norm(far, axis=1)
    np.testing.assert_allclose(run[scene.strut.distance], length, rtol=1e-12)
    np.testing.assert_allclose(
        run[scene.strut.pull], k * (length - natural) + c * np.sum(far * moves, axis=1) / length, rtol=1e-9
    )
    np.testing.assert_allclose(run[scene.strut.pull], np.sum(run[scene.strut.point_b.force] * far, axis=1) / length, rtol=1e-9)
    assert run.label(scene.strut.pull) == "strut.pull" and run.label(scene.strut.distance) == "strut.distance"
    with pytest.raises(ac.errors.UnknownVariableError, match=r"'tension' of SpringDamper .* read scene\.spring\.pull"):
        run[scene.strut.tension]
    np.testing.assert_allclose(run[scene.strut.stored_energy()], 0.5 * k * (length - natural) ** 2, rtol=1e-9)
    np.testing.assert_allclose(run[scene.strut.dissipated_power()], c * (np.sum(far * moves, axis=1) / length) ** 2, rtol=1e-9)


CURVES: dict[str, Callable[..., Any]] = {
    "cubic": CubicSpline, "pchip": PchipInterpolator, "akima": Akima1DInterpolator, "b-spline": make_interp_spline, "linear": interp1d, "periodic":
    lambda x, y: CubicSpline(x, np.append(y[:-1], y[0]), bc_type="periodic"), "samples": lambda x, y: ac.samples(x, y, "cubic"),
    "smoothed": lambda x, y: UnivariateSpline(x, y, s=1.0), "columns": lambda x, y: CubicSpline(x, np.column_stack([y, -y**2])),
}  # fmt: skip


@pytest.mark.parametrize("curve", CURVES.values(), ids=CURVES)
def test_curves_of_scipy_are_looked_up_at_expressions(curve):
    """The same numbers as scipy's, where data are, and beyond where it gives any."""
    rng = np.random.default_rng(4)
    points = np.sort(rng.uniform(-1, 2, 9))
    found, x = curve(points, rng.normal(size=9)), ca.SX.sym("x")
    read = ca.Function("read", [x], [ac.lookup(found, ac.Expression(2 * x, frozenset())).sx])
    places = rng.uniform(-2, 3, 100)
    if isinstance(found, interp1d):
        places = places[(places >= points[0]) & (places <= points[-1])]
    wanted = np.array([found(place) for place in places])
    np.testing.assert_allclose(
        np.array([read(place / 2) for place in places]).reshape(wanted.shape), wanted, rtol=1e-9, atol=1e-9
    )


TABLES: dict[str, Callable[..., Any]] = {
    "rectangle": lambda x, y, z: RectBivariateSpline(x, y, z, kx=2, ky=3), "smoothed": lambda x, y, z: RectBivariateSpline(x, y, z, s=0.5),
    "scattered": lambda x, y, z: SmoothBivariateSpline(np.repeat(x, y.size), np.tile(y, x.size), z.ravel(), kx=2, ky=2),
    "linear": lambda x, y, z: RegularGridInterpolator((x, y), z, bounds_error=False, fill_value=None),
    "filled": lambda x, y, z: RegularGridInterpolator((x, y), z, bounds_error=False, fill_value=7.0),
    "cubic": lambda x, y, z: RegularGridInterpolator((x, y), z, "cubic", bounds_error=False, fill_value=None, solver=_direct),
    "quintic": lambda x, y, z: RegularGridInterpolator((x, y), z, "quintic", bounds_error=False, fill_value=np.nan, solver=_direct),
    "b-spline": lambda x, y, z: NdBSpline((np.r_[x[0] - 1, x, x[-1] + 1], np.r_[y[0] - 1, y, y[-1] + 1]), z[:, :-1], (1, 2)),
    "casadi": lambda x, y, z: ca.interpolant("table", "bspline", [x, y], z.ravel(order="F")),
}  # fmt: skip


def _direct(A, b, **_):
    """In place of scipy's own way, which stops at 1e-6."""
    return np.linalg.solve(A.toarray(), b), 0


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_tables_of_two_variables_are_looked_up_and_are_ground_to_stand_on(table):
    """The same numbers as scipy's, on the data and beyond, at expressions, and as the height of a ground."""
    rng = np.random.default_rng(6)
    x, y = np.sort(rng.uniform(-1, 2, 8)), np.sort(rng.uniform(-3, 1, 7))
    found = table(x, y, rng.normal(size=(8, 7)))
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    read = ca.Function("read", [a, b], [ac.lookup(found, 2 * a, b - 1).sx, HeightField(found).point(ca.vertcat(2 * a, b - 1))[2]])
    inside = isinstance(found, ca.Function)  # CasADi's are zero beyond, ours too, but for the border itself
    for u, w in zip(
        rng.uniform(x[0], x[-1], 60) if inside else rng.uniform(-2, 3, 60),
        rng.uniform(y[0], y[-1], 60) if inside else rng.uniform(-4, 2, 60),
        strict=True,
    ):
        wanted = found(u, w) if isinstance(found, BivariateSpline) else np.array(found([u, w]))
        np.testing.assert_allclose([float(value) for value in read(u / 2, w + 1)], [wanted.item()] * 2, rtol=1e-9, atol=1e-9)


def test_tables_have_as_many_variables_as_they_are_asked_at():
    grid = [np.linspace(0, 1, 4)] * 3
    values = np.random.default_rng(1).normal(size=(4, 4, 4))
    at = ca.SX.sym("at", 3)
    read = ca.Function("read", [at], [ac.lookup(RegularGridInterpolator(grid, values), at).sx])
    for place in np.random.default_rng(2).uniform(0, 1, (20, 3)):
        assert float(read(place)) == pytest.approx(RegularGridInterpolator(grid, values)(place).item(), rel=1e-12)
    assert np.isnan(float(read([0.5, 0.5, 1.1])))
    for given, said in (
        (RegularGridInterpolator(grid, values), "has 3 variables, and was given 2"),
        (RegularGridInterpolator(grid, values, "nearest"), "'nearest' cannot stand here"),
        (RegularGridInterpolator(grid[:2], values), "more than one value"),
        (RBFInterpolator(np.eye(2), [0, 1], kernel="linear"), "no piecewise polynomial"),
        (ca.interpolant("table", "linear", [grid[0]], values[0, 0]), "one variable"),
    ):
        with pytest.raises(ac.errors.ParameterError, match=said):
            ac.lookup(given, ac.time, 2.0)


LAWS: dict[str, Callable[..., Any]] = {
    "curve": lambda: ParametricCurve(lambda s: (np.cos(s), np.sin(s), np.exp(s) * np.hypot(s, 1.0))),
    "surface": lambda: HeightField(lambda x, y: np.maximum(x, np.sqrt(1 + y**2))),
    "shape": lambda: ConvexShape(lambda n: np.sqrt(n[0] ** 2 + 2 * n[1] ** 2 + 3 * n[2] ** 2) + np.linalg.norm(n)),
    "field": lambda: PotentialField(lambda p, t: np.sin(t) * np.dot(p, p)),
    "spring": lambda: NonlinearSpring(lambda length: np.log(np.cosh(length))),
}  # fmt: skip


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_laws_of_parts_take_functions_of_numpy(law):
    """Without a word of CasADi's (warnings are errors here)."""
    law()


def test_rotor_runs_up_by_a_curve_of_its_speed():
    """As its time says: the integral of inertia over torque."""
    curve = PchipInterpolator([0, 50, 100, 200, 400], [10, 12, 11, 6, 0.5])
    scene = ac.System()
    scene.rotor = Inertia(0.5)
    scene.motor = TorqueSource(ac.lookup(curve, scene.rotor.w))
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    end = sum(quad(lambda w: 0.5 / curve(w), a, b, epsabs=1e-12)[0] for a, b in itertools.pairwise([0, 50, 100, 200, 300]))
    run = ac.build(scene).simulate(end, {scene.rotor.w: 0.0}, rtol=1e-11)
    assert run[scene.rotor.w][-1] == pytest.approx(300.0, rel=1e-10)


def test_what_is_no_curve_of_one_variable_is_refused_and_curves_that_are_called_are_told_of():
    curve = CubicSpline([0, 1, 2], [0, 1, 0])
    for given, at, said in ((3, ac.time, "no curve"), (curve, ca.SX.sym("x", 2), "one variable, and was given 2")):
        with pytest.raises(ac.errors.ParameterError, match=said):
            ac.lookup(given, at)
    with pytest.raises(ac.errors.ExpressionError, match=r"ac\.lookup"):
        curve(Inertia(1.0).w)


NUMPY: dict[str, Callable[..., Any]] = {
    "norm": lambda a, b, x: np.linalg.norm(a), "cross": lambda a, b, x: np.cross(a, b), "dot": lambda a, b, x: np.dot(a, b), "sum": lambda a, b, x: np.sum(a),
    "where": lambda a, b, x: np.where(x > 0.5, x, -x), "clip": lambda a, b, x: np.clip(x, 0.2, 0.6), "concatenate": lambda a, b, x: np.concatenate((a, b)),
    "interp": lambda a, b, x: np.interp(x, (0.0, 0.5, 1.0), (1.0, 3.0, 2.0)), "remainder": lambda a, b, x: np.remainder(-x, 0.3), "outer": lambda a, b, x: np.outer(a, b),
    "log10": lambda a, b, x: np.log10(x), "heaviside": lambda a, b, x: np.heaviside(x - 0.5, 0.5), "logical": lambda a, b, x: np.logical_and(x > 0.2, x < 0.6),
    "degrees": lambda a, b, x: np.rad2deg(x) + np.radians(x), "arctanh": lambda a, b, x: np.arctanh(x), "solve": lambda a, b, x: np.linalg.solve(np.outer(a, b) + np.eye(3), a),
    "%": lambda a, b, x: -x % 0.3, "//": lambda a, b, x: a // 0.2, "&": lambda a, b, x: (a > 0.2) & (b < 0.6), "|": lambda a, b, x: (a > 0.7) | (b < 0.3),
}  # fmt: skip


@pytest.mark.parametrize("function", NUMPY.values(), ids=NUMPY)
def test_functions_of_numpy_take_expressions(function):
    """The same as of numbers."""
    a, b, x = ca.SX.sym("a", 3), ca.SX.sym("b", 3), ca.SX.sym("x")
    read = ca.Function("read", [a, b, x], [ca.densify(function(*(ac.Expression(s, frozenset()) for s in (a, b, x))).sx)])
    rng = np.random.default_rng(0)
    for _ in range(5):
        at = rng.uniform(0.1, 0.9, 3), rng.uniform(0.1, 0.9, 3), float(rng.uniform(0.1, 0.9))
        wanted = np.asarray(function(*at), dtype=float)
        assert np.max(np.abs(np.array(read(*at)).reshape(wanted.shape) - wanted)) < 1e-13


def test_functions_of_numpy_that_do_not_are_named():
    expression = Pendulum().rod.tip.position
    with pytest.raises(ac.errors.ExpressionError, match=r"numpy.median .*test_readings.py:.*ac.norm"):
        np.median(expression)
    with pytest.raises(ac.errors.ExpressionError, match=r"numpy.sum with axis="):
        np.sum(expression, axis=0)


def test_torques_that_forces_pass_on_are_read_at_both_of_their_ends():
    """A wheel on a rubber mount, elastic and damped; its stretch is 2 sin(a / 2)."""
    scene = ac.System()
    scene.world, scene.hinge, scene.wheel = World(None), Revolute("z"), RigidBody(2.0, (0.1, 0.2, 0.3))
    scene.mount = Bushing((0, 0, 5.0, 0, 0, 0), damping=(0, 0, 0.4, 0, 0, 0))
    scene.connect(scene.world.frame, scene.hinge.frame_a, scene.mount.frame_a)
    scene.connect(scene.hinge.frame_b, scene.wheel.frame, scene.mount.frame_b)
    run = ac.build(scene).simulate(2.0, {scene.hinge.q: 0.8}, rtol=1e-12)
    wanted = 5.0 * np.sin(run[scene.hinge.q]) + 0.4 * run[scene.hinge.v]
    np.testing.assert_allclose(run[scene.mount.frame_b.torque], np.outer(wanted, (0, 0, 1)), atol=1e-13)
    np.testing.assert_allclose(run[scene.mount.frame_a.torque], np.outer(-wanted, (0, 0, 1)), atol=1e-13)
    np.testing.assert_allclose(run[ac.der(scene.hinge.v)], -wanted / 0.3, atol=1e-12)
