"""Assembly from rough sketches, its report, its branches, and assembly as a differentiable function."""

from __future__ import annotations

import dataclasses
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal as ac
from acausal import errors
from acausal.numerics.assembly import assemble
from acausal.numerics.sizes import Sizes
from acausal.start.assembly_function import start_units
from components import Force, KnifeEdge, Planar, PrescribedMotion, Prismatic, Revolute, RigidBody, World
from examples.andrews import Andrews
from tests.assembly_scenes import (
    arm,
    closed,
    five_bar,
    planar_platform,
    puma,
    rssr,
    scissor_lift,
    slider_crank,
    snake,
    stewart_platform,
)
from tests.scenes import DoublePendulum, FourBar, bennett_linkage, rotation
from tests.similar import SCENES as SIMILAR
from tests.similar import Units, four_bar_scene


def turned(*v: float) -> np.ndarray:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(v)
    K = np.cross(np.eye(3), np.array(v) / angle)
    return np.eye(3) - np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def _four_bar() -> tuple[ac.System, dict[Any, Any]]:
    scene = FourBar(rotation(3))
    return scene, {scene.a.q: 0.3}


def _five_bar() -> tuple[ac.System, dict[Any, Any]]:
    scene = five_bar()
    return scene, {scene.hinges[0].q: 1.2, scene.hinges[4].q: 1.0}


def _slider_crank_at_its_end() -> tuple[ac.System, dict[Any, Any]]:
    scene = slider_crank()
    return scene, {scene.rail.q: 3.5}


def _slider_crank_near_its_dead_centre() -> tuple[ac.System, dict[Any, Any]]:
    scene = slider_crank()
    return scene, {scene.a.q: np.pi - 1e-3}


def _andrews() -> tuple[ac.System, dict[Any, Any]]:
    return Andrews(), {}


def _bennett() -> tuple[ac.System, dict[Any, Any]]:
    scene = bennett_linkage()
    return scene, {scene.joints[0].q: 0.2}


def _snake() -> tuple[ac.System, dict[Any, Any]]:
    scene = snake(30)
    return scene, {scene.links[-1].tip.position: (3.0, 5.0, -4.0)}


def _scissor_lift() -> tuple[ac.System, dict[Any, Any]]:
    scene = scissor_lift(10)
    return scene, {scene.left[0].tip.position[2]: 0.3}


def _stewart_platform_in_a_pose() -> tuple[ac.System, dict[Any, Any]]:
    scene = stewart_platform()
    return scene, {scene.platform.frame.position: (0.1, -0.1, 1.2), scene.platform.frame.rotation: turned(0.1, 0.2, -0.1)}


def _stewart_platform_with_legs_of_given_lengths() -> tuple[ac.System, dict[Any, Any]]:
    scene = stewart_platform()
    return scene, {slide.q: 1.2 + 0.05 * k for k, slide in enumerate(scene.slide)}


SCENES = [
    _four_bar, _five_bar, _slider_crank_at_its_end, _slider_crank_near_its_dead_centre, _andrews, _bennett, _snake, _scissor_lift,
    _stewart_platform_in_a_pose, _stewart_platform_with_legs_of_given_lengths,
]  # fmt: skip


@pytest.mark.parametrize("make", SCENES, ids=lambda make: make.__name__[1:])
def test_every_sketch_wrong_by_half_a_radian_or_half_a_length_is_assembled(make):
    """Ten sketches each, with random errors of all joints (seed 5); also from errors three times as large."""
    scene, start = make()
    state = ac.build(scene).initial_state(start)
    account = state.account
    search = account.problem.positions
    rng = np.random.default_rng(5)
    for size in (0.5,) * 10 + (1.5,) * 10:
        guess = search.guess + size * rng.normal(size=search.guess.size) * account.problem.measured(account.data).scale
        found = dataclasses.replace(search, guess=guess).solve(account.data, account.weights)
        assert found.converged
        assert np.max(np.abs(np.array(search.residual(found.y, account.data)))) < 1e-12 * (1 + np.max(np.abs(found.y)))
        assert search.is_meant(found.y, account.data)


@pytest.mark.parametrize("seed", range(6))
def test_bodies_drawn_half_a_radian_and_half_a_length_off_are_assembled_when_built(seed):
    """A four-bar in a skewed plane, from six sketches; the distances between its joints are then exact."""
    rng = np.random.default_rng(seed)
    R = rotation(seed)
    scene = ac.System()
    scene.world = World(None)
    lengths = (0.4, 1.2, 0.8)
    corners = [np.zeros(3), 0.4 * np.array([np.cos(0.9), np.sin(0.9), 0]), np.array([1.0, 0, 0])]
    scene.bars = [
        RigidBody.rod(
            1.0,
            tuple(R @ (length, 0, 0)),
            position=tuple(R @ (corner + 0.5 * length * rng.normal(size=3))),
            rotation=turned(*(0.5 * rng.normal(size=3))),
        )
        for length, corner in zip(lengths, corners, strict=True)
    ]
    scene.hinges = [Revolute(tuple(R @ (0, 0, 1))) for _ in range(4)]
    a, b, c = scene.bars
    closed(
        scene,
        (scene.world.frame, scene.hinges[0], a.frame),
        (a.tip, scene.hinges[1], b.frame),
        (b.tip, scene.hinges[2], c.tip),
        (scene.world.at(tuple(R @ (1.0, 0, 0))), scene.hinges[3], c.frame),
    )
    run = ac.build(scene).simulate(1e-3, samples=2)
    assert np.allclose(run[b.tip.position][0], run[c.tip.position][0], atol=1e-12)
    assert np.isclose(np.linalg.norm(run[b.tip.position][0] - run[a.tip.position][0]), 1.2, atol=1e-12)


