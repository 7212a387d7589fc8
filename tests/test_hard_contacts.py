"""What is met in three dimensions: contacts that open and strike, friction that holds, tracks that are left, ropes that go slack; against closed forms."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

import acausal as ac
from acausal.simulate.trajectory import Trajectory
from components import (
    Circle,
    Contact,
    Coulomb,
    Cylinder,
    Disk,
    Ellipsoid,
    EndStop,
    Force,
    Hard,
    HeightField,
    Helix,
    ImplicitSurface,
    ParametricCurve,
    ParametricSurface,
    Particle,
    Planar,
    Plane,
    Plate,
    PointOnCurve,
    PointOnPlane,
    PointOnSurface,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    Rope,
    Sphere,
    Torque,
    World,
)
from tests.drawn import SEEDS, Drawn
from tests.pairings import each_value

G = 9.81
INSTANT = 1e-11
STATE = 1e-10


def times(run: Trajectory) -> list[float]:
    """When the mode changed, after the start."""
    met = run.solution.modes
    assert met is not None
    return [change.time for change in met.changes if change.row >= 0]


def held(guide: ac.Component, gravity: float = G) -> ac.System:
    """A particle and a guide in the world."""
    scene = ac.System()
    scene.world, scene.mass, scene.guide = World((0, 0, -gravity)), Particle(0.7), guide
    scene.connect(scene.world.frame, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.mass.point)
    return scene


@pytest.mark.parametrize(("size", "restitution"), [(1.0, 1.0), (1e-9, 0.8), (1e6, 0.3)])
def test_a_thrown_ball_bounces_along_parabolas(size: float, restitution: float) -> None:
    """Falls from h, hits after T = sqrt(2 h / g), then after 2 e T more; what goes along the floor goes on."""
    scene = ac.System()
    scene.world, scene.ball = World((0, 0, -G * size)), RigidBody.ball(2.0, 0.1 * size)
    scene.floor = Contact(Sphere(0.1 * size), Plane(), Hard(restitution))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    fall = np.sqrt(2 / G)
    end = fall * (1 + 2 * restitution + restitution**2)
    p, v = scene.ball.frame.position, scene.ball.frame.velocity
    start = {p: (0, 0, 1.1 * size), v: (2 * size, 0.3 * size, 0)}
    run = ac.build(scene).simulate(end, start, rtol=1e-12)
    assert times(run) == pytest.approx([fall, fall * (1 + 2 * restitution)], rel=INSTANT)
    # at the highest point of the second bounce
    highest = 0.1 + G / 2 * (restitution**2 * fall) ** 2
    assert run[p][-1] / size == pytest.approx([2 * end, 0.3 * end, highest], abs=STATE)
    assert run[v][-1] / size == pytest.approx([2, 0.3, 0], abs=STATE)
    assert np.min(run[scene.floor.gap]) > -1e-14 * size and np.all(run[scene.floor.normal_force] == 0)


def off_a_sphere(make: Callable[[float], ac.Component], seed: int) -> None:
    """From the top with a speed it leaves where m v^2 / R = m g cos: cos = 2/3 + v^2 / (3 g R); then it falls along a parabola."""
    of = Drawn(seed)
    radius, g = of.L * of.within(0.3, 3), of.g
    speed = np.sqrt(g * radius) * of.within(0.05, 0.9)
    guide = make(radius)
    scene = held(guide, g)
    p, v = scene.mass.point.position, scene.mass.point.velocity
    cosine = 2 / 3 + speed**2 / (3 * g * radius)
    angle = np.arccos(cosine)
    leaves = quad(
        lambda a: 1 / np.sqrt((speed / radius) ** 2 + 4 * g / radius * np.sin(a / 2) ** 2), 0, angle, epsabs=0, epsrel=1e-13
    )[0]
    more = 0.3 * np.sqrt(radius / g)
    run = ac.build(scene).simulate(leaves + more, {p: (0, 0, radius), v: (speed, 0, 0)}, rtol=1e-12)
    assert times(run) == pytest.approx([leaves], rel=INSTANT)
    at = run.at([leaves])
    assert at[p][0] / radius == pytest.approx([np.sin(angle), 0, cosine], abs=STATE)
    fast = np.sqrt(g * radius * cosine)
    flown = [radius * np.sin(angle) + fast * cosine * more, 0, radius * cosine - fast * np.sin(angle) * more - g / 2 * more**2]
    assert run[p][-1] / radius == pytest.approx(np.array(flown) / radius, abs=STATE)
    early = run.at(np.linspace(0, leaves, 9)[:-1])
    along = early[p][:, 2] / radius
    push = along - speed**2 / (g * radius) - 2 * (1 - along)
    assert early[guide.normal_force].ravel() / (0.7 * g) == pytest.approx(push, abs=STATE)


SPHERES = {
    "sphere": lambda r: Sphere(r),
    "heights": lambda r: HeightField(lambda x, y: ca.sqrt(r**2 - x**2 - y**2)),
    "implicit": lambda r: ImplicitSurface(lambda x, y, z: x**2 + y**2 + z**2 - r**2, start=(0, 0, r)),
    "parametric": lambda r: ParametricSurface(
        lambda a, b: (r * ca.sin(a), r * ca.cos(a) * ca.sin(b), r * ca.cos(a) * ca.cos(b)), "rad"
    ),
}


@pytest.mark.parametrize("kind", SPHERES)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_particle_leaves_a_sphere_at_two_thirds_of_its_height(seed: int, kind: str) -> None:
    off_a_sphere(lambda radius: PointOnSurface(SPHERES[kind](radius), unilateral=True), seed)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_particle_leaves_a_curve_at_two_thirds_of_its_height(seed: int) -> None:
    def hoop(radius: float) -> PointOnCurve:
        return PointOnCurve(ParametricCurve(lambda a: (radius * ca.sin(a), 0, radius * ca.cos(a)), unit="rad"), unilateral=True)

    off_a_sphere(hoop, seed)


def falls_in_a_loop(speed: float, radius: float, g: float) -> tuple[float, np.ndarray, float, np.ndarray]:
    """Time and place where it leaves a loop that it enters below with this speed, and time and place where it strikes again."""
    # N = m v^2 / R + m g cos a = 0 at the angle a from below: v^2 = u^2 - 2 g R (1 - cos a)
    cosine, unit = (2 - speed**2 / (g * radius)) / 3, np.sqrt(radius / g)
    angle = np.arccos(cosine)
    leaves = quad(lambda a: radius / np.sqrt(speed**2 - 4 * g * radius * np.sin(a / 2) ** 2), 0, angle, epsabs=0, epsrel=1e-13)[0]
    at = np.array([np.sin(angle), -cosine])  # over R, and times over the unit
    v = np.sqrt(-cosine) * np.array([cosine, np.sin(angle)])
    lands = 4 * v[1]  # |at + v t - t^2 / 2 up|^2 = 1 + t^3 (t / 4 - v_y)
    return leaves, radius * at, leaves + unit * lands, radius * (at + v * lands - [0, lands**2 / 2])


@pytest.mark.parametrize("kind", ["curve", "surface"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_particle_falls_out_of_a_loop_that_is_too_slow(seed: int, kind: str) -> None:
    of = Drawn(seed)
    radius, g = of.L * of.within(0.3, 3), of.g
    speed = np.sqrt(of.within(2.2, 4.7) * g * radius)
    leaves, at, strikes, where = falls_in_a_loop(speed, radius, g)
    if kind == "curve":
        guide = PointOnCurve(Circle(radius), unilateral=True, side=(0, 0, -1))
    else:
        guide = PointOnSurface(Cylinder(radius, inside_out=True), unilateral=True)
    scene = ac.System()
    scene.world, scene.mass, scene.guide = World((0, -g, 0)), Particle(of.M), guide
    scene.connect(scene.world.frame, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.mass.point)
    p, v = scene.mass.point.position, scene.mass.point.velocity
    start = {p[:2]: (0, -radius), v[:2]: (speed, 0)} | ({p[2]: 0, v[2]: 0} if kind == "surface" else {})
    run = ac.build(scene).simulate(strikes * (1 + 1e-3), start, rtol=1e-12)
    assert times(run)[:2] == pytest.approx([leaves, strikes], rel=INSTANT)
    found = run.at([leaves, strikes])[p] / radius
    assert found[0, :2] == pytest.approx(at / radius, abs=STATE) and found[1, :2] == pytest.approx(where / radius, abs=STATE)


def ramp(size: float, friction: Coulomb | None = None) -> ac.System:
    """A track 5 (1 - x / 10)^2 high that ends at x = 9, and a floor 3 below."""
    scene = ac.System()
    scene.world, scene.mass = World((0, 0, -G * size)), Particle(70.0)
    curve = ParametricCurve(lambda s: (size * s, 0, 5 * size * (1 - s / 10) ** 2), ends=(0.0, 9.0))
    scene.track, scene.floor = PointOnCurve(curve, unilateral=True, friction=friction), PointOnPlane(unilateral=True)
    scene.connect(scene.world.frame, scene.track.frame_a)
    scene.connect(scene.track.frame_b, scene.mass.point)
    scene.connect(scene.world.at((0, 0, -3 * size)), scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.mass.point)
    return scene


@each_value(("size", [1.0, 1e-6, 1e5]), ("rtol", [1e-12, 1e-7]))
def test_a_particle_flies_off_the_end_of_a_track(size: float, rtol: float) -> None:
    """Along the track's tangent there, with all that it fell."""
    scene, height = ramp(size), 5 * (0.95**2 - 0.1**2)
    speed, slope = np.sqrt(2 * G * height), -0.1
    v = speed / np.hypot(1, slope) * np.array([1, slope])
    lasts = (v[1] + np.sqrt(v[1] ** 2 + 2 * G * 3.05)) / G
    run = ac.build(scene).simulate(3.0, {scene.track.q: (0.5, 0), scene.track.v: (0, 0)}, rtol=rtol)
    off, lands = (t.time for t in run.transitions)
    assert lands - off == pytest.approx(lasts, rel=10 * rtol)
    assert run.at([off])[scene.mass.point.position][0] / size == pytest.approx([9, 0, 0.05], abs=10 * rtol)
    assert run.at([lands])[scene.mass.point.position][0] / size == pytest.approx([9 + v[0] * lasts, 0, -3], abs=100 * rtol)
    assert run.energy_error() < 10 * rtol
    flies = run.at(np.linspace(off, lands, 9)[1:])
    far = np.linalg.norm(flies[scene.mass.point.position] / size - [9, 0, 0.05], axis=1)
    assert flies[scene.track.gap] / size == pytest.approx(far, rel=1e-9) and not flies[scene.track.normal_force].any()


