"""Instances of an exported simulator: motions that are set, moved, read, copied and given up, in one block of memory each."""

from __future__ import annotations

import ctypes
import functools
import re
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal as ac
from components import AngleSource, Particle, PointOnCurve, Prismatic, Revolute, RigidBody, SplineCurve, TorqueSource, World
from tests.exported import (
    AT_EVENT,
    BAD_ARGUMENT,
    CONDITION,
    EVENT,
    FLAGS,
    INPUT,
    OPEN_START,
    OTHER_MODEL,
    OUTPUT,
    PARAMETER,
    RADAU,
    STATE,
    STOPPED,
    SUCCESS,
    WARNINGS,
    InputFunction,
    Instance,
    Library,
    command,
    compile_quickly,
    program,
)
from tests.test_integrability import disk_on_a_line
from tests.test_sensitivity import AdjustableFourBar, Oscillator


class Scene(AdjustableFourBar):
    """A four-bar whose coupler may change its length, driven at its crank."""

    def __init__(self) -> None:
        super().__init__()
        self.c.q.start = 1.0  # the side to which it closes
        self.drive = ac.Input("N*m")
        self.motor = TorqueSource(self.drive)
        self.connect(self.motor.flange, self.a.flange)


@functools.cache
def driven():
    """Scene, model, start, events and library."""
    scene = Scene()
    model = ac.build(scene)
    start = {scene.a.q: 1.0, scene.a.v: 2.0}
    events = [ac.when(scene.a.q - 1.5, "rising"), ac.when(scene.a.v)]
    outputs = {"angle": scene.b.q, "tip": scene.b.frame_b.position, "power": scene.drive * scene.a.v}
    folder = Path(_scratch().name) / "driven"
    model.export_simulator(folder, start, outputs=outputs, events=events)
    return scene, model, start, events, outputs, Library(folder)


@functools.cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


def reached(instance: Instance, t: float) -> np.ndarray:
    """States at time t, past events."""
    list(instance.events(t))
    return instance.x


def methods(library: Library):
    """Options: none, Newton's memory, fixed steps."""
    return (
        None,
        library.options(method=RADAU, rtol=1e-6),
        library.options(step=0.01, order=8),
    )


@pytest.mark.parametrize("method", range(3))
def test_from_time_to_time_or_step_by_step_the_motion_is_that_of_one_run(method):
    _, _, _, _, _, library = driven()
    options = methods(library)[method]
    times = np.linspace(0, 2, 23)
    whole = library.simulate(times, options=options)[1]
    one, other = library.instance(options), library.instance(options)
    for instance in (one, other):
        assert instance.started() == instance.set_end(2.0) == SUCCESS
    assert np.array_equal(np.array([reached(one, t) for t in times]).T, whole)
    steps = 0
    while other.time() < 2.0:
        assert other.step(2.0) in (SUCCESS, AT_EVENT)
        steps += 1
    assert np.array_equal(other.x, whole[:, -1]) and other.summary().steps == one.summary().steps <= steps


def test_events_outputs_and_states_are_those_of_the_package():
    scene, model, start, events, outputs, library = driven()
    run = model.simulate(2.0, start, method="gauss", rtol=1e-8, events=events, inputs={scene.drive: 0.3})
    instance = library.instance()
    assert instance.set(INPUT, 0, 0.3) == instance.started() == instance.set_end(2.0) == SUCCESS
    found = []
    while (status := instance.advance(2.0)) == AT_EVENT:
        event = instance.event()
        found.append((event.time, event.event, instance.time() == event.time, instance.x))
    assert status == SUCCESS and len(found) == len(run.events) > 2
    for (time, number, there, x), event in zip(found, run.events, strict=True):
        assert (time, events[number], there) == (event.time, event.when, True)
        assert np.array_equal(x, run.at(time).x[:, 0])
    assert library.names(OUTPUT) == ["angle", "tip[0]", "tip[1]", "tip[2]", "power"] and library.units(OUTPUT)[:2] == ["rad", "m"]
    expected = np.concatenate([np.ravel(run.at(2.0)[value][-1]) for value in outputs.values()])
    assert np.max(np.abs(instance.all(OUTPUT) - expected)) < 1e-14
    assert library.names(EVENT) == ["(a.q-1.5)", "a.v"] and np.isnan(instance.get(EVENT, 0))