def test_near_values_that_contradict_each_other_are_met_by_their_weights():
    """A slider wished at 1 with weight 3 and at 2 with weight 1 stands at the weighted mean, 1.25."""
    scene = ac.System()
    scene.world, scene.rail, scene.slider = World(None), Prismatic("x"), RigidBody.box(1.0, (0.1, 0.1, 0.1))
    closed(scene, (scene.world.frame, scene.rail, scene.slider.frame))
    place = scene.slider.frame.position[0]
    state = ac.build(scene).initial_state({scene.rail.q: ac.near(1.0, weight=3.0), place: ac.near(2.0)})
    assert np.isclose(state.x[0], 1.25, atol=1e-9)
    assert np.allclose([met.off for met in state.met], [0.25, 0.75], atol=1e-9)


def test_of_a_vector_some_entries_may_be_met_and_others_be_near():
    """A blade that points where it may not go: along itself it moves as it is told, and across as fast as that asks for."""
    scene = ac.System()
    scene.world, scene.plane, scene.sleigh, scene.blade = World(), Planar(), RigidBody.box(2.0, (0.3, 0.2, 0.1)), KnifeEdge()
    closed(scene, (scene.world.frame, scene.plane, scene.sleigh.frame))
    scene.connect(scene.world.frame, scene.blade.frame_a)
    scene.connect(scene.sleigh.frame, scene.blade.frame_b)
    model = ac.build(scene)
    state = model.initial_state({scene.plane.q: (0, 0, 0.3), "plane.v": (1.0, ac.near(0.0), 0.7)})
    assert state.x[3:] == pytest.approx([1.0, np.tan(0.3), 0.7], rel=1e-12)
    with pytest.raises(ac.errors.StartValueError, match=r"2 values are given for the shape \(3, 1\)"):
        model.initial_state({scene.plane.v: (1.0, ac.near(0.0))})


def test_a_point_out_of_reach_is_approached_as_near_as_the_arm_allows():
    scene = arm((1.0, 0.8))
    state = ac.build(scene).initial_state({scene.links[-1].tip.position[:2]: ac.near((3.0, 4.0))})
    assert np.allclose(state.met[0].got, 1.8 * np.array([0.6, 0.8]), atol=1e-6)
    assert np.isclose(np.hypot(*(state.met[0].got - state.met[0].wanted)), 5 - 1.8, atol=1e-9)


def test_what_start_values_leave_free_moves_least():
    """The nearest configuration to the sketch that puts the tip on a circle satisfies Lagrange's condition: the change is normal."""
    scene = arm((1.0, 0.8, 0.5))
    model = ac.build(scene)
    tip = scene.links[-1].tip.position
    state = model.initial_state({tip[0] * tip[0] + tip[1] * tip[1]: 1.5**2})
    q = ca.SX.sym("q", 3)
    x = sum(length * ca.cos(ca.sum1(q[: k + 1])) for k, length in enumerate((1.0, 0.8, 0.5)))
    y = sum(length * ca.sin(ca.sum1(q[: k + 1])) for k, length in enumerate((1.0, 0.8, 0.5)))
    normal = np.array(ca.Function("n", [q], [ca.gradient(x * x + y * y, q)])(state.x[:3])).ravel()
    change = state.x[:3] - state.account.positions.first
    assert np.linalg.norm(normal) > 0.1
    assert np.linalg.norm(change - normal * (normal @ change) / (normal @ normal)) < 1e-5


def test_velocities_left_free_are_least_over_all_joints():
    """Of a five-bar with one crank's velocity given, at another value of any other joint's the sum of squares is larger, in both directions."""
    scene = five_bar()
    model = ac.build(scene)
    given = {scene.hinges[0].q: 1.2, scene.hinges[4].q: 1.9, scene.hinges[0].v: 1.0}

    def velocities(start: dict[Any, Any]) -> np.ndarray:
        run = model.simulate(1e-3, start, samples=2)
        return np.array([run[hinge.v][0] for hinge in scene.hinges])

    least = velocities(given)
    for hinge, rate in list(zip(scene.hinges, least, strict=True))[1:]:
        more, less = (velocities(given | {hinge.v: rate + change}) for change in (0.01, -0.01))
        assert more @ more > least @ least < less @ less
        assert abs(more @ more - less @ less) < 1e-8 * (least @ least)


def test_velocities_may_be_asked_for_by_any_expression():
    """The speed of a tip squared, which is quadratic in the velocities."""
    scene = DoublePendulum()
    v = scene.lower.tip.velocity
    start = {scene.shoulder.q: 0.4, scene.elbow.q: 0.3, v.T @ v: 4.0, scene.elbow.v: ac.near(1.0)}
    run = ac.build(scene).simulate(1e-3, start, samples=2)
    assert np.isclose(np.linalg.norm(run[v][0]), 2.0, atol=1e-12)
    assert np.isclose(run[scene.elbow.v][0], 1.0, atol=1e-9)


def test_the_report_tells_what_was_asked_moved_closed_and_not_needed():
    scene = FourBar()
    tip = scene.crank.tip.position[0]
    words = str(ac.build(scene).initial_state({scene.a.q: 0.3, tip: 0.4 * np.cos(0.3), scene.d.q: ac.near(-1.0)}))
    assert "2 exact and 1 near values, 1 not met" in words
    assert "a.q" in words and "crank.tip.position[0]" in words
    assert "not met" in next(line for line in words.splitlines() if line.startswith("  d.q") and "near" in line)
    assert "farthest first" in words and "by 0.3 rad, from 0 to 0.3" in words
    assert "loop closed by joint 'c'" in words and "tests/scenes.py" in words
    assert "not needed, since each follows from the rest: a.q, crank.tip.position[0]" in words
    assert "leave no choice: d.q" in words


