"""The exported simulator: the numbers of the package from C that stands by itself; starts and failures told as data."""

from __future__ import annotations

import ctypes
import functools
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

import acausal as ac
from acausal.errors import ExportError, UnknownVariableError
from components import Capacitor, Diode, Force, Ground, Particle, Prismatic, Resistor, Revolute, RigidBody, World
from tests.exported import (
    BAD_ARGUMENT,
    CONDITION,
    FAILED_INPUT,
    FLAGS,
    INPUT,
    MAX_STEPS,
    NON_FINITE,
    OPEN_START,
    PARAMETER,
    RADAU,
    STATE,
    SUCCESS,
    WARNINGS,
    InputFunction,
    Library,
    command,
    compiled,
    printed,
    program,
    runtime,
)
from tests.scenes import DoublePendulum, FourBar
from tests.test_minimal import slider_crank
from tests.test_sensitivity import AdjustableFourBar, Oscillator


def pendulum():
    scene = DoublePendulum()
    return ac.build(scene), {scene.shoulder.q: 0.6, scene.elbow.v: 5.0}, 4.0


def four_bar():
    scene = FourBar()
    return ac.build(scene), {scene.a.q: 1.0, scene.a.v: 6.0}, 2.0


def stiff():
    scene = Oscillator(damping=1e5)
    return ac.build(scene), {scene.rail.q: 0.3, scene.rail.v: 1.0}, 2.0


SCENES = {scene.__name__: scene for scene in (pendulum, four_bar, stiff)}


@functools.cache
def exported(name: str):
    """Model, start, end and library of a scene."""
    model, start, end = SCENES[name]()
    folder = Path(_scratch().name) / name
    model.export_simulator(folder, start)
    return model, start, end, Library(folder)


@functools.cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


@pytest.mark.parametrize(
    ("name", "method", "rtol"),
    [("pendulum", "gauss", 1e-3), ("pendulum", "gauss", 1e-10), ("pendulum", "radau", 1e-7), ("four_bar", "gauss", 1e-10),
     ("four_bar", "radau", 1e-8), ("stiff", "gauss", 1e-6), ("stiff", "radau", 1e-3), ("stiff", "radau", 1e-12)],
)  # fmt: skip
def test_the_numbers_are_those_of_the_package_to_the_last_bit(name, method, rtol):
    model, start, end, library = exported(name)
    times = np.linspace(0, end, 57)
    report, x = library.simulate(times, options=library.options(rtol=rtol, method=("gauss", "radau").index(method)))
    run = model.simulate(end, start, rtol=rtol, method=method)
    assert (report.status, report.samples, report.steps) == (SUCCESS, 57, run.statistics.steps)
    assert np.array_equal(x, run.at(times).x)


def test_a_stiff_model_makes_gauss_solve_by_newton():
    """Otherwise the comparison above would not see the decision between the two."""
    model, start, end, _ = exported("stiff")
    statistics = model.simulate(end, start, rtol=1e-6, method="gauss").statistics
    assert statistics.method == "gauss with Newton"


@pytest.fixture(scope="module")
def oscillator(tmp_path_factory: pytest.TempPathFactory):
    scene = Oscillator(damping=0.1)
    model = ac.build(scene)
    return scene, model, Library(model.export_simulator(tmp_path_factory.mktemp("oscillator"), {scene.rail.q: 0.3}))


def test_the_program_prints_these_numbers(oscillator):
    scene, model, library = oscillator
    head, table = printed(program(library.path.parent), 2.0, 7, 1e-9)
    run = model.simulate(2.0, {scene.rail.q: 0.3}, rtol=1e-9, method="gauss")
    assert head == ["t", *model.state_names]
    assert np.array_equal(table[:, 0], np.linspace(0, 2, 7))
    assert np.array_equal(table[:, 1:].T, run.at(table[:, 0]).x)


@pytest.mark.parametrize("words", [(), ("x",), ("1", "1"), ("1", "2.5"), ("1", "5", "7"), ("1", "5", "1e-8", "euler"), ("-1",)])
def test_wrong_words_show_the_usage(oscillator, words):
    made = oscillator[2].path.parent / "main"
    if not made.exists():
        program(made.parent)
    run = subprocess.run([str(made), *words], capture_output=True, text=True)
    assert run.returncode == 2
    assert run.stderr.startswith("usage:")
    assert not run.stdout


