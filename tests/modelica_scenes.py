"""Scenes of Modelica.Mechanics.MultiBody.Examples with their parameters (Modelica Standard Library 4.0), composed from our parts.

Steel bodies have 7700 kg/m^3, the library's default; gravity is (0, -9.81, 0), its default too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import acausal as ac
from components import (
    AngleSource,
    Fixed,
    Force,
    Gear,
    Inertia,
    Particle,
    Planar,
    Prismatic,
    Revolute,
    RigidBody,
    RollingDisk,
    RotationalDamper,
    RotationalGround,
    Spherical,
    Spring,
    TorqueSource,
    TranslationalDamper,
    TranslationalGround,
    TranslationalSpring,
    Universal,
    World,
)
from examples.engine import CRANK, ROD, GasForce, steel_bar, steel_cylinder

DOWN = (0.0, -9.81, 0.0)


def join(scene: ac.System, a: ac.Point, joint: ac.System | object, b: ac.Point) -> None:
    """Connect a to the joint's frame_a and its frame_b to b."""
    scene.connect(a, joint.frame_a)
    scene.connect(joint.frame_b, b)


def square_bar(tip: tuple[float, float, float], side: float) -> RigidBody:
    """A steel bar in the plane of x and y with a square section."""
    return steel_bar(tip, side, side, (0.0, 0.0, 1.0))


PHASES, LEANS = np.radians((-30, 90, 210, 210, 90, -30)), np.radians((-30, 30, -30, 30, -30, 30))


def engine_v6(gas: bool = False) -> ac.System:
    """Loops.EngineV6: six of the one-cylinder engine's cranks on one shaft, at the angles PHASES; cylinders lean by LEANS. Six loops."""
    x = (1.0, 0.0, 0.0)
    scene = ac.System()
    scene.world, scene.bearing, scene.load = World(gravity=DOWN), Revolute("x"), Inertia(1.0)
    scene.shaft, scene.webs = steel_cylinder((1.2, 0, 0), 0.05), [steel_bar((0, CRANK, 0), 0.02, 0.05, x) for _ in range(6)]
    scene.rods, scene.pistons = (
        [steel_bar((0, -ROD, 0), 0.02, 0.06, x) for _ in range(6)],
        [steel_cylinder((0, -0.1, 0), 0.1) for _ in range(6)],
    )
    scene.crank_pins, scene.piston_pins = [Revolute("x") for _ in range(6)], [Revolute("x") for _ in range(6)]
    scene.cylinders = [Prismatic((0, -1, 0)) for _ in range(6)]
    join(scene, scene.world.frame, scene.bearing, scene.shaft.frame)
    scene.connect(scene.bearing.flange, scene.load.flange_a)
    for k in range(6):
        web, rod, piston, cylinder = scene.webs[k], scene.rods[k], scene.pistons[k], scene.cylinders[k]
        top = (0.2 * k + 0.05, 0.45 * np.cos(LEANS[k]), 0.45 * np.sin(LEANS[k]))
        scene.connect(scene.shaft.at((0.2 * k, 0, 0), rotation=("x", PHASES[k])), web.frame)
        join(scene, web.at((0.05, CRANK, 0)), scene.crank_pins[k], rod.at((0, -ROD, 0)))
        join(scene, piston.tip, scene.piston_pins[k], rod.frame)
        join(scene, scene.world.at(top, rotation=("x", LEANS[k])), cylinder, piston.frame)
    if gas:
        scene.gas = [GasForce() for _ in range(6)]
        for force, cylinder in zip(scene.gas, scene.cylinders, strict=True):
            scene.connect(force.flange, cylinder.flange)
    return scene


