"""Dry friction by what joints and guides truly bear, against closed forms."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import acausal as ac
from components import (
    Circle,
    Coulomb,
    Cylindrical,
    Force,
    Helix,
    JointFriction,
    Line,
    Particle,
    PointOnCurve,
    PointOnPlane,
    PointOnSurface,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    RoughGuide,
    Screw,
    Sphere,
    World,
)
from tests.drawn import SEEDS, Drawn
from tests.pairings import each_value
from tests.scenes import FourBar

G = 9.81


def zero(f: Callable[[float], Any], low: float, high: float) -> float:
    return float(brentq(f, low, high, xtol=1e-15))


def changes(run: ac.Trajectory) -> list[float]:
    """When something begins to slip, stops, or turns back."""
    return [transition.time for transition in run.transitions]


def bead(wire: RoughGuide, gravity: tuple[float, float, float], mass: float = 0.3) -> ac.System:
    scene = ac.System()
    scene.world, scene.wire, scene.bead = World(gravity=gravity), wire, Particle(mass)
    scene.connect(scene.world.frame, scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    return scene


@pytest.mark.parametrize("stays", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_bead_on_an_inclined_wire_stops_and_slides_back_or_stays(seed: int, stays: bool) -> None:
    of = Drawn(seed)
    slope, g, Q = of.within(0.1, 1.2), of.g, of.turn()
    mu = np.tan(slope) * (of.within(1.001, 3) if stays else of.within(0.1, 0.999))
    speed = np.sqrt(g * of.L) * of.within(0.3, 3)
    wire = PointOnCurve(Line(tuple(Q @ (np.cos(slope), 0.0, np.sin(slope)))), friction=Coulomb(mu))
    scene = bead(wire, tuple(Q @ (0.0, 0.0, -g)), of.M)
    up, down = g * (np.sin(slope) + mu * np.cos(slope)), max(g * (np.sin(slope) - mu * np.cos(slope)), 0.0)
    stop, end = speed / up, speed / up * of.within(1.2, 3)
    run = ac.build(scene).simulate(end, {wire.q: 0.0, wire.v: speed}, rtol=1e-12)
    assert changes(run) == pytest.approx([stop], rel=1e-11)
    assert run[wire.q][-1] == pytest.approx(speed * stop / 2 - down / 2 * (end - stop) ** 2, abs=1e-11 * speed * stop)
    assert run.modes(wire).words[-1] == ("sticks" if stays else "slides -")
    assert run.energy_error() < 1e-11


def ring_speed(k: float, c: float, begin: float, w: float, angle: np.ndarray | float) -> Any:
    """Square of the angular velocity along a ring in gravity, from that at the angle `begin`: w' + k w = c (k sin - 2 cos), by the angle, where c = g / R,
    k = 2 mu times the signs of slip and normal force."""

    def special(at: np.ndarray | float) -> Any:
        return c / (1 + k**2) * ((k**2 - 2) * np.sin(at) - 3 * k * np.cos(at))

    return special(angle) + (w - special(begin)) * np.exp(-k * (angle - begin))


def passing(k: float, c: float, begin: float, w: float, end: float) -> float:
    """Time from one angle to another, at which it may come to rest."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    u = np.sqrt(abs(end - begin)) * (nodes + 1) / 2  # the square root of the way that is left
    left = np.sqrt(abs(end - begin)) * weights / 2
    return float(left @ (2 * u / np.sqrt(ring_speed(k, c, begin, w, end - np.sign(end - begin) * u**2))))


@pytest.mark.parametrize("seed", SEEDS)
def test_bead_in_a_rough_ring_leans_on_its_outside_and_then_its_inside(seed: int) -> None:
    of = Drawn(seed)
    radius, mass, mu, Q = of.L * of.within(0.3, 3), of.M, of.within(0.05, 0.9), of.turn()
    c, low = of.g / radius, -np.pi / 2
    # from the bottom it is pressed inwards, until R w = g sin, there at a third of a quarter turn or so, then outwards
    over = of.within(0.1, 0.7)
    start = ring_speed(2 * mu, c, over, c * np.sin(over), low)
    wire = PointOnCurve(Circle(radius), friction=Coulomb(mu))
    scene = ac.System()
    scene.world, scene.wire, scene.bead = World(gravity=tuple(Q @ (0.0, -of.g, 0.0))), wire, Particle(mass)
    scene.connect(scene.world.at(tuple(of.place()), rotation=Q), scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    rest = zero(lambda at: ring_speed(-2 * mu, c, over, c * np.sin(over), at) / c, over, np.pi / 2)
    time = passing(2 * mu, c, low, start, over) + passing(-2 * mu, c, over, c * np.sin(over), rest)
    run = ac.build(scene).simulate(1.2 * time, {wire.q: low, wire.v: np.sqrt(start)}, rtol=1e-12)
    assert changes(run)[0] == pytest.approx(time, rel=1e-11)
    q, v = run[wire.q], run[wire.v]
    first, second = run.t <= time, q < over
    for some, k, begin, w in ((second & first, 2 * mu, low, start), (~second & first, -2 * mu, over, c * np.sin(over))):
        assert np.count_nonzero(some) > 2
        assert v[some] ** 2 == pytest.approx(ring_speed(k, c, begin, w, q[some]), abs=1e-10 * start)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_disk_on_a_plain_bearing_spins_down_by_its_weight(size: float) -> None:
    scene = ac.System()
    scene.world, scene.hinge = World(gravity=(0.0, 0.0, -G * size)), Revolute(axis="y")
    scene.disk = RigidBody(mass=2.0, inertia=(0.02 * size**2, 0.03 * size**2, 0.02 * size**2))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.disk.frame)
    scene.bearing = JointFriction(scene.hinge, Coulomb(0.1, static=0.15), radius=0.02 * size)
    run = ac.build(scene).simulate(5.0, {scene.hinge.q: 0.0, scene.hinge.v: -5.0}, rtol=1e-12)
    stop = 5.0 * 0.03 / (0.1 * 0.02 * 2.0 * G)
    assert changes(run) == pytest.approx([stop], rel=1e-11)
    assert run[scene.hinge.q][-1] == pytest.approx(-2.5 * stop, rel=1e-11)
    assert run[scene.bearing.drag[0]][0] == pytest.approx(0.1 * 0.02 * 2.0 * G * size**2, rel=1e-12)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("seed", SEEDS)