@pytest.mark.parametrize("method", range(3))
def test_a_copy_shares_no_memory_and_both_go_on_alike(method):
    library = driven()[-1]
    instance = library.instance(methods(library)[method])
    assert instance.started() == instance.set_end(3.0) == SUCCESS
    halfway = reached(instance, 1.3)
    copied, saved = instance.copied(), instance.copied()
    first, size = ctypes.addressof(instance.memory), len(instance.memory)
    words = np.frombuffer(copied.memory, dtype=np.uintp, count=size // 8)
    assert not np.any((words >= first) & (words < first + size))
    end = reached(instance, 3.0)
    ctypes.memset(first, 0xFF, size)  # whatever it was, the copies do not look at it
    assert np.array_equal(copied.x, halfway) and np.array_equal(reached(copied, 3.0), end)
    assert copied.restore(saved.address) == SUCCESS
    assert np.array_equal(copied.x, halfway) and np.array_equal(reached(copied, 3.0), end)
    assert np.array_equal(reached(saved, 3.0), end)
    other = library.instance(library.options(method=RADAU, order=13))
    assert method == 1 or other.restore(saved.address) == BAD_ARGUMENT


def test_reset_gives_an_instance_as_it_was_created():
    library = driven()[-1]
    instance = library.instance()
    assert instance.started() == SUCCESS
    first = reached(instance, 1.0)
    assert instance.set(PARAMETER, 0, 1.25) == instance.set(INPUT, 0, 2.0) == instance.set(CONDITION, 0, 2.0) == SUCCESS
    assert instance.started(0.5) == SUCCESS and not np.allclose(reached(instance, 1.5), first)
    assert instance.event().event >= 0
    instance.reset()
    assert instance.advance(1.0) == BAD_ARGUMENT and instance.words() == "There is no motion yet: start it."
    assert instance.event().event == -1 and np.isnan([instance.event().time, instance.change().time]).all()
    assert instance.started() == SUCCESS and np.array_equal(reached(instance, 1.0), first)


def test_loops_that_parameters_bring_to_a_singular_position_are_told_where_they_come_to_it():
    """With a coupler of 0.6 m the bars come to lie on one line: the model that is exported knows no way through. In any size, and only then."""
    scene, model, _, _, _, library = driven()
    for length in (0.6, 0.75, 1.1):
        start, instance = {scene.a.q: 1.0, scene.a.v: 4.0}, library.instance()
        assert instance.set(PARAMETER, list(model.parameter_names).index("length"), length) == SUCCESS
        assert instance.set(CONDITION, 1, 4.0) == SUCCESS and instance.started() == SUCCESS
        run = model.simulate(2.0, start, parameters={scene.length: length})
        status = AT_EVENT
        while status == AT_EVENT:
            status = instance.advance(2.0)
        if length != 0.6:
            assert status == SUCCESS and np.max(np.abs(instance.x - run.x[:, -1])) < 1e-6
            continue
        assert status == OTHER_MODEL and instance.advance(2.0) == OTHER_MODEL
        near = run.at([instance.time()])
        assert abs(np.sin(near[scene.a.q][0])) < 1e-2 and np.max(np.abs(near.x[:, 0] - instance.x)) < 1e-2


def test_inputs_and_parameters_that_are_set_on_the_way_begin_a_new_piece():
    """As a run of the package that starts where the one before ended."""
    scene, model, start, _, _, library = driven()
    instance = library.instance(library.options(rtol=1e-10))
    assert instance.started() == SUCCESS
    x, t = model.initial_state(start).x, 0.0
    for k, torque in enumerate((1.0, -2.0, 0.5)):
        assert instance.set(INPUT, 0, torque) == SUCCESS
        here = dict(zip(model.state_names, x, strict=True))
        near = {getattr(scene, name[0]).q: ac.near(here[name]) for name in here if name[1:] == ".q" and name[0] != "a"}
        given = {scene.a.q: here["a.q"], scene.a.v: here["a.v"], **near}
        x = model.simulate(t + 0.4, given, t0=t, rtol=1e-10, inputs={scene.drive: torque}).x[:, -1]
        t += 0.4
        assert np.max(np.abs(reached(instance, t) - x)) < 1e-8, k
    steps = instance.summary().steps
    assert instance.set(PARAMETER, 0, 3.0) == instance.set(INPUT, 0, 0.1) == SUCCESS  # a coupler that cannot close the loop here
    assert instance.advance(2.0) == OPEN_START and instance.time() == t and instance.summary().steps == steps
    assert instance.advance(2.0) == OPEN_START
    assert instance.set(PARAMETER, 0, 1.2) == instance.started() == SUCCESS


def test_control_in_short_periods_costs_a_step_each():
    """A new piece goes on with the step size of the one before."""
    library = driven()[-1]
    instance = library.instance(library.options(rtol=1e-6))
    assert instance.started() == SUCCESS
    for k in range(1, 201):
        assert instance.set(INPUT, 0, 0.1 * np.sin(0.1 * k)) == SUCCESS
        reached(instance, 0.01 * k)
    assert instance.summary().steps < 230
    rejected: list[int] = []
    for k, torque in enumerate((1e4, 0.0, 0.0, 0.0)):  # steps were too long for the first, and not for the last
        assert instance.set(INPUT, 0, torque) == SUCCESS
        reached(instance, 2.0 + 0.01 * (k + 1))
        rejected.append(instance.summary().rejected)
    assert rejected[0] > 0 and rejected == sorted(rejected)


def test_what_has_died_away_is_judged_beside_what_it_was_in_new_pieces_too(tmp_path):
    scene = Oscillator(damping=0.1)
    library = Library(ac.build(scene).export_simulator(tmp_path, {scene.rail.q: 0.3}))
    steps: list[int] = []
    for pieces in (1, 10):
        instance = library.instance()
        assert instance.started() == SUCCESS
        for t in np.linspace(400.0, 500.0, pieces + 1):
            assert instance.renew() == instance.advance(t) == SUCCESS
        steps.append(instance.summary().steps)
    assert steps[1] <= steps[0] + 15


def test_a_new_start_forgets_the_motion_before_also_where_it_fails():
    library = driven()[-1]
    fresh, instance = library.instance(), library.instance()
    assert fresh.started() == instance.started() == SUCCESS
    reached(instance, 2.0)
    assert instance.event().event >= 0 and instance.started() == SUCCESS
    assert instance.event().event == -1 and instance.change().count == fresh.change().count
    assert reached(instance, 0.1).tobytes() == reached(fresh, 0.1).tobytes()
    assert instance.summary().steps == fresh.summary().steps
    assert instance.set(CONDITION, 0, np.nan) == SUCCESS and instance.started() == OPEN_START
    assert [getattr(instance.summary(), name) for name in ("steps", "evaluations", "samples", "time")] == [0, 0, 0, 0]


def test_starts_are_those_of_their_time_and_values_whatever_was_started_before(tmp_path):
    """A disk that rolls on a line keeps where it began as a constant; a crank that time turns is where its time says."""
    scene = disk_on_a_line()
    start = {scene.rail.q: 0.3, scene.hub.q: 0.1, scene.rail.v: 1.0}
    library = Library(ac.build(scene).export_simulator(tmp_path / "disk", start, outputs={"x": scene.rail.q}))
    instance, place = library.instance(), library.names(CONDITION).index("rail.q")
    for x in (0.3, 2.0, 0.3):
        assert instance.set(CONDITION, place, x) == instance.started() == instance.advance(1.0) == SUCCESS
        assert instance.get(OUTPUT, 0) == pytest.approx(x + 1, abs=1e-13)
    led = AdjustableFourBar()
    led.turn = ac.Input("rad")
    led.drive = AngleSource(led.turn + 1.0 + 0.5 * np.sin(ac.time))
    led.connect(led.drive.flange, led.a.flange)
    near = {led.b.q: ac.near(0.3)}
    model = ac.build(led)
    library = Library(model.export_simulator(tmp_path / "led", near, outputs={"a": led.a.q}))
    instance = library.instance()
    for t, turn in ((0.0, 0.0), (0.7, 0.0), (-2.0, 0.3), (0.0, 0.2), (0.0, 0.0)):
        assert instance.set(INPUT, 0, turn) == instance.started(t) == SUCCESS
        assert instance.get(OUTPUT, 0) == pytest.approx(turn + 1 + 0.5 * np.sin(t), abs=1e-13)
        assert instance.x == pytest.approx(model.initial_state(near, t0=t, inputs={led.turn: turn}).x, abs=1e-12)


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_lengths_that_make_a_parallelogram_need_a_model_of_their_own(size, tmp_path):
    """It lies flat twice in a turn, which the four-bar that was exported does not."""
    scene = ac.System()
    scene.world, scene.far = World(), ac.Parameter(1.05 * size, "m")
    scene.bars = [RigidBody.rod(1.0, (length * size, 0, 0)) for length in (0.4, 1.0, 0.4)]
    scene.hinges = [Revolute("y") for _ in range(4)]
    ends = [scene.world.frame, *(bar.tip for bar in scene.bars)]
    begins = [*(bar.frame for bar in scene.bars), scene.world.at((scene.far, 0, 0))]
    for hinge, end, begin in zip(scene.hinges, ends, begins, strict=True):
        scene.connect(end, hinge.frame_a)
        scene.connect(hinge.frame_b, begin)
    start = {scene.hinges[0].q: 1.0, scene.hinges[1].q: ac.near(-1.0), scene.hinges[2].q: ac.near(1.0 + np.pi)}
    instance = Library(ac.build(scene).export_simulator(tmp_path / "bars", start)).instance()
    for far, status in ((1.05, SUCCESS), (1.02, SUCCESS), (1.0, OTHER_MODEL)):
        assert instance.set(PARAMETER, 0, far * size) == SUCCESS
        assert instance.started() == status


def test_calls_that_make_no_sense_are_told_and_change_nothing():
    library = driven()[-1]
    instance = library.instance()
    assert np.isnan(instance.get(OUTPUT, 0)) and instance.words() == "Outputs need a start."
    assert instance.started() == instance.set_end(1.0) == SUCCESS
    first = reached(instance, 0.5)
    for t in (0.4, np.nan, np.inf, 1.1):
        assert instance.advance(t) == instance.step(t) == BAD_ARGUMENT
    assert instance.started(np.nan) == BAD_ARGUMENT
    for kind, i in ((OUTPUT, 0), (EVENT, 0), (STATE, 99), (PARAMETER, -1), (-1, 0), (17, 0)):
        assert instance.set(kind, i, 1.0) == BAD_ARGUMENT and (kind in (OUTPUT, STATE) or np.isnan(instance.get(kind, i)))
    assert instance.set_end(0.1) == BAD_ARGUMENT
    assert np.array_equal(instance.x, first) and np.all(reached(instance, 0.6) != first)
    size = library.c_size(None)
    assert not library.c_create(None, ctypes.addressof(ctypes.create_string_buffer(size)), size - 1)


def test_inputs_by_a_function_get_the_users_pointer_and_may_give_up():
    library = driven()[-1]
    seen: list[int] = []

    @InputFunction
    def drive(user, t, u):
        seen.append(user)
        u[0] = 0.5 * t
        return t < 1

    number = ctypes.c_double(1.0)
    instance = library.instance(library.options(input=drive, user=ctypes.addressof(number)))
    assert instance.started() == SUCCESS and set(seen) == {ctypes.addressof(number)}
    assert instance.set(INPUT, 0, 1.0) == BAD_ARGUMENT
    reached(instance, 0.5)
    assert instance.get(INPUT, 0) == 0.25 and instance.renew() == SUCCESS
    assert any(instance.advance(3.0) == 7 for _ in range(5)) and instance.time() < 1


def test_a_ball_that_bounces_by_states_that_are_set(tmp_path):
    """Speeds change sign at each stop: after n bounces without loss it is where it was."""
    scene = ac.System()
    scene.world, scene.rail, scene.ball = World((0, 0, -9.81)), Prismatic("z"), Particle(1.0)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.ball.point)
    ground = ac.when(scene.rail.q, "falling", stop=True)
    library = Library(ac.build(scene).export_simulator(tmp_path, {scene.rail.q: 1.0}, events=[ground]))
    instance, times = library.instance(), []
    assert instance.started() == SUCCESS
    while (status := instance.advance(5.0)) == STOPPED:
        assert instance.advance(5.0) == STOPPED  # nothing was set: it stays
        times.append(instance.time())
        assert instance.set(STATE, 1, -instance.get(STATE, 1)) == SUCCESS
    assert status == SUCCESS
    fall = np.sqrt(2 / 9.81)
    assert np.max(np.abs(np.array(times) - fall * np.arange(1, 2 * len(times), 2))) < 1e-9 and len(times) == 6


