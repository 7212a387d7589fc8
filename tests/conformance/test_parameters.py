"""What holds at any values of parameters, in any order of declaration, under any names, in any units: laws over random networks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import acausal as ac
import components
from acausal.errors import AcausalError, ParameterError
from components import (
    Capacitor,
    Circle,
    Coulomb,
    Cylindrical,
    DCMotor,
    Drag,
    Gear,
    Ground,
    Inductor,
    Inertia,
    Particle,
    PlanetaryGear,
    PointOnCurve,
    PointOnPlane,
    Prismatic,
    RackAndPinion,
    Resistor,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalSpring,
    Screw,
    SlidingMass,
    SpringDamper,
    TorqueSource,
    TranslationalGround,
    TranslationalSpring,
    VoltageSource,
    World,
)

Value = float | ac.Parameter


def network(pairs: list[tuple[int, int]], values: list[float], nodes: int) -> ac.System:
    """Resistors of adjustable size between nodes; a battery with inner resistance 0.5 at the last one; a capacitor that nothing disturbs."""
    scene = ac.System()
    scene.ground, scene.battery, scene.inner = Ground(), VoltageSource(10.0), Resistor(0.5)
    scene.store, scene.feed = Capacitor(1.0), Resistor(1.0)
    scene.sizes = [ac.Parameter(v, "Ohm") for v in values]
    scene.resistors = [Resistor(size) for size in scene.sizes]
    pins: list[list[ac.Connector]] = [[] for _ in range(nodes)]
    pins[0] += [scene.ground.pin, scene.battery.pin_b, scene.store.pin_b]
    pins[-1].append(scene.inner.pin_b)
    scene.connect(scene.battery.pin_a, scene.inner.pin_a, scene.feed.pin_a)
    scene.connect(scene.feed.pin_b, scene.store.pin_a)
    for resistor, (a, b) in zip(scene.resistors, pairs, strict=True):
        pins[a].append(resistor.pin_a)
        pins[b].append(resistor.pin_b)
    for group in pins:
        scene.connect(*group)
    return scene


def currents(pairs: list[tuple[int, int]], values: list[float], nodes: int) -> np.ndarray | None:
    """Of the resistors, by a solver for dense matrices; None where they are not determined."""
    m, n = len(pairs), nodes - 1
    A = np.zeros((nodes, m))
    for k, (a, b) in enumerate(pairs):
        A[a, k] += 1
        A[b, k] -= 1
    M, r = np.zeros((n + m + 1, n + m + 1)), np.zeros(n + m + 1)
    M[:n, n : n + m], M[n : n + m, :n] = A[1:], A[1:].T
    M[n - 1, n + m], M[-1, n - 1], M[-1, -1], r[-1] = -1, 1, 0.5, 10.0
    M[n : n + m, n : n + m] = -np.diag(values)
    scaled = M / np.abs(M).max(axis=1, keepdims=True)
    if np.linalg.matrix_rank(scaled / np.abs(scaled).max(axis=0)) < len(r):
        return None
    return np.linalg.solve(M, r)[n : n + m]


def largest_term(values: list[float]) -> float:
    """The battery's potential times the largest conductance [A]: a current is a difference of such terms, which all are rounded."""
    return 10.0 * max(1 / value for value in (0.5, *values) if value > 0)


def sketch(rng: np.random.Generator) -> tuple[list[tuple[int, int]], int]:
    """A random graph in which every node has two neighbours at least."""
    nodes = int(rng.integers(3, 6))
    while True:
        pairs = [(k, int(rng.integers(k))) for k in range(1, nodes)]
        pairs += [tuple(int(i) for i in rng.choice(nodes, 2, replace=False)) for _ in range(int(rng.integers(2, 5)))]
        if all(sum(k in pair for pair in pairs) > 1 for k in range(1, nodes - 1)):
            return pairs, nodes


def extremes(rng: np.random.Generator, base: np.ndarray) -> list[float]:
    """Some shorted, some a million times as large."""
    kinds = rng.choice(3, base.size, p=[0.6, 0.25, 0.15])
    return [float(v * (1.0, 0.0, 1e6)[kind]) for v, kind in zip(base, kinds, strict=True)]