def test_bead_slides_down_a_rough_helix_to_its_terminal_speed(seed: int) -> None:
    of = Drawn(seed)
    radius, T, g = of.L * of.within(0.3, 3), of.within(0.3, 1.5), of.g
    lead, mu = radius * T, T * of.within(0.3, 0.9)
    wire = PointOnCurve(Helix(radius=radius, lead=lead), friction=Coulomb(mu))
    scene = bead(wire, (0.0, 0.0, -g), of.M)
    # per turn c along the helix, of slope T: R w = g cos sinh u with w the square of the angular velocity, and cosh u du = 2 R / c (T - mu cosh u) along the angle
    c, root = np.hypot(radius, lead), np.sqrt(T**2 - mu**2)
    last = 2 * np.arctanh(np.sqrt((T - mu) / (T + mu)))
    run = ac.build(scene).simulate(60 * c / np.sqrt(g * radius) / root, {wire.q: 0.0, wire.v: 0.0}, rtol=1e-12)
    u = np.arcsinh(c * run[wire.v] ** 2 / g)
    some = u < 0.98 * last
    assert np.count_nonzero(some) > 10
    way = -u / mu + T / mu * 2 / root * np.arctanh(np.sqrt((T + mu) / (T - mu)) * np.tanh(u / 2) * some)
    assert way[some] == pytest.approx(-2 * radius / c * run[wire.q][some], abs=1e-9)
    assert run[wire.v][-1] == pytest.approx(-np.sqrt(np.sinh(last) * g / c), rel=1e-9)
    assert run.energy_error() < 1e-10


def test_bead_on_a_wire_that_is_turned_is_pressed_by_its_own_speed_alone() -> None:
    mu, turning = 0.6, 3.0
    wire = PointOnCurve(Line((1.0, 0.0, 0.0)), friction=Coulomb(mu))
    scene = ac.System()
    scene.world, scene.bead, scene.wire = World(gravity=(0.0, 0.0, 0.0)), Particle(0.2), wire
    scene.drive = PrescribedMotion(rotation=("z", turning * ac.time))
    scene.connect(scene.world.frame, scene.drive.frame_a)
    scene.connect(scene.drive.frame_b, wire.frame_a)
    scene.connect(wire.frame_b, scene.bead.point)
    run = ac.build(scene).simulate(1.5, {wire.q: 0.3, wire.v: -2.0}, rtol=1e-12)
    # r'' = W^2 r -+ 2 mu W |r'|: inwards and, from the turn on, outwards the same linear equation
    roots = turning * (-mu + np.array([1, -1]) * np.sqrt(mu**2 + 1))
    parts = np.linalg.solve([[1.0, 1.0], roots], [0.3, -2.0])
    assert run[wire.q] == pytest.approx((parts[:, None] * np.exp(roots[:, None] * run.t)).sum(axis=0), rel=1e-11, abs=1e-11)


def test_bead_on_a_rough_sphere_that_holds_it_moves_as_one_on_a_ring() -> None:
    ends: list[np.ndarray] = []
    for surface in (False, True):
        guide = (
            PointOnSurface(Sphere(0.5), friction=Coulomb(0.3)) if surface else PointOnCurve(Circle(0.5), friction=Coulomb(0.3))
        )
        scene = bead(guide, (0.0, -G, 0.0))
        point = scene.bead.point
        run = ac.build(scene).simulate(0.9, {point.position: (0.5, 0.0, 0.0), point.velocity: (0.0, 2.2, 0.0)}, rtol=1e-12)
        ends.append(np.concatenate([run[point.position][-1], run[point.velocity][-1]]))
    assert ends[0].size == 6
    assert ends[1] == pytest.approx(ends[0], abs=1e-10)


def pendulum(mu: Any = 0.3, radius: float = 0.04) -> ac.System:
    scene = ac.System()
    scene.world, scene.hinge = World(gravity=(0.0, 0.0, -G)), Revolute(axis="y")
    scene.rod = RigidBody(mass=1.5, inertia=(0.02, 0.03, 0.02))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.at((0.0, 0.0, 0.2)))
    scene.bearing = JointFriction(scene.hinge, Coulomb(mu), radius=radius)
    return scene