def test_what_comes_down_on_a_track_from_behind_its_end_is_held_by_it() -> None:
    scene = ramp(1.0, Coulomb(0.05))
    p = scene.mass.point
    model = ac.build(scene)
    run = model.simulate(3.0, {p.position: (-1, 0, 7), p.velocity: (2, 0, 0)}, rtol=1e-11)
    strikes = brentq(lambda t: 7 - G / 2 * t * t - 5 * (1 - (2 * t - 1) / 10) ** 2, 0.5, 1.0, xtol=1e-15)
    assert times(run)[0] == pytest.approx(strikes, rel=INSTANT) and run.energy_error() < 1e-11
    assert {c.part for change in run.transitions for c in change.changes} == {"track.push", "track.drag", "floor"}
    with pytest.raises(ac.errors.SimulationError, match=r"The gap of track \(.*it jumps"):  # from below
        model.simulate(3.0, {p.position: (10.5, 0, -2), p.velocity: (-6, 0, 3)}, rtol=1e-11)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_pendulum_on_a_string_goes_slack_and_taut(seed: int) -> None:
    """As the loop; where the string is taut again, the velocity along it is lost."""
    of = Drawn(seed)
    length, g, Q, shift = of.L * of.within(0.3, 3), of.g, of.turn(), of.place()
    speed = np.sqrt(of.within(2.2, 4.7) * g * length)
    leaves, at, strikes, where = falls_in_a_loop(speed, length, g)
    scene = ac.System()
    scene.world, scene.mass, scene.rope = World(tuple(Q @ (0, -g, 0))), Particle(of.M), Rope(length)
    ends = [scene.rope.frame_a, scene.rope.frame_b]
    nail, bob = (ends[k] for k in of.order(2))
    scene.connect(scene.world.at(tuple(shift)), nail)
    scene.connect(bob, scene.mass.point)
    p, v = scene.mass.point.position, scene.mass.point.velocity
    start = {p: shift + Q @ (0, -length, 0), v: Q @ (speed, 0, 0)}
    run = ac.build(scene).simulate(strikes * (1 + 1e-3), start, rtol=1e-12)
    assert times(run)[:2] == pytest.approx([leaves, strikes], rel=INSTANT)
    assert run.at([leaves, strikes])[p] - shift == pytest.approx(np.array([[*at, 0], [*where, 0]]) @ Q.T, abs=STATE * length)
    rounding = 1e-13 * (length + np.linalg.norm(shift))
    assert np.min(run[scene.rope.slack]) > -rounding and np.min(run[scene.rope.tension]) >= 0
    late = run.at(np.linspace(strikes, run.t[-1], 5)[1:])
    assert np.max(np.abs(np.linalg.norm(late[p] - shift, axis=1) - length)) < rounding
    leaving = np.sqrt(g * at[1]) * np.array([-at[1], np.sqrt(length**2 - at[1] ** 2)]) / length
    kept = (leaving - [0, g * (strikes - leaves)]) @ np.array([-where[1], where[0]]) / length
    fast, up = np.linalg.norm(late[v][0]), (late[p][0] - shift) @ Q[:, 1]
    assert fast**2 / 2 + g * up == pytest.approx(kept**2 / 2 + g * where[1], abs=STATE * g * length)


def row_of_balls(places: list[float], order: list[int], restitution: float = 1.0) -> tuple[ac.System, list[RigidBody]]:
    """Balls of radius 1/2 along x without gravity, declared in an order."""
    scene = ac.System()
    scene.world = World(None)
    balls = [RigidBody.ball(1.0, 0.5) for _ in places]
    scene.balls = [balls[k] for k in order]
    pairs = [Contact(Sphere(0.5), Sphere(0.5), Hard(restitution)) for _ in places[1:]]
    scene.pairs = [pairs[k] for k in order if k < len(pairs)]
    for k, pair in enumerate(pairs):
        scene.connect(balls[k].frame, pair.frame_a)
        scene.connect(pair.frame_b, balls[k + 1].frame)
    return scene, balls


@each_value(("order", [[0, 1, 2], [2, 0, 1]]), ("apart", [0.0, 1e-3]))
def test_one_ball_strikes_two(order: list[int], apart: float) -> None:
    """Two that touch take part in one impact: with e = 1 by Poisson (-1/3, 2/3, 2/3); a little apart it is handed on: (0, 0, 1)."""
    places = [-0.5, 1.0, 2.0 + apart]
    scene, balls = row_of_balls(places, order)
    start = {ball.frame.position: (x, 0, 0) for ball, x in zip(balls, places, strict=True)}
    start |= {ball.frame.velocity: (float(k == 0), 0, 0) for k, ball in enumerate(balls)}
    run = ac.build(scene).simulate(1.0, start, rtol=1e-12)
    assert times(run) == pytest.approx([0.5, 0.5 + apart][: 2 if apart else 1], rel=INSTANT)
    ends = [run[ball.frame.velocity][-1, 0] for ball in balls]
    assert ends == pytest.approx([0, 0, 1] if apart else [-1 / 3, 2 / 3, 2 / 3], abs=STATE)


@pytest.mark.parametrize("seed", SEEDS)
def test_two_particles_on_a_rope_through_a_hole(seed: int) -> None:
    """One on a smooth table goes straight while the other, thrown up below, flies; the rope tightens, and pulls both by one impulse."""
    of = Drawn(seed)
    m, M, r, below = *(of.M * 10 ** of.rng.uniform(-1, 1, 2)), of.L * of.within(0.1, 1), of.L * of.within(0.1, 1)
    g, restitution = of.g, float(of.rng.choice([0.0, of.within(0.1, 1)]))
    up, across = np.sqrt(2 * g * below) * of.within(0.1, 0.9), np.sqrt(g * r) * of.within(0.1, 3)
    scene = ac.System()
    scene.world = World((0, 0, -g))
    top, low = particles = [Particle(m), Particle(M)]
    scene.particles = [particles[k] for k in of.order(2)]
    scene.table, scene.rope = PointOnPlane(unilateral=True), Rope(r + below, restitution, over=[scene.world.at((0, 0, 0))])
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, top.point, scene.rope.frame_a)
    scene.connect(scene.rope.frame_b, low.point)
    p, q = top.point, low.point
    # mean rate at which the rope becomes slack; hypot(r, a) - r without a difference
    rate = lambda t: up - g / 2 * t - across**2 * t / (r + np.hypot(r, across * t))  # noqa: E731
    taut = brentq(rate, 0, 2 * up / g, xtol=1e-300, rtol=1e-15)
    start = {p.position: (r, 0, 0), p.velocity: (0, across, 0), q.position: (0, 0, -below), q.velocity: (0, 0, up)}
    run = ac.build(scene).simulate(taut, start, rtol=1e-12)
    assert times(run) == pytest.approx([taut], rel=INSTANT)
    away = np.array([r, across * taut, 0]) / np.hypot(r, across * taut)
    v, w = np.array([0, across, 0]), up - g * taut
    impulse = (1 + restitution) * (away @ v - w) / (1 / m + 1 / M)
    fast = up + across
    assert run[p.velocity][-1] == pytest.approx(v - impulse / m * away, abs=STATE * fast * max(1, M / m))
    assert run[q.velocity][-1] == pytest.approx([0, 0, w + impulse / M], abs=STATE * fast * max(1, m / M))


def hangs(
    m: np.ndarray, p: np.ndarray, v: np.ndarray, slack: float, e: float
) -> tuple[list[float], tuple[np.ndarray, np.ndarray]]:
    """When a rope over an eyelet at the origin tightens, until two particles hang on it, and where they and their velocities are then."""
    g, t, instants = np.array([0, 0, -G]), 0.0, []

    def opening(s: float) -> float:  # its mean speed in a time s, without differences of lengths
        grown = 2 * np.sum(p * v, axis=1) + s * (np.sum(v * v, axis=1) + p @ g) + s * s * (v @ g) + s**3 / 4 * (g @ g)
        return slack / s - np.sum(grown / (np.linalg.norm(p + s * v + s * s / 2 * g, axis=1) + np.linalg.norm(p, axis=1)))

    while True:
        lengths = np.linalg.norm(p, axis=1)
        along = np.sum(p * v, axis=1) / lengths
        s = 1e-3
        if instants:
            s = -np.sum(along) / np.sum((np.sum(v * v, axis=1) - along**2 + p @ g) / lengths)
            if 0 < s < 1e-14:
                return instants, (p, v)
            s = s / 4 if s > 0 else 1e-3
        while opening(s) > 0:
            s *= 1.1
        s = brentq(opening, s / 1.1, s, xtol=1e-300, rtol=1e-15)
        p, v, t, slack = p + s * v + s * s / 2 * g, v + s * g, t + s, 0.0
        instants.append(t)
        away = p / np.linalg.norm(p, axis=1)[:, None]
        v = v - ((1 + e) * np.sum(away * v) / np.sum(1 / m) / m)[:, None] * away