@pytest.mark.slow
def test_the_line_in_the_readme_and_the_makefile_build_it(oscillator, tmp_path):
    library = oscillator[2]
    folder = shutil.copytree(library.path.parent, tmp_path / "copy", ignore=shutil.ignore_patterns("*.so", "main"))
    line = next(line for line in (folder / "README.txt").read_text().splitlines() if line.strip().startswith("cc "))
    subprocess.run(line.replace("-O2", "-O0").split(), cwd=folder, check=True)
    expected = printed(folder / "simulator", 1)[1]
    (folder / "simulator").unlink()
    flags = "-O0 -march=native -ffp-contract=off -fno-math-errno -Wno-psabi"
    subprocess.run(["make", "-s", f"CFLAGS={flags}"], cwd=folder, check=True)
    assert np.array_equal(printed(folder / "simulator", 1)[1], expected)
    assert (folder / "libsimulator.so").exists()


@pytest.mark.slow
def test_another_compiler_gives_the_same(tmp_path):
    """As libm of the two may differ, the same to rounding."""
    _, _, end, library = exported("four_bar")
    made = tmp_path / "library.so"
    objects = [tmp_path / f"{name}.o" for name in ("simulator", "model", "runtime")]
    for each in objects:
        line = [
            sys.executable,
            "-m",
            "ziglang",
            "cc",
            *FLAGS,
            "-O0",
            "-Wno-psabi",
            "-fsanitize-trap=undefined",
            "-c",
            "-o",
            str(each),
            f"{each.stem}.c",
        ]
        subprocess.run(line, cwd=library.path.parent, check=True)
    subprocess.run(
        [*command(), "-shared", "-o", str(made), *map(str, objects), "-lm"], check=True
    )  # linked by the one that is there
    times = np.linspace(0, end, 40)
    other = Library.__new__(Library)
    (tmp_path / "libsimulator.so").symlink_to(made)
    other.__init__(tmp_path)
    options = library.options(rtol=1e-12)
    assert np.max(np.abs(other.simulate(times, options=options)[1] - library.simulate(times, options=options)[1])) < 1e-12


def test_values_inputs_and_methods_of_a_whole_motion(oscillator):
    scene, model, library = oscillator
    start, p = {scene.rail.q: 0.25, scene.rail.v: -1.0}, {scene.stiffness: 9.0, scene.mass: 2.0}
    times, x0, values = [1.0, 1.5, 3.0], [0.25, -1.0], [9.0, 2.0]

    @InputFunction
    def push(user, t, u):
        u[0] = ctypes.cast(user, ctypes.POINTER(ctypes.c_double))[0] - 2 * t
        return 1

    three = ctypes.c_double(3.0)
    driven = {"input": push, "user": ctypes.addressof(three)}

    def same(found, **options) -> bool:
        run = model.simulate(3.0, **({"start": start, "method": "gauss"} | options))
        assert (found[0].status, found[0].samples, found[0].steps) == (SUCCESS, 3, run.statistics.steps)
        return np.array_equal(found[1], run.at(times).x)

    slope = {scene.push: lambda t: 3 - 2 * t}
    assert same(library.simulate(times), start={scene.rail.q: 0.3})
    assert same(library.simulate(times, 1.0, x0, [1.5], values), t0=1.0, parameters=p, inputs={scene.push: 1.5})
    assert same(library.simulate(times, 0, x0, None, values, library.options(**driven)), parameters=p, inputs=slope)
    finest = [library.simulate(times, options=library.options(rtol=rtol))[1] for rtol in (1e-15, 1e-30)]
    assert np.array_equal(*finest)
    fixed = library.options(**driven, step=0.03, order=8)
    assert same(library.simulate(times, 0, x0, None, values, fixed), parameters=p, inputs=slope, step=0.03, order=8)
    radau = library.options(**driven, step=0.02, order=5, method=RADAU)
    assert same(
        library.simulate(times, 0, x0, None, values, radau), parameters=p, inputs=slope, step=0.02, order=5, method="radau"
    )