def test_pendulum_in_a_plain_bearing_swings_as_its_equation_says() -> None:
    m, L, J, mr = 1.5, 0.2, 0.03 + 1.5 * 0.04, 0.3 * 0.04
    scene = pendulum()
    run = ac.build(scene).simulate(3.0, {scene.hinge.q: 2.5, scene.hinge.v: 0.0}, rtol=1e-12)

    def rates(_: float, y: np.ndarray, slip: float) -> list[float]:
        # N = m (L w^2 + g cos, L w' + g sin), J w' = -m g L sin - slip mu r |N|: a quadratic equation for |N|
        radial, across = m * (L * y[1] ** 2 + G * np.cos(y[0])), m * G * np.sin(y[0]) * (1 - m * L * L / J)
        b = -slip * m * L * mr / J
        n = (across * b + np.sqrt((across * b) ** 2 + (1 - b * b) * (radial**2 + across**2))) / (1 - b * b)
        return [y[1], (-m * G * L * np.sin(y[0]) - slip * mr * n) / J]

    def stops(_: float, y: np.ndarray, slip: float) -> float:
        return slip * y[1]

    y, t, slip, turns = np.array([2.5, 0.0]), 0.0, -1.0, []
    while True:
        begin = np.array(rates(t, y, slip))  # a series for the start, which is an event itself
        little = 1e-5
        y, t = (
            y
            + little * begin
            + little**2 / 2 * np.array([begin[1], (rates(t, y + little * begin, slip)[1] - begin[1]) / little]),
            t + little,
        )
        stops.terminal = True  # type: ignore[attr-defined]
        found = solve_ivp(rates, (t, 3.0), y, "DOP853", events=stops, args=(slip,), rtol=1e-13, atol=1e-15)
        t, y = float(found.t[-1]), found.y[:, -1]
        if found.status == 0:
            break
        turns.append(t)
        y[1] = 0.0
        if abs(m * G * L * np.sin(y[0])) <= mr * m * G:
            break
        slip = -float(np.sign(np.sin(y[0])))
    assert len(turns) > 2
    assert changes(run) == pytest.approx(turns, abs=1e-10)
    assert run[scene.hinge.q][-1] == pytest.approx(y[0], abs=1e-10)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("mu", [0.015, 0.03, 0.06])
