"""Bodies at rest on more than carries them: what they do is decided for all contacts together, whatever the forces that are not unique."""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

import acausal as ac
from acausal.errors import SingularWarning
from components import (
    Contact,
    Coulomb,
    Force,
    Hard,
    HeightField,
    Particle,
    PointOnPlane,
    Prismatic,
    Revolute,
    RigidBody,
    Sphere,
    World,
)
from tests.drawn import SEEDS, Drawn

G = 9.81
INSTANT = 1e-11
CORNERS = ((0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15))


def pushed(order: tuple[int, ...], mu: float, direction: tuple[float, float], size: float = 1.0) -> tuple[ac.System, dict]:
    """A box of 2 kg and height 0.4 on four feet, declared in an order, pushed 0.1 above its centre by 10 N/s; and its start."""
    scene = ac.System()
    scene.world, scene.box = World((0, 0, -G * size)), RigidBody.box(mass=2.0, size=(0.4 * size, 0.3 * size, 0.4 * size))
    feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in CORNERS]
    scene.feet = [feet[k] for k in order]
    for foot, (x, y) in zip(feet, CORNERS, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x * size, y * size, -0.2 * size)))
    scene.push = Force(lambda t: (10 * size * t * direction[0], 10 * size * t * direction[1], 0))
    scene.connect(scene.push.point, scene.box.at((0, 0, 0.1 * size)))
    frame = scene.box.frame
    start = {frame.position: (0, 0, 0.2 * size), frame.rotation: np.eye(3), frame.velocity: (0, 0, 0)}
    return scene, start | {frame.angular_velocity: (0, 0, 0)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "direction", "size"), [((0, 1, 2, 3), (1.0, 0.0), 1e-6), ((3, 1, 0, 2), (0.6, 0.8), 1.0)], ids=["edge", "askew"]
)
def test_a_pushed_box_tips_when_its_load_leaves_its_feet_and_no_foot_opens_before(
    order: tuple[int, ...], direction: tuple[float, float], size: float
) -> None:
    """F H = m g a about the first edge that is reached; single feet of least norm are at their limits long before."""
    scene, start = pushed(order, 0.9, direction, size)
    run = ac.build(scene).simulate(1.4, start, rtol=1e-12)
    tips = 2 * G / (10 * 0.3) * min(0.2 / direction[0], 0.15 / direction[1] if direction[1] else np.inf)
    times = [t.time for t in run.transitions if t.changes]
    assert times and times == pytest.approx(
        [tips] * len(times), rel=1e-11
    )  # feet may be told to lift one after the other within this
    before, after = run.at([0.999 * tips]), run.at([1.001 * tips])
    edge = int(direction[1] > direction[0])  # feet beyond the middle on this axis are those that it tips over
    assert [after[foot.normal_force].item() > 0 for foot in scene.feet] == [CORNERS[k][edge] > 0 for k in order]
    assert sum(before[foot.normal_force].item() for foot in scene.feet) == pytest.approx(2 * G * size, rel=1e-9)
    assert all(before[foot.normal_force].item() > 0 for foot in scene.feet)
    drag = sum(before[foot.friction_force][0] for foot in scene.feet)
    assert drag[:2] == pytest.approx(-9.99 * tips * size * np.array(direction), rel=1e-9)
    assert np.max(np.abs(before[scene.box.frame.position] - [[0, 0, 0.2 * size]])) < 1e-12 * size


def test_a_pushed_box_slides_when_friction_of_all_feet_together_is_too_little_however_slowly_that_begins() -> None:
    """F = mu m g, whichever foot is at its limit before; then m v' = F - mu m g, from zero on, in steps that the motion asks for."""
    scene, start = pushed((2, 0, 1, 3), 0.3, (0.6, 0.8))
    run = ac.build(scene).simulate(0.8, start, rtol=1e-12)
    slides = 0.3 * 2 * G / 10
    assert [t.time for t in run.transitions if t.changes] == pytest.approx([slides], rel=1e-11)
    speed = 10 * (0.8**2 - slides**2) / 4 - 0.3 * G * (0.8 - slides)
    assert run[scene.box.frame.velocity][-1] == pytest.approx([0.6 * speed, 0.8 * speed, 0], abs=1e-11)
    assert run.steps.t.size < 200