def test_what_a_call_cannot_do_is_a_status_in_words(oscillator):
    scene, model, library = oscillator
    times = [1.0, 1.5, 3.0]
    short = model.simulate(3.0, {scene.rail.q: 0.3}, max_steps=4, raise_on_failure=False, method="gauss")
    report, x = library.simulate(times, options=library.options(max_steps=4))
    assert (report.status, report.message, report.steps) == (MAX_STEPS, b"4 steps were not enough.", 4)
    assert report.time == short.status.time and report.samples == sum(t <= short.status.time for t in times)
    assert np.isnan(x[:, report.samples :]).all()
    stopped = library.simulate(times, options=library.options(input=InputFunction(lambda _, t, u: t < 0.5)))[0]
    assert (stopped.status, stopped.message) == (FAILED_INPUT, b"The inputs could not be computed.") and stopped.time < 0.5
    report = library.simulate(times, x0=[0.5, np.inf])[0]
    assert (report.status, report.message, report.failed_state) == (NON_FINITE, b"The start values are not finite.", b"rail.v")
    for options, words in (
        ({"order": 7}, "There is no method of that order."), ({"rtol": 2}, "rtol must lie"), ({"rtol": np.nan}, "rtol must lie"),
        ({"atol": -1}, "atol must be"), ({"step": np.nan}, "step must be"), ({"max_steps": 0}, "max_steps"), ({"method": 3}, "no method"),
        ({"max_step": -1}, "max_step must"), ({"max_step": 0.1, "step": 0.1}, "max_step must"),
    ):  # fmt: skip
        wrong = library.options(**options)
        report = library.simulate(times, options=wrong)[0]
        assert report.status == BAD_ARGUMENT and words in report.message.decode()
        assert library.c_size(ctypes.addressof(wrong)) == 0 and not library.c_create(ctypes.addressof(wrong), None, 0)
    for wrong in ([2.0, 1.0], [-1.0, 1.0], [0.0, np.nan], [0.0, np.inf]):
        assert library.simulate(wrong)[0].status == BAD_ARGUMENT


def test_a_run_that_fails_says_where_and_names_the_state(tmp_path):
    """sqrt(1 - t) has no value after one second."""
    scene = ac.System()
    scene.world, scene.rail, scene.body = World((0, 0, 0)), Prismatic("x"), Particle(1.0)
    scene.force = Force(lambda t: ((1 - t) ** 0.5, 0, 0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.point)
    scene.connect(scene.force.point, scene.body.point)
    model = ac.build(scene)
    made = program(model.export_simulator(tmp_path))
    status = model.simulate(3.0, raise_on_failure=False, method="gauss").status
    run = subprocess.run([str(made), "3", "5"], env={}, capture_output=True, text=True)
    assert run.returncode == 1
    assert len(run.stdout.splitlines()) == 3  # header, start and 0.75 s
    assert f"System: {status.message} Stopped at t = 1 s of 3 s" in run.stderr
    assert f"The state that failed first: {model.state_names[status.worst]}." in run.stderr


def test_names_units_values_and_version(tmp_path, oscillator):
    scene = Oscillator()
    model = ac.build(scene)
    folder = model.export_simulator(tmp_path / "new" / "folder", {scene.rail.q: 0.2}, {scene.mass: 3.0})
    facts = json.loads((folder / "model.json").read_text())
    assert facts["states"] == ["rail.q", "rail.v"] and facts["state_units"] == ["m", "m/s"]
    assert facts["start"] == [0.2, 0.0]
    assert facts["parameters"] == ["stiffness", "mass"] and facts["parameter_units"] == ["N/m", "kg"]
    assert facts["parameter_values"] == [4.0, 3.0]
    assert facts["inputs"] == ["push"]
    header = (folder / "simulator.h").read_text()
    assert "SIMULATOR_PARAMETER_mass, /* mass [kg] = 3 */" in header and '#define SIMULATOR_VERSION "acausal ' in header
    with pytest.raises(UnknownVariableError, match="parameter"):
        model.export_simulator(tmp_path, parameters={ac.Parameter(1.0): 2.0})
    library = oscillator[2]
    assert library.names(STATE) == ["rail.q", "rail.v"] and library.units(STATE) == ["m", "m/s"]
    assert library.names(INPUT) == ["push"] and library.c_index(PARAMETER, b"mass") == 1 and library.c_index(STATE, b"mass") == -1
    assert library.c_exported(CONDITION, 0) == 0.3 and np.isnan(library.c_exported(7, 0)) and library.c_name(STATE, 2) is None
    assert library.c_version().startswith(b"acausal ")


def test_units_of_orientations_and_their_rates(tmp_path):
    scene = ac.System()
    scene.world, scene.body = World(), RigidBody(1.0, (1.0, 2.0, 3.0))
    facts = json.loads((ac.build(scene).export_simulator(tmp_path) / "model.json").read_text())
    assert facts["state_units"] == [*["1"] * 4, *["m"] * 3, *["rad/s"] * 3, *["m/s"] * 3]


@pytest.mark.parametrize("name", ["", "4bar", "a-b", "model", "a b", "main", "häuser"])
def test_a_name_that_c_cannot_have_is_refused(tmp_path, name):
    with pytest.raises(ExportError, match="name"):
        ac.build(DoublePendulum()).export_simulator(tmp_path, name=name)


def test_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="cannot write"):
        ac.build(DoublePendulum()).export_simulator(tmp_path / "file")


