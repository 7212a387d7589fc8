"""Equations between positions of joints and scalar states, in every mixture: against closed forms and Lagrange's equations in one freedom.

With one freedom u and the kinetic energy m(u) u'^2 / 2, the potential V(u): m u'' + m' u'^2 / 2 + V' = 0.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import JumpWarning, ParameterError, StartValueError, UnderdeterminedError
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, rotation_about_z
from components import (
    Cylindrical,
    Gear,
    Inertia,
    Integrator,
    Particle,
    PlanetaryGear,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    Screw,
    SlidingMass,
    SpeedSource,
    TimeFunction,
    TorqueSource,
    VelocitySource,
    World,
)
from tests.pairings import each_value
from tests.scenes import Pendulum
from tests.test_elimination import slider_crank

G = 9.81


class Circle(ac.Component):
    """Two slides on a unit circle with an angle of its own; `implicit`: the same circle by other equations."""

    x, y = ac.Translational.port(), ac.Translational.port()
    pull, psi = ac.Variable("N"), ac.Variable("rad", start=-0.927)

    def __init__(self, implicit: bool) -> None:
        self.implicit = implicit

    def equations(self):
        c, s = np.cos(self.psi), np.sin(self.psi)
        if self.implicit:
            yield ac.equal(self.x.s * c + self.y.s * s, 1.0)
            yield ac.equal(self.y.s * c - self.x.s * s, 0.0)
        else:
            yield ac.equal(self.x.s, c)
            yield ac.equal(self.y.s, s)
        yield ac.equal(self.x.f, self.pull * self.x.s)
        yield ac.equal(self.y.f, self.pull * self.y.s)


class Cam(ac.Component):
    """slide = f(shaft), without losses."""

    slide, shaft = ac.Translational.port(), ac.Rotational.port()
    times = 1.0

    def __init__(self, f: Callable, slope: Callable) -> None:
        self.f, self.slope = f, slope

    def equations(self):
        yield ac.equal(self.times * self.slide.s, self.times * self.f(self.shaft.phi))
        yield ac.equal(self.shaft.tau + self.slide.f * self.slope(self.shaft.phi), 0.0)


class Ratio(ac.Component):
    """a = b + 0.3 sin b between two shafts, without losses."""

    a, b = ac.Rotational.port(), ac.Rotational.port()

    def equations(self):
        yield ac.equal(self.a.phi, self.b.phi + 0.3 * np.sin(self.b.phi))
        yield ac.equal(self.b.tau + self.a.tau * (1 + 0.3 * np.cos(self.b.phi)), 0.0)


class Product(ac.Component):
    """slide times shaft is 1."""

    slide, shaft = ac.Translational.port(), ac.Rotational.port()
    pull = ac.Variable("N")

    def equations(self):
        yield ac.equal(self.slide.s * self.shaft.phi, 1.0)
        yield ac.equal(self.slide.f, self.pull * self.shaft.phi)
        yield ac.equal(self.shaft.tau, self.pull * self.slide.s)


def one_freedom(mass: Callable, potential: Callable, u: float, rate: float, times: np.ndarray) -> np.ndarray:
    """u at the times, from the kinetic energy mass(u) u'^2 / 2 and the potential(u)."""
    q = ca.SX.sym("u")
    m, V = mass(q), potential(q)
    slopes = ca.Function("slopes", [q], [m, ca.jacobian(m, q), ca.jacobian(V, q)])

    def derivative(t: float, y: np.ndarray) -> list[float]:
        m, dm, dV = (float(f) for f in slopes(y[0]))
        return [y[1], -(0.5 * dm * y[1] ** 2 + dV) / m]

    return solve_ivp(derivative, (0, times[-1]), [u, rate], "DOP853", times, rtol=1e-13, atol=1e-13).y[0]


def lifted(mass: float) -> ac.System:
    """A particle on a vertical slide."""
    scene = ac.System()
    scene.world, scene.slide, scene.block = World(), Prismatic("z"), RigidBody.ball(mass, 0.1)
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.block.frame)
    return scene


def sine(r: float) -> Cam:
    return Cam(lambda x: r * np.sin(x), lambda x: r * np.cos(x))