def test_a_motion_ends_where_a_part_has_no_meaning_any_more(tmp_path):
    """Where that of the package does, with the part's name."""
    scene = ac.System()
    scene.world, scene.track, scene.car = World((0, 0, -9.81)), PointOnCurve(SplineCurve(np.eye(3))), Particle(1.0)
    scene.connect(scene.world.frame, scene.track.frame_a)
    scene.connect(scene.track.frame_b, scene.car.point)
    model, start = ac.build(scene), {scene.track.q: 1.0, scene.track.v: 4.0}
    run = model.simulate(2.0, start, raise_on_failure=False)
    folder = model.export_simulator(tmp_path, start, events=[ac.when(scene.track.q - 1.2)])
    instance = Library(folder).instance()
    assert instance.started() == SUCCESS
    while (status := instance.advance(2.0)) == AT_EVENT:
        pass
    assert status == STOPPED and instance.time() == run.t[-1]
    assert "border_of_track_1" in (folder / "simulator.h").read_text()


def test_instances_move_side_by_side_in_threads():
    library = driven()[-1]

    def end(speed: float) -> np.ndarray:
        instance = library.instance()
        assert instance.set(CONDITION, 1, speed) == instance.started() == SUCCESS
        return np.array([reached(instance, t) for t in np.linspace(0.1, 2, 20)])

    speeds, together = np.linspace(1, 4, 8), {}
    alone = [end(speed) for speed in speeds]
    threads = [threading.Thread(target=lambda s=s: together.update({s: end(s)})) for s in speeds]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(together[s], x) for s, x in zip(speeds, alone, strict=True))


