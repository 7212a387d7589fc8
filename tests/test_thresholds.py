"""Where numbers decide, they decide on the right side well before rounding, and not at what is merely small."""

from __future__ import annotations

import itertools
import warnings
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal.errors import AssemblyError, JumpWarning, LockedError, OptionError, StartValueError
from acausal.loops.self_stress import loop_reactions
from acausal.numerics.independent import Independent
from acausal.numerics.rivals import Candidate
from components import AngleSource, CartesianTranslation, Fixed, Gear, Particle, Revolute, RigidBody, Rod, World
from tests.pairings import each_value
from tests.scenes import DoublePendulum, Pendulum, bennett_linkage
from tests.similar import Units, four_bar_scene
from tests.test_scale_decisions import drawn_flat


def bead_on_two_rods(apart: float) -> ac.System:
    """From points that are so far apart, of lengths that let it hang below the first one."""
    scene = ac.System()
    scene.world, scene.move, scene.bead = World(), CartesianTranslation(), Particle(1.0)
    scene.near, scene.far = Rod(1.0), Rod(float(np.hypot(1.0, apart)))
    scene.move.q.start = (0.0, 0.0, -1.0)
    scene.connect(scene.world.frame, scene.move.frame_a, scene.near.frame_a)
    scene.connect(scene.world.at((apart, 0, 0)), scene.far.frame_a)
    scene.connect(scene.move.frame_b, scene.bead.point, scene.near.frame_b, scene.far.frame_b)
    return scene


@pytest.mark.parametrize("apart", [1e-4, 1e-3, 0.1])
def test_two_rods_that_are_nearly_one_hold_two_freedoms(apart: float):
    """A bead on two rods from neighbouring points turns about the line through these, however near they are."""
    scene = bead_on_two_rods(apart)
    model = ac.build(scene)
    assert model.degrees_of_freedom == 1 and all(entry.kept for entry in model.constraints())
    run = model.simulate(1.0, {scene.bead.point.position[1]: 0.6}, rtol=1e-9)
    assert np.max(np.abs(run[scene.bead.point.position][:, 0])) < 1e-9 / apart


@pytest.mark.parametrize(("apart", "freedoms"), [(0.0, 2), (1e-13, 2), (1e-5, 1)])
def test_rows_are_one_or_two(apart: float, freedoms: int):
    model = ac.build(bead_on_two_rods(apart))
    assert (model.degrees_of_freedom, model.system.constraints.singular) == (freedoms, False)


@pytest.mark.parametrize("apart", [1e-11, 1e-9, 1e-8, 1e-7, 1e-6, 3e-6])
def test_rows_that_are_neither_one_nor_two_are_told(apart: float):
    with pytest.raises(LockedError, match="neither"):
        ac.build(bead_on_two_rods(apart))


def nearly_a_parallelogram(longer: float) -> ac.System:
    """Drawn flat, on a ground that is longer than the coupler by so much."""
    scene = ac.System()
    scene.world, scene.hinges = World(), [Revolute("y") for _ in range(4)]
    bars = [RigidBody.rod(1.0, (length, 0, 0)) for length in (0.4, 1.0, 0.4)]
    scene.crank, scene.coupler, scene.rocker = bars
    ends = [
        (scene.world.frame, scene.crank.frame),
        (scene.crank.tip, scene.coupler.frame),
        (scene.coupler.tip, scene.rocker.tip),
        (scene.world.at((1.0 + longer, 0, 0)), scene.rocker.frame),
    ]
    for joint, (one, two) in zip(scene.hinges, ends, strict=True):
        scene.connect(one, joint.frame_a)
        scene.connect(joint.frame_b, two)
    return scene


@pytest.mark.parametrize("longer", [0.0, 1e-9, 1e-5, 1e-3])
def test_only_an_exact_parallelogram_passes_singular_positions(longer: float):
    assert ac.build(nearly_a_parallelogram(longer)).system.constraints.singular is (longer == 0.0)


@pytest.mark.parametrize(("angle", "clear"), [(1e-5, True), (1e-7, False)])
def test_coordinates_are_independent_until_right_beside_a_singular_position(angle: float, clear: bool):
    scene = nearly_a_parallelogram(0.0)
    model, start = ac.build(scene), {scene.hinges[0].q: angle, scene.hinges[3].q: angle}
    if clear:
        assert model.linearize(start).A.shape == (2, 2)
        return
    with pytest.raises(OptionError, match="singular position"):
        model.linearize(start)