def test_pendulum_whose_bearing_is_hardly_loaded_for_a_moment_keeps_its_tolerance(mu: float) -> None:
    """Thrown over its top, where its weight is what it needs to go round: friction is small there, in a narrow valley."""
    m, L, J, mr = 1.5, 0.2, 0.03 + 1.5 * 0.04, mu * 0.04
    scene = pendulum(mu)

    def rates(_: float, y: np.ndarray) -> list[float]:
        radial, across = m * (L * y[1] ** 2 + G * np.cos(y[0])), m * G * np.sin(y[0]) * (1 - m * L * L / J)
        b = -m * L * mr / J
        n = (across * b + np.sqrt((across * b) ** 2 + (1 - b * b) * (radial**2 + across**2))) / (1 - b * b)
        return [y[1], (-m * G * L * np.sin(y[0]) - mr * n) / J]

    model, q0, end = ac.build(scene), np.pi - 1.0, 0.6
    for speed in (7.2, 7.6, 8.0):
        exact = solve_ivp(rates, (0, end), [q0, speed], "DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
        for rtol in (1e-6, 1e-8, 1e-10, 1e-12):
            run = model.simulate(end, {scene.hinge.q: q0, scene.hinge.v: speed}, rtol=rtol)
            assert [run[scene.hinge.q][-1], run[scene.hinge.v][-1]] == pytest.approx(exact, rel=10 * rtol)


def chain(order: tuple[int, ...]) -> tuple[ac.System, dict[int, Revolute], dict[int, JointFriction]]:
    """Rods on one another, in bearings that load one another; bearings declared in this order."""
    scene = ac.System()
    scene.world = World(gravity=(0.0, 0.0, -G))
    hinges = {k: Revolute(axis="y") for k in range(3)}
    rods = {k: RigidBody.rod(0.3 + 0.1 * k, (0.0, 0.0, -0.2)) for k in range(3)}
    bearings: dict[int, JointFriction] = {}
    for k in order:
        bearings[k] = JointFriction(hinges[k], Coulomb(0.3, static=0.35), radius=0.03)
        setattr(scene, f"bearing{k}", bearings[k])
    for k in range(3):
        setattr(scene, f"hinge{k}", hinges[k])
        setattr(scene, f"rod{k}", rods[k])
        scene.connect(scene.world.frame if k == 0 else rods[k - 1].at((0.0, 0.0, -0.2)), hinges[k].frame_a)
        scene.connect(hinges[k].frame_b, rods[k].frame)
    return scene, hinges, bearings


def test_bearings_that_load_one_another_rub_by_what_each_bears_in_any_order() -> None:
    ends: list[np.ndarray] = []
    for order in ((0, 1, 2), (2, 0, 1)):
        scene, hinges, bearings = chain(order)
        start = {hinge.q: 1.0 + 0.3 * k for k, hinge in hinges.items()} | {hinge.v: 0.5 * k for k, hinge in hinges.items()}
        run = ac.build(scene).simulate(1.0, start, rtol=1e-12)
        for k, hinge in hinges.items():
            force, speed = run[hinge.frame_a.force], run[hinge.v]
            slips = np.abs(speed) > 1e-6
            load = 0.03 * np.hypot(force[:, 0], force[:, 2])
            drag = -0.3 * load * np.sign(speed)
            assert run[bearings[k].drag[0]][slips] == pytest.approx(drag[slips], rel=1e-12)
            assert np.all(np.abs(run[bearings[k].drag[0]]) <= 0.35 * load * (1 + 1e-12))
        assert run.energy_error() < 1e-11
        ends.append(np.array([run[hinge.q][-1] for hinge in hinges.values()]))
    assert ends[1] == pytest.approx(ends[0], abs=1e-10)


def test_sleeve_slides_and_turns_in_one_direction_until_it_stops() -> None:
    mass, radius, mu = 2.0, 0.05, 0.3
    scene = ac.System()
    scene.world, scene.sleeve = World(gravity=(0.0, 0.0, -G)), Cylindrical(axis="x")
    scene.body = RigidBody(mass=mass, inertia=(mass * radius**2, 0.1, 0.1))
    scene.connect(scene.world.frame, scene.sleeve.frame_a)
    scene.connect(scene.sleeve.frame_b, scene.body.frame)
    scene.rub = JointFriction(scene.sleeve, Coulomb(mu), radius=radius)
    run = ac.build(scene).simulate(1.0, {scene.sleeve.v: (30.0, -1.0)}, rtol=1e-12)
    speed = np.hypot(30.0 * radius, 1.0)
    assert changes(run) == pytest.approx([speed / (mu * G)], rel=1e-11)
    assert run[scene.sleeve.q][-1] == pytest.approx(np.array([30.0, -1.0]) * speed / (2 * mu * G), rel=1e-11)


def screw(mu: float, turning: float = 1e-3, size: float = 1.0, pitch: float = 0.01, mass: float = 2.0, g: float = G) -> ac.System:
    """A nut on a thread of slope pitch / (2 pi 0.01), in lengths of so many metres."""
    scene = ac.System()
    scene.world, scene.screw = World(gravity=(0.0, 0.0, -g * size)), Screw("z", pitch=pitch * size)
    scene.nut = RigidBody(mass=mass, inertia=(turning * size**2,) * 3)
    scene.connect(scene.world.frame, scene.screw.frame_a)
    scene.connect(scene.screw.frame_b, scene.nut.frame)
    scene.thread = JointFriction(scene.screw, Coulomb(mu), radius=0.01 * size)
    return scene


@each_value(("near", [False, True]), ("holds", [False, True]), ("seed", SEEDS))
def test_screw_holds_itself_where_its_slope_is_below_the_coefficient(seed: int, holds: bool, near: bool) -> None:
    of = Drawn(seed)
    slope, mass, g = of.within(0.05, 0.5), of.M, 9.81 / of.T**2
    part = 1 + (1 if holds else -1) * (1e-7 if near else of.within(0.1, 0.7))
    turning, spin, mu = mass * 1e-4 * of.within(2, 9), of.within(1, 9) / of.T, part * slope
    scene = screw(mu, turning, of.L, 2 * np.pi * 0.01 * slope, mass, g)
    model = ac.build(scene)
    rest = model.simulate(of.T, {scene.screw.q: 0.0, scene.screw.v: 0.0}, rtol=1e-12)
    assert rest.modes(scene.thread).words == (("sticks",) if holds else ("slides -",))
    # along thread and axis: J w' = r (f cos - N sin), m h w' = -m g + N cos + f sin, f = -mu N upwards, mu N downwards
    angle, h = np.arctan(slope), 0.01 * slope

    def acceleration(slip: float) -> float:
        M = [
            [turning, 0.01 * (np.sin(angle) + slip * mu * np.cos(angle))],
            [mass * h, slip * mu * np.sin(angle) - np.cos(angle)],
        ]
        return float(np.linalg.solve(M, [0.0, -mass * g])[0])

    stop, back = -spin / acceleration(1.0), 0.0 if holds else acceleration(-1.0)
    up = model.simulate(2.5 * stop, {scene.screw.q: 0.0, scene.screw.v: spin}, rtol=1e-12)
    assert changes(up)[0] == pytest.approx(stop, rel=1e-11)
    assert up[scene.screw.q][-1] == pytest.approx(spin * stop / 2 + back / 2 * (1.5 * stop) ** 2, abs=1e-11 * spin * stop)


def test_light_nut_on_a_thread_that_holds_itself_has_no_motion_and_the_critical_coefficient_is_said() -> None:
    scene = screw(0.5, turning=1e-8)
    # by the equations above the force across the thread changes with friction along it, both at once
    angle, h = np.arctan(1 / (2 * np.pi)), 0.01 / (2 * np.pi)
    M = [[1e-8, 0.01 * np.sin(angle)], [2.0 * h, -np.cos(angle)]]
    critical = 1 / abs(np.linalg.solve(M, [0.01 * np.cos(angle), np.sin(angle)])[1])
    with pytest.raises(
        ac.errors.SimulationError, match=r"thread \(.*\) slips with a coefficient of 0\.5, and there the critical"
    ) as said:
        ac.build(scene).simulate(0.5, {scene.screw.q: 0.0, scene.screw.v: 5.0})
    found = re.search(r"critical one is ([\d.e-]+):", str(said.value))
    assert found and float(found[1]) == pytest.approx(critical, rel=1e-5)
    below = screw(0.999 * critical, turning=1e-8)
    assert changes(ac.build(below).simulate(0.5, {below.screw.q: 0.0, below.screw.v: 5.0}))


@pytest.mark.parametrize("part", [0.9, 1 + 1e-9, 1.5])
def test_drawer_jams_where_it_is_pulled_too_far_off_its_middle(part: float) -> None:
    mu, length, pull = 0.25, 0.4, 7.0
    scene = ac.System()
    scene.world, scene.slide = World(gravity=(0.0, 0.0, 0.0)), Prismatic(axis="x")
    scene.drawer, scene.hand = RigidBody(mass=3.0, inertia=(0.1, 0.1, 0.1)), Force((pull, 0.0, 0.0))
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.drawer.frame)
    scene.connect(scene.drawer.at((0.0, part * length / (2 * mu), 0.0)), scene.hand.point)
    scene.rub = JointFriction(scene.slide, Coulomb(mu), length=length)
    run = ac.build(scene).simulate(1.0, {scene.slide.q: 0.0, scene.slide.v: 0.0}, rtol=1e-12)
    assert run[scene.slide.q][-1] == pytest.approx(max(1 - part, 0.0) * pull / 3.0 / 2, abs=1e-12)