class RopeOverAnEyelet(ac.System):
    """Two particles that are thrown, with numbers drawn, and what becomes of them: parabolas, jerks, then they hang on one another."""

    def __init__(self, seed: int, restitution: float) -> None:
        draw = np.random.default_rng(seed)
        self.masses, self.places = 10 ** draw.uniform(-1, 1, 2), draw.normal(size=(2, 3))
        self.places[:, 2] = -1 - np.abs(self.places[:, 2])
        self.speeds, self.slack = draw.normal(size=(2, 3)), draw.uniform(0.01, 0.5)
        length = float(np.sum(np.linalg.norm(self.places, axis=1)) + self.slack)
        self.bounce, self.restitution, self.length = restitution, ac.Parameter(restitution), ac.Parameter(length, "m")
        self.world, self.a, self.b = World(), Particle(self.masses[0]), Particle(self.masses[1])
        self.rope = Rope(self.length, self.restitution, over=[self.world.at((0, 0, 0))])
        self.connect(self.a.point, self.rope.frame_a)
        self.connect(self.b.point, self.rope.frame_b)

    def start(self) -> dict[ac.Expression, np.ndarray]:
        p, q = self.a.point, self.b.point
        return dict(zip((p.position, q.position, p.velocity, q.velocity), (*self.places, *self.speeds), strict=True))

    def rates(self, _: float, y: np.ndarray) -> np.ndarray:
        p, v = y[:6].reshape(2, 3), y[6:].reshape(2, 3)
        r = np.linalg.norm(p, axis=1)
        away = p / r[:, None]
        turns = np.sum(v * v, axis=1) - np.sum(away * v, axis=1) ** 2
        tension = (np.sum(turns / r) - G * np.sum(away[:, 2])) / np.sum(1 / self.masses)
        return np.concatenate([v.ravel(), ([0, 0, -G] - away * (tension / self.masses)[:, None]).ravel()])

    def hangs(self, bouncier: float = 0.0, longer: float = 0.0) -> tuple[list[float], np.ndarray]:
        """When the rope tightens, and places and velocities when it does so for good."""
        instants, at = hangs(self.masses, self.places, self.speeds, self.slack + longer, self.bounce + bouncier)
        return instants, np.ravel(at)

    def end(self, later: float, bouncier: float = 0.0, longer: float = 0.0) -> np.ndarray:
        """Places and velocities after that."""
        instants, at = self.hangs(bouncier, longer)
        return solve_ivp(self.rates, (instants[-1], later), at, method="DOP853", rtol=3e-14, atol=1e-16).y[:, -1]


@pytest.mark.parametrize(("seed", "restitution"), [(0, 0.1), (2, 0.5), (1, 0.7), (3, 0.9)])
def test_a_rope_over_an_eyelet_is_taut_after_jerks_without_end(seed: int, restitution: float) -> None:
    """The instant is known by how jerks are rounded, what comes after it to rounding."""
    scene = RopeOverAnEyelet(seed, restitution)
    instants = scene.hangs()[0]
    later = 1.05 * instants[-1]
    run = ac.build(scene).simulate(later, scene.start(), rtol=1e-12)
    assert times(run)[0] == pytest.approx(instants[0], rel=INSTANT)
    assert run.transitions[-1].time == pytest.approx(instants[-1], abs=5 * INSTANT)
    end = scene.end(later)
    found = np.ravel([run[expression][-1] for expression in scene.start()])
    assert found == pytest.approx(end, abs=1e-12 * np.max(np.abs(end)))
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize(("seed", "restitution"), [(0, 0.1), (2, 0.5)])
def test_what_hangs_after_jerks_without_end_depends_on_them_as_differences_say(seed: int, restitution: float) -> None:
    scene, step = RopeOverAnEyelet(seed, restitution), 2e-4
    later = 1.05 * scene.hangs()[0][-1]
    found = ac.build(scene).sensitivities([0.0, later], [scene.restitution, scene.length], scene.start(), rtol=1e-12)
    for column, moved in enumerate(np.eye(2) * step):
        back, before, after, on = (scene.end(later, *(k * moved)) for k in (-2, -1, 1, 2))
        told = np.concatenate([found[expression][-1, :, column] for expression in scene.start()])
        assert told == pytest.approx((back - 8 * before + 8 * after - on) / (12 * step), abs=1e-9)


def rests_on_a_shaken_table(high: float, rate: float, shaken: float, e: float) -> float:
    """When a ball that is let go above a table at shaken sin(rate t) comes to rest on it: parabolas, in differences that do not cancel."""
    t, v, gap = 0.0, -shaken * rate, high

    def opening(s: float) -> float:  # its mean speed in a time s
        x = rate * s / 2
        moved = 2 * np.sin(x) * (np.cos(rate * t + x) - np.cos(rate * t)) + 2 * np.cos(rate * t) * (np.sin(x) - x)
        return gap / s + v - G * s / 2 - shaken * moved / s

    while True:
        down = G - shaken * rate**2 * np.sin(rate * t)
        s = 1e-3 if gap else 2 * v / down
        if s < 1e-12:
            return t + s / (1 - e)
        s /= 4
        while opening(s) > 0:
            s *= 1.05
        s = brentq(opening, s / 1.05, s, xtol=1e-300, rtol=1e-15)
        v = -e * (v - G * s + 2 * shaken * rate * np.sin(rate * t + rate * s / 2) * np.sin(rate * s / 2))
        t, gap = t + s, 0.0


@pytest.mark.parametrize(("seed", "restitution"), [(9, 0.8), (13, 0.9)])
def test_a_ball_comes_to_rest_on_a_shaken_table_when_it_should(seed: int, restitution: float) -> None:
    """Of extrapolations some agree by chance, before they are right."""
    draw = np.random.default_rng(seed)
    high, rate = draw.uniform(0.05, 0.5), draw.uniform(1, 6)
    shaken = draw.uniform(0.1, 0.6) * G / rate**2
    scene = ac.System()
    scene.world, scene.table = World(), PrescribedMotion(position=(0, 0, shaken * np.sin(rate * ac.time)))
    scene.ball, scene.rail = Particle(1.0), Prismatic("z")
    scene.contact = PointOnPlane(unilateral=True, restitution=restitution)
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.contact.frame_a)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.ball.point)
    scene.connect(scene.contact.frame_b, scene.ball.point)
    rest = rests_on_a_shaken_table(high, rate, shaken, restitution)
    run = ac.build(scene).simulate(1.02 * rest, {scene.rail.q: high, scene.rail.v: 0.0}, rtol=1e-12, compiled=False)
    assert run.transitions[-1].time == pytest.approx(rest, rel=INSTANT)
    assert run[scene.rail.q][-1] == pytest.approx(shaken * np.sin(rate * 1.02 * rest), abs=1e-14)


@pytest.mark.parametrize(("seed", "restitutions"), [(9, (0.9, 0.9, 0.9)), (6, (0.6, 0.6, 0.6))])
def test_balls_that_bounce_beside_one_another_come_to_rest_each_at_its_own_time(
    seed: int, restitutions: tuple[float, ...]
) -> None:
    """Though they strike in turns for a while, the first does not take the others along."""
    draw = np.random.default_rng(seed)
    draw.integers(2, 5), draw.choice([0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9], 3)
    high, e = draw.uniform(0.05, 0.5, 3), np.array(restitutions)
    rests = np.sqrt(2 * high / G) * (1 + e) / (1 - e)
    scene = ac.System()
    scene.world, scene.rails, scene.balls = World(), [Prismatic("z") for _ in e], [Particle(1.0 + k) for k in range(3)]
    scene.floors = [PointOnPlane(unilateral=True, restitution=restitution) for restitution in restitutions]
    for rail, ball, floor in zip(scene.rails, scene.balls, scene.floors, strict=True):
        scene.connect(scene.world.frame, rail.frame_a, floor.frame_a)
        scene.connect(rail.frame_b, ball.point, floor.frame_b)
    start = {rail.q: z for rail, z in zip(scene.rails, high, strict=True)} | {rail.v: 0.0 for rail in scene.rails}
    run = ac.build(scene).simulate(1.01 * np.max(rests), start, rtol=1e-12, compiled=False)
    closed = {change.part: t.time for t in run.transitions for change in t.changes if change.new == "closed"}
    assert [next(time for part, time in closed.items() if f"[{k}]" in part) for k in range(3)] == pytest.approx(
        rests, rel=INSTANT
    )


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_particle_runs_off_a_table_with_a_round_edge(speed: float) -> None:
    """At once where v^2 > g R, else further down, where v^2 = g R cos: cos = 2/3 + v^2 / (3 g R)."""
    R = 0.5
    curve = ParametricCurve(
        lambda s: (ca.if_else(s < 0, s, R * ca.sin(s / R)), 0, ca.if_else(s < 0, 0, R * ca.cos(s / R) - R)), unit="m"
    )
    guide = PointOnCurve(curve, unilateral=True)
    scene = held(guide)
    p = scene.mass.point.position
    run = ac.build(scene).simulate(0.5, {guide.q: (-0.2, 0), guide.v: (speed, 0)}, rtol=1e-12)
    cosine = min(2 / 3 + speed**2 / (3 * G * R), 1.0)
    leaves = (
        0.2 / speed
        + quad(lambda a: R / np.sqrt(speed**2 + 4 * G * R * np.sin(a / 2) ** 2), 0, np.arccos(cosine), epsabs=0, epsrel=1e-13)[0]
    )
    assert times(run) == pytest.approx([leaves], rel=INSTANT)
    fast, t, sine = np.sqrt(speed**2 + 2 * G * R * (1 - cosine)), 0.5 - leaves, np.sqrt(1 - cosine**2)
    flown = [R * sine + fast * cosine * t, 0, R * (cosine - 1) - fast * sine * t - G / 2 * t * t]
    assert run[p][-1] == pytest.approx(flown, abs=STATE)


def test_an_egg_bounces_without_a_loss_and_as_it_does_where_nearest_points_are_followed() -> None:
    """On a plane by its closed form, and on heights that happen to be level by a joint with the gap as a coordinate: the same motion, and the same instants."""
    ends: list[np.ndarray] = []
    for surface in (Plane(), HeightField(lambda x, y: 0.0 * x)):
        scene = ac.System()
        scene.world, scene.body = World(), RigidBody(1.0, (0.002, 0.003, 0.004))
        scene.floor = Contact(Ellipsoid((0.15, 0.1, 0.08)), surface, Hard(restitution=1.0))
        scene.connect(scene.world.frame, scene.floor.frame_a)
        scene.connect(scene.floor.frame_b, scene.body.frame)
        frame = scene.body.frame
        start = {
            frame.position: (0, 0, 0.15),
            frame.rotation: np.eye(3),
            frame.velocity: (0.1, 0, 0),
            frame.angular_velocity: (1, 2, 0),
        }
        run = ac.build(scene).simulate(0.6, start, rtol=1e-12)
        assert len(times(run)) >= 3 and run.energy_error() < 1e-11
        ends.append(np.concatenate([times(run), run[frame.position][-1], run[frame.rotation][-1].ravel()]))
    assert np.max(np.abs(ends[0] - ends[1])) < 1e-9