def checked(scene: ac.System, start: dict, constraints: int, end: float = 2.0) -> ac.Trajectory:
    """The motion of a scene of one freedom, its energy and constraints kept to rounding, its table and freedoms counted."""
    model = ac.build(scene)
    table = model.constraints()
    assert (model.degrees_of_freedom, table.configuration_freedom, table.velocity_freedom) == (1, 1, 1)
    assert sum(entry.kind == "holonomic" for entry in table) == constraints
    run = model.simulate(end, start, rtol=1e-11)
    assert run.energy_error() < 1e-11
    assert run.constraint_error() < 1e-13
    return run


@pytest.mark.parametrize("implicit", [False, True])
def test_a_bead_on_a_circle_with_an_angle_of_its_own(implicit):
    scene = ac.System()
    scene.world, scene.across, scene.along, scene.bead = World((0, -G, 0)), Prismatic("x"), Prismatic("y"), Particle(1.0)
    scene.circle = Circle(implicit)
    scene.connect(scene.world.frame, scene.across.frame_a)
    scene.connect(scene.across.frame_b, scene.along.frame_a)
    scene.connect(scene.along.frame_b, scene.bead.point)
    scene.connect(scene.across.flange, scene.circle.x)
    scene.connect(scene.along.flange, scene.circle.y)
    run = checked(scene, {scene.across.q: 0.6, scene.along.q: -0.8}, 2, 3.0)
    exact = one_freedom(lambda u: ca.SX(1), lambda u: G * ca.sin(u), np.arctan2(-0.8, 0.6), 0.0, run.t)
    np.testing.assert_allclose(run[scene.circle.psi], exact, atol=1e-10)
    np.testing.assert_allclose(run[scene.across.q], np.cos(exact), atol=1e-10)
    model = ac.build(scene)
    hanging = model.linearize({scene.across.q: 0.0, scene.along.q: -1.0, scene.circle.psi: -np.pi / 2})
    np.testing.assert_allclose(hanging.eigenvalues, [1j * np.sqrt(G), -1j * np.sqrt(G)], atol=1e-10)
    small = model.minimal({scene.across.q: 0.6, scene.along.q: -0.8})
    assert len(small.state_names) == 2
    np.testing.assert_allclose(small.simulate(1.0, rtol=1e-11)[scene.circle.psi][-1], run.at(1.0)[scene.circle.psi][0], atol=1e-9)
    assert len(model.branches({scene.across.q: 0.6}, searches=30)) == 2


@pytest.mark.parametrize("where", ["scalar", "joint"])
def test_a_yoke_on_an_inertia_or_on_a_hinge(where):
    r, m, J = 0.3, 2.0, 0.1
    scene = lifted(m)
    scene.cam = sine(r)
    if where == "scalar":
        scene.rotor = Inertia(J)
        scene.connect(scene.rotor.flange_a, scene.cam.shaft)
        angle, rate = scene.rotor.phi, scene.rotor.w
    else:
        scene.hinge, scene.wheel = Revolute("y"), RigidBody(1.0, (J, J, J))
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.wheel.frame)
        scene.connect(scene.hinge.flange, scene.cam.shaft)
        angle, rate = scene.hinge.q, scene.hinge.v
    scene.connect(scene.slide.flange, scene.cam.slide)
    run = checked(scene, {angle: 0.2, rate: 3.0}, 1)
    exact = one_freedom(lambda u: J + m * (r * ca.cos(u)) ** 2, lambda u: m * G * r * ca.sin(u), 0.2, 3.0, run.t)
    np.testing.assert_allclose(run[angle], exact, atol=1e-10)
    np.testing.assert_allclose(run[scene.slide.q], r * np.sin(exact), atol=1e-10)


def test_two_couplings_in_series():
    r, m, J = 0.3, 2.0, 0.1
    scene = lifted(m)
    scene.cam, scene.ratio, scene.rotor = sine(r), Ratio(), Inertia(J)
    scene.connect(scene.slide.flange, scene.cam.slide)
    scene.connect(scene.cam.shaft, scene.ratio.a)
    scene.connect(scene.ratio.b, scene.rotor.flange_a)
    run = checked(scene, {scene.rotor.phi: 0.2, scene.rotor.w: 3.0}, 2)
    height = lambda u: r * ca.sin(u + 0.3 * ca.sin(u))  # noqa: E731
    slope = lambda u: r * ca.cos(u + 0.3 * ca.sin(u)) * (1 + 0.3 * ca.cos(u))  # noqa: E731
    exact = one_freedom(lambda u: J + m * slope(u) ** 2, lambda u: m * G * height(u), 0.2, 3.0, run.t)
    np.testing.assert_allclose(run[scene.rotor.phi], exact, atol=1e-10)