TWO = r"""
#include <cstdio>
#include "simulator/simulator.h"
#include "two/two.h"
static int advance(const char *, const char *) { return 7; }
int main() {
    double times[2] = {0.5, 1}, x[100];
    int failed = simulator_simulate(0, 0, 0, 0, 0, 2, times, x, 0);
    for (long i = 0; i < 2 * SIMULATOR_STATES; i++) std::printf("%.17g\n", x[i]);
    two_instance *two = two_create(0, 0, 0);
    failed += two_start(two, 0) + two_set_end(two, 1.0);
    for (int k = 0; k < 2; k++) {
        failed += two_advance(two, times[k]);
        for (long i = 0; i < TWO_STATES; i++) std::printf("%.17g\n", two_get(two, TWO_STATE, i));
    }
    two_free(two);
    return failed + advance("", "") - 7;
}
"""


@pytest.mark.slow
def test_two_models_in_one_program_of_another_language_and_loaded_for_all_to_see(tmp_path):
    """Neither takes names of the other or of the C library, as objects or as libraries loaded with RTLD_GLOBAL."""
    objects: list[str] = []
    expected: list[np.ndarray] = []
    libraries: list[Library] = []
    for name, scene in (("simulator", "pendulum"), ("two", "four_bar")):
        model, start, _ = SCENES[scene]()
        folder = model.export_simulator(tmp_path / name, start, name=name)
        for source in (f"{name}.c", "model.c"):
            objects.append(str(folder / f"{source}.o"))
            compiled(folder, "-c", "-o", objects[-1], source)
        objects.append(str(runtime(name)))
        libraries.append(Library(folder, name))
        expected.append(model.simulate(1.0, start, method="gauss").at([0.5, 1.0]).x)
    for library, x in zip(libraries, expected, strict=True):
        assert np.array_equal(library.simulate([0.5, 1.0])[1], x)
        shown = subprocess.run(
            ["nm", "-D", "--defined-only", str(library.path)], capture_output=True, text=True, check=True
        ).stdout
        public = (library.path.parent / f"{library.name}.h").read_text()
        seen = {line.split()[-1] for line in shown.splitlines()}
        assert seen == set(re.findall(rf"\b({library.name}_[a-z_]+)\(", public.split("extern")[1]))
    (tmp_path / "two.cpp").write_text(TWO)
    warnings = [w for w in WARNINGS if not w.startswith("-std")]
    subprocess.run(["g++", *warnings, "-o", "both", "two.cpp", *objects, "-lm"], cwd=tmp_path, check=True)
    text = subprocess.run([str(tmp_path / "both")], capture_output=True, text=True, check=True).stdout
    assert np.array_equal(np.array(text.split(), dtype=float), np.concatenate([x.T.ravel() for x in expected]))


def adjustable_slider_crank():
    r, rod = ac.Parameter(0.3, "m"), ac.Parameter(1.0, "m")
    scene = slider_crank(r, rod)
    return (
        scene,
        {scene.a.q: 0.5, scene.a.v: 3.0},
        {r: (0.3, 0.25, 0.4, 0.9, 3.0), rod: (1.0, 1.2, 0.8, 0.1, 0.7)},
        lambda v: v[1] > v[0] * np.sin(0.5),
    )


