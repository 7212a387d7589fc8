"""Places, angles and angular velocities that inputs prescribe: the same motion as by functions of time, whatever the course is given as."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import acausal as ac
from acausal import errors
from acausal.collocation.problem import StatusKind
from acausal.errors import ParameterError
from components import (
    AngleSource,
    Inertia,
    PositionSource,
    PrescribedAngularVelocity,
    PrescribedMotion,
    Prismatic,
    Revolute,
    RigidBody,
    SlidingMass,
    Spherical,
    TranslationalGround,
    TranslationalSpring,
    World,
)
from tests.exported import INPUT, OPEN_START, PARAMETER, STATE, SUCCESS, Library
from tests.pairings import each_value

SIZES = [1e-3, 1.0, 1e3]
UP = (0.0, 0.0, -9.81)


def led(kind: Any, given: Any) -> tuple[Any, ac.Model]:
    """A rod on a hinge or a slide whose coordinate is given."""
    scene: Any = ac.System()
    scene.course = given
    scene.world, scene.joint, scene.rod = (
        World(UP),
        Revolute("y") if kind is AngleSource else Prismatic("z"),
        RigidBody.rod(2.0, (0, 0, -1)),
    )
    scene.source = kind(given)
    scene.connect(scene.world.frame, scene.joint.frame_a)
    scene.connect(scene.joint.frame_b, scene.rod.frame)
    scene.connect(scene.joint.flange, scene.source.flange)
    return scene, ac.build(scene)


TIMES = np.linspace(0.0, 3.0, 301)
COURSES: dict[str, Any] = {
    "expression": 0.3 * np.sin(2 * ac.time) + 0.1,
    "function": lambda t: 0.3 * np.sin(2 * t) + 0.1,
    "with rates": (lambda t: 0.3 * np.sin(2 * float(t)) + 0.1, lambda t: 0.6 * np.cos(2 * float(t)), lambda t: -1.2 * np.sin(2 * float(t))),
    "spline": CubicSpline(TIMES, 0.3 * np.sin(2 * TIMES) + 0.1),
    "samples": ac.samples(TIMES, 0.3 * np.sin(2 * TIMES) + 0.1, "cubic"),
}  # fmt: skip


@each_value(("kind", [AngleSource, PositionSource]), ("form", list(COURSES)))
def test_a_course_moves_a_joint_alike_in_each_form(kind: Any, form: str) -> None:
    given = ac.Input("rad" if kind is AngleSource else "m")
    scene, model = led(kind, given)
    run = model.simulate(3.0, inputs={given: COURSES[form]}, rtol=1e-11)
    angle = 0.3 * np.sin(2 * run.t) + 0.1
    rate, second = 0.6 * np.cos(2 * run.t), -1.2 * np.sin(2 * run.t)
    effort = 2.0 / 3 * second + 9.81 * np.sin(angle) if kind is AngleSource else 2.0 * (second + 9.81)
    exact = form in ("expression", "function", "with rates")
    for found, wanted, spline in (
        (run[scene.joint.q], angle, 1e-9),
        (run[scene.joint.v], rate, 1e-6),
        (-run[scene.source.flange.tau if kind is AngleSource else scene.source.flange.f], effort, 1e-3),
    ):
        assert np.max(np.abs(found - wanted)) < (1e-11 if exact else spline)
    assert run.energy_error() < 1e-11


def test_a_held_input_rests_and_a_shaft_without_joints_follows() -> None:
    held = ac.Input("rad")
    scene, model = led(AngleSource, held)
    for angle in (0.7, 0.0, -3.0):
        run = model.simulate(100.0, inputs={held: angle})
        assert np.max(np.abs(run[scene.joint.q] - angle)) < 1e-11
    shaft: Any = ac.System()
    shaft.angle = ac.Input("rad")
    shaft.source, shaft.rotor = AngleSource(shaft.angle), Inertia(0.5)
    shaft.connect(shaft.source.flange, shaft.rotor.flange_a)
    run = ac.build(shaft).simulate(2.0, inputs={shaft.angle: lambda t: np.sin(3 * t)})
    assert np.max(np.abs(run[shaft.source.flange.tau] - 4.5 * np.sin(3 * run.t))) < 1e-14


def four_bar(drive: Any, size: float) -> Any:
    scene: Any = ac.System()
    scene.drive = drive
    ends = [size * np.array(p) for p in ((0.3, 0, 0), (0.8, 0, 0.9), (0.1, 0, -0.9))]
    at = [np.zeros(3), ends[0], ends[0] + ends[1], ends[0] + ends[1] + ends[2]]
    scene.world = World(UP)
    scene.bars = [RigidBody.rod(1.0, tuple(end), position=tuple(p)) for end, p in zip(ends, at, strict=False)]
    parts = [scene.world, *scene.bars, scene.world]
    scene.hinges = [Revolute.between(a, b, at=tuple(p), axis="y") for a, b, p in zip(parts, parts[1:], at, strict=False)]
    scene.source = AngleSource(drive)
    scene.connect(scene.source.flange, scene.hinges[0].flange)
    return scene


def turn(t: Any) -> Any:
    return 2 * t + 0.3 * np.sin(3 * t)


@pytest.mark.parametrize("size", SIZES)
def test_a_crank_of_a_loop_turns_by_an_input_as_by_a_function_of_time(size: float) -> None:
    one, other = four_bar(ac.Input("rad"), size), four_bar(turn, size)
    runs = ac.build(one).simulate(5.0, inputs={one.drive: turn}, rtol=1e-11), ac.build(other).simulate(5.0, rtol=1e-11)
    for k in range(3):
        assert abs(runs[0][one.hinges[k].q][-1] - runs[1][other.hinges[k].q][-1]) < 1e-10
    a, b = (run[scene.source.flange.tau] for run, scene in zip(runs, (one, other), strict=True))
    assert np.max(np.abs(a - b)) < 1e-8 * np.max(np.abs(b))
    assert runs[0].energy_error() < 1e-10


def test_independent_coordinates_follow_an_input_too() -> None:
    scene = four_bar(ac.Input("rad"), 1.0)
    model = ac.build(scene)
    assert "rheonomic" in str(model.constraints())
    run = model.minimal().simulate(3.0, inputs={scene.drive: lambda t: 1 + turn(t)}, rtol=1e-10)
    assert np.max(np.abs(run[scene.hinges[0].q] - 1 - turn(run.t))) < 1e-9


Motion = Callable[[Any], tuple[Any, ...]]


def hand(part: Callable[..., Any], size: float, course: Motion | None) -> tuple[Any, ac.Trajectory]:
    """A body on a ball joint that a frame carries, which moves by inputs where there is a course."""
    scene: Any = ac.System()
    scene.x, scene.y, scene.turn = given = ac.Input(""), ac.Input(""), ac.Input("")
    scene.world, scene.hand = World((0, 0, -9.81 * size)), part(*given)
    scene.ball, scene.rod = (
        Spherical(),
        RigidBody(2.0, np.diag([0.02, 0.03, 0.01]) * size**2, (0.1 * size, 0.2 * size, -0.5 * size)),
    )
    scene.connect(scene.world.frame, scene.hand.frame_a)
    scene.connect(scene.hand.frame_b, scene.ball.frame_a)
    scene.connect(scene.ball.frame_b, scene.rod.frame)
    inputs = {u: (lambda t, k=k: course(t)[k]) for k, u in enumerate(given)} if course else {}
    return scene, ac.build(scene).simulate(3.0, {scene.ball.v: (1, 2, 3)}, inputs=inputs, rtol=1e-11)


@pytest.mark.parametrize("size", SIZES)
def test_a_frame_moves_in_space_by_inputs_as_by_functions_of_time(size: float) -> None:
    def course(t: Any) -> tuple[Any, ...]:
        return 0.3 * size * np.sin(2 * t), 0.1 * size * t**2, 0.5 * np.sin(t)

    def function(*_: Any) -> PrescribedMotion:
        return PrescribedMotion(lambda t: (*course(t)[:2], 0.2 * size), lambda t: course(t)[2], (1, 1, 0))

    one, by_inputs = hand(lambda x, y, turn: PrescribedMotion((x, y, 0.2 * size), turn, (1, 1, 0)), size, course)
    other, by_time = hand(function, size, None)
    assert np.max(np.abs(by_inputs[one.rod.frame.rotation] - by_time[other.rod.frame.rotation])) < 1e-9
    assert np.max(np.abs(by_inputs[one.rod.frame.velocity] - by_time[other.rod.frame.velocity])) < 1e-9 * size
    forces = [run[scene.hand.frame_b.force] for run, scene in ((by_inputs, one), (by_time, other))]
    assert np.max(np.abs(forces[0] - forces[1])) < 1e-8 * np.max(np.abs(forces[1]))
    assert by_inputs.energy_error() < 1e-10


def test_orientations_and_angular_velocities_by_inputs_agree() -> None:
    """Turned about one axis, an angle and its rate say the same."""
    one, by_angle = hand(
        lambda x, y, turn: PrescribedMotion(rotation=("rotation vector", (x, 0.0, 0.0))), 1.0, lambda t: (np.sin(t), 0 * t, 0 * t)
    )
    other, by_rate = hand(
        lambda x, y, turn: PrescribedAngularVelocity((turn, 0.0, 0.0)), 1.0, lambda t: (0 * t, 0 * t, np.cos(t))
    )
    assert np.max(np.abs(by_angle[one.rod.frame.rotation] - by_rate[other.rod.frame.rotation])) < 1e-9


def carried(size: float, turned_round: bool = False) -> Any:
    """Two rods from the origin to what an input carries along x."""
    scene: Any = ac.System()
    scene.x = ac.Input("m", default=1.2 * size)
    scene.world, scene.carried, scene.hinges = World(UP), PrescribedMotion((scene.x, 0, 0)), [Revolute("y") for _ in range(3)]
    scene.rods = [RigidBody.rod(1.0, (size, 0, 0)), RigidBody.rod(2.0, (0.5 * size, 0, 0))]
    a, b, c = scene.hinges
    chain = [scene.world.frame, a.frame_a, a.frame_b, scene.rods[0].frame, scene.rods[0].tip]
    chain += [b.frame_a, b.frame_b, scene.rods[1].frame, scene.rods[1].tip]
    chain += [c.frame_a, c.frame_b, scene.carried.frame_b, scene.carried.frame_a, scene.world.frame]
    pairs = list(zip(chain[::2], chain[1::2], strict=True))
    for one, other in reversed(pairs) if turned_round else pairs:
        scene.connect(one, other)
    return scene


@each_value(("size", SIZES), ("turned_round", [False, True]))
def test_a_carried_end_of_a_loop_meets_its_closed_form(size: float, turned_round: bool) -> None:
    scene = carried(size, turned_round)
    a = scene.hinges[0]
    run = ac.build(scene).simulate(
        2.0, {a.q: ac.near(-0.7)}, inputs={scene.x: lambda t: size * (1.2 + 0.2 * np.sin(3 * t))}, rtol=1e-11
    )
    s = 1.2 + 0.2 * np.sin(3 * run.t)
    assert np.max(np.abs(np.abs(run[a.q]) - np.arccos((s**2 + 1.0 - 0.5**2) / (2 * s)))) < 1e-10
    assert run.energy_error() < 1e-10


MECHANISMS: dict[str, Callable[[float], Any]] = {
    "hinge": lambda size: led(AngleSource, ac.Input("rad"))[0],
    "slide": lambda size: led(PositionSource, ac.Input("m"))[0],
    "four-bar": lambda size: four_bar(ac.Input("rad"), size),
    "carried": carried,
}
"""Of a size, where they have one; the first input and its rates prescribe their motion."""


def unit_of(kind: str, size: float) -> float:
    """Of the place or angle that is prescribed."""
    return 0.1 * size if kind == "carried" else 1.0


def placed(kind: str, size: float, state: dict[str, float]) -> tuple[float, float, float, float]:
    """What is prescribed, by the states: itself and its rate; how far the loop is open, and on which branch it is closed."""
    if kind == "carried":
        first, second = state["hinges[0].q"], state["hinges[0].q"] + state["hinges[1].q"]
        x = size * (np.cos(first) + 0.5 * np.cos(second))
        rates = state["hinges[0].v"], state["hinges[0].v"] + state["hinges[1].v"]
        rate = -size * (np.sin(first) * rates[0] + 0.5 * np.sin(second) * rates[1])
        return x, rate, size * (np.sin(first) + 0.5 * np.sin(second)), np.sign(np.sin(second - first))
    if kind != "four-bar":
        return state["joint.q"], state["joint.v"], 0.0, 1.0
    ends = size * np.array([(0.3, 0.0), (0.8, 0.9), (0.1, -0.9)])
    angles = state["hinges[0].q"], state["hinges[0].q"] + state["hinges[1].q"], -state["hinges[3].q"]
    bars = [
        np.array([np.cos(q) * end[0] + np.sin(q) * end[1], -np.sin(q) * end[0] + np.cos(q) * end[1]])
        for q, end in zip(angles, ends, strict=True)
    ]
    gap = np.linalg.norm(np.sum(bars, axis=0) - [1.2 * size, 0])
    return state["hinges[0].q"], state["hinges[0].v"], float(gap), np.sign(bars[1][0] * bars[2][1] - bars[1][1] * bars[2][0])


@pytest.mark.parametrize("kind", MECHANISMS)
@pytest.mark.parametrize("size", SIZES)
def test_places_do_not_drift_however_coarse_the_steps_are(kind: str, size: float) -> None:
    scene, unit = MECHANISMS[kind](size), unit_of(kind, size)
    model = ac.build(scene)
    (own,) = (entry for entry in (getattr(scene, name, None) for name in ("course", "drive", "x")) if entry is not None)
    given = own.default + unit * np.sin(3 * ac.time) * (1 - np.exp(-ac.time))
    run = model.simulate(100.0, inputs={own: given}, rtol=1e-3, samples=500)
    wanted = own.default + unit * np.sin(3 * run.t) * (1 - np.exp(-run.t))
    rate = unit * (3 * np.cos(3 * run.t) * (1 - np.exp(-run.t)) + np.sin(3 * run.t) * np.exp(-run.t))
    x, v, gap, branch = (
        np.array(part)
        for part in zip(*(placed(kind, size, dict(zip(model.state_names, x, strict=True))) for x in run.x.T), strict=True)
    )
    assert np.max(np.abs(x - wanted)) < 1e-13 * (own.default + unit)
    assert np.max(np.abs(v - rate)) < 1e-12 * unit and np.max(np.abs(gap)) < 1e-12 * size and np.ptp(branch) == 0


@pytest.mark.parametrize("kind", MECHANISMS)
@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_exported_motions_are_where_inputs_are_set_and_go_on_with_their_rates(kind: str, size: float, tmp_path: Path) -> None:
    """By Taylor's polynomial between the times at which they are set; however far places jump, loops stay closed on their branch, or it is said that they cannot."""
    scene, unit = MECHANISMS[kind](size), unit_of(kind, size)
    model = ac.build(scene)
    library = Library(model.export_simulator(tmp_path / "set", {scene.hinges[0].q: ac.near(-0.7)} if kind == "carried" else None))
    instance, t, rng = library.instance(), 0.0, np.random.default_rng(0)
    assert instance.started() == SUCCESS
    branch = placed(kind, size, dict(zip(model.state_names, instance.x, strict=True)))[-1]
    start = instance.get(INPUT, 0)
    for k in range(6):
        given = start + unit * rng.uniform(-1, 1) * (1 if k % 2 else 0.01), unit * rng.normal(), unit * rng.normal()
        for i, value in enumerate(given):
            assert instance.set(INPUT, i, value) == SUCCESS
        for later in (0.0, 0.03, 0.1):
            instance = instance.copied() if later else instance
            assert instance.advance(t + later) == SUCCESS, instance.words()
            x, v, gap, side = placed(kind, size, dict(zip(model.state_names, instance.x, strict=True)))
            assert x == pytest.approx(given[0] + later * given[1] + later**2 / 2 * given[2], abs=1e-13 * (start + unit))
            assert v == pytest.approx(given[1] + later * given[2], abs=1e-12 * unit)
            assert abs(gap) < 1e-12 * size and side == branch
            assert instance.get(INPUT, 0) == pytest.approx(x, abs=1e-13 * (start + unit))
        t += 0.1
    before = instance.x[0]
    assert instance.set(STATE, 0, before + 0.1) == SUCCESS and instance.advance(t + 0.1) == OPEN_START
    if kind == "carried":
        assert instance.started() == SUCCESS and instance.set(INPUT, 0, 1.51 * size) == SUCCESS
        assert instance.advance(0.1) == OPEN_START and "inputs that prescribe places" in instance.words()