@pytest.mark.parametrize("group", range(4))
def test_networks_of_resistors_built_at_one_size_are_right_at_any_other(group):
    right = 0
    for seed in range(6 * group, 6 * group + 6):
        rng = np.random.default_rng(seed)
        pairs, nodes = sketch(rng)
        base = rng.uniform(0.5, 5, len(pairs))
        built, asked = extremes(rng, base), extremes(rng, base)
        print("seed", seed, pairs, built, asked)
        scene = network(pairs, built, nodes)
        exact = [currents(pairs, values, nodes) for values in (built, asked)]
        if exact[0] is None:
            with pytest.raises(AcausalError):
                ac.build(scene)
            continue
        model = ac.build(scene)
        for given, wanted in zip((built, asked), exact, strict=True):
            parameters = dict(zip(scene.sizes, given, strict=True))
            if wanted is None:
                with pytest.raises(ParameterError, match="resistance = "):
                    model.simulate(1e-9, parameters=parameters)
                continue
            run = model.simulate(1e-9, parameters=parameters, samples=2)
            found = np.array([run[resistor.i][-1] for resistor in scene.resistors])
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * largest_term(given))
            right += 1
    assert right > 5


def test_a_bridge_built_with_its_branch_shorted():
    scene = network([(1, 0), (2, 0), (1, 2), (3, 1), (3, 2)], [1.0, 2.0, 0.0, 4.0, 5.0], 4)
    model = ac.build(scene)
    exact = currents([(1, 0), (2, 0), (1, 2), (3, 1), (3, 2)], [1.0, 2.0, 3.0, 4.0, 5.0], 4)
    run = model.simulate(1e-9, parameters={scene.sizes[2]: 3.0})
    np.testing.assert_allclose([run[r.i][-1] for r in scene.resistors], exact, atol=1e-12)


def test_a_value_at_which_nothing_is_determined_is_named():
    """Two resistors in parallel, both shorted: nothing says how they share the current."""
    scene = network([(1, 0), (1, 0)], [1.0, 2.0], 2)
    model = ac.build(scene)
    with pytest.raises(ParameterError, match=r"resistance = 0 Ohm.*depend on one another"):
        model.simulate(1.0, parameters=dict.fromkeys(scene.sizes, 0.0))
    alone = model.initial_state(parameters={scene.sizes[0]: 0.0})
    assert float(model.functions.output(scene.resistors[0].i)(0.0, alone.x, [], alone.p)) == pytest.approx(20.0, rel=1e-14)


@pytest.mark.parametrize(("part", "name"), [(Capacitor, "capacitance"), (Inductor, "inductance")])
def test_stores_that_would_be_none_are_refused_by_name(part, name):
    size = ac.Parameter(1.0)
    scene = network([(1, 0)], [1.0], 2)
    scene.size, scene.more = size, part(size)
    scene.connect(scene.more.pin_a, scene.resistors[0].pin_a)
    scene.connect(scene.more.pin_b, scene.ground.pin)
    model = ac.build(scene)
    for value in (0.0, -1.0):
        with pytest.raises(ParameterError, match=name):
            model.simulate(1.0, parameters={size: value})
    with pytest.raises(ParameterError, match=name):
        part(ac.Parameter(0.0))
    with pytest.raises(
        ParameterError, match=r"built with the parameters' own values: give ac.Parameter\(0\) one that is allowed"
    ):
        part(ac.Parameter(0.0))


class Weighted(ac.Component):
    """A load whose coefficients a user may set to anything: share der(x) + (1 - share) x = i, and v = x."""

    flange = ac.Rotational.port()
    x = ac.Variable("rad/s")

    def __init__(self, share: ac.Parameter) -> None:
        self.share = share

    def equations(self):
        yield ac.equal(ac.der(self.flange.phi), self.x)
        yield ac.equal(self.share * ac.der(self.x) + (1.0 - self.share) * self.x, self.flange.tau)