def adjustable_four_bar():
    scene = AdjustableFourBar()
    lengths = {scene.length: (1.2, 1.25, 0.9, 3.0, 0.1)}
    far = np.hypot(1 - 0.4 * np.cos(1.0), 0.4 * np.sin(1.0))
    return scene, {scene.a.q: 1.0, scene.a.v: 2.0}, lengths, lambda v: abs(v[0] - 0.8) < far < v[0] + 0.8


def hung_arm():
    """No loop: an arm whose tip is where it is told to be."""
    length = ac.Parameter(1.0, "m")
    scene = ac.System()
    scene.world, scene.one, scene.two = World(), Revolute("y"), Revolute("y")
    scene.upper, scene.lower = RigidBody.rod(1.0, (0, 0, -0.8)), RigidBody.rod(1.0, (0, 0, -0.9))
    scene.connect(scene.world.frame, scene.one.frame_a)
    scene.connect(scene.one.frame_b, scene.upper.frame)
    scene.connect(scene.upper.at((0, 0, -1.0 * length)), scene.two.frame_a)
    scene.connect(scene.two.frame_b, scene.lower.frame)
    tip = scene.lower.tip.position
    return scene, {tip[0]: 0.9, tip[2]: -0.7, scene.two.v: 1.0}, {length: (1.0, 0.9, 1.1, 5.0)}, lambda v: v[0] < 2


@pytest.mark.slow
@pytest.mark.parametrize("make", [adjustable_slider_crank, adjustable_four_bar, hung_arm])
def test_other_parameters_are_assembled_as_by_the_package_or_refused(tmp_path, make):
    scene, start, values, closes = make()
    model = ac.build(scene)
    library = Library(model.export_simulator(tmp_path, start))
    times = [0.0, 0.3, 0.5]
    report, found = library.simulate(times)
    assert report.status == SUCCESS and np.array_equal(found, model.simulate(0.5, start, method="gauss").at(times).x)
    first = dict(zip(model.state_names, found[:, 0], strict=True))
    branch = {getattr(scene, name[:-2]).q: ac.near(value) for name, value in first.items() if name.endswith(".q")}
    for column in zip(*values.values(), strict=True):
        changed = dict(zip(values, column, strict=True))
        p = [changed.get(parameter, parameter.value) for parameter in model.system.flat.parameters]
        report, found = library.simulate(times, p=p)
        assert report.status == (SUCCESS if closes(column) else OPEN_START)
        assert closes(column) or np.isnan(found).all()
        if closes(column):
            expected = model.simulate(0.5, {**branch, **start}, parameters=changed, method="gauss").at(times).x
            assert np.max(np.abs(found - expected)) < 1e-9
            assert library.simulate(times, x0=expected[:, 0], p=p)[0].status == SUCCESS
        if column != next(zip(*values.values(), strict=True)) and model.functions.invariants is not None:
            first = model.initial_state(start).x  # that of other parameters
            assert library.simulate(times, x0=first, p=p)[0].status == OPEN_START


@pytest.mark.slow
def test_other_conditions_give_other_starts(tmp_path):
    scene, start, _, _ = adjustable_four_bar()
    model = ac.build(scene)
    library = Library(model.export_simulator(tmp_path, start))
    assert library.names(CONDITION) == ["a.q", "a.v"] and library.units(CONDITION) == ["rad", "rad/s"]
    x, instance = model.initial_state(start).x, library.instance()
    assert instance.started() == SUCCESS and np.max(np.abs(instance.x - x)) < 1e-14
    for angle, speed in ((2.0, -1.0), (-1.5, 0.0), (9.0, 1e-9)):
        assert instance.set_values(CONDITION, [angle, speed]) == SUCCESS and instance.started() == SUCCESS
        found = instance.x
        assert np.max(np.abs(np.array(model.functions.invariants(0, found, [], model.system.p_values)))) < 1e-13
        assert np.isclose(found[0], angle, atol=1e-14)
        assert abs(found[list(model.state_names).index("a.v")] - speed) < 1e-14 * (1 + abs(speed))
        assert library.simulate([0.0, 0.1], x0=found)[0].status == SUCCESS
    for k in range(x.size):  # one number of a start state that is wrong
        wrong = x.copy()
        wrong[k] += 1e-3
        assert library.simulate([0.0, 0.1], x0=wrong)[0].status == OPEN_START
    assert instance.set_values(CONDITION, [np.nan, 1.0]) == SUCCESS and instance.started() == OPEN_START
    assert "does not close the loops" in instance.words() and instance.advance(1.0) == BAD_ARGUMENT