def test_the_report_of_forty_joints_is_short():
    scene = snake(40)
    words = str(ac.build(scene).initial_state({scene.links[-1].tip.position: (12.0, 16.0, 4.0)}))
    assert "and 30 more" in words or "and 29 more" in words
    assert len(words.splitlines()) < 20
    far = [float(line.split(" by ")[1].split()[0]) for line in words.splitlines() if line.startswith("  hinges[")]
    assert len(far) == 10 and far == sorted(far, reverse=True)


def test_failure_names_the_values_that_fight_and_what_they_would_be():
    """With the crank at 0.3 rad the coupler's angle is not free; each of the two is named with what it would be without it."""
    scene = FourBar()
    model = ac.build(scene)
    with pytest.raises(errors.StartValueError) as caught:
        model.initial_state({scene.a.q: 0.3, scene.b.q: 2.0, scene.a.v: 1.0})
    words = str(caught.value)
    assert "a.q = 0.3" in words and "b.q = 2" in words and "off by" in words and "a.v" not in words
    assert "Leave out a.q or b.q" in words or "Leave out b.q or a.q" in words
    said = float(words.split("b.q = 2 rad")[1].split("it would be ")[1].split(";")[0])
    with pytest.raises(errors.StartValueError) as other_order:
        model.initial_state({scene.b.q: 2.0, scene.a.q: 0.3, scene.a.v: 1.0})
    assert str(other_order.value).index("a.q = ") < str(other_order.value).index("b.q = ")
    place = model.state_names.index("b.q")
    assert min(abs(said - state.x[place]) for state in model.branches({scene.a.q: 0.3})) < 1e-5


def test_a_loop_that_parameters_keep_open_is_named_with_its_smallest_gap():
    """Lengths 1, rod and slider: with its rail 2 m aside, a rod of 0.5 m misses by 2 - 1 - 0.5."""
    rod = ac.Parameter(2.5, "m")
    scene = ac.System()
    scene.world, scene.a, scene.b, scene.c, scene.rail = World(None), Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    scene.crank, scene.rod = RigidBody.rod(1.0, (1.0, 0, 0)), RigidBody.rod(1.0, (rod, 0, 0))
    scene.slider = RigidBody.box(1.0, (0.1, 0.1, 0.1))
    closed(
        scene,
        (scene.world.frame, scene.a, scene.crank.frame),
        (scene.crank.tip, scene.b, scene.rod.frame),
        (scene.rod.tip, scene.c, scene.slider.frame),
        (scene.world.at((0, 2.0, 0)), scene.rail, scene.slider.frame),
    )
    model = ac.build(scene)
    with pytest.raises(errors.AssemblyError, match=r"joint '\w+' .* cannot close.*smallest gap reached is 0.5 "):
        model.initial_state(parameters={rod: 0.5})


def test_weights_that_are_no_weights_are_refused():
    scene = FourBar()
    model = ac.build(scene)
    for weight in (0.0, -1.0, float("nan"), float("inf"), "much"):
        with pytest.raises(errors.StartValueError, match=r"a\.q: the weight is"):
            model.initial_state({scene.a.q: ac.near(1.0, weight=weight)})  # pyright: ignore[reportArgumentType]


# --- branches ---


def test_an_arm_of_two_links_reaches_a_point_with_the_elbow_up_and_down():
    """Closed form by the law of cosines."""
    a, b, x, y = 1.0, 0.8, 1.2, 0.5
    scene = arm((a, b))
    model = ac.build(scene)
    found = model.branches({scene.links[-1].tip.position[:2]: (x, y)})
    elbow = np.arccos((x * x + y * y - a * a - b * b) / (2 * a * b))
    wanted = sorted((np.arctan2(y, x) - np.arctan2(b * np.sin(e), a + b * np.cos(e)), e) for e in (elbow, -elbow))
    assert np.allclose(sorted(tuple(state.x[:2]) for state in found), wanted, atol=1e-12)
    words = str(found)
    assert "2 branches" in words and "(nearest to the sketch)" in words and "hinges[1].q" in words
    assert len(model.branches({scene.links[-1].tip.position[:2]: (x, y)}, by=scene.links[-1].tip.position)) == 1
    assert "1 branch:" in str(model.branches({scene.hinges[0].q: 0.3}))


def test_a_four_bar_with_its_crank_held_is_open_or_crossed():
    """In a skewed plane; closed form: two circles about crank tip and fixed hinge meet in two points."""
    R = rotation(1)
    scene = FourBar(R)
    model = ac.build(scene)
    found = model.branches({scene.a.q: 0.7})
    assert len(found) == 2
    p, d, s, c = np.array([0.4 * np.cos(0.7), 0, -0.4 * np.sin(0.7)]), np.array([1.0, 0, 0]), 1.2, 0.8
    along = (d - p) / np.linalg.norm(d - p)
    t = (s * s - c * c + (d - p) @ (d - p)) / (2 * np.linalg.norm(d - p))
    side = np.sqrt(s * s - t * t) * np.array([along[2], 0, -along[0]])
    tips = [model.simulate(1e-6, _start(scene, state), samples=2)[scene.coupler.tip.position][0] for state in found]
    for wanted in (p + t * along + side, p + t * along - side):
        assert min(np.linalg.norm(tip - R @ wanted) for tip in tips) < 1e-9


