"""Exported simulators with parts that open, stick, slide and strike: the bits of the package, in a block of memory of the caller's."""

from __future__ import annotations

import ctypes
import functools
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import acausal as ac
from acausal.language.expression import Expression
from acausal.language.mode_laws import ModeLaw
from components import Gripper, Particle, PointLatch, Revolute, RigidBody, SampleAndHold, TimeFunction, World
from tests.exported import (
    AUTO,
    CONDITION,
    GAUSS,
    INPUT,
    OUTPUT,
    OVERLAPS,
    RADAU,
    STATE,
    STOPPED,
    SUCCESS,
    Instance,
    Library,
    program,
)
from tests.scenes import FourBar
from tests.test_borne_friction import pendulum
from tests.test_changing_index import bridge
from tests.test_export_instances import COUNTED
from tests.test_modes import Touch, bouncing, changes, rubbing, sliding, table


@dataclass(frozen=True)
class Case:
    """A scene with its start, until `end`; `seen`: expressions that are put out; `event`: one that is looked for."""

    scene: ac.System
    start: dict[Expression, object]
    end: float
    seen: dict[str, Expression]
    event: ac.when


def ball() -> Case:
    """Comes to rest after impacts without end."""
    scene = bouncing(0.5)
    s, v = scene.mass.s, scene.mass.v
    return Case(scene, {s: 1.0, v: 0.0}, 1.6, {"push": scene.floor.push}, ac.when(v, "rising"))


def belt() -> Case:
    """Sticks and slips."""
    scene = rubbing(1.0, 2.0, 3.0, belt=0.5, stiffness=4.0)
    s, v = scene.mass.s, scene.mass.v
    return Case(scene, {s: 0.0, v: 0.0}, 9.0, {"drag": scene.rub.drag}, ac.when(s - 0.6))


def slide() -> Case:
    """Obliquely over a slope until friction in two directions holds it."""
    scene = sliding(0.5, 0.3)
    at = scene.particle.point
    start = {at.position: np.zeros(3), at.velocity: np.array([1.0, 0.8, 0.0])}
    return Case(scene, start, 2.0, {"rub": scene.touch.rub[0], "push": scene.touch.push}, ac.when(at.velocity[1] - 0.1))


def box() -> Case:
    """Lands on four feet, whose pushes are not unique."""
    scene, feet = table((0, 1, 2, 3), restitution=0.3)
    at = scene.box.frame
    start = {at.position: (0.0, 0.0, 0.7), at.velocity: (1.0, 0.3, 0.0), at.angular_velocity: (0.5, 0.2, 1.0)}
    return Case(scene, start, 0.8, {f"push{k}": foot.push for k, foot in feet.items()}, ac.when(at.velocity[2], "rising"))


def linkage() -> Case:
    """A closed loop whose coupler strikes a plane and rubs along it."""
    scene = FourBar()
    scene.touch = Touch(0.3, restitution=0.4)
    scene.connect(scene.coupler.at((0.6, 0.0, -0.3)), scene.touch.point)
    return Case(scene, {scene.a.q: -1.2, scene.a.v: 0.0}, 1.5, {"push": scene.touch.push}, ac.when(scene.a.v))


def bearing() -> Case:
    """A pendulum in a plain bearing, which is loaded by its own friction too."""
    scene = pendulum()
    q, v = scene.hinge.q, scene.hinge.v
    return Case(scene, {q: 2.5, v: 0.0}, 3.0, {"drag": scene.bearing.drag[0]}, ac.when(q))


class Thrower(ac.Component):
    """Pulls down, until what hangs on it has come down twice; and throws it up again where it strikes."""

    flange = ac.Translational.port()
    v = ac.Variable("m/s")

    def __init__(self) -> None:
        self.count, self.pull = ac.Discrete(), ac.Discrete("N", start=-3.0 * self.flange.s)

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.v, ac.der(self.flange.s))
        yield ac.equal(self.flange.f, -1.0 * self.pull)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.when(self.flange.s - 0.2, "falling", set={self.count: self.count + 1.0})
        yield ac.when(self.count - 1.5, "rising", set={self.pull: 0.5 * self.pull - 1.0})
        yield ac.when(self.flange.s - 0.1, "rising", set={self.v: self.v + 0.3})