@pytest.mark.parametrize("seed", SEEDS)
def test_points_that_begin_to_slip_one_after_the_other_while_their_loads_turn_go_as_they_are_driven(seed: int) -> None:
    """Each is driven by m (v' + mu g v / |v|) for v = j s^2 / 2 (1 - s / b), s = t - a, in a direction that turns: it slips from a on, from no acceleration,
    and stops at a + b. In tens of steps each."""
    n, scene, start = Drawn(seed), ac.System(), {}
    scene.world, g, T, end = World((0, 0, -n.g)), n.g, n.T, 0.25 * n.T
    asked = [
        (
            n.within(0.3, 0.8),
            T * (0.05 + 0.02 * k + n.within(0, 0.01)),
            T * n.within(0.12, 0.2),
            n.within(0.3, 0.8) * g / T,
            n.within(-6, 6) / T,
        )
        for k in range(5)
    ]
    scene.points, scene.feet = (
        [Particle(n.M * n.within(0.3, 3)) for _ in asked],
        [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for mu, *_ in asked],
    )
    scene.loads, places = [], [n.place() * (1, 1, 0) for _ in asked]
    for place, point, foot, (mu, a, b, j, w) in zip(places, scene.points, scene.feet, asked, strict=True):
        s = ac.time - a
        pull, turned, x, y = j * s * (1 - 1.5 * s / b) + mu * g, j * s**2 / 2 * (1 - s / b) * w, np.cos(w * s), np.sin(w * s)
        scene.loads.append(Force((point.mass * (pull * x - turned * y), point.mass * (pull * y + turned * x), 0)))
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, point.point)
        scene.connect(scene.loads[-1].point, point.point)
        start |= {point.point.position: place, point.point.velocity: (0, 0, 0)}
    run = ac.build(scene).simulate(end, start, rtol=1e-12, samples=2)
    nodes, weights = np.polynomial.legendre.leggauss(30)
    for k, (place, point, (_, a, b, j, w)) in enumerate(zip(places, scene.points, asked, strict=True)):
        last = min(end - a, b)
        s = last * (1 + nodes) / 2
        moved = last / 2 * weights @ (j * s**2 / 2 * (1 - s / b) * np.exp(1j * w * s))
        assert run[point.point.position][-1] == pytest.approx(place + np.array([moved.real, moved.imag, 0]), abs=1e-11 * n.L)
        times = [t.time for t in run.transitions if any(part.startswith(f"feet[{k}]") for part in t.parts)]
        assert times == pytest.approx([t for t in (a, a + b) if t < end], rel=INSTANT)
    assert run.statistics.steps < 600  # of ten slips that begin or end


@pytest.mark.parametrize("direction", [0.65, 0.7246027037455638])
def test_a_pushed_box_tips_once_and_only_then_at_any_tolerance(direction: float) -> None:
    """The same, in directions that differ by how much less the load of one of the two last feet is; friction of feet that carry nothing holds nothing, whatever forces it was left by rounding."""
    across, aside = np.cos(direction), np.sin(direction)
    scene, start = pushed((3, 1, 0, 2), 0.9, (across, aside))
    model, tips = ac.build(scene), 2 * G / (10 * 0.3) * min(0.2 / across, 0.15 / aside)
    for k in range(8):
        run = model.simulate(1.01 * tips, start, rtol=1e-12 * 1.6**k)
        assert [t.time for t in run.transitions if t.changes] == pytest.approx([tips], rel=INSTANT)


def loaded(order: tuple[int, ...], along: np.ndarray, friction: float) -> tuple[ac.System, list[Any], dict[Any, Any]]:
    """A table of 3 kg on four legs, declared in an order, on which 2 kg run outward from its middle with 0.5 m/s."""
    scene, corners = ac.System(), [(0.4, 0.3), (0.4, -0.3), (-0.4, 0.3), (-0.4, -0.3)]
    scene.world, scene.table = World((0, 0, -G)), RigidBody.box(3.0, (0.8, 0.6, 0.05))
    scene.rail, scene.load = Prismatic((*along, 0)), Particle(2.0)
    legs = [PointOnPlane(unilateral=True, friction=Coulomb(friction) if friction else None) for _ in corners]
    scene.legs = [legs[k] for k in order]
    for leg, (x, y) in zip(legs, corners, strict=True):
        scene.connect(scene.world.frame, leg.frame_a)
        scene.connect(leg.frame_b, scene.table.at((x, y, -0.7)))
    scene.connect(scene.table.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.load.point)
    f = scene.table.frame
    start = {f.position: (0, 0, 0.7), f.rotation: np.eye(3), f.velocity: (0, 0, 0), f.angular_velocity: (0, 0, 0)}
    return scene, legs, start | {scene.rail.q: 0.0, scene.rail.v: 0.5}