def test_a_product_and_a_parabola_between_slide_and_shaft():
    m, J = 2.0, 0.1
    scene = lifted(m)
    scene.tie, scene.rotor = Product(), Inertia(J)
    scene.connect(scene.slide.flange, scene.tie.slide)
    scene.connect(scene.rotor.flange_a, scene.tie.shaft)
    run = checked(scene, {scene.slide.q: 2.0, scene.rotor.w: 0.5}, 1, 0.5)
    exact = one_freedom(lambda u: m + J / u**4, lambda u: m * G * u, 2.0, -0.5 * 4.0, run.t)
    np.testing.assert_allclose(run[scene.slide.q], exact, atol=1e-10)


class Belt(ac.Component):
    """Between two pulleys with radii r and s."""

    a, b = ac.Rotational.port(), ac.Rotational.port()
    pull = ac.Variable("N")

    def __init__(self, r: ac.Expression, s: ac.Expression) -> None:
        self.r, self.s = r, s

    def equations(self):
        yield ac.equal(self.r * ac.der(self.a.phi), self.s * ac.der(self.b.phi))
        yield ac.equal(self.a.tau, self.r * self.pull)
        yield ac.equal(self.b.tau, -self.s * self.pull)


def belt_on_two_shafts(inertias: tuple[float, float], r: ac.Expression, s: ac.Expression) -> ac.System:
    scene = ac.System()
    scene.world, scene.hinges = World((0, 0, 0)), [Revolute("z") for _ in inertias]
    scene.wheels = [RigidBody(1.0, (J, J, J)) for J in inertias]
    for hinge, wheel in zip(scene.hinges, scene.wheels, strict=True):
        scene.connect(scene.world.frame, hinge.frame_a)
        scene.connect(hinge.frame_b, wheel.frame)
    scene.belt = Belt(r, s)
    scene.connect(scene.belt.a, scene.hinges[0].flange)
    scene.connect(scene.belt.b, scene.hinges[1].flange)
    return scene


def test_a_belt_on_pulleys_of_any_radii_takes_a_freedom_though_they_are_zero_unless_told():
    r, s, J = ac.Input("m"), ac.Input("m"), (0.3, 0.7)
    scene = belt_on_two_shafts(J, r, s)
    scene.r, scene.s, scene.motor = r, s, TorqueSource(2.0)
    scene.connect(scene.motor.flange, scene.hinges[0].flange)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(1.0, inputs={scene.r: 0.2, scene.s: 0.5}, rtol=1e-11)
    assert run[scene.hinges[1].v] == pytest.approx(run.t * 2.0 * 0.4 / (J[0] + J[1] * 0.4**2), rel=1e-11)


def test_radii_that_signals_tell_do_not_yield_to_a_belt():
    """Its ratio k changes, energy does not: w = w_0 sqrt((J_1 + J_2 k_0^2) / (J_1 + J_2 k^2))."""
    J, radii, rates = (0.3, 0.7), (0.2, 0.5), (0.1, -0.2)
    r, s = Integrator(), Integrator()
    scene = belt_on_two_shafts(J, r.x, s.x)
    scene.r, scene.s, scene.told = r, s, [TimeFunction(lambda t, rate=rate: rate + 0 * t) for rate in rates]
    for told, radius in zip(scene.told, (r, s), strict=True):
        scene.connect(told.output, radius.input)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(1.0, {r.x: radii[0], s.x: radii[1], scene.hinges[0].v: 3.0}, rtol=1e-11)
    k = (radii[0] + rates[0] * run.t) / (radii[1] + rates[1] * run.t)
    assert run[scene.hinges[0].v] == pytest.approx(3.0 * np.sqrt((J[0] + J[1] * k[0] ** 2) / (J[0] + J[1] * k**2)), rel=1e-9)
    assert run[scene.hinges[1].v] == pytest.approx(k * run[scene.hinges[0].v], rel=1e-11)