COUNTED = r"""
#include <stdio.h>
#include <stdlib.h>
#include "simulator.h"
static long taken;
void *__real_malloc(size_t bytes);
void *__real_realloc(void *block, size_t bytes);
void *__real_calloc(size_t count, size_t bytes);
void *__wrap_malloc(size_t bytes);
void *__wrap_realloc(void *block, size_t bytes);
void *__wrap_calloc(size_t count, size_t bytes);
void *__wrap_malloc(size_t bytes) { taken++; return __real_malloc(bytes); }
void *__wrap_realloc(void *block, size_t bytes) { taken++; return __real_realloc(block, bytes); }
void *__wrap_calloc(size_t count, size_t bytes) { taken++; return __real_calloc(count, bytes); }
static char room[2][4000000];
static int go(simulator_instance *s, double t) {
    int status;
    while ((status = simulator_advance(s, t)) == SIMULATOR_AT_EVENT) {}
    return status;
}
static int uses(simulator_instance *s) {
    double x[SIMULATOR_STATES];
    simulator_set(s, SIMULATOR_PARAMETER, 0, 1.21);
    simulator_set(s, SIMULATOR_CONDITION, 0, 0.9);
    int bad = simulator_start(s, 0) + go(s, 1.0);
    simulator_instance *copy = simulator_copy(s, room[1], sizeof room[1]);
    bad += !copy || simulator_set(s, SIMULATOR_INPUT, 0, 1.0) + go(s, 2.0) + simulator_restore(copy, s) + go(copy, 3.0);
    bad += simulator_get_all(copy, SIMULATOR_STATE, x) + !(simulator_get(copy, SIMULATOR_OUTPUT, 0) < 1e9);
    simulator_reset(s);
    return bad + simulator_start(s, 1.0) + go(s, 2.0);
}
int main(void) {
    simulator_options options = simulator_defaults();
    for (int radau = 0; radau < 2; radau++) {
        options.method = radau ? SIMULATOR_RADAU : SIMULATOR_GAUSS;
        taken = 0;
        int bad = uses(simulator_create(&options, room[0] + 8, sizeof room[0] - 8));
        long here = taken;
        simulator_instance *s = simulator_create(&options, 0, 0);
        bad += uses(s);
        simulator_free(s);
        if (bad || here || taken != 1) { printf("%d %ld %ld\n", bad, here, taken); return 1; }
    }
    return 0;
}
"""