def thrower() -> Case:
    """Counts, sets what it pulls with, and bounces."""
    scene = bouncing(0.9)
    scene.thrower = Thrower()
    scene.connect(scene.mass.flange_b, scene.thrower.flange)
    s, v = scene.mass.s, scene.mass.v
    return Case(scene, {s: 1.0, v: 0.0}, 1.6, {"pull": scene.thrower.pull, "push": scene.floor.push}, ac.when(s - 0.15, "rising"))


def caught() -> Case:
    """A pendulum that a wall catches at its end, and lets go."""
    scene = ac.System()
    scene.world, scene.hinge, scene.arm = World(), Revolute("y"), RigidBody(1.0, (0.1, 0.1, 0.1), (0.0, 0.0, -0.8))
    q, v = scene.hinge.q, scene.hinge.v
    scene.catch = PointLatch(closes=q - 0.7, opens=ac.time - 0.4)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.arm.frame)
    scene.connect(scene.world.at((-0.8 * np.sin(0.7), 0.0, -0.8 * np.cos(0.7))), scene.catch.frame_a)
    scene.connect(scene.catch.frame_b, scene.arm.at((0.0, 0.0, -0.8)))
    return Case(scene, {q: -0.3, v: 9.0}, 0.8, {"grip": scene.catch.force[2], "held": scene.catch.held}, ac.when(q - 0.3))


def rectifier() -> Case:
    """Four diodes between inductors on both sides and a store: some currents follow at once in some modes, and through states in others."""
    scene = bridge(5e-3, 0.05, 1e-3, 1e-3, True)
    start = {scene.line.i: 0.0, scene.choke.i: 0.0, scene.store.v: 0.0}
    seen = {"flows": scene.diodes[0].current, "over": scene.diodes[1].v}
    return Case(scene, start, 0.1, seen, ac.when(scene.store.v - 2.0))


MADE: dict[str, Callable[[], Case]] = {
    made.__name__: made for made in (ball, belt, slide, box, linkage, bearing, thrower, caught, rectifier)
}
BOX = pytest.param("box", marks=pytest.mark.slow)
NAMES = [BOX if name == "box" else name for name in MADE]
METHODS = {"auto": AUTO, "gauss": GAUSS, "radau": RADAU}
SCRATCH = tempfile.TemporaryDirectory()


@functools.cache
def exported(name: str) -> tuple[Case, ac.Model, Library]:
    case = MADE[name]()
    model = ac.build(case.scene)
    folder = model.export_simulator(Path(SCRATCH.name) / name, case.start, outputs=case.seen, events=[case.event])
    return case, model, Library(folder)


def looked_at(run: ac.Trajectory, end: float) -> np.ndarray:
    """Times, among them those a few roundings after changes of mode: some are found only as the next step begins."""
    return np.unique(np.concatenate([np.linspace(0, end, 33), np.array(changes(run)[:-1]) * (1 + 1e-15)]))


@pytest.mark.parametrize("name", NAMES)
def test_whatever_opens_sticks_or_strikes_the_bits_are_those_of_the_package(name: str) -> None:
    case, model, library = exported(name)
    for method, options in (("auto", {"rtol": 1e-9}), ("radau", {"rtol": 1e-6}), ("gauss", {"rtol": 1e-6, "max_step": 0.03})):
        run = model.simulate(case.end, case.start, method=method, **options)
        times = looked_at(run, case.end)
        chosen = library.options(method=METHODS[method], **options)
        report, x = library.simulate(times, options=chosen)
        assert (report.status, report.steps) == (SUCCESS, run.statistics.steps), report.message
        assert np.array_equal(x, run.at(times).x)