JOINTS = np.array([(0, 0, 0), (0.3, 0, 0.4), (0.5, 0, 1.1), (0.7, 0, 0.4), (1, 0, 0)])


def five_bars(*sizes: float) -> Any:
    """Linkages of five bars in one scene, both cranks of each led by inputs from where it is drawn."""
    scene: Any = ac.System()
    scene.world, scene.mass = World(UP), ac.Parameter(1.0, "kg")
    scene.courses = [[ac.Input("rad"), ac.Input("rad")] for _ in sizes]
    scene.linkages = [ac.System() for _ in sizes]
    for linkage, size, courses in zip(scene.linkages, sizes, scene.courses, strict=True):
        at = size * JOINTS
        linkage.bars = [RigidBody.rod(scene.mass * 1.0, tuple(b - a), position=tuple(a)) for a, b in itertools.pairwise(at)]
        parts = [scene.world, *linkage.bars, scene.world]
        linkage.hinges = [Revolute.between(a, b, at=tuple(p), axis="y") for a, b, p in zip(parts, parts[1:], at, strict=False)]
        linkage.drives = [AngleSource(course) for course in courses]
        linkage.connect(linkage.drives[0].flange, linkage.hinges[0].flange)
        linkage.connect(linkage.drives[1].flange, linkage.hinges[4].flange)
    return scene


