"""Ropes around pulleys: lengths by geometry, motions by closed forms and by Lagrange's equations, at any size."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import ParameterError
from acausal.parts.pose import Pose
from components import (
    Cable,
    CommonTangent,
    Particle,
    Prismatic,
    Pulley,
    RackAndPinion,
    Revolute,
    RigidBody,
    Tangent,
    TorqueSource,
    World,
)
from tests.pairings import each_value

G = 9.81
SIZES = [1e-3, 1.0, 1e3]


def circle_points(centre: np.ndarray, radius: float, n: int = 20001) -> np.ndarray:
    a = np.linspace(0, 2 * np.pi, n)
    return centre + radius * np.column_stack([np.cos(a), np.sin(a)])


def perimeter(points: np.ndarray) -> float:
    """Of the convex hull: a rubber band around."""
    from scipy.spatial import ConvexHull

    return float(ConvexHull(points).area)


def coordinate(piece: Tangent | CommonTangent, p: np.ndarray, angle: float = 0.0) -> float:
    """Its length, frame_b at p in the plane z, x, turned about y."""
    c, s = np.cos(angle), np.sin(angle)
    X = Pose(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.array([p[0], 0.0, p[1]]))
    return float(ca.evalf(piece.coordinate(X)))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("turned", [0.0, 0.7, -2.0])
def test_a_belt_around_two_pulleys_is_as_long_as_a_rubber_band(size: float, turned: float) -> None:
    frame = World().frame
    p, r, R = np.array([0.9, 0.3]) * size, 0.2 * size, 0.45 * size
    # over the tops one way, under the bottoms back; the second pulley's frame is turned
    c, s = np.cos(turned), np.sin(turned)

    def seen(v: tuple[float, float, float]) -> tuple[float, float, float]:
        return (c * v[0] - s * v[2], v[1], s * v[0] + c * v[2])

    over = CommonTangent(Pulley(frame, r), Pulley(frame, R, seen((0, 0, 1)), seen((1, 0, 0))))
    under = CommonTangent(Pulley(frame, r, (0, 0, -1), (1, 0, 0)), Pulley(frame, R, seen((0, 0, -1)), seen((1, 0, 0))))
    halves = 0.5 * np.pi * 2 * (r + R)  # from the tops to the bottoms
    found = coordinate(over, p, turned) + coordinate(under, p, turned) + halves
    wanted = perimeter(np.vstack([circle_points(np.zeros(2), r), circle_points(p, R)]))
    assert abs(found - wanted) < 1e-7 * size


@pytest.mark.parametrize("size", SIZES)
def test_a_crossed_belt_has_its_known_length(size: float) -> None:
    frame, d, r, R = World().frame, 1.3 * size, 0.2 * size, 0.45 * size
    down = CommonTangent(Pulley(frame, r), Pulley(frame, R, (0, 0, -1), (1, 0, 0)))
    up = CommonTangent(Pulley(frame, r, (0, 0, -1), (1, 0, 0)), Pulley(frame, R))
    found = coordinate(down, np.array([d, 0.0])) + coordinate(up, np.array([d, 0.0])) + np.pi * (r + R)
    wanted = 2 * np.sqrt(d**2 - (r + R) ** 2) + (r + R) * (np.pi + 2 * np.arcsin((r + R) / d))
    assert abs(found - wanted) < 1e-14 * size * 10


@each_value(("size", SIZES), ("mass", [0.0, 3.0]), ("turned", [False, True]))
def test_atwoods_machine_with_a_pulley(size: float, mass: float, turned: bool) -> None:
    """a = g (m1 - m2) / (m1 + m2 + J / r^2), whichever end comes first; two pulls where the pulley has inertia."""
    m1, m2, r = 2.0, 1.0, 0.2 * size
    scene: Any = ac.System()
    scene.world, scene.one, scene.two = World((0, 0, -G * size)), Particle(m1), Particle(m2)
    wheel = RigidBody.disk(mass, r, axis="y") if mass else None
    if wheel:
        scene.wheel = wheel
    scene.rope = Cable(3 * size, over=(Pulley(scene.world.frame, r, along=(-1, 0, 0) if turned else (1, 0, 0), wheel=wheel),))
    first, second = (scene.rope.frame_b, scene.rope.frame_a) if turned else (scene.rope.frame_a, scene.rope.frame_b)
    scene.connect(first, scene.one.point)
    scene.connect(second, scene.two.point)
    heights = -size, size + np.pi * r - 3 * size
    start = {scene.one.point.position: (-r, 0, heights[0]), scene.two.point.position: (r, 0, heights[1])}
    run = ac.build(scene).simulate(0.5, start, rtol=1e-11)
    a = G * size * (m1 - m2) / (m1 + m2 + mass / 2)
    assert (
        np.max(
            np.abs(run[scene.one.point.position] - np.column_stack([-r + 0 * run.t, 0 * run.t, heights[0] - a * run.t**2 / 2]))
        )
        < 1e-12 * size
    )
    pulls = np.atleast_2d(run[scene.rope.tension].T).T
    wanted = [m1 * (G * size - a), m2 * (G * size + a)] if wheel else [m1 * (G * size - a)]
    assert np.max(np.abs(pulls - (wanted[::-1] if turned else wanted))) < 1e-12 * G * size * 10
    if wheel:
        phi = run[scene.rope.hinges[0].q]
        assert np.max(np.abs(phi - (0.5 if turned else -0.5) * a * run.t**2 / r)) < 1e-11
    assert run.energy_error() < 1e-12 and run.constraint_error() < 1e-13 * max(size, 1.0)


@pytest.mark.parametrize("size", SIZES)
def test_a_pendulum_winds_itself_around_a_cylinder(size: float) -> None:
    """On a rope of free length l = l0 - r theta, its place is r n - l t: l^2 theta'' = r l theta'^2 - dV/dtheta / m; velocity l theta' across the rope."""
    r, whole = 0.2, 1.5
    scene: Any = ac.System()
    scene.world, scene.bob = World((0, 0, -G * size)), Particle(2.0)
    scene.rope = Cable((2.0 + whole) * size, over=(Pulley(scene.world.frame, r * size),))
    scene.connect(scene.world.at((-2.0 * size, 0, r * size)), scene.rope.frame_a)
    scene.connect(scene.rope.frame_b, scene.bob.point)

    def place(a: np.ndarray) -> np.ndarray:
        """a: how far the rope's end has turned from along x downwards; the arc is r a."""
        free = whole - r * a
        return np.array([r * np.sin(a) + free * np.cos(a), 0 * a, r * np.cos(a) - free * np.sin(a)])

    def fall(t: float, y: np.ndarray) -> list[float]:
        free = whole - r * y[0]
        # V = m g z, dz/da = -free cos(a)
        return [y[1], (r * free * y[1] ** 2 + G * free * np.cos(y[0])) / free**2]

    a0 = 0.6
    run = ac.build(scene).simulate(
        2.0, {scene.bob.point.position: size * place(np.array(a0)), scene.bob.point.velocity: (0, 0, 0)}, rtol=1e-11
    )
    exact = solve_ivp(fall, (0, 2.0), [a0, 0.0], "DOP853", run.t, rtol=1e-13, atol=1e-14).y[0]
    assert exact.max() > 2.3  # far to the other side
    assert np.max(np.abs(run[scene.bob.point.position] / size - place(exact).T)) < 1e-9
    assert run.energy_error() < 1e-10


