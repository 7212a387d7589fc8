"""Scenes in any units of length, mass and time, anywhere and turned anyhow: what must move as its original does."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import acausal as ac
from components import (
    Cone,
    Contact,
    Cylinder,
    Damper,
    Ellipsoid,
    Free,
    Gear,
    HuntCrossley,
    PointOnPlane,
    Prismatic,
    Revolute,
    RigidBody,
    Rod,
    RollingDisk,
    RollingEllipsoid,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    Screw,
    SmoothCoulomb,
    Sphere,
    Spherical,
    Spring,
    Universal,
    World,
)
from tests.formulations import HELD, Place, Sketch, composed, displaced, script
from tests.test_formulations import Hinges, bennett, goldberg, line_symmetric, orthogonal, planar, sarrus, spherical

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Units:
    """How many metres, kilograms and seconds the scene's own are; and where it stands in the world, in its own lengths."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0
    place: Place = HELD

    def vector(self, *v: float) -> Vector:
        """A length times a direction, in the scene's axes [m]."""
        return tuple(self.length * x for x in v)  # type: ignore[return-value]

    @property
    def g(self) -> float:
        """[m/s^2] of 9.81 of the scene's own."""
        return 9.81 * self.length / self.time**2

    @property
    def inertia(self) -> float:
        """[kg m^2]"""
        return self.mass * self.length**2

    @property
    def torque(self) -> float:
        """[N m]"""
        return self.inertia / self.time**2

    @property
    def stiffness(self) -> float:
        """[N/m]"""
        return self.mass / self.time**2

    @property
    def rate(self) -> float:
        """[1/s]"""
        return 1 / self.time

    @property
    def speed(self) -> float:
        """[m/s]"""
        return self.length / self.time

    def world(self, *gravity: float) -> World:
        """With gravity in the scene's own axes and units."""
        R = self.place[0]
        return World(tuple(self.length / self.time**2 * (R @ np.array(gravity, dtype=float))))

    def base(self, world: World, *point: float) -> ac.Frame:
        """The frame of the world that the scene stands on, shifted by `point` in the scene's axes."""
        R, p = self.place
        at = tuple(self.length * (R @ np.array(point, dtype=float) + p)) if point else self.vector(*p)
        return world.frame if self.place is HELD and not any(point) else world.at(at, R)


@dataclass(frozen=True, eq=False)
class Similar:
    """A scene, its start, how long it runs [s], and what is seen of it, each with its unit: seen / unit is the same in all units."""

    scene: Any
    start: Mapping[Any, Any]
    end: float
    seen: tuple[tuple[Any, float], ...]
    growth: float = 100.0
    """By how much differences at the start have grown at the end, at most."""
    joints: tuple[Any, ...] = field(default=())

    def numbers(self, run: Any) -> np.ndarray:
        """All that is seen, without units, (samples, ...)."""
        return np.hstack([np.reshape(run[expression], (run.t.size, -1)) / unit for expression, unit in self.seen])


SCENES: dict[str, Callable[[Units], Similar]] = {}


def scene(make: Callable[[Units], Similar]) -> Callable[[Units], Similar]:
    """Enter a scene in `SCENES`."""
    SCENES[make.__name__] = make
    return make


def joined(scene: ac.System, *ends: tuple[ac.Point, Any, ac.Point]) -> None:
    """Joints, each between two connectors."""
    for a, joint, b in ends:
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)


