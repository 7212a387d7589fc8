"""Classical hybrid systems, each against closed forms or a small program that goes from event to event with exact flows in between."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations, product

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import acausal as ac
from acausal.language.mode_laws import ModeLaw
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
    Rope,
    RoughContact,
    Sphere,
    Spring,
    World,
)
from tests.drawn import SEEDS, Drawn
from tests.pairings import each_value

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


@pytest.mark.parametrize("seed", SEEDS)
def test_a_rocking_block_loses_housners_share_at_each_impact_and_stands(seed: int) -> None:
    """Housner (1963): speeds fall to 1 - 3/2 sin(alpha)^2 at each impact; of infinitely many the sum of times is finite."""
    of = Drawn(seed)
    m, alpha, R, g = of.M, of.within(0.3, 0.5), of.L * of.within(0.3, 3), of.g
    wide, high, tilt = 2 * R * np.sin(alpha), 2 * R * np.cos(alpha), alpha * of.within(0.2, 0.95) * of.rng.choice([1, -1])
    scene = ac.System()
    scene.world, scene.plane = World((0, -g, 0)), Planar("z")
    scene.block = RigidBody(m, (m * R**2, m * R**2, m * R**2 / 3))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(1.5)) for _ in (0, 1)]
    scene.connect(scene.world.frame, scene.plane.frame_a)
    scene.connect(scene.plane.frame_b, scene.block.frame)
    floor, ends = scene.world.at((0, 0, 0), UPRIGHT), (-wide / 2, wide / 2)
    for foot, k in zip(scene.feet, of.order(2), strict=True):
        scene.connect(floor, foot.frame_a)
        scene.connect(foot.frame_b, scene.block.at((ends[k], -high / 2, 0)))
    keep, rate2 = 1 - 1.5 * np.sin(alpha) ** 2, 3 * g / (4 * R)
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
    centre = np.array([pivot - pivot * c - high / 2 * s, -pivot * s + high / 2 * c])
    run = ac.build(scene).simulate(
        1.1 * t, {scene.plane.q: (*centre, tilt), scene.plane.v: (0, 0, 0)}, rtol=1e-12, compiled=False
    )
    found = impacts(run)
    assert found[:10] == pytest.approx(strikes[:10], rel=INSTANT)
    share = [change.after[scene.plane.v[2]] / change.before[scene.plane.v[2]] for change in run.transitions[:10]]
    assert np.ravel(share) == pytest.approx(keep, rel=STATE)
    assert run.transitions[-1].time == pytest.approx(t, rel=INSTANT)
    assert run[scene.plane.q][-1] / [R, R, 1] == pytest.approx([0, high / 2 / R, 0], abs=STATE)
    assert np.max(np.abs(run[scene.plane.v][-1] / [R, R, 1])) < 1e-30 * np.sqrt(rate2)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_block_on_a_slope_between_two_stops_strikes_as_parabolas_do(seed: int) -> None:
    """Down to the lower stop, up to the upper one as long as it gets there."""
    of = Drawn(seed)
    pull, length, lower, upper, Q = (
        of.g * np.sin(of.within(0.2, 1)),
        of.L * of.within(0.3, 1),
        of.within(0.85, 1),
        of.within(0.6, 1),
        of.turn(),
    )
    begin, end = (length * of.within(0, 1), np.sqrt(pull * length) * of.within(-4, 4), 0.0), 6 * np.sqrt(length / pull)
    scene = ac.System()
    scene.world, scene.rail = World(tuple(-pull * Q[:, 0] + of.g * Q[:, 1])), Prismatic(tuple(Q[:, 0]))
    scene.block = RigidBody.box(of.M, (0.1 * of.L,) * 3)
    stops = EndStop(scene.rail.flange, lower=0.0, restitution=lower), EndStop(scene.rail.flange, upper=length, restitution=upper)
    scene.stops = [stops[k] for k in of.order(2)]
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.block.frame)
    (x, v, t), strikes = begin, list[float]()
    while True:
        last = x, v, t
        if v > 0 and v * v > 2 * pull * (length - x):
            fast = np.sqrt(v * v - 2 * pull * (length - x))
            t, x, v = t + 2 * (length - x) / (v + fast), length, -upper * fast
        else:
            fast = np.sqrt(v * v + 2 * pull * x)
            t, x, v = t + ((v + fast) / pull if v > 0 else 2 * x / (fast - v)), 0.0, lower * fast
        if t > end:
            break
        strikes.append(t)
    run = ac.build(scene).simulate(end, {scene.rail.q: begin[0], scene.rail.v: begin[1]}, rtol=1e-12, compiled=False)
    (x, v, t), unit = last, np.sqrt(pull * length)
    assert len(strikes) > 3 and impacts(run) == pytest.approx(strikes, rel=INSTANT)
    assert run[scene.rail.q][-1] / length == pytest.approx((x + v * (end - t) - pull / 2 * (end - t) ** 2) / length, abs=STATE)
    assert run[scene.rail.v][-1] / unit == pytest.approx((v - pull * (end - t)) / unit, abs=STATE)


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


@pytest.mark.parametrize("elastic", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_two_masses_on_a_spring_bounce_as_exponentials_say(seed: int, elastic: bool) -> None:
    """The lower one strikes the floor; where it loses energy it comes to stand while the spring presses it down, and is pulled off by it again."""
    of = Drawn(seed)
    m, M = of.M * of.rng.uniform(0.3, 3, 2)
    length, high, restitution = of.L * of.within(0.3, 1), of.L * of.within(0.1, 0.6), 1.0 if elastic else of.within(0.3, 0.7)
    k = of.within(60, 300) * (m + M) / of.T**2
    g, end = of.g, 1.2 * of.T * np.sqrt(of.within(0.6, 1.4))
    scene = ac.System()
    scene.world, scene.low, scene.high = World((0, 0, -g)), Prismatic("z"), Prismatic("z")
    scene.foot, scene.head = Particle(m), Particle(M)
    scene.spring = Spring(k, length)
    scene.floor = EndStop(scene.low.flange, lower=0.0, restitution=restitution)
    for rail, mass in ((scene.low, scene.foot), (scene.high, scene.head)):
        scene.connect(scene.world.frame, rail.frame_a)
        scene.connect(rail.frame_b, mass.point)
    scene.connect(scene.foot.point, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.head.point)
    lower, upper = scene.low, scene.high
    start = {lower.q: high, lower.v: 0.0, upper.q: high + length, upper.v: 0.0}
    run = ac.build(scene).simulate(end, start, rtol=1e-12, compiled=False)
    # lengths over L, times over T
    m, M, k, length, high, g, end = m / of.M, M / of.M, k * of.T**2 / of.M, length / of.L, high / of.L, 9.81, end / of.T
    free = np.zeros((5, 5))  # of y, y', Y, Y', 1
    free[0, 1] = free[2, 3] = 1
    free[1] = [-k / m, 0, k / m, 0, -k * length / m - g]
    free[3] = [k / M, 0, -k / M, 0, k * length / M - g]
    stands = free.copy()
    stands[:2] = 0
    strikes, z = flows(free, stands, np.array([high, 0, high + length, 0, 1]), restitution, end)
    found = np.array(impacts(run)) / of.T
    apart = np.diff(strikes, prepend=0) > 1e-4
    assert np.sum(apart) >= 3
    assert [found[np.argmin(np.abs(found - t))] for t in np.array(strikes)[apart]] == pytest.approx(
        np.array(strikes)[apart], rel=INSTANT
    )
    last = [run[x][-1].item() / unit for x, unit in zip((lower.q, lower.v, upper.q, upper.v), (of.L, of.speed) * 2, strict=True)]
    assert np.max(np.abs(np.array(last) - z[:4])) < (STATE if elastic else 1e-9)  # bridged by limits that agree to 1e-9


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
@pytest.mark.parametrize("seed", SEEDS)
def test_billiards_follow_the_collisions_one_by_one_until_errors_have_grown_a_million_times(seed: int) -> None:
    """Three balls in a rectangle; what they are apart from a motion next to theirs tells how far rounding may lead."""
    of, n = Drawn(seed), 3
    r, box, x = of.within(0.08, 0.13), np.array([of.within(0.9, 1.1), 1.0]), np.zeros((n, 2))
    while min(np.linalg.norm(a - b) for a, b in combinations(x, 2)) < 2.2 * r:
        x = r + (box - 2 * r) * of.rng.uniform(size=(n, 2))
    v = of.rng.uniform(-1, 1, (n, 2))
    end = 0.0
    while end < 40:
        end += 0.5
        strikes, places, speeds = collides(x, v, r, box, end)
        near = collides(x + 1e-12 * np.array([[1, 0], [0, -1], [-1, 1]]), v, r, box, end)
        growth = np.max(np.abs(near[1] - places)) / 1e-12
        if growth > 1e6:
            break
    L, T = of.L, of.T
    scene = ac.System()
    scene.world, scene.balls = World(None), [RigidBody.ball(of.M, r * L) for _ in range(n)]
    sides = [((0, 0, 0), ((0, 0, 1), (1, 0, 0), (0, 1, 0))), ((0, 0, 0), ((0, 1, 0), (0, 0, 1), (1, 0, 0)))]
    sides += [
        ((box[0] * L, 0, 0), ((0, 0, -1), (1, 0, 0), (0, -1, 0))),
        ((0, box[1] * L, 0), ((0, 1, 0), (0, 0, -1), (-1, 0, 0))),
    ]
    walls = [scene.world.at(*side) for side in sides]
    scene.walls = [Contact(Sphere(r * L), Plane(), Hard(1.0)) for _ in range(4 * n)]
    scene.pairs = [Contact(Sphere(r * L), Sphere(r * L), Hard(1.0)) for _ in range(n * (n - 1) // 2)]
    for contact, (ball, wall) in zip(scene.walls, product(scene.balls, walls), strict=True):
        scene.connect(wall, contact.frame_a)
        scene.connect(contact.frame_b, ball.frame)
    for contact, (one, other) in zip(scene.pairs, combinations(scene.balls, 2), strict=True):
        scene.connect(one.frame, contact.frame_a)
        scene.connect(contact.frame_b, other.frame)
    start = {ball.frame.position: (*at * L, 0) for ball, at in zip(scene.balls, x, strict=True)}
    start |= {ball.frame.velocity: (*at * L / T, 0) for ball, at in zip(scene.balls, v, strict=True)}
    run = ac.build(scene).simulate(end * T, start, rtol=1e-12, compiled=False)
    found = np.array(impacts(run)) / T
    assert len(found) == len(strikes) > 10
    early = np.array(strikes) < 0.4 * end
    assert found[early] == pytest.approx(np.array(strikes)[early], rel=INSTANT)
    last = np.array([run[ball.frame.position][-1, :2] / L for ball in scene.balls])
    fast = np.array([run[ball.frame.velocity][-1, :2] / L * T for ball in scene.balls])
    assert np.max(np.abs(last - places)) < 1e-14 * growth and np.max(np.abs(fast - speeds)) < 1e-13 * growth


@pytest.mark.parametrize("seed", SEEDS)
def test_a_table_tips_when_its_load_has_passed_its_legs_by_as_much_as_it_weighs_less(seed: int) -> None:
    """m (x - a) = M a; what each leg carries before depends on no order of declaration."""
    of = Drawn(seed)
    M, m = of.M * of.rng.uniform(0.3, 3, 2)
    (a, b, high), g, speed, direction = of.L * of.rng.uniform(0.2, 1, 3), of.g, of.speed * of.within(0.1, 1), of.within(0, 7)
    corners = np.array([(a, b), (a, -b), (-a, b), (-a, -b)])
    along = np.array([np.cos(direction), np.sin(direction), 0])
    tips = min(a / abs(along[0]), b / abs(along[1])) * (1 + M / m) / speed
    pushes = []
    for order in ([0, 1, 2, 3], of.order(4)):
        scene = ac.System()
        scene.world, scene.table = World((0, 0, -g)), RigidBody.box(M, (2 * a, 2 * b, 0.05 * high))
        scene.rail, scene.load = Prismatic(tuple(along)), Particle(m)
        legs = [PointOnPlane(unilateral=True, friction=Coulomb(2.0)) for _ in corners]
        scene.legs = [legs[k] for k in order]
        for leg, (x, y) in zip(legs, corners, strict=True):
            scene.connect(scene.world.frame, leg.frame_a)
            scene.connect(leg.frame_b, scene.table.at((x, y, -high)))
        scene.connect(scene.table.frame, scene.rail.frame_a)
        scene.connect(scene.rail.frame_b, scene.load.point)
        frame = scene.table.frame
        start = {
            frame.position: (0, 0, high),
            frame.rotation: np.eye(3),
            frame.velocity: (0, 0, 0),
            frame.angular_velocity: (0, 0, 0),
        }
        more = 0.05 * np.sqrt(a / g)
        run = ac.build(scene).simulate(tips + more, start | {scene.rail.q: 0.0, scene.rail.v: speed}, rtol=1e-12, compiled=False)
        opens = [t.time for t in run.transitions if t.changes]
        assert opens == pytest.approx([tips], rel=INSTANT)
        early = run.at([0.3 * tips, 0.9 * tips])
        push = np.array([early[leg.normal_force].ravel() for leg in legs])
        assert np.min(push) > 0 and np.sum(push, axis=0) == pytest.approx(g * (M + m), rel=STATE)
        load = speed * np.array([0.3, 0.9]) * tips * m * g
        assert corners.T @ push == pytest.approx(np.outer(along[:2], load), abs=STATE * g * (M + m) * (a + b))
        pushes.append(push)
        assert np.linalg.norm(run[frame.angular_velocity][-1]) > 1e-6 / of.T
    assert pushes[0] == pytest.approx(pushes[1], abs=1e-9 * g * (M + m))


class Pole:
    """Numbers of the toy of Pfeiffer and Glocker (1996), each drawn near theirs, in metres, kilogrammes and seconds; in other units by `of`.

    y: height [m], turns of sleeve and bird [rad]; the beak, the sleeve's lower and its upper edge may touch the pole.
    """

    def __init__(self, of: Drawn) -> None:
        def near(value: float) -> float:
            return value * of.within(0.9, 1.1)

        sleeve, bird, of_sleeve, of_bird = near(0.0003), near(0.0045), near(5e-9), near(7e-7)
        a, b, high, beak, stiffness = near(0.010), near(0.015), near(0.0058), near(0.02), near(0.0056)
        weights = np.array([sleeve + bird, bird * a, bird * b])
        self.mass = np.array(
            [
                weights,
                [weights[1], of_sleeve + bird * a**2, bird * a * b],
                [weights[2], bird * a * b, of_bird + bird * b**2],
            ]
        )
        self.play = np.array([near(0.0024), near(0.0006), 0])
        self.play[2] = self.play[1]
        self.normals = np.array([[0, 0, -beak], [0, high, 0], [0, -high, 0]])
        self.slips = np.array([[1, a, -near(0.0051)], [1, near(0.0031), 0], [1, 0, 0]])
        self.slips[2, 1] = self.slips[1, 1]
        self.bounce, self.mu = np.array([near(0.5), 0, 0]), near(0.3)
        self.pull = np.zeros((3, 4))  # forces by (y, sleeve, bird, 1)
        self.pull[1:, 1:3] = stiffness * np.array([[-1, 1], [1, -1]])
        self.pull[:, 3] = -G * weights
        leans = -of.within(0.8, 0.99) * self.play[1] / high  # the lower edge nearly touches
        self.start = np.array([0, leans, near(-0.25), near(-0.3), 0, near(-7.0)])


class Woodpecker(ac.Component):
    """A sleeve that falls along a pole, jams and slips, and a bird on it by a spring, whose beak strikes, linear in its angles."""

    y, sleeve, bird = (ac.Variable(unit, "place") for unit in ("m", "rad", "rad"))
    v, sleeve_rate, bird_rate = (ac.Variable(unit, "rate") for unit in ("m/s", "rad/s", "rad/s"))

    def __init__(self, pole: Pole, of: Drawn) -> None:
        self.push, self.drag = [ac.Reaction("N") for _ in pole.play], [ac.Reaction("N") for _ in pole.play]
        lever = np.array([1, of.L, of.L])  # numbers in units of which these many make metres, kilogrammes and seconds
        self.mass, self.play = of.M * np.outer(lever, lever) * pole.mass, of.L * pole.play
        self.normals, self.slips, self.mu, self.bounce = lever * pole.normals, lever * pole.slips, pole.mu, pole.bounce
        self.pull = of.M * of.L / of.T**2 * lever[:, None] * pole.pull / [of.L, 1, 1, 1]

    def equations(self) -> Iterable[ac.Equation]:
        q, u = (self.y, self.sleeve, self.bird), (self.v, self.sleeve_rate, self.bird_rate)
        for k in range(3):
            yield ac.equal(ac.der(q[k]), u[k])
            force = sum((self.pull[k, j] * q[j] for j in range(3)), self.pull[k, 3] + 0.0 * q[0])
            for i in range(3):
                force = force + self.normals[i, k] * self.push[i] + self.slips[i, k] * self.drag[i]
            yield ac.equal(sum((self.mass[k, j] * ac.der(u[j]) for j in range(1, 3)), self.mass[k, 0] * ac.der(u[0])), force)

    def laws(self) -> Iterable[ModeLaw]:
        q, u = (self.y, self.sleeve, self.bird), (self.v, self.sleeve_rate, self.bird_rate)
        for i in range(3):
            gap = self.play[i] + sum((self.normals[i, k] * q[k] for k in (1, 2)), 0.0 * q[0])
            yield ac.OneSided(self.push[i], gap, self.bounce[i])
            slip = sum((self.slips[i, k] * u[k] for k in (1, 2)), 1.0 * u[0])
            yield ac.DryFriction(self.drag[i], slip, self.mu * self.push[i], self.mu * self.push[i])


def answer(
    W: np.ndarray, rate: np.ndarray, floor: np.ndarray, mu: float, slips: np.ndarray | None = None
) -> tuple[np.ndarray, dict[int, int]]:
    """Pushes and drags (6,) of what touches, floor >= 0, with rates after it rate + W x; and what holds, with the sign of its friction, 0: sticks. All cases are tried."""
    touching, small = np.flatnonzero(floor >= 0), 1e-9 * np.max(np.abs(rate))
    for case in product(product((True, False), (0, 1, -1)), repeat=len(touching)):
        A, b = np.eye(6), np.zeros(6)
        for i, (holds, sign) in zip(touching, case, strict=True):
            A[i], b[i] = (W[i], -rate[i]) if holds else (A[i], floor[i])
            if sign:
                A[3 + i, i] = -sign * mu
            else:
                A[3 + i], b[3 + i] = W[3 + i], -rate[3 + i]
        if np.linalg.matrix_rank(A) < 6:
            continue
        x = np.linalg.solve(A, b)
        after, little = rate + W @ x, 1e-9 * np.max(np.abs(x))
        fits = True
        for i, (_, sign) in zip(touching, case, strict=True):
            fits &= x[i] >= floor[i] - little and after[i] >= -small and abs(x[3 + i]) <= mu * x[i] + little
            fits &= sign * after[3 + i] <= small if slips is None or slips[i] == 0 else sign == -slips[i]
        if fits:
            return x, {int(i): sign for i, (holds, sign) in zip(touching, case, strict=True) if holds}
    raise AssertionError("no case fits")


def pecks(pole: Pole, end: float) -> tuple[list[float], list[float], np.ndarray]:
    """Instants of impacts, of all events, and the last places, rates and 1 (7,)."""
    t, strikes, events, step, J, mu = 0.0, [], [], 1e-4, np.vstack([pole.normals, pole.slips]), pole.mu
    z, pull = np.append(pole.start, 1), np.hstack([pole.pull[:, :3], np.zeros((3, 3)), pole.pull[:, 3:]])
    W, free = J @ np.linalg.solve(pole.mass, J.T), J @ np.linalg.solve(pole.mass, pull)
    while True:
        touches, rate = pole.play + pole.normals @ z[:3] < 1e-12, J @ z[3:6]
        if np.any(rate[:3][touches] < -1e-9):
            first, _ = answer(W, rate, np.where(touches, 0.0, -1.0), mu)
            more, _ = answer(W, rate + W @ first, np.where(touches, pole.bounce * first[:3], -1.0), mu)
            z[3:6] += np.linalg.solve(pole.mass, J.T @ (first + more))
            strikes.append(t)
            continue
        slips = np.where(np.abs(rate[3:]) > 1e-9, np.sign(rate[3:]), 0)
        soon = np.concatenate([z[:3] + 1e-7 * z[3:6], z[3:]])  # what is at its limit is beyond it then, or not
        _, mode = answer(W, free @ soon, np.where(touches & (rate[:3] < 1e-9), 0.0, -1.0), mu, slips)
        # forces are linear in z as long as these go on
        S, right = np.eye(6), np.zeros((6, 7))
        for i, sign in mode.items():
            S[i], right[i] = W[i], -free[i]
            if sign:
                S[3 + i, i] = -sign * mu
            else:
                S[3 + i], right[3 + i] = W[3 + i], -free[3 + i]
        forces, A = np.linalg.solve(S, right), np.zeros((7, 7))
        A[:3, 3:6], A[3:6] = np.eye(3), np.linalg.solve(pole.mass, pull + J.T @ forces)
        # that is as long as all of these are positive
        signs = [np.array([*pole.normals[i], 0, 0, 0, pole.play[i]]) for i in range(3) if i not in mode]
        signs += [forces[i] for i in mode]
        for i, sign in mode.items():
            more = [mu * forces[i] + s * forces[3 + i] for s in (1, -1)]
            signs += [np.array([0, 0, 0, *(-sign * pole.slips[i]), 0])] if sign else more
        C, flow, now, begin = np.array(signs), expm(A * step), z, 2e-6
        assert np.all(C @ expm(A * begin) @ z > 0)
        while t < end and np.all(C @ flow @ now > 0):
            t, now, begin = t + step, flow @ now, 0.0
        left = lambda s, A, c, now: c @ expm(A * s) @ now  # noqa: E731
        ends = [c for c in C if c @ flow @ now <= 0]
        past = [brentq(left, begin, step, args=(A, c, now), xtol=1e-17, rtol=1e-15) for c in ends]
        if t >= end or t + min(past) > end:
            return strikes, events, expm(A * (end - t)) @ now
        t, z = t + min(past), expm(A * min(past)) @ now
        events.append(t)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_woodpecker_jams_slips_and_pecks_as_a_program_says_that_tries_all_cases(seed: int) -> None:
    """The sleeve jams at its lower edge and slips off it, the beak strikes, the sleeve jams at its upper edge; by Poisson's law with friction, over two periods or so."""
    of = Drawn(seed)
    pole, end = Pole(of), 0.3
    scene = ac.System()
    scene.toy = toy = Woodpecker(pole, of)
    states, units = (toy.y, toy.sleeve, toy.bird, toy.v, toy.sleeve_rate, toy.bird_rate), np.array([of.L, 1, 1] * 2)
    units[3:] /= of.T
    strikes, events, z = pecks(pole, end)
    run = ac.build(scene).simulate(end * of.T, dict(zip(states, units * pole.start, strict=True)), rtol=1e-12, compiled=False)
    assert len(strikes) > 4 and np.array(impacts(run)) / of.T == pytest.approx(strikes, rel=INSTANT)
    found = sorted({t.time / of.T for t in run.transitions})
    assert found == pytest.approx(events, rel=INSTANT)
    scale = np.max(np.abs(np.array([run[x] for x in states])), axis=1).ravel()
    assert np.array([run[x][-1] for x in states]) / scale == pytest.approx(units * z[:6] / scale, abs=STATE)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_tippe_top_slips_and_turns_over_as_its_own_equations_say(seed: int) -> None:
    """A ball whose centre of mass is below its middle, by Newton and Euler, in units of its radius, mass and weight: the force at its foot follows from that this stays on the floor."""
    of = Drawn(seed)
    a, A, C, mu = of.within(0.18, 0.22), of.within(0.36, 0.38), of.within(0.34, 0.36), of.within(0.28, 0.32)
    up, tilt, spin, speed, end = np.array([0.0, 0.0, 1.0]), of.within(0.18, 0.22), of.within(5.2, 5.6), of.within(0.2, 0.25), 7.0

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        v, w, e = y[3:6], y[6:9], y[9:12]  # of the centre of mass, of the body, its axis
        arm = a * e - up  # from the centre of mass, at -a e from the middle, to the foot
        slip = v + np.cross(w, arm)
        push = up - mu * slip[:2] @ np.eye(2, 3) / np.hypot(*slip[:2])
        turned = np.cross(-w, A * w + (C - A) * (w @ e) * e)
        inverse = np.eye(3) / A + (1 / C - 1 / A) * np.outer(e, e)
        # the height of the foot, z - a e_z - 1 + ..., does not change: v_z' = -a e''_z
        free, by = inverse @ turned, inverse @ np.cross(arm, push)
        bend = np.cross(free, e)[2] + np.cross(w, np.cross(w, e))[2]
        N = (1 - a * bend) / (1 + a * np.cross(by, e)[2])
        return np.concatenate([v, N * push - up, free + N * by, np.cross(w, e)])

    e = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    begin = np.concatenate([up - a * e, [speed, 0.0, 0.0], spin * up, e])
    begin[3:6] -= np.cross(begin[6:9], a * e)
    other = solve_ivp(rates, (0, end), begin, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    r, T, Q, place, inertia = of.L, np.sqrt(of.L / of.g), of.turn(), of.place(), of.M * of.L**2
    scene, friction = ac.System(), Coulomb(mu)
    scene.world, scene.top = (
        World(tuple(-of.g * Q[:, 2])),
        RigidBody(of.M, (A * inertia, A * inertia, C * inertia), centre_of_mass=(0, 0, -a * r)),
    )
    scene.floor = RoughContact(Sphere(r), Plane(), friction) if seed % 2 else Contact(Sphere(r), Plane(), Hard(friction=friction))
    scene.connect(scene.world.at(tuple(place), rotation=Q), scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.top.frame)
    f, c, s = scene.top.frame, np.cos(tilt), np.sin(tilt)
    start = {f.position: place + r * Q[:, 2], f.rotation: Q @ [[c, 0, s], [0, 1, 0], [-s, 0, c]]}
    start |= {f.velocity: speed * r / T * Q[:, 0], f.angular_velocity: spin / T * Q[:, 2]}
    run = ac.build(scene).simulate(end * T, start, rtol=1e-12, samples=2)
    axis = Q.T @ run[f.rotation][-1][:, 2]
    assert axis == pytest.approx(other[9:12], abs=STATE)
    assert run[f.angular_velocity][-1] @ Q * T == pytest.approx(other[6:9], abs=STATE)
    assert (run[f.position][-1] - place) @ Q / r - a * axis == pytest.approx(other[:3], abs=STATE)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("locked", ["stands", "slides"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_car_with_its_lower_wheels_locked_stands_or_slides_by_what_these_bear(seed: int, locked: str) -> None:
    """The others roll freely. It slides where sin > mu times the part of the weight on the locked ones, which grows with its height and its braking."""
    of = Drawn(seed)
    m, g, end, mu = of.M, of.g, of.T, of.within(0.2, 0.8)
    before, behind, side = of.L * of.rng.uniform(0.5, 1.5, 3)
    high = of.L * of.within(0.1, 0.5)
    # moments about the centre: front * before - back * behind = rubs * high
    bears = behind / (before + behind - mu * high)
    angle = np.arctan(mu * bears) * (of.within(1.01, 1.3) if locked == "slides" else of.within(0.3, 0.99))
    scene = ac.System()
    scene.world = World((g * np.sin(angle), 0, -g * np.cos(angle)))
    scene.car = RigidBody(m, tuple(m * of.L**2 * of.rng.uniform(0.5, 0.9, 3)))
    scene.locked = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in range(2)]
    scene.free = [PointOnPlane(unilateral=True) for _ in range(2)]
    for wheels, x in ((scene.locked, before), (scene.free, -behind)):
        for wheel, y in zip(wheels, (side, -side), strict=True):
            scene.connect(scene.world.frame, wheel.frame_a)
            scene.connect(wheel.frame_b, scene.car.at((x, y, -high)))
    f = scene.car.frame
    start = {f.position: (0, 0, high), f.rotation: np.eye(3), f.velocity: (0, 0, 0), f.angular_velocity: (0, 0, 0)}
    run = ac.build(scene).simulate(end, start, rtol=1e-11, compiled=False)
    pull = g * (np.sin(angle) - mu * bears * np.cos(angle))
    if locked == "slides":
        assert run[f.velocity][-1] == pytest.approx([pull * end, 0, 0], abs=1e-10 * g * end)
    else:
        assert np.abs(run[f.velocity]).max() < 1e-12 * g * end


@each_value(("size", [1e-3, 1.0, 1e3]), (("pace", "slack", "away"), [(1.5, 0.3, 30.0), (0.2, 0.05, 0.0), (0.11, 1.0, 0.0)]))
def test_a_stone_on_the_ground_is_lifted_by_its_sling_and_falls_back_again_and_again(
    size: float, pace: float, slack: float, away: float
) -> None:
    # where the rope tightens, and where its swing ends on the ground, it keeps the part of its speed along the swing, then along the ground
    height, length, speed, g = 2.0 * size, 2.5 * size, pace * np.sqrt(size), G
    reach = np.sqrt(length**2 - height**2)
    scene = ac.System()
    scene.world, scene.stone, scene.sling, scene.floor = World(), Particle(5.0), Rope(length), PointOnPlane(unilateral=True)
    scene.connect(scene.world.at((away * size, 0, height)), scene.sling.frame_a)
    scene.connect(scene.sling.frame_b, scene.stone.point, scene.floor.frame_b)
    scene.connect(scene.world.frame, scene.floor.frame_a)

    def aloft(v: float) -> float:
        def top(t: float, y: np.ndarray) -> float:
            return float(y[1])

        top.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
        start = [np.arcsin(reach / length), v * height / length**2]
        up = solve_ivp(
            lambda t, y: [y[1], -g / length * np.sin(y[0])],
            (0, 9 * np.sqrt(size)),
            start,
            "DOP853",
            events=top,
            rtol=1e-13,
            atol=1e-16,
        )
        return 2 * up.t_events[0][0]

    times, kept = [slack * size / speed], (height / length) ** 2
    for k in range(3):
        flight = aloft(speed * kept**k)
        times += [times[-1] + flight, times[-1] + flight + 2 * reach / (speed * kept ** (k + 1))]
    place, motion = scene.stone.point.position, scene.stone.point.velocity
    run = ac.build(scene).simulate(
        times[-1] + 0.5 * aloft(speed * kept**3),
        {place: (reach + (away - slack) * size, 0, 0), motion: (speed, 0, 0)},
        rtol=1e-12,
    )
    assert [change.time for change in run.transitions] == pytest.approx(times, rel=1e-10)
    assert run.transitions[-1].after[motion][0] == pytest.approx(-speed * kept**4, rel=1e-9)