class Slots(ac.Component):
    """Two slides on one of two lines that cross at right angles."""

    x, y = ac.Translational.port(), ac.Translational.port()
    pull = ac.Variable("N")

    def equations(self):
        yield ac.equal(self.x.s * self.y.s, 0.0)
        yield ac.equal(self.x.f, self.pull * self.y.s)
        yield ac.equal(self.y.f, self.pull * self.x.s)


class SameSpeed(ac.Component):
    """What two slides carry moves with the speed V."""

    x, y = ac.Translational.port(), ac.Translational.port()
    pull = ac.Variable("N*s/m")

    def __init__(self, V: float) -> None:
        self.V = V

    def equations(self):
        u, v = ac.der(self.x.s), ac.der(self.y.s)
        yield ac.equal(u * u + v * v, self.V**2)
        yield ac.equal(self.x.f, self.pull * u)
        yield ac.equal(self.y.f, self.pull * v)


def on_two_slides(tie: Slots | SameSpeed, gravity: float) -> ac.System:
    scene = ac.System()
    scene.world, scene.slides, scene.bead, scene.tie = (
        World((gravity, 0, 0)),
        [Prismatic("x"), Prismatic("y")],
        Particle(1.0),
        tie,
    )
    scene.connect(scene.world.frame, scene.slides[0].frame_a)
    scene.connect(scene.slides[0].frame_b, scene.slides[1].frame_a)
    scene.connect(scene.slides[1].frame_b, scene.bead.point)
    scene.connect(scene.slides[0].flange, tie.x)
    scene.connect(scene.slides[1].flange, tie.y)
    return scene


def test_a_bead_in_slots_that_cross_where_it_is_drawn_has_one_freedom():
    scene = on_two_slides(Slots(), 2.0)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(1.0, {scene.slides[0].q: 0.3, scene.slides[1].q: 0.0}, rtol=1e-11)
    assert run[scene.slides[0].q] == pytest.approx(0.3 + run.t**2, rel=1e-11)
    assert np.max(np.abs(run[scene.slides[1].q])) < 1e-14


@pytest.mark.parametrize("V", [0.02, 2.0])
def test_a_speed_that_is_kept_takes_a_freedom_though_all_is_at_rest_unless_told(V):
    # its direction turns by theta' = -(g / V) sin(theta)
    g, theta = 1.5 * V, 2.0
    scene = on_two_slides(SameSpeed(V), g)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    u, v = (slide.v for slide in scene.slides)
    run = model.simulate(1.0, {u: V * np.cos(theta), v: V * np.sin(theta)}, rtol=1e-11)
    assert np.arctan2(run[v], run[u]) == pytest.approx(2 * np.arctan(np.tan(theta / 2) * np.exp(-g / V * run.t)), rel=1e-10)


@pytest.mark.parametrize("k", [0, 1, 2])
def test_a_mass_moved_by_a_cam_on_any_hinge_of_a_loop(k):
    """The third hinge closes the loop; energy and both kinds of constraints hold, and the cam's relation to the last digit."""
    scene = slider_crank()
    scene.cam, scene.mass = sine(0.3), SlidingMass(1.0)
    scene.connect(scene.mass.flange_a, scene.cam.slide)
    scene.connect(scene.hinges[k].flange, scene.cam.shaft)
    run = checked(scene, {scene.hinges[0].q: 0.4, scene.hinges[0].v: 3.0}, 2, 1.0)
    np.testing.assert_allclose(run[scene.mass.s], 0.3 * np.sin(run[scene.hinges[k].q]), atol=1e-14)


def test_a_rotor_on_a_rack_of_changing_ratio_in_a_loop():
    scene = slider_crank()
    scene.cam, scene.rotor = Cam(lambda x: 0.2 * x * x, lambda x: 0.4 * x), Inertia(0.2)
    scene.connect(scene.slider.flange, scene.cam.slide)
    scene.connect(scene.rotor.flange_a, scene.cam.shaft)
    start = {scene.hinges[0].q: 0.4, scene.hinges[0].v: 3.0, scene.rotor.phi: ac.near(2.5)}
    run = checked(scene, start, 3, 1.0)
    np.testing.assert_allclose(run[scene.slider.q], 0.2 * run[scene.rotor.phi] ** 2, atol=1e-14)


