"""Scenes whose modes change, each with what is known of it: the values that are compared, in closed form, at the end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import quad, solve_ivp

import acausal as ac
from components import (
    CartesianTranslation,
    Clutch,
    Contact,
    Coulomb,
    Cylinder,
    EndStop,
    ForceSource,
    Hard,
    Particle,
    Planar,
    Plane,
    PointOnPlane,
    PointOnSurface,
    RigidBody,
    SlidingMass,
    Sphere,
    TranslationalGround,
    TranslationalSpring,
    VelocitySource,
    World,
)

G = 9.81
BOUNCES, RESTITUTION = 10_000, 0.9999
STIFFNESS, SLIDING, HOLDING, BELT, CYCLES = 4.0, 2.0, 3.0, 0.5, 1000
SLOPE, ROUGH, SPEED = 0.4, 0.6, (1.0, -1.0)
BALL, MU, THROWN = 0.1, 0.2, 2.0
HALF_WIDTH, HALF_HEIGHT, TILT = 0.1, 0.3, 0.2


@dataclass(frozen=True, eq=False)
class ModeScene:
    """`make()`: system, start, and an expression whose last values are compared with `reference`; `end` [s]; `kind`: what the error means."""

    name: str
    title: str
    end: float
    kind: str
    make: Callable[[], tuple[ac.System, dict[Any, Any], Any]]
    reference: np.ndarray


def _on(scene: ac.System, a: Any, part: Any, b: Any) -> None:
    scene.connect(a, part.frame_a)
    scene.connect(part.frame_b, b)


def _bounce() -> tuple[ac.System, dict[Any, Any], Any]:
    scene = ac.System()
    scene.mass, scene.ground, scene.weight = SlidingMass(1.0), TranslationalGround(), ForceSource(-G)
    scene.stop = EndStop(scene.mass.flange_a, lower=0.0, restitution=RESTITUTION)
    scene.connect(scene.mass.flange_b, scene.weight.flange)
    return scene, {scene.mass.s: 1.0, scene.mass.v: 0.0}, scene.mass.s


def _bounce_end() -> tuple[float, float]:
    """A third of the flight after the last bounce, and the height there."""
    fall, e = math.sqrt(2 / G), RESTITUTION
    flights = [2 * fall * e**k for k in range(1, BOUNCES + 1)]
    last = flights[-1]
    up = last / 3
    return math.fsum([fall, *flights[:-1], up]), G / 2 * up * (last - up)


def _belt() -> tuple[ac.System, dict[Any, Any], Any]:
    scene = ac.System()
    scene.mass, scene.spring, scene.wall = SlidingMass(1.0), TranslationalSpring(STIFFNESS), TranslationalGround()
    scene.belt = VelocitySource(BELT)
    scene.rub = Clutch(scene.belt.flange, scene.mass.flange_a, capacity=SLIDING, holding=HOLDING)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.mass.flange_b)
    return scene, {scene.mass.s: 0.0, scene.mass.v: BELT, scene.belt.flange.s: 0.0}, scene.mass.s


def _belt_end() -> tuple[float, float]:
    """In the middle of a stretch that sticks, after so many cycles."""
    omega, ahead = math.sqrt(STIFFNESS), (HOLDING - SLIDING) / STIFFNESS
    period = 2 * (math.pi - math.atan(omega * ahead / BELT)) / omega + 2 * ahead / BELT
    return HOLDING / STIFFNESS / BELT + CYCLES * period - 0.5 * ahead / BELT, HOLDING / STIFFNESS - 0.5 * ahead


def _incline() -> tuple[ac.System, dict[Any, Any], Any]:
    scene = ac.System()
    scene.world, scene.mass = World((G * math.sin(SLOPE), 0, -G * math.cos(SLOPE))), Particle(1.0)
    scene.guide = PointOnPlane(unilateral=True, friction=Coulomb(ROUGH))
    _on(scene, scene.world.frame, scene.guide, scene.mass.point)
    p = scene.mass.point
    return scene, {p.position: (0, 0, 0), p.velocity: (*SPEED, 0)}, p.position


def _incline_end() -> np.ndarray:
    """At the angle a to the fall line the speed is C tan(a/2)^k / sin a, k = mu / tan(slope); place by quadrature."""
    k, pull = ROUGH / math.tan(SLOPE), G * math.sin(SLOPE)
    first = math.atan2(-SPEED[1], SPEED[0])
    shape = lambda a: math.tan(a / 2) ** k / math.sin(a)  # noqa: E731
    scale = math.hypot(*SPEED) / shape(first)
    power = 12  # a = first w^12: smooth at the end
    x, y = (
        quad(
            lambda w, f=f: (scale * shape(first * w**power)) ** 2 * f(first * w**power) / pull * first * power * w ** (power - 1),
            0, 1, epsabs=0, epsrel=3e-14, limit=200,
        )[0]
        for f in (lambda a: math.cos(a) / math.sin(a), lambda a: 1.0)
    )  # fmt: skip
    return np.array([x, -y, 0.0])


def _roll() -> tuple[ac.System, dict[Any, Any], Any]:
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(0.7, BALL)
    scene.floor = Contact(Sphere(BALL), Plane(), Hard(friction=Coulomb(MU)))
    _on(scene, scene.world.frame, scene.floor, scene.ball.frame)
    frame = scene.ball.frame
    start = {
        frame.position: (0, 0, BALL), frame.velocity: (0.6 * THROWN, 0.8 * THROWN, 0), frame.angular_velocity: (0, 0, 0), frame.rotation: np.eye(3),
    }  # fmt: skip
    return scene, start, frame.position


def _roll_end(end: float) -> np.ndarray:
    rolls = 2 * THROWN / (7 * MU * G)
    far = THROWN * rolls - MU * G / 2 * rolls**2 + 5 / 7 * THROWN * (end - rolls)
    return np.array([0.6 * far, 0.8 * far, BALL])


def _rock() -> tuple[ac.System, dict[Any, Any], Any]:
    scene = ac.System()
    scene.world, scene.box, scene.plane = World(), RigidBody.box(2.0, (2 * HALF_WIDTH, 0.1, 2 * HALF_HEIGHT)), Planar("y")
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(2.0)) for _ in range(2)]
    _on(scene, scene.world.frame, scene.plane, scene.box.frame)
    for foot, x in zip(scene.feet, (HALF_WIDTH, -HALF_WIDTH), strict=True):
        _on(scene, scene.world.frame, foot, scene.box.at((x, 0, -HALF_HEIGHT)))
    lifted = HALF_WIDTH * math.sin(TILT) + HALF_HEIGHT * math.cos(TILT)
    return scene, {scene.plane.q: (lifted, 0, TILT)}, scene.plane.q[2:]


def rocking_rates(angle: float, mass: float = 2.0) -> float:
    """Housner's: angular acceleration of a block that rocks about the edge towards which it leans."""
    inertia = mass * ((2 * HALF_WIDTH) ** 2 + (2 * HALF_HEIGHT) ** 2) / 12 + mass * (HALF_WIDTH**2 + HALF_HEIGHT**2)
    side = math.copysign(1, angle)
    return mass * G * (HALF_HEIGHT * math.sin(angle) - side * HALF_WIDTH * math.cos(angle)) / inertia