@pytest.mark.parametrize("direction", [(0.0, 1.0), (0.6, 0.5), (-0.5, 0.6)], ids=["across", "askew", "more"])
def test_a_table_without_friction_stands_until_its_load_has_passed_the_edge(direction: tuple[float, float]) -> None:
    """By M / m of its distance; what rests in zero until then takes no steps."""
    along = np.array(direction) / np.hypot(*direction)
    scene, _, start = loaded((2, 0, 3, 1), along, 0.0)
    tips = 2.5 * min(a / abs(e) for a, e in zip((0.4, 0.3), along, strict=True) if e) / 0.5
    run = ac.build(scene).simulate(tips + 0.05, start, rtol=1e-12, compiled=False)
    assert next(t.time for t in run.transitions if t.changes) == pytest.approx(tips, rel=1e-10)
    assert run.steps.t.size < 200


def test_what_legs_carry_depends_on_no_order_until_it_tips() -> None:
    along, found = np.array([0.6, 0.5]) / np.hypot(0.6, 0.5), list[np.ndarray]()
    tips = 2.5 * 0.4 / along[0] / 0.5
    for order in ((0, 1, 2, 3), (1, 3, 0, 2)):
        scene, legs, start = loaded(order, along, 0.5)
        run = ac.build(scene).simulate(0.995 * tips, start, rtol=1e-12, compiled=False)
        found.append(np.array([run.at([0.3 * tips, 0.99 * tips])[leg.normal_force] for leg in legs]))
    assert found[0] == pytest.approx(found[1], abs=1e-8)


@pytest.mark.parametrize(
    ("mu", "above", "size", "mass"), [(0.5, 0.0, 1.0, 1.0), (0.5, 0.3, 1e-3, 1e-6), (0.0, 0.7, 1.0, 1e-9), (0.05, 0.2, 1e3, 1e6)]
)
def test_a_box_comes_down_to_rest_on_three_feet_that_share_its_load(mu: float, above: float, size: float, mass: float) -> None:
    """Nine rows, or three, over six freedoms: what rests does so to rounding, and may be shifted and turned on the floor."""
    scene = ac.System()
    scene.world, scene.box = World((0, 0, -G)), RigidBody.box(mass, (0.4 * size, 0.3 * size, 0.2 * size))
    scene.feet = [PointOnPlane(unilateral=True, **({"friction": Coulomb(mu)} if mu else {})) for _ in range(3)]
    for foot, (x, y) in zip(scene.feet, ((0.2, 0.15), (-0.2, 0.15), (0, -0.15)), strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x * size, y * size, -0.1 * size)))
    found = ac.build(scene).equilibrium({scene.box.frame.position: (0, 0, (0.1 + above) * size)})
    assert found[scene.box.frame.position].ravel()[2] == pytest.approx(0.1 * size, rel=1e-9)
    assert found.dimension == 3
    assert found.residual * size < 1e-11 * G


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_the_energy_of_what_stands_still_is_not_off_by_its_rounding(size: float) -> None:
    """Heights are counted from where it stands, so that its energy is nothing but rounding."""
    scene = ac.System()
    scene.world = World((0.4 * size, 0.3 * size, -9.81 * size))
    scene.box = RigidBody(2.0, np.array((0.1, 0.2, 0.15)) * size**2)
    corners = size * np.array([(0.3, 0.2, -0.7), (0.3, -0.2, -0.7), (-0.3, 0.2, -0.7), (-0.3, -0.2, -0.7)])
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(0.3)) for _ in corners]
    for foot, corner in zip(scene.feet, corners, strict=True):
        scene.connect(scene.world.at((0, 0, corners[0, 2])), foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at(tuple(corner)))
    run = ac.build(scene).simulate(3.0)
    assert np.abs(run[scene.box.frame.position]).max() < 1e-14 * size
    assert run.energy_error() < 1e-12


