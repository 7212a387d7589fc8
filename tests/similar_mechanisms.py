"""More scenes in any units: of other kinds of parts and of loops than those of `tests.similar`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

import acausal as ac
from components import (
    PID,
    AngleSource,
    CartesianTranslation,
    Constant,
    Cylindrical,
    Damper,
    Diode,
    ElasticGear,
    ElectromotiveForce,
    Fixed,
    FlexibleBeam,
    Force,
    Free,
    Gear,
    Ground,
    Inductor,
    Inertia,
    NonlinearDamper,
    NonlinearSpring,
    Particle,
    Planar,
    PlanetaryGear,
    PrescribedMotion,
    Prismatic,
    RackAndPinion,
    Resistor,
    Revolute,
    RigidBody,
    Rod,
    RollingBall,
    RollingDisk,
    RollingTorus,
    RotationalDamper,
    RotationalGround,
    RotationSensor,
    Section,
    SignalTorque,
    SlidingMass,
    Spherical,
    Spring,
    SpringDamper,
    Torque,
    TorqueSource,
    TranslationalDamper,
    TranslationalGround,
    TranslationalSpring,
    Universal,
    VoltageSource,
)
from tests.similar import Similar, Units, joined

MORE: dict[str, Callable[[Units], Similar]] = {}


def more(make: Callable[[Units], Similar]) -> Callable[[Units], Similar]:
    """Enter a scene in `MORE`."""
    MORE[make.__name__] = make
    return make


def at(of: Units, *point: float) -> tuple[float, ...]:
    """A point of the scene in the world's axes [m]."""
    R, p = of.place
    return tuple(of.length * (R @ np.array(point, dtype=float) + p))


def along(of: Units, *direction: float) -> tuple[float, ...]:
    """A direction of the scene in the world's axes."""
    return tuple(of.place[0] @ np.array(direction, dtype=float))


def placed(of: Units, *point: float) -> dict[str, Any]:
    """Of a body in a rough sketch."""
    return {"position": at(of, *point), "rotation": of.place[0]}


def inertia(of: Units, *moments: float) -> Any:
    """[kg m^2]"""
    return tuple(of.inertia * x for x in moments)


@more
def bicycle(of: Units) -> Similar:
    """Two rolling disks in a loop, hinges by points of a rough sketch: those of the Whipple bicycle."""
    s: Any = ac.System()
    s.road, tilt = of.world(0, 0, -9.81), np.pi / 10
    s.rear = RigidBody(2.0 * of.mass, inertia(of, 0.0603, 0.12, 0.0603), **placed(of, 0, 0, 0.3))
    s.frame = RigidBody(85.0 * of.mass, inertia(of, 9.2, 11.0, 2.8, 0, -2.4, 0), **placed(of, 0.3, 0, 0.9))
    s.fork = RigidBody(4.0 * of.mass, inertia(of, 0.05892, 0.06, 0.00708, 0, 0.00756, 0), **placed(of, 0.9, 0, 0.7))
    s.front = RigidBody(3.0 * of.mass, inertia(of, 0.1405, 0.28, 0.1405), **placed(of, 1.02, 0, 0.35))
    s.hub = Revolute.between(s.frame, s.rear, at=at(of, 0, 0, 0.3), axis=along(of, 0, 1, 0))
    s.steer = Revolute.between(s.frame, s.fork, at=at(of, 1.1, 0, 0), axis=along(of, np.sin(tilt), 0, -np.cos(tilt)))
    s.hub_f = Revolute.between(s.fork, s.front, at=at(of, 1.02, 0, 0.35), axis=along(of, 0, 1, 0))
    s.contact, s.contact_f = RollingDisk(0.3 * of.length), RollingDisk(0.35 * of.length)
    joined(s, (of.base(s.road), s.contact, s.rear.frame), (of.base(s.road), s.contact_f, s.front.frame))
    start = {
        s.contact.q: (0, 0, 0, 0, 0),
        s.contact.v: (0.05 * of.rate, 4 / 0.3 * of.rate, 0),
        s.steer.q: 0.0,
        s.steer.v: 0.0,
    }
    seen = ((s.steer.q, 1.0), (s.steer.v, of.rate), (s.contact.v, of.rate), (s.contact.q[3:5], of.length))
    return Similar(s, start, 0.5 * of.time, seen)