def reach(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of unit size: the end of the first crank, and from there to that of the other, turned by angles about y from where they are drawn, one and minus the other."""
    cos, sin = np.cos(angles), np.sin(angles * [1, -1])
    ways = (JOINTS[[1, 3]] - JOINTS[[0, 4]])[:, ::2]
    ends = JOINTS[[0, 4]][:, ::2] + np.stack([cos * ways[:, 0] + sin * ways[:, 1], cos * ways[:, 1] - sin * ways[:, 0]], axis=1)
    return ends[0], ends[1] - ends[0]


def knee(angles: np.ndarray) -> np.ndarray:
    """Where the two equal links between the cranks meet."""
    end, way = reach(angles)
    return end + way / 2 + np.sqrt(0.53 / (way @ way) - 0.25) * np.array([-way[1], way[0]])


@pytest.mark.parametrize("sizes", [(1.0,), (1e-3, 1.0), (1e3, 1.0), (1.0, 1e-3, 1e3)])
def test_what_is_led_rests_where_inputs_do_beside_what_they_move(sizes: tuple[float, ...]) -> None:
    """At rest with all states zero nothing is torn, whatever rounding of loads makes of them."""
    scene = five_bars(*sizes)
    model, courses = ac.build(scene), itertools.chain(*scene.courses[1:])
    moved: dict[Any, Any] = {course: lambda t, k=k: 0.3 * np.sin((1 + k) * t) for k, course in enumerate(courses)}
    run = model.simulate(0.5, inputs=moved)
    for size, courses, linkage in zip(sizes, scene.courses, scene.linkages, strict=True):
        places = run[linkage.hinges[2].frame_a.position][:, ::2] / size
        for t, place in zip(run.t, places, strict=True):
            assert place == pytest.approx(knee(np.array([moved.get(course, lambda _: 0.0)(t) for course in courses])), abs=1e-12)


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_what_is_led_out_of_reach_ends_there_wherever_steps_land(size: float) -> None:
    scene = five_bars(size)
    model, stretched = ac.build(scene), brentq(lambda t: np.linalg.norm(reach(np.array([-t, -t]))[1]) - 2 * np.sqrt(0.53), 0, 1.5)
    for rtol, speed in itertools.product(np.geomspace(1e-4, 1e-11, 15), (1.0, 1.3)):
        turned = (lambda t, v=speed: -v * t, lambda t, v=speed: -v, lambda t: 0.0)
        run = model.simulate(1.5, inputs=dict.fromkeys(scene.courses[0], turned), rtol=rtol, raise_on_failure=False)
        assert run.status.kind is not StatusKind.SUCCESS and speed * run.t[-1] == pytest.approx(stretched, abs=1e-2)


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_in_whatever_order_numbers_are_set_the_motion_goes_on_alike(size: float, tmp_path: Path) -> None:
    """Two cranks of a linkage of five bars jump and go on, one mass changes: the same bits, and the angles that were set."""
    scene: Any = five_bars(size)
    library, rng = Library(ac.build(scene).export_simulator(tmp_path / "set")), np.random.default_rng(0)
    names = library.names(INPUT)
    rates = [names.index(f"der(linkages[0].drives[{k}].angle)") for k in (0, 1)]
    for _ in range(4):
        angles, seen = rng.uniform(-0.4, 0.4, 2), set[bytes]()
        sets = [(PARAMETER, 0, 1.5), (INPUT, 0, angles[0]), (INPUT, 1, angles[1]), (INPUT, rates[0], 0.3), (INPUT, rates[1], 0.2)]
        for _ in range(6):
            instance = library.instance()
            assert instance.started() == SUCCESS
            for one in rng.permutation(len(sets)):
                assert instance.set(*sets[one]) == SUCCESS
            assert instance.advance(0.01) == SUCCESS
            assert instance.x[:2] == pytest.approx(angles + 0.01 * np.array([0.3, 0.2]), abs=1e-13)
            seen.add(instance.x.tobytes())
        assert len(seen) == 1


@pytest.mark.parametrize("size", SIZES)
def test_what_hangs_from_a_place_that_jumps_turns_as_by_a_blow(size: float, tmp_path: Path) -> None:
    """A rod's end that is moved in no time: the rod turns about its centre of percussion, two thirds down."""
    scene: Any = ac.System()
    scene.u = ac.Input("m")
    scene.world, scene.slide, scene.cart, scene.hinge = (
        World(UP),
        Prismatic("x"),
        RigidBody(1.0, np.zeros((3, 3)), (0, 0, 0)),
        Revolute("y"),
    )
    scene.rod, scene.source = RigidBody.rod(2.0, (0, 0, -size)), PositionSource(scene.u)
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.cart.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    scene.connect(scene.source.flange, scene.slide.flange)
    model = ac.build(scene)
    instance = Library(model.export_simulator(tmp_path / "set")).instance()
    assert instance.started() == SUCCESS and instance.advance(0.5) == SUCCESS
    assert instance.set(INPUT, 0, 1e-3 * size) == instance.set(INPUT, 1, 0.2 * size) == SUCCESS
    found = dict(zip(model.state_names, instance.x, strict=True))
    assert found["slide.q"] == pytest.approx(1e-3 * size, rel=1e-12) and found["slide.v"] == pytest.approx(0.2 * size, rel=1e-12)
    assert found["hinge.q"] == pytest.approx(1.5e-3, rel=1e-5) and found["hinge.v"] == pytest.approx(0.3, rel=1e-5)


@pytest.mark.parametrize("kind", MECHANISMS)
def test_steps_lead_to_where_inputs_with_rates_go(kind: str) -> None:
    scene, unit = MECHANISMS[kind](1.0), unit_of(kind, 1.0)
    model = ac.build(scene)
    x = model.initial_state({scene.hinges[0].q: ac.near(-0.7)} if kind == "carried" else {}).x
    own = 1.2 if kind == "carried" else 0.0
    step, h = model.step("gauss", 4, 0.05), 0.05
    given = np.array([own, 0.3 * unit, -0.7 * unit])
    for _ in range(3):
        x, left = (np.array(part).ravel() for part in step(0, x, given, []))
        given = given + h * np.array([given[1] + h / 2 * given[2], given[2], 0.0])
        place, rate, gap, _ = placed(kind, 1.0, dict(zip(model.state_names, x, strict=True)))
        assert left[0] < 1e-9 and abs(gap) < 1e-9
        assert place == pytest.approx(given[0], abs=1e-9) and rate == pytest.approx(given[1], abs=1e-9)


def test_samples_may_end_where_the_run_does_and_not_bend_within() -> None:
    given = ac.Input("rad")
    _, model = led(AngleSource, given)
    model.simulate(3.0, inputs={given: COURSES["samples"]})
    with pytest.raises(ParameterError, match="bend at t = 3 s"):
        model.simulate(4.0, inputs={given: COURSES["samples"]})
    wave = CubicSpline([0, 1, 2, 3], [0, 1, 0.2, 0], bc_type="periodic", extrapolate="periodic")
    run = model.simulate(10.0, inputs={given: wave}, rtol=1e-11)
    assert np.max(np.abs(run[model.system.flat.named("joint.q")] - wave(run.t))) < 1e-10
    saw = CubicSpline([0, 1, 2, 3], [0, 1, 0.2, 0], extrapolate="periodic")
    with pytest.raises(ParameterError, match="bend at t = 3 s"):
        model.simulate(10.0, t0=1.5, inputs={given: saw})


@pytest.mark.parametrize("part", [lambda u: PrescribedMotion((u, 0, 0)), lambda u: PrescribedAngularVelocity((u, 0, 0))])
def test_what_inputs_prescribe_stands_among_the_constraints(part: Callable[[Any], Any]) -> None:
    scene: Any = ac.System()
    scene.course = ac.Input("")
    scene.world, scene.hand, scene.hinge, scene.rod = World(UP), part(scene.course), Revolute("y"), RigidBody.rod(1.0, (0, 0, -1))
    chain = [scene.world.frame, scene.hand.frame_a, scene.hand.frame_b, scene.hinge.frame_a, scene.hinge.frame_b, scene.rod.frame]
    for a, b in zip(chain[::2], chain[1::2], strict=True):
        scene.connect(a, b)
    table = ac.build(scene).constraints()
    assert [entry.kind for entry in table.entries if "follows" in entry.name][:1] == ["rheonomic"]
    assert table.velocity_freedom == 1


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_what_an_input_brings_in_is_known_with_its_rate_and_not_told_without(size: float) -> None:
    """A place by an input, a spring, a mass: with a mass at the place, too, its rate is an input, and is read; else nothing needs it, and any course will do."""
    length, exact = 0.02 * size, 0.02 * size * np.array([3.0, 3 * np.cos(3 * 5.0)])
    for carries in (True, False):
        scene = ac.System()
        scene.u, scene.spring, scene.load = ac.Input("m"), TranslationalSpring(1000.0), SlidingMass(10.0)
        scene.source, scene.carrier = PositionSource(scene.u), SlidingMass(2.0)
        scene.connect(scene.source.flange, scene.spring.flange_a, *([scene.carrier.flange_a] if carries else []))
        if not carries:
            scene.hold = TranslationalGround()
            scene.connect(scene.hold.flange, scene.carrier.flange_a)
        scene.connect(scene.spring.flange_b, scene.load.flange_a)
        run = ac.build(scene).simulate(5.0, inputs={scene.u: length * np.sin(3 * ac.time)}, rtol=1e-10)  # warnings are errors
        if carries:
            assert run.energy_error() < 1e-9
            assert run[ac.der(scene.source.flange.s)][[0, -1]] == pytest.approx(exact)
        else:
            assert np.isnan(run.energy_error())
            with pytest.raises(errors.ExpressionError, match="rate of the input u, which is not known"):
                run[ac.der(scene.source.flange.s)]