FOUR = np.array([(0.22, -0.08, -0.51, 1.0), (1.0, -0.01, -0.84, 0.97), (-0.66, -0.91, -0.53, 0.29), (0.42, -0.02, 0.54, 1.1)])


@pytest.mark.parametrize(("feet", "size"), [(FOUR[[1, 3, 0, 2]], 1.0), (FOUR[[0, 1, 3]], 1e-3), (FOUR[:3], 1e3)])
def test_a_body_on_rough_feet_of_any_slope_stays_where_any_forces_would_hold_it(feet: np.ndarray, size: float) -> None:
    """In a plane: the place, slope and friction of each; by a linear program for the largest that friction can have left everywhere."""
    k, points, slopes, mu = len(feet), feet[:, :2], feet[:, 2], feet[:, 3]
    scene = ac.System()
    scene.world, scene.joints = World(), [Prismatic("x"), Prismatic("z"), Revolute("y")]
    scene.body, at = RigidBody(1.5, 0.5 * size**2 * np.eye(3)), scene.world.frame
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(one)) for one in mu]
    for joint in scene.joints:
        scene.connect(at, joint.frame_a)
        at = joint.frame_b
    scene.connect(at, scene.body.frame)
    for foot, (x, z), slope in zip(scene.feet, size * points, slopes, strict=True):
        scene.connect(scene.world.at((x, 0, z), rotation=((0, 1, 0), slope)), foot.frame_a)
        scene.connect(foot.frame_b, scene.body.at((x, 0, z)))
    normal, along = np.array([np.sin(slopes), np.cos(slopes)]), np.array([np.cos(slopes), -np.sin(slopes)])
    A = np.vstack([np.hstack([normal, along]), np.hstack([points[:, 0] * f[1] - points[:, 1] * f[0] for f in (normal, along)])])
    within = [[np.diag(-mu), sign * np.eye(k), np.ones((k, 1))] for sign in (1, -1)]
    found = linprog(
        [*np.zeros(2 * k), -1], np.block(within), np.zeros(2 * k), np.hstack([A, np.zeros((3, 1))]), [0, 1, 0], [*[(None, None)] * (2 * k), (None, 5)]
    )  # fmt: skip
    stays = found.status == 0 and found.fun < 0
    assert found.status == 2 or abs(found.fun) > 1e-3
    run = ac.build(scene).simulate(0.02 * np.sqrt(size), dict.fromkeys([joint.q for joint in scene.joints], 0.0), samples=3)
    moved = max(float(np.abs(run[joint.q]).max()) / unit for joint, unit in zip(scene.joints, (size, size, 1), strict=True))
    assert moved < 1e-12 if stays else moved > 1e-6


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_pushed_box_goes_where_it_is_pushed_from_the_instant_at_which_all_feet_begin_to_slide(size: float) -> None:
    """As F' (t - t1)^3 / 6 m, and neither aside nor round: what rounding makes of directions while all sticks, or while the slip is nothing, is not what it makes of them later."""
    scene, T = ac.System(), np.sqrt(size / G)
    scene.mu, scene.world, scene.box = (
        ac.Parameter(0.3),
        World((0, 0, -G)),
        RigidBody.box(2.0, (0.4 * size, 0.3 * size, 0.2 * size)),
    )
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(scene.mu)) for _ in CORNERS]
    for foot, (x, y) in zip(scene.feet, CORNERS, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x * size, y * size, -0.1 * size)))
    scene.push = Force((9 * G / T * ac.time, 0, 0))
    scene.connect(scene.push.point, scene.box.at((0, 0, -0.02 * size)))
    model, place, off = ac.build(scene), scene.box.frame.position, list[float]()
    for k in range(-7, 8, 2):
        mu = 0.3 * (1 + 1e-5 * k)
        run = model.simulate(0.7 * T, {place: (0, 0, 0.1 * size)}, rtol=1e-12, samples=2, parameters={scene.mu: mu})
        assert run.statistics.steps < 300
        left = 0.7 - 2 * mu / 9
        off.append(float(np.max(np.abs(np.ravel(run[place][-1]) / size - [9 * left**3 / 12, 0, 0.1]))))
    assert max(off) < 1e-14


