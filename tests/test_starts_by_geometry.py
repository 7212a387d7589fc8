"""Starts are chosen by geometry: order and names of declaration decide nothing, and of branches that close the nearest to the sketch is taken."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize

import acausal as ac
from acausal import errors
from acausal.numerics.assembly import assemble
from acausal.start import start_search
from acausal.start.block_search import solve_block
from components import (
    Cable,
    Contact,
    Diode,
    ParametricCurve,
    Particle,
    Planar,
    PointOnCurve,
    Prismatic,
    Resistor,
    Revolute,
    RigidBody,
    Rod,
    Sphere,
    Spherical,
    Spring,
    Universal,
    VoltageSource,
    World,
)
from tests.assembly_scenes import closed, five_bar, rssr, slider_crank, stewart_platform, two_rods_to_a_driven_pivot
from tests.pairings import each_value
from tests.scenes import FourBar, bennett_linkage
from tests.test_electrical import series
from tests.test_singular_loops import FourBars

NAMES = ("a10", "a2", "ä", "Z", "z9", "b_1", "x", "part", "Ω", "a1", "q", "B", "k03", "k3", "é2", "m", "n12", "n4", "w", "yy")
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Linkage:
    """Bars [m] from their hinge to their tip, drawn at (x, y, angle); joints and springs between points of bars, -1 is the ground."""

    bars: tuple[tuple[float, Point], ...]
    joints: tuple[tuple[Callable[[], Any], int, Point, int, Point], ...]


def turned(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def hinge() -> Revolute:
    return Revolute("z")


def spring() -> Spring:
    return Spring(30.0, 0.2)


def linkage(kind: str, rng: np.random.Generator, rough: float) -> Linkage:
    """A sketch with errors of about `rough` in places and angles."""

    def bar(length: float, x: float, y: float, angle: float) -> tuple[float, Point]:
        e = rough * rng.normal(size=3)
        return length, (x + length * e[0], y + length * e[1], angle + e[2])

    tip = lambda length: (length, 0.0, 0.0)  # noqa: E731
    none = (0.0, 0.0, 0.0)
    if kind == "parallelogram":  # nothing but places tells its sides apart
        bars = (bar(0.5, 0, 0, 0.8), bar(1.0, 0.35, 0.36, 0.0), bar(0.5, 1, 0, 0.8))
        joints = [(hinge, -1, none, 0, none), (hinge, 0, tip(0.5), 1, none), (hinge, 1, tip(1.0), 2, tip(0.5))]
        joints += [(hinge, -1, (1.0, 0.0, 0.0), 2, none)]
    elif kind == "four-bar with springs":
        bars = (bar(0.4, 0, 0, 0.9), bar(1.2, 0.25, 0.3, 0.4), bar(0.8, 1, 0, 1.2))
        joints = [(hinge, -1, none, 0, none), (hinge, 0, tip(0.4), 1, none), (hinge, 1, tip(1.2), 2, tip(0.8))]
        joints += [(hinge, -1, (1.0, 0.0, 0.0), 2, none)]
        joints += [(spring, -1, (0.3 * k, 1.0, 0.0), 1, (0.4 * k, 0.1, 0.0)) for k in range(3)]
    elif kind == "three equal legs":
        bars, joints = [bar(0.3, 0, 0, 0)], []
        for k in range(3):
            a = 2 * np.pi * k / 3
            bars += [bar(0.6, np.cos(a), np.sin(a), a + 2.5), bar(0.5, 0.5 * np.cos(a), 0.5 * np.sin(a), a + 3.3)]
            foot, head = (float(np.cos(a)), float(np.sin(a)), 0.0), (0.3 * float(np.cos(a)), 0.3 * float(np.sin(a)), 0.0)
            joints += [(hinge, -1, foot, 1 + 2 * k, none), (hinge, 1 + 2 * k, tip(0.6), 2 + 2 * k, none)]
            joints += [(hinge, 2 + 2 * k, tip(0.5), 0, head)]
    else:  # a slider-crank with a second rod, of the same length
        bars = (
            bar(0.4, 0, 0, 0.6),
            bar(1.0, 0.3, 0.2, -0.2),
            bar(0.1, 1.2, 0, 0),
            bar(1.0, 0.3, 0.2, -0.5),
            bar(0.1, 0.2, -0.7, 0),
        )
        joints = [(hinge, -1, none, 0, none), (hinge, 0, tip(0.4), 1, none), (hinge, 1, tip(1.0), 2, none)]
        joints += [(lambda: Prismatic("x"), -1, none, 2, none), (hinge, 0, tip(0.4), 3, none), (hinge, 3, tip(1.0), 4, none)]
        joints += [(lambda: Prismatic("y"), -1, (0.1, 0.0, 0.0), 4, none)]
    return Linkage(tuple(bars), tuple(joints))


def built(of: Linkage, order: random.Random) -> tuple[ac.Model, dict[str, str], list[Any]]:
    """The model with its parts declared in some order under some names; what they are called in plain words, and the joints."""
    own = ["world", *(f"bar{k}" for k in range(len(of.bars))), *(f"joint{k}" for k in range(len(of.joints)))]
    scene, made = ac.System(), dict[str, Any]()
    names = dict(zip(own, order.sample(NAMES, len(own)), strict=True))
    for part in order.sample(own, len(own)):
        if part == "world":
            made[part] = World((0.0, -9.81, 0.0))
        elif part.startswith("bar"):
            length, (x, y, angle) = of.bars[int(part[3:])]
            made[part] = RigidBody.rod(1.0, (length, 0, 0), position=(x, y, 0.0), rotation=turned(angle))
        else:
            made[part] = of.joints[int(part[5:])][0]()
        setattr(scene, names[part], made[part])
    for k in order.sample(range(len(of.joints)), len(of.joints)):
        _, a, at_a, b, at_b = of.joints[k]
        one, two = (made["world"] if i < 0 else made[f"bar{i}"] for i in (a, b))
        joint = made[f"joint{k}"]
        ends = (joint.point_a, joint.point_b) if isinstance(joint, Spring) else (joint.frame_a, joint.frame_b)
        pairs = [(one.at(at_a), ends[0]), (ends[1], two.at(at_b))]
        for pair in order.sample(pairs, 2):
            scene.connect(*pair)
    joints = [made[f"joint{k}"] for k in range(len(of.joints)) if of.joints[k][0] is not spring]
    return ac.build(scene), {name: part for part, name in names.items()}, joints


def in_plain_words(names: tuple[str, ...], known: dict[str, str]) -> tuple[str, ...]:
    found: list[str] = []
    for name in names:
        own = next(k for k in sorted(known, key=len, reverse=True) if name.startswith((k + ".", k + "[")))
        found.append(known[own] + name[len(own) :])
    return tuple(found)


@each_value(("rough", [0.0, 0.3]), ("kind", ["parallelogram", "four-bar with springs", "three equal legs", "two rods"]))
def test_order_and_names_of_declaration_change_no_bit(kind, rough):
    """Of the branch, the rows that are dropped, the states, and the motion."""
    sketch, seen = linkage(kind, np.random.default_rng(3), rough), set[Any]()
    for seed in range(3):
        model, known, joints = built(sketch, random.Random(seed))
        run = model.simulate(0.05, samples=2, compiled=False, progress=False)
        c = model.system.constraints
        decisions = tuple(in_plain_words(names, known) for names in (model.state_names, c.kept, c.redundant, c.vanishing))
        seen.add((decisions, *(np.asarray(run[joint.q]).tobytes() for joint in joints)))
    assert len(seen) == 1


MECHANISMS: dict[str, Callable[[], tuple[ac.System, dict[Any, Any]]]] = {
    "four-bar": lambda: (FourBar(), {}),
    "four-bar with its crank held": lambda: (s := FourBar(), {s.a.q: 0.6}),
    "five-bar": lambda: (s := five_bar(), {s.hinges[0].q: 1.2}),
    "slider-crank": lambda: (s := slider_crank(), {s.rail.q: 2.2}),
    "spatial four-bar": lambda: (s := rssr(), {s.a.q: 1.0}),
    "Bennett's linkage": lambda: (bennett_linkage(), {}),
    "platform": lambda: (s := stewart_platform(), {x.q: 1.2 + 0.03 * k for k, x in enumerate(s.slide)}),
}


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_branch_nearest_to_a_rough_sketch_is_taken(name):
    """Against many searches, from sketches in which every joint is off by about a third of a radian or length."""
    scene, start = MECHANISMS[name]()
    account = ac.build(scene).initial_state(start).account
    search, data = account.problem.positions, account.data
    rng = np.random.default_rng(11)
    for _ in range(1 if name == "platform" else 2):
        unknowns = search.sizes(data, account.positions.y).unknowns
        sketch = dataclasses.replace(search, guess=account.positions.y + 0.35 * unknowns * rng.normal(size=unknowns.size))
        first = sketch.first(data)
        sizes, rows, apart = sketch.sizes(data, first), sketch.rows(data, first), sketch.apart(data, first)
        found = sketch.solve(data, account.weights)
        assert found.converged
        taken = np.linalg.norm(apart(found.y)[0])
        for size in (0.3, 1.0, 3.0) * 3:
            other = assemble(rows, first + size * sizes.unknowns * rng.normal(size=first.size), sizes=sizes, nearest=apart)
            if other.converged and search.is_meant(other.y, data):
                assert taken <= np.linalg.norm(apart(other.y)[0]) * (1 + 1e-4) + 1e-6


@each_value(("side", [1.0, -1.0]), ("wished", [0, 2]))
def test_of_branches_as_near_as_each_other_that_to_which_near_values_lead_is_taken(wished, side):
    """Cranks drawn upright that are to lie flat: each could to either side, and the bars between them over or under."""
    scene = FourBars()
    flat = {crank.tip.position[1]: 0.0 for crank in scene.cranks}
    model = ac.build(scene)
    state = model.initial_state(flat | {scene.feet[wished].q: ac.near(0.6 * side)})
    angles = [state.x[model.state_names.index(f"feet[{k}].q")] for k in range(3)]
    assert np.max(np.abs(np.array(angles) - 0.5 * np.pi * side)) < 1e-6


@pytest.mark.parametrize("angle", [-2.5, -0.4, 1.9])
def test_the_start_is_the_first_of_the_branches(angle):
    scene = FourBar()
    model = ac.build(scene)
    state, branches = model.initial_state({scene.a.q: angle}), model.branches({scene.a.q: angle}, searches=40)
    assert np.max(np.abs(state.x - branches[0].x)) < 1e-9
    others = len(branches) - 1
    assert ("other branch" in str(state)) == (others > 0) and (others == 0 or str(state).count(f"{others} other branch") == 1)


def test_a_closed_sketch_stays_as_it_is():
    """To the bit, without any search, though another branch is near: the bars lie nearly in one line."""
    for angle in (1e-3, -1e-3):
        scene = FourBar()
        model = ac.build(scene)
        state = model.initial_state({scene.a.q: angle})
        again = model.initial_state({scene.a.q: state.x[0], scene.b.q: state.x[model.state_names.index("b.q")]})
        assert again.account.positions.restarts == 0
        assert np.max(np.abs(again.x - state.x)) < 1e-12


@pytest.mark.parametrize("distance", [1.0, 1e3, 1e6])
def test_a_body_drawn_far_away_is_assembled(distance):
    """On three rods, and on a rod of its own with a universal joint and a ball."""
    scene = ac.System()
    scene.world = World(None)
    scene.body = RigidBody.box(1.0, (0.2, 0.2, 0.2), position=(distance, 0.3 * distance, -0.2 * distance))
    scene.rods = [Rod(1.0) for _ in range(3)]
    for k, rod in enumerate(scene.rods):
        scene.connect(scene.world.at((0.5 * k, 0.1 * k * k, 0)), rod.frame_a)
        scene.connect(rod.frame_b, scene.body.at((0.1 * k, 0, 0.1 * k * k)))
    model = ac.build(scene)
    assert model.simulate(0.01, compiled=False, samples=2, progress=False).constraint_error() < 1e-11
    scene = ac.System()
    scene.world, scene.cross, scene.ball = World(None), Universal("y", "z"), Spherical()
    scene.arm = RigidBody.rod(1.0, (1.0, 0, 0), radius=0.1)
    scene.body = RigidBody.box(1.0, (0.2, 0.2, 0.2), position=(0, distance, distance))
    closed(scene, (scene.world.frame, scene.cross, scene.arm.frame), (scene.arm.tip, scene.ball, scene.body.frame))
    assert np.isfinite(ac.build(scene).initial_state().x).all()


@pytest.mark.parametrize("period", [0.01, 10.0, 3e4])
def test_a_loop_closes_at_a_time_to_which_a_drive_at_rest_leads(period):
    """Two rods reach the pivot only while it passes: it begins at rest, out of reach."""
    scene = two_rods_to_a_driven_pivot(2.0 * np.cos(ac.time * 2 * np.pi / period))
    state = ac.build(scene).initial_state(t0=0.2 * period)
    assert np.isfinite(state.x).all()


@pytest.mark.parametrize("voltage", [None, 0.5, 2.0, 10.0, 20.0, 300.0])
def test_a_diode_is_found_from_any_voltage(voltage):
    scene = series(VoltageSource(5.0), resistor=Resistor(50.0), diode=Diode(1e-9, 0.025))
    start = {} if voltage is None else {scene.diode.v: ac.near(voltage)}
    current = float(ac.build(scene).initial_state(start).x[0])
    assert abs(current - 1e-9 * np.expm1((5.0 - 50.0 * current) / 0.025)) < 1e-9


@pytest.mark.parametrize("value", ["0.3", None, [0.1, "0.2"], 1j, [[0.1], [0.2, 0.3]]])
def test_a_start_that_is_no_number_is_refused(value):
    scene = ac.System()
    scene.world, scene.slide, scene.point = World(None), Prismatic("x"), Particle(1.0)
    closed(scene, (scene.world.frame, scene.slide, scene.point.point))
    with pytest.raises(errors.StartValueError, match="not a number"):
        ac.build(scene).initial_state({scene.slide.q: value})


def test_what_cannot_move_rests_whatever_is_wished_for():
    """Not at a rounding error, from which a motion would go on."""
    scene = ac.System()
    scene.world, scene.rail, scene.block = World(None), Prismatic("x"), RigidBody.box(1.0, (0.1, 0.1, 0.1), position=(0.3, 0, 0))
    scene.top, scene.stone = Prismatic("y"), Particle(1.0, position=(0.3, 0, 0))
    scene.stays = [Rod(float(np.hypot(x - 0.3, y))) for x, y in ((1.0, 0.4), (-0.7, 1.1))]
    closed(
        scene,
        (scene.world.frame, scene.rail, scene.block.frame),
        (scene.block.frame, scene.top, scene.stone.point),
        (scene.world.at((1.0, 0.4, 0)), scene.stays[0], scene.block.frame),
        (scene.world.at((-0.7, 1.1, 0)), scene.stays[1], scene.block.frame),
    )
    state = ac.build(scene).initial_state({scene.rail.v: ac.near(-0.524997), scene.top.v: ac.near(0.3)})
    values = dict(zip(ac.build(scene).state_names, state.x, strict=True))
    assert values["rail.v"] == 0.0 and values["top.v"] == 0.3


@pytest.mark.parametrize("length", [1.0, 1e-7, 3.0])
def test_what_is_only_wished_for_never_keeps_loops_from_closing(length):
    """A point of an arm on two crosses slides on a curve that moves away: from the wish no search finds back, from the sketch every one does."""
    scene = ac.System()
    scene.world = World(None)
    scene.wire = PointOnCurve(ParametricCurve(lambda s: (length * ca.sin(s), 0.3 * length * ca.sin(2 * s), 0.2 * length * s * s)))
    scene.ball, scene.first, scene.second = Spherical(), Universal("x", "y"), Universal("x", "z")
    scene.upper, scene.lower = (RigidBody.rod(1.0, (0, 0, x * length), radius=0.05 * length) for x in (0.5, 0.4))
    closed(
        scene,
        (scene.world.at((0, 0, -0.85 * length)), scene.first, scene.upper.frame),
        (scene.upper.tip, scene.second, scene.lower.frame),
        (scene.world.frame, scene.wire, scene.ball.frame_a),
    )
    scene.connect(scene.ball.frame_b, scene.lower.tip)
    model = ac.build(scene)
    wished = {scene.wire.q: ac.near(9.0), scene.first.q: ac.near([3.0, -2.0]), scene.second.q: ac.near([2.0, 2.5])}
    assert np.isfinite(model.initial_state().x).all() and np.isfinite(model.initial_state(wished).x).all()


def hung_plate(size: float) -> Any:
    """A plate in a plane, held by a rod to a body that is free; of both together little is given."""
    scene: Any = ac.System()
    scene.world, scene.board, scene.rod = World(), Planar("z"), Rod(2.5 * size)
    scene.body, scene.plate = (RigidBody.box(1.0, (size, 0.5 * size, 0.2 * size)) for _ in range(2))
    scene.connect(scene.world.at((0.3 * size, -0.2 * size, 0)), scene.board.frame_a)
    scene.connect(scene.board.frame_b, scene.plate.frame)
    scene.connect(scene.body.at((0, 0.1 * size, 0.1 * size)), scene.rod.frame_a)
    scene.connect(scene.rod.frame_b, scene.plate.at((0.4 * size, 0.2 * size, 0)))
    return scene


@pytest.mark.parametrize("size", [1.0 + 1e-7, 3.0, 0.7e-3, 1e4])
def test_what_start_values_leave_open_is_the_nearest_in_any_unit(size):
    """Among all that meets what is given, the search goes on to what is least far from the sketch: its way there decides nothing."""
    found: list[np.ndarray] = []
    for of in (1.0, size):
        scene = hung_plate(of)
        run = ac.build(scene).simulate(1e-3, {scene.body.frame.position: (0.9 * of, 0.7 * of, 2.0 * of)}, samples=2)
        assert np.max(np.abs(run[scene.body.frame.position][0] - of * np.array([0.9, 0.7, 2.0]))) < 1e-14 * of
        R = [run[part.frame.rotation][0].ravel() for part in (scene.body, scene.plate)]
        found.append(np.concatenate([run[scene.plate.frame.position][0] / of, *R]))
    assert np.max(np.abs(found[0] - found[1])) < 1e-9


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_weight_on_a_cable_starts_at_the_place_on_its_ellipsoid_that_is_nearest_to_the_sketch(size):
    """Though along one axis the cable's length hardly changes at first: in which direction a place is off makes no difference."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        (a, b, drawn), longer = rng.uniform(-1, 1, (3, 3)) - np.array([[0], [0], [1]]) * [0, 0, 1], rng.uniform(0.9, 1.1)
        around = lambda x, a=a, b=b: np.linalg.norm(x - a) + np.linalg.norm(x - b)  # noqa: E731
        length = longer * around(drawn)
        scene = ac.System()
        scene.world, scene.weight = World(), Particle(2.0, position=tuple(size * drawn))
        scene.cable = Cable(size * length, over=(scene.weight.point,))
        scene.connect(scene.world.at(tuple(size * a)), scene.cable.frame_a)
        scene.connect(scene.cable.frame_b, scene.world.at(tuple(size * b)))
        place = ac.build(scene).initial_state().x[:3] / size
        closing = {"type": "eq", "fun": lambda x, of=around, length=length: of(x) - length}
        begins = [drawn + 0.1 * rng.normal(size=3) for _ in range(4)]
        off = lambda x, drawn=drawn: np.sum((x - drawn) ** 2)  # noqa: E731
        tried = [minimize(off, begin, constraints=closing, options={"ftol": 1e-15}) for begin in begins]
        assert abs(around(place) - length) < 1e-13
        assert off(place) < min(one.fun for one in tried if one.success) + 1e-9


