"""Classical hybrid systems, each against closed forms or a small program that goes from event to event with exact flows in between."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import acausal as ac
from acausal.simulate.trajectory import Trajectory
from components import (
    Contact,
    Coulomb,
    EndStop,
    Hard,
    Particle,
    Planar,
    Plane,
    PointOnPlane,
    Prismatic,
    RigidBody,
    Sphere,
    Spring,
    World,
)

G = 9.81
INSTANT = 1e-11
STATE = 1e-10
UPRIGHT = ((1, 0, 0), (0, 0, 1), (0, -1, 0))
"""Turns z to y."""


def impacts(run: Trajectory) -> list[float]:
    """When velocities jumped."""
    met = run.solution.modes
    assert met is not None
    return [change.time for change in met.changes if change.jumped]


def rocks(alpha: float, rate2: float, theta: float) -> float:
    """How long a block of slenderness alpha takes from standing to a tilt theta, where it turns: theta'' = -rate2 sin(alpha - theta)."""
    x, weights = np.polynomial.legendre.leggauss(60)
    s, weights = (x + 1) / 2, weights / 2
    tilt = theta * (1 - s * s)  # smooth where it turns
    squared = 4 * rate2 * np.sin(alpha - (theta + tilt) / 2) * np.sin((theta - tilt) / 2)
    return float(weights @ (2 * theta * s / np.sqrt(squared)))


@pytest.mark.parametrize(("wide", "high", "tilt", "size"), [(0.2, 1.0, 0.15, 1.0), (0.3, 1.0, -0.2, 1e-6)])
def test_a_rocking_block_loses_housners_share_at_each_impact_and_stands(
    wide: float, high: float, tilt: float, size: float
) -> None:
    """Housner (1963): speeds fall to 1 - 3/2 sin(alpha)^2 at each impact; of infinitely many the sum of times is finite."""
    m, alpha, R = 3.0, np.arctan(wide / high), np.hypot(wide, high) / 2
    scene = ac.System()
    scene.world, scene.plane = World((0, -G * size, 0)), Planar("z")
    scene.block = RigidBody(m, (1.0 * size**2, 1.0 * size**2, m * R**2 / 3 * size**2))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(1.5)) for _ in (0, 1)]
    scene.connect(scene.world.frame, scene.plane.frame_a)
    scene.connect(scene.plane.frame_b, scene.block.frame)
    floor = scene.world.at((0, 0, 0), UPRIGHT)
    for foot, x in zip(scene.feet, (-wide / 2 * size, wide / 2 * size), strict=True):
        scene.connect(floor, foot.frame_a)
        scene.connect(foot.frame_b, scene.block.at((x, -high / 2 * size, 0)))
    keep, rate2 = 1 - 1.5 * np.sin(alpha) ** 2, 3 * G / (4 * R)
    strikes, theta, t = [], abs(tilt), 0.0
    while theta > 1e-30:
        t += rocks(alpha, rate2, theta)
        strikes.append(t)
        # w^2 = 2 rate2 (cos(alpha - theta) - cos(alpha)), in products
        half = keep**2 * np.sin(alpha - theta / 2) * np.sin(theta / 2)
        theta = brentq(lambda a, h=half: np.sin(alpha - a / 2) * np.sin(a / 2) - h, 0, theta, xtol=1e-300, rtol=1e-15)
        t += rocks(alpha, rate2, theta)
    pivot = np.copysign(wide / 2, -tilt)
    c, s = np.cos(tilt), np.sin(tilt)
    centre = np.array([pivot - pivot * c - high / 2 * s, -pivot * s + high / 2 * c]) * size
    run = ac.build(scene).simulate(
        1.1 * t, {scene.plane.q: (*centre, tilt), scene.plane.v: (0, 0, 0)}, rtol=1e-12, compiled=False
    )
    found = impacts(run)
    assert found[:10] == pytest.approx(strikes[:10], rel=INSTANT)
    share = [change.after[scene.plane.v[2]] / change.before[scene.plane.v[2]] for change in run.transitions[:10]]
    assert np.ravel(share) == pytest.approx(keep, rel=STATE)
    assert run.transitions[-1].time == pytest.approx(t, rel=1e-9)
    assert run[scene.plane.q][-1] / [size, size, 1] == pytest.approx([0, high / 2, 0], abs=STATE)
    assert np.max(np.abs(run[scene.plane.v][-1])) < 1e-30


@pytest.mark.parametrize(("lower", "upper"), [(0.9, 0.6), (1.0, 1.0)])
def test_a_block_on_a_slope_between_two_stops_strikes_as_parabolas_do(lower: float, upper: float) -> None:
    """Down to the lower stop, up to the upper one as long as it gets there."""
    pull, length = G * np.sin(0.4), 0.5
    scene = ac.System()
    scene.world, scene.rail = World((-pull, 0, -G * np.cos(0.4))), Prismatic("x")
    scene.block = RigidBody.box(2.0, (0.1, 0.1, 0.1))
    scene.low, scene.high = (
        EndStop(scene.rail.flange, lower=0.0, restitution=lower),
        EndStop(scene.rail.flange, upper=length, restitution=upper),
    )
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.block.frame)
    x, v, t, strikes, end = 0.2, 4.0, 0.0, [], 3.0
    while True:
        last = x, v, t
        if v > 0 and v * v > 2 * pull * (length - x):
            fast = np.sqrt(v * v - 2 * pull * (length - x))
            t, x, v = t + 2 * (length - x) / (v + fast), length, -upper * fast
        else:
            fast = np.sqrt(v * v + 2 * pull * x)
            t, x, v = t + (v + fast) / pull, 0.0, lower * fast
        if t > end:
            break
        strikes.append(t)
    run = ac.build(scene).simulate(end, {scene.rail.q: 0.2, scene.rail.v: 4.0}, rtol=1e-12, compiled=False)
    x, v, t = last
    assert len(strikes) > 6 and impacts(run) == pytest.approx(strikes, rel=INSTANT)
    assert run[scene.rail.q][-1] == pytest.approx(x + v * (end - t) - pull / 2 * (end - t) ** 2, abs=STATE)
    assert run[scene.rail.v][-1] == pytest.approx(v - pull * (end - t), abs=STATE)


def flows(free: np.ndarray, stands: np.ndarray, z: np.ndarray, restitution: float, end: float) -> tuple[list[float], np.ndarray]:
    """Instants of impacts of z[0] on zero with the rate z[1], z' = free z, or stands z as long as (free z)[1] < 0; and the last state."""
    t, step, strikes, stood = 0.0, 2e-3, [], False
    while True:
        A = stands if stood else free

        def left(s: float, A: np.ndarray = A, z: np.ndarray = z, stood: bool = stood) -> float:
            """Positive as long as it goes on as it does."""
            later = expm(A * s) @ z
            return -(free @ later)[1] if stood else later[0] / (s if z[0] == 0 else 1.0)

        begin = 0.0 if stood else 1e-3 * min(step, abs(z[1]) or step)  # the shortest flight would be 2 v / a
        k = next(k for k in range(1, 10**6) if t + (k - 1) * step >= end or left(k * step) < 0)
        past = np.inf if t + (k - 1) * step >= end else brentq(left, (k - 1) * step or begin, k * step, xtol=1e-17, rtol=1e-15)
        if t + past > end:
            return strikes, expm(A * (end - t)) @ z
        t, z = t + past, expm(A * past) @ z
        z[0] = 0.0
        if not stood:
            strikes.append(t)
            z[1] = -restitution * z[1] if abs(z[1]) > 1e-13 else 0.0
        stood = not stood and z[1] == 0