@scene
def double_pendulum(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.a, s.b = of.world(0, 0, -9.81), Revolute("y"), Revolute("y")
    s.upper, s.lower = (RigidBody.rod(of.mass, of.vector(0, 0, -1)) for _ in range(2))
    joined(s, (of.base(s.world), s.a, s.upper.frame), (s.upper.tip, s.b, s.lower.frame))
    return Similar(s, {s.a.q: 0.6, s.b.v: 1.0 * of.rate}, 3 * of.time, ((s.a.q, 1.0), (s.b.q, 1.0), (s.b.v, of.rate)))


@scene
def spring_pendulum(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.ball = of.world(0, 0, -9.81), RigidBody.ball(of.mass, 0.1 * of.length)
    s.spring, s.damper = Spring(300 * of.stiffness, of.length), Damper(0.3 * of.stiffness * of.time)
    s.joint = Free()
    joined(s, (of.base(s.world), s.joint, s.ball.frame))
    for part in (s.spring, s.damper):
        s.connect(of.base(s.world, 0, 0, 2), part.point_a)
        s.connect(part.point_b, s.ball.frame)
    start = {s.joint.q: [1, 0, 0, 0, *of.vector(0.2, 0, 0.1)], s.joint.v: [0, 0, of.rate, *(of.speed * np.array([0.0, 0.5, 0]))]}
    return Similar(s, start, 2 * of.time, ((s.joint.q[4:7], of.length), (s.joint.v[3:6], of.speed), (s.joint.q[0:4], 1.0)))


def four_bar_scene(of: Units, coupler: float = 1.2, axis: Vector = (0, 1, 0)) -> Any:
    s: Any = ac.System()
    s.world = of.world(0, 0, -9.81)
    s.crank, s.coupler, s.rocker = (
        RigidBody.rod(m * of.mass, of.vector(x, 0, 0)) for m, x in ((1, 0.4), (2, coupler), (1.5, 0.8))
    )
    s.a, s.b, s.c, s.d = (Revolute(axis) for _ in range(4))
    joined(
        s,
        (of.base(s.world), s.a, s.crank.frame),
        (s.crank.tip, s.b, s.coupler.frame),
        (s.coupler.tip, s.c, s.rocker.tip),
        (of.base(s.world, 1, 0, 0), s.d, s.rocker.frame),
    )
    return s


@scene
def four_bar(of: Units) -> Similar:
    """From a rough sketch: all bars lie along x."""
    s = four_bar_scene(of)
    return Similar(s, {s.a.q: 0.9, s.a.v: 2 * of.rate}, 2 * of.time, tuple((j.q, 1.0) for j in (s.a, s.b, s.c, s.d)))


@scene
def carried_wishbone(of: Units) -> Similar:
    """A body that is free, with two arms, an upright and a tie rod at its side: what loops hold, and what they do not, has units of both kinds."""
    s: Any = ac.System()
    s.world, s.chassis, s.joint = of.world(0, 0, -9.81), RigidBody.box(9 * of.mass, of.vector(1, 0.6, 0.3)), Free()
    s.lower, s.upper = (RigidBody.rod(of.mass, of.vector(x, y, 0)) for x, y in ((0.0, 0.4), (-0.02, 0.3)))
    s.upright = RigidBody.box(2 * of.mass, of.vector(0.1, 0.1, 0.3))
    s.hinges, s.balls = [Revolute("x"), Revolute("x")], [Spherical(), Spherical()]
    joined(
        s,
        (of.base(s.world), s.joint, s.chassis.frame),
        (s.chassis.at(of.vector(0, 0.35, 0.2)), s.hinges[0], s.lower.frame),
        (s.chassis.at(of.vector(0, 0.45, 0.5)), s.hinges[1], s.upper.frame),
        (s.lower.tip, s.balls[0], s.upright.at(of.vector(0, 0, -0.15))),
        (s.upper.tip, s.balls[1], s.upright.at(of.vector(-0.02, 0, 0.15))),
    )
    s.tie, s.spring = Rod(math.hypot(0.36, 0.01) * of.length), Spring(300 * of.stiffness, of.length)
    s.connect(s.chassis.at(of.vector(-0.14, 0.36, 0.29)), s.tie.frame_a)
    s.connect(s.tie.frame_b, s.upright.at(of.vector(-0.14, -0.03, -0.07)))
    s.connect(of.base(s.world, 0, 0, 2), s.spring.point_a)
    s.connect(s.spring.point_b, s.chassis.at(of.vector(0.1, 0.1, 0.1)))
    start = {s.joint.v: [of.rate, 0, 0, *(of.speed * np.array([0.0, 0.5, 0]))], s.hinges[0].v: 2 * of.rate}
    seen = ((s.joint.q[4:7], of.length), (s.joint.v[3:6], of.speed), (s.joint.q[0:4], 1.0), (s.hinges[0].q, 1.0))
    return Similar(s, start, 0.5 * of.time, seen)


@scene
def slider_crank(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.a, s.b, s.c, s.rail = of.world(0, -9.81, 0), Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    s.crank, s.rod = (RigidBody.rod(of.mass, of.vector(x, 0, 0)) for x in (1.0, 2.5))
    s.slider = RigidBody.box(of.mass, of.vector(0.1, 0.1, 0.1))
    joined(
        s,
        (of.base(s.world), s.a, s.crank.frame),
        (s.crank.tip, s.b, s.rod.frame),
        (s.rod.tip, s.c, s.slider.frame),
        (of.base(s.world), s.rail, s.slider.frame),
    )
    return Similar(s, {s.a.q: 0.7, s.a.v: 3 * of.rate}, 2 * of.time, ((s.a.q, 1.0), (s.b.q, 1.0), (s.rail.q, of.length)))


@scene
def equal_slider_crank(of: Units) -> Similar:
    """Passes its change points at speed: crank and rod have the same length."""
    s: Any = ac.System()
    s.world, s.a, s.b, s.c, s.rail = of.world(0, 0, 0), Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    s.crank, s.rod = (RigidBody.rod(of.mass, of.vector(1, 0, 0)) for _ in range(2))
    s.slider = RigidBody.box(of.mass, of.vector(0.1, 0.1, 0.1))
    joined(
        s,
        (of.base(s.world), s.a, s.crank.frame),
        (s.crank.tip, s.b, s.rod.frame),
        (s.rod.tip, s.c, s.slider.frame),
        (of.base(s.world), s.rail, s.slider.frame),
    )
    start = {s.a.q: 1.0, s.a.v: 3 * of.rate, s.rail.q: ac.near(of.length)}
    return Similar(s, start, 2 * of.time, ((s.a.q, 1.0), (s.b.q, 1.0), (s.rail.q, of.length)), growth=1e4)


@scene
def two_four_bars(of: Units) -> Similar:
    """IFToMM's benchmark A02: passes a singular position, with all cranks level."""
    s: Any = ac.System()
    s.world = of.world(0, -9.81, 0)
    s.cranks = [RigidBody.rod(of.mass, of.vector(0, 1, 0)) for _ in range(3)]
    s.bars = [RigidBody.rod(of.mass, of.vector(1, 0, 0)) for _ in range(2)]
    s.feet, s.heads = [Revolute("z") for _ in range(3)], [Revolute("z") for _ in range(4)]
    ends = [(of.base(s.world, k, 0, 0) if k else of.base(s.world), s.feet[k], s.cranks[k].frame) for k in range(3)]
    for k in range(2):
        ends += [(s.cranks[k].tip, s.heads[2 * k], s.bars[k].frame), (s.bars[k].tip, s.heads[2 * k + 1], s.cranks[k + 1].tip)]
    joined(s, *ends)
    start = {s.feet[0].q: 0.0, s.feet[0].v: -1 * of.rate}
    return Similar(s, start, 2 * of.time, tuple((j.q, 1.0) for j in s.feet), growth=1e4)


@scene
def stewart_platform(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.platform = of.world(0, 0, -9.81), RigidBody.cylinder(5.0 * of.mass, 0.6 * of.length, 0.05 * of.length)
    s.cardan, s.slide, s.ball = (
        [make() for _ in range(6)] for make in (lambda: Universal("x", "y"), lambda: Prismatic("z"), Spherical)
    )
    s.lower, s.upper = ([RigidBody.rod(of.mass, of.vector(0, 0, x)) for _ in range(6)] for x in (0.5, -0.5))
    s.springs = [Spring(2000 * of.stiffness, 1.2 * of.length) for _ in range(6)]
    for k in range(6):
        base, top = np.deg2rad(120 * (k // 2) + (-1) ** k * 12), np.deg2rad(120 * (k // 2) + (-1) ** k * 48)
        foot = of.base(s.world, math.cos(base), math.sin(base), 0)
        head = s.platform.at(of.vector(0.6 * math.cos(top), 0.6 * math.sin(top), 0))
        joined(
            s,
            (foot, s.cardan[k], s.lower[k].frame),
            (s.lower[k].frame, s.slide[k], s.upper[k].frame),
            (head, s.ball[k], s.upper[k].frame),
        )
        s.connect(foot, s.springs[k].point_a)
        s.connect(s.springs[k].point_b, head)
    start = {leg.q: (1.1 + 0.02 * k) * of.length for k, leg in enumerate(s.slide)}
    return Similar(s, start, 0.5 * of.time, tuple((leg.q, of.length) for leg in s.slide))


@scene
def rolling_disk(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.contact = of.world(0, 0, -9.81), RollingDisk(0.5 * of.length)
    s.disk = RigidBody.disk(of.mass, 0.5 * of.length, "y")
    joined(s, (of.base(s.world), s.contact, s.disk.frame))
    v = s.contact.v
    return Similar(s, {v: [0.1 * of.rate, 3 * of.rate, 0.2 * of.rate]}, 2 * of.time, ((v, of.rate),))


@scene
def rattleback(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.contact = of.world(0, 0, -9.81), RollingEllipsoid(of.vector(0.2, 0.03, 0.02))
    inertia = of.inertia * np.array([[2e-3, -5e-4, 0], [-5e-4, 1.6e-2, 0], [0, 0, 1.7e-2]])
    s.stone = RigidBody(of.mass, inertia)
    joined(s, (of.base(s.world), s.contact, s.stone.frame))
    v = s.contact.v
    return Similar(s, {v: [0.01 * of.rate, -0.01 * of.rate, -2 * of.rate]}, of.time, ((v, of.rate),))


@scene
def cylinder_on_an_ellipsoid(of: Units) -> Similar:
    """Coordinates on both: lengths and angles in one joint."""
    s: Any = ac.System()
    s.world, s.contact = of.world(0, 0, -9.81), Contact(Cylinder(0.1 * of.length), Ellipsoid(of.vector(0.9, 0.7, 0.5)))
    s.roller = RigidBody.cylinder(of.mass, 0.1 * of.length, of.length)
    joined(s, (of.base(s.world), s.contact, s.roller.frame))
    start = {
        s.contact.q: [0.02 * of.length, 0.05 * of.length, 1.2, 40 / 41, 9 / 41, 0, 0],
        s.contact.v: [0.1 * of.rate, -0.1 * of.rate, of.rate],
    }
    return Similar(s, start, 0.3 * of.time, ((s.contact.q[0:2], of.length), (s.contact.q[2:7], 1.0), (s.contact.v, of.rate)))


@scene
def ball_that_yields_in_a_cone(of: Units) -> Similar:
    s: Any = ac.System()
    law = HuntCrossley(
        1e4 * of.stiffness / of.length**0.5, 0.3 * of.time / of.length, friction=SmoothCoulomb(0.2, 0.01 * of.speed)
    )
    s.world, s.contact = of.world(0, 0, -9.81), Contact(Sphere(0.1 * of.length), Cone(0.8), law)
    s.joint, s.ball = Free(), RigidBody.ball(1.3 * of.mass, 0.1 * of.length)
    joined(s, (of.base(s.world), s.joint, s.ball.frame), (of.base(s.world), s.contact, s.ball.frame))
    start = {s.joint.q: [1, 0, 0, 0, 0.5 * of.length, 0, 0.7 * of.length], s.joint.v: [0, 0, 0, 0, of.speed, 0]}
    return Similar(s, start, 0.3 * of.time, ((s.joint.q[4:7], of.length), (s.joint.v[0:3], of.rate)), growth=1e4)


@scene
def geared_pendulums(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.a, s.b = of.world(0, 0, -9.81), Revolute("y"), Revolute("y")
    s.one, s.two = (RigidBody.rod(m * of.mass, of.vector(0, 0, -x)) for m, x in ((1, 1), (0.3, 0.5)))
    joined(s, (of.base(s.world), s.a, s.one.frame), (of.base(s.world, 0, 1, 0), s.b, s.two.frame))
    s.gear, s.spring, s.damper, s.ground = (
        Gear(-3.0),
        RotationalSpring(2 * of.torque),
        RotationalDamper(0.1 * of.torque * of.time),
        RotationalGround(),
    )
    s.connect(s.a.flange, s.gear.flange_a)
    s.connect(s.gear.flange_b, s.b.flange)
    for part in (s.spring, s.damper):
        s.connect(s.ground.flange, part.flange_a)
        s.connect(part.flange_b, s.a.flange)
    return Similar(s, {s.a.q: 0.8}, 2 * of.time, ((s.a.q, 1.0), (s.b.q, 1.0), (s.a.v, of.rate)))


@scene
def screw_press(of: Units) -> Similar:
    """A screw and a slide that close a loop over a nut: an angle is tied to a height."""
    s: Any = ac.System()
    s.world, s.screw, s.slide, s.hinge = of.world(0, 0, -9.81), Screw("z", 0.3 * of.length), Prismatic("z"), Revolute("z")
    s.spindle, s.ram = (
        RigidBody.cylinder(of.mass, 0.1 * of.length, of.length),
        RigidBody.box(2 * of.mass, of.vector(0.2, 0.2, 0.2)),
    )
    joined(
        s,
        (of.base(s.world), s.screw, s.spindle.frame),
        (s.spindle.frame, s.hinge, s.ram.frame),
        (of.base(s.world), s.slide, s.ram.frame),
    )
    return Similar(s, {s.screw.v: 2 * of.rate}, of.time, ((s.screw.q, 1.0), (s.slide.q, of.length)))


@scene
def top_on_a_plane(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.contact = of.world(0, 0, -9.81), PointOnPlane()
    s.joint = Free()
    s.top = RigidBody(of.mass, tuple(of.inertia * x for x in (0.02, 0.02, 0.01)), of.vector(0, 0, 0.3))
    joined(s, (of.base(s.world), s.joint, s.top.frame))
    s.connect(of.base(s.world), s.contact.frame_a)
    s.connect(s.contact.frame_b, s.top.frame)
    tilt = 0.4
    start = {s.joint.q: [math.cos(tilt / 2), math.sin(tilt / 2), 0, 0, 0, 0, 0], s.joint.v: [0, 0, 60 * of.rate, 0, 0, 0]}
    return Similar(s, start, 0.5 * of.time, ((s.joint.q[0:4], 1.0), (s.joint.q[4:7], of.length)))


@scene
def rods_in_space(of: Units) -> Similar:
    """A plate that hangs on three massless rods."""
    s: Any = ac.System()
    s.world, s.plate = (
        of.world(0, 0, -9.81),
        RigidBody.box(
            of.mass,
            of.vector(1, 1, 0.05),
            position=tuple(of.length * (of.place[0] @ (0, 0, -1) + of.place[1])),
            rotation=of.place[0],
        ),
    )
    s.rods = [Rod(1.1 * of.length) for _ in range(3)]
    for k, rod in enumerate(s.rods):
        x, y = math.cos(2.1 * k), math.sin(2.1 * k)
        s.connect(of.base(s.world, 0.6 * x, 0.6 * y, 0), rod.frame_a)
        s.connect(rod.frame_b, s.plate.at(of.vector(0.5 * x, 0.5 * y, 0)))
    R, p = of.place
    position, along = s.plate.frame.position, s.plate.frame.rotation[:, 0]
    start = {position.T @ R[:, k]: of.length * (offset + float(R[:, k] @ p)) for k, offset in ((0, 0.15), (1, -0.05))}
    start |= {along.T @ R[:, 1]: 0.1}
    w = s.plate.frame.angular_velocity
    return Similar(s, start, of.time, ((w.T @ w, of.rate**2), (along.T @ R[:, 1], 1.0)))


def scaled(sketch: Sketch, of: Units) -> Sketch:
    """A sketch of the formulations in other units: bodies on hinges, and forces of gravity only."""
    L, M, T = of.length, of.mass, of.time
    bodies = tuple(
        replace(b, place=(b.place[0], L * b.place[1]), mass=M * b.mass, centre=L * b.centre, inertia=of.inertia * b.inertia)
        for b in sketch.bodies
    )
    joints = tuple(
        replace(j, frame_a=(j.frame_a[0], L * j.frame_a[1]), frame_b=(j.frame_b[0], L * j.frame_b[1])) for j in sketch.joints
    )
    moved = Sketch(L / T**2 * sketch.gravity, bodies, joints, (), np.zeros((len(bodies), 6)))
    return displaced(moved, (of.place[0], L * of.place[1])) if of.place is not HELD else moved


def linkage(make: Callable[[], Hinges]) -> Callable[[Units], Similar]:
    """A single loop of hinges, many of them redundant."""

    def made(of: Units) -> Similar:
        hinges = make()
        s = composed(script(scaled(hinges.sketch(), of)))
        joints = [getattr(s, f"j{k}") for k in range(len(hinges.axes))]
        start = {joints[0].q: 0.0, joints[0].v: hinges.rate * of.rate}
        return Similar(s, start, hinges.end * of.time / 2, tuple((j.q, 1.0) for j in joints), growth=1e4)

    made.__name__ = make.__name__ + "_linkage"
    return made


for _make in (bennett, goldberg, line_symmetric, orthogonal, sarrus, planar, spherical):
    scene(linkage(_make))
