"""Gears between joints that a loop ties already: they agree with it and transmit nothing, or are named."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from acausal.errors import LockedError, ParameterError, StartValueError
from acausal.numerics.switching import switching
from components import (
    AngleSource,
    Cable,
    ConstantSum,
    Gear,
    Inertia,
    PositionSource,
    Prismatic,
    RackAndPinion,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    Spherical,
    Universal,
    World,
)

G, LENGTH = 9.81, 0.5


def parallelogram(joints: tuple[int, int] | None, *ratios: float | ac.Parameter, idler: float = 0.02) -> ac.System:
    """Two upright cranks of 0.5 m and a coupler of 1 m; a gear between two of the joints (two cranks, then the ends of the coupler), or
    two gears and an idler between them."""
    scene = ac.System()
    scene.world, scene.coupler = World(), RigidBody.rod(2.0, (1, 0, 0))
    scene.cranks, scene.hinges = [RigidBody.rod(m, (0, 0, LENGTH)) for m in (1.0, 1.5)], [Revolute("y") for _ in range(4)]
    for k, foot in enumerate((scene.world.frame, scene.world.at((1, 0, 0)))):
        scene.connect(foot, scene.hinges[k].frame_a)
        scene.connect(scene.hinges[k].frame_b, scene.cranks[k].frame)
    scene.connect(scene.cranks[0].tip, scene.hinges[2].frame_a)
    scene.connect(scene.hinges[2].frame_b, scene.coupler.frame)
    scene.connect(scene.coupler.tip, scene.hinges[3].frame_a)
    scene.connect(scene.hinges[3].frame_b, scene.cranks[1].tip)
    if joints is None:
        return scene
    first, last = (scene.hinges[k].flange for k in joints)
    scene.ratios, scene.gears = list(ratios), [Gear(ratio) for ratio in ratios]
    scene.idlers = [Inertia(idler) for _ in ratios[1:]]
    scene.connect(first, scene.gears[0].flange_a)
    for before, between, after in zip(scene.gears, scene.idlers, scene.gears[1:], strict=False):
        scene.connect(before.flange_b, between.flange_a)
        scene.connect(between.flange_b, after.flange_a)
    scene.connect(scene.gears[-1].flange_b, last)
    return scene


def angle(times: np.ndarray, start: float, rate: float, more: float = 0.0) -> np.ndarray:
    """Of the cranks, by hand; `more` is inertia on their shaft [kg m^2]."""
    inertia, moment = (1.0 + 1.5) * LENGTH**2 / 3 + 2.0 * LENGTH**2 + more, ((1.0 + 1.5) / 2 + 2.0) * LENGTH * G
    law = lambda t, y: [y[1], moment * np.sin(y[0]) / inertia]  # noqa: E731
    return solve_ivp(law, (0, times[-1]), [start, rate], "DOP853", times, rtol=1e-12, atol=1e-12).y[0]


@pytest.mark.parametrize(
    ("joints", "ratios", "more"),
    [((0, 1), (1.0,), 0.0), ((0, 2), (-1.0,), 0.0), ((2, 3), (-1.0,), 0.0), ((1, 0), (-0.5, -2.0), 0.02 * 4)],
    ids=["cranks", "crank and coupler", "ends of the coupler", "idler"],
)
def test_a_gear_that_says_what_a_parallelogram_does_changes_nothing_but_for_its_idler(joints, ratios, more):
    scene = parallelogram(joints, *ratios)
    model = ac.build(scene)
    table = model.constraints()
    assert model.degrees_of_freedom == table.configuration_freedom == 1
    assert sum(entry.kind == "redundant" for entry in table) == 1
    run = model.simulate(1.0, {scene.hinges[0].q: 0.3, scene.hinges[0].v: 6.0}, rtol=1e-11)  # through both flat positions
    for hinge in scene.hinges[:2]:
        np.testing.assert_allclose(run[hinge.q], angle(run.t, 0.3, 6.0, more), atol=1e-8)
    assert run.energy_error() < 1e-8
    # one gear of a train drives the idler, the other one transmits nothing
    assert min(np.max(np.abs(run[gear.flange_b.tau])) for gear in scene.gears) < 1e-12


def test_a_gear_that_a_parallelogram_does_not_allow_is_named():
    for joints, ratio in (((0, 1), 2.0), ((0, 1), -1.0), ((0, 3), -1.0)):
        with pytest.raises(LockedError, match="gears"):
            ac.build(parallelogram(joints, ratio))
    scene = parallelogram((0, 1), ac.Parameter(1.0))
    model = ac.build(scene)
    with pytest.raises(StartValueError, match="hinges"):
        model.initial_state({scene.hinges[0].q: 0.3, scene.hinges[1].q: 0.4})
    with pytest.raises(ParameterError, match=r"gears\[0\].ratio = 2 \(built with 1\).*equation 1 of gears"):
        model.simulate(1.0, parameters={scene.ratios[0]: 2.0})
    holds = model.functions.holds
    assert holds is not None
    for q in (0.3, 0.0):
        x = model.initial_state({scene.hinges[0].q: q}).x
        assert holds(0, x, [], [1.0]) >= 0 > max(float(holds(0, x, [], [ratio])) for ratio in (2.0, 1 + 1e-9))
    assert "it transmits nothing" in str(model.decisions)


@pytest.mark.parametrize("other", [lambda t: 2 * t, lambda t: 2 * t + 0.1 * t * t], ids=["alike", "later apart"])
def test_two_drives_of_a_parallelogram_are_refused_since_they_may_differ_later(other):
    scene = parallelogram(None)
    scene.drives = [AngleSource(2 * ac.time), AngleSource(other(ac.time))]
    for drive, hinge in zip(scene.drives, scene.hinges, strict=False):
        scene.connect(drive.flange, hinge.flange)
    with pytest.raises(LockedError, match="hold joints that loops hold already"):
        ac.build(scene)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_rack_between_joints_that_loops_hold_at_rest_is_held_to_rounding_and_nothing_warns(size):
    g = np.random.default_rng(0)
    scene, place = ac.System(), lambda: size * g.normal(size=3)
    scene.world = World((0, 0, -G * size))
    scene.bodies = [RigidBody.box(1.0, (size,) * 3, position=place()) for _ in range(3)]
    scene.hinge = Revolute.between(scene.world, scene.bodies[0], at=place(), axis=g.normal(size=3))
    scene.slide = Prismatic.between(scene.world, scene.bodies[1], at=place(), axis=g.normal(size=3))
    scene.pins = [Spherical.between(scene.world, body, at=place()) for body in scene.bodies[:2]]
    scene.swing = Revolute.between(scene.world, scene.bodies[2], at=place(), axis="y")
    scene.rack = RackAndPinion(0.3 * size)
    scene.connect(scene.hinge.flange, scene.rack.pinion)
    scene.connect(scene.slide.flange, scene.rack.rack)
    run = ac.build(scene).simulate(0.5)
    assert np.max(np.abs(run[scene.hinge.q])) < 1e-12 < np.max(np.abs(run[scene.swing.q]))


def test_a_cable_that_locks_a_hinge_is_named_and_so_are_flanges_where_there_are_any():
    scene = ac.System()
    scene.world, scene.rod, scene.hinge, scene.cable = World(), RigidBody.rod(1.0, (1, 0, 0)), Revolute("y"), Cable(1.5)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.world.at((0, 0, 1)), scene.cable.frame_a)
    scene.connect(scene.cable.frame_b, scene.rod.tip)
    with pytest.raises(LockedError, match="gears, cables and sources, from 'connection of cable"):
        ac.build(scene)


@pytest.mark.parametrize("count", [3, 4])
def test_rotors_geared_to_hinges_of_a_loop_at_rest_are_moved_without_a_switch(count):
    """Where terms of their equations are zero but for rounding, too: absolute values of these would end steps without end."""
    scene = parallelogram(None)
    scene.rotors, scene.gears = [Inertia(0.01 * (k + 1)) for k in range(count)], [Gear(2.0 + k) for k in range(count)]
    for hinge, gear, rotor in zip(scene.hinges, scene.gears, scene.rotors, strict=False):
        scene.connect(rotor.flange_a, gear.flange_a)
        scene.connect(gear.flange_b, hinge.flange)
    model = ac.build(scene)
    assert switching(model.functions.explicit_dynamics) is None
    run = model.simulate(0.7, {scene.hinges[0].q: 0.3}, rtol=1e-11)
    more = sum(rotor.inertia * gear.ratio**2 for rotor, gear in zip(scene.rotors, scene.gears, strict=True))
    np.testing.assert_allclose(run[scene.hinges[0].q], angle(run.t, 0.3, 0.0, more), atol=1e-9)
    assert run.statistics.steps < 30


@pytest.mark.parametrize(("seed", "size"), [(0, 1e-3), (4, 1.0), (6, 1.0), (7, 1e3)])
def test_a_gear_between_a_hinge_and_one_that_a_loop_holds_at_rest_holds_it(seed, size):
    """All axes are parallel: where rows of loops are nothing but rounding they hold nothing, though they may look like what the gear says."""
    g = np.random.default_rng(seed)
    along, across, _ = np.linalg.qr(g.normal(size=(3, 3)))[0]
    scene, (pivot, pin, other) = ac.System(), size * g.normal(size=(3, 3))
    scene.world = World((0, 0, -G * size))
    turned = [np.linalg.qr(g.normal(size=(3, 3)))[0] for _ in range(4)]
    scene.bodies = [
        RigidBody.box(1.0, (size, 2 * size, size), position=size * g.normal(size=3), rotation=R * np.linalg.det(R))
        for R in turned
    ]
    slide, rocker, wheel, pendulum = scene.bodies
    scene.guide = Prismatic.between(slide, scene.world, at=pivot, axis=along)
    scene.pin, scene.held, scene.hinge, scene.swing = (
        Revolute.between(a, b, at=at, axis=along)
        for a, b, at in (
            (rocker, slide, pin), (rocker, scene.world, pivot), (wheel, scene.world, other), (pendulum, slide, other),
        )
    )  # fmt: skip
    scene.cross = Universal.between(wheel, rocker, at=pin, axis_a=along, axis_b=across)
    scene.ball = Spherical.between(wheel, pendulum, at=other)
    scene.gear = Gear(1.3)
    scene.connect(scene.hinge.flange, scene.gear.flange_a)
    scene.connect(scene.gear.flange_b, scene.held.flange)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1
    run = model.simulate(0.2)
    assert np.max(np.abs(run[scene.hinge.q])) < 1e-12 < np.max(np.abs(run[scene.swing.q]))


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_gear_that_a_given_motion_leaves_at_once_is_refused(size: float):
    """Slides on a rod that spins: x^2 + z^2 stays. Where x is given, loops hold z, and x + z = 0 is met at the sketch only: at no other time, which is looked at."""
    scene = ac.System()
    scene.world = World((0, 0, -9.81 * size))
    ends = size * np.array([[0.6, 0, 0], [0, 0, 0.8]])
    scene.slides = [RigidBody.box(1.0, (size, size, size), position=tuple(end)) for end in ends]
    scene.rod = RigidBody(1.0, 0.1 * size**2 * np.eye(3), position=tuple(ends.mean(axis=0)))
    scene.guides = [
        Prismatic.between(scene.world, b, at=tuple(e), axis=a) for b, e, a in zip(scene.slides, ends, "xz", strict=True)
    ]
    scene.balls = [Spherical.between(body, scene.rod, at=tuple(end)) for body, end in zip(scene.slides, ends, strict=True)]
    scene.source, scene.sum = PositionSource(lambda t: 0.1 * size * np.sin(2 * t)), ConstantSum(0.0, 2)
    scene.connect(scene.source.flange, scene.guides[0].flange)
    for flange, guide in zip(scene.sum.flanges, scene.guides, strict=True):
        scene.connect(flange, guide.flange)
    with pytest.raises(LockedError, match="1 hold joints that loops hold already"):
        ac.build(scene)


def geared_five_bar(size: float, damping: float) -> Any:
    """Two cranks that a gear turns against one another, and two equal rods to an apex: these lie on one another where the cranks' tips meet."""
    scene: Any = ac.System()
    scene.world = World((0, 0, -9.81 * size))
    scene.bars = [
        RigidBody.rod(0.5, (size * x, 0, size * z), position=(size * at, 0, size * up))
        for x, z, at, up in ((-0.05, 0.3, -0.2, 0), (0.25, 0.35, -0.25, 0.3), (0.05, 0.3, 0.2, 0), (-0.25, 0.35, 0.25, 0.3))
    ]
    (a, b, c, d), hinge = scene.bars, lambda one, other, x, z: Revolute.between(one, other, at=(size * x, 0, size * z), axis="y")
    scene.left, scene.right = hinge(scene.world, a, -0.2, 0), hinge(scene.world, c, 0.2, 0)
    scene.pins = [hinge(a, b, -0.25, 0.3), hinge(c, d, 0.25, 0.3), hinge(b, d, 0, 0.65)]
    scene.gear, scene.damper, scene.ground = Gear(-1.0), RotationalDamper(damping * size**2), RotationalGround()
    scene.connect(scene.left.flange, scene.gear.flange_a, scene.damper.flange_a)
    scene.connect(scene.right.flange, scene.gear.flange_b)
    scene.connect(scene.damper.flange_b, scene.ground.flange)
    return scene


