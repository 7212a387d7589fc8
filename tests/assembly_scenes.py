"""Mechanisms that are hard to assemble from a rough sketch, or in several ways; exact lengths, no rough poses."""

from __future__ import annotations

import numpy as np

import acausal as ac
from components import PrescribedMotion, Prismatic, Revolute, RigidBody, Spherical, Universal, World


def closed(scene: ac.System, *ends: tuple[ac.Frame, Revolute | Prismatic | Spherical | Universal, ac.Frame]) -> ac.System:
    """`scene` with each joint connected between its two frames."""
    for one, joint, two in ends:
        scene.connect(one, joint.frame_a)
        scene.connect(joint.frame_b, two)
    return scene


def arm(lengths: tuple[float, ...] = (1.0, 0.8), axis: str = "z") -> ac.System:
    """Rods on parallel hinges: an arm in a plane."""
    scene = ac.System()
    scene.world = World(None)
    scene.hinges = [Revolute(axis) for _ in lengths]
    scene.links = [RigidBody.rod(1.0, (length, 0, 0)) for length in lengths]
    starts = [scene.world.frame, *(link.tip for link in scene.links[:-1])]
    return closed(scene, *((s, h, link.frame) for s, h, link in zip(starts, scene.hinges, scene.links, strict=True)))


def snake(count: int = 30) -> ac.System:
    """A chain of links of 1 m on hinges about y and z in turn."""
    scene = ac.System()
    scene.world = World(None)
    scene.hinges = [Revolute("yz"[k % 2]) for k in range(count)]
    scene.links = [RigidBody.rod(1.0, (1.0, 0, 0)) for _ in range(count)]
    starts = [scene.world.frame, *(link.tip for link in scene.links[:-1])]
    return closed(scene, *((s, h, link.frame) for s, h, link in zip(starts, scene.hinges, scene.links, strict=True)))


def slider_crank(crank: ac.Parameter | float = 1.0, rod: ac.Parameter | float = 2.5) -> ac.System:
    """Crank and rod in the plane z = 0, slider along x; the slider is at x = r cos a + sqrt(l^2 - r^2 sin^2 a)."""
    scene = ac.System()
    scene.world, scene.a, scene.b, scene.c, scene.rail = World(None), Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    scene.crank, scene.rod = RigidBody.rod(1.0, (crank, 0, 0)), RigidBody.rod(1.0, (rod, 0, 0))
    scene.slider = RigidBody.box(1.0, (0.1, 0.1, 0.1))
    return closed(
        scene,
        (scene.world.frame, scene.a, scene.crank.frame),
        (scene.crank.tip, scene.b, scene.rod.frame),
        (scene.rod.tip, scene.c, scene.slider.frame),
        (scene.world.frame, scene.rail, scene.slider.frame),
    )


def five_bar() -> ac.System:
    """Two driven cranks a metre apart and two rods between: a planar five-bar."""
    scene = ac.System()
    scene.world = World(None)
    scene.hinges = [Revolute("z") for _ in range(5)]
    scene.bars = [RigidBody.rod(1.0, (x, 0, 0)) for x in (0.6, 1.0, 1.1, 0.5)]
    a, b, c, d = scene.bars
    h = scene.hinges
    return closed(
        scene,
        (scene.world.frame, h[0], a.frame),
        (a.tip, h[1], b.frame),
        (b.tip, h[2], c.tip),
        (d.tip, h[3], c.frame),
        (scene.world.at((1.0, 0, 0)), h[4], d.frame),
    )


def scissor_lift(stages: int = 10) -> ac.System:
    """Crossed bars of 1 m, hinged at their middles and ends; the lowest slides on the ground. One freedom."""
    scene = ac.System()
    scene.world = World(None)
    scene.left = [RigidBody.rod(1.0, (1.0, 0, 0)) for _ in range(stages)]
    scene.right = [RigidBody.rod(1.0, (1.0, 0, 0)) for _ in range(stages)]
    scene.middle, scene.one, scene.two = ([Revolute("y") for _ in range(stages)] for _ in range(3))
    scene.rail = Prismatic("x")
    scene.shoe = RigidBody.box(1.0, (0.1, 0.1, 0.1))
    ends = [
        (scene.world.frame, scene.one[0], scene.left[0].frame),
        (scene.world.frame, scene.rail, scene.shoe.frame),
        (scene.shoe.frame, scene.two[0], scene.right[0].frame),
    ]
    for k in range(stages):
        ends.append((scene.left[k].at((0.5, 0, 0)), scene.middle[k], scene.right[k].at((0.5, 0, 0))))
        if k:
            ends.append((scene.right[k - 1].tip, scene.one[k], scene.left[k].frame))
            ends.append((scene.left[k - 1].tip, scene.two[k], scene.right[k].frame))
    return closed(scene, *ends)