@pytest.mark.parametrize(
    ("mu", "angle", "at", "growth", "size"),
    [(0.2776, 3.105, (-0.066, 0.0516, -0.0746), 17.6, 1.0), (0.7094, 1.7, (0.05, -0.03, -0.02), 14.0, 1e-3)],
)
def test_a_box_that_is_pushed_ever_harder_off_its_centre_slides_and_leaves_its_feet_one_by_one(
    mu: float, angle: float, at: tuple[float, float, float], growth: float, size: float
) -> None:
    """Four feet that slide share what they carry in a way of their own, and one that would have to pull bears nothing from then on. Forces of the feet obey their laws and, by quadrature,
    make the momentum and the spin of the box while it stands on three.
    """
    scene, T = ac.System(), np.sqrt(size / G)
    scene.world, scene.box = World((0, 0, -G)), RigidBody.box(2.0, (0.4 * size, 0.3 * size, 0.2 * size))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in CORNERS]
    for foot, (x, y) in zip(scene.feet, CORNERS, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x * size, y * size, -0.1 * size)))
    way = np.array([np.cos(angle), np.sin(angle), 0])
    scene.push = Force((growth * G / T * way[0] * ac.time, growth * G / T * way[1] * ac.time, 0))
    scene.connect(scene.push.point, scene.box.at(tuple(size * np.array(at))))
    frame = scene.box.frame
    run = ac.build(scene).simulate(2 * T, {frame.position: (0, 0, 0.1 * size)}, rtol=1e-11, samples=101)
    pushes, gaps = (
        np.array([np.ravel(run[value]) for value in values])
        for values in zip(*((f.normal_force, f.gap) for f in scene.feet), strict=True)
    )
    drags = np.array([np.array(run[foot.friction_force]) for foot in scene.feet])
    weight = 2 * G
    assert pushes.min() >= 0 and gaps.min() > -1e-14 * size and np.abs(pushes * gaps).max() < 1e-13 * weight * size
    assert (np.linalg.norm(drags, axis=2) - mu * pushes).max() < 1e-13 * weight
    assert run.energy_error() < 1e-11
    instants = sorted({t.time for t in run.transitions if t.time > 0})
    ends = [*instants, 2 * T]
    assert len(instants) > 1 and np.sum(np.ravel(run.at([0.5 * (ends[1] + ends[2])])[scene.feet[0].gap]) >= 0)
    nodes, weights = np.polynomial.legendre.leggauss(90)
    arms = np.array([(x, y, -0.1) for x, y in CORNERS] + [at]) * size
    inertia = np.diag([0.3**2 + 0.2**2, 0.4**2 + 0.2**2, 0.4**2 + 0.3**2]) * 2.0 / 12 * size**2
    for first, last in ((ends[0] + 0.2 * (ends[1] - ends[0]), ends[1]), (ends[1], ends[2])):
        first, last = first + 1e-9 * (last - first), last - 1e-9 * (last - first)
        times = 0.5 * (first + last + (last - first) * nodes)
        during, sides = run.at(times), run.at([first, last])
        forces = [
            np.array(during[foot.friction_force]) + np.outer(np.ravel(during[foot.normal_force]), (0, 0, 1))
            for foot in scene.feet
        ]
        forces.append(np.outer(growth * G / T * times, way))
        places = [during[frame.rotation] @ arm for arm in arms]
        push = sum(forces) - np.outer(np.ones(len(times)), (0, 0, weight))
        torque = sum(np.cross(place, force) for place, force in zip(places, forces, strict=True))
        turned = [R @ inertia @ R.T @ w for R, w in zip(sides[frame.rotation], sides[frame.angular_velocity], strict=True)]
        gained = 0.5 * (last - first) * np.array([weights @ push, weights @ torque / size])
        found = np.array([2.0 * (sides[frame.velocity][1] - sides[frame.velocity][0]), (turned[1] - turned[0]) / size])
        assert found == pytest.approx(gained, abs=1e-9 * weight * T)