def test_a_coefficient_of_ones_own_that_vanishes_is_named_at_the_call():
    scene = ac.System()
    scene.share = ac.Parameter(0.5)
    scene.load, scene.motor = Weighted(scene.share), TorqueSource(1.0)
    scene.connect(scene.motor.flange, scene.load.flange)
    model = ac.build(scene)
    run = model.simulate(1.0, parameters={scene.share: 1.0}, rtol=1e-10)
    np.testing.assert_allclose(run[scene.load.x], run.t, atol=1e-9)
    with pytest.raises(ParameterError, match=r"share = 0 \(built with 0\.5\)"):
        model.simulate(1.0, parameters={scene.share: 0.0})


@pytest.mark.parametrize("seed", range(4))
def test_trains_of_shafts_built_at_one_size_move_as_those_built_at_another(seed):
    rng = np.random.default_rng(seed)
    built, asked = rng.uniform(0.2, 3, 8), rng.uniform(0.2, 3, 8) * 10.0 ** rng.integers(-2, 3, 8)

    def drive(values: np.ndarray) -> tuple[ac.System, list[ac.Parameter]]:
        p = [ac.Parameter(float(v)) for v in values]
        scene = ac.System()
        scene.p = p
        scene.a, scene.b, scene.c, scene.d = (Inertia(J) for J in p[:4])
        scene.gear, scene.planets = Gear(p[4]), PlanetaryGear(p[5])
        scene.spring, scene.damper, scene.motor = RotationalSpring(p[6]), RotationalDamper(p[7]), TorqueSource(1.0)
        scene.connect(scene.motor.flange, scene.a.flange_a)
        scene.connect(scene.a.flange_b, scene.gear.flange_a)
        scene.connect(scene.gear.flange_b, scene.b.flange_a)
        scene.connect(scene.b.flange_b, scene.spring.flange_a, scene.damper.flange_a)
        scene.connect(scene.spring.flange_b, scene.damper.flange_b, scene.planets.sun)
        scene.connect(scene.planets.carrier, scene.c.flange_a)
        scene.connect(scene.planets.ring, scene.d.flange_a)
        return scene, p

    (one, parameters), (other, _) = drive(built), drive(asked)
    start = lambda s: {s.a.phi: 0.1, s.a.w: 0.2, s.c.phi: 0.3, s.c.w: -0.1, s.d.phi: 0.0, s.d.w: 0.1}  # noqa: E731
    there = ac.build(other).simulate(0.5, start(other), rtol=1e-11)
    here = ac.build(one).simulate(0.5, start(one), parameters=dict(zip(parameters, asked, strict=True)), rtol=1e-11)
    for a, b in ((one.a, other.a), (one.b, other.b), (one.c, other.c), (one.d, other.d)):
        np.testing.assert_allclose(here[a.phi], there[b.phi], atol=1e-9 * max(1.0, np.max(np.abs(there[b.phi]))))


PARTS: dict[str, Callable[[float, float, float], ac.Component]] = {
    "a": lambda L, M, T: Inertia(0.3 * M * L**2),
    "b": lambda L, M, T: Inertia(1.1 * M * L**2),
    "c": lambda L, M, T: Inertia(0.7 * M * L**2),
    "m": lambda L, M, T: SlidingMass(2.0 * M),
    "g": lambda L, M, T: Gear(2.5),
    "k": lambda L, M, T: RotationalSpring(3.0 * M * L**2 / T**2),
    "d": lambda L, M, T: RotationalDamper(0.2 * M * L**2 / T),
    "r": lambda L, M, T: RackAndPinion(0.4 * L),
    "w": lambda L, M, T: TranslationalSpring(5.0 * M / T**2),
    "e": lambda L, M, T: TranslationalGround(),
    "p": lambda L, M, T: PlanetaryGear(2.0),
    "q": lambda L, M, T: Inertia(0.2 * M * L**2),
}
TIES = (
    ("a.flange_b", "g.flange_a"), ("g.flange_b", "b.flange_a"), ("b.flange_b", "k.flange_a", "d.flange_a"),
    ("k.flange_b", "d.flange_b", "c.flange_a"), ("c.flange_b", "p.sun"), ("p.ring", "q.flange_a"), ("p.carrier", "r.pinion"),
    ("r.rack", "m.flange_a"), ("m.flange_b", "w.flange_a"), ("w.flange_b", "e.flange"),
)  # fmt: skip