def stewart_platform() -> ac.System:
    """Six legs (universal, prismatic, ball) between a base of radius 1 and a platform of radius 0.6, both semi-regular hexagons."""
    scene = ac.System()
    scene.world = World(None)
    scene.platform = RigidBody.cylinder(5.0, 0.6, 0.05)
    scene.cardan = [Universal("x", "y") for _ in range(6)]
    scene.slide = [Prismatic("z") for _ in range(6)]
    scene.ball = [Spherical() for _ in range(6)]
    scene.lower = [RigidBody.rod(1.0, (0, 0, 0.5)) for _ in range(6)]
    scene.upper = [RigidBody.rod(1.0, (0, 0, -0.5)) for _ in range(6)]
    for k in range(6):
        base = np.deg2rad(120 * (k // 2) + (-1) ** k * 12)
        top = np.deg2rad(120 * (k // 2) + (-1) ** k * 48)
        closed(
            scene,
            (scene.world.at((float(np.cos(base)), float(np.sin(base)), 0)), scene.cardan[k], scene.lower[k].frame),
            (scene.lower[k].frame, scene.slide[k], scene.upper[k].frame),
            (
                scene.platform.at((0.6 * float(np.cos(top)), 0.6 * float(np.sin(top)), 0)),
                scene.ball[k],
                scene.upper[k].frame,
            ),
        )
    return scene


def puma() -> ac.System:
    """An arm of six hinges with the dimensions of the PUMA 560 [m]: shoulder offset 0.15, upper arm 0.43, elbow offset 0.02, forearm 0.43,
    and a wrist whose three axes cross in one point; the tip is 0.06 beyond it.
    """
    scene = ac.System()
    scene.world = World(None)
    scene.hinges = [Revolute(axis) for axis in ("z", "y", "y", "z", "y", "z")]
    ends = ((0, 0.15, 0), (0.43, 0, 0), (0.02, 0, 0.43), (0, 0, 0), (0, 0, 0), (0, 0, 0.06))
    scene.links = [RigidBody(1.0, (0.1, 0.1, 0.1)) for _ in ends]
    places = [scene.world.frame, *(link.at(end) for link, end in zip(scene.links, ends, strict=True))]
    scene.tool = places.pop()
    return closed(scene, *((a, h, link.frame) for a, h, link in zip(places, scene.hinges, scene.links, strict=True)))


def planar_platform(base: np.ndarray, platform: np.ndarray) -> ac.System:
    """3-RPR: a platform in the plane z = 0 on three legs (hinge, slider, hinge) from `base` to `platform`, both (3, 2) [m]."""
    scene = ac.System()
    scene.world = World(None)
    scene.platform = RigidBody.disk(1.0, 0.3)
    scene.foot, scene.leg, scene.head = (
        [Revolute("z") for _ in range(3)] if k != 1 else [Prismatic("x") for _ in range(3)] for k in range(3)
    )
    scene.lower = [RigidBody.rod(1.0, (0.1, 0, 0)) for _ in range(3)]
    scene.upper = [RigidBody.rod(1.0, (-0.1, 0, 0)) for _ in range(3)]
    for k in range(3):
        closed(
            scene,
            (scene.world.at((*base[k].tolist(), 0.0)), scene.foot[k], scene.lower[k].frame),
            (scene.lower[k].frame, scene.leg[k], scene.upper[k].frame),
            (scene.upper[k].frame, scene.head[k], scene.platform.at((*platform[k].tolist(), 0.0))),
        )
    return scene


def rssr() -> ac.System:
    """Spatial four-bar: a crank of 0.3 m about z, a rod of 0.9 m between two balls, a rocker of 0.6 m about the x axis at (0.8, 0.5, 0.1)."""
    scene = ac.System()
    scene.world, scene.a, scene.d = World(None), Revolute("z"), Revolute("x")
    scene.b, scene.c = Spherical(), Spherical()
    scene.crank, scene.rod, scene.rocker = (
        RigidBody.rod(1.0, (0.3, 0, 0)),
        RigidBody.rod(1.0, (0.9, 0, 0), radius=0.02),
        RigidBody.rod(1.0, (0, 0, 0.6)),
    )
    return closed(
        scene,
        (scene.world.frame, scene.a, scene.crank.frame),
        (scene.crank.tip, scene.b, scene.rod.frame),
        (scene.rod.tip, scene.c, scene.rocker.tip),
        (scene.world.at((0.8, 0.5, 0.1)), scene.d, scene.rocker.frame),
    )


def two_rods_to_a_driven_pivot(distance: object) -> ac.System:
    """Two rods, 1.3 m together, reach from the origin to a pivot that is driven to `distance` along x."""
    scene = ac.System()
    scene.world, scene.drive = World(None), PrescribedMotion(position=(distance, 0, 0))
    scene.a, scene.b, scene.c = (Revolute("z") for _ in range(3))
    scene.one, scene.two = RigidBody.rod(1.0, (0.7, 0, 0)), RigidBody.rod(1.0, (0.6, 0, 0))
    closed(
        scene,
        (scene.world.frame, scene.a, scene.one.frame),
        (scene.one.tip, scene.b, scene.two.frame),
        (scene.two.tip, scene.c, scene.drive.frame_b),
    )
    scene.connect(scene.world.frame, scene.drive.frame_a)
    return scene