@pytest.mark.parametrize(("share", "met"), [(3e-8, True), (1e-10, False)])
def test_values_that_nearly_say_the_same_are_met_where_they_differ_enough(share: float, met: bool):
    scene = DoublePendulum()
    start = {scene.shoulder.q: 0.3, scene.shoulder.q + share * scene.elbow.q: 0.3 + share * 0.5}
    model = ac.build(scene)
    if met:
        assert model.initial_state(start).x[1] == pytest.approx(0.5, abs=1e-13 / share)
        return
    with pytest.raises(StartValueError):
        model.initial_state(start)


@pytest.mark.parametrize(("jump", "said"), [(0.0, False), (1e-5, True), (0.1, True)])
def test_a_small_jump_of_a_prescribed_motion_is_said_too(jump: float, said: bool):
    scene = Pendulum()
    scene.drive = AngleSource(lambda t: t + ca.if_else(t > 0.5, jump, 0.0))
    scene.connect(scene.drive.flange, scene.hinge.flange)
    model = ac.build(scene)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.simulate(1.0)
    found = [w for w in caught if w.category is JumpWarning]
    assert bool(found) is said and all(w.filename == __file__ for w in found)


@pytest.mark.parametrize(("askew", "said"), [(1e-11, True), (1e-8, True), (1e-4, True), (1e-2, True), (0.1, False), (1.0, False)])
def test_who_meant_axes_to_be_parallel_is_told_by_how_much_they_are_not(askew: float, said: bool):
    """A four-bar that is drawn closed, with one hinge askew, is locked; by a large angle nobody meant it to move."""
    scene = ac.System()
    scene.world, places = World(), [(0, 0, 0), (0.2, 0, 0.4), (1.1, 0, 0.7), (1.0, 0, 0)]
    scene.bars = [RigidBody.rod(1.0, tuple(np.subtract(b, a)), position=a) for a, b in itertools.pairwise(places)]
    ends, axes = [scene.world.frame, *scene.bars, scene.world.frame], ["y", "y", "y", (0, np.cos(askew), np.sin(askew))]
    scene.hinges = [Revolute.between(ends[k], ends[k + 1], at=places[k], axis=axes[k]) for k in range(4)]
    with pytest.raises(LockedError) as caught:
        ac.build(scene)
    assert ("nearly follow" in str(caught.value)) is said


def test_of_reactions_that_rigid_bodies_leave_open_the_least_ones_are_given():
    """Of Bennett's linkage: none along a direction that leaves the motion as it is, to as many digits as its rows depend on one another; and no
    hinge resists about its axis.
    """
    scene = bennett_linkage()
    model = ac.build(scene)
    system, run = model.system, model.simulate(0.5, samples=3, rtol=1e-12)
    loops = loop_reactions(system.mechanics, system.constraints)
    tree, (W, A) = system.mechanics.tree, loops.measured
    statics = ca.Function("statics", [tree.q, tree.t, system.p], [ca.densify(part) for part in (W, A, loops.of_wrenches)])
    joints = [edge.joint for edge in loops.edges]
    for k, t in enumerate(run.t):
        W, A, sizes = (np.array(part) for part in statics(np.array([float(run[j.edge.joint.q][k]) for j in tree.joints]), t, []))
        wrenches: list[np.ndarray] = []
        for joint in joints:
            axes = np.reshape(run[joint.frame_b.rotation][k], (3, 3)) @ np.array(joint.mounting())
            wrenches += [axes.T @ run[joint.frame_b.torque][k], axes.T @ run[joint.frame_b.force][k]]
            assert abs(wrenches[-2][2]) < 1e-10 * np.linalg.norm(wrenches[-2])
        U, s, _ = np.linalg.svd(A)
        free = W @ U[:, int(np.sum(s > 1e-7 * s[0])) :]
        left = free.T @ (np.concatenate(wrenches) / sizes[:, 0])
        assert free.size and np.max(np.abs(left)) < 5e-12 * np.linalg.norm(free) * np.linalg.norm(wrenches)