def shafts(
    order: list[str], ties: list[tuple[str, ...]], name: Callable[[str], str], units: tuple[float, float, float] = (1, 1, 1)
) -> tuple[list[str], np.ndarray]:
    """The states of a drive, by the names of its parts in `PARTS`, and where its parts are after a while."""
    scene = ac.System()
    parts = {key: PARTS[key](*units) for key in order}
    for key in order:
        setattr(scene, name(key), parts[key])
    for tie in ties:
        scene.connect(*(getattr(parts[end.split(".")[0]], end.split(".")[1]) for end in tie))
    model = ac.build(scene)
    L, _, T = units
    run = model.simulate(2.0 * T, {parts["a"].w: 1.0 / T, parts["m"].s: 0.1 * L}, rtol=1e-11)
    back = {name(key): key for key in order}
    states = sorted(back[state.split(".")[0]] + state[len(state.split(".")[0]) :] for state in model.state_names)
    return states, np.array([run[parts[key].phi][-1] for key in "abcq"])


def test_neither_order_nor_names_change_which_states_are_chosen_or_what_moves():
    states, places = shafts(list(PARTS), list(TIES), str)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        order = [str(key) for key in rng.permutation(list(PARTS))]
        ties = [tuple(str(end) for end in rng.permutation(TIES[k])) for k in rng.permutation(len(TIES))]
        letters = [str(letter) for letter in rng.permutation(list("abcdefghijkl"))]
        renamed = {key: f"part_{letter}" for key, letter in zip(PARTS, letters, strict=True)}
        print("seed", seed, order)
        found, moved = shafts(order, ties, renamed.__getitem__ if seed % 2 else str)
        assert found == states
        np.testing.assert_allclose(moved, places, rtol=1e-13)


@pytest.mark.parametrize("units", [(1e9, 1, 1), (1, 1e-9, 1), (1, 1e9, 1), (1, 1, 1e-9), (1, 1, 1e9), (1e-3, 1e-6, 1e3)])
def test_units_change_neither_the_states_nor_the_motion(units):
    states, places = shafts(list(PARTS), list(TIES), str)
    found, moved = shafts(list(PARTS), list(TIES), str, units)
    assert found == states
    np.testing.assert_allclose(moved, places, rtol=1e-12)


def linkage(lengths: np.ndarray) -> tuple[ac.System, list[ac.Parameter]]:
    """A four-bar with adjustable crank, coupler, rocker and ground, all drawn along x."""
    scene = ac.System()
    scene.lengths = [ac.Parameter(float(length), "m") for length in lengths]
    crank, coupler, rocker, ground = scene.lengths
    scene.world, scene.hinges = World((0, 0, -9.81)), [Revolute("y") for _ in range(4)]
    scene.bars = [RigidBody.rod(1.0, (length, 0, 0)) for length in (crank, coupler, rocker)]
    one, two, three = scene.bars
    ends = (
        (scene.world.frame, one.frame),
        (one.tip, two.frame),
        (two.tip, three.tip),
        (scene.world.at((ground, 0, 0)), three.frame),
    )
    for hinge, (a, b) in zip(scene.hinges, ends, strict=True):
        scene.connect(a, hinge.frame_a)
        scene.connect(hinge.frame_b, b)
    return scene, scene.lengths


USUAL = np.array([0.4, 1.2, 0.8, 1.0])


@pytest.mark.parametrize(
    "factors", [(1, 0.5, 1, 1), (1, 1, 1, 1.35), (1.4, 1.1, 0.8, 0.9), (1e3, 1e3, 1e3, 1e3), (2e-6, 1e-6, 3e-6, 2e-6)]
)
def test_a_start_does_not_depend_on_the_lengths_at_the_build(factors):
    (one, parameters), (other, _) = linkage(USUAL), linkage(USUAL * factors)
    here, there = ac.build(one), ac.build(other)
    values = dict(zip(parameters, USUAL * factors, strict=True))
    for start in ({}, {0: 0.9}, {3: ac.near(1.4)}):
        found = here.initial_state({one.hinges[k].q: q for k, q in start.items()}, parameters=values)
        wanted = there.initial_state({other.hinges[k].q: q for k, q in start.items()})
        np.testing.assert_allclose(found.x, wanted.x, atol=1e-11)