def test_rod_between_two_rough_rails_slides_down_as_its_equation_says() -> None:
    mass, length, mu = 1.2, 0.8, 0.15
    scene = ac.System()
    scene.world = World(gravity=(0.0, 0.0, -G))
    scene.floor, scene.wall = Prismatic(axis="x"), Prismatic(axis="z")
    scene.foot, scene.head = Revolute(axis="y"), Revolute(axis="y")
    scene.rod = RigidBody(mass=mass, inertia=(mass * length**2 / 12,) * 3)
    scene.shoe, scene.block = RigidBody(mass=0.2, inertia=(0.01,) * 3), RigidBody(mass=0.3, inertia=(0.01,) * 3)
    scene.connect(scene.world.frame, scene.floor.frame_a, scene.wall.frame_a)
    scene.connect(scene.floor.frame_b, scene.shoe.frame, scene.foot.frame_a)
    scene.connect(scene.wall.frame_b, scene.block.frame, scene.head.frame_a)
    scene.connect(scene.foot.frame_b, scene.rod.at((0.0, 0.0, -length / 2)))
    scene.connect(scene.head.frame_b, scene.rod.at((0.0, 0.0, length / 2)))
    scene.below, scene.beside = JointFriction(scene.floor, Coulomb(mu)), JointFriction(scene.wall, Coulomb(mu))
    run = ac.build(scene).simulate(
        0.4, {scene.floor.q: 0.3, scene.wall.q: np.sqrt(length**2 - 0.09), scene.floor.v: 0.0}, rtol=1e-12
    )

    def rates(_: float, y: np.ndarray) -> list[float]:
        # foot (L sin a, 0), head (0, L cos a); unknown: a'', forces of the floor upwards and of the wall along x, with signs as they turn out to be
        s, c, w = np.sin(y[0]), np.cos(y[0]), y[1]
        m, at_foot, at_head, L = mass, 0.2, 0.3, length
        A = m * L * L / 3 + L * L * (at_foot * c * c + at_head * s * s)
        for below in (1, -1):
            for beside in (1, -1):
                M = [
                    [(m / 2 + at_foot) * L * c, mu * below, -1.0],  # along x: what is on the right of the wall
                    [-(m / 2 + at_head) * L * s, -1.0, -mu * beside],  # upwards
                    [A, mu * below * L * c, mu * beside * L * s],  # by Lagrange
                ]
                right = [
                    (m / 2 + at_foot) * L * s * w * w, (m / 2 + at_head) * L * c * w * w - (m + 0.5) * G,
                    (m / 2 + at_head) * G * L * s - L * L * s * c * (at_head - at_foot) * w * w,
                ]  # fmt: skip
                a, up, out = np.linalg.solve(M, right)
                if up * below >= 0 and out * beside >= 0:
                    return [w, a]
        raise AssertionError

    sol = solve_ivp(rates, (0.0, 0.4), [np.arcsin(0.3 / length), 0.0], "DOP853", rtol=1e-13, atol=1e-13)
    assert run[scene.floor.q][-1] == pytest.approx(length * np.sin(sol.y[0, -1]), abs=1e-10)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("part", [0.5, 1 - 1e-6, 1 + 1e-6, 1.5])