def test_a_rod_that_falls_on_one_end_is_turned() -> None:
    """One impulse (1 + e) m u / (1 + 3 cos^2) at the end of a thin rod that comes down without turning, inclined by an angle."""
    length, angle, fast, restitution = 0.8, 0.4, 2.0, 0.5
    scene = ac.System()
    scene.world, scene.rod = World(None), RigidBody.rod(1.5, (length, 0, 0), radius=1e-3)
    scene.foot = PointOnPlane(unilateral=True, restitution=restitution)
    scene.connect(scene.world.frame, scene.foot.frame_a)
    scene.connect(scene.foot.frame_b, scene.rod.frame)
    frame, c, s = scene.rod.frame, np.cos(angle), np.sin(angle)
    upwards = ((c, 0, -s), (0, 1, 0), (s, 0, c))
    start = {
        frame.position: (0, 0, 0.2),
        frame.rotation: upwards,
        frame.velocity: (0, 0, -fast),
        frame.angular_velocity: (0, 0, 0),
    }
    run = ac.build(scene).simulate(0.15, start, rtol=1e-12)
    inertia = 1.5 * (length**2 / 12 + 1e-6 / 4)
    impulse = (1 + restitution) * fast / (1 / 1.5 + (length / 2 * c) ** 2 / inertia)
    assert times(run) == pytest.approx([0.1], rel=INSTANT)
    assert run[frame.angular_velocity][-1] == pytest.approx([0, impulse * length / 2 * c / inertia, 0], abs=STATE)
    after = run.at([0.1 + 1e-12])[frame.velocity][0, 2]
    assert after == pytest.approx(restitution * fast, abs=1e-9)


def test_a_string_between_two_particles_tightens_and_slackens_by_its_restitution() -> None:
    """Apart at 1 m/s they go until it is taut, and come back at e times that: a string that strikes."""
    scene = ac.System()
    scene.world, scene.a, scene.b, scene.rope = World(None), Particle(1.0), Particle(3.0), Rope(2.0, restitution=0.5)
    scene.connect(scene.a.point, scene.rope.frame_a)
    scene.connect(scene.rope.frame_b, scene.b.point)
    a, b = scene.a.point, scene.b.point
    run = ac.build(scene).simulate(
        1.0, {a.position: (0, 0, 0), b.position: (1.5, 0, 0), a.velocity: (-0.5, 0, 0), b.velocity: (0.5, 0, 0)}, rtol=1e-12
    )
    assert times(run) == pytest.approx([0.5], rel=INSTANT)
    # the centre of mass keeps 1/4
    assert run[a.velocity][-1] == pytest.approx([0.25 + 0.5 * 0.75, 0, 0], abs=STATE)
    assert run[b.velocity][-1] == pytest.approx([0.25 - 0.5 * 0.25, 0, 0], abs=STATE)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Coulomb(-0.1), "Coulomb's mu is -0.1"),
        (lambda: Coulomb(0.4, static=0.3), "static is less than its mu, by 0.1"),
        (lambda: Coulomb(ac.Parameter(0.4), static=0.3), "static is less than its mu, by 0.1"),
        (lambda: Coulomb(0.4, static=-0.3), "Coulomb's static is -0.3"),
        (lambda: Hard(-0.1), "Hard's restitution is -0.1"),
        (lambda: Hard(1.2), "Hard's restitution is 1.2"),
        (lambda: Hard(ac.Parameter(1.2)), "Hard's restitution is 1.2"),
        (lambda: Hard(friction=0.3), "Give Coulomb"),
        (lambda: PointOnPlane(unilateral=True, restitution=1.5), "PointOnPlane's restitution is 1.5"),
        (lambda: PointOnPlane(unilateral=1), "PointOnPlane's unilateral is 1"),
        (lambda: PointOnPlane(restitution=0.5), "nothing strikes"),
        (lambda: PointOnCurve(Circle(1.0), friction=0.3), "Give Coulomb"),
        (lambda: PointOnSurface(Circle(1.0), unilateral=True), "surface is"),
        (lambda: PointOnCurve(Circle(1e-3), unilateral=True), r"along `side`, \(0.0, 1.0, 0.0\)"),
        (lambda: PointOnCurve(Circle(1e3), unilateral=True, side=(3, 1, 0)), "across the curve all along"),
        (lambda: PointOnCurve(Helix(1.0, 0.0), unilateral=True), "across the curve all along"),
        (lambda: Rope(1.0, restitution=2.0), "Rope's restitution is 2"),
        (lambda: Rope(-1.0), "Rope's length is -1"),
    ],
)
def test_what_cannot_be_is_refused_with_the_line(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ac.errors.ParameterError, match=rf"{words}.*") as refused:
        make()
    assert "test_hard_contacts.py:" in str(refused.value)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_track_that_runs_along_its_side_where_a_loop_is_looked_at_is_looked_at_beside(size: float) -> None:
    """A follower on a rail over a circle that turns, held across by mistake: closing it to rounding ends where the circle runs along its side."""
    scene = ac.System()
    scene.world, scene.rail, scene.mass, scene.radius = World(), Prismatic("z"), Particle(0.2), ac.Parameter(size, "m")
    scene.cam, scene.face = (
        PrescribedMotion(angle=lambda t: 40.0 * t, axis="y"),
        PointOnCurve(Circle(scene.radius), unilateral=True),
    )
    scene.connect(scene.world.frame, scene.rail.frame_a, scene.cam.frame_a)
    scene.connect(scene.rail.frame_b, scene.mass.point, scene.face.frame_b)
    scene.connect(scene.cam.frame_b, scene.face.frame_a)
    with pytest.raises(ac.errors.AcausalError, match=r"'rail'|'face'"):
        ac.build(scene).simulate(0.1)


def test_a_start_inside_of_what_is_hard_is_refused_by_part_and_line() -> None:
    scene = held(PointOnPlane(unilateral=True))
    with pytest.raises(
        ac.errors.SimulationError, match=r"gap of guide.* \(.*test_hard_contacts.py:\d+\) is negative at the start \(-0\.1 m\)"
    ):
        ac.build(scene).simulate(1.0, {scene.mass.point.position: (0, 0, -0.1)})


def test_a_rope_that_is_shorter_than_its_ends_are_apart_is_refused_by_part_and_line() -> None:
    scene = held(Rope(1.0))
    with pytest.raises(
        ac.errors.SimulationError, match=r"guide.tie \(.*test_hard_contacts.py:\d+\) .*\(-0\.5 m\).*A rope is shorter"
    ):
        ac.build(scene).simulate(1.0, {scene.mass.point.position: (0, 0, -1.5)})