@pytest.mark.parametrize("name", NAMES)
def test_outputs_read_the_reactions_of_their_time_and_events_are_found_alike(name: str) -> None:
    case, model, library = exported(name)
    run = model.simulate(case.end, case.start, rtol=1e-8, events=[case.event])
    met = run.solution.modes
    assert met is not None
    times = looked_at(run, case.end)
    instance = library.instance()
    assert instance.started() == instance.set_end(case.end) == SUCCESS
    found, seen = [], [instance.all(OUTPUT)]  # before anything has moved
    for t in times:
        found += [(event.time, instance.x) for event in instance.events(t)]
        seen.append(instance.all(OUTPUT))
    assert [t for t, _ in found] == [event.time for event in run.events] and found
    there = run.at([t for t, _ in found]).x  # an event may be found one step later, where it is between two steps
    np.testing.assert_allclose(np.array([x for _, x in found]).T, there, rtol=0, atol=1e-12 * np.max(np.abs(there)))
    ours = np.array([run.at(times)[e] for e in case.seen.values()]).T
    ours = np.vstack([ours[:1], ours])
    np.testing.assert_allclose(np.array(seen), ours, rtol=1e-9, atol=1e-9 * np.max(np.abs(ours)))
    last = instance.change()
    assert last.count == len(met.changes) and last.time == met.begins[-1] and last.part


@pytest.mark.parametrize("name", ["ball", BOX, "linkage"])
def test_copies_go_their_own_way_from_wherever_they_are_made(name: str) -> None:
    """Also at an impact, with the memory of the original overwritten; and after a reset everything begins anew."""
    case, model, library = exported(name)
    end, impact = case.end, changes(model.simulate(case.end, case.start))[0]
    alone, whole = library.instance(), library.instance()
    assert alone.started() == alone.set_end(end) == whole.started() == whole.set_end(end) == SUCCESS
    list(whole.events(end))
    for t in (0.4 * impact, impact, 0.5 * (impact + end)):
        list(alone.events(t))
        copy = alone.copied()
        ctypes.memset(alone.memory, 0xFF, len(alone.memory))
        alone = copy
    list(alone.events(end))
    assert np.array_equal(alone.x, whole.x) and alone.summary().steps == whole.summary().steps
    assert (alone.change().count, alone.change().time) == (whole.change().count, whole.change().time)
    whole.reset()
    assert whole.change().count == 0
    assert whole.started() == whole.set_end(end) == SUCCESS
    list(whole.events(end))
    assert np.array_equal(alone.x, whole.x)


@pytest.mark.parametrize("name", NAMES)
def test_real_time_in_short_periods_and_pieces_that_begin_anew_make_the_same_motion(name: str) -> None:
    """Without an end, step by step; every period the inputs are renewed, so that modes are decided anew from states that are given."""
    case, model, library = exported(name)
    end = 0.5 * case.end
    x = model.simulate(end, case.start, rtol=1e-10).x[:, -1]
    for renewed in (False, True):
        instance = library.instance(library.options(rtol=1e-10))
        assert instance.started() == SUCCESS
        for t in np.linspace(0, end, 41)[1:]:
            list(instance.events(t))
            if renewed:
                assert instance.renew() == SUCCESS
        assert np.max(np.abs(instance.x - x)) < 1e-7 * max(1.0, np.max(np.abs(x)))
        assert instance.change().count > 1


def test_masks_are_no_inputs() -> None:
    case, model, library = exported("slide")
    assert library.c_count(INPUT) == len(model.input_names) - model.functions.integrand.masks == 0
    assert library.names(OUTPUT) == list(case.seen)


def test_a_start_below_the_floor_is_refused_in_words() -> None:
    _, _, library = exported("ball")
    instance: Instance = library.instance()
    assert instance.set(CONDITION, library.names(CONDITION).index("mass.s"), -0.1) == SUCCESS
    assert instance.started() == SUCCESS
    assert instance.advance(1.0) == OVERLAPS
    assert re.fullmatch(r"The gap of floor .*is negative at the start, or after a jump of an input\.", instance.words())
    assert instance.advance(1.0) == OVERLAPS
    assert instance.set(CONDITION, library.names(CONDITION).index("mass.s"), 1.0) == instance.started() == SUCCESS
    assert instance.advance(0.1) == SUCCESS and instance.get(STATE, 0) < 1.0