@pytest.mark.parametrize(("elbow", "count"), [(5e-4, 2), (1e-5, 1)])
def test_branches_that_differ_by_a_ten_thousandth_are_one(elbow: float, count: int):
    """Those of an arm that is nearly stretched."""
    scene = arm((1.0, 0.8))
    reach = (1.0 + 0.8 * np.cos(elbow), 0.8 * np.sin(elbow))
    start = {scene.links[-1].tip.position[:2]: reach, scene.hinges[1].q: ac.near(elbow)}
    assert len(ac.build(scene).branches(start, searches=20)) == count


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_branches_are_told_apart_by_places_in_any_unit(size: float):
    """With its crank held, a four-bar's coupler ends in two places, and its crank in one."""
    scene = four_bar_scene(Units(length=size))
    model = ac.build(scene)
    for body, count in ((scene.crank, 1), (scene.coupler, 2)):
        assert len(model.branches({scene.a.q: 0.3}, by=body.tip.position, searches=20)) == count


def _start(scene: Any, state: Any) -> dict[Any, Any]:
    return {scene.a.q: 0.7, scene.d.q: ac.near(state.x[1]), scene.b.q: ac.near(state.x[2])}


def test_a_four_bar_that_turns_fully_has_two_branches_one_that_does_not_has_one():
    """Grashof: with shortest + longest < sum of the others the two ways to assemble are apart, else one leads to the other."""
    for coupler, count in ((1.2, 2), (1.5, 1)):  # 0.4, 0.8, 1.0 and the coupler
        found = ac.build(FourBar(coupler=coupler)).branches(searches=120)
        assert len(found) == count
        assert "1 freedom is left" in str(found)


def test_a_spatial_four_bar_has_two_rockers_for_one_crank():
    """RSSR: |tip of rocker - tip of crank| = rod is A sin + B cos = C in the rocker's angle."""
    scene = rssr()
    angles = sorted(np.array([_of(scene.d.q, state) for state in ac.build(scene).branches({scene.a.q: 0.7}, by=[scene.d.q])]))
    crank, pivot, rod, c = 0.3 * np.array([np.cos(0.7), np.sin(0.7), 0]), np.array([0.8, 0.5, 0.1]), 0.9, 0.6
    d = pivot - crank
    A, B, C = -2 * c * d[1], 2 * c * d[2], rod**2 - c * c - d @ d
    middle, half = np.arctan2(A, B), np.arccos(C / np.hypot(A, B))
    wanted = sorted(np.remainder(np.array([middle + half, middle - half]) + np.pi, 2 * np.pi) - np.pi)
    assert np.allclose(angles, wanted, atol=1e-9)


def _of(variable: Any, state: Any) -> float:
    coordinate = next(c for c in state.account.problem.coordinates.all if c.name == "d.q")
    return float(np.remainder(state.x[coordinate.place.start] + np.pi, 2 * np.pi) - np.pi)


def test_an_arm_of_six_hinges_reaches_a_pose_in_eight_ways():
    """Shoulder left or right, elbow up or down, wrist turned or not (Pieper 1968); each puts the tool in the pose asked for."""
    scene = puma()
    model = ac.build(scene)
    first = {h.q: v for h, v in zip(scene.hinges, (0.3, 0.5, 0.4, 0.6, 0.8, -0.3), strict=True)}
    run = model.simulate(1e-6, first, samples=2)
    p, R = run[scene.tool.position][0], run[scene.tool.rotation][0]
    found = model.branches({scene.tool.position: p, scene.tool.rotation: R})
    assert len(found) == 8
    for state in found:
        there = model.simulate(1e-6, {h.q: v for h, v in zip(scene.hinges, state.x, strict=False)}, samples=2)
        assert np.allclose(there[scene.tool.position][0], p, atol=1e-12)
        assert np.allclose(there[scene.tool.rotation][0], R, atol=1e-12)


BASE = np.array([(0, 0), (1.0, 0), (0.21, 0.65)])
PLATFORM = np.array([(0, 0), (1.2, 0), (0.04, 0.56)])


@pytest.mark.parametrize("legs", [(0.95, 1.13, 0.97), (0.6, 0.7, 0.65), (0.9, 0.9, 0.5), (1.2, 0.6, 0.8)])
def test_a_platform_on_three_legs_has_as_many_poses_as_its_polynomial_has_roots(legs):
    """Up to six. Differences of the three circles give the place linearly for a platform's angle; the first circle is left to scan."""
    angle = np.linspace(-np.pi, np.pi, 200_001)
    c, s = np.cos(angle), np.sin(angle)
    D = [np.array([c * x - s * y, s * x + c * y]) - a[:, None] for (x, y), a in zip(PLATFORM, BASE, strict=True)]
    (a, b), (d, e) = 2 * (D[1] - D[0]), 2 * (D[2] - D[0])
    f, g = (legs[k] ** 2 - legs[0] ** 2 - (D[k] ** 2).sum(0) + (D[0] ** 2).sum(0) for k in (1, 2))
    det = a * e - b * d
    left = (f * e - b * g + det * D[0][0]) ** 2 + (a * g - f * d + det * D[0][1]) ** 2 - legs[0] ** 2 * det**2
    roots = int(np.sum(left[:-1] * left[1:] < 0))
    scene = planar_platform(BASE, PLATFORM)
    model = ac.build(scene)
    start = {leg.q: length for leg, length in zip(scene.leg, legs, strict=True)}
    if roots:
        assert len(model.branches(start)) == roots
    else:
        with pytest.raises(errors.StartValueError, match=r"leg\[0\]\.q"):
            model.branches(start)