@pytest.mark.parametrize(("speed", "mu"), [(0.4, 0.0), (1.5, 0.0), (1.5, 30.0)])
def test_a_ball_goes_over_the_edge_of_a_table(speed: float, mu: float) -> None:
    """About the edge by an angle with cos = (10 + 7 v^2 / (g r)) / 17 if it rolls, (2 + v^2 / (g r)) / 3 if it slides, or at once if that is over 1."""
    r, m = 0.1, 0.7
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(m, r)
    scene.table = Contact(Sphere(r), Plate(2.0, 1.0), Hard(friction=Coulomb(mu) if mu else None))
    scene.connect(scene.world.at((-1.0, 0, 0)), scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    k = 1.4 if mu else 1.0  # kinetic energy over that of sliding
    cosine = min((2 * G * r / k + speed**2) / (G * r * (1 + 2 / k)), 1.0)
    rate = lambda a: np.sqrt(speed**2 + 4 * G * r / k * np.sin(a / 2) ** 2) / r  # noqa: E731
    leaves = 0.1 / speed + quad(lambda a: 1 / rate(a), 0, np.arccos(cosine), epsabs=0, epsrel=1e-13)[0]
    start = {
        frame.position: (-0.1, 0, r),
        frame.velocity: (speed, 0, 0),
        frame.rotation: np.eye(3),
        frame.angular_velocity: (0, speed / r if mu else 0, 0),
    }
    run = ac.build(scene).simulate(leaves + 0.1, start, rtol=1e-12)
    sine, fast = np.sqrt(1 - cosine**2), r * rate(np.arccos(cosine))
    flown = np.array([r * sine + fast * cosine * 0.1, 0, r * cosine - fast * sine * 0.1 - G / 2 * 0.01])
    assert times(run)[-1] == pytest.approx(leaves, rel=INSTANT)
    assert run[frame.position][-1] == pytest.approx(flown, abs=STATE)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cradle_of_three_pendulums_hands_on_by_poissons_law(seed: int) -> None:
    """The first falls by a quarter of its circle on two that hang still and touch: what stops both gaps from closing, and the restitution times that again."""
    of = Drawn(seed)
    length, g, e = of.L * of.within(0.3, 2), of.g, of.within(0.2, 1)
    r, m = length * of.within(0.05, 0.2), of.M * 10 ** of.rng.uniform(-1, 1, 3)
    own = m * length**2 * of.rng.uniform(0.01, 0.3, 3)
    scene = ac.System()
    scene.world = World((0, 0, -g))
    hinges = [Revolute("y") for _ in m]
    balls = [RigidBody(float(w), (float(i),) * 3, (0, 0, -length)) for w, i in zip(m, own, strict=True)]
    order = of.order(3)
    scene.hinges, scene.balls = [hinges[k] for k in order], [balls[k] for k in order]
    scene.pairs = [Contact(Sphere(r), Sphere(r), Hard(e)) for _ in (0, 1)]
    bobs = [ball.at((0, 0, -length)) for ball in balls]
    for k, (hinge, ball) in enumerate(zip(hinges, balls, strict=True)):
        scene.connect(scene.world.at((2 * r * k, 0, 0)), hinge.frame_a)
        scene.connect(hinge.frame_b, ball.frame)
    for pair, k in zip(scene.pairs, of.order(2), strict=True):
        scene.connect(bobs[k], pair.frame_a)
        scene.connect(pair.frame_b, bobs[k + 1])
    inertia = m * length**2 + own
    slow = np.sqrt(m[0] * g * length / inertia[0])
    falls = ellipk(0.5) / slow
    run = ac.build(scene).simulate(falls, {hinges[0].q: np.pi / 2, hinges[1].q: 0.0, hinges[2].q: 0.0}, rtol=1e-12)
    assert times(run) == pytest.approx([falls], rel=INSTANT)
    gaps = np.array([[-1, 1, 0], [0, -1, 1]])
    blow = np.linalg.solve(gaps @ (gaps / inertia).T, [1, 0])
    after = [1, 0, 0] + (1 + e) * gaps.T @ blow / inertia
    found = [run[hinge.v][-1].item() / (np.sqrt(2) * -slow) for hinge in hinges]
    assert found == pytest.approx(after, abs=STATE * np.max(inertia) / np.min(inertia))
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("seed", range(6))
def test_a_block_shot_up_an_incline_stops_and_stays_or_slides_back(seed: int) -> None:
    """Slowed by g (sin + mu cos); it stays where tan <= static, else it goes back with g (sin - mu cos)."""
    of = Drawn(seed)
    slope, Q, shift, mass, g = of.within(0.1, 1.2), of.turn(), of.place(), of.M, of.g
    s, c, stays = np.sin(slope), np.cos(slope), seed % 2
    mu, static = np.tan(slope) * np.sort(of.rng.uniform(0.1, 0.99, 2))
    if stays:
        static = np.tan(slope) * of.within(1.01, 2)
    speed = np.sqrt(g * of.L) * of.within(0.3, 3)
    scene = ac.System()
    scene.world, scene.mass = World(tuple(Q @ (-g * s, 0, -g * c))), Particle(mass)
    scene.guide = PointOnPlane(unilateral=True, friction=Coulomb(mu, static=static))
    scene.connect(scene.world.at(tuple(shift), rotation=Q), scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.mass.point)
    p, v = scene.mass.point.position, scene.mass.point.velocity
    stop = speed / (g * (s + mu * c))
    end, back = stop * of.within(1.2, 3), 0.0 if stays else g * (s - mu * c)
    run = ac.build(scene).simulate(end, {p: shift, v: Q @ (speed, 0, 0)}, rtol=1e-12)
    assert np.min(np.abs(np.array(times(run)) - stop)) < INSTANT * stop  # its direction is held a little before
    far = speed * stop / 2 - back / 2 * (end - stop) ** 2
    assert (run[p][-1] - shift) @ Q == pytest.approx([far, 0, 0], abs=STATE * (speed * stop + np.linalg.norm(shift)))
    push, drag = run[scene.guide.normal_force].ravel() / (mass * g), run[scene.guide.friction_force][-1] / (mass * g)
    assert push == pytest.approx(c, rel=STATE)
    assert Q.T @ drag == pytest.approx([s if stays else mu * c, 0, 0], abs=STATE)


@pytest.mark.parametrize(
    ("seed", "rtol"),
    [
        *((3, 1e-4), (28, 1e-3), (47, 3e-4), (70, 1e-4), (105, 1e-4), (116, 1e-3), (127, 1e-5), (206, 1e-3), (251, 1e-4)),
        *((301, 1e-5), (315, 1e-7), (353, 1e-3), (358, 1e-7), (389, 1e-3)),
    ],
)
def test_slip_along_a_line_stops_where_it_turns_round_however_loosely_it_is_followed(seed: int, rtol: float) -> None:
    """On planes turned at random, up which it is shot: more friction at rest than it slides with keeps it there, which steps across the stop would miss."""
    draw = np.random.default_rng([seed, 7])
    size, gravity, mass, slope = (
        10 ** draw.uniform(-4, 4),
        10 ** draw.uniform(-2, 2),
        10 ** draw.uniform(-4, 4),
        draw.uniform(0.05, 1.4),
    )
    part = draw.choice([draw.uniform(0.2, 0.95), draw.uniform(1.05, 4)])
    mu = float(part * np.tan(slope))
    static = float(mu * draw.choice([1.0, draw.uniform(1, 1.5)]))
    Q = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    Q *= np.linalg.det(Q)
    speed, shift = np.sqrt(gravity * size) * draw.uniform(0.3, 3), draw.normal(size=3) * size
    scene = ac.System()
    scene.world, scene.mass = World(Q @ (-gravity * np.sin(slope), 0, -gravity * np.cos(slope))), Particle(mass)
    scene.plane = PointOnPlane(unilateral=True, friction=Coulomb(mu, static=static))
    scene.connect(scene.plane.frame_b, scene.mass.point)
    scene.connect(scene.world.at(tuple(shift), rotation=Q), scene.plane.frame_a)
    slows = gravity * (np.sin(slope) + mu * np.cos(slope))
    stop = speed / slows
    p, v = scene.mass.point.position, scene.mass.point.velocity
    run = ac.build(scene).simulate(stop * draw.uniform(1.2, 2.5), {p: shift, v: Q @ (speed, 0, 0)}, rtol=rtol)
    assert static > np.tan(slope)
    assert times(run)[-1] == pytest.approx(stop, rel=rtol)
    assert run.modes(scene.plane).words[-1] == "closed, sticks"
    assert np.linalg.norm(run[p][-1] - shift - Q @ (speed * stop / 2, 0, 0)) < rtol * speed * stop
    assert np.linalg.norm(run[v][-1]) < 1e-12 * speed


def test_a_block_thrown_across_a_floor_stops_on_a_straight_line() -> None:
    scene = held(PointOnPlane(unilateral=True, friction=Coulomb(0.3)))
    p, v = scene.mass.point.position, scene.mass.point.velocity
    run = ac.build(scene).simulate(3.0, {p: (0, 0, 0), v: (3.0, -4.0, 0)}, rtol=1e-12)
    assert times(run)[-1] == pytest.approx(5.0 / (0.3 * G), rel=INSTANT)
    assert run[p][-1] == pytest.approx(np.array([0.6, -0.8, 0]) * 25 / (2 * 0.3 * G), abs=STATE)


def test_a_ball_that_slides_begins_to_roll_at_five_sevenths_of_its_speed() -> None:
    """Its slip falls with 7/2 mu g, whichever way it is turned; then it rolls without a loss."""
    mu, speed, r = 0.2, 2.0, 0.1
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(0.7, r)
    scene.floor = Contact(Sphere(r), Plane(), Hard(friction=Coulomb(mu, static=0.3)))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    frame, along = scene.ball.frame, np.array([0.6, 0.8, 0])
    start = {
        frame.position: (0, 0, r),
        frame.velocity: speed * along,
        frame.angular_velocity: (0, 0, 0),
        frame.rotation: np.eye(3),
    }
    run = ac.build(scene).simulate(2.0, start, rtol=1e-12)
    rolls = 2 * speed / (7 * mu * G)
    assert times(run)[-1] == pytest.approx(rolls, rel=INSTANT)
    assert run[frame.velocity][-1] == pytest.approx(5 / 7 * speed * along, abs=STATE)
    far = speed * rolls - mu * G / 2 * rolls**2 + 5 / 7 * speed * (2.0 - rolls)
    assert run[frame.position][-1] == pytest.approx([far * 0.6, far * 0.8, r], abs=STATE)
    assert np.linalg.norm(run[scene.floor.slip][-1]) < STATE


@pytest.mark.parametrize("rtol", [1e-9, 1e-12])
def test_wherever_a_slip_ends_its_instant_is_exact_and_nothing_after_it_is_worse(rtol: float) -> None:
    """Beyond it the direction of a slip is another, and at it rounding: at 20 speeds, to 1e-12 s."""
    r, mu = 0.1, 0.2
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(0.7, r)
    scene.floor = Contact(Sphere(r), Plane(), Hard(friction=Coulomb(mu, static=0.3)))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    frame, model = scene.ball.frame, ac.build(scene)
    for k in range(20):
        speed = 2.0 * (1 + 0.06 * k)
        run = model.simulate(2.0, {frame.position: (0, 0, r), frame.velocity: speed * np.array([0.6, 0.8, 0])}, rtol=rtol)
        assert times(run)[-1] == pytest.approx(2 * speed / (7 * mu * G), abs=1e-12)
        assert run.energy_error() < 2e-12
        assert run.statistics.steps < 100


@each_value(("rolls", [False, True]), ("seed", [0, 1, 2, 3, 17, 29]))
def test_slips_on_inclines_end_when_they_must_however_large_all_is(seed: int, rolls: bool) -> None:
    """s (limit + a cos) falls at the rate limit^2 - a^2, with a along the slope, and limit what friction makes of the slip s: 3.5 times as much of a ball's."""
    rng = np.random.default_rng(seed)
    mu, g, mass, r = 10 ** rng.uniform(-1.5, 0), G * 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-3, 1)
    most = 3.5 * mu if rolls else mu
    tilt = np.arctan(most * rng.uniform(0.05, 0.8))
    scene = ac.System()
    scene.world = World((g * np.sin(tilt), 0, -g * np.cos(tilt)))
    scene.floor = (
        Contact(Sphere(r), Plane(), Hard(friction=Coulomb(mu))) if rolls else PointOnPlane(unilateral=True, friction=Coulomb(mu))
    )
    scene.body = RigidBody.ball(mass, r) if rolls else Particle(mass)
    f = scene.body.frame if rolls else scene.body.point
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, f)
    model, a, limit = ac.build(scene), g * np.sin(tilt), most * g * np.cos(tilt)
    for k in range(4):
        size, angle = np.sqrt(g * r) * 10 ** rng.uniform(-1, 1), rng.uniform(0, 2 * np.pi)
        v = size * np.array([np.cos(angle), np.sin(angle), 0])
        start = {f.position: (0, 0, r if rolls else 0), f.velocity: v}
        slip = v
        if rolls and k > 1:
            start[f.angular_velocity] = w = rng.normal(size=3) * size / r
            slip = v + np.cross(w, (0, 0, -r))
        s = float(np.linalg.norm(slip))
        ends = (s * limit + a * slip[0]) / (limit**2 - a**2)
        run = model.simulate(1.1 * ends, start, rtol=(rtol := (1e-11, 1e-9)[k % 2]))
        assert [t.time for t in run.transitions if t.changes] == pytest.approx([ends], rel=20 * rtol)
        assert np.linalg.norm(run[scene.floor.slip][-1]) < 1e-9 * s