THROWN_AWAY = (
    "p, s = ac.Parameter(1.0), ac.System(); trial = c.Particle(p); s.force, s.ball = c.Force((p, 0, 0)), c.Particle(1.0)",
    "p, s = ac.Parameter(1.0), ac.System(); s.force, s.ball, _ = [k(v) for k, v in ((c.Force, (p, 0, 0)), (c.Particle, 1.0), (c.Spring, p))]",
    "p, s = ac.Parameter(1.0), ac.System(); c.RigidBody.ball(p, p); c.Coulomb(p); s.force, s.ball = c.Force((p, 0, 0)), c.Particle(1.0)",
)


@pytest.mark.parametrize("script", THROWN_AWAY)
def test_what_was_thrown_away_asks_nothing_on_whatever_line(script):
    """As in a loop, or in a cell of a notebook."""
    made = {"ac": ac, "c": components}
    exec(compile(script, "<ipython-input-1>", "exec"), made)
    scene, p = made["s"], made["p"]
    scene.world = World(None)
    scene.connect(scene.force.point, scene.ball.point)
    run = ac.build(scene).simulate(1.0, parameters={p: -2.0}, samples=2)
    assert run[scene.ball.point.velocity[0]][-1] == pytest.approx(-2.0)


def test_what_parts_are_made_of_is_asked_wherever_it_was_made():
    """Laws, curves and what a class method is given, made on other lines than the parts."""
    mu, radius, mass = ac.Parameter(0.3), ac.Parameter(1.0, "m"), ac.Parameter(1.0, "kg")
    rough = Coulomb(mu)
    circle = Circle(radius)
    scene = ac.System()
    scene.world, scene.bead, scene.ball = World(), Particle(1.0), RigidBody.ball(mass, 0.1)
    scene.guide, scene.floor = PointOnCurve(circle), PointOnPlane(unilateral=True, friction=rough)
    scene.connect(scene.world.frame, scene.guide.frame_a, scene.floor.frame_a)
    scene.connect(scene.guide.frame_b, scene.bead.point)
    scene.connect(scene.floor.frame_b, scene.ball.at((0, 0, -0.1)))
    model = ac.build(scene)
    for parameter, words in ((mu, "Coulomb's mu"), (radius, "Circle's radius"), (mass, "mass")):
        with pytest.raises(ParameterError, match=rf"With the parameters of this call .*{words} is -1"):
            model.initial_state(parameters={parameter: -1.0})


@pytest.mark.parametrize("make", [lambda p: RigidBody.ball(1.0, 0.1, position=p), lambda p: Particle(1.0, position=p)])
def test_a_sketch_is_of_numbers_and_says_so(make):
    with pytest.raises(ParameterError, match="place in the sketch depends on a parameter"):
        make((ac.Parameter(0.3, "m"), 0.0, 0.0))


def motor_on_a_hinge(resistance: Value, inertia: Value, damping: Value) -> tuple[ac.System, ac.Expression]:
    scene = ac.System()
    scene.world, scene.bar, scene.source, scene.ground = World(), RigidBody.rod(1.0, (1, 0, 0)), VoltageSource(5.0), Ground()
    scene.hinge = Revolute.between(scene.world, scene.bar, at=(0, 0, 0), axis="y")
    scene.motor = DCMotor(0.4, resistance, 0.3, inertia, 2.0, damping)
    scene.connect(scene.source.pin_a, scene.motor.pin_a)
    scene.connect(scene.source.pin_b, scene.motor.pin_b, scene.ground.pin)
    scene.connect(scene.motor.flange, scene.hinge.flange)
    return scene, scene.hinge.q