def test_a_slider_never_turns_round_on_its_rail():
    """Swinging block: its sliding joint closes the loop, and a block turned by 180 degrees would satisfy the same equations."""
    scene = ac.System()
    scene.world, scene.a, scene.b, scene.d, scene.rail = World(None), Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    scene.crank, scene.rod = RigidBody.rod(1.0, (0.4, 0, 0)), RigidBody.rod(1.0, (1.0, 0, 0))
    scene.block = RigidBody.box(1.0, (0.1, 0.1, 0.1))
    closed(
        scene,
        (scene.world.frame, scene.a, scene.crank.frame),
        (scene.crank.tip, scene.b, scene.block.frame),
        (scene.world.at((1.0, 0, 0)), scene.d, scene.rod.frame),
        (scene.rod.frame, scene.rail, scene.block.frame),
    )
    model = ac.build(scene)
    assert [cut.name for cut in model.system.mechanics.mechanism.cuts] == ["rail"]
    found = model.branches({scene.a.q: 0.7})
    length = np.hypot(0.4 * np.cos(0.7) - 1.0, 0.4 * np.sin(0.7))
    seen = model.functions.outputs.resolve
    look = ca.Function(
        "look", [model.system.x], [*map(seen, (scene.block.frame.rotation, scene.rod.frame.rotation, scene.rail.q))]
    )
    ends = [[np.array(value) for value in look(state.x)] for state in found]
    assert all(np.allclose(block, rod, atol=1e-12) for block, rod, _ in ends)
    assert np.allclose(sorted(float(slide[0, 0]) for *_, slide in ends), [-length, length], atol=1e-12)


def test_wrong_calls_for_branches_are_explained():
    scene = FourBar()
    model = ac.build(scene)
    with pytest.raises(errors.OptionError, match="searches is 0"):
        model.branches(searches=0)
    with pytest.raises(errors.OptionError, match="positions, not velocities"):
        model.branches(by=[scene.a.v])
    with pytest.raises(errors.OptionError, match=r"3.*is not a variable"):
        model.branches(by=[3])  # pyright: ignore[reportArgumentType]


# --- assembly as a function ---


def closed_form(w: ca.SX) -> ca.SX:
    """Place of the slider for crank, rod and crank angle."""
    r, rod, a = w[0], w[1], w[2]
    return r * ca.cos(a) + ca.sqrt(rod**2 - r**2 * ca.sin(a) ** 2)


def test_a_slider_crank_as_a_function_is_its_closed_form_with_both_derivatives():
    r, rod = ac.Parameter(1.0, "m"), ac.Parameter(2.5, "m")
    scene = slider_crank(r, rod)
    place = ac.build(scene).assembly_function(scene.rail.q, [r, rod, scene.a.q], {scene.a.q: 0.7})
    w, z = ca.SX.sym("w", 3), ca.MX.sym("z", 3)
    wanted = ca.Function("f", [w], [closed_form(w), *ca.hessian(closed_form(w), w)])
    found = ca.Function("f", [z], [place(z), *ca.hessian(place(z), z)])
    for at in ((1.0, 2.5, 0.7), (0.8, 2.0, 2.5), (1.0, 1.5, 5.0), (0.5, 3.0, -2.0)):
        for one, other in zip(found(at), wanted(at), strict=True):
            assert np.max(np.abs(np.array(one - other))) < 1e-12


def test_a_function_that_cannot_close_is_nan():
    """A rod of 0.5 m on a crank of 1 m at a right angle misses the slider."""
    rod = ac.Parameter(2.5, "m")
    scene = slider_crank(1.0, rod)
    place = ac.build(scene).assembly_function(scene.rail.q, [rod, scene.a.q], {scene.a.q: 0.7})
    assert np.isnan(float(place([0.5, 1.5])))
    assert np.isfinite(float(place([0.5, 0.1])))


def test_a_function_is_nan_where_constraints_that_were_redundant_part():
    """A planar four-bar with a hinge moved out of the plane: the kept constraints are still met, the others are not."""
    aside = ac.Parameter(0.0, "m")
    scene = ac.System()
    scene.world, scene.hinges = World(None), [Revolute("z") for _ in range(4)]
    scene.bars = [RigidBody.rod(1.0, (size, 0, 0)) for size in (0.4, 1.2, 0.8)]
    a, b, c = scene.bars
    h = scene.hinges
    closed(
        scene,
        (scene.world.frame, h[0], a.frame),
        (a.tip, h[1], b.frame),
        (b.tip, h[2], c.tip),
        (scene.world.at((1.0, 0, aside)), h[3], c.frame),
    )
    x = ac.build(scene).assembly_function(None, [aside, h[0].q], {h[0].q: 0.7})
    assert np.isfinite(np.array(x([0.0, 0.9]))).all()
    assert np.isnan(np.array(x([0.01, 0.7]))).all()


def test_a_function_does_not_follow_a_turn_of_more_than_a_radian_in_one_step():
    scene = slider_crank()
    model = ac.build(scene)
    one, eight = (model.assembly_function(scene.rail.q, scene.a.q, {scene.a.q: 0.7}, steps=steps) for steps in (1, 8))
    assert np.isnan(float(one(3.7)))
    assert np.isclose(float(eight(3.7)), np.cos(3.7) + np.sqrt(2.5**2 - np.sin(3.7) ** 2), atol=1e-12)


