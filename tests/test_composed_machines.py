"""Machines as strangers compose them: contacts, stops, friction and ropes with one another, in any size, order of declaration and tolerance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.language.connector import Connector
from components import (
    Backlash,
    Brake,
    Contact,
    Coulomb,
    EndStop,
    Force,
    Hard,
    HeightField,
    Planar,
    PointOnPlane,
    PointOnSurface,
    Prismatic,
    Revolute,
    RigidBody,
    Sphere,
    Spring,
    Torque,
    World,
)
from tests.pairings import each_value

G = 9.81


def connected(scene: ac.System, pairs: list[tuple[Connector, Connector]], order: int) -> ac.Model:
    for a, b in pairs[::order]:
        scene.connect(a, b)
    return ac.build(scene)


@each_value(("order", [1, -1]), ("size, rtol", [(1.0, 1e-12), (1e-3, 1e-6), (1e4, 1e-6)]))
def test_a_wedge_that_is_driven_under_a_load_slips_stops_and_holds(size: float, rtol: float, order: int) -> None:
    """At rest four rows hold three freedoms; it slips where no forces hold it, and locks itself when nothing drives it any longer."""
    mu, slope, wedge, load, rise = 0.5, 0.2, 1.0, 2.0, 60.0
    c, s = np.cos(slope), np.sin(slope)
    scene = ac.System()
    scene.world, scene.x, scene.z, scene.up = World((0, 0, -G * size)), Prismatic("x"), Prismatic("z"), Prismatic("z")
    scene.wedge, scene.load = (RigidBody(mass, inertia=0.1 * size**2 * np.eye(3)) for mass in (wedge, load))
    scene.floor, scene.face = (PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in range(2))
    scene.push = Force(lambda t: (size * ca.if_else(t < 1, rise * t, 0), 0, 0))
    face = scene.wedge.at((0, 0, 0.5 * size), ((c, 0, s), (0, 1, 0), (-s, 0, c)))
    pairs = [
        (scene.world.frame, scene.x.frame_a),
        (scene.x.frame_b, scene.z.frame_a),
        (scene.z.frame_b, scene.wedge.frame),
        (scene.world.frame, scene.up.frame_a),
        (scene.up.frame_b, scene.load.frame),
        (scene.world.frame, scene.floor.frame_a),
        (scene.floor.frame_b, scene.wedge.at((0.1 * size, 0, 0))),
        (face, scene.face.frame_a),
        (scene.face.frame_b, scene.load.frame),
        (scene.push.point, scene.wedge.frame),
    ]
    run = connected(scene, pairs, order).simulate(2.0, {scene.up.q: 0.5 * size}, rtol=rtol)
    # N (c - mu s) = load (g + tan x''), wedge x'' = F - N (s + mu c) - mu (wedge g + N (c - mu s))
    k = (s + mu * c) / (c - mu * s)
    needed, moved = load * G * k + mu * (wedge + load) * G, wedge + load * np.tan(slope) * (k + mu)
    begins = needed / rise
    speed, way = rise * (1 - begins) ** 2 / (2 * moved), rise * (1 - begins) ** 3 / (6 * moved)
    stops = 1 + speed * moved / needed
    slips = [t.time for t in run.transitions if any(c.part.startswith("floor") for c in t.changes)]
    assert slips[-1] == pytest.approx(stops, rel=1e-11)
    assert any(abs(t - begins) < 1e-6 for t in slips)
    assert run[scene.x.q][-1].item() / size == pytest.approx(way + speed**2 * moved / (2 * needed), rel=1e-10)
    assert run[scene.x.v][-1].item() == pytest.approx(0, abs=1e-90)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("size, rtol", [(1.0, 1e-12), (1e-3, 1e-6), (1e4, 1e-9)])
def test_a_follower_on_a_turning_cam_does_not_know_where_its_axes_were_put(size: float, rtol: float) -> None:
    """Tangents on a ball jump somewhere, in the axes of its frame: nothing that slides or sticks there sees it."""
    ends = []
    for turned in (0.0, 1.0, 2.0, 3.0, 4.5):
        c, s = np.cos(turned), np.sin(turned)
        scene = ac.System()
        scene.world, scene.axle, scene.slide = World((0, 0, -G * size)), Revolute("y"), Prismatic("z")
        scene.cam, scene.follower = (RigidBody(m, inertia=0.1 * size**2 * np.eye(3)) for m in (1.0, 0.5))
        scene.touch = Contact(Sphere(0.05 * size), Sphere(0.3 * size), Hard(0.0, Coulomb(0.2)))
        scene.spring = Spring(300.0, 0.8 * size)
        pairs = [
            (scene.world.frame, scene.axle.frame_a),
            (scene.axle.frame_b, scene.cam.frame),
            (scene.world.frame, scene.slide.frame_a),
            (scene.slide.frame_b, scene.follower.frame),
            (scene.cam.at((0.1 * size, 0, 0), ((c, 0, s), (0, 1, 0), (-s, 0, c))), scene.touch.frame_a),
            (scene.touch.frame_b, scene.follower.frame),
            (scene.world.at((0, 0, 1.2 * size)), scene.spring.point_a),
            (scene.follower.frame, scene.spring.point_b),
        ]
        start = {scene.axle.v: 9.0, scene.slide.q: size * (np.sqrt(0.35**2 - 0.01) + 1e-3)}
        run = connected(scene, pairs, 1).simulate(3.0, start, rtol=rtol)
        ends.append((run[scene.axle.q][-1].item(), run[scene.slide.q][-1].item() / size))
        assert run.energy_error() < max(1e-13, 1e-3 * rtol)
    assert np.array(ends) == pytest.approx(np.tile(ends[0], (5, 1)), rel=max(1e-12, 1e-2 * rtol))


@pytest.mark.parametrize("size, rtol", [(1.0, 1e-6), (1e-3, 1e-6), (1e4, 1e-12)])
def test_fingers_lift_a_box_for_a_hundred_seconds_and_it_does_not_creep(size: float, rtol: float) -> None:
    """It stands for a second, is lifted by four spring-loaded pads with friction, and goes up by (F / m) (t^2 / 2) and then on."""
    scene = ac.System()
    scene.world, scene.lift, scene.free = World((0, 0, -G * size)), Prismatic("z"), Planar("y")
    scene.carriage, scene.box = RigidBody(1.0, inertia=0.1 * size**2 * np.eye(3)), RigidBody.box(0.8, (0.1 * size,) * 3)
    scene.slides, scene.fingers = (
        [Prismatic("x") for _ in range(2)],
        [RigidBody(0.2, inertia=0.01 * size**2 * np.eye(3)) for _ in range(2)],
    )
    scene.spring, scene.low = Spring(500.0, 0.05 * size), EndStop(scene.lift.flange, lower=0.0)
    scene.pads = [PointOnPlane(unilateral=True, friction=Coulomb(0.5)) for _ in range(4)]
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(0.5)) for _ in range(2)]
    weight = 2.2 * G
    scene.motor = Force(lambda t: (0, 0, size * ca.if_else(t < 1, 0, ca.if_else(t < 2, weight + 4, weight))))
    pairs = [
        (scene.world.frame, scene.lift.frame_a),
        (scene.lift.frame_b, scene.carriage.frame),
        (scene.motor.point, scene.carriage.frame),
        (scene.world.frame, scene.free.frame_a),
        (scene.free.frame_b, scene.box.frame),
        (scene.fingers[0].frame, scene.spring.point_a),
        (scene.fingers[1].frame, scene.spring.point_b),
    ]
    for k, side in enumerate((-1, 1)):
        pairs += [(scene.carriage.frame, scene.slides[k].frame_a), (scene.slides[k].frame_b, scene.fingers[k].frame)]
        for j, z in enumerate((-0.03, 0.03)):
            pad = scene.pads[2 * k + j]
            pairs += [
                (scene.fingers[k].at((0, 0, 0), ((0, 0, -side), (0, 1, 0), (side, 0, 0))), pad.frame_a),
                (pad.frame_b, scene.box.at((0.05 * size * side, 0, z * size))),
            ]
        pairs += [
            (scene.world.at((0, 0, -0.05 * size)), scene.feet[k].frame_a),
            (scene.feet[k].frame_b, scene.box.at((0.05 * size * side, 0, -0.05 * size))),
        ]
    start = {scene.slides[0].q: -0.05 * size, scene.slides[1].q: 0.05 * size}
    run = connected(scene, pairs, 1).simulate(100.0, start, rtol=rtol)
    gained = 4 / 2.2
    assert run[scene.lift.q][-1].item() / size == pytest.approx(gained / 2 + gained * 98, rel=1e-12)
    z, x, turned = run[scene.free.q][-1]
    assert abs(z - run[scene.lift.q][-1].item()) < 1e-12 * z and abs(x) < 1e-11 * size and abs(turned) < 1e-10


def play_with_brakes() -> tuple[ac.Model, dict[ac.Expression, Any]]:
    """Two shafts with play between them, each with a brake; one is driven to and fro: bounces without end while both slip."""
    scene = ac.System()
    scene.world, scene.a, scene.b = World((0, 0, 0)), Revolute("z"), Revolute("z")
    scene.first, scene.second = RigidBody(1.0, inertia=np.eye(3)), RigidBody(1.0, inertia=2 * np.eye(3))
    scene.play = Backlash(scene.a.flange, scene.b.flange, width=0.1, restitution=0.3)
    scene.brakes = [Brake(scene.a.flange, capacity=0.5), Brake(scene.b.flange, capacity=1.0, holding=1.5)]
    scene.torque = Torque(lambda t: (0, 0, 6 * ca.sin(3 * t)))
    pairs = [
        (scene.world.frame, scene.a.frame_a),
        (scene.a.frame_b, scene.first.frame),
        (scene.world.frame, scene.b.frame_a),
        (scene.b.frame_b, scene.second.frame),
        (scene.torque.frame, scene.first.frame),
    ]
    return connected(scene, pairs, 1), {scene.b.q: 0.02}


def chain_on_the_ground() -> tuple[ac.Model, dict[ac.Expression, Any]]:
    """Three links that fall on a rough floor, moving along it, and come to lie there."""
    scene, n, length = ac.System(), 3, 0.2
    scene.world, scene.root, scene.hinges = World((0, 0, -G)), Planar("y"), [Revolute("y") for _ in range(n - 1)]
    scene.links = [RigidBody.rod(0.1, tip=(length, 0, 0)) for _ in range(n)]
    scene.touches = [PointOnPlane(unilateral=True, restitution=0.2, friction=Coulomb(0.3)) for _ in range(n + 1)]
    pairs = [(scene.world.frame, scene.root.frame_a), (scene.root.frame_b, scene.links[0].frame)]
    tips = [link.at((length, 0, 0)) for link in scene.links]
    for tip, hinge, link in zip(tips, scene.hinges, scene.links[1:], strict=False):
        pairs += [(tip, hinge.frame_a), (hinge.frame_b, link.frame)]
    for touch, place in zip(scene.touches, [*(link.frame for link in scene.links), tips[-1]], strict=True):
        pairs += [(scene.world.frame, touch.frame_a), (touch.frame_b, place)]
    start: dict[ac.Expression, Any] = {scene.root.q: (0.25, 0, -0.3), scene.root.v: (0, 1.5, 0)}
    return connected(scene, pairs, 1), start | {hinge.q: 0.25 * (-1) ** k for k, hinge in enumerate(scene.hinges)}


def sledge_on_a_hill() -> tuple[ac.Model, dict[ac.Expression, Any]]:
    """On three runners, bouncing down a field of heights."""
    scene = ac.System()
    scene.world, scene.sledge = World((0, 0, -G)), RigidBody.box(1.0, (0.3, 0.2, 0.1))
    hill = HeightField(lambda x, y: 0.2 * ca.cos(2 * x) + 0.1 * ca.sin(3 * y))
    scene.runners = [PointOnSurface(hill, unilateral=True, restitution=0.1, friction=Coulomb(0.2)) for _ in range(3)]
    pairs: list[tuple[Connector, Connector]] = []
    for runner, place in zip(scene.runners, [(0.15, 0, -0.05), (-0.15, 0.1, -0.05), (-0.15, -0.1, -0.05)], strict=True):
        pairs += [(scene.world.frame, runner.frame_a), (runner.frame_b, scene.sledge.at(place))]
    frame = scene.sledge.frame
    return connected(scene, pairs, 1), {frame.position: (0.2, 0, 0.5), frame.velocity: (1.0, 0.3, 0)}


@pytest.mark.parametrize(
    "make, end, left", [(play_with_brakes, 10.0, 1e-10), (chain_on_the_ground, 1.0, 1e-10), (sledge_on_a_hill, 1.5, 1e-11)]
)
def test_the_balance_of_energy_closes_through_bounces_without_end_while_other_things_rub(
    make: Callable[[], tuple[ac.Model, dict[ac.Expression, Any]]], end: float, left: float
) -> None:
    """What slides beside what comes to rest has friction all the while, and from the bounces that are bridged, or that are too low to be seen."""
    model, start = make()
    assert model.simulate(end, start, rtol=1e-12).energy_error() < left


@each_value(("back", [0.0, 0.5]), ("size, rtol", [(1.0, 1e-6), (1e-3, 1e-11), (1e4, 1e-8)]))
def test_a_rod_that_jams_on_its_tip_is_stopped_whatever_else_might_touch(size: float, rtol: float, back: float) -> None:
    """Slipping forward on its tip, with 1 + 3 s (s - mu c) < 0, it has no acceleration: its tip is held at once, by the impulse that ends its slip. A foot at its other
    end, which touches nothing until it falls on it, changes nothing; with it there are more rows than freedoms."""
    mu, turned = 1.5, -0.6832591242345625
    speed, rate = 0.6752376256381849, -3.3978796614215545
    c, s = np.cos(turned), np.sin(turned)
    assert 1 + 3 * s * (s + mu * c) < 0
    ends = []
    for feet in ((-0.5,), (-0.5, 0.5), (0.5, -0.5)):
        scene = ac.System()
        scene.world, scene.plane = World((0, 0, -G * size)), Planar("y")
        scene.rod = RigidBody(1.0, inertia=size**2 / 12 * np.eye(3))
        scene.feet = [PointOnPlane(unilateral=True, restitution=back, friction=Coulomb(mu)) for _ in feet]
        pairs = [(scene.world.frame, scene.plane.frame_a), (scene.plane.frame_b, scene.rod.frame)]
        for foot, z in zip(scene.feet, feet, strict=True):
            pairs += [(scene.world.frame, foot.frame_a), (foot.frame_b, scene.rod.at((0, 0, z * size)))]
        start = {scene.plane.q: (0.5 * c * size, 0, turned), scene.plane.v: (-0.5 * s * rate * size, speed * size, rate)}
        run = connected(scene, pairs, 1).simulate(0.2, start, rtol=rtol)
        stopped = run.at([1e-9])[scene.plane.v][0] / (size, size, 1)
        tip = stopped[:2] + 0.5 * stopped[2] * np.array([s, -c])
        assert tip == pytest.approx([0, 0], abs=1e-7)
        # about the tip nothing acts: its angular momentum stays, by an inertia of 1 / 3
        before = rate / 12 + 0.5 * (c * speed - s * (-0.5 * s * rate))
        assert stopped[2] / 3 == pytest.approx(before, rel=1e-7)
        ends.append(run[scene.plane.q][-1] / (size, size, 1))
        assert run.energy_error() < max(1e-12, rtol)
    assert np.array(ends) == pytest.approx(np.tile(ends[0], (3, 1)), abs=max(1e-11, rtol))