def rocking_factor() -> float:
    """What is left of the angular velocity when the other edge strikes."""
    a, b = HALF_WIDTH, HALF_HEIGHT
    about = (a * a + b * b) / 3 + a * a + b * b
    return ((a * a + b * b) / 3 + b * b - a * a) / about


def restarted_rocking(end: float, method: str, rtol: float) -> float:
    """The angle at the end, by SciPy, begun anew at each impact."""
    t, y = 0.0, np.array([TILT, 0.0])
    while t < end:
        side = math.copysign(1, y[0] if y[0] else y[1])
        struck = lambda t, y: y[0]  # noqa: E731
        struck.terminal, struck.direction = True, -side  # pyright: ignore[reportFunctionMemberAccess]
        rates = lambda t, y, side=side: (y[1], rocking_rates(math.copysign(y[0], side) if y[0] else side * 1e-300))  # noqa: E731
        run = solve_ivp(rates, (t, end), y, method=method, rtol=rtol, atol=1e-2 * rtol, events=struck)
        t, y = run.t[-1], run.y[:, -1]
        if run.status == 1:
            y = np.array([-side * 1e-300, rocking_factor() * y[1]])
    return float(y[0])


def _falling_box() -> tuple[ac.System, dict[Any, Any], Any]:
    scene = ac.System()
    scene.world, scene.box = World(), RigidBody.box(mass=2.0, size=(0.4, 0.3, 0.2))
    scene.feet = [PointOnPlane(unilateral=True, restitution=0.3, friction=Coulomb(0.3)) for _ in range(4)]
    for foot, x, y in zip(scene.feet, (0.2, 0.2, -0.2, -0.2), (0.15, -0.15, 0.15, -0.15), strict=True):
        _on(scene, scene.world.frame, foot, scene.box.at((x, y, -0.1)))
    frame = scene.box.frame
    start = {frame.position: (0, 0, 0.3), frame.velocity: (1, 0, 0), frame.angular_velocity: (0.5, 0.2, 1)}
    return scene, start, frame.velocity