@functools.cache
def turned_by_a_push(draw: int) -> tuple[np.ndarray, np.ndarray, float, np.ndarray, np.ndarray]:
    """A plate of 2 kg on three feet: places of these and of a push, which grows with time, coefficient of friction, push, and where it is at time 0.9. In units in which its length is
    0.6 and gravity one; by equations in the plane with friction that creeps by 1e-11."""
    random, m, h = np.random.default_rng(draw), 2.0, 0.1
    angles = 2 * np.pi * (np.arange(3) + random.uniform(-0.1, 0.1, 3)) / 3
    feet, at, mu = (
        np.stack([0.3 * np.cos(angles), 0.2 * np.sin(angles)], 1),
        random.uniform((-0.2, -0.15, -0.08), (0.2, 0.15, 0.05)),
        random.uniform(0.2, 0.5),
    )
    angle = random.uniform(0, 2 * np.pi)
    push = random.uniform(1, 2) * m * np.array([np.cos(angle), np.sin(angle)])

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        turn = np.array([[np.cos(y[2]), -np.sin(y[2])], [np.sin(y[2]), np.cos(y[2])]])
        arms, F = feet @ turn.T, push * t
        slip = y[3:5] + y[5] * np.stack([-arms[:, 1], arms[:, 0]], 1)
        drag = -mu * slip / np.sqrt(np.sum(slip**2, 1) + 1e-22)[:, None]
        bears = np.linalg.solve(
            [np.ones(3), arms[:, 1] + h * drag[:, 1], -arms[:, 0] - h * drag[:, 0]], [m, at[2] * F[1], -at[2] * F[0]]
        )
        forces = np.vstack([drag * bears[:, None], F])
        spun = np.sum(np.vstack([arms, turn @ at[:2]]) @ [[0, 1], [-1, 0]] * forces) / (m / 12 * (0.6**2 + 0.4**2))
        return np.array([*y[3:], *np.sum(forces, 0) / m, spun])

    with np.errstate(over="ignore"):  # of its differences, where nothing moves yet
        other = solve_ivp(rates, (0, 0.9), np.zeros(6), "Radau", rtol=1e-10, atol=1e-14)
    return feet, at, mu, push, other.y[:3, -1]


@pytest.mark.parametrize(
    ("draw", "order", "size"), [(1, (0, 1, 2), 1e-3), (1, (2, 1, 0), 1.0), (5, (1, 0, 2), 1.0), (5, (2, 0, 1), 1e3)]
)
def test_a_plate_on_three_feet_that_is_pushed_off_its_centre_turns_about_the_point_that_all_of_them_agree_on(
    draw: int, order: tuple[int, ...], size: float
) -> None:
    """Nothing jumps as they begin to slide, all at once, and what acts on them just then would take them elsewhere."""
    feet, at, mu, push, expected = turned_by_a_push(draw)
    scene, T, height = ac.System(), np.sqrt(size / G), 0.1 * size
    scene.world, scene.box = World((0, 0, -G)), RigidBody.box(2.0, (0.6 * size, 0.4 * size, 2 * height))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in order]
    for foot, k in zip(scene.feet, order, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((*(feet[k] * size), -height)))
    scene.push = Force((*(G * push / T * ac.time), 0))
    scene.connect(scene.push.point, scene.box.at(tuple(at * size)))
    frame = scene.box.frame
    run = ac.build(scene).simulate(0.9 * T, {frame.position: (0, 0, height)}, rtol=1e-10, samples=2)
    place, R = run[frame.position][-1] / size, run[frame.rotation][-1]
    assert [*place[:2], np.arctan2(R[1, 0], R[0, 0])] == pytest.approx(expected, abs=1e-8)
    assert len(run.transitions) == 1 and run.steps.t.size < 300


