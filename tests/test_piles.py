"""Piles: shapes that fall on one another and settle, whatever their sizes, masses, laws and tolerances.

What strikes what is chaotic, but at each instant an independent formulation says what happens: without friction and restitution, speeds after an
impact are the nearest ones, in the metric of masses, at which nothing that touches closes. At all times nothing goes through anything, energy never grows, and runs end.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import nnls

import acausal as ac
from acausal.simulate.trajectory import Trajectory
from components import (
    CartesianTranslation,
    Contact,
    Coulomb,
    Force,
    Hard,
    Planar,
    Plane,
    PointOnPlane,
    Prismatic,
    RigidBody,
    Sphere,
    World,
)
from tests.pairings import each_value

G = 9.81
Walls = tuple[tuple[tuple[float, float], tuple[float, float]], ...]  # points and normals (x, z), in units of the size
FLOOR: Walls = (((0, 0), (0, 1)),)
VEE: Walls = (((0, 0), (0.6, 0.8)), ((0, 0), (-0.8, 0.6)))
BOX: Walls = (((0, 0), (0, 1)), ((-0.5, 0), (1, 0)), ((0.5, 0), (-1, 0)))


@dataclass(frozen=True)
class Pile:
    """Disks of so large `radii` and `masses` in a plane, among `walls` at a distance of `size`; `places` and `speeds` (n, 2) at the start."""

    radii: np.ndarray
    masses: np.ndarray
    walls: Walls
    places: np.ndarray
    speeds: np.ndarray
    size: float

    def run(self, law: Hard, end: float, order: list[int] | None = None, t0: float = 0.0, **options: float) -> Trajectory:
        n, scene = len(self.radii), ac.System()
        scene.world = World(gravity=(0, 0, -G * self.size))
        scene.balls = [RigidBody.ball(float(m), float(r)) for m, r in zip(self.masses, self.radii, strict=True)]
        scene.rails = [Planar("y") for _ in range(n)]
        for rail, ball in zip(scene.rails, scene.balls, strict=True):
            scene.connect(scene.world.frame, rail.frame_a)
            scene.connect(rail.frame_b, ball.frame)
        pairs = [(a, ball) for a in range(-len(self.walls), 0) for ball in range(n)] + list(combinations(range(n), 2))
        pairs = [pairs[k] for k in order] if order else pairs
        scene.contacts = [
            Contact(Sphere(float(self.radii[b])), Plane() if a < 0 else Sphere(float(self.radii[a])), law) for a, b in pairs
        ]
        for contact, (a, b) in zip(scene.contacts, pairs, strict=True):
            if a < 0:
                (x, z), (nx, nz) = self.walls[a]
                base = scene.world.at((self.size * x, 0, self.size * z), ((nz, 0, nx), (0, 1, 0), (-nx, 0, nz)))
            else:
                base = scene.balls[a].frame
            scene.connect(base, contact.frame_a)
            scene.connect(contact.frame_b, scene.balls[b].frame)
        start = {}
        for rail, (x, z), (u, w) in zip(scene.rails, self.places, self.speeds, strict=True):
            start |= {rail.q: (z, x, 0.0), rail.v: (w, u, 0.0)}
        return ac.build(scene).simulate(t0 + end, start, t0=t0, samples=2, progress=False, max_steps=5000, **options)  # pyright: ignore[reportArgumentType]

    def states(self, run: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places and speeds (steps, n, 2), and spins (steps, n), at the ends of all steps; states are found by where they are at the start."""
        x = run.solution.x
        at, fast = (
            np.array([[np.flatnonzero(x[:, 0] == value).item() for value in row] for row in of])
            for of in (self.places, self.speeds)
        )
        return x[at].transpose(2, 0, 1), x[fast].transpose(2, 0, 1), x[fast[:, 0] + 1].T

    def rows(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gaps, and their derivatives by all places (gaps, 2 n)."""
        n, gaps, rows = len(self.radii), [], []
        for point, normal in self.walls:
            e = np.array(normal, float) / np.hypot(*normal)
            for a in range(n):
                row = np.zeros((n, 2))
                row[a] = e
                gaps.append((places[a] - self.size * np.array(point)) @ e - self.radii[a])
                rows.append(row.ravel())
        for a, b in combinations(range(n), 2):
            d, row = places[a] - places[b], np.zeros((n, 2))
            row[a], row[b] = d / np.hypot(*d), -d / np.hypot(*d)
            gaps.append(np.hypot(*d) - self.radii[a] - self.radii[b])
            rows.append(row.ravel())
        return np.array(gaps), np.array(rows)

    def deepest(self, run: Trajectory) -> float:
        """The least gap at the ends of all steps, in units of the size."""
        return min(np.min(self.rows(places)[0]) for places in self.states(run)[0]) / self.size

    def energy(self, run: Trajectory) -> np.ndarray:
        places, speeds, spins = self.states(run)
        kinetic = np.sum(self.masses * (np.sum(speeds**2, axis=2) + 0.4 * (self.radii * spins) ** 2), axis=1) / 2
        return kinetic + np.sum(self.masses * G * self.size * places[:, :, 1], axis=1)


def drawn(seed: int, n: int, walls: Walls, size: float = 1.0, mass: float = 1.0) -> Pile:
    rng = np.random.default_rng(seed)
    radii = size * rng.uniform(0.08, 0.2, n)
    z = (0.3 * size if walls is VEE else 0.0) + 1.05 * np.cumsum(radii) + np.concatenate(([0.0], np.cumsum(radii[:-1])))
    places = np.column_stack((0.25 * size * rng.uniform(-1, 1, n), z))
    return Pile(radii, mass * rng.uniform(0.3, 3, n), walls, places, size * rng.uniform(-1, 1, (n, 2)), size)


def check(pile: Pile, run: Trajectory, grows: float) -> None:
    assert pile.deepest(run) > -1e-12
    energy = pile.energy(run)
    assert np.max(np.diff(energy)) < grows * np.ptp(energy)


@pytest.mark.parametrize("walls, seed, size, mass", [(FLOOR, 2, 1.0, 1.0), (VEE, 2, 1e-5, 1e3), (BOX, 3, 1e5, 1e-3)])
def test_speeds_after_each_impact_are_the_nearest_at_which_nothing_closes(
    walls: Walls, seed: int, size: float, mass: float
) -> None:
    """Nearest: nothing that touches closes, all impulses push, and they do no work on the speeds that are left."""
    pile = drawn(seed, 5, walls, size, mass)
    run = pile.run(Hard(0.0), 0.6, rtol=1e-9)
    check(pile, run, 1e-9)
    places, speeds, _ = pile.states(run)
    masses, impacts, fast = np.repeat(pile.masses, 2), 0, size * np.sqrt(G)
    for k in np.flatnonzero(np.diff(run.solution.t) == 0):
        gaps, rows = pile.rows(places[k])
        gained, left = masses * (speeds[k + 1] - speeds[k]).ravel(), speeds[k + 1].ravel()
        blow, unseen = np.linalg.norm(gained), 2e-6 * mass * fast  # of bounces that are too low to be seen
        if blow < 10 * unseen:
            continue
        impacts += 1
        assert np.min(rows[gaps < 1e-15 * size] @ left) > -1e-9 * fast
        assert blow * nnls(rows[gaps < 1e-11 * size].T, gained / blow)[1] < unseen
        assert abs(gained @ left) < unseen * fast
    assert impacts >= 5


@pytest.mark.slow
@pytest.mark.parametrize("seed, end", [(16, 0.6), (12, 0.7), (19, 0.3)])
def test_disks_that_jam_are_stopped_at_once(seed: int, end: float) -> None:
    """What slides is drawn into a wedge narrower than friction: there is no acceleration, and it is stopped by a blow of its own, or with that of another disk; slip that
    begins from what holding leaves of it, the other way, goes on."""
    pile = drawn(seed, 5, VEE)
    check(pile, pile.run(Hard(0.0, Coulomb(0.9)), end, rtol=1e-6), 1e-6)


@pytest.mark.slow
def test_disks_that_rattle_between_others_without_restitution_come_to_rest() -> None:
    """A blow from one side opens the other: bounces without end, though none gives anything back, whose falls depend on what others bear."""
    pile = drawn(17, 5, VEE)
    check(pile, pile.run(Hard(0.0, Coulomb(0.5)), 0.8, rtol=1e-6), 1e-6)


@pytest.mark.parametrize("size, t0", [(1.0, 0.0), (1e-5, 1e3), (1e5, 1e6)])
def test_a_disk_settles_in_a_corner_where_it_sticks_on_one_side_and_bounces_on_the_other(size: float, t0: float) -> None:
    """It rests where both sides touch it: at its radius over the cosines of their slopes."""
    r = 0.1 * size
    pile = Pile(np.array([r]), np.array([2.0]), VEE, size * np.array([[0.05, 0.4]]), size * np.array([[0.3, 0.01]]), size)
    run = pile.run(Hard(0.6, Coulomb(1.0)), 3.0, t0=t0, rtol=1e-12)
    check(pile, run, 1e-9)
    gaps = pile.rows(pile.states(run)[0][-1])[0]
    assert np.max(np.abs(gaps)) < 1e-13 * size and np.max(np.abs(pile.states(run)[1][-1])) < 1e-13 * size


@pytest.mark.parametrize("t0", [0.0, 1e6])
@pytest.mark.parametrize("height", [1e-3, 1e-9, 1e-12])
def test_what_is_dropped_from_next_to_nothing_slides_until_it_must_stop(height: float, t0: float) -> None:
    """v / (mu g) after it touches: the impulses of all bounces together are those of the weight. Bounces end where rounding of places, or of times, hides them."""
    speed, mu, e = 0.3, 0.3, 0.5
    scene = ac.System()
    scene.world, scene.body, scene.slide, scene.rise = World(), RigidBody(1.0, inertia=np.eye(3)), Prismatic("x"), Prismatic("z")
    scene.foot = PointOnPlane(unilateral=True, restitution=e, friction=Coulomb(mu))
    for a, b in (
        (scene.world.frame, scene.slide.frame_a),
        (scene.slide.frame_b, scene.rise.frame_a),
        (scene.rise.frame_b, scene.body.frame),
        (scene.world.frame, scene.foot.frame_a),
        (scene.foot.frame_b, scene.body.frame),
    ):
        scene.connect(a, b)
    start = {scene.slide.q: 0.0, scene.slide.v: speed, scene.rise.q: height, scene.rise.v: 0.0}
    run = ac.build(scene).simulate(t0 + 0.2, start, t0=t0, progress=False, max_steps=1000)
    assert np.min(run[scene.rise.q]) > -1e-15
    assert run[scene.slide.v][-1].item() == 0 and run[scene.rise.v][-1].item() == 0
    stops = run.solution.modes.changes[-1].time - t0  # pyright: ignore[reportOptionalMemberAccess]
    assert stops == pytest.approx(speed / (mu * G), rel=1e-6, abs=64 * np.spacing(t0))


def test_nothing_is_missed_while_bounces_of_another_are_bridged() -> None:
    """One ball comes to rest at its limit; another one, let go at the same time, strikes in the last moment before that."""
    e, low, r = 0.5, 0.2, 0.1
    rest = np.sqrt(2 * low / G) * (1 + e) / (1 - e)
    for part in (2e-7, 5e-7, 8e-7):
        first = np.sqrt(2 * low / G)
        high = 0.5 * G * (rest - part * (rest - first)) ** 2
        pile = Pile(
            np.array([r, r]),
            np.ones(2),
            FLOOR,
            np.array([[-1.0, low + r], [1.0, high + r]]),
            np.array([[0.01, 0.0], [0.02, 0.03]]),
            1.0,
        )
        pile.speeds[:, 1] = (1e-200, 2e-200)  # by which their states are told from one another
        run = pile.run(Hard(e), 1.2 * rest, rtol=1e-10)
        check(pile, run, 1e-9)
        falls = pile.states(run)[1][:, 1, 1]
        struck = np.flatnonzero((falls[:-1] < -1) & (falls[1:] > 1))
        assert run.solution.t[struck[0]] == pytest.approx(np.sqrt(2 * high / G), rel=1e-9)


def stack(size: float, turning: bool) -> tuple[ac.System, dict[ac.Expression, tuple[float, ...]]]:
    """A smooth ball above another one, a little aside, dropped on the floor; `turning`: they may turn, which nothing makes them do."""
    scene = ac.System()
    scene.world, scene.balls = World(gravity=(0, 0, -9.81 * size)), [RigidBody.ball(1.0, 0.05 * size) for _ in range(2)]
    law = Hard(0.5)
    scene.floors, scene.pair = (
        [Contact(Sphere(0.05 * size), Plane(), law) for _ in range(2)],
        Contact(Sphere(0.05 * size), Sphere(0.05 * size), law),
    )
    scene.slides = [] if turning else [CartesianTranslation() for _ in range(2)]
    for slide, ball in zip(scene.slides, scene.balls, strict=False):
        scene.connect(scene.world.frame, slide.frame_a)
        scene.connect(slide.frame_b, ball.frame)
    for floor, ball in zip(scene.floors, scene.balls, strict=True):
        scene.connect(scene.world.frame, floor.frame_a)
        scene.connect(floor.frame_b, ball.frame)
    scene.connect(scene.balls[0].frame, scene.pair.frame_a)
    scene.connect(scene.pair.frame_b, scene.balls[1].frame)
    places = (0.0004, -0.0004, 0.0601), (-0.0014, -0.0012, 0.1711)
    return scene, {ball.frame.position: tuple(size * x for x in place) for ball, place in zip(scene.balls, places, strict=True)}


@each_value(("size", [1e-6, 1.0, 1e5]), ("rtol", [1e-6, 1e-12]))
def test_spins_that_are_nothing_but_rounding_of_blows_do_not_shorten_steps(size: float, rtol: float) -> None:
    """Bounces without end leave them at 1e-18, where rounding moves them more than any tolerance allows."""
    ends = []
    for turning in (True, False):
        scene, start = stack(size, turning)
        run = ac.build(scene).simulate(0.35, start, rtol=rtol, progress=False)
        assert run.statistics.steps < 400
        ends.append(np.concatenate([run[ball.frame.position][-1] for ball in scene.balls]) / size)
    assert ends[0] == pytest.approx(ends[1], abs=max(1e-8, 100 * rtol))


@each_value(("order", [1, -1]), ("size", [1e-4, 1.0, 1e3]))
def test_what_slides_goes_on_while_something_else_comes_to_rest(size: float, order: int) -> None:
    """A block bounces to rest without slip, and is pushed along from t = 1 s to 1.2 s with twice its friction; another one bounces until 1.35 s, when the first one slides yet."""
    scene = ac.System()
    scene.world, mu = World(gravity=(0, 0, -G * size)), 0.3
    scene.along, scene.up = [Prismatic("x") for _ in range(2)], [Prismatic("z") for _ in range(2)]
    scene.blocks, scene.feet = (
        [RigidBody.box(2.0, (size,) * 3) for _ in range(2)],
        [PointOnPlane(unilateral=True, restitution=0.5, friction=Coulomb(mu)) for _ in range(2)],
    )
    scene.push = Force(lambda t: (ca.if_else(ca.logic_and(t >= 1, t < 1.2), 2 * mu * 2.0 * G * size, 0), 0, 0))
    for along, up, block, foot in [*zip(scene.along, scene.up, scene.blocks, scene.feet, strict=True)][::order]:
        scene.connect(scene.world.frame, along.frame_a)
        scene.connect(along.frame_b, up.frame_a)
        scene.connect(up.frame_b, block.frame)
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(block.frame, foot.frame_b)
    scene.connect(scene.blocks[0].frame, scene.push.point)
    run = ac.build(scene).simulate(
        2.0, {scene.up[0].q: 0.1 * size, scene.up[1].q: size, scene.along[1].v: 0.1 * size}, rtol=1e-11
    )
    assert run[scene.along[0].q][-1] == pytest.approx(0.2**2 * mu * G * size, rel=1e-9)


@pytest.mark.parametrize(
    ("size", "restitution", "masses", "radii"),
    [
        (1.0, 0.8, (7.159, 8.627, 0.107, 5.337), (0.295, 0.289, 0.087, 0.293)),
        (10.0, 0.5, (0.137, 2.545), (0.1297, 0.1625)),
        (100.0, 1.0, (2.628, 0.151, 1.826), (0.2952, 0.1559, 0.0781)),
        (1e-3, 0.8, (7.167, 0.439, 6.544, 0.1, 0.251), (0.2037, 0.2591, 0.065, 0.0744, 0.1687)),
        (1.0, 0.0, (0.26, 3.17, 0.36), (0.17, 0.3, 0.29)),
    ],
)
def test_balls_that_touch_and_are_dropped_together_bounce_in_unison(
    size: float, restitution: float, masses: tuple[float, ...], radii: tuple[float, ...]
) -> None:
    """With one restitution all around no speed between two that touch is given one by an impact: they bounce as one would, however often, though rounding parts them."""
    scene, n, e = ac.System(), len(masses), restitution
    scene.world = World(gravity=(0, 0, -G * size))
    scene.rails = [Prismatic("z") for _ in masses]
    scene.balls = [RigidBody.ball(mass, size * radius) for mass, radius in zip(masses, radii, strict=True)]
    below = [Plane(), *(Sphere(size * radius) for radius in radii[:-1])]
    scene.touch = [Contact(Sphere(size * radius), shape, Hard(e)) for radius, shape in zip(radii, below, strict=True)]
    for k in range(n):
        scene.connect(scene.world.frame, scene.rails[k].frame_a)
        scene.connect(scene.rails[k].frame_b, scene.balls[k].frame)
        scene.connect(scene.balls[k - 1].frame if k else scene.world.frame, scene.touch[k].frame_a)
        scene.connect(scene.touch[k].frame_b, scene.balls[k].frame)
    fall, at_rest = np.sqrt(2 / G), [2 * sum(radii[:k]) + radii[k] for k in range(n)]  # from the size above the floor
    instants = fall * np.cumsum([1.0, *(2 * e ** (k + 1) for k in range(4 if e else 0))])
    end = instants[-1] + (0.5 * fall * e**5 if e else fall)
    start = {rail.q: size * (1 + place) for rail, place in zip(scene.rails, at_rest, strict=True)}
    run = ac.build(scene).simulate(end, start | {rail.v: 0.0 for rail in scene.rails}, rtol=1e-12)
    np.testing.assert_allclose(list(dict.fromkeys(line.time for line in run.transitions)), instants, rtol=1e-12)
    since, speed = end - instants[-1], G * fall * e ** len(instants)
    height = speed * since - G * since**2 / 2 if e else 0.0
    for rail, place in zip(scene.rails, at_rest, strict=True):
        np.testing.assert_allclose(run[rail.q][-1], size * (place + height), rtol=1e-11)
        np.testing.assert_allclose(run[rail.v][-1], size * (speed - G * since if e else 0.0), atol=1e-11 * size)