def scenes() -> tuple[ModeScene, ...]:
    """References are computed when they are asked for."""
    bounce, height = _bounce_end()
    belt, place = _belt_end()
    rocks = 1.5
    return (
        ModeScene(
            "bounce", f"ball, {BOUNCES} bounces, restitution {RESTITUTION}", bounce, "height [m]", _bounce, np.array([height])
        ),
        ModeScene("belt", f"block on a belt, {CYCLES} cycles of stick and slip", belt, "place [m]", _belt, np.array([place])),
        ModeScene(
            "incline", "particle thrown across an incline, stops and stays", 3.0, "place of rest [m]", _incline, _incline_end()
        ),
        ModeScene("roll", "ball that slips, then rolls", 2.0, "place [m]", _roll, _roll_end(2.0)),
        ModeScene("rock", "rocking block", rocks, "angle [rad]", _rock, np.array([restarted_rocking(rocks, "DOP853", 3e-14)])),
        ModeScene("box", "box dropped on four feet, to rest", 1.0, "speed that is left [m/s]", _falling_box, np.zeros(3)),
    )


def hovering(contacts: int) -> tuple[ac.System, dict[Any, Any]]:
    """A spinning box in free flight high above a floor, on a spring, with so many corners that could touch it."""
    scene = ac.System()
    scene.world, scene.box = World(None), RigidBody.box(2.0, (0.4, 0.3, 0.2))
    scene.feet = [PointOnPlane(unilateral=True) for _ in range(contacts)]
    for k, foot in enumerate(scene.feet):
        _on(scene, scene.world.frame, foot, scene.box.at((0.2 * math.cos(k), 0.2 * math.sin(k), -0.1)))
    frame = scene.box.frame
    return scene, {frame.position: (0, 0, 5), frame.velocity: (0.1, 0, 0), frame.angular_velocity: (1.0, 2.0, 3.0)}


def carts(count: int, rough: bool) -> tuple[ac.System, dict[Any, Any]]:
    """Masses in a row, joined by springs, each with friction on the floor, or held by it: the one that is pushed moves between springs and does not stop."""
    scene = ac.System()
    scene.first, scene.floor = SlidingMass(1.0), TranslationalGround()
    scene.masses = [SlidingMass(1.0) for _ in range(count)]
    scene.springs = [TranslationalSpring(100.0) for _ in range(count)]
    ends = [scene.first, *scene.masses]
    for a, b, spring in zip(ends, ends[1:], scene.springs, strict=False):
        scene.connect(a.flange_b, spring.flange_a)
        scene.connect(spring.flange_b, b.flange_a)
    start: dict[Any, Any] = {scene.first.s: -0.1, scene.first.v: 0.5}
    if rough:
        scene.rubs = [Clutch(scene.floor.flange, mass.flange_a, capacity=50.0) for mass in scene.masses]
        start |= {mass.s: 0.0 for mass in scene.masses} | {mass.v: 0.0 for mass in scene.masses}
    else:
        for mass in scene.masses:
            scene.connect(mass.flange_a, scene.floor.flange)
    return scene, start