@each_value(("size", SIZES), ("masses", [(0.0, 0.0), (0.4, 0.9)]))
def test_a_tackle_of_a_loose_and_a_fixed_pulley(size: float, masses: tuple[float, float]) -> None:
    """From the ceiling around the load's pulley, up over a fixed one, down to a weight; all pieces hang straight.

    x up of the load: the weight goes down by 2 x, the loose wheel turns by x / r, the fixed one by 2 x / R:
    (M + m + J / r^2 + 4 (J' / R^2 + w)) x'' = g (2 w - M - m).
    """
    M, w, r, R = 3.0, 2.0, 0.1 * size, 0.15 * size
    scene: Any = ac.System()
    scene.world, scene.rail, scene.load, scene.weight = (
        World((0, 0, -G * size)),
        Prismatic("z"),
        RigidBody.ball(M, 0.05 * size),
        Particle(w),
    )
    scene.wheels = [RigidBody.disk(m, a, axis="y") for m, a in zip(masses, (r, R), strict=True) if m]
    loose, fixed = scene.wheels or (None, None)
    top = scene.world.at((r + R, 0, 2 * size))
    # under the loose pulley to the right, then over the fixed one
    pulleys = (Pulley(scene.load.frame, r, (0, 0, -1), (1, 0, 0), loose), Pulley(top, R, wheel=fixed))
    z, hang = 0.3 * size, 1.1 * size
    scene.rope = Cable(2 * (2 * size - z) + np.pi * (r + R) + hang, over=pulleys)
    scene.connect(scene.world.at((-r, 0, 2 * size)), scene.rope.frame_a)
    scene.connect(scene.rope.frame_b, scene.weight.point)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.load.frame)
    model = ac.build(scene)
    start = {scene.rail.q: z, scene.weight.point.position: (r + 2 * R, 0, 2 * size - hang)}
    run = model.simulate(0.4, start, rtol=1e-11)
    m, other = masses
    x = G * size * (2 * w - M - m) / (M + m + m / 2 + 4 * (other / 2 + w)) / 2 * run.t**2
    assert np.max(np.abs(run[scene.rail.q] - z - x)) < 1e-11 * size
    assert np.max(np.abs(run[scene.weight.point.position][:, 2] - (2 * size - hang) + 2 * x)) < 1e-11 * size
    if loose:
        turns = [run[hinge.q] for hinge in scene.rope.hinges]
        assert np.max(np.abs(np.abs(turns[1]) - 2 * np.abs(x) / R)) < 1e-10
        assert np.max(np.abs(np.abs(turns[0]) - np.abs(x) / r)) < 1e-10
    assert run.energy_error() < 1e-11