@pytest.mark.parametrize("seed", SEEDS)
def test_wedge_is_driven_out_where_it_is_steeper_than_its_two_angles_of_friction(seed: int, part: float) -> None:
    of = Drawn(seed)
    mu, g, end = of.within(0.05, 0.2), of.g, of.T
    wedge, above = of.M * of.within(0.1, 1), of.M
    slope = (np.arctan(mu) + np.arctan(mu * (1 + wedge / above))) * part  # the floor bears the wedge, too
    scene = ac.System()
    scene.world = World(gravity=(0.0, 0.0, -g))
    scene.floor, scene.guide = Prismatic(axis="x"), Prismatic(axis="z")
    own = 0.1 * of.M * of.L**2
    scene.wedge, scene.load = RigidBody(mass=wedge, inertia=(own,) * 3), RigidBody(mass=above, inertia=(own,) * 3)
    scene.face, scene.rub = PointOnPlane(friction=Coulomb(mu)), JointFriction(scene.floor, Coulomb(mu))
    scene.connect(scene.world.frame, scene.floor.frame_a, scene.guide.frame_a)
    scene.connect(scene.floor.frame_b, scene.wedge.frame)
    scene.connect(scene.guide.frame_b, scene.load.frame)
    scene.connect(scene.wedge.at((0.0, 0.0, 0.0), rotation=("y", -slope)), scene.face.frame_a)
    scene.connect(scene.face.frame_b, scene.load.frame)
    run = ac.build(scene).simulate(end, {scene.floor.q: 0.0, scene.floor.v: 0.0}, rtol=1e-12)
    # the load sinks by T x, x the way of the wedge: N and mu N on the face, up to the floor's U and mu U
    s, c, T = np.sin(slope), np.cos(slope), np.tan(slope)
    M = [[wedge, mu * c - s, mu], [above * T, c + mu * s, 0.0], [0.0, -c - mu * s, 1.0]]
    away = max(float(np.linalg.solve(M, [0.0, above * g, wedge * g])[0]), 0.0) if part > 1 else 0.0
    assert abs(run[scene.floor.q][-1] - run[scene.floor.q][0]) == pytest.approx(
        away / 2 * end**2, rel=1e-6 if abs(part - 1) < 1e-3 else 1e-10, abs=1e-12 * of.L
    )


def test_stop_of_a_bead_depends_on_the_coefficient_as_its_closed_form_does() -> None:
    slope, mu = 0.6, ac.Parameter(0.8)
    scene = bead(PointOnCurve(Line((np.cos(slope), 0.0, np.sin(slope))), friction=Coulomb(mu)), (0.0, 0.0, -G))
    start = {scene.wire.q: 0.0, scene.wire.v: 4.0}
    found = ac.build(scene).sensitivities([0.0, 1.0], [mu, scene.wire.v], start, rtol=1e-12)
    up = G * (np.sin(slope) + 0.8 * np.cos(slope))
    assert found.S[-1, 0] == pytest.approx([-8.0 / up**2 * G * np.cos(slope), 4.0 / up], rel=1e-9)


def test_stop_in_a_rough_ring_depends_on_start_and_coefficient_through_where_its_side_changes() -> None:
    c, low = G / 0.5, -np.pi / 2

    def rest(speed: float, mu: float) -> float:
        over = zero(lambda at: ring_speed(2 * mu, c, low, speed**2, at) - c * np.sin(at), 0.0, np.pi / 2)
        return zero(lambda at: ring_speed(-2 * mu, c, over, c * np.sin(over), at), over, np.pi / 2 + 0.5)

    mu, speed, h = ac.Parameter(0.9), np.sqrt(40 * c), 1e-4
    scene = bead(PointOnCurve(Circle(0.5), friction=Coulomb(mu, static=50.0)), (0.0, -G, 0.0))
    start = {scene.wire.q: low, scene.wire.v: speed}
    found = ac.build(scene).sensitivities([0.0, 1.5], [scene.wire.v, mu], start, rtol=1e-12)
    # differences of the closed form, to fourth order
    steps = [(h * speed, 0.0), (0.0, h)]
    exact = [
        (8 * (rest(speed + a, 0.9 + b) - rest(speed - a, 0.9 - b)) - rest(speed + 2 * a, 0.9 + 2 * b) + rest(speed - 2 * a, 0.9 - 2 * b))
        / (12 * (a + b))
        for a, b in steps
    ]  # fmt: skip
    assert found.x[0, -1] == pytest.approx(rest(speed, 0.9), abs=1e-11)
    assert found.S[-1, 0] == pytest.approx(exact, rel=1e-8)


def test_bounce_in_a_rough_ring_depends_on_all_that_its_closed_form_has() -> None:
    """Without weight a bead on a ring slows down as exp(-mu q); a floor that it strikes presses it on the ring, which rubs it in both phases of the impact."""
    at, end = (3.0, 0.4, 0.7, 0.25), 1.0

    def place(speed: Any, mu: Any, restitution: Any, height: Any) -> Any:
        struck = np.pi - np.arcsin(2 * height)
        up, across = np.sqrt(1 - (2 * height) ** 2), 2 * height  # parts of the blow along the ring, and on it
        slower = np.exp(mu * (struck - np.pi / 2))
        back = speed / slower * restitution * (up - mu * across) / (up + mu * across)
        return struck - np.log(1 + mu * back * (end - (slower - 1) / (mu * speed))) / mu

    mu, restitution, height = values = [ac.Parameter(value) for value in at[1:]]
    scene = bead(PointOnCurve(Circle(0.5), friction=Coulomb(mu)), (0.0, 0.0, 0.0))
    scene.floor = PointOnPlane(unilateral=True, restitution=restitution)
    scene.connect(scene.world.at((0.0, height, 0.0), rotation=("x", -np.pi / 2)), scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.bead.point)
    start = {scene.wire.q: np.pi / 2, scene.wire.v: at[0]}
    found = ac.build(scene).sensitivities([0.0, end], [scene.wire.v, *values], start, rtol=1e-12)
    exact = [place(*(value + 1e-30j * (i == k) for i, value in enumerate(at))).imag / 1e-30 for k in range(4)]
    assert found.x[0, -1] == pytest.approx(place(*at), rel=1e-11)
    assert found.S[-1, 0] == pytest.approx(exact, rel=1e-8)