@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_two_masses_on_a_spring_bounce_as_exponentials_say(restitution: float) -> None:
    """The lower one strikes the floor, with e = 1/2 it comes to stand while the spring presses it down, and is pulled off by it again."""
    m, M, k, length, end = 0.4, 1.1, 300.0, 0.5, 1.2
    scene = ac.System()
    scene.world, scene.low, scene.high = World(), Prismatic("z"), Prismatic("z")
    scene.foot, scene.head = Particle(m), Particle(M)
    scene.spring = Spring(k, length)
    scene.floor = EndStop(scene.low.flange, lower=0.0, restitution=restitution)
    for rail, mass in ((scene.low, scene.foot), (scene.high, scene.head)):
        scene.connect(scene.world.frame, rail.frame_a)
        scene.connect(rail.frame_b, mass.point)
    scene.connect(scene.foot.point, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.head.point)
    lower, upper = scene.low, scene.high
    start = {lower.q: 0.3, lower.v: 0.0, upper.q: 0.3 + length, upper.v: 0.0}
    run = ac.build(scene).simulate(end, start, rtol=1e-12, compiled=False)
    free = np.zeros((5, 5))  # of y, y', Y, Y', 1
    free[0, 1] = free[2, 3] = 1
    free[1] = [-k / m, 0, k / m, 0, -k * length / m - G]
    free[3] = [k / M, 0, -k / M, 0, k * length / M - G]
    stands = free.copy()
    stands[:2] = 0
    strikes, z = flows(free, stands, np.array([0.3, 0, 0.3 + length, 0, 1]), restitution, end)
    found = np.array(impacts(run))
    apart = np.diff(strikes, prepend=0) > 1e-4
    assert np.sum(apart) > 5
    assert [found[np.argmin(np.abs(found - t))] for t in np.array(strikes)[apart]] == pytest.approx(
        np.array(strikes)[apart], rel=INSTANT
    )
    last = [run[x][-1].item() for x in (lower.q, lower.v, upper.q, upper.v)]
    assert np.max(np.abs(np.array(last) - z[:4])) < (
        STATE if restitution == 1 else 1e-9
    )  # bridged twice, by limits that agree to 1e-9
    if restitution == 1:
        assert found == pytest.approx(strikes, rel=INSTANT) and run.energy_error() < 1e-11