@dataclass(frozen=True, eq=False)
class Billiards:
    """Equal balls without friction on a round table, which lose nothing: system and start; places p and velocities v (n, 2) at the start."""

    system: ac.System
    start: dict[Any, Any]
    p: np.ndarray
    v: np.ndarray
    radius: float = 0.05
    table: float = 0.6

    def places(self, run: ac.Trajectory) -> np.ndarray:
        """(times, n, 2)."""
        return np.stack([run[slide.q][:, :2] for slide in self.system.slides], axis=1)

    def energy_change(self, run: ac.Trajectory) -> float:
        """Largest, beside the energy."""
        energy = sum(np.sum(run[slide.v][:, :2] ** 2, axis=1) for slide in self.system.slides)
        return float(np.max(np.abs(energy / np.sum(self.v**2) - 1)))

    def overlap(self, run: ac.Trajectory) -> float:
        """The deepest, in units of the radius."""
        p = self.places(run)
        i, j = np.triu_indices(p.shape[1], 1)
        apart = np.linalg.norm(p[:, i] - p[:, j], axis=2) - 2 * self.radius
        rim = self.table - self.radius - np.linalg.norm(p, axis=2)
        return float(max(0.0, -min(np.min(apart, initial=np.inf), np.min(rim))) / self.radius)

    def by_events(self, end: float) -> tuple[np.ndarray, int]:
        """From event to event with the roots of quadratics: places at the end, and how many collisions."""
        p, v, t, count = self.p.copy(), self.v.copy(), 0.0, 0
        i, j = np.triu_indices(p.shape[0], 1)
        while True:
            r, w = p[i] - p[j], v[i] - v[j]
            b, ww = np.sum(r * w, axis=1), np.sum(w * w, axis=1)
            root = b * b - ww * (np.sum(r * r, axis=1) - 4 * self.radius**2)
            meet = (b < 0) & (root > 0)
            pair = np.full(b.size, np.inf)
            pair[meet] = (np.sum(r * r, axis=1) - 4 * self.radius**2)[meet] / (np.sqrt(root[meet]) - b[meet])
            b, ww, gap = np.sum(p * v, axis=1), np.sum(v * v, axis=1), (self.table - self.radius) ** 2 - np.sum(p * p, axis=1)
            rim = (np.sqrt(np.maximum(b * b + ww * gap, 0)) - b) / ww
            k, m = int(np.argmin(pair)) if pair.size else 0, int(np.argmin(rim))
            step = max(0.0, min(pair[k] if pair.size else np.inf, rim[m]))
            if t + step > end:
                return p + (end - t) * v, count
            p, t, count = p + step * v, t + step, count + 1
            if pair.size and pair[k] <= rim[m]:
                n = (p[i[k]] - p[j[k]]) / (2 * self.radius)
                exchanged = (n @ (v[i[k]] - v[j[k]])) * n
                v[i[k]] -= exchanged
                v[j[k]] += exchanged
            else:
                n = p[m] / np.linalg.norm(p[m])
                v[m] -= 2 * (n @ v[m]) * n


def billiards(count: int) -> Billiards:
    """Of so many balls."""
    scene = ac.System()
    scene.world = World(None)
    scene.balls, scene.slides = [RigidBody.ball(1.0, 0.05) for _ in range(count)], [CartesianTranslation() for _ in range(count)]
    scene.rims = [PointOnSurface(Cylinder(0.55, inside_out=True), unilateral=True, restitution=1.0) for _ in range(count)]
    pairs = [(i, j) for i in range(count) for j in range(i)]
    scene.pairs = [Contact(Sphere(0.05), Sphere(0.05), Hard(1.0)) for _ in pairs]
    for ball, slide, rim in zip(scene.balls, scene.slides, scene.rims, strict=True):
        _on(scene, scene.world.frame, slide, ball.frame)
        _on(scene, scene.world.frame, rim, ball.frame)
    for (i, j), pair in zip(pairs, scene.pairs, strict=True):
        _on(scene, scene.balls[i].frame, pair, scene.balls[j].frame)
    angle = 2.4 * np.arange(count)
    p = (0.13 * np.sqrt(np.arange(count) + 0.5))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    v = np.random.default_rng(1).normal(size=(count, 2)) * 0.3
    start = {slide.q: (*at, 0.0) for slide, at in zip(scene.slides, p, strict=True)}
    start |= {slide.v: (*speed, 0.0) for slide, speed in zip(scene.slides, v, strict=True)}
    return Billiards(scene, start, p, v)