def test_a_winch_is_a_tangent_on_a_rack() -> None:
    """A drum on which rope is wound many times lifts a weight: (m + J / r^2) z'' = tau / r - m g."""
    r, m, J, tau = 0.1, 2.0, 0.03, 3.0
    scene: Any = ac.System()
    scene.world, scene.axle, scene.drum = World(), Revolute("y"), RigidBody(1.0, (J, J, J))
    scene.rail, scene.weight = Prismatic("z"), Particle(m)
    scene.rope, scene.rack, scene.motor = Tangent(Pulley(scene.world.frame, r)), RackAndPinion(r), TorqueSource(-tau)
    scene.connect(scene.world.frame, scene.axle.frame_a, scene.rope.frame_a)
    scene.connect(scene.axle.frame_b, scene.drum.frame)
    scene.connect(scene.world.at((r, 0, 0)), scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.weight.point, scene.rope.frame_b)
    scene.connect(scene.rope.flange, scene.rack.rack)
    scene.connect(scene.rack.pinion, scene.axle.flange, scene.motor.flange)
    run = ac.build(scene).simulate(3.0, {scene.rail.q: -100.0}, rtol=1e-11)
    a = (tau / r - m * G) / (m + J / r**2)
    assert np.max(np.abs(run[scene.rail.q] + 100 - a * run.t**2 / 2)) < 1e-9
    assert abs(run[scene.axle.q][-1] - run[scene.axle.q][0] + a * 4.5 / r) < 1e-8
    assert abs(a * 4.5 / r) > 4 * np.pi


def test_a_driven_wheel_draws_a_rope_whose_ends_feel_it() -> None:
    """A motor on the pulley of an Atwood machine: (m1 + m2 + J / r^2) a = tau / r + g (m1 - m2)."""
    m1, m2, M, r, tau = 1.0, 3.0, 2.0, 0.2, 5.0
    scene: Any = ac.System()
    scene.world, scene.one, scene.two, scene.wheel, scene.motor = (
        World(),
        Particle(m1),
        Particle(m2),
        RigidBody.disk(M, r, axis="y"),
        TorqueSource(-tau),
    )
    scene.rope = Cable(3.0, over=(Pulley(scene.world.frame, r, wheel=scene.wheel),))
    scene.connect(scene.rope.frame_a, scene.one.point)
    scene.connect(scene.rope.frame_b, scene.two.point)
    scene.connect(scene.rope.hinges[0].flange, scene.motor.flange)
    start = {scene.one.point.position: (-r, 0, -1), scene.two.point.position: (r, 0, 1 + np.pi * r - 3)}
    run = ac.build(scene).simulate(0.5, start, rtol=1e-11)
    a = (tau / r + G * (m1 - m2)) / (m1 + m2 + M / 2)
    assert np.max(np.abs(run[scene.one.point.position][:, 2] + 1 + a * run.t**2 / 2)) < 1e-11
    assert run.energy_error() < 1e-12


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda f: Pulley(f, 0.0), ("radius is 0", "positive")),
        (lambda f: Pulley(f, -1.0), ("radius is -1",)),
        (lambda f: Pulley(Particle(1.0).point, 0.1), ("frame is", "Give a frame")),
        (lambda f: Pulley(f, 0.1, "z", "z"), ("right angles", "in its plane")),
        (lambda f: Pulley(f, 0.1, (0, 0, 0)), ("middle",)),
        (lambda f: Pulley(f, 0.1, wheel=Particle(1.0)), ("wheel is", "RigidBody")),
        (lambda f: Tangent(0.1), ("pulley is 0.1", "Pulley(frame, radius)")),
        (lambda f: Cable(1.0, over=(0.1,)), ("over is", "Pulley(block.frame")),
    ],
)  # fmt: skip
def test_what_is_no_pulley_is_refused_in_words(make: Any, words: tuple[str, ...]) -> None:
    with pytest.raises(ParameterError) as caught:
        make(World().frame)
    assert all(word in str(caught.value) for word in words), caught.value
    assert "test_pulleys.py" in str(caught.value)