@pytest.mark.slow
def test_what_is_held_at_the_start_is_assembled_with_other_start_values_too() -> None:
    scene = ac.System()
    scene.world, scene.hinge, scene.arm = World(), Revolute("y"), RigidBody(1.0, (0.1, 0.1, 0.1), (0.0, 0.0, -0.8))
    scene.load, scene.ball = Particle(0.3), RigidBody.ball(0.2, 0.1, position=(0.1, 0.2, -0.3))
    scene.tie, scene.hand = PointLatch(held=True, opens=ac.time - 0.2), Gripper(held=True, opens=ac.time - 0.1)
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.arm.frame)
    for at, held, end in ((-0.8, scene.tie, scene.load.point), (-0.4, scene.hand, scene.ball.frame)):
        scene.connect(scene.arm.at((0, 0, at)), held.frame_a)
        scene.connect(held.frame_b, end)
    model = ac.build(scene)
    start = {scene.hinge.q: 0.3, scene.hinge.v: 2.0}
    library = Library(model.export_simulator(Path(SCRATCH.name) / "held", start))
    for q, v in ((0.3, 2.0), (0.3, 3.0), (-0.5, 1.0)):
        instance: Instance = library.instance()
        assert instance.set_values(CONDITION, [q, v]) == instance.started() == SUCCESS, instance.words()
        assert instance.advance(0.4) == SUCCESS, (q, v, instance.words())
        run = model.simulate(0.4, {scene.hinge.q: q, scene.hinge.v: v})
        assert np.allclose(instance.x, run.x[:, -1], rtol=0, atol=1e-7)


def test_an_event_that_stops_at_an_impact_stops_where_the_package_does() -> None:
    scene = bouncing(0.5)
    model = ac.build(scene)
    start, stop = {scene.mass.s: 1.0, scene.mass.v: 0.0}, ac.when(scene.mass.s, "falling", stop=True)
    folder = model.export_simulator(Path(SCRATCH.name) / "stopped", start, events=[stop])
    instance, run = Library(folder).instance(), model.simulate(2.0, start, events=[stop])
    assert instance.started() == instance.set_end(2.0) == SUCCESS
    status = instance.advance(2.0)
    assert status == STOPPED
    assert instance.time() == pytest.approx(run.t[-1], rel=1e-15)
    assert np.array_equal(instance.x, run.x[:, -1])
    met = run.solution.modes
    assert met is not None and instance.change().count == len(met.changes)


@pytest.mark.slow
def test_no_memory_is_taken_while_modes_change() -> None:
    """As for other instances."""
    _, _, library = exported("linkage")
    folder = library.path.parent
    main = COUNTED[: COUNTED.index("static int uses")] + USES + COUNTED[COUNTED.index("int main") :]
    (folder / "counted.c").write_text(main)
    made = program(folder, "counted.c", "-Wl,--wrap=malloc,--wrap=realloc,--wrap=calloc")
    result = subprocess.run([str(made)], capture_output=True, text=True)
    assert result.returncode == 0, result.stdout


USES = r"""
static int uses(simulator_instance *s) {
    double outputs[SIMULATOR_OUTPUTS];
    int bad = simulator_start(s, 0) + simulator_get_all(s, SIMULATOR_OUTPUT, outputs) + go(s, 0.6);
    simulator_instance *copy = simulator_copy(s, room[1], sizeof room[1]);
    bad += !copy || go(s, 0.7) + simulator_renew(s) + go(s, 0.78) + simulator_restore(copy, s) + go(copy, 1.5);
    bad += simulator_get_all(copy, SIMULATOR_OUTPUT, outputs) + simulator_change(copy).count < 3;
    simulator_reset(s);
    return bad + simulator_start(s, 1.0) + go(s, 2.5);
}
"""


def test_what_time_alone_moves_switches_in_the_program_too_where_nothing_has_a_state() -> None:
    speed, period = 7.0, 0.13
    scene = ac.System()
    scene.source, scene.sampler = TimeFunction(np.sin(speed * ac.time)), SampleAndHold(period)
    scene.connect(scene.source.output, scene.sampler.input)
    crossing = ac.when(scene.source.output.value)
    folder = ac.build(scene).export_simulator(
        Path(SCRATCH.name) / "clock", {}, outputs={"held": scene.sampler.output.value}, events=[crossing]
    )
    instance = Library(folder).instance()
    assert instance.started() == instance.set_end(2.0) == SUCCESS
    found: list[float] = []
    for t in (0.07, 0.4, 0.95, 1.37, 2.0):
        found += [event.time for event in instance.events(t)]
        assert instance.all(OUTPUT) == pytest.approx([np.sin(speed * period * np.floor(t / period))], abs=1e-12)
    assert found == pytest.approx(np.pi / speed * np.arange(1, 5), rel=1e-12)
