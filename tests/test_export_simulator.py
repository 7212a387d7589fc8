"""The exported simulator: the numbers of the package from a C program that stands by itself."""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import acausal as ac
from acausal.emit.compiler import compiler
from acausal.errors import ExportError, UnknownVariableError
from components import Force, Particle, Prismatic, Revolute, RigidBody, World
from tests.scenes import DoublePendulum, FourBar
from tests.test_minimal import slider_crank
from tests.test_sensitivity import AdjustableFourBar, Oscillator

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wno-psabi", "-Werror")


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


def compiled(
    folder: Path, *flags: str, command: tuple[str, ...] | None = None, program: str = "simulator", **other: str | Path
) -> Path:
    """The program, made by the line in README.txt, without any warning. `other`: files to take instead of `main`.c, `runtime`.c."""
    lines = (folder / "README.txt").read_text().splitlines()
    words = next(line for line in lines if line.strip().startswith("cc ")).split()[1:]
    command = command or compiler()
    assert command is not None
    words[words.index("simulator")] = program
    words = [str(other.get(word.removesuffix(".c"), word)) for word in words]
    made = subprocess.run([*command, *WARNINGS, *flags, *words], cwd=folder, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert not made.stderr
    return folder / program


@pytest.fixture(scope="module")
def runtime(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The integrators as an object file: the same for all models, and the longest to compile."""
    folder = ac.build(DoublePendulum()).export_simulator(tmp_path_factory.mktemp("runtime"))
    command = compiler()
    assert command is not None
    flags = (*WARNINGS, "-O2", "-march=native", "-ffp-contract=off", "-fno-math-errno")
    subprocess.run([*command, *flags, "-c", "runtime.c"], cwd=folder, check=True)
    return folder / "runtime.o"


def printed(program: Path, *words: object) -> tuple[list[str], np.ndarray]:
    """Header and values of a run in an empty environment."""
    command = [str(program), *map(str, words)]
    run = subprocess.run(command, cwd="/", env={}, capture_output=True, text=True, check=True)
    head, *rows = run.stdout.splitlines()
    return head.split(","), np.array([row.split(",") for row in rows], dtype=float)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory, runtime: Path):
    """name -> model, start, end and program of a scene."""
    made = {}

    def get(name: str):
        if name not in made:
            model, start, end = SCENES[name]()
            folder = model.export_simulator(tmp_path_factory.mktemp(name), start)
            made[name] = model, start, end, compiled(folder, runtime=runtime)
        return made[name]

    return get


@pytest.mark.parametrize(
    ("name", "method", "rtol"),
    [("pendulum", "gauss", 1e-3), ("pendulum", "gauss", 1e-10), ("pendulum", "radau", 1e-7), ("four_bar", "gauss", 1e-10),
     ("four_bar", "radau", 1e-8), ("stiff", "gauss", 1e-6), ("stiff", "radau", 1e-3), ("stiff", "radau", 1e-12)],
)  # fmt: skip
def test_prints_the_numbers_of_the_package_to_the_last_bit(exported, name, method, rtol):
    model, start, end, program = exported(name)
    head, table = printed(program, end, 57, rtol, method)
    run = model.simulate(end, start, rtol=rtol, method=method)
    assert head == ["t", *model.state_names]
    assert np.array_equal(table[:, 0], np.linspace(0, end, 57))
    assert np.array_equal(table[:, 1:].T, run.at(table[:, 0]).x)


def test_a_stiff_model_makes_gauss_solve_by_newton(exported):
    """Otherwise the comparison above would not see the decision between the two."""
    model, start, end, _ = exported("stiff")
    statistics = model.simulate(end, start, rtol=1e-6, method="gauss").statistics
    assert statistics.method == "gauss with Newton"


@pytest.mark.slow
def test_lanes_do_not_matter(exported):
    _, _, end, program = exported("four_bar")
    native = printed(program, end, 40, 1e-13)[1]
    for lanes in {2, 4, 8}:
        other = compiled(program.parent, f"-DLANES={lanes}", program=f"lanes{lanes}")
        assert np.max(np.abs(printed(other, end, 40, 1e-13)[1] - native)) < 1e-12


def test_another_compiler_gives_the_same_without_warnings(exported):
    _, _, end, program = exported("four_bar")
    other = compiled(program.parent, command=(sys.executable, "-m", "ziglang", "cc"), program="other")
    assert np.max(np.abs(printed(other, end, 40, 1e-12)[1] - printed(program, end, 40, 1e-12)[1])) < 1e-12


USE = r"""
#include <stdio.h>
#include <string.h>
#include "simulator.h"
static int push(void *user, double t, double *u) { u[0] = *(double *)user - 2 * t; return 1; }
static int none(void *user, double t, double *u) { return t < 0.5 || !u || user; }
static void show(const char *name, SimulatorReport *r, const double *x) {
    printf("%s;%d;%s;%s;%ld;%ld;%.17g", name, (int)r->status, r->message, r->failed_state ? r->failed_state : "", r->samples, r->steps, r->time);
    for (int i = 0; i < 6; i++) printf(";%.17g", x[i]);
    printf("\n");
}
int main(void) {
    double times[3] = {1, 1.5, 3}, bad[2] = {2, 1}, x[6] = {0}, x0[2] = {0.25, -1}, p[2] = {9, 2}, u[1] = {1.5}, worse[2] = {0.5, 1};
    SimulatorReport r;
    worse[1] /= 0.0;
    simulate(0, 0, 0, 0, 0, 3, times, x, &r); show("default", &r, x);
    simulate(0, 1, x0, u, p, 3, times, x, &r); show("values", &r, x);
    SimulatorOptions o = simulator_defaults();
    double three = 3;
    o.input = push; o.user = &three; simulate(&o, 0, x0, 0, p, 3, times, x, &r); show("input", &r, x);
    o.step = 0.03; o.order = 8; simulate(&o, 0, x0, 0, p, 3, times, x, &r); show("fixed", &r, x);
    o.method = SIMULATOR_RADAU; o.order = 5; o.step = 0.02; simulate(&o, 0, x0, 0, p, 3, times, x, &r); show("radau", &r, x);
    o = simulator_defaults(); o.max_steps = 4; memset(x, 0, sizeof x);
    simulate(&o, 0, 0, 0, 0, 3, times, x, &r); show("short", &r, x);
    o = simulator_defaults(); o.input = none; simulate(&o, 0, 0, 0, 0, 3, times, x, &r); show("stopped", &r, x);
    o.order = 7; simulate(&o, 0, 0, 0, 0, 3, times, x, &r); show("order", &r, x);
    o.order = 0; o.rtol = 2; simulate(&o, 0, 0, 0, 0, 3, times, x, &r); show("rtol", &r, x);
    simulate(0, 0, 0, 0, 0, 2, bad, x, &r); show("times", &r, x);
    simulate(0, 0, worse, 0, 0, 3, times, x, &r); show("start", &r, x);
    return simulate(0, 0, 0, 0, 0, 3, times, x, 0);
}
"""


def test_called_from_a_program(tmp_path, runtime):
    scene = Oscillator(damping=0.1)
    model = ac.build(scene)
    start, p = {scene.rail.q: 0.25, scene.rail.v: -1.0}, {scene.stiffness: 9.0, scene.mass: 2.0}
    (model.export_simulator(tmp_path, {scene.rail.q: 0.3}) / "use.c").write_text(USE)
    text = subprocess.run(
        [str(compiled(tmp_path, main="use.c", runtime=runtime))], env={}, capture_output=True, text=True, check=True
    ).stdout
    rows = {line.split(";")[0]: line.split(";")[1:] for line in text.splitlines()}
    times = [1.0, 1.5, 3.0]

    def states(name: str) -> np.ndarray:
        assert rows[name][:4] == ["0", "", "", "3"]
        return np.array(rows[name][6:], dtype=float).reshape(3, 2).T

    def same(name: str, begin=start, **options) -> bool:
        run = model.simulate(3.0, begin, **options)
        assert rows[name][4] == str(run.statistics.steps)
        return np.array_equal(states(name), run.at(times).x)

    slope = {scene.push: lambda t: 3 - 2 * t}
    assert same("default", {scene.rail.q: 0.3})
    assert same("values", t0=1.0, parameters=p, inputs={scene.push: 1.5})
    assert same("input", parameters=p, inputs=slope)
    assert same("fixed", parameters=p, inputs=slope, step=0.03, order=8, method="gauss")
    assert same("radau", parameters=p, inputs=slope, step=0.02, order=5, method="radau")
    short = model.simulate(3.0, {scene.rail.q: 0.3}, max_steps=4, raise_on_failure=False)
    assert rows["short"][:3] == ["4", "4 steps were not enough.", ""]
    assert rows["short"][4:6] == ["4", f"{short.status.time:.17g}"]
    assert int(rows["short"][3]) == sum(t <= short.status.time for t in times)
    assert rows["stopped"][0] == "5"
    assert float(rows["stopped"][5]) < 0.5
    assert rows["order"][:2] == ["7", "There is no method of that order."]
    assert rows["rtol"][:2] == ["7", "rtol must lie between 0 and 1."]
    assert rows["times"][:2] == ["7", "Times must be in ascending order."]
    assert rows["start"][:3] == ["2", "The start values are not finite.", "rail.v"]


def test_a_run_that_fails_says_where_and_names_the_state(tmp_path):
    """sqrt(1 - t) has no value after one second."""
    scene = ac.System()
    scene.world, scene.rail, scene.body = World((0, 0, 0)), Prismatic("x"), Particle(1.0)
    scene.force = Force(lambda t: ((1 - t) ** 0.5, 0, 0))
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.body.point)
    scene.connect(scene.force.point, scene.body.point)
    model = ac.build(scene)
    program = compiled(model.export_simulator(tmp_path))
    status = model.simulate(3.0, raise_on_failure=False).status
    run = subprocess.run([str(program), "3", "5"], env={}, capture_output=True, text=True)
    assert run.returncode == 1
    assert len(run.stdout.splitlines()) == 3  # header, start and 0.75 s
    assert f"System: {status.message} Stopped at t = 1 s of 3 s" in run.stderr
    assert f"The state that failed first: {model.state_names[status.worst]}." in run.stderr


@pytest.mark.parametrize("words", [(), ("x",), ("1", "1"), ("1", "2.5"), ("1", "5", "7"), ("1", "5", "1e-8", "euler"), ("-1",)])
def test_wrong_words_show_the_usage(exported, words):
    run = subprocess.run([str(exported("pendulum")[3]), *words], capture_output=True, text=True)
    assert run.returncode == 2
    assert run.stderr.startswith("usage:")
    assert not run.stdout


def test_facts_and_parameters(tmp_path):
    scene = Oscillator()
    model = ac.build(scene)
    folder = model.export_simulator(tmp_path / "new" / "folder", {scene.rail.q: 0.2}, {scene.mass: 3.0})
    facts = json.loads((folder / "model.json").read_text())
    assert facts["states"] == ["rail.q", "rail.v"]
    assert facts["start"] == [0.2, 0.0]
    assert facts["parameters"] == ["stiffness", "mass"]
    assert facts["parameter_values"] == [4.0, 3.0]
    assert facts["inputs"] == ["push"]
    with pytest.raises(UnknownVariableError, match="parameter"):
        model.export_simulator(tmp_path, parameters={ac.Parameter(1.0): 2.0})


def test_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="cannot write"):
        ac.build(DoublePendulum()).export_simulator(tmp_path / "file")


FLAGS = ("-O1", "-march=native", "-ffp-contract=off", "-fno-math-errno")
SOURCES = ("simulator.c", "model.c", "runtime.c")
TWO = r"""
#include <cstdio>
#define SIMULATOR_PREFIX one_
#include "one/simulator.h"
#undef SIMULATOR_PREFIX
#define SIMULATOR_PREFIX two_
#include "two/simulator.h"
static int advance(const char *, const char *) { return 7; }
int main() {
    double times[2] = {0.5, 1}, x[100];
    int failed = one_simulate(0, 0, 0, 0, 0, 2, times, x, 0);
    for (long i = 0; i < 2 * one_model_states; i++) std::printf("%.17g\n", x[i]);
    SimulatorOptions options = two_simulator_defaults();
    failed += two_simulate(&options, 0, two_model_start, 0, 0, 2, times, x, 0);
    for (long i = 0; i < 2 * two_model_states; i++) std::printf("%.17g\n", x[i]);
    return failed + advance("", "") - 7;
}
"""


def run_of(library: ctypes.CDLL, states: int, times: list[float]) -> np.ndarray:
    """States (states, times) by the library's `simulate` from its exported start."""
    found = np.zeros((len(times), states))
    library.simulate.argtypes = [ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 3, ctypes.c_long, *[ctypes.c_void_p] * 3]
    assert library.simulate(None, 0.0, None, None, None, len(times), np.array(times).ctypes.data, found.ctypes.data, None) == 0
    return found.T


@pytest.mark.slow
def test_shared_libraries_of_two_models_do_not_take_names_of_each_other_or_of_the_c_library(exported, tmp_path):
    """Loaded for all to see, so that whatever is visible in the first hides the same in the second."""
    command = compiler()
    assert command is not None
    for name in ("pendulum", "four_bar"):
        model, start, end, program = exported(name)
        library = tmp_path / f"{name}.so"
        line = [*command, *WARNINGS, *FLAGS, "-fPIC", "-shared", "-o", str(library), *SOURCES, "-lm"]
        subprocess.run(line, cwd=program.parent, check=True)
        times = [0.0, end / 3, end]
        found = run_of(ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL), len(model.state_names), times)
        assert np.array_equal(found, model.simulate(end, start, method="gauss").at(times).x)
        shown = subprocess.run(["nm", "-D", "--defined-only", str(library)], capture_output=True, text=True, check=True).stdout
        public = (program.parent / "simulator.h").read_text()
        assert all(line.split()[-1] in public for line in shown.splitlines())


@pytest.mark.slow
def test_two_models_in_one_program_written_in_another_language(exported, tmp_path):
    command = compiler()
    assert command is not None
    objects: list[str] = []
    expected: list[np.ndarray] = []
    for prefix, name in (("one", "pendulum"), ("two", "four_bar")):
        model, start, _, program = exported(name)
        (tmp_path / prefix).symlink_to(program.parent)
        for source in SOURCES:
            objects.append(f"{prefix}_{source}.o")
            line = [*command, *WARNINGS, *FLAGS, f"-DSIMULATOR_PREFIX={prefix}_"]
            subprocess.run([*line, "-c", "-o", objects[-1], f"{prefix}/{source}"], cwd=tmp_path, check=True)
        expected.append(model.simulate(1.0, start, method="gauss").at([0.5, 1.0]).x.T.ravel())
    (tmp_path / "two.cpp").write_text(TWO)
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", "-o", "both", "two.cpp", *objects, "-lm"], cwd=tmp_path, check=True)
    printed = subprocess.run([str(tmp_path / "both")], capture_output=True, text=True, check=True).stdout
    assert np.array_equal(np.array(printed.split(), dtype=float), np.concatenate(expected))


@pytest.fixture(scope="module")
def position_independent(runtime: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The integrators for shared libraries."""
    command = compiler()
    assert command is not None
    made = tmp_path_factory.mktemp("pic") / "runtime.o"
    subprocess.run([*command, *FLAGS, "-fPIC", "-c", "-o", str(made), "runtime.c"], cwd=runtime.parent, check=True)
    return made


class Library:
    """An exported simulator called through ctypes: what `simulate` says, and the states."""

    def __init__(self, model: ac.Model, folder: Path, runtime: Path) -> None:
        command = compiler()
        assert command is not None
        made = folder / "model.so"
        line = [*command, *WARNINGS, *FLAGS, "-fPIC", "-shared", "-o", str(made), "simulator.c", "model.c", str(runtime), "-lm"]
        subprocess.run(line, cwd=folder, check=True)
        self.library, self.nx = ctypes.CDLL(str(made)), len(model.state_names)
        array = [ctypes.c_void_p]
        self.library.simulate.argtypes = [*array, ctypes.c_double, *array * 3, ctypes.c_long, *array * 3]
        self.library.simulator_start.argtypes = [ctypes.c_double, *array * 4]

    def run(self, times, t0=0.0, x0=None, p=None) -> tuple[int, np.ndarray]:
        """Status and states (nx, times)."""
        kept = [None if v is None else np.array(v, dtype=float) for v in (x0, p, times)]
        x, p, t = (None if v is None else v.ctypes.data for v in kept)
        found = np.full((len(times), self.nx), np.nan)
        status = self.library.simulate(None, t0, x, None, p, len(times), t, found.ctypes.data, None)
        return status, found.T

    def start(self, conditions=None, p=None, t0=0.0) -> tuple[int, np.ndarray]:
        """Status and start state."""
        kept = [None if v is None else np.array(v, dtype=float) for v in (conditions, p)]
        c, p = (None if v is None else v.ctypes.data for v in kept)
        x = np.full(self.nx, np.nan)
        return self.library.simulator_start(t0, c, None, p, x.ctypes.data), x


OPEN = 8


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
def test_other_parameters_are_assembled_as_by_the_package_or_refused(tmp_path, position_independent, make):
    scene, start, values, closes = make()
    model = ac.build(scene)
    library = Library(model, model.export_simulator(tmp_path, start), position_independent)
    times = [0.0, 0.3, 0.5]
    status, found = library.run(times)
    assert status == 0 and np.array_equal(found, model.simulate(0.5, start, method="gauss").at(times).x)
    for column in zip(*values.values(), strict=True):
        changed = dict(zip(values, column, strict=True))
        p = [changed.get(parameter, parameter.value) for parameter in model.system.flat.parameters]
        status, found = library.run(times, p=p)
        assert status == (0 if closes(column) else OPEN)
        assert closes(column) or np.isnan(found).all()
        if closes(column):
            expected = model.simulate(0.5, start, parameters=changed, method="gauss").at(times).x
            assert np.max(np.abs(found - expected)) < 1e-9
            assert library.run(times, x0=expected[:, 0], p=p)[0] == 0
        if column != next(zip(*values.values(), strict=True)) and model.functions.invariants is not None:
            assert library.run(times, x0=model.initial_state(start).x, p=p)[0] == OPEN  # that of other parameters


@pytest.mark.slow
def test_other_conditions_give_other_starts(tmp_path, position_independent):
    scene, start, _, _ = adjustable_four_bar()
    model = ac.build(scene)
    library = Library(model, model.export_simulator(tmp_path, start), position_independent)
    facts = json.loads((tmp_path / "model.json").read_text())
    assert facts["conditions"] == ["a.q", "a.v"] and facts["condition_values"] == [1.0, 2.0]
    x = model.initial_state(start).x
    status, found = library.start()
    assert status == 0 and np.array_equal(found, x)
    for angle, speed in ((2.0, -1.0), (-1.5, 0.0), (9.0, 1e-9)):
        status, found = library.start([angle, speed])
        assert status == 0 and np.max(np.abs(np.array(model.functions.invariants(0, found, model.system.p_values)))) < 1e-13
        assert np.isclose(found[0], angle, atol=1e-14) and abs(found[list(model.state_names).index("a.v")] - speed) < 1e-14 * (
            1 + abs(speed)
        )
        assert library.run([0.0, 0.1], x0=found)[0] == 0
    for k in range(x.size):  # one number of a start state that is wrong
        wrong = x.copy()
        wrong[k] += 1e-3
        assert library.run([0.0, 0.1], x0=wrong)[0] == OPEN
    assert library.start([np.nan, 1.0])[0] == OPEN


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
def test_an_exported_simulator_moves_alike_in_all_units(tmp_path, position_independent):
    """Assembled and simulated by the same program with lengths, masses and times of other units: every bit is the same."""
    scene = ScaledFourBar()
    model = ac.build(scene)
    library = Library(model, model.export_simulator(tmp_path, {scene.a.q: 1.0, scene.a.v: 6.0}), position_independent)
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
        status, start = library.start([1.0, 6.0 / T], p)
        assert status == 0
        status, found = library.run([0.0, 0.5 * T, 1.0 * T], x0=start, p=p)
        assert status == 0
        seen.append(found * np.array([[T] if name.endswith(".v") else [1.0] for name in model.state_names]))
    assert all(np.array_equal(seen[0], other) for other in seen[1:])
    expected = model.simulate(1.0, {scene.a.q: 1.0, scene.a.v: 6.0}, method="gauss").at([0.0, 0.5, 1.0]).x
    assert np.max(np.abs(seen[0] - expected)) < 1e-12