@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
def test_what_was_rounding_is_followed_to_the_tolerance_when_it_is_driven(rtol: float) -> None:
    """A ball slides and rolls without a turn about the vertical, of which there is rounding only; from 1 s on it is driven: w' = 30 (t - 1)^2."""
    r, mass = 0.1, 0.7
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(mass, r)
    scene.floor = Contact(Sphere(r), Plane(), Hard(friction=Coulomb(0.2, static=0.3)))
    scene.drive = Torque((0, 0, 0.4 * mass * r**2 * ca.if_else(ac.time > 1, 30 * (ac.time - 1) ** 2, 0)))
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame, scene.drive.frame)
    frame = scene.ball.frame
    start = {
        frame.position: (0, 0, r),
        frame.velocity: (1.2, 1.6, 0),
        frame.angular_velocity: (0, 0, 0),
        frame.rotation: np.eye(3),
    }
    run = ac.build(scene).simulate(3.0, start, rtol=rtol)
    assert run[frame.angular_velocity][-1, 2] == pytest.approx(80.0, rel=10 * rtol)


@pytest.mark.parametrize("slips", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_ball_that_strikes_the_floor_askew_slips_or_rolls_off(seed: int, slips: bool) -> None:
    """Impulses (1 + e) m u along the normal, and across it mu times that, or what ends the slip."""
    of = Drawn(seed)
    m, r, e, part, Q = of.M, of.L * of.within(0.1, 1), of.within(0, 1), of.within(0.2, 0.6), of.turn()
    velocity, spin = of.speed * of.rng.normal(size=3), of.rng.normal(size=3) * of.speed / r
    velocity[2] = -abs(velocity[2])
    slip = (velocity + np.cross(spin, [0, 0, -r])) * [1, 1, 0]
    push, ends = (1 + e) * m * -velocity[2], m * np.linalg.norm(slip) / (1 + 1 / part)
    mu = ends / push * (of.within(0.1, 0.99) if slips else of.within(1.01, 5))
    scene = ac.System()
    scene.world, scene.ball = World(None), RigidBody(m, (part * m * r * r,) * 3)
    scene.floor = Contact(Sphere(r), Plane(), Hard(e, Coulomb(mu)))
    scene.connect(scene.world.at((0, 0, 0), rotation=Q), scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    frame, falls = scene.ball.frame, r / -velocity[2]
    start = {
        frame.position: Q @ (0, 0, 2 * r),
        frame.velocity: Q @ velocity,
        frame.angular_velocity: Q @ spin,
        frame.rotation: np.eye(3),
    }
    run = ac.build(scene).simulate(2 * falls, start, rtol=1e-12)
    assert times(run) == pytest.approx([falls], rel=INSTANT)
    drag = -slip / np.linalg.norm(slip) * min(mu * push, ends)
    fast, turns = np.linalg.norm(velocity) + np.linalg.norm(spin) * r, np.cross([0, 0, -r], drag) / (part * m * r * r)
    assert run[frame.velocity][-1] @ Q == pytest.approx(velocity + (drag + np.array([0, 0, push])) / m, abs=STATE * fast)
    assert run[frame.angular_velocity][-1] @ Q == pytest.approx(spin + turns, abs=STATE * fast / r)


@pytest.mark.parametrize("slips", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_two_rough_balls_that_collide_askew_exchange_spin(seed: int, slips: bool) -> None:
    """Both spin: impulses (1 + e) times the reduced mass along the line of centres, and across it mu times that, or what ends the slip."""
    of = Drawn(seed)
    r, m, part = of.L * of.rng.uniform(0.1, 1, 2), of.M * 10 ** of.rng.uniform(-1, 1, 2), of.rng.uniform(0.2, 0.6, 2)
    e, Q = of.within(0, 1), of.turn()
    inertia = part * m * r * r
    normal, v, w = Q[:, 0], of.speed * of.rng.normal(size=(2, 3)), of.speed / of.L * of.rng.normal(size=(2, 3))
    v[0] += (2 * of.speed - normal @ (v[0] - v[1])) * normal
    slip = v[1] - v[0] + np.cross(w[1], -r[1] * normal) - np.cross(w[0], r[0] * normal)
    slip -= normal @ slip * normal
    push = (1 + e) * 2 * of.speed / np.sum(1 / m)
    ends = np.linalg.norm(slip) / np.sum(1 / m + r * r / inertia)
    mu = ends / push * (of.within(0.1, 0.99) if slips else of.within(1.01, 5))
    scene = ac.System()
    scene.world, scene.pair = World(None), Contact(Sphere(r[1]), Sphere(r[0]), Hard(e, Coulomb(mu)))
    balls = [RigidBody(float(mass), (float(own),) * 3) for mass, own in zip(m, inertia, strict=True)]
    scene.balls = [balls[k] for k in of.order(2)]
    a, b = (ball.frame for ball in balls)
    scene.connect(a, scene.pair.frame_a)
    scene.connect(scene.pair.frame_b, b)
    start = {b.position: (0, 0, 0), a.position: -np.sum(r) * normal - of.T * (v[0] - v[1])}
    start |= {a.velocity: v[0], b.velocity: v[1], a.angular_velocity: w[0], b.angular_velocity: w[1]}
    run = ac.build(scene).simulate(2 * of.T, start | {a.rotation: np.eye(3), b.rotation: np.eye(3)}, rtol=1e-12)
    assert times(run) == pytest.approx([of.T], rel=INSTANT)
    impulse = push * normal - slip / np.linalg.norm(slip) * min(mu * push, ends)  # on b
    fast = np.max(np.abs(v)) + np.max(np.abs(w)) * np.max(r)
    more = STATE * fast * max(1, m[0] / m[1], m[1] / m[0])
    assert run[b.velocity][-1] == pytest.approx(v[1] + impulse / m[1], abs=more)
    assert run[a.velocity][-1] == pytest.approx(v[0] - impulse / m[0], abs=more)
    assert run[b.angular_velocity][-1] == pytest.approx(w[1] + np.cross(-r[1] * normal, impulse) / inertia[1], abs=more / min(r))
    assert run[a.angular_velocity][-1] == pytest.approx(w[0] + np.cross(r[0] * normal, -impulse) / inertia[0], abs=more / min(r))


@pytest.mark.parametrize("slips", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_ball_let_go_on_an_incline_rolls_or_slips(seed: int, slips: bool) -> None:
    """It rolls with g sin / (1 + c) where mu >= c / (1 + c) tan, of an inertia c m r^2, else it slips from the first instant."""
    of = Drawn(seed)
    slope, c, r, m, g, Q = of.within(0.1, 1.2), of.within(0.2, 0.66), of.L * of.within(0.1, 1), of.M, of.g, of.turn()
    mu = c / (1 + c) * np.tan(slope) * (of.within(0.1, 0.999) if slips else of.within(1.001, 5))
    scene = ac.System()
    scene.world, scene.ball = World(tuple(Q @ (g * np.sin(slope), 0, -g * np.cos(slope)))), RigidBody(m, (c * m * r * r,) * 3)
    scene.floor = Contact(Sphere(r), Plane(), Hard(friction=Coulomb(mu)))
    scene.connect(scene.world.at((0, 0, 0), rotation=Q), scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    frame, end = scene.ball.frame, of.T
    start = {
        frame.position: Q @ (0, 0, r),
        frame.velocity: (0, 0, 0),
        frame.angular_velocity: (0, 0, 0),
        frame.rotation: np.eye(3),
    }
    run = ac.build(scene).simulate(end, start, rtol=1e-12)
    pull, rub = g * np.sin(slope), mu * g * np.cos(slope)
    along, turning = (pull - rub, rub / (c * r)) if slips else (pull / (1 + c), pull / (1 + c) / r)
    assert run[frame.velocity][-1] @ Q == pytest.approx([end * along, 0, 0], abs=STATE * end * pull)
    assert run[frame.position][-1] @ Q == pytest.approx([end**2 / 2 * along, 0, r], abs=STATE * (end**2 * pull + r))
    assert run[frame.angular_velocity][-1] @ Q == pytest.approx([0, end * turning, 0], abs=STATE * end * (turning + pull / r))


def over(f: Callable[[np.ndarray], np.ndarray], low: float, high: float) -> float:
    """The integral of what is smooth."""
    x, weights = np.polynomial.legendre.leggauss(60)
    return float((high - low) / 2 * weights @ f(low + (high - low) * (1 + x) / 2))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_ball_that_rolls_over_a_sphere_begins_to_slip_before_it_leaves(seed: int) -> None:
    """m v^2 / R = m g cos - N, and rolling needs 2/7 m g sin = mu N, with v^2 = v0^2 + 10/7 g R (1 - cos); then (v^2)' = 2 R (g sin - mu N / m), linear in v^2."""
    of = Drawn(seed)
    g, r, table, mu, Q, place = (
        of.g,
        of.L * of.within(0.05, 0.3),
        of.L * of.within(0.7, 2),
        of.within(0.2, 2),
        of.turn(),
        of.place(),
    )
    R = r + table
    v = np.sqrt(g * R) * of.within(0.1, 0.4)

    def rolling(a: np.ndarray | float) -> np.ndarray:
        return v**2 + 20 / 7 * g * R * np.sin(a / 2) ** 2

    slips = brentq(lambda a: mu * (g * np.cos(a) - rolling(a) / R) - 2 / 7 * g * np.sin(a), 0, 1.2, xtol=1e-15, rtol=1e-15)
    p = (4 * mu**2 - 2) / (1 + 4 * mu**2) * R * g
    q = 2 * mu * (p - R * g)
    free = rolling(slips) - p * np.cos(slips) - q * np.sin(slips)

    def sliding(a: np.ndarray | float) -> np.ndarray:
        return free * np.exp(2 * mu * (a - slips)) + p * np.cos(a) + q * np.sin(a)

    leaves = brentq(lambda a: g * np.cos(a) - sliding(a) / R, slips, 1.5, xtol=1e-15, rtol=1e-15)
    begins = over(lambda a: R / np.sqrt(rolling(a)), 0, slips)
    opens = begins + over(lambda a: R / np.sqrt(sliding(a)), slips, leaves)
    spun = np.sqrt(rolling(slips)) + 2.5 * mu * over(
        lambda a: (g * np.cos(a) * R - sliding(a)) / np.sqrt(sliding(a)), slips, leaves
    )
    scene = ac.System()
    scene.world, scene.ball = World(tuple(-g * Q[:, 2])), RigidBody.ball(of.M, r)
    scene.table = Contact(Sphere(r), Sphere(table), Hard(friction=Coulomb(mu)))
    scene.connect(scene.world.at(tuple(place)), scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.ball.frame)
    f = scene.ball.frame
    start = {f.position: place + R * Q[:, 2], f.velocity: v * Q[:, 0], f.rotation: Q, f.angular_velocity: v / r * Q[:, 1]}
    run = ac.build(scene).simulate(1.1 * opens, start, rtol=1e-12, samples=2)
    assert [t.changes[0].new for t in run.transitions] == ["slides", "open"]
    assert [t.time for t in run.transitions] == pytest.approx([begins, opens], rel=INSTANT)
    fast, left = np.sqrt(sliding(leaves)) * np.array([np.cos(leaves), 0, -np.sin(leaves)]), 0.1 * opens
    at, down = R * np.array([np.sin(leaves), 0, np.cos(leaves)]), np.array([0, 0, -g])
    assert (run[f.position][-1] - place) @ Q / R == pytest.approx((at + fast * left + down * left**2 / 2) / R, abs=STATE)
    assert run[f.velocity][-1] @ Q / spun == pytest.approx((fast + down * left) / spun, abs=STATE)
    assert run[f.angular_velocity][-1] @ Q * r / spun == pytest.approx([0, 1, 0], abs=STATE)


def test_a_box_on_four_feet_with_more_friction_at_rest_comes_to_rest() -> None:
    scene = ac.System()
    scene.world, scene.box = World(), RigidBody.box(mass=2.0, size=(0.4, 0.3, 0.2))
    scene.feet = [PointOnPlane(unilateral=True, restitution=0.3, friction=Coulomb(0.3, static=0.4)) for _ in range(4)]
    for foot, x, y in zip(scene.feet, (0.2, 0.2, -0.2, -0.2), (0.15, -0.15, 0.15, -0.15), strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x, y, -0.1)))
    frame = scene.box.frame
    start = {frame.position: (0, 0, 0.3), frame.velocity: (1, 0, 0), frame.angular_velocity: (0.5, 0.2, 1)}
    run = ac.build(scene).simulate(1.0, start, rtol=1e-10)
    assert run.transitions[-1].changes[0].new == "sticks"
    assert np.all(np.abs(run[frame.velocity][-1]) < 1e-12)
    assert sum(run[foot.normal_force][-1] for foot in scene.feet) == pytest.approx(2 * G, rel=1e-10)
    assert run.energy_error() < 1e-7  # bridged impacts have no line of their own


@pytest.mark.parametrize("restitution", [0.0, 0.3])
def test_a_dropped_box_comes_to_rest_in_the_same_place_in_every_order_of_its_feet(restitution: float) -> None:
    """Four feet strike together, and slide while what each of them carries is not unique."""
    corners = np.array([(0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15)])
    found: list[np.ndarray] = []
    for size, order in ((1.0, (0, 1, 2, 3)), (1e-3, (2, 0, 3, 1))):
        scene = ac.System()
        scene.world, scene.box = World((0, 0, -G * size)), RigidBody.box(2.0, (0.4 * size, 0.3 * size, 0.2 * size))
        scene.feet = [PointOnPlane(unilateral=True, restitution=restitution, friction=Coulomb(0.4)) for _ in order]
        for foot, (x, y) in zip(scene.feet, corners[list(order)], strict=True):
            scene.connect(scene.world.frame, foot.frame_a)
            scene.connect(foot.frame_b, scene.box.at((x * size, y * size, -0.1 * size)))
        frame = scene.box.frame
        start = {frame.position: (0, 0, 0.6 * size), frame.velocity: (size, 0.3 * size, 0), frame.angular_velocity: (1, 2, 0.5)}
        run = ac.build(scene).simulate(0.8, start, rtol=1e-12, compiled=False)
        assert np.all(np.abs(run[frame.velocity][-1]) < 1e-12 * size)
        found.append(np.concatenate([run[frame.position][-1] / size, run[frame.rotation][-1].ravel()]))
    assert found[0][2] == pytest.approx(0.1, abs=1e-12)
    assert found[1] == pytest.approx(found[0], abs=1e-11)


@each_value(("kind", ["point", "ball", "rope", "stop"]), (("shift", "start"), [(0.0, 0.0), (1.0, 0.7), (1e3, 0.0), (1e6, 0.3)]))
def test_what_is_put_where_it_touches_rests_there_however_far_away(kind: str, shift: float, start: float) -> None:
    """Places whose difference is a number are rounded too: 0.3 - 0.1 - 0.2 is no overlap, nor is what is left of it at 1e6 m."""
    R, o = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix(), shift * np.array([0.3, -0.7, 0.6])
    scene = ac.System()
    scene.world, scene.slide, scene.box = World(tuple(R @ (0, 0, -9.81))), Prismatic("z"), RigidBody.box(1.0, (0.1, 0.1, 0.1))

    def there(height: float) -> ac.Frame:
        return scene.world.at(tuple(o + R @ (0, 0, height)), rotation=R)

    scene.connect(there(0.3 - start), scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.box.frame)
    if kind == "stop":
        scene.held = EndStop(scene.slide.flange, lower=start + 0.3 - 0.1 - 0.2)
    else:
        scene.held = {
            "point": lambda: PointOnPlane(unilateral=True),
            "ball": lambda: Contact(Sphere(0.2), Plane(), Hard(0.5)),
            "rope": lambda: Rope(0.2),
        }[kind]()
        scene.connect(there(0.5 if kind == "rope" else 0.1), scene.held.frame_a)
        scene.connect(scene.held.frame_b, scene.box.at((0, 0, -0.2)) if kind == "point" else scene.box.frame)
    run = ac.build(scene).simulate(0.3, {scene.slide.q: start, scene.slide.v: 0.0})
    assert run[scene.slide.q] == pytest.approx(start, abs=1e-8)
    assert len(run.transitions) == 0 or run.transitions[-1].time < 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_a_box_that_is_pushed_harder_and_harder_slides_or_tips_and_nothing_else_is_told(seed: int) -> None:
    """By F = k t at a height y above its middle: slides where F = static m g, tips about an edge where F (y + h) = m g b."""
    draw = np.random.default_rng([seed, 3])
    h, m, g = (10 ** draw.uniform(-3, 3) for _ in range(3))
    b, y, mu, side = h * draw.uniform(0.2, 2), h * draw.uniform(-0.8, 3), draw.uniform(0.05, 2), draw.choice([-1, 1])
    static, ramp = mu * draw.uniform(1, 1.3), m * g / np.sqrt(h / g)
    scene = ac.System()
    scene.world, scene.x, scene.z, scene.turn = World((0, 0, -g)), Prismatic("x"), Prismatic("z"), Revolute("y")
    scene.box, scene.push = RigidBody(m, (m * (b**2 + h**2) / 3,) * 3), Force((side * ramp * ac.time, 0.0, 0.0))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu, static=static)) for _ in range(2)]
    scene.connect(scene.world.frame, scene.x.frame_a)
    scene.connect(scene.x.frame_b, scene.z.frame_a)
    scene.connect(scene.z.frame_b, scene.turn.frame_a)
    scene.connect(scene.turn.frame_b, scene.box.frame)
    for foot, x in zip(scene.feet, (-b, b), strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x, 0, -h)))
    scene.connect(scene.box.at((0, 0, y)), scene.push.point)
    slides, tips = static * m * g / ramp, m * g * b / (y + h) / ramp
    run = ac.build(scene).simulate(1.01 * min(slides, tips), {scene.z.q: h}, rtol=1e-12)
    assert run.transitions[0].time == pytest.approx(min(slides, tips), rel=INSTANT)
    assert all(transition.changes for transition in run.transitions)
    told = {change.new for change in run.transitions[0].changes}
    assert {word.split()[0] for word in told} == ({"slides"} if slides < tips else {"open", "off"})