def train(planets: int) -> ac.System:
    """Sun, carrier and ring on hinges, planets on hinges of the carrier, a mesh of each with the sun and the ring."""

    class Mesh(ac.Component):
        wheel, planet, carrier = ac.Rotational.port(), ac.Rotational.port(), ac.Rotational.port()

        def __init__(self, teeth: float, planet: float) -> None:
            self.teeth, self.other = teeth, planet

        def equations(self):
            yield ac.equal(self.teeth * (self.wheel.phi - self.carrier.phi) + self.other * self.planet.phi, 0.0)
            yield ac.equal(self.planet.tau * self.teeth, self.other * self.wheel.tau)
            yield ac.equal(self.carrier.tau + self.wheel.tau, 0.0)

    scene = ac.System()
    scene.world, scene.hinges = World(None), [Revolute("z") for _ in range(3)]
    scene.bodies = [RigidBody(1.0, (J, J, J)) for J in (0.1, 0.4, 0.3)]
    for hinge, body in zip(scene.hinges, scene.bodies, strict=True):
        scene.connect(scene.world.frame, hinge.frame_a)
        scene.connect(hinge.frame_b, body.frame)
    sun, carrier, ring = scene.hinges
    scene.axles = [Revolute("z") for _ in range(planets)]
    scene.planets = [RigidBody(0.3 / planets, (0.02 / planets, 0.02 / planets, 0.03 / planets)) for _ in range(planets)]
    scene.inner, scene.outer = [Mesh(30, 20) for _ in range(planets)], [Mesh(-70, 20) for _ in range(planets)]
    for k, (axle, planet) in enumerate(zip(scene.axles, scene.planets, strict=True)):
        a = 2 * np.pi * k / planets
        scene.connect(scene.bodies[1].at((0.5 * np.cos(a), 0.5 * np.sin(a), 0)), axle.frame_a)
        scene.connect(axle.frame_b, planet.frame)
        for mesh, wheel in ((scene.inner[k], sun), (scene.outer[k], ring)):
            scene.connect(mesh.wheel, wheel.flange)
            scene.connect(mesh.planet, axle.flange)
            scene.connect(mesh.carrier, carrier.flange)
    scene.drive = TorqueSource(1.0)
    scene.connect(scene.drive.flange, sun.flange)
    return scene


def test_three_planets_move_as_one_and_share_the_load():
    one, three = train(1), train(3)
    model = ac.build(three)
    assert model.degrees_of_freedom == 2
    assert sum(entry.kind == "redundant" for entry in model.constraints()) == 2
    single, run = ac.build(one).simulate(1.0, rtol=1e-11), model.simulate(1.0, rtol=1e-11)
    for a, b in zip(one.hinges, three.hinges, strict=True):
        np.testing.assert_allclose(run[b.q], single[a.q], atol=1e-11)
    for mesh in three.inner:
        np.testing.assert_allclose(run[mesh.wheel.tau], single[one.inner[0].wheel.tau] / 3, atol=1e-11)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("shafts", ["hinges", "inertias"])
def test_two_equal_gears_agree_and_two_that_do_not_are_named(shafts):
    scene = Pendulum() if shafts == "hinges" else ac.System()
    scene.ratios = [ac.Parameter(-2.0), ac.Parameter(-2.0)]
    scene.gears = [Gear(ratio) for ratio in scene.ratios]
    if shafts == "hinges":
        scene.pivot, scene.arm = Revolute("y"), RigidBody.rod(2.0, (0, 0, -0.5))
        scene.connect(scene.world.at((1, 0, 0)), scene.pivot.frame_a)
        scene.connect(scene.pivot.frame_b, scene.arm.frame)
        first, second, start = scene.hinge.flange, scene.pivot.flange, {scene.hinge.q: 1.0}
    else:
        scene.rotors = [Inertia(0.3), Inertia(1.1)]
        first, second, start = scene.rotors[0].flange_a, scene.rotors[1].flange_a, {scene.rotors[0].w: 1.0}
    for gear in scene.gears:
        scene.connect(first, gear.flange_a)
        scene.connect(second, gear.flange_b)
    model = ac.build(scene)
    run = model.simulate(1.0, start, rtol=1e-10)
    np.testing.assert_allclose(run[scene.gears[0].flange_a.tau], run[scene.gears[1].flange_a.tau], atol=1e-12)
    both = model.simulate(1.0, start, parameters=dict.fromkeys(scene.ratios, -3.0), rtol=1e-10)
    assert both.energy_error() < 1e-8
    with pytest.raises(ParameterError, match=r"gears\[1\].ratio = -3"):
        model.simulate(1.0, start, parameters={scene.ratios[1]: -3.0})