@pytest.mark.parametrize(
    ("draw", "size", "turned"), [(1, 1e-3, False), (1, 1.0, True), (4, 1e3, True)], ids=["pivot", "turned", "many"]
)
def test_feet_slide_from_the_instant_at_which_no_forces_hold_them_any_longer(draw: int, size: float, turned: bool) -> None:
    """As a linear program finds it, whose directions of friction close in on those that are found; from then on forces obey their laws, also where a foot is what the others turn about."""
    random, arm = np.random.default_rng(draw), -0.1
    count, _, mu, pattern = int(random.integers(3, 9)), random.choice(3), random.uniform(0.1, 0.8), int(random.integers(3))
    around = 2 * np.pi * np.arange(count) / count
    feet = (
        np.stack([0.3 * np.cos(around), 0.2 * np.sin(around)], 1)
        if pattern == 0
        else random.uniform(-1, 1, (count, 2)) * (0.3, 0.2)
    )
    feet = feet - np.mean(feet, 0)
    at, angle = random.uniform((-0.3, -0.2, -0.08), (0.3, 0.2, 0.1)), random.uniform(0, 6.28)
    way = np.array([np.cos(angle), np.sin(angle), 0])
    exact = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    fans, width = np.tile(np.linspace(0, 2 * np.pi, 64, endpoint=False), (count, 1)), 0.1
    for _ in range(7):
        forces = np.stack([mu * np.cos(fans), mu * np.sin(fans), np.ones(fans.shape)], -1)
        places = np.broadcast_to(np.c_[feet, np.full(count, arm)][:, None], forces.shape)
        columns = np.concatenate([forces, np.cross(places, forces)], -1).reshape(-1, 6)
        load = np.array([*way, *np.cross(at, way)])
        found = linprog([*np.zeros(len(columns)), -1], A_eq=np.vstack([columns, load]).T, b_eq=[0, 0, 1, 0, 0, 0], options=exact)
        twist, held = found.eqlin.marginals, found.x[:-1].reshape(fans.shape)
        slips = np.stack(
            [twist[0] + twist[4] * arm - twist[5] * feet[:, 1], twist[1] + twist[5] * feet[:, 0] - twist[3] * arm], 1
        )
        middle = np.angle(np.where(held.sum(1) > 1e-9, (held * np.exp(1j * fans)).sum(1), -slips[:, 0] - 1j * slips[:, 1]))
        fans, width = (
            np.hstack([middle[:, None] + width * np.linspace(-1.5, 1.5, 31), np.tile(np.arange(0, 6.28, 0.4), (count, 1))]),
            width / 6,
        )
    scene, T = ac.System(), np.sqrt(size / G)
    scene.world, scene.box = World((0, 0, -G)), RigidBody.box(2.0, (0.6 * size, 0.4 * size, 0.2 * size))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in feet]
    for foot, place in zip(scene.feet, feet[::-1] if turned else feet, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((*(place * size), arm * size)))
    scene.push = Force((2 * G / T * way[0] * ac.time, 2 * G / T * way[1] * ac.time, 0))
    scene.connect(scene.push.point, scene.box.at(tuple(at * size)))
    slides, frame = found.x[-1] * T, scene.box.frame
    run = ac.build(scene).simulate(1.3 * slides, {frame.position: (0, 0, -arm * size)}, rtol=1e-9, samples=31)
    instants = [t.time for t in run.transitions if t.time > 0]
    assert instants[0] == pytest.approx(slides, rel=1e-8) and len(instants) < 4
    assert run.energy_error() < 1e-9
    pushes = np.array([np.ravel(run[foot.normal_force]) for foot in scene.feet])
    drags = np.array([np.linalg.norm(run[foot.friction_force], axis=1) for foot in scene.feet])
    assert pushes.min() > -1e-12 * 2 * G and (drags - mu * pushes).max() < 1e-9 * 2 * G
    assert np.linalg.norm(run[frame.position][-1][:2]) > 1e-5 * size


def test_derivatives_say_where_a_foot_that_bears_nothing_hides_the_instant_at_which_all_give_way() -> None:
    """What the others then bear jumps as they begin to slide, and a force that vanishes has no direction by which to tell when."""
    scene, mu = ac.System(), ac.Parameter(0.3)
    scene.world, scene.box = World((0, 0, -G)), RigidBody.box(2.0, (0.4, 0.3, 0.2))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(k)) for k in (mu, mu, 0.35, 0.35)]
    for foot, (x, y) in zip(scene.feet, CORNERS, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x, y, -0.1)))
    scene.push = Force((181.2 * ac.time, 45.5 * ac.time, 0))
    scene.connect(scene.push.point, scene.box.at((-0.048, 0.031, -0.02)))
    with pytest.warns(SingularWarning, match="Where several hold one another"):
        ac.build(scene).sensitivities([0.0, 0.04], [mu], {scene.box.frame.position: (0, 0, 0.1)}, rtol=1e-9)