def test_a_function_keeps_the_branch_over_a_full_turn():
    """Open and crossed four-bar: after a turn of the crank in small steps each is where it began."""
    scene = FourBar(rotation(4))
    model = ac.build(scene)
    for state in model.branches({scene.a.q: 0.7}):
        start = {scene.a.q: 0.7, scene.d.q: ac.near(state.x[1]), scene.b.q: ac.near(state.x[2])}
        x = model.assembly_function(None, [scene.a.q], start, steps=24)
        assert np.allclose(np.array(x(0.7)).ravel(), state.x, atol=1e-12)
        tip = model.assembly_function(scene.coupler.tip.position, [scene.a.q], start, steps=24)
        assert np.allclose(np.array(tip(0.7 + 2 * np.pi)), np.array(tip(0.7)), atol=1e-12)
        assert np.linalg.norm(np.array(tip(0.7 + np.pi)) - np.array(tip(0.7))) > 0.1


def test_a_function_of_a_loop_with_redundant_constraints_has_the_derivatives_of_differences():
    """A four-bar in a skewed plane, three of its constraints redundant: positions and velocities, against central differences."""
    rocker = ac.Parameter(0.8, "m")
    R = rotation(2)
    scene = ac.System()
    scene.world, scene.hinges = World(None), [Revolute(tuple(R @ (0, 0, 1))) for _ in range(4)]
    scene.crank, scene.coupler = RigidBody.rod(1.0, tuple(R @ (0.4, 0, 0))), RigidBody.rod(1.0, tuple(R @ (1.2, 0, 0)))
    scene.rocker = RigidBody.rod(1.0, tuple(rocker * float(e) for e in R[:, 0]))
    closed(
        scene,
        (scene.world.frame, scene.hinges[0], scene.crank.frame),
        (scene.crank.tip, scene.hinges[1], scene.coupler.frame),
        (scene.coupler.tip, scene.hinges[2], scene.rocker.tip),
        (scene.world.at(tuple(R @ (1.0, 0, 0))), scene.hinges[3], scene.rocker.frame),
    )
    model = ac.build(scene)
    q, v = scene.hinges[0].q, scene.hinges[0].v
    start = {q: 0.4, v: 2.0}
    x = model.assembly_function(None, [rocker, q, v], start)
    z = ca.MX.sym("z", 3)
    slopes = ca.Function("J", [z], [ca.jacobian(x(z), z)])
    at = np.array([0.85, 0.9, 1.5])
    found = np.array(slopes(at))
    assert np.allclose(np.array(x(at)).ravel(), model.initial_state({q: 0.9, v: 1.5}, parameters={rocker: 0.85}).x, atol=1e-11)
    for k in range(3):
        h = 1e-5 * np.eye(3)[k]
        difference = (
            -np.array(x(at + 2 * h)) + 8 * np.array(x(at + h)) - 8 * np.array(x(at - h)) + np.array(x(at - 2 * h))
        ) / 12e-5
        assert np.max(np.abs(difference.ravel() - found[:, k])) < 1e-8


def test_lengths_of_a_four_bar_are_found_from_points_of_its_coupler_curve():
    """Path synthesis with ipopt and exact Hessians: eight points that a known four-bar passes through, crank angles not given."""
    sizes = [ac.Parameter(v, "m") for v in (0.4, 1.2, 0.8, 1.0, 0.6, 0.3)]
    a, b, c, d, e, f = sizes
    scene = ac.System()
    scene.world, scene.hinges = World(None), [Revolute("z") for _ in range(4)]
    scene.crank, scene.coupler, scene.rocker = (RigidBody.rod(1.0, (size, 0, 0)) for size in (a, b, c))
    closed(
        scene,
        (scene.world.frame, scene.hinges[0], scene.crank.frame),
        (scene.crank.tip, scene.hinges[1], scene.coupler.frame),
        (scene.coupler.tip, scene.hinges[2], scene.rocker.tip),
        (scene.world.at((d, 0, 0)), scene.hinges[3], scene.rocker.frame),
    )
    q = scene.hinges[0].q
    point = scene.coupler.at((e, f, 0)).position[:2]
    curve = ac.build(scene).assembly_function(point, [*sizes, q], {q: 0.5, scene.hinges[3].q: ac.near(1.2)})
    true, angles = np.array([0.45, 1.1, 0.9, 1.05, 0.5, 0.4]), 0.2 + np.arange(8) * np.pi / 4
    through = [np.array(curve([*true, angle])).ravel() for angle in angles]
    lengths, turns = ca.MX.sym("lengths", 6), ca.MX.sym("turns", 8)
    missed = ca.vertcat(*(curve(ca.vertcat(lengths, turns[k])) - through[k] for k in range(8)))
    problem = {"x": ca.vertcat(lengths, turns), "f": ca.sumsqr(missed)}
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-12}, "show_eval_warnings": False}
    solver = ca.nlpsol("synthesis", "ipopt", problem, options)
    found = solver(x0=[size.value for size in sizes] + list(angles + 0.1), lbx=[0.05] * 6 + [-np.inf] * 8)
    assert solver.stats()["success"] and solver.stats()["iter_count"] < 40
    assert float(found["f"]) < 1e-18
    assert np.allclose(np.array(found["x"]).ravel()[:6], true, atol=1e-7)


def test_a_function_changes_what_is_left_free_as_little_as_it_can():
    """An arm of three links with its tip given: its derivative is the pseudo-inverse of the tip's Jacobian."""
    scene = arm((1.0, 0.8, 0.5))
    tip = scene.links[-1].tip.position[:2]
    model = ac.build(scene)
    x = model.assembly_function(None, [tip], {tip: (1.2, 0.5)})
    z = ca.MX.sym("z", 2)
    slopes = np.array(ca.Function("J", [z], [ca.jacobian(x(z), z)])((1.2, 0.5)))[:3]
    sums = np.cumsum(np.array(x((1.2, 0.5))).ravel()[:3])
    steps = np.array((1.0, 0.8, 0.5)) * np.array([-np.sin(sums), np.cos(sums)])
    J = np.cumsum(steps[:, ::-1], axis=1)[:, ::-1]
    assert np.allclose(slopes, np.linalg.pinv(J), atol=1e-10)