def cams(count: int, size: float, offset: ac.Parameter | float = 0.0) -> ac.System:
    """A mass on a rotor's cams that say the same in other words, but for an `offset` of all others than the first."""
    scene = ac.System()
    scene.mass, scene.rotor, scene.offset, scene.cams = SlidingMass(2.0), Inertia(0.7 * size**2), offset, []
    for k in range(count):
        away = offset if k else 0.0
        cam = Cam(lambda a, away=away: size * (np.sin(a) + 0.2 * a) + away, lambda a: size * (np.cos(a) + 0.2))
        cam.times = 1.0 - 3.0 * k
        scene.cams = [*scene.cams, cam]
        scene.connect(cam.slide, scene.mass.flange_a if k % 2 else scene.mass.flange_b)
        scene.connect(cam.shaft, scene.rotor.flange_b if k % 2 else scene.rotor.flange_a)
    return scene


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_cams_that_say_the_same_share_the_load_and_those_that_do_not_are_named(size):
    one, three, offset = cams(1, size), cams(3, size), ac.Parameter(0.0)
    model = ac.build(three)
    assert sum(entry.kind == "redundant" for entry in model.constraints()) == 2
    single, run = (ac.build(s).simulate(1.0, {s.rotor.phi: 0.3, s.rotor.w: 1.0}, rtol=1e-10) for s in (one, three))
    inertia = 0.7 + 2.0 * (np.cos(run[three.rotor.phi]) + 0.2) ** 2  # what moves by itself keeps its energy
    np.testing.assert_allclose(run[three.rotor.w], np.sqrt((0.7 + 2.0 * (np.cos(0.3) + 0.2) ** 2) / inertia), rtol=1e-9)
    for cam in three.cams:
        np.testing.assert_allclose(3 * run[cam.slide.f], single[one.cams[0].slide.f], rtol=1e-7, atol=1e-9 * size)
    for other, start in ((offset, {offset: 0.1 * size}), (0.1 * size, {})):
        with pytest.raises((ParameterError, UnderdeterminedError), match=r"cams\[[01]\]"):
            apart = cams(2, size, other)
            ac.build(apart).simulate(1.0, {apart.rotor.phi: 0.3}, parameters=start)


def test_three_planetary_gears_between_inertias():
    scene = ac.System()
    scene.sun, scene.arm, scene.ring = Inertia(0.1), Inertia(0.4), Inertia(0.3)
    scene.gears, scene.motor = [PlanetaryGear(2.0) for _ in range(3)], TorqueSource(0.7)
    scene.connect(scene.motor.flange, scene.sun.flange_b)
    for gear in scene.gears:
        scene.connect(gear.sun, scene.sun.flange_a)
        scene.connect(gear.carrier, scene.arm.flange_a)
        scene.connect(gear.ring, scene.ring.flange_a)
    run = ac.build(scene).simulate(1.0, rtol=1e-11)
    a, J = np.array([1.0, -3.0, 2.0]), np.array([0.1, 0.4, 0.3])
    rates = np.linalg.solve(np.block([[np.diag(J), a[:, None]], [a[None, :], np.zeros((1, 1))]]), [0.7, 0, 0, 0])
    np.testing.assert_allclose(run[scene.sun.w], rates[0] * run.t, atol=1e-11)
    for gear in scene.gears:
        np.testing.assert_allclose(run[gear.sun.tau], rates[3] / 3, atol=1e-12)


def driven(value: object, **options: float) -> tuple[ac.System, ac.Trajectory]:
    scene = Pendulum()
    scene.speed = ac.Input("rad/s", **options)
    scene.drive = SpeedSource(scene.speed)
    scene.connect(scene.drive.flange, scene.hinge.flange)
    return scene, ac.build(scene).simulate(2.0, inputs={} if value is None else {scene.speed: value}, rtol=1e-10)