@each_value(
    (
        ("lengths", "angle"),
        [
            ((0.3, 1.0, 0.7, 0.9), 0.7),
            ((1.0, 1e3, 3.0, 999.0), 0.7),
            *(((0.5, 1.0, 0.5, 1.0), -angle) for angle in (0.1, 1e-2, 1e-3)),
        ],
    ),
    ("size", [1.0, 1e-4]),
)
def test_hinges_of_a_four_bar_bear_no_torque_about_their_axes(lengths: tuple[float, ...], angle: float, size: float):
    """However different its lengths are, and however near to where it lies flat; and what they bear moves the bars as they move."""
    scene = ac.System()
    scene.world, scene.hinges = World(gravity=(0, 0, -9.81 * size)), [Revolute("y") for _ in range(4)]
    scene.bars = [RigidBody.rod(1.0, (size * length, 0, 0)) for length in lengths[:3]]
    crank, coupler, rocker = scene.bars
    a, b, c, d = scene.hinges
    ends = [(scene.world.frame, a.frame_a), (a.frame_b, crank.frame), (crank.tip, b.frame_a), (b.frame_b, coupler.frame)]
    ends += [
        (coupler.tip, c.frame_a),
        (c.frame_b, rocker.tip),
        (rocker.frame, d.frame_b),
        (scene.world.at((size * lengths[3], 0, 0)), d.frame_a),
    ]
    for pair in ends:
        scene.connect(*pair)
    run = ac.build(scene).simulate(1e-6, {a.q: angle, a.v: 1.0}, samples=2)
    forces, torques = (
        np.array([run[part][0] for part in parts])
        for parts in zip(*((h.frame_b.force, h.frame_b.torque) for h in scene.hinges), strict=True)
    )
    assert np.max(np.abs(torques[:, 1])) < 1e-10 * size * max(lengths[:3]) * np.max(np.abs(forces))
    middle = (ac.der(coupler.frame.velocity) + ac.der(coupler.tip.velocity)) / 2
    pulls = -run[b.frame_b.force][0] - run[c.frame_a.force][0]
    assert pulls == pytest.approx(run[middle][0] + [0, 0, 9.81 * size], abs=1e-12 * np.max(np.abs(forces)))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(("misfit", "fits"), [(3e-10, True), (1e-8, False)])
def test_rigid_parts_fit_to_nine_digits_of_their_lengths(size: float, misfit: float, fits: bool):
    scene = ac.System()
    scene.world, scene.hinge, scene.body = World(), Revolute("y"), RigidBody.rod(1.0, (0, 0, -size))
    scene.one, scene.other = Fixed((0, 0, -size)), Fixed((0, 0, -size * (1 + misfit)))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.body.frame, scene.one.frame_a, scene.other.frame_a)
    scene.connect(scene.one.frame_b, scene.other.frame_b)
    if fits:
        assert ac.build(scene).degrees_of_freedom == 1
        return
    with pytest.raises(AssemblyError, match="does not fit"):
        ac.build(scene)


@each_value(("size", [1e-6, 1.0, 1e6]), (("off", "met"), [(1e-7, True), (1e-5, False)]))
def test_states_are_typed_to_six_digits(size: float, off: float, met: bool):
    scene = four_bar_scene(Units(length=size))
    model = ac.build(scene)
    x = model.initial_state({scene.a.q: 0.3}).x
    x[1] += off
    if met:
        assert model.linearize(x).A.shape == (2, 2)
        return
    with pytest.raises(StartValueError, match="violate the constraints"):
        model.linearize(x)


@pytest.mark.parametrize(("turned", "told"), [(1e-4, True), (1e-5, True), (1e-7, False), (1e-10, False)])
def test_a_side_is_drawn_by_a_hundred_thousandth_of_a_turn(turned: float, told: bool):
    """Bars drawn on one line but for an angle close to the side that it points to; what is less is a slip of the pen, and one side is taken for both."""
    sides = list[float]()
    for sense in (1.0, -1.0):
        scene, hinges = drawn_flat((0.3, 0.9, 0.6, 0.8))
        hinges[1].q.start = sense * turned
        sides.append(float(np.sign(ac.build(scene).simulate(1e-9, samples=2)[hinges[0].q][0])))
    assert sides == ([1.0, -1.0] if told else [sides[0]] * 2)


@pytest.mark.parametrize(("off", "same"), [(1e-3, False), (1e-5, True)])
def test_configurations_are_the_same_to_four_digits(off: float, same: bool):
    """Searches end near one another, branches lie apart: only those are compared by which is nearer."""
    one, other = (Candidate(np.zeros(3), 0.0, np.array([0.3, x, -0.2])) for x in (0.1, 0.1 + off))
    assert one.is_as(other) == other.is_as(one) == same


