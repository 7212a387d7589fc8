"""Latches, hooks and grippers: constraints imposed and released at events, against closed forms."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

import acausal as ac
from acausal.collocation.problem import StatusKind
from acausal.errors import ModelError, OptionError
from acausal.language.mode_laws import ModeLaw
from acausal.parts.rotations import rotation_about
from components import (
    Brake,
    EndStop,
    Fixed,
    Gripper,
    Inertia,
    Latch,
    Particle,
    PointLatch,
    PointOnPlane,
    PrescribedMotion,
    Prismatic,
    Pulley,
    Revolute,
    RigidBody,
    Rope,
    SlidingMass,
    Spherical,
    Torque,
    TranslationalGround,
    TranslationalSpring,
    World,
)
from tests.drawn import SEEDS, Drawn
from tests.pairings import each_value


def boxes(first: float, second: float, opens: float, size: float = 1.0) -> tuple[ac.System, ac.Model]:
    """Two of them, docked where they meet, in space."""
    scene = ac.System()
    scene.world = World(gravity=(0.0, 0.0, 0.0))
    scene.a = RigidBody.box(mass=first, size=(0.1 * size, 0.2 * size, 0.1 * size))
    scene.b = RigidBody.box(mass=second, size=(0.1 * size, 0.1 * size, 0.3 * size))
    gap = scene.b.frame.position[0] - scene.a.frame.position[0] - 0.1 * size
    scene.dock = Latch(closes=-1.0 * gap, opens=ac.time - opens)
    scene.connect(scene.a.at((0.05 * size, 0.0, 0.0)), scene.dock.frame_a)
    scene.connect(scene.dock.frame_b, scene.b.at((-0.05 * size, 0.0, 0.0)))
    return scene, ac.build(scene)


@pytest.mark.parametrize("radius", [0.1, 1e-3, 1e-4])
def test_latch_bears_what_turns_a_needle(radius: float) -> None:
    """Its torques are as many times harder to find as the needle is thinner than long: about its own axis nothing resists them."""
    scene = ac.System()
    scene.world, scene.box = World(gravity=(0, 0, 0)), RigidBody.box(1.0, (0.3, 0.2, 0.1))
    scene.needle, scene.hold, scene.turn = (
        RigidBody.cylinder(1.0, radius, 1.0, axis="x"),
        Latch(held=True),
        Torque((0.3, 0.2, 0.1)),
    )
    scene.connect(scene.box.at((0.1, 0, 0)), scene.hold.frame_a)
    scene.connect(scene.hold.frame_b, scene.needle.at((-0.5, 0, 0)))
    scene.connect(scene.turn.frame, scene.box.frame)
    start = {scene.box.frame.position: (0, 0, 0), scene.needle.frame.position: (0.6, 0, 0)}
    run = ac.build(scene).simulate(1e-6, start, samples=2)
    across = (3 * radius**2 + 1) / 12
    needle = np.diag([radius**2 / 2, across, across])
    whole = needle + np.diag([0.05, 0.1, 0.13]) / 12 + np.diag([0, 0.5 * 0.6**2, 0.5 * 0.6**2])
    faster = np.linalg.solve(whole, [0.3, 0.2, 0.1])
    force = np.cross(faster, [0.3, 0, 0])
    assert run[scene.hold.force][0] == pytest.approx(force, rel=1e-7, abs=1e-12)
    assert run[scene.hold.torque][0] == pytest.approx(needle @ faster + np.cross([0.5, 0, 0], force), rel=1e-7)


@pytest.mark.parametrize(("time", "turned"), [(1.0, 0.0), (1e3, 0.0), (1e-6, 0.0), (1.0, 0.7), (3.0, -2.1)])
def test_carts_on_a_turned_rail_that_dock_and_swing_part_once_in_any_unit(time: float, turned: float) -> None:
    """What closes the latch stays at zero while it holds, and is left upwards: that is no second closing."""
    scene = ac.System()
    scene.world, scene.rails = World(gravity=(0, 0, 0)), [Prismatic("x") for _ in range(2)]
    scene.carts = [RigidBody.box(mass, (0.1, 0.1, 0.1)) for mass in (1.0, 2.0)]
    scene.spring, scene.wall = TranslationalSpring(27.0 / time**2, 1.0), TranslationalGround()
    first, second = scene.rails[0].q, scene.rails[1].q
    scene.dock = Latch(closes=first - second + 0.1, opens=ac.time - 1.2 * time)
    for rail, cart in zip(scene.rails, scene.carts, strict=True):
        scene.connect(scene.world.at((3, -2, 1), rotation=((1, 2, -1), turned)), rail.frame_a)
        scene.connect(rail.frame_b, cart.frame)
    scene.connect(scene.wall.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.rails[1].flange)
    scene.connect(scene.carts[0].at((0.05, 0, 0)), scene.dock.frame_a)
    scene.connect(scene.dock.frame_b, scene.carts[1].at((-0.05, 0, 0)))
    run = ac.build(scene).simulate(2 * time, {first: 0.0, second: 1.0, scene.rails[0].v: 3 / time}, rtol=1e-10)
    assert [change.time for change in run.transitions] == pytest.approx([0.3 * time, 1.2 * time], rel=1e-12)
    swing, pace = np.sin(2.7) / 3, np.cos(2.7)
    assert run[first][-1] == pytest.approx(0.9 + swing + 0.8 * pace, abs=1e-11)
    w = np.sqrt(13.5)
    assert run[second][-1] == pytest.approx(1 + swing * np.cos(0.8 * w) + pace / w * np.sin(0.8 * w), abs=1e-11)


@pytest.mark.parametrize(("first", "second", "size"), [(1.0, 2.0, 1.0), (3e-9, 1e-9, 1e-3), (1e5, 1e3, 1e3)])
def test_bodies_that_dock_keep_their_momentum(first: float, second: float, size: float) -> None:
    scene, model = boxes(first, second, 1.5, size)
    a, b, v = scene.a.frame, scene.b.frame, 1.0 * size
    run = model.simulate(
        2.0, {a.position: (-size, 0, 0), a.velocity: (v, 0, 0), b.position: (0, 0, 0)}, rtol=1e-10, compiled=False
    )
    docked, released = run.transitions
    assert docked.time == pytest.approx(0.9, rel=1e-13)
    assert released.time == pytest.approx(1.5, rel=1e-13)
    together = first * v / (first + second)
    for body in (a, b):
        assert docked.after[body.velocity] == pytest.approx([together, 0, 0], rel=1e-13, abs=1e-14 * v)
        assert run[body.velocity][-1] == pytest.approx([together, 0, 0], rel=1e-12, abs=1e-13 * v)
    lost = first * second / (first + second) * v**2 / 2
    assert docked.energy_lost == pytest.approx(lost, rel=1e-12)
    assert docked.changes[0].part == "dock"
    assert (docked.changes[0].old, docked.changes[0].new) == ("free", "held")
    assert docked.changes[0].impulse == pytest.approx(
        [first * second / (first + second) * v, 0, 0], rel=1e-12, abs=1e-14 * first * v
    )
    assert released.energy_lost == 0.0
    assert run.energy_error() < 1e-12


def test_bodies_that_dock_off_their_centres_turn_together() -> None:
    # a particle catches the end of a rod at rest: momentum and spin about the common centre are kept
    m, M, L, v = 0.5, 2.0, 1.2, 3.0
    scene = ac.System()
    scene.world, scene.ball = World(gravity=(0.0, 0.0, 0.0)), Particle(m)
    scene.rod = RigidBody(mass=M, inertia=(1e-3, M * L**2 / 12, M * L**2 / 12))
    scene.hook = PointLatch(closes=scene.ball.point.position[2])
    scene.connect(scene.rod.at((L / 2, 0.0, 0.0)), scene.hook.frame_a)
    scene.connect(scene.hook.frame_b, scene.ball.point)
    ball, rod = scene.ball.point, scene.rod.frame
    run = ac.build(scene).simulate(
        1.0, {ball.position: (L / 2, 0, -1), ball.velocity: (0, 0, v), rod.position: (0, 0, 0)}, rtol=1e-11, compiled=False
    )
    after = run.transitions[0].after
    centre, c = m * v / (m + M), m / (m + M) * L / 2
    inertia = M * L**2 / 12 + M * c**2 + m * (L / 2 - c) ** 2
    spin = -m * v * (L / 2 - c) / inertia
    assert after[rod.angular_velocity] == pytest.approx([0, spin, 0], rel=1e-12, abs=1e-13)
    assert after[rod.velocity] == pytest.approx([0, 0, centre + spin * c], rel=1e-12, abs=1e-13)
    lost = m * v**2 / 2 - (m + M) * centre**2 / 2 - inertia * spin**2 / 2
    assert run.transitions[0].energy_lost == pytest.approx(lost, rel=1e-12)
    ends = run[scene.rod.at((L / 2, 0.0, 0.0)).position]
    t = run.t >= run.transitions[0].time + 1e-9
    assert np.abs(ends - run[ball.position])[t].max() < 1e-12


def arm(length: float, m: float) -> ac.System:
    """A pendulum with a point mass at its end."""
    scene = ac.System()
    scene.world, scene.hinge = World(), Revolute(axis="y")
    scene.rod = RigidBody(mass=m, centre_of_mass=(0.0, 0.0, -length), inertia=(1e-6, 1e-6, 1e-6))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    return scene


@each_value(("angle", [0.0, 0.7, np.pi / 2]), ("kind", [PointLatch, Latch]))
def test_pendulum_is_caught_at_a_wall_and_falls_again(angle: float, kind: type[PointLatch] | type[Latch]) -> None:
    # one freedom only, whatever many rows hold it; also where some of them do not move it
    length, m = 0.8, 1.3
    scene = arm(length, m)
    scene.catch = kind(closes=scene.hinge.q - angle, opens=ac.time - 3.0)
    wall = scene.world.at(
        (-length * np.sin(angle), 0.0, -length * np.cos(angle)), rotation_about(np.array([0.0, 1.0, 0.0]), angle)
    )
    scene.connect(wall, scene.catch.frame_a)
    scene.connect(scene.catch.frame_b, scene.rod.at((0.0, 0.0, -length)))
    model = ac.build(scene)
    run = model.simulate(3.2, {scene.hinge.q: -0.3, scene.hinge.v: 9.0}, rtol=1e-11, compiled=False)
    caught = run.transitions[0]
    assert caught.after[scene.hinge.q] == pytest.approx(angle, abs=1e-13)
    assert caught.after[scene.hinge.v] == pytest.approx(0.0, abs=1e-13)
    held = (run.t > caught.time) & (run.t < 3.0)
    assert np.abs(run[scene.hinge.q][held] - angle).max(initial=0.0) < 1e-13
    before = caught.before[scene.hinge.v]
    assert caught.energy_lost == pytest.approx((m * length**2 + 1e-6) * before**2 / 2, rel=1e-11)
    alone = arm(length, m)
    rest = ac.build(alone).simulate(0.2, {alone.hinge.q: angle}, rtol=1e-11, compiled=False)
    assert run[scene.hinge.q][-1] == pytest.approx(rest[alone.hinge.q][-1], abs=1e-9)
    assert run.energy_error() < 1e-9


def test_ball_that_an_arm_lets_go_flies_a_parabola() -> None:
    length, w, angle = 0.9, 7.0, 0.6
    scene = ac.System()
    scene.world, scene.hinge, scene.ball = World(gravity=(0.0, 0.0, -9.81)), Revolute(axis="y"), Particle(0.2)
    scene.rod = RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.hand = PointLatch(held=True, opens=scene.hinge.q - angle)
    scene.connect(scene.rod.at((length, 0.0, 0.0)), scene.hand.frame_a)
    scene.connect(scene.hand.frame_b, scene.ball.point)
    ball = scene.ball.point
    start = {scene.hinge.q: 0.0, scene.hinge.v: w, ball.position: (length, 0, 0), ball.velocity: (0, 0, -length * w)}
    run = ac.build(scene).simulate(0.8, start, rtol=1e-12, compiled=False)
    thrown = run.transitions[-1]
    at = np.array([length * np.cos(angle), 0.0, -length * np.sin(angle)])
    speed = thrown.before[scene.hinge.v]
    direction = np.array([-np.sin(angle), 0.0, -np.cos(angle)])
    assert thrown.after[ball.position] == pytest.approx(at, abs=1e-12)
    assert thrown.after[ball.velocity] == pytest.approx(length * speed * direction, abs=1e-11)
    t = run.t[-1] - thrown.time
    assert run[ball.position][-1] == pytest.approx(
        at + length * speed * direction * t + np.array([0, 0, -9.81 / 2]) * t**2, abs=1e-11
    )
    assert run[scene.hinge.v][-1] == pytest.approx(speed, rel=1e-12)
    assert run.energy_error() < 1e-10


def carriage(gripper: Gripper) -> ac.System:
    """A cart on a rail with a gripper, and a box on a floor."""
    scene = ac.System()
    scene.world, scene.slide = World(), Prismatic(axis="x")
    scene.cart, scene.box, scene.hand = (
        RigidBody.box(mass=2.0, size=(0.2, 0.2, 0.2)),
        RigidBody.box(mass=0.5, size=(0.1, 0.1, 0.1)),
        gripper,
    )
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.cart.frame)
    scene.connect(scene.cart.frame, scene.hand.frame_a)
    scene.connect(scene.hand.frame_b, scene.box.frame)
    return scene


def test_gripper_holds_without_creep_lets_go_and_holds_again() -> None:
    scene = carriage(Gripper(opens=ac.time - 100.0))
    box, place = scene.box.frame, np.array([0.03, 0.02, -0.3])
    again = ac.when(ac.time - 100.1, set=scene.hand.closing())
    first = ac.when(ac.time - 0.001, set=scene.hand.closing())
    start = {box.position: place, box.angular_velocity: (0.3, 2.0, 1.0), scene.slide.v: 0.4}
    run = ac.build(scene).simulate(110.0, start, events=[first, again], compiled=False)
    relative = run[box.position] - np.column_stack([run[scene.slide.q], 0 * run.t, 0 * run.t])
    turned = run[box.rotation]
    for begin, end in ((0.001, 100.0), (100.1, 110.0)):
        held = (run.t > begin + 1e-9) & (run.t < end - 1e-9)
        assert held.sum() > 1
        assert np.abs(relative[held] - relative[held][0]).max() < 1e-12
        assert np.abs(turned[held] - turned[held][0]).max() < 1e-12
    falls = relative[np.searchsorted(run.t, 100.1 - 1e-9)][2] - relative[np.searchsorted(run.t, 50.0)][2]
    assert falls == pytest.approx(-9.81 / 2 * 0.1**2, rel=1e-2)
    assert len(run.transitions) == 3
    at = run.transitions[2]
    assert at.after[box.velocity] == pytest.approx([at.after[scene.slide.v], 0, 0], abs=1e-12)
    assert run[scene.hand.force].reshape(-1, 3)[-1] == pytest.approx([0, 0, 0.5 * 9.81], abs=1e-10)


@pytest.mark.parametrize("turned", [((1.0, 2.0, -1.0), 2.5), ((-1.0, 0.3, 0.5), 1.9)])
def test_gripper_holds_bodies_as_one_however_its_frames_are_turned(turned: tuple[tuple[float, float, float], float]) -> None:
    scene = ac.System()
    scene.world, sizes = World(gravity=(0.0, 0.0, 0.0)), ((0.3, 0.2, 0.1), (0.1, 0.4, 0.2))
    scene.boxes = [RigidBody.box(mass, size) for mass, size in zip((1.0, 2.5), sizes, strict=True)]
    scene.hand = Gripper(closes=ac.time - 0.2)
    scene.connect(scene.boxes[0].at((0.1, -0.3, 0.2), rotation=turned), scene.hand.frame_a)
    scene.connect(scene.hand.frame_b, scene.boxes[1].at((0.2, 0.1, -0.4)))
    frames = [box.frame for box in scene.boxes]
    start = {frames[0].velocity: (1, 0.2, -0.3), frames[0].angular_velocity: (0.4, -1, 0.7), frames[1].position: (0.5, 0.8, -0.2)}
    run = ac.build(scene).simulate(1.0, start, rtol=1e-11, samples=21)
    apart = run[frames[0].rotation.T @ frames[1].rotation][run.t > 0.2]
    assert apart == pytest.approx(np.broadcast_to(apart[0], apart.shape), abs=1e-10)
    # momentum, and spin about the world's origin, are kept
    momentum = spin = 0.0
    for box, size, mass in zip(frames, sizes, (1.0, 2.5), strict=True):
        R, v, w = run[box.rotation], run[box.velocity], run[box.angular_velocity]
        local = mass / 12 * (np.dot(size, size) - np.square(size))
        momentum = momentum + mass * v
        spin = spin + mass * np.cross(run[box.position], v) + np.einsum("tij,j,tkj,tk->ti", R, local, R, w)
    for kept in (momentum, spin):
        assert kept == pytest.approx(np.broadcast_to(kept[0], kept.shape), abs=1e-10)


def test_what_is_caught_while_it_stands_on_a_floor_stays_above_it() -> None:
    # a ball on the floor is caught by a box that falls onto it: the floor takes its part in the same instant
    m, M, h, g = 0.3, 0.7, 0.5, 9.81
    scene = ac.System()
    scene.world, scene.low = World(gravity=(0.0, 0.0, -g)), Particle(m)
    scene.floor = PointOnPlane(unilateral=True)
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.low.point)
    scene.box = RigidBody.box(mass=M, size=(0.1, 0.1, 0.1))
    scene.hook = PointLatch(closes=-1.0 * scene.box.frame.position[2])
    scene.connect(scene.box.frame, scene.hook.frame_a)
    scene.connect(scene.hook.frame_b, scene.low.point)
    low, box = scene.low.point, scene.box.frame
    run = ac.build(scene).simulate(
        1.0,
        {low.position: (0, 0, 0), box.position: (0, 0, h), box.velocity: (0.4, 0, 0)},
        rtol=1e-11,
        compiled=False,
        raise_on_failure=False,
    )
    assert run.status.kind is StatusKind.CANNOT_SET
    start = {low.position: (0, 0, 0), box.position: (0, 0, h), low.velocity: (0.4, 0, 0), box.velocity: (0.4, 0, 0)}
    run = ac.build(scene).simulate(1.0, start, rtol=1e-11, compiled=False)
    assert run[box.velocity][-1] == pytest.approx([0.4, 0, 0], abs=1e-10)
    assert np.abs(run[low.position][-1][2]) < 1e-12
    assert run[scene.floor.normal_force][-1] == pytest.approx((m + M) * g, rel=1e-10)
    assert run.energy_error() < 1e-10


def test_bounce_of_what_has_been_caught_moves_both() -> None:
    # falls docked, bounces docked: as one body
    scene = ac.System()
    scene.world, scene.ball, scene.box = World(), Particle(0.3), RigidBody.box(mass=0.7, size=(0.1, 0.1, 0.1))
    scene.floor = PointOnPlane(unilateral=True, restitution=0.6)
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.point)
    scene.hook = PointLatch(held=True)
    scene.connect(scene.box.frame, scene.hook.frame_a)
    scene.connect(scene.hook.frame_b, scene.ball.point)
    ball, box = scene.ball.point, scene.box.frame
    run = ac.build(scene).simulate(0.7, {ball.position: (0, 0, 1), box.position: (0, 0, 1)}, rtol=1e-11, compiled=False)
    struck = run.transitions[0]
    v = np.sqrt(2 * 9.81)
    assert struck.time == pytest.approx(v / 9.81, rel=1e-12)
    for body in (ball, box):
        assert struck.after[body.velocity] == pytest.approx([0, 0, 0.6 * v], rel=1e-12, abs=1e-12)
    assert struck.changes[0].impulse == pytest.approx(1.6 * v, rel=1e-12)
    assert run.energy_error() < 1e-10


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e4])
def test_frames_that_do_not_meet_are_told_by_how_much(size: float) -> None:
    scene, model = boxes(1.0, 1.0, 9.0, size)
    a, b = scene.a.frame, scene.b.frame
    start = {a.position: (-size, 1e-3 * size, 0), a.velocity: (size, 0, 0), b.position: (0, 0, 0)}
    run = model.simulate(2.0, start, compiled=False, raise_on_failure=False)
    assert run.status.kind is StatusKind.CANNOT_SET
    assert f"{1e-3 * size:.4g} m" in run.status.message
    assert "dock" in run.status.message
    assert run.t[-1] == pytest.approx(0.9, rel=1e-12)


def test_half_a_turn_is_not_how_frames_meet() -> None:
    scene, model = boxes(1.0, 1.0, 9.0)
    a, b = scene.a.frame, scene.b.frame
    start = {a.position: (-1, 0, 0), a.velocity: (1, 0, 0), b.position: (0, 0, 0), b.rotation: np.diag([1.0, -1.0, -1.0])}
    run = model.simulate(2.0, start, compiled=False, raise_on_failure=False)
    assert run.status.kind is StatusKind.CANNOT_SET


def test_frames_that_cannot_move_against_each_other_are_refused() -> None:
    scene = ac.System()
    scene.world, scene.box = World(), RigidBody.box(mass=1.0, size=(0.1, 0.1, 0.1))
    scene.latch = Latch()
    scene.connect(scene.box.frame, scene.latch.frame_a)
    scene.connect(scene.latch.frame_b, scene.box.at((0.1, 0.0, 0.0)))
    with pytest.raises(ModelError, match="does not move"):
        ac.build(scene)


def test_derivatives_through_what_is_fastened_are_refused() -> None:
    scene, model = boxes(1.0, 2.0, 1.5)
    a, b = scene.a.frame, scene.b.frame
    with pytest.raises(OptionError, match="dock"):
        model.sensitivities([0.0, 1.0], [a.velocity], {a.position: (-1, 0, 0), a.velocity: (1, 0, 0), b.position: (0, 0, 0)})
    with pytest.raises(OptionError, match="minimal"):
        model.minimal()
    with pytest.raises(OptionError, match=r"equations .*dock"):
        model.equations()


def test_what_is_held_at_the_start_loses_what_is_not_allowed() -> None:
    scene = arm(0.8, 1.3)
    scene.catch = PointLatch(held=True, opens=ac.time - 0.1)
    scene.connect(scene.world.at((0.0, 0.0, -0.8)), scene.catch.frame_a)
    scene.connect(scene.catch.frame_b, scene.rod.at((0.0, 0.0, -0.8)))
    model = ac.build(scene)
    run = model.simulate(0.2, {scene.hinge.v: 2.0}, rtol=1e-11, compiled=False)
    assert run.transitions[0].time == 0.0
    assert run.transitions[0].energy_lost == pytest.approx((1.3 * 0.8**2 + 1e-6) * 2.0, rel=1e-12)
    assert np.abs(run[scene.hinge.q]).max() < 1e-13
    assert run.energy_error() < 1e-12
    run = model.simulate(0.2, {scene.hinge.q: 0.1}, compiled=False, raise_on_failure=False)
    assert run.status.kind is StatusKind.CANNOT_SET
    assert "catch" in run.status.message


def test_arm_that_is_held_where_it_hinges_stands_still() -> None:
    # its place there does not move; the rotation does
    scene = arm(0.8, 1.3)
    scene.stop = Latch(closes=scene.hinge.q - 0.5, opens=ac.time - 3.0)
    scene.connect(scene.world.at((0.0, 0.0, 0.0), rotation_about(np.array([0.0, 1.0, 0.0]), 0.5)), scene.stop.frame_a)
    scene.connect(scene.stop.frame_b, scene.rod.frame)
    run = ac.build(scene).simulate(2.0, {scene.hinge.v: 4.0}, rtol=1e-11, compiled=False)
    assert run[scene.hinge.q][-1] == pytest.approx(0.5, abs=1e-13)
    assert run[scene.stop.torque].reshape(-1, 3)[-1] == pytest.approx([0, 1.3 * 9.81 * 0.8 * np.sin(0.5), 0], rel=1e-9, abs=1e-9)
    assert run[scene.stop.force].reshape(-1, 3)[-1] == pytest.approx([0, 0, 0], abs=1e-9)
    assert run.energy_error() < 1e-10


class Geneva(ac.Component):
    """A pin on a driver turns a wheel with n slots by one of them in each turn, and between these the wheel is locked."""

    driver, wheel = ac.Rotational.port(), ac.Rotational.port()

    def __init__(self, slots: int) -> None:
        self.step, self.far = 2 * np.pi / slots, 1 / np.sin(np.pi / slots)
        self.push, self.hold = ac.Reaction("N*m"), ac.Reaction("N*m")
        self.turn, self.within = ac.Discrete(start=0), ac.Discrete(start=0)

    def led(self, angle: Any) -> Any:
        """Where the wheel is led to by the pin, at an angle from the line of centres."""
        return -np.arctan2(np.sin(angle), self.far - np.cos(angle))

    def ratio(self, angle: Any) -> Any:
        return -(self.far * np.cos(angle) - 1) / (1 + self.far**2 - 2 * self.far * np.cos(angle))

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.wheel.tau, -1.0 * (self.push + self.hold))
        yield ac.equal(self.driver.tau, self.push * self.ratio(self.driver.phi))

    def laws(self) -> Iterable[ModeLaw]:
        angle, place = self.driver.phi - 2 * np.pi * self.turn, self.wheel.phi + self.step * self.turn
        yield ac.Lock((self.push,), place - self.led(angle), self.within)
        yield ac.Lock((self.hold,), place - self.step / 2, 1.0 - self.within)
        yield ac.when(angle + (np.pi - self.step) / 2, "rising", set={self.within: 1.0})
        yield ac.when(angle - (np.pi - self.step) / 2, "rising", set={self.within: 0.0, self.turn: self.turn + 1.0})


@pytest.mark.parametrize("joints", [False, True])
@pytest.mark.parametrize("slots", [4, 7])
def test_a_wheel_with_slots_turns_and_rests_by_locks_between_shafts_or_hinges(slots: int, joints: bool) -> None:
    """Energy alone says how fast: (J + K ratio^2) w^2 is the same all along."""
    J, K, w = 0.7, 1.9, 2.3
    scene = ac.System()
    geneva = scene.geneva = Geneva(slots)
    if joints:
        scene.world, scene.axles = World(None), [Revolute("z"), Revolute("z")]
        scene.wheels = [RigidBody(1.0, (moment,) * 3) for moment in (J, K)]
        for axle, wheel, port in zip(scene.axles, scene.wheels, (geneva.driver, geneva.wheel), strict=True):
            scene.connect(scene.world.frame, axle.frame_a)
            scene.connect(axle.frame_b, wheel.frame)
            scene.connect(axle.flange, port)
        (phi, rate), (wheel, wheel_rate) = ((axle.q, axle.v) for axle in scene.axles)
    else:
        scene.driver, scene.wheel = Inertia(J), Inertia(K)
        scene.connect(scene.driver.flange_b, geneva.driver)
        scene.connect(geneva.wheel, scene.wheel.flange_a)
        (phi, rate), (wheel, wheel_rate) = ((part.phi, part.w) for part in (scene.driver, scene.wheel))
    half = (np.pi - geneva.step) / 2
    nodes, weights = np.polynomial.legendre.leggauss(60)

    def lasts(end: float) -> float:
        angles = -half + (end + half) * (nodes + 1) / 2
        return float(np.sqrt(1 + K / J * geneva.ratio(angles) ** 2) @ weights * (end + half) / 2 / w)

    inside = 0.3 * half
    t = (np.pi - half) / w + 2 * (2 * np.pi - 2 * half) / w + 2 * lasts(half) + lasts(inside)
    start = {phi: -np.pi, rate: w, wheel: geneva.step / 2, wheel_rate: 0.0}
    run = ac.build(scene).simulate(t, start, rtol=1e-12)
    speed = w / np.sqrt(1 + K / J * geneva.ratio(inside) ** 2)
    assert run[phi][-1] == pytest.approx(4 * np.pi + inside, rel=1e-12)
    assert run[wheel][-1] == pytest.approx(-2 * geneva.step + geneva.led(inside), rel=1e-12)
    assert run[rate][-1] == pytest.approx(speed, rel=1e-11)
    assert run[wheel_rate][-1] == pytest.approx(geneva.ratio(inside) * speed, rel=1e-11)


@pytest.mark.parametrize("size", [1.0, 1e3])
def test_slides_that_are_tied_on_their_flanges_share_their_momentum(size: float) -> None:
    class Tie(ac.Component):
        flange_a, flange_b = ac.Translational.port(), ac.Translational.port()

        def __init__(self) -> None:
            self.pull, self.held = ac.Reaction("N"), ac.Discrete(start=0)

        def equations(self) -> Iterable[ac.Equation]:
            yield ac.equal(self.flange_a.f, self.pull)
            yield ac.equal(self.flange_b.f, -1.0 * self.pull)

        def laws(self) -> Iterable[ModeLaw]:
            yield ac.Lock((self.pull,), self.flange_b.s - self.flange_a.s, self.held)
            yield ac.when(self.flange_a.s - self.flange_b.s, "rising", set={self.held: 1.0})
            yield ac.when(ac.time - 2.0, "rising", set={self.held: 0.0})

    m, M, v = 0.3, 1.1, 2.0 * size
    scene = ac.System()
    scene.a, scene.b, scene.tie = SlidingMass(m), SlidingMass(M), Tie()
    scene.connect(scene.a.flange_b, scene.tie.flange_a)
    scene.connect(scene.tie.flange_b, scene.b.flange_a)
    run = ac.build(scene).simulate(3.0, {scene.a.s: 0.0, scene.a.v: v, scene.b.s: size, scene.b.v: 0.0}, rtol=1e-12)
    together = m * v / (m + M)
    assert [transition.time for transition in run.transitions] == pytest.approx([0.5, 2.0], rel=1e-14)
    assert run.transitions[0].energy_lost == pytest.approx(m * M / (m + M) * v**2 / 2, rel=1e-12)
    assert [run[mass.s][-1].item() for mass in (scene.a, scene.b)] == pytest.approx([size + 2.5 * together] * 2, rel=1e-13)


class Governor(ac.Component):
    """Remembers that a speed has passed a level."""

    def __init__(self, speed: ac.Expression, level: float) -> None:
        self.excess, self.on = speed - level, ac.Discrete(start=0)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.when(self.excess, "rising", set={self.on: 1})


@each_value(("size", [1e-3, 1.0, 1e3]), ("kind", [Latch, PointLatch, Gripper]), ("first", [True, False]))
def test_a_lift_whose_rope_breaks_is_caught_by_its_brake(kind: type, size: float, first: bool) -> None:
    # what is held at the start does not move there, and is let go later: what rubs and what stops it has to be there from the start
    m, g, level, breaks = 400.0, 9.81, 1.5 * np.sqrt(size), 1.0 * np.sqrt(size)
    scene = ac.System()
    scene.world, scene.rail, scene.cage = World(), Prismatic("z"), RigidBody.box(m, (size, size, 2 * size))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.cage.frame)
    scene.governor = Governor(-1.0 * scene.rail.v, level)
    held = kind(opens=ac.time - breaks, held=True)
    if first:
        scene.rope = held
    scene.brake, scene.stop = (
        Brake(scene.rail.flange, capacity=8000.0 * scene.governor.on),
        EndStop(scene.rail.flange, upper=0.1 * size),
    )
    if not first:
        scene.rope = held
    scene.connect(scene.world.frame, scene.rope.frame_a)
    scene.connect(scene.rope.frame_b, scene.cage.frame)
    run = ac.build(scene).simulate(3.0 * np.sqrt(size), rtol=1e-11)
    slows = 8000 / m - g
    times = np.cumsum([breaks, level / g, level / slows])
    assert [change.time for change in run.transitions] == pytest.approx(times, rel=1e-11)
    assert run[scene.rail.q][-1] == pytest.approx(-(level**2) / 2 * (1 / g + 1 / slows), rel=1e-11)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("turns", [True, False])
def test_what_is_held_at_the_start_is_assembled_from_a_sketch_and_moves_along_as_with_a_joint(turns: bool, size: float) -> None:
    ends = []
    for kind in (PointLatch, Spherical) if turns else (Latch, Fixed):
        scene = ac.System()
        scene.world, scene.hinge = World(), Revolute(axis="y")
        scene.rod = RigidBody.rod(1.0, (size, 0, 0), radius=0.05 * size)
        scene.other = RigidBody.rod(1.5, (0, 0, -size), radius=0.1 * size, position=(0.95 * size, 0.04 * size, 0.02 * size))
        scene.joint = kind(held=True) if kind in (PointLatch, Latch) else kind()
        scene.connect(scene.world.frame, scene.hinge.frame_a)
        scene.connect(scene.hinge.frame_b, scene.rod.frame)
        scene.connect(scene.rod.tip, scene.joint.frame_a)
        scene.connect(scene.joint.frame_b, scene.other.frame)
        tip = scene.other.tip
        asked = {scene.hinge.q: 0.3, scene.hinge.v: 1.2 / np.sqrt(size)}
        more = {tip.position[1]: 0.3 * size, scene.other.frame.angular_velocity: (0.5 / np.sqrt(size), 0, 0)} if turns else {}
        more |= {tip.position[0]: ac.near(0.95 * size)} if turns else {}
        run = ac.build(scene).simulate(1.5 * np.sqrt(size), asked | more, rtol=1e-11)
        assert run.energy_error() < 1e-9 and all(change.energy_lost < 1e-12 * run.kinetic_energy[0] for change in run.transitions)
        gap = run[scene.rod.tip.position - scene.other.frame.position]
        assert np.abs(gap).max() < 1e-10 * size
        ends.append(np.concatenate([run[scene.hinge.q], run[tip.position / size].ravel()]))
    assert ends[0] == pytest.approx(ends[1], abs=2e-8)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_what_a_gripper_holds_at_the_start_moves_along_from_where_it_stands(size: float) -> None:
    scene = arm(size, 1.3)
    scene.ball = RigidBody(0.4, (0.01 * size**2, 0.02 * size**2, 0.015 * size**2), position=(0.3 * size, 0.2 * size, -1.1 * size))
    scene.hand = Gripper(held=True)
    scene.connect(scene.rod.at((0.0, 0.0, -0.8 * size)), scene.hand.frame_a)
    scene.connect(scene.hand.frame_b, scene.ball.at((0.1 * size, 0, 0), rotation=("x", 0.3)))
    time, frame = np.sqrt(size), scene.ball.frame
    run = ac.build(scene).simulate(2.0 * time, {scene.hinge.q: 0.2, scene.hinge.v: 3.0 / time}, rtol=1e-11)
    assert run.energy_error() < 1e-10 and all(change.energy_lost < 1e-12 * run.kinetic_energy[0] for change in run.transitions)
    turned, place = run[frame.rotation], run[scene.rod.frame.rotation.T @ frame.position]
    assert (
        np.ptp(place, axis=0).max() < 1e-10 * size
        and np.abs(run[frame.angular_velocity - scene.rod.frame.angular_velocity]).max() < 1e-9 / time
    )
    assert np.abs(turned - turned[0]).max() > 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_box_that_a_gripper_lifts_by_a_rope_over_pulleys_hangs_for_a_hundred_seconds(seed: int) -> None:
    """A winch draws the rope of a gripper by t^3 (10 - 15 t + 6 t^2), and holds it: the box follows its law, and then moves by no more than what roundings of its weight make of it."""
    of = Drawn(seed)
    L, T, g = of.L, 4 * np.sqrt(of.L / 9.81), 9.81
    claw, load = of.M * of.rng.uniform(0.2, 3, 2)
    r, apart, high, way, reach = L * of.rng.uniform((0.1, 0.5, 2.5, 0.3, 0.3), (0.3, 1, 4, 1, 0.6))
    size = L * np.array([0.2, 0.3, 0.2])
    lifted, drawn = reach + size[2] / 2, (ac.time - T) / T
    winch = high - way / 2 - way * np.where(drawn < 0, 0, np.where(drawn < 1, drawn**3 * (10 - 15 * drawn + 6 * drawn**2), 1))
    scene = ac.System()
    scene.world, scene.hand = World((0, 0, -g)), Gripper(held=True)
    bodies = [RigidBody.box(claw, tuple(size)), RigidBody.box(load, tuple(size))]
    scene.bodies = [bodies[k] for k in of.order(2)]
    scene.drive = PrescribedMotion(position=(apart + r, 0, winch))
    pulleys = (Pulley(scene.world.at((0, 0, high)), r), Pulley(scene.world.at((apart, 0, high)), r))
    scene.rope = Rope(high - lifted + np.pi * r + apart + way / 2, over=pulleys)
    scene.connect(scene.world.frame, scene.drive.frame_a)
    scene.connect(bodies[0].frame, scene.rope.frame_a, scene.hand.frame_a)
    scene.connect(scene.rope.frame_b, scene.drive.frame_b)
    scene.connect(scene.hand.frame_b, bodies[1].frame)
    upper, lower = (body.frame for body in bodies)
    start = {upper.position: (-r, 0, lifted), lower.position: (-r, 0, size[2] / 2)}
    run = ac.build(scene).simulate(100.0 * np.sqrt(L), start, rtol=1e-10, compiled=False)
    s = np.clip(run.t / T - 1, 0, 1)
    rises = way * s**3 * (10 - 15 * s + 6 * s**2)
    for frame, z in ((upper, lifted), (lower, size[2] / 2)):
        assert run[frame.position] == pytest.approx(np.array([-r + 0 * s, 0 * s, z + rises]).T, abs=1e-9 * L)
    held = run.t > 3 * T
    assert np.ptp(run[lower.position][held], axis=0).max() < 2e-16 * g * run.t[-1] ** 2  # roundings of the weights, at most
    middle = run.at([1.5 * T, 70 * T])
    assert middle[scene.rope.tension].ravel() == pytest.approx(g * (claw + load), rel=1e-9)  # at 3/2 T it does not accelerate
    assert np.linalg.norm(middle[scene.hand.force].reshape(2, 3)[1]) == pytest.approx(g * load, rel=1e-9)
    assert not run.transitions