@pytest.mark.parametrize("damping", [0.0, 0.01])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_cranks_geared_to_one_another_go_on_as_they_must_where_their_rods_lie_on_one_another_or_say_that_they_do_not(
    size: float, damping: float
):
    """By symmetry the apex stays in the middle: there another motion branches off, the apex swings and the cranks rest. What is told of an energy that has
    grown beyond all that was there is told as a gap, and not measured by itself.
    """
    scene = geared_five_bar(size, damping)
    model, apex = ac.build(scene), scene.bars[1].tip.position[0]
    told = 0
    for rtol in (1e-4, 1e-7, 1e-8, 1e-11):
        for end in (0.5, 0.53, 0.6):
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                try:
                    run = model.simulate(end, {scene.left.v: 0.7}, rtol=rtol, progress=False)
                except ac.errors.SimulationError:
                    said, run = [None], None
            told += bool(said)
            assert said or np.max(np.abs(run[apex])) < 1e-6 * size
            assert end > 0.5 or not said
            assert run is None or run.energy_error() > 1e-3 or np.max(np.abs(run[apex])) < 1e-3 * size
    assert told


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_cranks_that_a_cable_keeps_apart_turn_on_where_they_lie_flat_or_say_what_holds_them(size: float):
    """A parallelogram: evenly, at any speed; crossed beyond, or swinging, they would keep no energy."""
    scene: Any = ac.System()
    scene.world, scene.cranks, scene.cable = World(gravity=None), [Revolute("y"), Revolute("y")], Cable(size)
    scene.bars = [RigidBody.rod(1.0, (0.4 * size, 0, 0)) for _ in scene.cranks]
    for crank, bar, at in zip(scene.cranks, scene.bars, (0.0, size), strict=True):
        scene.connect(scene.world.at((at, 0, 0)), crank.frame_a)
        scene.connect(crank.frame_b, bar.frame)
    scene.connect(scene.bars[0].tip, scene.cable.frame_a)
    scene.connect(scene.bars[1].tip, scene.cable.frame_b)
    model, (left, right) = ac.build(scene), scene.cranks
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            run = model.simulate(5.0, {left.q: 1.0, right.q: 1.0, left.v: 3.0}, rtol=rtol, progress=False)
        off = max(float(np.max(np.abs(run[crank.q] - 1.0 - 3.0 * run.t))) for crank in scene.cranks)
        assert off < 1e-6 or (said and run.energy_error() > 0.1 and "cables" in str(said[0].message))