def leaning_rod(mu: float, inertia: float = 1 / 3, half: float = 0.5, mass: float = 1.3, g: float = G) -> ac.System:
    """A rod of half a length with its foot on the floor."""
    scene = ac.System()
    scene.world, scene.foot = World(gravity=(0.0, 0.0, -g)), PointOnPlane(unilateral=True, friction=Coulomb(mu))
    own = mass * half**2 * inertia
    scene.rod = RigidBody(mass=mass, inertia=(own, own, 1e-5 * own))
    scene.connect(scene.world.frame, scene.foot.frame_a)
    scene.connect(scene.foot.frame_b, scene.rod.at((0.0, 0.0, -half)))
    return scene


def leaning(scene: ac.System, angle: float, slip: float, turning: float = 0.0, half: float = 0.5) -> dict[Any, Any]:
    """At an angle over the floor; slip of its foot to the right."""
    along = half * np.array([np.cos(angle), 0.0, np.sin(angle)])
    R = np.array([[np.sin(angle), 0.0, np.cos(angle)], [0.0, 1.0, 0.0], [-np.cos(angle), 0.0, np.sin(angle)]])
    w = np.array([0.0, turning, 0.0])
    frame = scene.rod.frame
    velocity = np.array([slip, 0.0, 0.0]) + np.cross(w, along)
    return {frame.position: along, frame.rotation: R, frame.velocity: velocity, frame.angular_velocity: w}


@pytest.mark.parametrize("seed", SEEDS)
def test_rod_is_stopped_at_once_beyond_its_critical_coefficient(seed: int) -> None:
    """4 / 3 at least for a slender one, where its tan is 2; here its inertia about its middle is m h^2 / q."""
    of = Drawn(seed)
    angle, q, half, mass, g = of.within(0.6, 1.3), of.within(1.5, 8), of.L * of.within(0.3, 3), of.M, of.g
    s, c, fast = np.sin(angle), np.cos(angle), np.sqrt(of.g * half) * of.within(5, 30)
    critical = (1 + q * c * c) / (q * s * c)
    below, beyond = (leaning_rod(critical * k, 1 / q, half, mass, g) for k in (0.98, 1.02))
    short = 1e-3 * half / fast
    run = ac.build(below).simulate(short, leaning(below, angle, -fast, half=half), rtol=1e-12)
    # N (1 + q c^2 - q mu s c) = m g
    assert run[below.foot.normal_force][0] == pytest.approx(mass * g / (1 + q * c * c) / 0.02, rel=1e-9)
    run = ac.build(beyond).simulate(short, leaning(beyond, angle, -fast, half=half), rtol=1e-12)
    struck = run.transitions[0]
    assert struck.time == 0
    # the impulse that stops the foot: slip' = (1 + q s^2) X + q s c Z, 0 = q s c X + (1 + q c^2) Z, over the mass
    X, Z = np.linalg.solve([[1 + q * s * s, -q * s * c], [-q * s * c, 1 + q * c * c]], [mass * fast, 0.0])
    assert struck.energy_lost == pytest.approx(fast / 2 * X, rel=1e-10)
    assert next(change.impulse for change in struck.changes if np.size(change.impulse) == 1) == pytest.approx(abs(Z), rel=1e-10)
    assert struck.after[beyond.foot.slip] == pytest.approx(np.zeros(3), abs=1e-12 * fast)


def test_rod_that_may_fly_or_be_held_names_its_critical_coefficient() -> None:
    angle = np.arctan(2.0)
    scene = leaning_rod(1.5)
    with pytest.raises(
        ac.errors.SimulationError, match=r"foot.* slips with a coefficient of 1\.5, and there the critical one is 1\.33333:"
    ):
        ac.build(scene).simulate(0.05, leaning(scene, angle, -1.0, turning=12.0))
    scene = leaning_rod(1.3)
    assert not ac.build(scene).simulate(0.01, leaning(scene, angle, -1.0, turning=12.0)).transitions