def fourbar1() -> ac.System:
    """Loops.Fourbar1: a spatial loop of six hinges and a slider. `j1.q` turns the crank, `j2.q` is where the slider is."""
    scene = ac.System()
    scene.world = World(gravity=DOWN)
    scene.j1, scene.j2, scene.rev, scene.rev1 = Revolute("x"), Prismatic("x"), Revolute("y"), Revolute("z")
    scene.j3, scene.j4, scene.j5 = Revolute("x"), Revolute("y"), Revolute("z")
    scene.b1, scene.b2, scene.b3 = (steel_cylinder(tip, 0.05) for tip in ((0, 0.5, 0.1), (0, 0.2, 0), (-1, 0.3, 0.1)))
    join(scene, scene.world.frame, scene.j1, scene.b1.frame)
    join(scene, scene.world.at((1.2, 0, 0)), scene.j2, scene.b2.frame)
    scene.connect(scene.b2.tip, scene.rev.frame_a)
    scene.connect(scene.rev.frame_b, scene.rev1.frame_a)
    scene.connect(scene.rev1.frame_b, scene.b3.frame)
    scene.connect(scene.b1.tip, scene.j3.frame_a)
    scene.connect(scene.j3.frame_b, scene.j4.frame_a)
    scene.connect(scene.j4.frame_b, scene.j5.frame_a)
    scene.connect(scene.j5.frame_b, scene.b3.tip)
    return scene


def fourbar2() -> ac.System:
    """Loops.Fourbar2: the coupler is a rod without mass between a universal and a spherical joint."""
    scene = ac.System()
    scene.world = World(gravity=DOWN)
    scene.j1, scene.j2 = Revolute("x"), Prismatic("x")
    scene.b1, scene.b2 = (steel_cylinder(tip, 0.05) for tip in ((0, 0.5, 0.1), (0, 0.2, 0)))
    rod = np.array((-1, 0.3, 0.1))
    scene.cardan, scene.ball, scene.rod = Universal("y", tuple(np.cross(rod, (0, 1, 0)))), Spherical(), Fixed(tuple(rod))
    join(scene, scene.world.frame, scene.j1, scene.b1.frame)
    join(scene, scene.world.at((1.2, 0, 0)), scene.j2, scene.b2.frame)
    join(scene, scene.b2.tip, scene.cardan, scene.rod.frame_a)
    join(scene, scene.rod.frame_b, scene.ball, scene.b1.tip)
    return scene


def planar_fourbar() -> ac.System:
    """Loops.PlanarFourbar: four hinges about z, a damper on the first."""
    scene = ac.System()
    scene.world = World(gravity=DOWN)
    scene.crank, scene.coupler, scene.rocker = (square_bar(tip, 0.05) for tip in ((0.4, 0, 0), (0.1, 1.1, 0), (0.65, 0.1, 0)))
    scene.a, scene.b, scene.c, scene.d = (Revolute("z") for _ in range(4))
    scene.damper, scene.ground = RotationalDamper(0.1), RotationalGround()
    join(scene, scene.world.frame, scene.a, scene.crank.frame)
    join(scene, scene.crank.at((0.4, 0, 0)), scene.b, scene.coupler.frame)
    join(scene, scene.world.at((-0.15, 1, 0)), scene.c, scene.rocker.frame)
    join(scene, scene.rocker.at((0.65, 0.1, 0)), scene.d, scene.coupler.at((0.1, 1.1, 0)))
    scene.connect(scene.a.flange, scene.damper.flange_b)
    scene.connect(scene.ground.flange, scene.damper.flange_a)
    return scene


def line_force_with_two_masses() -> ac.System:
    """Elementary.LineForceWithTwoMasses: a bar on a hinge, held by a strut of two point masses with a damper between them."""
    scene = ac.System()
    scene.world = World(gravity=DOWN)
    scene.hinge, scene.bar = Revolute("z"), square_bar((0.7, 0, 0), 0.035)
    along = np.array((0.7, 1.2, 0)) / np.hypot(0.7, 1.2)
    scene.cardan, scene.ram, scene.ball = Universal("z", tuple(np.cross(along, (0, 0, 1)))), Prismatic(tuple(along)), Spherical()
    scene.lower, scene.upper = Fixed(tuple(0.2 * along)), Fixed(tuple(-0.2 * along))
    scene.mass_a, scene.mass_b = Particle(1.0), Particle(1.0)
    scene.damper, scene.ground = TranslationalDamper(3.0), TranslationalGround()
    join(scene, scene.world.at((0, 0.3, 0)), scene.hinge, scene.bar.frame)
    join(scene, scene.world.at((0, -0.9, 0)), scene.cardan, scene.lower.frame_a)
    join(scene, scene.lower.frame_a, scene.ram, scene.upper.frame_a)
    join(scene, scene.upper.frame_a, scene.ball, scene.bar.at((0.7, 0, 0)))
    scene.connect(scene.lower.frame_b, scene.mass_a.point)
    scene.connect(scene.upper.frame_b, scene.mass_b.point)
    scene.connect(scene.ram.flange, scene.damper.flange_b)
    scene.connect(scene.ground.flange, scene.damper.flange_a)
    return scene


