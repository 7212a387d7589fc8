"""What things move along is seen: nets on surfaces, as far as a motion comes."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.visual import shapes
from acausal.visual.geometry import rotated
from acausal.visual.scene import animation_of
from acausal.visual.shapes import PLANE_COLOUR, PointMass, Polygon, Wire
from components import (
    Cable,
    CentralField,
    Cone,
    Contact,
    ConvexShape,
    Cylinder,
    Ellipsoid,
    Hard,
    HeightField,
    ImplicitSurface,
    ParametricSurface,
    Particle,
    Plate,
    PointOnPlane,
    PointOnSurface,
    Prismatic,
    Pulley,
    Revolution,
    RigidBody,
    Rolling,
    RollingDisk,
    Sphere,
    Torus,
    World,
)
from components.geometry.net import net
from components.geometry.surfaces import AbstractSurface
from tests.pairings import each_value

Kind = tuple[Callable[[float], AbstractSurface], Callable[[np.ndarray, float], np.ndarray]]
KINDS: dict[str, Kind] = {
    "sphere": (lambda k: Sphere(0.7 * k, inside_out=True), lambda p, k: np.linalg.norm(p, axis=1) - 0.7 * k),
    "cylinder": (lambda k: Cylinder(0.6 * k), lambda p, k: np.hypot(p[:, 0], p[:, 1]) - 0.6 * k),
    "cone": (lambda k: Cone(0.5), lambda p, k: p[:, 2] * np.tan(0.5) - np.hypot(p[:, 0], p[:, 1])),
    "torus": (lambda k: Torus(0.5 * k, 0.2 * k), lambda p, k: np.hypot(np.hypot(p[:, 0], p[:, 1]) - 0.5 * k, p[:, 2]) - 0.2 * k),
    "field": (lambda k: HeightField(lambda x, y: x * y / k), lambda p, k: p[:, 2] - p[:, 0] * p[:, 1] / k),
    "plate": (lambda k: Plate(1.0 * k, 0.4 * k), lambda p, k: np.abs(p[:, 2]) + np.maximum(np.abs(p[:, 1]) - 0.2 * k, 0)),
    "ellipsoid": (lambda k: Ellipsoid((0.5 * k, 0.4 * k, 0.3 * k)), lambda p, k: k * (np.sum((p / [0.5, 0.4, 0.3] / k) ** 2, axis=1) - 1)),
    "convex": (lambda k: ConvexShape(lambda n: 0.3 * k * ca.norm_2(n)), lambda p, k: np.linalg.norm(p, axis=1) - 0.3 * k),
    "revolution": (
        lambda k: Revolution(lambda s: (k * ca.cos(s), 0.4 * k * ca.sin(s)), "rad", ends=(-1.2, 1.0)),
        lambda p, k: k * (np.hypot(p[:, 0], p[:, 1]) ** 2 / k**2 + (p[:, 2] / 0.4 / k) ** 2 - 1) + np.maximum(p[:, 2] - 0.4 * k * np.sin(1.0), 0),
    ),
    "implicit": (lambda k: ImplicitSurface(lambda x, y, z: (x / k) ** 2 + 2 * (y / k) ** 2 + (z / k) ** 4 - 0.2, (k, 0, 0)), lambda p, k: k * (p[:, 0] ** 2 / k**2 + 2 * p[:, 1] ** 2 / k**2 + (p[:, 2] / k) ** 4 - 0.2)),
    "parametric": (lambda k: ParametricSurface(lambda a, b: (a, b, (a**2 + 2 * b**2) / k), "m"), lambda p, k: p[:, 2] - (p[:, 0] ** 2 + 2 * p[:, 1] ** 2) / k),
}  # fmt: skip


@each_value(("size", [1e-3, 1.0, 1e3]), ("kind", KINDS))
def test_nets_lie_on_their_surfaces_and_go_on_beyond_the_motion(kind: str, size: float) -> None:
    make, off = KINDS[kind]
    path = size * (np.array([0.25, 0.2, 0.3]) + np.random.default_rng(2).uniform(-0.15, 0.15, (80, 3)))
    wires = net(make(size), path)
    points = np.vstack([wire.points for wire in wires])
    assert np.abs(off(points, size)).max() < 1e-12 * size
    assert len(wires) >= 20
    lowest, highest = points.min(axis=0), points.max(axis=0)
    if kind in ("field", "parametric", "cone"):  # seen from above
        assert (lowest[:2] < path.min(axis=0)[:2]).all() and (highest[:2] > path.max(axis=0)[:2]).all()
    if kind == "cylinder":
        assert lowest[2] < path[:, 2].min() and highest[2] > path[:, 2].max()
    assert np.abs(points).max() < 4 * size


def ball_in_a_bowl() -> ac.System:
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody(0.2, (2e-4, 2e-4, 2e-4))
    scene.bowl = Contact(Sphere(0.05), HeightField(lambda x, y: x**2 + y**2), Rolling())
    scene.connect(scene.world.at((0.3, 0, 1.0), rotation=("y", 0.2)), scene.bowl.frame_a)
    scene.connect(scene.bowl.frame_b, scene.ball.frame)
    return scene


def test_a_bowl_is_seen_under_its_ball_and_the_ball_by_what_touches() -> None:
    scene = ball_in_a_bowl()
    run = ac.build(scene).simulate(1.0, {scene.ball.frame.velocity[1]: 0.5})
    shown = animation_of(run)
    bowl, ball = (body for body in shown.bodies if all(isinstance(shape, Wire) for shape in body.shapes))
    assert bowl.shapes[0].colour == PLANE_COLOUR and np.ptp(bowl.positions, axis=0).max() == 0
    assert bowl.positions[0] == pytest.approx([0.3, 0, 1.0])
    assert ball.positions[-1] == pytest.approx(run[scene.ball.frame.position][-1], abs=1e-9)
    drawn = animation_of(ac.build(ball_of(scene)).simulate(0.1))
    assert sum(any(isinstance(shape, Wire) for shape in body.shapes) for body in drawn.bodies) == 1


def ball_of(scene: ac.System) -> ac.System:
    """The same with a body that has a shape of its own."""
    other = ac.System()
    other.world, other.ball, other.bowl = (
        World(),
        RigidBody.ball(0.2, 0.05),
        Contact(scene.bowl.shape, scene.bowl.surface, Rolling()),
    )
    other.connect(other.world.frame, other.bowl.frame_a)
    other.connect(other.bowl.frame_b, other.ball.frame)
    return other


@pytest.mark.parametrize(
    "guide",
    [PointOnSurface(Torus(0.5, 0.2)), PointOnSurface(Cone(0.5), unilateral=True), Contact(Sphere(0.01), Cylinder(0.4), Hard())],
)
def test_what_guides_points_and_what_is_struck_is_seen(guide: ac.System) -> None:
    scene = ac.System()
    scene.world, scene.guide, scene.stone = World(), guide, RigidBody.ball(1.0, 0.01)
    scene.connect(scene.world.frame, scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.stone.frame)
    start = {scene.stone.frame.position: (0.41, 0.0, 0.9)} if not isinstance(guide, PointOnSurface) else {}
    shown = animation_of(ac.build(scene).simulate(0.1, start))
    assert sum(all(isinstance(shape, Wire) for shape in body.shapes) for body in shown.bodies) == 1


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_plane_is_seen_as_a_patch_under_what_moves_on_it_and_once_under_all(size: float) -> None:
    """An incline, on which each of four feet has a frame of its own, and a floor, on which a wheel without a shape is seen by what rolls."""
    scene = ac.System()
    scene.world, scene.wheel = World(), RigidBody(1.0, (0.02 * size**2, 0.04 * size**2, 0.02 * size**2))
    scene.rolls = RollingDisk(0.3 * size)
    scene.box, scene.feet = RigidBody.box(1.0, (size, size, 0.1 * size)), [PointOnPlane(unilateral=True) for _ in range(4)]
    for foot, (x, y) in zip(scene.feet, size * np.array([(0.4, 0.4), (0.4, -0.4), (-0.4, 0.4), (-0.4, -0.4)]), strict=True):
        scene.connect(scene.world.at((x * np.cos(0.4), y, -x * np.sin(0.4)), rotation=("y", 0.4)), foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x, y, 0.0)))
    scene.connect(scene.world.frame, scene.rolls.frame_a)
    scene.connect(scene.rolls.frame_b, scene.wheel.frame)
    start = {scene.rolls.v: (0, 2.0 / np.sqrt(size), 0), scene.box.frame.position: (0, 0, size)}
    run = ac.build(scene).simulate(0.3 * np.sqrt(size), start)
    bodies = animation_of(run).bodies
    floor, incline = (
        body
        for name in ("rolls", "feet")
        for body in bodies
        if body.name.startswith(name) and isinstance(body.shapes[0], shapes.Plane)
    )
    assert any(isinstance(shape, shapes.Disk) for body in bodies if body.name == "rolls" for shape in body.shapes)
    for body, places in (
        (floor, run[scene.wheel.frame.position]),
        (incline, np.vstack([run[foot.point_b] for foot in scene.feet])),
    ):
        plane = body.shapes[0]
        seen = rotated(body.quaternions[:1] * [1, -1, -1, -1], places - body.positions[0]) - np.array(plane.point)
        assert np.abs(seen[:, :2]).max() < 0.5 * plane.size < 3 * size


def test_satellites_and_weights_off_their_hinges_are_seen_and_long_motions_move() -> None:
    scene = ac.System()
    scene.world, scene.earth, scene.satellite = World(gravity=None), CentralField(4e14), RigidBody.box(500.0, (1, 2, 5))
    scene.connect(scene.world.frame, scene.earth.frame)
    f = scene.satellite.frame
    shown = animation_of(ac.build(scene).simulate(6000.0, {f.position: (7e6, 0, 0), f.velocity: (0, 7500, 0)}, samples=50))
    assert any(isinstance(shape, PointMass) for shape in shown.bodies[0].shapes) and shown.speed == 100
    other = ac.System()
    other.world, other.slide = World(), Prismatic("z")
    other.weight = RigidBody(2.0, (1.0, 1.0, 1.0), centre_of_mass=(0, 0.3, -0.4))
    other.connect(other.world.frame, other.slide.frame_a)
    other.connect(other.slide.frame_b, other.weight.frame)
    (weight,) = animation_of(ac.build(other).simulate(1.0)).bodies
    assert weight.shapes == (Polygon(((0.0, 0.0, 0.0), (0.0, 0.3, -0.4))),)


def test_a_pulley_is_seen_though_its_wheel_has_no_shape() -> None:
    for wheel, rings in ((RigidBody(1.0, (0.01, 0.02, 0.01)), 1), (RigidBody.cylinder(1.0, 0.2, 0.05, "y"), 0)):
        scene = ac.System()
        scene.world, scene.wheel, scene.stones = World(), wheel, [Particle(1.0), Particle(2.0)]
        scene.rope = Cable(3.0, over=(Pulley(scene.world.at((0, 0, 2.0)), 0.2, middle="z", along="-x", wheel=scene.wheel),))
        scene.connect(scene.rope.frame_a, scene.stones[0].point)
        scene.connect(scene.rope.frame_b, scene.stones[1].point)
        start = {
            scene.stones[0].point.position: (0.2, 0, 0.8),
            scene.stones[1].point.position[0]: -0.2,
            scene.stones[1].point.position[1]: 0.0,
        }
        shown = animation_of(ac.build(scene).simulate(0.1, start))
        assert (sum(type(shape).__name__ == "Torus" for body in shown.bodies for shape in body.shapes) > 0) == bool(rings)
