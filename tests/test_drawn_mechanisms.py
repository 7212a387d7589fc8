"""Mechanisms drawn at random that strike, rub, jam and hang: pendulums, linkages, boxes and ropes among floors, stops and bearings, in any size.

No closed form knows where they go. But at all times the laws say what may be: nothing is inside anything, contacts push or are open, friction stays within its limit and against
the slip, and the balance of energy closes through every impact.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal as ac
from components import (
    Contact,
    Coulomb,
    EndStop,
    Fixed,
    Hard,
    JointFriction,
    Patch,
    Planar,
    Plane,
    PointOnPlane,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    Rope,
    Sphere,
    Spherical,
    Spring,
    World,
)

G = 9.81


@dataclass
class Drawn:
    """A scene of so large `size` and `mass`, with parts that touch by these laws, its start, and what draws the numbers."""

    g: np.random.Generator
    size: float
    mass: float
    scene: Any = field(default_factory=ac.System)
    start: dict[Any, Any] = field(default_factory=dict[Any, Any])
    touches: list[tuple[Any, Coulomb | None]] = field(default_factory=list[tuple[Any, Coulomb | None]])

    @staticmethod
    def by(seed: int) -> Drawn:
        g = np.random.default_rng(seed)
        size, mass = float(g.choice([1e-3, 1.0, 1e3])), float(g.choice([1e-6, 1.0, 1e4]))
        drawn = Drawn(g, size, mass)
        drawn.scene.world = World(gravity=(0, 0, -G * size))
        return drawn

    def on(self, a: Any, part: Any, b: Any) -> None:
        self.scene.connect(a, part.frame_a)
        self.scene.connect(part.frame_b, b)

    def rod(
        self, tip: tuple[float, float, float], position: tuple[float, float, float] | None = None, times: float = 1.0
    ) -> RigidBody:
        placed = None if position is None else tuple(self.size * x for x in position)
        return RigidBody.rod(times * self.mass, tuple(self.size * x for x in tip), position=placed)

    def hinge(self, a: Any, b: Any, at: tuple[float, float, float]) -> Revolute:
        return Revolute.between(a, b, at=tuple(self.size * x for x in at), axis="y")

    def feet(self, places: list[Any], floor: float) -> None:
        """Points or balls on a tilted floor."""
        s, g = self.scene, self.g
        s.ground = Fixed(position=(0, 0, floor), rotation=Rotation.from_rotvec([0.1 * g.normal(), 0.1 * g.normal(), 0]))
        s.connect(s.world.frame, s.ground.frame_a)
        mu, e = float(g.choice([0, 0.1, 0.5, 1.0])), float(g.choice([0, 0.3, 0.8]))
        law = Coulomb(mu) if mu else None
        s.feet = [
            PointOnPlane(unilateral=True, restitution=e, friction=law)
            if g.random() < 0.6
            else Contact(Sphere(0.05 * self.size), Plane(), Hard(e, law))
            for _ in places
        ]
        for foot, place in zip(s.feet, places, strict=True):
            self.on(s.ground.frame_b, foot, place)
            self.touches.append((foot, law))

    def bearing(self, hinge: Any, mu: float, static: float | None) -> None:
        self.scene.bearing = JointFriction(hinge, Coulomb(mu, static=static), radius=0.03 * self.size)


def _double(d: Drawn) -> tuple[list[Any], Any, float, float]:
    """Hinges, tip, how far that reaches, and how high it is at the start."""
    s, g = d.scene, d.g
    upper, lower = g.uniform(0.3, 1, 2)
    s.a, s.b = Revolute("y"), Revolute("y")
    s.u, s.l = d.rod((0, 0, -upper), times=g.uniform(0.5, 2)), d.rod((0, 0, -lower), times=g.uniform(0.5, 2))
    d.on(s.world.frame, s.a, s.u.frame)
    d.on(s.u.tip, s.b, s.l.frame)
    first, second = g.uniform(-2, 2, 2)
    d.start |= {s.a.q: first, s.b.q: second, s.a.v: g.uniform(-5, 5)}
    return [s.a, s.b], s.l.tip, (upper + lower) * d.size, -(upper * np.cos(first) + lower * np.cos(first + second)) * d.size


def _spatial(d: Drawn) -> tuple[list[Any], Any, float, float]:
    s, g, size = d.scene, d.g, d.size
    upper, lower = g.uniform(0.3, 1, 2)
    s.a, s.b = Spherical(), Revolute("x")
    s.u = RigidBody.box(d.mass, (0.1 * size, 0.2 * size, 0.15 * size))
    s.l = RigidBody.rod(d.mass * g.uniform(0.5, 2), (0, 0, -lower * size), radius=0.03 * size)
    d.on(s.world.frame, s.a, s.u.at((0, 0, upper * size)))
    d.on(s.u.at((0, 0, -0.05 * size)), s.b, s.l.frame)
    bent = g.uniform(1.0, 2.0)
    d.start |= {s.a.v: g.uniform(-3, 3, 3), s.b.q: bent}
    return [s.b], s.l.tip, (upper + lower) * size, -(upper + 0.05 + lower * np.cos(bent)) * size


def pendulum(seed: int) -> Drawn:
    """Two links above a floor, their hinges between stops or in plain bearings."""
    d = Drawn.by(seed)
    s, g = d.scene, d.g
    planar = g.random() < 0.7
    hinges, tip, reach, height = (_double if planar else _spatial)(d)
    if g.random() < 0.5:
        hinge = hinges[int(g.integers(len(hinges)))]
        s.stop = EndStop(hinge.flange, lower=-2.2, upper=2.2, restitution=float(g.choice([0, 0.6, 1.0])))
    if g.random() < 0.7:
        d.bearing(hinges[int(g.integers(len(hinges)))], g.uniform(0.05, 0.4), 0.5)
    d.feet([tip], min(-0.8 * reach, height - 0.4 * reach))
    if g.random() < 0.3:
        s.leash = Rope(length=float(g.uniform(1.0, 1.3)) * (reach + 0.3 * d.size), restitution=0.2)
        d.on(s.world.at((0.2 * d.size, 0, 0.1 * d.size)), s.leash, tip)
    return d


def boxes(seed: int) -> Drawn:
    """One or two boxes or balls, which a rope may tie, each with two feet above an inclined floor."""
    d = Drawn.by(seed)
    s, g, size = d.scene, d.g, d.size
    s.bodies = [
        RigidBody.box(d.mass * g.uniform(0.5, 2), g.uniform(0.1, 0.4, 3) * size)
        if g.random() < 0.5
        else RigidBody.ball(d.mass, 0.15 * size)
        for _ in range(int(g.integers(1, 3)))
    ]
    for k, body in enumerate(s.bodies):
        frame = body.frame
        place = np.array([0.6 * k, 0, g.uniform(0.6, 1.2)]) * size
        d.start |= {
            frame.position: place,
            frame.velocity: g.uniform(-1, 1, 3) * size,
            frame.angular_velocity: g.uniform(-3, 3, 3),
        }
    places = [body.at(tuple(g.uniform(-0.15, 0.15, 3) * size)) for body in s.bodies for _ in range(2)]
    if len(s.bodies) == 2 and g.random() < 0.6:
        s.tie = Rope(length=0.9 * size, restitution=float(g.choice([0, 0.4])))
        d.on(s.bodies[0].at((0.05 * size, 0, 0)), s.tie, s.bodies[1].at((0, 0.05 * size, 0)))
    d.feet(places, 0.0)
    return d


def striker(seed: int) -> Drawn:
    """A four-bar in a plain bearing that strikes a ball on a rough rail, which a spring brings back."""
    d = Drawn.by(seed)
    s, g, size = d.scene, d.g, d.size
    mu, e = float(g.choice([0, 0.1, 0.4, 0.9])), float(g.choice([0, 0.3, 0.8]))
    law = Coulomb(mu) if mu else None
    s.crank, s.coupler = d.rod((0, 0, 0.4), (0, 0, 0)), d.rod((1.1, 0, 0.45), (0, 0, 0.4), 2.0)
    s.rocker = d.rod((0.1, 0, 0.85), (1.0, 0, 0))
    s.a, s.b = d.hinge(s.world, s.crank, (0, 0, 0)), d.hinge(s.crank, s.coupler, (0, 0, 0.4))
    s.c, s.d = d.hinge(s.coupler, s.rocker, (1.1, 0, 0.85)), d.hinge(s.world, s.rocker, (1.0, 0, 0))
    s.ball, s.rail = RigidBody.ball(d.mass * g.uniform(0.2, 2), 0.1 * size), Prismatic("x")
    s.spring = Spring(50 * d.mass, 0.5 * size)
    d.on(s.world.at((1.3 * size, 0, 0.8 * size)), s.rail, s.ball.frame)
    s.connect(s.world.at((2.2 * size, 0, 0.8 * size)), s.spring.point_a)
    s.connect(s.spring.point_b, s.ball.frame)
    s.hit = Contact(Sphere(0.05 * size), Sphere(0.1 * size), Hard(e, law))
    d.on(s.ball.frame, s.hit, s.rocker.tip)
    d.touches.append((s.hit, law))
    if mu:
        s.rub = JointFriction(s.rail, Coulomb(mu))
    d.bearing(s.d, 0.1, None)
    d.start |= {s.a.v: float(g.uniform(4, 8)), s.rail.q: 0.0}
    return d


def shaken(seed: int) -> Drawn:
    """One or two boxes in a plane on a table that shakes both ways."""
    d = Drawn.by(seed)
    s, g, size = d.scene, d.g, d.size
    mu, e = float(g.choice([0.1, 0.4, 0.9])), float(g.choice([0, 0.3, 0.8]))
    far, fast, law = g.uniform(0.02, 0.2) * size, g.uniform(3, 20), Coulomb(mu)
    s.table = PrescribedMotion(position=(far * np.sin(fast * ac.time), 0, 0.5 * far * np.sin(1.3 * fast * ac.time)))
    s.connect(s.world.frame, s.table.frame_a)
    s.boxes = [
        RigidBody.box(d.mass * g.uniform(0.5, 2), (0.3 * size, 0.3 * size, 0.2 * size)) for _ in range(int(g.integers(1, 3)))
    ]
    s.slides = [Planar("y") for _ in s.boxes]
    s.feet = [PointOnPlane(unilateral=True, restitution=e, friction=law) for _ in range(2 * len(s.boxes))]
    for k, (slide, box) in enumerate(zip(s.slides, s.boxes, strict=True)):
        d.on(s.world.frame, slide, box.frame)
        for foot, x in zip(s.feet[2 * k : 2 * k + 2], (-0.15, 0.15), strict=True):
            d.on(s.table.frame_b, foot, box.at((x * size, 0, -0.1 * size)))
            d.touches.append((foot, law))
        d.start |= {box.frame.position[0]: 0.6 * k * size, box.frame.position[2]: 0.5 * size}
        d.start[slide.v] = np.array([g.uniform(-1, 1) * size, 0, g.uniform(-2, 2)])
    return d


def in_a_bowl(seed: int) -> Drawn:
    """A ball with a patch that falls into a rough bowl, or onto a rough dome."""
    d = Drawn.by(seed)
    s, g, size = d.scene, d.g, d.size
    inside, law = g.random() < 0.5, Coulomb(float(g.choice([0.1, 0.4, 0.9])), patch=Patch(0.01 * size))
    s.body = RigidBody.box(d.mass, (0.3 * size, 0.2 * size, 0.15 * size))
    s.touch = Contact(Sphere(0.1 * size), Sphere(size, inside_out=inside), Hard(float(g.choice([0, 0.3, 0.8])), law))
    d.on(s.world.frame, s.touch, s.body.frame)
    d.touches.append((s.touch, law))
    frame = s.body.frame
    d.start |= {frame.position: np.array([0.05 * g.normal(), 0.05 * g.normal(), -0.5 if inside else 1.3]) * size}
    d.start |= {frame.velocity: g.uniform(-1, 1, 3) * size, frame.angular_velocity: g.uniform(-6, 6, 3)}
    return d


DRAWN = [
    *((pendulum, seed) for seed in (0, 3, 7, 11, 19, 24, 32, 36, 38)),
    *((boxes, seed) for seed in (2, 9, 14, 15, 33, 37)),
    *((striker, seed) for seed in (1, 3, 6, 9, 18)),
    *((shaken, seed) for seed in (0, 5, 9, 19)),
    *((in_a_bowl, seed) for seed in (1, 2, 4)),
]  # fmt: skip


@pytest.mark.parametrize(("make", "seed"), DRAWN, ids=[f"{make.__name__}{seed}" for make, seed in DRAWN])
def test_laws_hold_at_all_times(make: Any, seed: int) -> None:
    d = make(seed)
    rtol = float(10.0 ** -d.g.integers(6, 12))
    run = ac.build(d.scene).simulate(2.0, d.start, rtol=rtol, samples=201, progress=False)
    assert run.energy_error() < 1e-6
    weight = d.mass * G * d.size
    for part, law in d.touches:
        gap, push = np.asarray(run[part.gap]), np.asarray(run[part.normal_force])
        assert gap.min() > -1e-12 * d.size
        assert push.min() >= -1e-9 * weight
        assert np.all((push <= 1e-9 * weight) | (gap < 1e-9 * d.size))
        if law is None:
            continue
        drag, slip = np.asarray(run[part.friction_force]), np.asarray(run[part.slip])
        force, speed = np.linalg.norm(drag, axis=1), np.linalg.norm(slip, axis=1)
        assert np.all(force <= float(law.static) * push + 1e-9 * np.maximum(push, weight))
        slides = (speed > 1e-6 * d.size) & (push > 1e-9 * weight)
        if law.patch is None and slides.any():
            np.testing.assert_allclose(force[slides], float(law.mu) * push[slides], rtol=1e-9)