def bevel_gear(ratio: float = 10.0, gravity: tuple[float, float, float] | None = None) -> ac.System:
    """As Rotational3DEffects.BevelGear1D, with disks for rotors: a free carrier, two shafts at right angles, a gear between them."""
    scene = ac.System()
    scene.world, scene.carrier = World(gravity=gravity), RigidBody.box(7.7, (0.3, 0.4, 0.5))
    scene.first, scene.second, scene.gear = Revolute("x"), Revolute("y"), Gear(ratio)
    scene.pinion, scene.wheel = RigidBody(3.0, (0.11, 0.06, 0.06)), RigidBody(5.0, (0.9, 1.7, 0.9))
    join(scene, scene.carrier.at((0.2, 0, 0.1)), scene.first, scene.pinion.frame)
    join(scene, scene.carrier.at((0, 0.3, -0.1)), scene.second, scene.wheel.frame)
    scene.connect(scene.first.flange, scene.gear.flange_a)
    scene.connect(scene.second.flange, scene.gear.flange_b)
    return scene


def free_body() -> ac.System:
    """Elementary.FreeBody: a body on two springs without natural length."""
    scene = ac.System()
    scene.world = World(gravity=DOWN)
    scene.body = RigidBody(1.0, (1.0, 1.0, 1.0), (0.2, 0, 0))
    scene.left, scene.right = Spring(20.0), Spring(20.0)
    scene.connect(scene.left.point_a, scene.world.frame)
    scene.connect(scene.left.point_b, scene.body.frame)
    scene.connect(scene.right.point_a, scene.world.at((0.8, 0, 0)))
    scene.connect(scene.right.point_b, scene.body.at((0.4, 0, 0)))
    return scene


def spring_mass_system() -> ac.System:
    """Elementary.SpringMassSystem: the same twice, a spring on the joint's flange, and a spring between points."""
    scene = ac.System()
    scene.world, scene.p1, scene.p2 = World(gravity=DOWN), Prismatic((0, -1, 0)), Prismatic((0, -1, 0))
    scene.body1, scene.body2 = Particle(1.0), Particle(1.0)
    scene.spring1, scene.spring2, scene.ground = TranslationalSpring(30.0, 0.1), Spring(30.0, 0.1), TranslationalGround()
    join(scene, scene.world.at((0.3, 0, 0)), scene.p1, scene.body1.point)
    join(scene, scene.world.at((0.6, 0, 0)), scene.p2, scene.body2.point)
    scene.connect(scene.ground.flange, scene.spring1.flange_a)
    scene.connect(scene.p1.flange, scene.spring1.flange_b)
    scene.connect(scene.spring2.point_a, scene.world.at((0.6, 0, 0)))
    scene.connect(scene.spring2.point_b, scene.body2.point)
    return scene


def rolling_wheel() -> ac.System:
    """Elementary.RollingWheel: a wheel on the plane z = 0."""
    scene = ac.System()
    scene.world, scene.wheel, scene.contact = World(), RigidBody(2.0, (0.12, 0.06, 0.12)), RollingDisk(0.3)
    join(scene, scene.world.frame, scene.contact, scene.wheel.frame)
    return scene


def rolling_wheel_set(
    torques: Callable[[Any], Any] | None = None, force: Callable[[Any], Any] | None = None, ahead: float = 0.2
) -> ac.System:
    """Elementary.RollingWheelSetDriving and -Pulling: two wheels on an axle that stays level, a small body `ahead` of it [m].

    `torques`: (left, right) [N*m] at a time; `force`: (3,) [N] on the small body.
    """
    scene = ac.System()
    scene.world, scene.level, scene.axle = World(), Planar("z"), RigidBody(0.01, (0.001, 0.001, 0.001), (ahead, 0, 0))
    scene.hinges, scene.contacts = [Revolute("y") for _ in range(2)], [RollingDisk(0.1) for _ in range(2)]
    scene.wheels = [RigidBody(0.5, (0.02, 0.01, 0.02)) for _ in range(2)]
    join(scene, scene.world.at((0, 0, 0.1)), scene.level, scene.axle.frame)
    for side, hinge, wheel, contact in zip((0.25, -0.25), scene.hinges, scene.wheels, scene.contacts, strict=True):
        join(scene, scene.axle.at((0, side, 0)), hinge, wheel.frame)
        join(scene, scene.world.frame, contact, wheel.frame)
    if torques is not None:
        scene.motors = [TorqueSource(lambda t, k=k: torques(t)[k]) for k in range(2)]
        for motor, hinge in zip(scene.motors, scene.hinges, strict=True):
            scene.connect(motor.flange, hinge.flange)
    if force is not None:
        scene.pull = Force(force)
        scene.connect(scene.pull.point, scene.axle.centre)
    return scene