@pytest.mark.slow
def test_no_memory_is_taken_after_an_instance_is_made():
    """Not a call of malloc while it starts, moves, is set, read, copied and reset; none at all in memory of the caller."""
    folder = driven()[-1].path.parent
    (folder / "counted.c").write_text(COUNTED)
    made = program(folder, "counted.c", "-Wl,--wrap=malloc,--wrap=realloc,--wrap=calloc")
    result = subprocess.run([str(made)], capture_output=True, text=True)
    assert result.returncode == 0, result.stdout


@pytest.mark.slow
def test_the_instances_compile_without_a_warning_as_c11_too():
    folder = driven()[-1].path.parent
    warnings = ["-std=c11" if w == "-std=c99" else w for w in WARNINGS]
    for source in ("simulator.c", "model.c", "main.c", "runtime.c"):
        subprocess.run([*command(), *warnings, "-march=native", "-fsyntax-only", source], cwd=folder, check=True)


@pytest.mark.slow
def test_the_examples_in_the_docs_run(tmp_path, monkeypatch):
    """In C and in Python, from the text of docs/export.md; the motion is that of the package."""
    text = (Path(__file__).parents[1] / "docs" / "export.md").read_text(encoding="utf-8")
    (scene, ours, unit), (example, *_) = (
        re.findall(r"```python\n(.*?)```", text, re.DOTALL),
        re.findall(r"```c\n(.*?)```", text, re.DOTALL),
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MAKEFLAGS", r"-- CFLAGS=-O0\ -march=native\ -ffp-contract=off\ -fno-math-errno\ -Wno-psabi")
    names: dict[str, Any] = {}
    compile_quickly(monkeypatch)
    exec(scene + ours + unit, names)
    run = names["model"].simulate(2.0, {names["scene"].shoulder.q: 0.6}, method="gauss", rtol=1e-8)
    assert names["status"] == SUCCESS and abs(names["angle"] - run.x[0, -1]) < 1e-13
    heavy = names["model"].simulate(2.0, {names["scene"].shoulder.q: 0.3}, parameters={names["scene"].mass: 2.0}, rtol=1e-8)
    assert abs(names["found"]["tip[2]"][-1] - heavy[names["scene"].upper.tip.position][-1, 2]) < 1e-6
    Path("arm/use.c").write_text(example)
    line = [*command(), *WARNINGS, *FLAGS, "-o", "use", "use.c", "arm.o", "model.o", "runtime.o", "-lm"]
    subprocess.run(line, cwd="arm", check=True)
    told = subprocess.run(["arm/use"], capture_output=True, text=True, check=True).stdout
    assert told.startswith("hangs down at 0.4") and "tip at x = " in told