@pytest.mark.parametrize(
    "given",
    [lambda t: np.sin(3 * t), (lambda t: np.sin(3 * t), lambda t: 3 * np.cos(3 * t)), np.sin(3 * ac.time)],
    ids=["function", "pair", "expression"],
)
def test_a_speed_that_is_an_input_moves_a_joint(given):
    """The torque by hand: J w' + m g l / 2 sin q."""
    scene, run = driven(given)
    np.testing.assert_allclose(run[scene.hinge.v], np.sin(3 * run.t), atol=1e-12)
    angle = (1 - np.cos(3 * run.t)) / 3
    np.testing.assert_allclose(run[scene.hinge.q], angle, atol=1e-9)
    torque = np.cos(3 * run.t) + G / 2 * np.sin(angle)
    np.testing.assert_allclose(-run[scene.drive.flange.tau], torque, atol=1e-8)
    assert run.energy_error() < 1e-9


def test_a_constant_speed_needs_no_rate():
    scene, run = driven(None, default=2.0)
    np.testing.assert_allclose(run[scene.hinge.q], 2 * run.t, atol=1e-11)
    model = ac.build(scene)
    assert model.input_names == ("speed", "der(speed)")
    (entry,) = model.constraints()
    assert (entry.kind, entry.known, model.degrees_of_freedom) == ("rheonomic", "given by an input", 0)


def test_an_input_without_a_rate_is_told():
    with pytest.raises(ParameterError, match=r"rate der\(speed\) is needed.*give its rates with it"):
        driven(lambda t: float(np.interp(float(t), [0, 1, 2], [0, 1, 0])))


def test_a_jump_of_a_prescribed_speed_is_told():
    with pytest.warns(JumpWarning, match="input speed is off by 1 of what its rate says"):
        driven((lambda t: float(t > 1), lambda t: 0.0))


def test_a_crank_and_a_belt_at_given_speeds():
    scene = slider_crank()
    scene.speed = ac.Input("rad/s", default=3.0)
    scene.drive = SpeedSource(scene.speed)
    scene.connect(scene.drive.flange, scene.hinges[0].flange)
    run = ac.build(scene).simulate(2.0, {scene.hinges[0].q: 0.7}, inputs={scene.speed: lambda t: 3 + t}, rtol=1e-11)
    np.testing.assert_allclose(run[scene.hinges[0].q], 0.7 + 3 * run.t + run.t**2 / 2, atol=1e-11)
    assert run.constraint_error() < 1e-13 and run.energy_error() < 1e-9
    other = lifted(1.0)
    other.speed = ac.Input("m/s")
    other.belt = VelocitySource(other.speed)
    other.connect(other.belt.flange, other.slide.flange)
    moved = ac.build(other).simulate(1.0, inputs={other.speed: lambda t: t * t}, rtol=1e-10)
    np.testing.assert_allclose(moved[other.slide.q], moved.t**3 / 3, atol=1e-10)
    np.testing.assert_allclose(-moved[other.belt.flange.f], G + 2 * moved.t, atol=1e-9)


def test_a_scene_that_only_moves_as_prescribed_has_its_reactions():
    scene = ac.System()
    scene.world, scene.table, scene.rod = World(), PrescribedMotion(angle=2 * ac.time, axis="z"), RigidBody.rod(1.0, (1, 0, 0))
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.rod.frame)
    model = ac.build(scene)
    assert model.state_names == () and model.degrees_of_freedom == 0
    run = model.simulate(1.0)
    np.testing.assert_allclose(
        run[scene.rod.tip.position], np.stack([np.cos(2 * run.t), np.sin(2 * run.t), 0 * run.t], axis=1), atol=1e-14
    )
    pull = np.stack([2 * np.cos(2 * run.t), 2 * np.sin(2 * run.t), 0 * run.t - G], axis=1)
    np.testing.assert_allclose(run[scene.table.frame_a.force], -pull, atol=1e-12)


def test_a_prescribed_speed_leaves_one_place_free_in_minimal_coordinates():
    scene = slider_crank(SpeedSource(3.0))
    small = ac.build(scene).minimal({scene.hinges[0].q: 0.7})
    assert len(small.state_names) == 1
    run = small.simulate(1.0, rtol=1e-10)
    np.testing.assert_allclose(run[scene.hinges[0].q][-1], 3.7, atol=1e-9)


class Shaft(AbstractJoint):
    """A hinge about y whose end is called otherwise."""

    end = ac.Rotational.port()
    q = ac.Variable("rad")
    v = ac.Variable("rad/s")

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(rotation_about_z(q), np.zeros(3))