@each_value(("size", [1.0, 1e-4, 1e5]), ("restitution", [0.3, 0.6]))
def test_bounces_without_end_on_what_moves_have_the_work_of_its_drive(size: float, restitution: float) -> None:
    """A table goes up and down under a particle that comes to rest on it: also while its bounces are bridged it is borne."""
    scene = ac.System()
    scene.world, scene.mass, scene.plate = World((0, 0, -G * size)), Particle(0.1), RigidBody(1.0, (size**2,) * 3)
    scene.drive = PrescribedMotion(position=(0, 0, 0.01 * size * np.sin(20 * ac.time)))
    scene.floor = PointOnPlane(unilateral=True, restitution=restitution)
    for a, part, b in (
        (scene.world.frame, scene.drive, scene.plate.frame),
        (scene.plate.frame, scene.floor, scene.mass.point),
    ):
        scene.connect(a, part.frame_a)
        scene.connect(part.frame_b, b)
    p = scene.mass.point
    run = ac.build(scene).simulate(2.0, {p.position: (0, 0, 0.1 * size), p.velocity: (0, 0, 0)}, rtol=1e-9)
    assert "open -> closed" in str(run.transitions[-1]) and run.energy_error() < 1e-12


TRIPOD = ((1.0, 0.0), (-0.5, 0.8), (-0.5, -0.8))


def test_what_is_put_where_it_touches_strikes_nothing_at_the_start() -> None:
    """Three smooth feet that glide and spin on a plane turned at random: what they go down with is rounding."""
    draw = np.random.default_rng(8)
    Q = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    Q *= np.linalg.det(Q)
    scene = ac.System()
    scene.world, scene.stool = World(tuple(Q @ (0, 0, -G))), RigidBody(2.0, (0.1, 0.1, 0.2))
    scene.feet = [PointOnPlane(unilateral=True) for _ in TRIPOD]
    for foot, (x, y) in zip(scene.feet, TRIPOD, strict=True):
        scene.connect(scene.world.at((0, 0, 0), rotation=Q), foot.frame_a)
        scene.connect(foot.frame_b, scene.stool.at((x, y, -0.3)))
    frame, v, w = scene.stool.frame, Q @ (0.7, -0.2, 0), Q @ (0, 0, 5.0)
    start = {frame.position: Q @ (0, 0, 0.3), frame.rotation: Q, frame.velocity: v, frame.angular_velocity: w}
    run = ac.build(scene).simulate(1.0, start, rtol=1e-12)
    assert len(run.transitions) == 0
    assert run[frame.position][-1] == pytest.approx(v + Q @ (0, 0, 0.3), abs=STATE)
    assert run[frame.angular_velocity][-1] == pytest.approx(w, abs=STATE)