@each_value(("lifts", [False, True]), ("seed", SEEDS))
def test_ball_with_back_spin_slides_and_then_rolls(seed: int, lifts: bool) -> None:
    """With an inertia c m r^2 its slip falls by (1 + 1 / c) mu g, and its velocity by mu g."""
    of = Drawn(seed)
    radius, mu, c, mass, g = of.L * of.within(0.1, 1), of.within(0.05, 1), of.within(0.2, 0.66), of.M, of.g
    velocity, turning = of.speed * of.rng.normal(size=3) * [1, 1, 0], of.speed / radius * of.rng.normal(size=3)
    scene = ac.System()
    scene.world, scene.ball = World(gravity=(0.0, 0.0, -g)), RigidBody(mass, (c * mass * radius**2,) * 3)
    scene.contact = (
        RollingBall(radius, friction=Coulomb(mu), unilateral=True) if lifts else RollingBall(radius, friction=Coulomb(mu))
    )
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    start = {frame.position: (0.0, 0.0, radius), frame.velocity: velocity, frame.angular_velocity: turning}
    slip = velocity + np.cross(turning, (0.0, 0.0, -radius))
    stop = np.linalg.norm(slip) / ((1 + 1 / c) * mu * g)
    end, rolling, fast = 3 * stop, velocity - slip / (1 + 1 / c), np.linalg.norm(velocity) + np.linalg.norm(slip)
    run = ac.build(scene).simulate(end, start, rtol=1e-12)
    assert changes(run) == pytest.approx([stop], rel=1e-11)
    assert run[frame.velocity][-1] == pytest.approx(rolling, abs=1e-11 * fast)
    way = rolling * end + slip / (1 + 1 / c) * stop / 2
    assert run[frame.position][-1][:2] == pytest.approx(way[:2], abs=1e-11 * fast * end)
    assert run[frame.angular_velocity][-1][2] == pytest.approx(turning[2], abs=1e-11 * fast / radius)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize(("mu", "rolls"), [(0.1, False), (0.3, True)])
def test_ball_on_an_incline_rolls_where_friction_can_hold_it(mu: float, rolls: bool) -> None:
    slope = 0.6  # rolls where tan is at most 7 / 2 mu
    scene = ac.System()
    scene.world, scene.ball = World(gravity=(0.0, 0.0, -G)), RigidBody.ball(mass=0.7, radius=0.1)
    scene.contact = RollingBall(0.1, friction=Coulomb(mu))
    scene.connect(scene.world.at((0.0, 0.0, 0.0), rotation=("y", slope)), scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    run = ac.build(scene).simulate(1.0, {scene.contact.v: np.zeros(5)}, rtol=1e-12)
    along = G * (5 / 7 * np.sin(slope) if rolls else np.sin(slope) - mu * np.cos(slope))
    moved = run[scene.ball.frame.position][-1] - run[scene.ball.frame.position][0]
    assert np.linalg.norm(moved) == pytest.approx(along / 2, rel=1e-11)
    assert run[scene.contact.normal_force] == pytest.approx(0.7 * G * np.cos(slope), rel=1e-11)


def test_four_bar_with_friction_in_all_its_joints_turns_back_in_one_instant() -> None:
    scene = FourBar()
    hinges: dict[str, Revolute] = {name: getattr(scene, name) for name in "abcd"}
    rubs = {name: JointFriction(hinge, Coulomb(0.2, static=0.25), radius=0.02) for name, hinge in hinges.items()}
    for name, rub in rubs.items():
        setattr(scene, f"rub_{name}", rub)
    run = ac.build(scene).simulate(1.5, {scene.a.q: -1.2, scene.a.v: 0.0, scene.c.q: ac.near(0.9)}, rtol=1e-12)
    # single joints turn back where their neighbours move alike; all of them where the linkage comes to rest
    assert sorted(len(transition.parts) for transition in run.transitions) == [1, 1, 1, 1, 4]
    for name, hinge in hinges.items():
        force, axis = run[hinge.frame_a.force], np.asarray(hinge.axis, dtype=float)
        load = np.linalg.norm(force - (force @ axis)[:, None] * axis, axis=1)
        assert np.abs(run[rubs[name].drag[0]]) == pytest.approx(0.2 * 0.02 * load, rel=1e-9)
    assert run.energy_error() < 1e-10


def test_rod_that_slides_on_into_its_critical_position_is_told_so() -> None:
    """Its normal force grows beyond bounds there."""
    scene = leaning_rod(2.0)
    with pytest.raises(
        ac.errors.SimulationError, match=r"foot.* slips with a coefficient of 2, and there the critical one is 2:"
    ):
        ac.build(scene).simulate(0.3, leaning(scene, 0.5, -6.0, -2.0), rtol=1e-10)


@each_value(("tilt", [0.0, 0.6, np.pi / 2]), ("size", [1.0, 1e-6, 1e4]))
def test_collar_of_a_bearing_rubs_by_the_force_along_its_axis(tilt: float, size: float) -> None:
    """A balanced disk runs down: I w' = -mu m g (radius sin(tilt) + collar cos(tilt))."""
    mu, r, collar, w = 0.2, 0.02 * size, 0.05 * size, 7.0
    scene = ac.System()
    scene.world, scene.hinge = World(gravity=(0, 0, -G * size)), Revolute(axis=(np.sin(tilt), 0, np.cos(tilt)))
    scene.disk = RigidBody.disk(1.5, 0.3 * size, axis=(np.sin(tilt), 0, np.cos(tilt)))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.disk.frame)
    scene.bearing = JointFriction(scene.hinge, Coulomb(mu), radius=r, collar=collar)
    slows = mu * G * size * (r * np.sin(tilt) + collar * np.cos(tilt)) / (0.5 * (0.3 * size) ** 2)
    run = ac.build(scene).simulate(1.2 * w / slows, {scene.hinge.q: 0.0, scene.hinge.v: w}, rtol=1e-10)
    assert changes(run) == pytest.approx([w / slows], rel=1e-9)
    assert run[scene.hinge.q][-1] == pytest.approx(w**2 / (2 * slows), rel=1e-9)