def collides(x: np.ndarray, v: np.ndarray, r: float, box: np.ndarray, end: float) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Equal disks (n, 2) in a box from 0 to `box`, without loss: instants, and the last places and speeds."""
    x, v, t, strikes = x.copy(), v.copy(), 0.0, []
    while True:
        times = {}
        for a, k in product(range(len(x)), (0, 1)):
            if v[a, k]:
                times[a, k, True] = ((box[k] - r if v[a, k] > 0 else r) - x[a, k]) / v[a, k]
        for a, b in combinations(range(len(x)), 2):
            d, w = x[a] - x[b], v[a] - v[b]
            root = (d @ w) ** 2 - (w @ w) * (d @ d - 4 * r * r)
            if d @ w < 0 and root > 0:
                times[a, b, False] = (d @ d - 4 * r * r) / (np.sqrt(root) - d @ w)
        a, b, wall = min(times, key=times.__getitem__)
        step = times[a, b, wall]
        if t + step > end:
            return strikes, x + v * (end - t), v
        t, x = t + step, x + v * step
        strikes.append(t)
        if wall:
            v[a, b] *= -1
        else:
            n = (x[a] - x[b]) / np.linalg.norm(x[a] - x[b])
            give = ((v[a] - v[b]) @ n) * n
            v[a], v[b] = v[a] - give, v[b] + give


@pytest.mark.slow
def test_billiards_follow_the_collisions_one_by_one_until_errors_have_grown_a_million_times() -> None:
    """Three balls in a square; what they are apart from a motion next to theirs tells how far rounding may lead."""
    r, box, n = 0.12, np.array([1.0, 1.1]), 3
    x = np.array([[0.2, 0.3], [0.7, 0.35], [0.45, 0.8]])
    v = np.array([[1.0, 0.37], [-0.6, 0.9], [0.21, -0.83]])
    end = 0.0
    while end < 40:
        end += 0.5
        strikes, places, speeds = collides(x, v, r, box, end)
        near = collides(x + 1e-12 * np.array([[1, 0], [0, -1], [-1, 1]]), v, r, box, end)
        growth = np.max(np.abs(near[1] - places)) / 1e-12
        if growth > 1e6:
            break
    scene = ac.System()
    scene.world, scene.balls = World(None), [RigidBody.ball(1.0, r) for _ in range(n)]
    sides = [((0, 0, 0), ((0, 0, 1), (1, 0, 0), (0, 1, 0))), ((0, 0, 0), ((0, 1, 0), (0, 0, 1), (1, 0, 0)))]
    sides += [((box[0], 0, 0), ((0, 0, -1), (1, 0, 0), (0, -1, 0))), ((0, box[1], 0), ((0, 1, 0), (0, 0, -1), (-1, 0, 0)))]
    walls = [scene.world.at(*side) for side in sides]
    scene.walls = [Contact(Sphere(r), Plane(), Hard(1.0)) for _ in range(4 * n)]
    scene.pairs = [Contact(Sphere(r), Sphere(r), Hard(1.0)) for _ in range(n * (n - 1) // 2)]
    for contact, (ball, wall) in zip(scene.walls, product(scene.balls, walls), strict=True):
        scene.connect(wall, contact.frame_a)
        scene.connect(contact.frame_b, ball.frame)
    for contact, (one, other) in zip(scene.pairs, combinations(scene.balls, 2), strict=True):
        scene.connect(one.frame, contact.frame_a)
        scene.connect(contact.frame_b, other.frame)
    start = {ball.frame.position: (*at, 0) for ball, at in zip(scene.balls, x, strict=True)}
    start |= {ball.frame.velocity: (*at, 0) for ball, at in zip(scene.balls, v, strict=True)}
    run = ac.build(scene).simulate(end, start, rtol=1e-12, compiled=False)
    found = np.array(impacts(run))
    assert len(found) == len(strikes) > 10
    early = np.array(strikes) < 0.4 * end
    assert found[early] == pytest.approx(np.array(strikes)[early], rel=INSTANT)
    last = np.array([run[ball.frame.position][-1, :2] for ball in scene.balls])
    fast = np.array([run[ball.frame.velocity][-1, :2] for ball in scene.balls])
    assert np.max(np.abs(last - places)) < 1e-14 * growth and np.max(np.abs(fast - speeds)) < 1e-13 * growth


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, 0.5)])
def test_a_table_tips_when_its_load_has_passed_its_legs_by_as_much_as_it_weighs_less(direction: tuple[float, float]) -> None:
    """m (x - a) = M a; what each leg carries before depends on no order of declaration."""
    M, m, a, b, speed = 3.0, 2.0, 0.4, 0.3, 0.5
    corners = [(a, b), (a, -b), (-a, b), (-a, -b)]
    along = np.array([*direction, 0]) / np.hypot(*direction)
    tips = min(a / along[0], b / along[1] if along[1] else np.inf) * (1 + M / m) / speed
    pushes = []
    for order in ((0, 1, 2, 3), (2, 0, 3, 1)):
        scene = ac.System()
        scene.world, scene.table, scene.rail, scene.load = (
            World(),
            RigidBody.box(M, (2 * a, 2 * b, 0.05)),
            Prismatic(along),
            Particle(m),
        )
        legs = [PointOnPlane(unilateral=True, friction=Coulomb(0.5)) for _ in corners]
        scene.legs = [legs[k] for k in order]
        for leg, (x, y) in zip(legs, corners, strict=True):
            scene.connect(scene.world.frame, leg.frame_a)
            scene.connect(leg.frame_b, scene.table.at((x, y, -0.7)))
        scene.connect(scene.table.frame, scene.rail.frame_a)
        scene.connect(scene.rail.frame_b, scene.load.point)
        frame = scene.table.frame
        start = {
            frame.position: (0, 0, 0.7),
            frame.rotation: np.eye(3),
            frame.velocity: (0, 0, 0),
            frame.angular_velocity: (0, 0, 0),
        }
        run = ac.build(scene).simulate(tips + 0.05, start | {scene.rail.q: 0.0, scene.rail.v: speed}, rtol=1e-12, compiled=False)
        opens = [t.time for t in run.transitions if t.changes]
        assert opens == pytest.approx([tips], rel=INSTANT)
        early = run.at([0.3 * tips, 0.9 * tips])
        push = np.array([early[leg.normal_force].ravel() for leg in legs])
        assert np.min(push) > 0 and np.sum(push, axis=0) == pytest.approx(G * (M + m), rel=STATE)
        load = speed * np.array([0.3, 0.9]) * tips * m * G
        assert np.array(corners).T @ push == pytest.approx(np.outer(along[:2], load), abs=1e-9)
        pushes.append(push)
        assert run.energy_error() < 1e-10 and np.linalg.norm(run[frame.angular_velocity][-1]) > 1e-3
    assert pushes[0] == pytest.approx(pushes[1], rel=1e-9)