def test_a_flange_of_a_joint_of_one_s_own_may_have_any_name():
    """A torque at it and a rotor behind it do what they do at the catalogue's hinge, and it reads what that reads."""
    found: list[np.ndarray] = []
    for hinge in (Shaft(), Revolute("z")):
        scene = ac.System()
        scene.world, scene.hinge, scene.rod = World((0, -9.81, 0)), hinge, RigidBody.rod(1.0, (0.5, 0, 0))
        scene.rotor, scene.motor = Inertia(0.1), TorqueSource(0.7)
        flange = hinge.connectors()[-1]
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        scene.connect(flange, scene.rotor.flange_a)
        scene.connect(scene.motor.flange, scene.rotor.flange_b)
        run = ac.build(scene).simulate(1.0, rtol=1e-11)
        found.append(np.column_stack([run[scene.hinge.q], run[flange.phi], run[flange.tau]]))
    assert np.max(np.abs(found[0] - found[1])) < 1e-9 and np.max(np.abs(found[0][:, 0] - found[0][:, 1])) < 1e-15
    assert np.ptp(found[0][:, 0]) > 0.5


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e4])
@pytest.mark.parametrize("pitch", [0.02, -0.3])
def test_a_torque_at_a_screw_lifts_its_nut(pitch: float, size: float) -> None:
    """Through a gear, against gravity: (J + i^2 Jm + m h^2) q'' = i M - m g h; its nut runs in a guide, too."""
    h, m, J, Jm, i, g, M = pitch / (2 * np.pi), 2.0, 0.03, 0.002, 5.0, 9.81, 0.7
    scene = ac.System()
    scene.world, scene.screw, scene.guide = World((0, 0, -g * size)), Screw("z", pitch=pitch * size), Cylindrical("z")
    scene.nut = RigidBody(m, inertia=(J * size**2,) * 3)
    scene.motor, scene.gear, scene.torque = Inertia(Jm * size**2), Gear(i), TorqueSource(M * size**2)
    scene.connect(scene.world.frame, scene.screw.frame_a, scene.guide.frame_a)
    scene.connect(scene.screw.frame_b, scene.guide.frame_b, scene.nut.frame)
    scene.connect(scene.torque.flange, scene.motor.flange_a)
    scene.connect(scene.motor.flange_b, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.screw.flange)
    run = ac.build(scene).simulate(2.0, {scene.screw.q: 1.0, scene.screw.v: 0.3}, rtol=1e-11)
    turned = 1.0 + 0.3 * run.t + (i * M - m * g * h) / (J + i**2 * Jm + m * h**2) * run.t**2 / 2
    assert np.max(np.abs(run[scene.screw.q] - turned)) < 1e-9 * np.max(np.abs(turned))
    assert np.max(np.abs(run[scene.nut.frame.position[2]] / size - h * turned)) < 1e-9 * np.max(np.abs(h * turned))
    assert run[scene.motor.phi] == pytest.approx(i * run[scene.screw.q])


@each_value(("beside", ["turns", "shifts"]), (("size", "pace"), [(1e-3, 1e3), (1.0, 1.0), (1e3, 1e-3), (1e-3, 1e-3)]))
def test_what_rounding_leaves_of_velocities_is_no_contradiction(size, pace, beside):
    scene = cams(1, size)
    scene.other = Inertia(1.0) if beside == "turns" else SlidingMass(1.0)
    model, (fast, much) = ac.build(scene), (scene.other.w, 1.0) if beside == "turns" else (scene.other.v, size)
    at = {scene.rotor.phi: 0.3, fast: pace * much}
    noise = np.finfo(float).eps * pace * np.random.default_rng(1).uniform(-1, 1, (5, 2))
    for turn, shift in noise:
        model.initial_state({**at, scene.rotor.w: turn, scene.mass.v: size * shift})
        with pytest.raises(StartValueError, match=r"mass\.v"):
            model.initial_state({**at, scene.rotor.w: 1e6 * turn, scene.mass.v: 1e6 * size * shift})
    run = model.simulate(0.1 / pace, {**at, scene.rotor.w: noise[0, 0], scene.mass.v: size * noise[0, 1]}, samples=2)
    assert not run[scene.rotor.w].any()  # it rests, and no warning says that its constraints are left