def test_a_stool_that_has_stopped_stands_on_all_of_its_feet() -> None:
    """It glides straight on, light at its feet: two of them hold it, and where it stands nothing rubs any more."""
    draw = np.random.default_rng(2)
    Q = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    Q *= np.linalg.det(Q)
    scene, mu = ac.System(), 0.2
    scene.world, scene.stool = World(tuple(Q @ (0, 0, -G))), RigidBody(1.0, (0.02,) * 3)
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in TRIPOD]
    for foot, (x, y) in zip(scene.feet, TRIPOD, strict=True):
        scene.connect(scene.world.at((0, 0, 0), rotation=Q), foot.frame_a)
        scene.connect(foot.frame_b, scene.stool.at((x, y, 0)))
    frame, model = scene.stool.frame, ac.build(scene)
    for _ in range(4):
        v = draw.normal(size=2)
        stop = np.linalg.norm(v) / (mu * G)
        start = {frame.rotation: Q, frame.velocity: Q @ (*v, 0), frame.angular_velocity: (0, 0, 0), frame.position: (0, 0, 0)}
        run = model.simulate(1.2 * stop, start, rtol=1e-12)
        assert [change.time for change in run.transitions] == pytest.approx([stop] * len(run.transitions), rel=1e-8)
        assert Q.T @ run[frame.position][-1] == pytest.approx(np.array([*v, 0]) * stop / 2, abs=STATE)
        assert {run.modes(foot).words[-1] for foot in scene.feet} == {"closed, sticks"}
        assert np.max(np.abs([run[foot.friction_force][-1] for foot in scene.feet])) < 1e-9


def test_a_light_plank_and_what_it_carries_stop_together() -> None:
    """Feet far apart, light: as it stops rounding turns it, faster and faster, which what stands on it with small feet can hardly hold."""
    draw = np.random.default_rng(3)
    length, mass, load, g, mu, above = (
        10 ** draw.uniform(*of) for of in ((-3, 3), (-2, 2), (-2, 2), (-1, 2), (-2, 0.2), (-2, 0.2))
    )
    Q = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    Q *= np.linalg.det(Q)
    first = draw.normal() * np.sqrt(g * length)
    second = 0.6104222365598851 * first
    # the load slips on the plank until both are as fast, then they stop with mu g
    side = np.sign(second - first)
    by = above * load * g * side - mu * (mass + load) * g * np.sign(first)
    together = (second - first) / (by / mass + above * g * side)
    speed = first + by / mass * together
    stop = abs(speed) / (mu * g)
    path = first * together + by / mass * together**2 / 2 + speed * stop / 2
    wide = 10 * max(abs(path), length)
    scene = ac.System()
    scene.world = World(tuple(Q @ (0, 0, -g)))
    scene.plank, scene.load = RigidBody(mass, (mass * wide**2 / 4,) * 3), RigidBody(load, (load * length**2,) * 3)
    scene.low, scene.high = ([PointOnPlane(unilateral=True, friction=Coulomb(k)) for _ in TRIPOD] for k in (mu, above))
    for foot, (x, y) in zip(scene.low, TRIPOD, strict=True):
        scene.connect(scene.world.at((0, 0, 0), rotation=Q), foot.frame_a)
        scene.connect(foot.frame_b, scene.plank.at((x * wide, y * wide, 0)))
    for foot, (x, y) in zip(scene.high, TRIPOD, strict=True):
        scene.connect(scene.plank.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.load.at((x * length, y * length, 0)))
    start = {}
    for body, along in ((scene.plank, first), (scene.load, second)):
        frame = body.frame
        start |= {
            frame.position: (0, 0, 0),
            frame.rotation: Q,
            frame.velocity: Q @ (along, 0, 0),
            frame.angular_velocity: (0, 0, 0),
        }
    run = ac.build(scene).simulate(1.2 * (together + stop), start, rtol=1e-12)
    assert np.sign(speed) == np.sign(first) and above > mu
    assert run.transitions[0].time == pytest.approx(together, rel=INSTANT)
    assert list(run.transitions)[-1].time == pytest.approx(together + stop, rel=1e-6)
    assert Q.T @ run[scene.plank.frame.position][-1] == pytest.approx([path, 0, 0], abs=STATE * abs(path))
    assert {run.modes(foot).words[-1] for foot in (*scene.low, *scene.high)} == {"closed, sticks"}
    for body in (scene.plank, scene.load):
        assert np.linalg.norm(run[body.frame.velocity][-1]) < 1e-12 * abs(speed)


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
def test_ladder_put_against_its_wall_begins_closed_there_and_so_it_does_where_a_motion_goes_on(length: float) -> None:
    rng, scene = np.random.default_rng(8), ac.System()
    scene.world, scene.plane, scene.rod = World(), Planar("y"), RigidBody.rod(3.0, (0, 0, length), radius=1e-6 * length)
    scene.floor, scene.wall = PointOnPlane(unilateral=True), PointOnPlane(unilateral=True)
    scene.connect(scene.world.frame, scene.plane.frame_a, scene.floor.frame_a)
    scene.connect(scene.plane.frame_b, scene.rod.frame, scene.floor.frame_b)
    scene.connect(scene.world.at((0, 0, 0), rotation=("y", np.pi / 2)), scene.wall.frame_a)
    scene.connect(scene.wall.frame_b, scene.rod.tip)
    model = ac.build(scene)
    for lean in rng.uniform(0.05, 0.6, 8):
        start = {scene.rod.frame.position: (length * np.sin(lean), 0, 0), scene.rod.tip.position: (0, 0, length * np.cos(lean))}
        run = model.simulate(3 * np.sqrt(length), start)
        assert abs(run.transitions[0].before[scene.rod.tip.position][2] - 2 / 3 * length * np.cos(lean)) < 1e-10 * length
        for part in rng.uniform(0.1, 0.9, 2):
            x = run.at([part * run.t[-1]]).x[:, -1]
            on = model.simulate((1 - part) * run.t[-1], dict(zip(model.state_names, x, strict=True)))
            assert np.allclose(on.x[:, -1], run.x[:, -1], atol=1e-7 * length)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_spinning_coin_bounces_to_rest_on_its_edge_however_long_it_is_watched(size: float) -> None:
    """Long after a bounce so low that its gap is a rounding steps are as long as the next rise: what has just been let go ends none of them."""
    r, e, mu = 0.012 * size, 0.2, 0.3
    scene = ac.System()
    scene.world, scene.coin, scene.contact = (
        World(),
        RigidBody.disk(0.01, r, axis="z"),
        Contact(Disk(r), Plane(), Hard(e, Coulomb(mu))),
    )
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.coin.frame)
    model, frame, time = ac.build(scene), scene.coin.frame, np.sqrt(size)
    start = {frame.rotation: ("x", 1.2), frame.position: (0, 0, 5 / 3 * r), frame.angular_velocity: (0, 0, 30 / time)}
    for watched in (0.3, 1.0):
        run = model.simulate(watched * time, start)
        assert run.energy_error() < 1e-8 and run[scene.contact.gap].min() > -1e-12 * r
        push, rub = run[scene.contact.normal_force].ravel(), np.linalg.norm(run[scene.contact.friction_force], axis=1)
        assert push.min() >= 0 and (rub - mu * push).max() < 1e-9 * push.max()
        weight = 0.01 * run[frame.acceleration + np.array([0, 0, 9.81])]
        assert np.abs(weight - run[scene.contact.friction_force] - push[:, None] * np.array([0, 0, 1])).max() < 1e-9 * push.max()


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_pin_turns_a_geneva_wheel_between_the_walls_of_its_slot(size: float) -> None:
    """Both walls are on one wheel and one driven pin: loops that are redundant. Where a wall is touched the wheel's angle is that of the pin, beside by half a slot."""
    a, half, rate = 0.1 * size, 1e-3 * size, 2.0
    middle, slot = a * np.sqrt(2), 1.25 * np.pi
    scene = ac.System()
    scene.world, scene.drive = World(gravity=None), PrescribedMotion(angle=rate * ac.time - 0.2 - np.pi / 4)
    scene.pin, scene.hinge, scene.wheel = RigidBody.ball(0.01, 0.01 * size), Revolute("z"), RigidBody.ball(1.0, 0.1 * size)
    scene.connect(scene.world.frame, scene.drive.frame_a)
    scene.connect(scene.drive.frame_b, scene.pin.frame)
    scene.connect(scene.world.at((middle, 0, 0)), scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.wheel.frame)
    along, aside = np.array([np.cos(slot), np.sin(slot), 0]), np.array([-np.sin(slot), np.cos(slot), 0])
    scene.walls = []
    for side in (1, -1):
        wall = ParametricCurve(lambda u, side=side: ca.DM(along) * u + ca.DM(side * half * aside), (0.2 * a, a), "m")
        scene.walls.append(PointOnCurve(wall, unilateral=True, side="z" if side > 0 else "-z"))
        scene.connect(scene.wheel.frame, scene.walls[-1].frame_a)
        scene.connect(scene.walls[-1].frame_b, scene.pin.at((a, 0, 0)))
    run = ac.build(scene).simulate((np.pi / 2 + 0.5) / rate, {scene.hinge.q: 0.0, scene.hinge.v: 0.0})
    pin = run[scene.pin.at((a, 0, 0)).position][:, :2] - (middle, 0)
    beside = np.unwrap(np.arctan2(pin[:, 1], pin[:, 0])) % (2 * np.pi) - slot - run[scene.hinge.q].ravel()
    play = np.arcsin(half / np.linalg.norm(pin, axis=1))
    for wall, side in zip(scene.walls, (1, -1), strict=True):
        held = run[wall.normal_force].ravel() > 0
        assert held.sum() > 50 and np.abs(beside - side * play)[held].max() < 1e-9
    inside = np.linalg.norm(pin, axis=1) < a
    assert (np.abs(beside) - play)[inside].max() < 1e-9 and run.energy_error() < 1e-9