def four_bar_that_folds(ground: float, size: float) -> Any:
    """Where the ground is 0.9 of its size: crank and coupler are then as long as ground and rocker. The rocker's hinge may be askew."""
    scene: Any = ac.System()
    scene.ground, scene.tilt = ac.Parameter(ground * size, "m"), ac.Parameter(0.0)
    scene.world, scene.hinges = World(), [Revolute("y"), Revolute("y"), Revolute("y"), Revolute((0, 1, scene.tilt))]
    scene.bars = [RigidBody.rod(1.0, (length * size, 0, 0)) for length in (0.4, 1.0, 0.5)]
    one, two, three = scene.bars
    held = [
        (scene.world.frame, one.frame),
        (one.tip, two.frame),
        (two.tip, three.tip),
        (scene.world.at((scene.ground, 0, 0)), three.frame),
    ]
    for hinge, (a, b) in zip(scene.hinges, held, strict=True):
        scene.connect(a, hinge.frame_a)
        scene.connect(hinge.frame_b, b)
    return scene


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_what_is_said_to_hold_at_other_lengths_would_be_decided_alike_there(size: float):
    """Nearer to where it folds less may change; folding itself is never taken for granted."""
    for ground in (0.95, 0.903, 0.9001):
        constraints = ac.build(four_bar_that_folds(ground, size)).system.constraints
        held = [
            part
            for part in (1e-9, 1e-7, 1e-5, 1e-3, 0.1, 0.5, 1.0)
            if constraints.hold(np.array([(ground + part * (0.9 - ground)) * size, 0.0]))
        ]
        assert held and 1.0 not in held, ground


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_steps_are_told_where_rows_do_not_follow_from_others_any_more(size: float):
    """Hinges that are askew by a seven-thousandth lock a four-bar: it is one step's business, too, where nothing examines loops."""
    scene = four_bar_that_folds(1.0, size)
    model = ac.build(scene)
    x, step = model.initial_state({scene.hinges[0].q: 1.0, scene.hinges[3].q: ac.near(1.2)}).x, model.step("gauss", 4, 0.01)
    for tilt, met in ((0.0, True), (1.5e-4, False), (1e-2, False)):
        assert np.isfinite(float(step(0, x, [], [size, tilt])[1])) == met


def test_steps_are_told_where_gears_contradict_each_other():
    scene: Any = ac.System()
    scene.world, scene.a, scene.b = World(), Revolute("y"), Revolute("y")
    scene.one, scene.two = RigidBody.rod(1.0, (0, 0, -1.0)), RigidBody.rod(1.0, (0, 0, -0.7))
    scene.ratios = [ac.Parameter(2.0), ac.Parameter(2.0)]
    scene.gears = [Gear(ratio) for ratio in scene.ratios]
    scene.connect(scene.world.frame, scene.a.frame_a, scene.b.frame_a)
    scene.connect(scene.a.frame_b, scene.one.frame)
    scene.connect(scene.b.frame_b, scene.two.frame)
    scene.connect(scene.a.flange, *(gear.flange_a for gear in scene.gears))
    scene.connect(scene.b.flange, *(gear.flange_b for gear in scene.gears))
    model = ac.build(scene)
    x, step = model.initial_state({scene.a.q: 0.3, scene.a.v: 0.4}).x, model.step("gauss", 4, 0.01)
    for ratio in (2.0, -3.0, 1e-5, 1e6):
        for off, met in ((0.0, True), (3e-8, False), (1e-3, False)):
            assert np.isfinite(float(step(0, x, [], [ratio, ratio * (1 + off)])[1])) == met, (ratio, off)


@pytest.mark.parametrize("dependent", [1e-6, 1e-8])
def test_rows_are_left_to_singular_values_unless_these_would_say_the_same(dependent: float):
    """60 rows, and five that nearly follow from them."""
    rng = np.random.default_rng(1)

    def rows(count: int, of: np.ndarray) -> np.ndarray:
        found = rng.normal(size=(count, len(of))) @ of
        return found / np.linalg.norm(found, axis=1)[:, None]

    plain = rows(60, np.eye(80))
    for off in (1e-4, 1e-2, 1.0, 3.0, 10.0, 30.0):
        J = np.vstack([plain, rows(5, plain) + off * dependent * rows(5, np.eye(80))])
        found = Independent.of(J, dependent)
        assert (found is not None) == (off < 0.1)
        assert found is None or found.rows.size == np.sum(np.linalg.svd(J, compute_uv=False) > dependent) == 60