@more
def gyroscope(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.ball, s.spin = of.world(0, -9.81, 0), Spherical(), Revolute("x")
    s.bar = RigidBody.rod(4 * of.mass, of.vector(0.25, 0, 0), radius=0.025 * of.length)
    s.rotor = RigidBody.rod(12 * of.mass, of.vector(0.2, 0, 0), radius=0.05 * of.length)
    joined(s, (of.base(s.world), s.ball, s.bar.frame))
    s.connect(s.bar.at(of.vector(0.25, 0, 0), rotation=("y", np.pi / 4)), s.spin.frame_a)
    s.connect(s.spin.frame_b, s.rotor.at(of.vector(0.1, 0, 0)))
    return Similar(s, {s.spin.v: 500 * of.rate}, 0.5 * of.time, ((s.ball.q, 1.0), (s.ball.v, of.rate), (s.spin.v, of.rate)))


@more
def elastic_slider_crank(of: Units) -> Similar:
    """A driven crank and a rod that bends and stretches: stiff, and prescribed."""
    s: Any = ac.System()
    s.world, edge = of.world(0, 0, 0), 0.02 * of.length
    modulus, density = 2e7 * of.mass / of.length / of.time**2, 1000 * of.mass / of.length**3
    s.crank = RigidBody.rod(0.36 * of.mass, of.vector(0.15, 0, 0))
    s.rod = FlexibleBeam(
        0.3 * of.length, Section.rectangle(edge, edge), youngs_modulus=modulus, density=density, bending=(2, 0), axial=1,
        damping=1e-3 * of.time,
    )  # fmt: skip
    s.slider = RigidBody.box(0.1 * of.mass, of.vector(0.05, 0.03, 0.03))
    s.main, s.pin, s.wrist, s.guide = Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    s.drive = AngleSource(10 * of.rate * ac.time)
    joined(
        s,
        (of.base(s.world), s.main, s.crank.frame),
        (s.crank.tip, s.pin, s.rod.frame_a),
        (s.rod.frame_b, s.wrist, s.slider.frame),
        (of.base(s.world), s.guide, s.slider.frame),
    )
    s.connect(s.main.flange, s.drive.flange)
    start = {s.main.q: 0.0, s.pin.q: 0.0, s.guide.q: ac.near(0.45 * of.length)}
    return Similar(s, start, 0.5 * of.time, ((s.guide.q, of.length), (s.rod.q, of.length), (s.pin.q, 1.0)))


def volts(of: Units) -> float:
    """With 1 A for all."""
    return of.inertia / of.time**3


@more
def motor_drive(of: Units) -> Similar:
    """A circuit, its motor, an elastic gear, a pendulum; a diode across the winding."""
    s: Any = ac.System()
    V, s.world = volts(of), of.world(0, 0, -9.81)
    s.source, s.resistor, s.coil = VoltageSource(24 * V), Resistor(2 * V), Inductor(0.05 * V * of.time)
    s.motor, s.ground, s.rotor = ElectromotiveForce(0.8 * V * of.time), Ground(), Inertia(0.02 * of.inertia)
    s.diode = Diode(1e-6, 0.3 * V)
    s.gear = ElasticGear(5.0, 40 * of.torque, 0.5 * of.torque * of.time)
    s.hinge, s.rod = Revolute("y"), RigidBody.rod(2 * of.mass, of.vector(0, 0, -0.5))
    joined(s, (of.base(s.world), s.hinge, s.rod.frame))
    s.connect(s.source.pin_b, s.ground.pin)
    s.connect(s.source.pin_a, s.resistor.pin_a)
    s.connect(s.resistor.pin_b, s.coil.pin_a)
    s.connect(s.coil.pin_b, s.motor.pin_a)
    s.connect(s.motor.pin_b, s.ground.pin)
    s.connect(s.diode.pin_a, s.ground.pin)
    s.connect(s.diode.pin_b, s.motor.pin_a)
    s.connect(s.motor.flange, s.rotor.flange_a)
    s.connect(s.rotor.flange_b, s.gear.flange_a)
    s.connect(s.gear.flange_b, s.hinge.flange)
    return Similar(s, {s.hinge.q: 0.2}, 0.5 * of.time, ((s.hinge.q, 1.0), (s.rotor.w, of.rate), (s.coil.i, 1.0)))


@more
def planetary_drive(of: Units) -> Similar:
    """Sun and ring on shafts, the carrier on a pendulum."""
    s: Any = ac.System()
    s.world, s.gear = of.world(0, 0, -9.81), PlanetaryGear(2.5)
    s.sun, s.ring, s.motor = Inertia(0.03 * of.inertia), Inertia(0.2 * of.inertia), TorqueSource(0.4 * of.torque)
    s.hinge, s.rod, s.damper = (
        Revolute("y"),
        RigidBody.rod(of.mass, of.vector(0, 0, -1)),
        RotationalDamper(0.1 * of.torque * of.time),
    )
    s.still = RotationalGround()
    joined(s, (of.base(s.world), s.hinge, s.rod.frame))
    s.connect(s.motor.flange, s.sun.flange_a)
    s.connect(s.sun.flange_b, s.gear.sun)
    s.connect(s.ring.flange_b, s.gear.ring)
    s.connect(s.hinge.flange, s.gear.carrier)
    s.connect(s.still.flange, s.damper.flange_a)
    s.connect(s.damper.flange_b, s.ring.flange_a)
    return Similar(
        s, {s.hinge.q: 0.4, s.sun.w: 3 * of.rate}, of.time, ((s.hinge.q, 1.0), (s.sun.w, of.rate), (s.ring.w, of.rate))
    )


@more
def rack_on_a_pendulum(of: Units) -> Similar:
    """A length is tied to an angle, and to a mass on a spring."""
    s: Any = ac.System()
    s.world, s.hinge, s.rail = of.world(0, 0, -9.81), Revolute("y"), Prismatic("x")
    s.rod, s.cart = RigidBody.rod(of.mass, of.vector(0, 0, -1)), RigidBody.box(0.5 * of.mass, of.vector(0.2, 0.2, 0.2))
    s.rack, s.spring = RackAndPinion(0.3 * of.length), TranslationalSpring(20 * of.stiffness)
    s.block, s.damper, s.still = SlidingMass(0.2 * of.mass), TranslationalDamper(of.stiffness * of.time), TranslationalGround()
    joined(s, (of.base(s.world), s.hinge, s.rod.frame), (of.base(s.world, 0, 1, 0), s.rail, s.cart.frame))
    s.connect(s.hinge.flange, s.rack.pinion)
    s.connect(s.rack.rack, s.rail.flange)
    s.connect(s.rail.flange, s.spring.flange_a)
    s.connect(s.spring.flange_b, s.block.flange_a)
    s.connect(s.block.flange_b, s.damper.flange_a)
    s.connect(s.damper.flange_b, s.still.flange)
    seen = ((s.hinge.q, 1.0), (s.rail.q, of.length), (s.block.s, of.length))
    return Similar(s, {s.hinge.q: 0.5, s.block.s: 0.0}, of.time, seen)


@more
def cardan_shaft(of: Units) -> Similar:
    """Two universal joints and a shaft that slides between two shafts in bearings at an angle."""
    s: Any = ac.System()
    s.world = of.world(0, 0, -9.81)
    s.drive, s.driven = (RigidBody.cylinder(m * of.mass, 0.2 * of.length, 0.1 * of.length, "x") for m in (1, 2))
    s.one, s.two = (RigidBody.rod(0.3 * of.mass, of.vector(x, 0, 0), radius=0.03 * of.length) for x in (0.5, -0.5))
    s.bearing, s.far, s.slide = Revolute("x"), Revolute("x"), Prismatic("x")
    s.first, s.second = Universal("y", "z"), Universal("y", "z")
    angle = 0.35
    R, p = of.place
    turned = R @ np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    far = s.world.at(tuple(of.length * (R @ np.array([1.1, 0, -0.2]) + p)), turned)
    joined(
        s,
        (of.base(s.world), s.bearing, s.drive.frame),
        (s.drive.frame, s.first, s.one.frame),
        (s.one.frame, s.slide, s.two.frame),
        (far, s.far, s.driven.frame),
        (s.driven.frame, s.second, s.two.frame),
    )
    start = {s.bearing.q: 0.1, s.bearing.v: 4 * of.rate, s.slide.q: ac.near(1.1 * of.length)}
    return Similar(s, start, of.time, ((s.bearing.v, of.rate), (s.far.v, of.rate), (s.slide.q, of.length)))


@more
def three_rrr(of: Units) -> Similar:
    """A planar platform on three legs of two rods."""
    s: Any = ac.System()
    s.world, s.plate = of.world(0, -9.81, 0), RigidBody.cylinder(2 * of.mass, 0.3 * of.length, 0.05 * of.length)
    s.upper, s.lower = ([RigidBody.rod(m * of.mass, of.vector(0.7, 0, 0)) for _ in range(3)] for m in (1.0, 0.6))
    s.feet, s.knees, s.pins = ([Revolute("z") for _ in range(3)] for _ in range(3))
    for k in range(3):
        a = 2 * np.pi * k / 3 + 0.3
        joined(
            s,
            (of.base(s.world, np.cos(a), np.sin(a), 0), s.feet[k], s.upper[k].frame),
            (s.upper[k].tip, s.knees[k], s.lower[k].frame),
            (s.plate.at(of.vector(0.3 * np.cos(a), 0.3 * np.sin(a), 0)), s.pins[k], s.lower[k].tip),
        )
    start: dict[Any, Any] = {foot.q: 2 * np.pi * k / 3 + 2.5 for k, foot in enumerate(s.feet)}
    start |= {knee.q: ac.near(1.4) for knee in s.knees} | {s.feet[0].v: 0.5 * of.rate}
    return Similar(s, start, 0.5 * of.time, tuple((j.q, 1.0) for j in (*s.feet, *s.knees)))


@more
def andrews(of: Units) -> Similar:
    """Three loops, one spring, a torque; in millimetres, grams and milliseconds by birth."""
    s: Any = ac.System()
    s.world = of.world(0, 0, 0)
    K = [  # mass, inertia, centre
        (0.04325, 2.194e-6, (0.00092, 0)), (0.00365, 4.410e-7, (-0.0115, 0)), (0.02373, 5.255e-6, (0.01043, -0.01874)),
        (0.00706, 5.667e-7, (0, 0.01421 - 0.02)), (0.07050, 1.169e-5, (0.02308, -0.00916)), (0.00706, 5.667e-7, (0.02 - 0.01421, 0)),
        (0.05498, 1.912e-5, (-0.00449, -0.01228)),
    ]  # fmt: skip
    s.K = [RigidBody(m * of.mass, inertia(of, i / 2, i / 2, i), of.vector(*c, 0)) for m, i, c in K]
    s.joints = [Revolute("z") for _ in range(10)]
    C, F, B, A5, A7, G, H, E3, E4, E6 = s.joints
    k1, k2, k3, k4, k5, k6, k7 = s.K
    E = k3.at(of.vector(0, -0.035, 0))
    joined(
        s,
        (of.base(s.world), C, k1.frame),
        (k1.at(of.vector(0.007, 0, 0)), F, k2.frame),
        (of.base(s.world, -0.03635, 0.03273, 0), B, k3.frame),
        (of.base(s.world, -0.06934, -0.00227, 0), A5, k5.frame),
        (of.base(s.world, -0.06934, -0.00227, 0), A7, k7.frame),
        (k5.at(of.vector(0.04, 0, 0)), G, k4.frame),
        (k7.at(of.vector(0, -0.04, 0)), H, k6.frame),
        (E, E3, k2.at(of.vector(-0.028, 0, 0))),
        (E, E4, k4.at(of.vector(0, -0.02, 0))),
        (E, E6, k6.at(of.vector(0.02, 0, 0))),
    )
    s.spring, s.motor = (
        Spring(4530.0 * of.stiffness, 0.07785 * of.length),
        Torque(of.vector(0, 0, 0.033 * of.torque / of.length), resolved_in="body"),
    )
    s.connect(s.spring.point_a, k3.at(of.vector(0.02, -0.018, 0)))
    s.connect(s.spring.point_b, of.base(s.world, 0.014, 0.072, 0))
    s.connect(s.motor.frame, k1.frame)
    rough = {F: 0.0, B: 0.46, G: 0.22, A5: 0.49, H: -0.22, A7: 1.23}
    start = {C.q: -0.06171389, **{j.q: ac.near(a) for j, a in rough.items()}}
    return Similar(s, start, 0.02 * of.time, tuple((j.q, 1.0) for j in s.joints[:7]))


@more
def shaken_pendulum(of: Units) -> Similar:
    """Hangs from a frame that is led along and turned."""
    s: Any = ac.System()
    t = ac.time * of.rate
    s.world, s.ball, s.rod = (
        of.world(0, 0, -9.81),
        Spherical(),
        RigidBody.rod(of.mass, of.vector(0, 0, -1), radius=0.1 * of.length),
    )
    s.table = PrescribedMotion((0.1 * of.length * ca.sin(3 * t), 0.0, 0.05 * of.length * ca.cos(2 * t)), 0.3 * ca.sin(t), "x")
    s.connect(of.base(s.world), s.table.frame_a)
    s.connect(s.table.frame_b, s.ball.frame_a)
    s.connect(s.ball.frame_b, s.rod.frame)
    return Similar(s, {s.ball.v: [of.rate, 0, 0]}, of.time, ((s.ball.q, 1.0), (s.ball.v, of.rate)))


@more
def rolling_ball_in_a_plate(of: Units) -> Similar:
    """A ball between the floor and a plate that slides: two contacts in a loop."""
    s: Any = ac.System()
    s.world, s.low, s.high = of.world(0, 0, -9.81), RollingBall(0.2 * of.length), RollingBall(0.2 * of.length)
    s.ball, s.plate, s.slide = (
        RigidBody.ball(of.mass, 0.2 * of.length),
        RigidBody.box(2 * of.mass, of.vector(1, 1, 0.1)),
        Planar("z"),
    )
    joined(s, (of.base(s.world), s.low, s.ball.frame), (of.base(s.world, 0, 0, 0.4), s.slide, s.plate.frame))
    s.connect(s.plate.at((0, 0, 0), rotation=("x", np.pi)), s.high.frame_a)
    s.connect(s.high.frame_b, s.ball.frame)
    s.spring = Spring(30 * of.stiffness)
    s.connect(s.spring.point_a, of.base(s.world, 0.5, 0.2, 0.4))
    s.connect(s.spring.point_b, s.plate.frame)
    return Similar(
        s,
        {s.slide.v: [*(of.speed * np.array([0.3, 0.1])), 0.4 * of.rate]},
        0.5 * of.time,
        ((s.slide.q[0:2], of.length), (s.slide.q[2], 1.0), (s.low.v, of.rate)),
    )


@more
def rolling_torus(of: Units) -> Similar:
    s: Any = ac.System()
    s.world, s.contact = of.world(0, 0, -9.81), RollingTorus(0.3 * of.length, 0.1 * of.length)
    s.body = RigidBody(of.mass, inertia(of, 0.03, 0.05, 0.03))
    joined(s, (of.base(s.world), s.contact, s.body.frame))
    return Similar(
        s,
        {s.contact.v: [0.2 * of.rate, 4 * of.rate, 0.1 * of.rate]},
        of.time,
        ((s.contact.v, of.rate), (s.contact.q[3:5], of.length)),
    )


@more
def wheel_set(of: Units) -> Similar:
    """Two wheels on an axle that stays level: rows of the second wheel are given by the first."""
    s: Any = ac.System()
    s.world, s.level = of.world(0, 0, -9.81), Planar("z")
    s.axle = RigidBody(0.5 * of.mass, inertia(of, 0.01, 0.01, 0.01), of.vector(0.2, 0, 0))
    s.hinges, s.contacts = [Revolute("y") for _ in range(2)], [RollingDisk(0.1 * of.length) for _ in range(2)]
    s.wheels = [RigidBody(0.5 * of.mass, inertia(of, 0.002, 0.001, 0.002)) for _ in range(2)]
    joined(s, (of.base(s.world, 0, 0, 0.1), s.level, s.axle.frame))
    for side, hinge, wheel, contact in zip((0.25, -0.25), s.hinges, s.wheels, s.contacts, strict=True):
        joined(s, (s.axle.at(of.vector(0, side, 0)), hinge, wheel.frame), (of.base(s.world), contact, wheel.frame))
    s.motor = TorqueSource(0.02 * of.torque)
    s.connect(s.motor.flange, s.hinges[0].flange)
    start = {s.hinges[0].v: 3 * of.rate, s.hinges[1].v: 2 * of.rate}
    return Similar(s, start, of.time, ((s.level.q[0:2], of.length), (s.level.q[2], 1.0), (s.hinges[0].v, of.rate)))


@more
def strut(of: Units) -> Similar:
    """A bar on a hinge, held by a damper between two point masses on a ram: loop of cardan, slide and ball."""
    s: Any = ac.System()
    s.world, s.hinge, s.bar = (
        of.world(0, -9.81, 0),
        Revolute("z"),
        RigidBody.rod(3 * of.mass, of.vector(0.7, 0, 0), radius=0.03 * of.length),
    )
    line = np.array((0.7, 1.2, 0)) / np.hypot(0.7, 1.2)
    s.cardan, s.ram, s.ball = Universal("z", tuple(np.cross(line, (0, 0, 1)))), Prismatic(tuple(line)), Spherical()
    s.lower, s.upper = Fixed(of.vector(*(0.2 * line))), Fixed(of.vector(*(-0.2 * line)))
    s.mass_a, s.mass_b = Particle(of.mass), Particle(of.mass)
    s.damper, s.ground = TranslationalDamper(3 * of.stiffness * of.time), TranslationalGround()
    joined(
        s,
        (of.base(s.world, 0, 0.3, 0), s.hinge, s.bar.frame),
        (of.base(s.world, 0, -0.9, 0.1), s.cardan, s.lower.frame_a),
        (s.lower.frame_a, s.ram, s.upper.frame_a),
        (s.upper.frame_a, s.ball, s.bar.at(of.vector(0.7, 0, 0))),
    )
    s.connect(s.lower.frame_b, s.mass_a.point)
    s.connect(s.upper.frame_b, s.mass_b.point)
    s.connect(s.ram.flange, s.damper.flange_b)
    s.connect(s.ground.flange, s.damper.flange_a)
    return Similar(s, {s.hinge.q: 0.1}, of.time, ((s.hinge.q, 1.0), (s.ram.q, of.length)))


@more
def bevel_gear(of: Units) -> Similar:
    """A carrier that flies free, two shafts at right angles, a gear between them."""
    s: Any = ac.System()
    s.world, s.carrier, s.free = of.world(0, 0, 0), RigidBody.box(7.7 * of.mass, of.vector(0.3, 0.4, 0.5)), Free()
    s.first, s.second, s.gear = Revolute("x"), Revolute("y"), Gear(10.0)
    s.pinion, s.wheel = (
        RigidBody(3.0 * of.mass, inertia(of, 0.11, 0.06, 0.06)),
        RigidBody(5.0 * of.mass, inertia(of, 0.9, 1.7, 0.9)),
    )
    joined(
        s,
        (of.base(s.world), s.free, s.carrier.frame),
        (s.carrier.at(of.vector(0.2, 0, 0.1)), s.first, s.pinion.frame),
        (s.carrier.at(of.vector(0, 0.3, -0.1)), s.second, s.wheel.frame),
    )
    s.connect(s.first.flange, s.gear.flange_a)
    s.connect(s.second.flange, s.gear.flange_b)
    start = {s.first.v: 5 * of.rate, s.free.v: [0, 0.3 * of.rate, of.rate, 0, 0, 0]}
    return Similar(s, start, of.time, ((s.free.q[0:4], 1.0), (s.free.q[4:7], of.length), (s.first.q, 1.0)))


@more
def points_on_strings(of: Units) -> Similar:
    """Three particles on rods and springs, with drag that grows with the square of the speed."""
    s: Any = ac.System()
    s.world, s.a, s.b, s.c = (
        of.world(0, 0, -9.81),
        *(
            Particle(m * of.mass, position=at(of, *x))
            for m, x in ((1, (0.8, 0, -0.6)), (0.5, (0.8, 0.42, -1.16)), (2, (1.3, 0, -0.7)))
        ),
    )
    s.rod, s.rod2, s.spring = (
        Rod(of.length),
        Rod(0.7 * of.length),
        SpringDamper(40 * of.stiffness, 0.5 * of.length, 0.2 * of.stiffness * of.time),
    )
    s.drag = NonlinearDamper(lambda length, rate: 0.3 * of.mass / of.length * rate * ca.fabs(rate))
    s.law = NonlinearSpring(lambda length: 2 * of.torque * (length / (0.9 * of.length)) ** 4)
    for part, one, two in (
        (s.rod, of.base(s.world), s.a.point),
        (s.rod2, s.a.point, s.b.point),
        (s.spring, s.a.point, s.c.point),
        (s.drag, of.base(s.world, 0, 0, 1), s.b.point),
        (s.law, s.b.point, s.c.point),
    ):
        ends = (part.frame_a, part.frame_b) if isinstance(part, Rod) else (part.point_a, part.point_b)
        s.connect(one, ends[0])
        s.connect(two, ends[1])
    start = {
        s.a.point.position: at(of, 0.8, 0, -0.6),
        s.b.point.position: at(of, 0.8, 0.42, -1.16),
        s.c.point.position: at(of, 1.3, 0, -0.7),
    }
    start |= {point.velocity: (0, 0, 0) for point in (s.a.point, s.b.point, s.c.point)}
    d = s.a.point.position - s.b.point.position, s.c.point.position - s.b.point.position
    return Similar(
        s, start, of.time, ((d[0].T @ d[0], of.length**2), (d[0].T @ d[1], of.length**2), (d[1].T @ d[1], of.length**2))
    )


@more
def controlled_arm(of: Units) -> Similar:
    """A PID controller with its filter holds a pendulum."""
    s: Any = ac.System()
    s.world, s.hinge, s.rod = of.world(0, 0, -9.81), Revolute("y"), RigidBody.rod(of.mass, of.vector(0, 0, -1))
    s.wanted, s.sensor, s.motor = Constant(0.8), RotationSensor(), SignalTorque()
    s.pid = PID(30 * of.torque, 20 * of.torque / of.time, 6 * of.torque * of.time, filter_time=0.01 * of.time)
    joined(s, (of.base(s.world), s.hinge, s.rod.frame))
    s.connect(s.hinge.flange, s.sensor.flange)
    s.connect(s.hinge.flange, s.motor.flange)
    s.connect(s.wanted.output, s.pid.setpoint)
    s.connect(s.sensor.angle, s.pid.measurement)
    s.connect(s.pid.output, s.motor.signal)
    return Similar(s, {s.hinge.q: 0.0}, of.time, ((s.hinge.q, 1.0), (s.hinge.v, of.rate)))


@more
def rssr(of: Units) -> Similar:
    """Two cranks in planes at an angle, a coupler on two ball joints that may turn about itself."""
    s: Any = ac.System()
    s.world, s.a, s.d, s.b, s.c = of.world(0, 0, -9.81), Revolute("y"), Revolute("x"), Spherical(), Spherical()
    s.crank, s.rocker = RigidBody.rod(of.mass, of.vector(0.3, 0, 0)), RigidBody.rod(1.5 * of.mass, of.vector(0, 0, 0.9))
    s.coupler = RigidBody.rod(0.7 * of.mass, of.vector(1.2, 0, 0), radius=0.03 * of.length)
    joined(
        s,
        (of.base(s.world), s.a, s.crank.frame),
        (s.crank.tip, s.b, s.coupler.frame),
        (s.coupler.tip, s.c, s.rocker.tip),
        (of.base(s.world, 1.0, 0.4, -0.5), s.d, s.rocker.frame),
    )
    start = {s.a.q: 0.4, s.a.v: 3 * of.rate, s.d.q: ac.near(0.3)}
    return Similar(s, start, of.time, ((s.a.q, 1.0), (s.d.q, 1.0)))


@more
def crane(of: Units) -> Similar:
    """Slides in three directions, a cylindrical joint, a load on a spring, wind."""
    s: Any = ac.System()
    s.world, s.gantry, s.hook, s.load = (
        of.world(0, 0, -9.81),
        CartesianTranslation(),
        Cylindrical("y"),
        RigidBody.box(2 * of.mass, of.vector(0.3, 0.2, 0.1)),
    )
    s.trolley, s.holds = (
        RigidBody.box(5 * of.mass, of.vector(0.3, 0.3, 0.1)),
        [SpringDamper(200 * of.stiffness, 0.5 * of.length, 3 * of.stiffness * of.time) for _ in range(3)],
    )
    s.wind = Force(tuple(of.mass * of.length / of.time**2 * x for x in along(of, 3, 1, 0)))
    joined(s, (of.base(s.world), s.gantry, s.trolley.frame), (s.trolley.frame, s.hook, s.load.at(of.vector(0, 0, 0.6))))
    for hold, x in zip(s.holds, ((1, 0, 0), (0, 1, 0.1), (0, 0, 1)), strict=True):
        s.connect(of.base(s.world, *x), hold.point_a)
        s.connect(hold.point_b, s.trolley.frame)
    s.damper = Damper(2 * of.stiffness * of.time)
    s.connect(of.base(s.world, 0, -1, -1), s.damper.point_a)
    s.connect(s.damper.point_b, s.load.frame)
    s.connect(s.wind.point, s.load.frame)
    return Similar(
        s,
        {s.gantry.q: of.length * np.array([0.1, 0, -0.1]), s.hook.v: [2 * of.rate, 0.1 * of.speed]},
        of.time,
        ((s.gantry.q, of.length), (s.hook.q[0], 1.0), (s.hook.q[1], of.length)),
    )


@more
def scissors(of: Units) -> Similar:
    """Two crossed bars under a table that stays level: a loop over two slides, with a redundant row."""
    s: Any = ac.System()
    s.world = of.world(0, 0, -9.81)
    s.left, s.right, s.table = (
        RigidBody.rod(of.mass, of.vector(1, 0, 0)),
        RigidBody.rod(of.mass, of.vector(1, 0, 0)),
        RigidBody.box(3 * of.mass, of.vector(1, 0.5, 0.1)),
    )
    s.base, s.middle, s.foot, s.head, s.pin = (Revolute("y") for _ in range(5))
    s.slide, s.rail, s.spring = Prismatic("x"), Prismatic("x"), Spring(300 * of.stiffness)
    s.shoe, s.block = (RigidBody.box(0.1 * of.mass, of.vector(0.1, 0.1, 0.1)) for _ in range(2))
    joined(
        s,
        (of.base(s.world), s.base, s.left.frame),
        (s.left.at(of.vector(0.5, 0, 0)), s.middle, s.right.at(of.vector(0.5, 0, 0))),
        (s.table.frame, s.pin, s.right.tip),
        (s.table.frame, s.rail, s.block.frame),
        (s.block.frame, s.head, s.left.tip),
        (of.base(s.world), s.slide, s.shoe.frame),
        (s.shoe.frame, s.foot, s.right.frame),
    )
    s.connect(s.spring.point_a, of.base(s.world))
    s.connect(s.spring.point_b, s.right.frame)
    start = {s.base.q: -0.6, s.slide.q: ac.near(0.8 * of.length), s.foot.q: ac.near(-2.5), s.base.v: 0.3 * of.rate}
    return Similar(s, start, 0.3 * of.time, ((s.base.q, 1.0), (s.slide.q, of.length), (s.middle.q, 1.0)))


@more
def geared_bars(of: Units) -> Similar:
    """A five-bar whose cranks are geared: one loop of rods and a gear across it."""
    s: Any = ac.System()
    s.world, s.gear = of.world(0, 0, -9.81), Gear(-1.0)
    s.bars = [RigidBody.rod(of.mass, of.vector(x, 0, 0)) for x in (0.4, 0.9, 0.9, 0.4)]
    s.joints = [Revolute("y") for _ in range(5)]
    joined(
        s,
        (of.base(s.world), s.joints[0], s.bars[0].frame),
        (s.bars[0].tip, s.joints[1], s.bars[1].frame),
        (s.bars[1].tip, s.joints[2], s.bars[2].tip),
        (s.bars[3].tip, s.joints[3], s.bars[2].frame),
        (of.base(s.world, 0.8, 0, 0), s.joints[4], s.bars[3].frame),
    )
    s.connect(s.joints[0].flange, s.gear.flange_a)
    s.connect(s.gear.flange_b, s.joints[4].flange)
    start = {s.joints[0].v: 2 * of.rate, s.joints[1].q: ac.near(-1.2), s.joints[3].q: ac.near(1.2)}
    return Similar(s, start, 0.5 * of.time, tuple((j.q, 1.0) for j in s.joints))