class ScaledFourBar(ac.System):
    """A four-bar whose lengths, masses and gravity are parameters."""

    def __init__(self) -> None:
        self.length, self.mass, self.g = ac.Parameter(1.0, "m"), ac.Parameter(1.0, "kg"), ac.Parameter(9.81, "m/s^2")
        L, M = self.length, self.mass
        self.world = World((0, 0, -self.g))
        self.crank, self.coupler = RigidBody.rod(1.0 * M, (0.4 * L, 0, 0)), RigidBody.rod(2.0 * M, (1.2 * L, 0, 0))
        self.rocker = RigidBody.rod(1.5 * M, (0.8 * L, 0, 0))
        self.a, self.b, self.c, self.d = (Revolute("y") for _ in range(4))
        for joint, one, other in (
            (self.a, self.world.frame, self.crank.frame),
            (self.b, self.crank.tip, self.coupler.frame),
            (self.c, self.coupler.tip, self.rocker.frame),
            (self.d, self.rocker.tip, self.world.at((1.0 * L, 0, 0))),
        ):
            self.connect(one, joint.frame_a)
            self.connect(joint.frame_b, other)


@pytest.mark.slow
def test_an_exported_simulator_moves_alike_in_all_units(tmp_path):
    """Assembled and simulated by the same program with lengths, masses and times of other units: every bit is the same."""
    scene = ScaledFourBar()
    model = ac.build(scene)
    library = Library(model.export_simulator(tmp_path, {scene.a.q: 1.0, scene.a.v: 6.0}))
    seen: list[np.ndarray] = []
    for length, mass, time in [
        (0, 0, 1),
        (-15, 0, 0),
        (15, 0, 0),
        (2, -15, 0),
        (-3, 15, 0),
        (0, 1, -15),
        (0, 1, 15),
        (15, -15, 15),
        (-15, 15, -15),
    ]:
        L, M, T = 4.0**length, 4.0**mass, 4.0**time
        p = [L, M, 9.81 * L / T**2]
        instance = library.instance()
        assert instance.set_values(CONDITION, [1.0, 6.0 / T]) == instance.set_values(PARAMETER, p) == SUCCESS
        assert instance.started() == instance.set_end(T) == SUCCESS
        columns = []
        for t in (0.0, 0.5 * T, 1.0 * T):
            assert instance.advance(t) == SUCCESS
            columns.append(instance.x)
        seen.append(np.array(columns).T * np.array([[T] if name.endswith(".v") else [1.0] for name in model.state_names]))
    assert all(np.array_equal(seen[0], other) for other in seen[1:])
    expected = model.simulate(1.0, {scene.a.q: 1.0, scene.a.v: 6.0}, method="gauss").at([0.0, 0.5, 1.0]).x
    assert np.max(np.abs(seen[0] - expected)) < 1e-12


def test_scenes_without_positions_start_at_other_parameters_too(tmp_path):
    """A diode behind a resistor that follows from a capacitor's voltage: what it is at first depends on the resistance."""
    scene = ac.System()
    scene.resistance = ac.Parameter(100.0, "Ohm")
    scene.ground, scene.store, scene.wire, scene.diode = Ground(), Capacitor(1e-5), Resistor(scene.resistance), Diode()
    scene.connect(scene.store.pin_a, scene.wire.pin_a)
    scene.connect(scene.wire.pin_b, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.store.pin_b, scene.ground.pin)
    model = ac.build(scene)
    start = {scene.store.v: 2.0}
    library = Library(model.export_simulator(tmp_path, start))
    times = np.linspace(0, 1e-2, 9)
    for resistance in (100.0, 10.0, 3e4):
        report, x = library.simulate(times, p=[resistance], options=library.options(rtol=1e-9))
        run = model.simulate(1e-2, start, parameters={scene.resistance: resistance}, rtol=1e-9, samples=times)
        assert report.status == SUCCESS
        assert x == pytest.approx(run.x, rel=1e-7)
        assert run[scene.store.v][0] == 2.0