@pytest.mark.parametrize("size", [*SIZES, 3.7e-4, 0.013, 27.0])
def test_a_machine_that_hangs_on_a_machine(size: float) -> None:
    """The second end of a rope carries a pulley with a rope of its own; by Lagrange. All places are given, exactly, and none contradicts another."""
    m1, m2, m3, M, pull = 3.0, 1.0, 1.5, 0.5, G * size
    scene: Any = ac.System()
    scene.world, scene.rail, scene.block = World((0, 0, -pull)), Prismatic("z"), RigidBody.ball(M, 0.02 * size)
    scene.one, scene.two, scene.three = Particle(m1), Particle(m2), Particle(m3)
    scene.above = Cable(3 * size, over=(Pulley(scene.world.frame, 0.3 * size),))
    scene.below = Cable(2 * size, over=(Pulley(scene.block.frame, 0.1 * size),))
    scene.connect(scene.world.at((0.3 * size, 0, 0)), scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.block.frame, scene.above.frame_b)
    scene.connect(scene.above.frame_a, scene.one.point)
    scene.connect(scene.below.frame_a, scene.two.point)
    scene.connect(scene.below.frame_b, scene.three.point)
    z, second = -size, 0.8 * size
    first, third = 2 * size - np.pi * 0.3 * size, 2 * size - np.pi * 0.1 * size - second
    start = {
        scene.rail.q: z,
        scene.one.point.position: (-0.3 * size, 0, -first),
        scene.two.point.position: (0.2 * size, 0, z - second),
        scene.three.point.position: (0.4 * size, 0, z - third),
    }
    run = ac.build(scene).simulate(0.3, start, rtol=1e-11)
    down, over = np.linalg.solve([[m1 + M + m2 + m3, m3 - m2], [m3 - m2, m2 + m3]], [pull * (M + m2 + m3 - m1), pull * (m3 - m2)])
    assert np.max(np.abs(run[scene.rail.q] - z + down * run.t**2 / 2)) < 1e-12 * size
    assert np.max(np.abs(run[scene.three.point.position][:, 2] - z + third + (down + over) * run.t**2 / 2)) < 1e-12 * size


@pytest.mark.parametrize("size", SIZES)
def test_ropes_that_leave_their_wheels_where_they_end_in_the_sketch_have_constraints_all_the_same(size: float) -> None:
    """A machine on a machine, its wheels heavy, everything drawn at height 0: by Lagrange; what wheels have turned by is integral of two velocities."""
    m, J, r, pull = np.array([4.0, 1.0, 2.5, 0.5]), np.array([0.01, 0.004]), 0.1 * size, G * size
    scene: Any = ac.System()
    scene.world, scene.rails = World((0, 0, -pull)), [Prismatic("z") for _ in m]
    scene.loads = [RigidBody(mass, (size**2,) * 3) for mass in m]
    scene.wheels = [RigidBody(0.2, (inertia * size**2,) * 3) for inertia in J]
    for rail, load, x in zip(scene.rails, scene.loads, (-r, 0.0, 2 * r, r), strict=True):
        scene.connect(scene.world.at((x, 0, 0)), rail.frame_a)
        scene.connect(rail.frame_b, load.frame)
    scene.above = Cable(4 * size, over=(Pulley(scene.world.at((0, 0, 2 * size)), r, wheel=scene.wheels[0]),))
    scene.below = Cable(2 * size, over=(Pulley(scene.loads[3].frame, r, wheel=scene.wheels[1]),))
    for rope, one, other in ((scene.above, 0, 3), (scene.below, 1, 2)):
        scene.connect(scene.loads[one].frame, rope.frame_a)
        scene.connect(scene.loads[other].frame, rope.frame_b)
    model = ac.build(scene)
    table = model.constraints()
    assert (table.configuration_freedom, table.velocity_freedom, table.hidden) == (4, 2, 2)
    run = model.simulate(0.5, {scene.rails[0].q: 0.3 * size, scene.rails[1].q: -0.7 * size}, rtol=1e-11)
    m[3] += 0.2
    inertias, weights = J / 0.1**2, m * pull  # of what rises at the first rope, and over at the second
    A = [[m.sum() + inertias[0], m[2] - m[1]], [m[2] - m[1], m[1] + m[2] + inertias[1]]]
    up, over = np.linalg.solve(A, [weights[1:].sum() - weights[0], weights[2] - weights[1]])
    speeds = [run[rail.v][-1] / 0.5 for rail in scene.rails]
    assert speeds == pytest.approx([up, over - up, -over - up, -up], rel=1e-11)
    assert max(np.ptp(run[found.expression]) for found in table.velocity.integrals) < 1e-12 * max(size, 1.0)