def test_a_function_of_near_values_gives_what_the_search_gives():
    """A free platform told where to be: inputs, near values and positions of bodies as arguments."""
    scene = stewart_platform()
    model = ac.build(scene)
    p, R = scene.platform.frame.position, scene.platform.frame.rotation
    start = {p: ac.near((0.1, -0.1, 1.2)), R: turned(0.1, 0.2, -0.1)}
    lengths = ac.Expression(ca.vertcat(*(s.q.sx for s in scene.slide)), frozenset(s.q for s in scene.slide))
    legs = model.assembly_function(lengths, [p], start)
    feet = [np.array([np.cos(a), np.sin(a), 0]) for a in (np.deg2rad(120 * (k // 2) + (-1) ** k * 12) for k in range(6))]
    heads = [0.6 * np.array([np.cos(a), np.sin(a), 0]) for a in (np.deg2rad(120 * (k // 2) + (-1) ** k * 48) for k in range(6))]
    for at in ((0.1, -0.1, 1.2), (-0.2, 0.15, 1.4)):
        wanted = [np.linalg.norm(np.array(at) + turned(0.1, 0.2, -0.1) @ h - f) for f, h in zip(feet, heads, strict=True)]
        assert np.allclose(np.abs(np.array(legs(at)).ravel()), wanted, atol=1e-9)


def adjustable_four_bar(length: float) -> tuple[ac.Model, list[ac.Parameter], Revolute]:
    """A crank that turns fully, all four lengths adjustable, in units of `length`."""
    sizes = [ac.Parameter(v * length, "m") for v in (0.4, 1.2, 0.8, 1.0)]
    a, b, c, d = sizes
    scene = ac.System()
    scene.world, scene.hinges = World(None), [Revolute("z") for _ in range(4)]
    scene.crank, scene.coupler, scene.rocker = (RigidBody.rod(1.0, (size, 0, 0)) for size in (a, b, c))
    closed(
        scene,
        (scene.world.frame, scene.hinges[0], scene.crank.frame),
        (scene.crank.tip, scene.hinges[1], scene.coupler.frame),
        (scene.coupler.tip, scene.hinges[2], scene.rocker.tip),
        (scene.world.at((d, 0, 0)), scene.hinges[3], scene.rocker.frame),
    )
    return ac.build(scene), sizes, scene.hinges[0]


def test_a_function_reaches_values_that_are_far_away():
    """Lengths up to a fifth longer or shorter and the crank several turns away: rarely off the branch, and never where it cannot close."""
    model, sizes, crank = adjustable_four_bar(1.0)
    x = model.assembly_function(None, [*sizes, crank.q, crank.v], {crank.q: 0.5, crank.v: 1.0})
    rng = np.random.default_rng(0)
    missed = 0
    for _ in range(100):
        lengths, angle, speed = np.array([0.4, 1.2, 0.8, 1.0]) * rng.uniform(0.8, 1.2, 4), rng.uniform(-15, 15), rng.normal()
        far = np.hypot(lengths[3] - lengths[0] * np.cos(angle), lengths[0] * np.sin(angle))
        closes = abs(lengths[1] - lengths[2]) < far < lengths[1] + lengths[2]
        found = np.array(x([*lengths, angle, speed])).ravel()
        assert closes or np.isnan(found).all()
        missed += closes and np.isnan(found).any()
        if np.isfinite(found).all():
            p = dict(zip(sizes, lengths, strict=True))
            gap = model.functions.invariants(0, found, [], [p[size] for size in model.system.flat.parameters])
            assert np.max(np.abs(np.array(gap))) < 1e-13
    assert missed <= 10


@pytest.mark.parametrize("power", [-15, -3, 15])
def test_a_function_decides_alike_in_all_units_of_length(power):
    """Small lengths are not closed because they are small."""
    unit = 4.0**power
    (model, sizes, crank), (other, scaled, same) = adjustable_four_bar(1.0), adjustable_four_bar(unit)
    x = model.assembly_function(None, [*sizes, crank.q], {crank.q: 0.5, crank.v: 1.0})
    y = other.assembly_function(None, [*scaled, same.q], {same.q: 0.5, same.v: 1.0})
    rng = np.random.default_rng(1)
    for _ in range(50):
        lengths, angle = np.array([0.4, 1.2, 0.8, 1.0]) * rng.uniform(0.5, 1.5, 4), rng.uniform(-8, 8)
        one, two = (np.array(f([*(s * lengths), angle])).ravel() for f, s in ((x, 1.0), (y, unit)))
        assert np.array_equal(np.isnan(one), np.isnan(two))
        assert np.allclose(one, two, rtol=0, atol=1e-11, equal_nan=True)


def test_wrong_calls_for_functions_are_explained():
    scene = slider_crank()
    model = ac.build(scene)
    with pytest.raises(errors.OptionError, match="neither a parameter nor an input"):
        model.assembly_function(None, [scene.a.q])
    with pytest.raises(errors.OptionError, match="3 in wrt"):
        model.assembly_function(None, [3])  # pyright: ignore[reportArgumentType]
    with pytest.raises(errors.OptionError, match="wrt is empty"):
        model.assembly_function(None, [], {scene.a.q: 0.7})
    with pytest.raises(errors.OptionError, match="twice"):
        model.assembly_function(None, [scene.a.q, scene.a.q], {scene.a.q: 0.7})
    with pytest.raises(errors.OptionError, match="steps is 0"):
        model.assembly_function(None, [scene.a.q], {scene.a.q: 0.7}, steps=0)


def test_no_unknown_goes_farther_at_once_than_its_limit():
    """And what is left is told row by row, with units."""
    seen: list[np.ndarray] = []

    def rows(y):
        seen.append(y.copy())
        return np.array([y[0] - 10.0, y[0] * y[1] - 20.0]), np.array([[1.0, 0.0], [y[1], y[0]]])

    found = assemble(
        rows, np.ones(2), sizes=Sizes(np.ones(2), np.array([1.0, 4.0]), limit=np.array([0.5, np.inf])), stride=np.inf
    )
    assert found.converged
    assert np.allclose(found.y, (10.0, 2.0), rtol=0, atol=1e-12)
    assert np.max(np.abs(np.diff(seen, axis=0)[:, 0])) <= 0.5 * (1 + 1e-12)
    missed = assemble(
        lambda y: (np.array([y[0] ** 2 + 3.0, 0.0 * y[1]]), np.diag([2 * y[0], 0.0])),
        np.zeros(2),
        sizes=Sizes(np.ones(2), 2 * np.ones(2)),
    )
    assert not missed.converged
    assert missed.left.tolist() == [3.0, 0.0] == [missed.gap, 0.0]


def test_inputs_move_what_is_assembled_as_parameters_do():
    """A slider-crank whose crank an input lifts, beside a force that another input is, which was declared before."""
    scene, r = ac.System(), ac.Parameter(1.0, "m")
    scene.push, scene.lift = ac.Input("N"), ac.Input("m", default=0.1)
    scene.world, scene.base, scene.load = World(None), PrescribedMotion(position=(0, scene.lift, 0)), Force((scene.push, 0, 0))
    scene.a, scene.b, scene.c, scene.rail = Revolute("z"), Revolute("z"), Revolute("z"), Prismatic("x")
    scene.crank, scene.rod, scene.slider = (
        RigidBody.rod(1.0, (r, 0, 0)),
        RigidBody.rod(1.0, (2.5, 0, 0)),
        RigidBody.ball(1.0, 0.1),
    )
    closed(
        scene,
        (scene.world.frame, scene.base, scene.a.frame_a),
        (scene.crank.tip, scene.b, scene.rod.frame),
        (scene.rod.tip, scene.c, scene.slider.frame),
        (scene.world.frame, scene.rail, scene.slider.frame),
    )
    scene.connect(scene.a.frame_b, scene.crank.frame)
    scene.connect(scene.load.point, scene.slider.frame)
    start = {scene.a.q: 0.7, scene.rail.q: ac.near(3.0)}
    place = ac.build(scene).assembly_function(scene.rail.q, [scene.lift, r, scene.a.q], start)
    w, z = ca.SX.sym("w", 3), ca.MX.sym("z", 3)
    closed_place = w[1] * ca.cos(w[2]) + ca.sqrt(2.5**2 - (w[1] * ca.sin(w[2]) + w[0]) ** 2)
    wanted = ca.Function("f", [w], [closed_place, *ca.hessian(closed_place, w)])
    found = ca.Function("f", [z], [place(z), *ca.hessian(place(z), z)])
    for at in ((0.1, 1.0, 0.7), (0.3, 0.8, 2.0), (-0.4, 1.2, -1.0)):
        for one, other in zip(found(at), wanted(at), strict=True):
            assert np.max(np.abs(np.array(one - other))) < 1e-12


@pytest.mark.parametrize("name", ["spring_pendulum", "slider_crank", "screw_press"])
def test_units_of_velocities_move_what_moves_most_by_its_own_unit_in_a_second(name):
    for length in (1.0, 4.0**-5):
        similar = SIMILAR[name](Units(length=length))
        model = ac.build(similar.scene)
        start = model.initial_state(similar.start)
        units, rates = start_units(start)
        for k, rate in enumerate(rates):
            x = np.array(start.x)
            x[units.size :] = rate * (np.arange(rates.size) == k)
            moved = np.array(model.functions.explicit_dynamics(0, x, [], start.p)).ravel()[: units.size]
            assert np.max(np.abs(moved) / units) == pytest.approx(1.0, rel=1e-12), (length, k)


def test_all_at_once_angles_are_followed_by_less_than_a_radian():
    scene = FourBar()
    model, begin = ac.build(scene), 0.3
    at_once, in_steps = (model.assembly_function(None, [scene.a.q], {scene.a.q: begin}, steps=steps) for steps in (1, 30))
    angles = np.array([[*in_steps(a).full()[:3, 0]] for a in (begin, *begin + np.linspace(-1.5, 1.5, 12))])
    for q in angles[1:]:
        found = at_once(q[0]).full()[:3, 0]
        if np.max(np.abs(q - angles[0])) < 1.0:
            assert found == pytest.approx(q, abs=1e-12)
        else:
            assert np.isnan(found).all()


@pytest.mark.parametrize("weight", [1.0, 9.0])
def test_wishes_that_contradict_one_another_are_met_as_the_start_met_them_by_their_weights(weight):
    scene = FourBar()
    model, start = ac.build(scene), {scene.a.q: ac.near(0.3, 1.0), scene.b.q: ac.near(0.9, weight)}
    met = model.initial_state(start).x
    found = model.assembly_function(None, [scene.a.q, scene.b.q], start)([0.3, 0.9]).full().ravel()
    assert abs(met[0] - 0.3) > 0.1
    assert found == pytest.approx(met, abs=1e-8)