@pytest.mark.parametrize(
    ("size", "mu", "height"),
    [(1.0, 0.3, 0.4), (1.0, 0.45, 0.37), (1e-3, 0.3, 0.4), (1e-3, 0.6, 0.4), (1e3, 0.3, 0.35), (1e3, 0.45, 0.35)],
)
def test_a_box_that_lands_level_on_an_incline_slips_from_rest_on_two_of_its_feet(size: float, mu: float, height: float) -> None:
    """Nothing moves it across, but rounding. Its planar equations: an impact that stops its edge, then slip that begins at once, downhill."""
    slope, corner = 0.4, np.array([-0.2, -0.1])
    scene = ac.System()
    scene.world, scene.box = World((0, 0, -G * size)), RigidBody.box(1.0, (0.4 * size, 0.3 * size, 0.2 * size))
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in CORNERS]
    for foot, (x, y) in zip(scene.feet, CORNERS, strict=True):
        scene.connect(scene.world.at((0, 0, 0), rotation=("y", slope)), foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x * size, y * size, -0.1 * size)))
    inertia, down = (
        (0.4**2 + 0.2**2) / 12,
        G * np.array([np.sin(slope), -np.cos(slope)]),
    )  # along and across the incline, in sizes
    turn = lambda a: np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])  # noqa: E731  # about y: z to x
    place = turn(-slope) @ np.array([0.0, height])
    fall = np.sqrt(2 * (place + turn(-slope) @ corner)[1] / (G * np.cos(slope)))

    def foot_of(angle: float) -> tuple[np.ndarray, np.ndarray]:
        arm = turn(angle) @ corner
        across = np.array([arm[1], -arm[0]])  # its velocity is that of the centre and the rate of turning times this
        return across, np.eye(2) + np.outer(across, across) / inertia

    across, compliance = foot_of(-slope)
    blow = np.linalg.solve(compliance, -down * fall)
    assert abs(blow[0]) < mu * blow[1]

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        across, compliance = foot_of(y[2])
        free = down - y[5] ** 2 * (turn(y[2]) @ corner)
        push = np.array([-mu, 1.0]) * -free[1] / (compliance[1] @ [-mu, 1.0])
        return np.concatenate([y[3:], down + push, [push @ across / inertia]])

    y = np.concatenate([place + down * fall**2 / 2, [-slope], down * fall + blow, [blow @ across / inertia]])
    by = solve_ivp(rate, (0.0, 0.01), y, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    run = ac.build(scene).simulate(fall + 0.01, {scene.box.frame.position: (0, 0, height * size)}, rtol=1e-10)
    assert run.transitions[0].time == pytest.approx(fall, rel=1e-11)
    world = turn(slope) @ by[:2]
    assert run[scene.box.frame.position][-1] == pytest.approx(np.array([world[0], 0.0, world[1]]) * size, abs=1e-9 * size)
    assert run[scene.box.frame.angular_velocity][-1] == pytest.approx([0.0, by[5], 0.0], abs=1e-7)
    assert run.statistics.steps < 40 and run.energy_error() < 1e-11


@pytest.mark.parametrize(("size", "rtol"), [(1e-3, 1e-4), (1.0, 1e-5), (1e3, 1e-6)])
def test_a_gap_that_closes_at_once_asks_for_no_more_digits_than_its_rate_has(size: float, rtol: float) -> None:
    """A ball rolls towards a hill and is begun into its slope by 4e-9 of its speed: the gap is 1e-22 of all lengths then, its rate is held, and only rounding
    moves either.
    """
    r, g = 0.1 * size, 9.81 * size
    scene = ac.System()
    scene.world, scene.ball = World((0, 0, -g)), RigidBody.ball(1.0, r)
    hill = HeightField(lambda x, y: 0.3 * size * ca.exp(-4 * (x / size) ** 2))
    scene.contact = Contact(Sphere(r), hill, Hard(0.2, Coulomb(0.6)))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    start = {
        frame.position[:2]: (-1.5 * size, 0.0),
        scene.contact.gap: 0.0,
        frame.velocity[:2]: (size, 0.0),
        frame.angular_velocity: (0, 10.0, 0),
    }
    run = ac.build(scene).simulate(2.0, start, rtol=rtol)
    assert run.statistics.steps < 200
    assert run.energy_error() < max(100 * rtol, 1e-8)
    height = run[frame.position][:, 2]
    assert np.max(height) - height[0] == pytest.approx(
        0.7 * size / 9.81, rel=1e-3
    )  # 7/10 v^2 / g: by energy, where it turns back