@pytest.mark.parametrize("size", [1.0, 2e-5])
def test_a_ball_in_a_hollow_sphere_is_above_or_below_as_is_wished(size):
    """From where the sketch has it, above, the way down leads farther away from where it is to be exactly."""
    scene = ac.System()
    scene.world, scene.ball = World(None), RigidBody.ball(1.0, 0.1 * size)
    scene.contact = Contact(Sphere(0.1 * size), Sphere(size, inside_out=True))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    model, place = ac.build(scene), scene.ball.frame.position
    for x, y, z in ((0.4, 0.1, -0.8), (0.4, 0.1, 0.8), (-0.2, 0.5, -0.3)):
        height = np.sign(z) * np.sqrt(0.81 - x**2 - y**2) * size
        run = model.simulate(0.0, {place[0]: x * size, place[1]: y * size, place[2]: ac.near(z * size)}, samples=2)
        assert np.allclose(run[place][0], (x * size, y * size, height), rtol=1e-12)


def test_places_are_searched_for_again_only_where_something_counts_for_them(monkeypatch):
    """Masses and speeds do not, lengths and places of joints that close loops do; bit for bit as a scene that was never asked before."""

    def made() -> tuple[Any, ac.Model]:
        s: Any = FourBar()
        s.mass, s.far = ac.Parameter(2.0, "kg"), ac.Parameter(0.1, "m")
        s.load, s.rail, s.stop = Particle(s.mass), Revolute("y"), RigidBody.box(1.0, (0.1, 0.1, 0.1))
        s.connect(s.coupler.at((s.far, 0, 0)), s.load.point)
        s.connect(s.rocker.at((0, 0, s.far)), s.rail.frame_a)
        s.connect(s.rail.frame_b, s.stop.frame)
        return s, ac.build(s)

    searched: list[bool] = []
    monkeypatch.setattr(
        start_search,
        "solve_block",
        lambda block, *given: searched.append(not block.unknowns.linear) or solve_block(block, *given),
    )
    s, model = made()
    model.initial_state({s.a.q: 0.3, s.a.v: 1.0})
    for start, parameters, anew in (
        ((0.3, 1.0), {"mass": 3.0}, False),
        ((0.3, -2.0), {}, False),
        ((0.3, -2.0), {"mass": 0.2, "far": 0.3}, False),
        ((0.4, 1.0), {}, True),
    ):
        searched.clear()
        found = model.initial_state({s.a.q: start[0], s.a.v: start[1]}, parameters=parameters).x
        assert any(searched) == anew
        other, fresh = made()
        assert np.array_equal(found, fresh.initial_state({other.a.q: start[0], other.a.v: start[1]}, parameters=parameters).x)
    lengths = ac.Parameter(1.2, "m")
    four: Any = ac.System()
    four.long, four.world, four.rods = lengths, World(), [RigidBody.rod(1.0, (x, 0, 0)) for x in (0.4, lengths, 0.8)]
    four.hinges = [Revolute("y") for _ in range(4)]
    ends = (four.world.frame, four.rods[0].frame), (four.rods[0].tip, four.rods[1].frame)
    ends += (four.rods[1].tip, four.rods[2].tip), (four.world.at((1, 0, 0)), four.rods[2].frame)
    for hinge, (one, two) in zip(four.hinges, ends, strict=True):
        four.connect(one, hinge.frame_a)
        four.connect(hinge.frame_b, two)
    model = ac.build(four)
    for length in (1.2, 1.1):
        x = model.initial_state({four.hinges[0].q: 0.3}, parameters={lengths: length}).x
        run = model.simulate(0.0, {four.hinges[0].q: 0.3}, parameters={lengths: length})
        apart = run[four.rods[1].tip.position][0] - run[four.rods[0].tip.position][0]
        assert np.linalg.norm(apart) == pytest.approx(length, rel=1e-12) and x.shape == run.x[:, 0].shape