def ball_on_a_spring(stiffness: Value, length: Value, damping: Value, drag: Value) -> tuple[ac.System, ac.Expression]:
    scene = ac.System()
    scene.world, scene.ball, scene.air = World(), Particle(1.0, position=(0.3, 0.2, 0.1)), Drag(linear=drag, quadratic=damping)
    scene.spring = SpringDamper(stiffness, length, damping)
    scene.connect(scene.world.frame, scene.spring.point_a)
    scene.connect(scene.spring.point_b, scene.ball.point, scene.air.point)
    return scene, scene.ball.point.position


def screws_in_line(pitch: Value, other: Value, aside: Value) -> tuple[ac.System, ac.Expression]:
    scene = ac.System()
    scene.world, scene.nut = World((1, 0, -9)), RigidBody(1.0, np.diag([0.4, 0.5, 0.6]), (0.3, aside, 0.2))
    scene.end = RigidBody(1.0, np.diag([0.4, 0.5, 0.6]), (0.3, 0.1, 0.2), position=(0, 0, 1))
    scene.first = Screw.between(scene.world, scene.nut, at=(0, 0, 0), axis="z", pitch=pitch)
    scene.second = Screw.between(scene.nut, scene.end, at=(0, 0, 0), axis="z", pitch=other)
    scene.guide = Cylindrical.between(scene.world, scene.end, at=(0, 0, 0), axis="z")
    return scene, scene.first.q


def slider_crank(aside: Value, tilt: Value, pull: Value) -> tuple[ac.System, ac.Expression]:
    scene = ac.System()
    scene.world, scene.crank = World((pull, 0, -9)), RigidBody.rod(1.0, (0.8, 0, 0.6))
    scene.rod = RigidBody.rod(1.0, (1.9, 0, -0.6), position=(0.8, 0, 0.6))
    scene.slide = RigidBody.box(1.0, (1, 1, 1), position=(2.7, 0, 0))
    scene.hinges, scene.guide = [Revolute("y") for _ in range(3)], Prismatic((1, 0, tilt))
    ends = [
        (scene.world.at((0, 0, aside)), scene.crank.frame),
        (scene.crank.tip, scene.rod.frame),
        (scene.rod.tip, scene.slide.frame),
    ]
    for joint, (a, b) in zip([*scene.hinges, scene.guide], [*ends, (scene.world.frame, scene.slide.frame)], strict=True):
        scene.connect(a, joint.frame_a)
        scene.connect(joint.frame_b, b)
    return scene, scene.guide.q


def slide_as_it_is_drawn(place: Value, tilt: Value) -> tuple[ac.System, ac.Expression]:
    scene = ac.System()
    scene.world, scene.block = World(), RigidBody.box(1.0, (1, 1, 1), position=(2, 0, 0))
    scene.guide = Prismatic((1, 0, tilt))
    scene.connect(scene.world.at((place, 0, 0)), scene.guide.frame_a)
    scene.connect(scene.guide.frame_b, scene.block.frame)
    return scene, scene.guide.q


@pytest.mark.parametrize("values", [(slide_as_it_is_drawn, 0.5, 0.3), (motor_on_a_hinge, 1.2, 0.02, 0.05), (ball_on_a_spring, 30.0, 0.4, 0.5, 0.3), (screws_in_line, 0.3, 0.2, 0.1), (slider_crank, 0.2, 0.1, 1.0)])  # fmt: skip
def test_what_may_be_0_as_a_number_may_be_0_as_a_parameter(values: tuple[Callable[..., Any], float]):
    """At the build, with others in the call, and the other way round: as what is built with these numbers."""
    made, *sizes = values
    for one in range(len(sizes)):
        for begin, end in ((0.0, sizes[one]), (sizes[one], 0.0)):
            changed = ac.Parameter(begin)
            scene, read = made(*(changed if k == one else size for k, size in enumerate(sizes)))
            other, there = made(*(end if k == one else size for k, size in enumerate(sizes)))
            here = ac.build(scene).simulate(0.4, parameters={changed: end}, rtol=1e-10, samples=3)[read]
            assert np.max(np.abs(here - ac.build(other).simulate(0.4, rtol=1e-10, samples=3)[there])) < 1e-7