def init_spring_constant(stiffness: ac.Parameter) -> ac.System:
    """Elementary.InitSpringConstant: a bar on a damped hinge, held by a spring from above."""
    scene = ac.System()
    scene.world, scene.hinge, scene.bar = World(gravity=DOWN), Revolute("z"), RigidBody(1.0, (0.001,) * 3, (0.5, 0, 0))
    scene.spring, scene.damper, scene.ground = Spring(stiffness, 0.1), RotationalDamper(0.1), RotationalGround()
    join(scene, scene.world.frame, scene.hinge, scene.bar.frame)
    scene.connect(scene.spring.point_a, scene.world.at((1, 0.2, 0)))
    scene.connect(scene.spring.point_b, scene.bar.at((1, 0, 0)))
    scene.connect(scene.ground.flange, scene.damper.flange_a)
    scene.connect(scene.damper.flange_b, scene.hinge.flange)
    return scene


def double_pendulum() -> ac.System:
    """Elementary.DoublePendulum: two bars on hinges about z, the first one damped. `tip`: the end of the second."""
    scene = ac.System()
    scene.world, scene.revolute1, scene.revolute2 = World(gravity=DOWN), Revolute("z"), Revolute("z")
    scene.box1, scene.box2 = square_bar((0.5, 0, 0), 0.06), square_bar((0.5, 0, 0), 0.06)
    scene.damper, scene.ground, scene.tip = RotationalDamper(0.1), RotationalGround(), scene.box2.at((0.5, 0, 0))
    join(scene, scene.world.frame, scene.revolute1, scene.box1.frame)
    join(scene, scene.box1.at((0.5, 0, 0)), scene.revolute2, scene.box2.frame)
    scene.connect(scene.ground.flange, scene.damper.flange_a)
    scene.connect(scene.damper.flange_b, scene.revolute1.flange)
    return scene


PLANAR_LOOPS = ((0.1, 0.5, 0), (0.1, 0.6, 0), (0, 0.55, 0))  # from the lower to the upper hinge of each loop's right side


def planar_loops(angle: Callable[[Any], Any]) -> ac.System:
    """Loops.PlanarLoops_analytic: three plane loops in a row, the first crank turned by a given angle; 1 kg on each coupler, the other rods without mass.

    The lower hinges are 0.5 m apart; `sides[k]` and `couplers[k]` are the rods of loop k, their hinges at one pin above.
    """
    scene = ac.System()
    scene.world, scene.rev, scene.drive = World(gravity=DOWN), Revolute("z"), AngleSource(angle)
    scene.crank, scene.sides = Fixed((0, 0.5, 0)), [Fixed(right) for right in PLANAR_LOOPS]
    left = [(0, 0.5, 0), *PLANAR_LOOPS[:2]]
    scene.spans = [tuple(np.array(b) - np.array(a) + np.array((0.5, 0, 0))) for a, b in zip(left, PLANAR_LOOPS, strict=True)]
    scene.couplers = [RigidBody(1.0, (1e-3,) * 3, tuple(np.array(span) / 2)) for span in scene.spans]
    scene.lower, scene.upper, scene.pins = ([Revolute("z") for _ in range(3)] for _ in range(3))
    join(scene, scene.world.frame, scene.rev, scene.crank.frame_a)
    scene.connect(scene.drive.flange, scene.rev.flange)
    end = scene.crank.frame_b
    for k in range(3):
        join(scene, scene.world.at((0.5 * (k + 1), 0, 0)), scene.lower[k], scene.sides[k].frame_a)
        join(scene, end, scene.upper[k], scene.couplers[k].frame)
        join(scene, scene.couplers[k].at(scene.spans[k]), scene.pins[k], scene.sides[k].frame_b)
        end = scene.sides[k].frame_b
    return scene
