"""Inputs among nonlinear scalar equations: what these give follows inputs at once, whatever these are given as, and in whatever asks for it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import acausal as ac
from acausal.errors import OptionError
from acausal.language.connector import Translational
from acausal.runtime.kernels import How
from acausal.runtime.native import native_problem
from components import (
    Capacitor,
    DCMotor,
    Diode,
    ForceSource,
    Ground,
    Inertia,
    Resistor,
    Revolute,
    RigidBody,
    VoltageSource,
    World,
)
from components.signals import Constant, Integrator
from tests.exported import INPUT, OUTPUT, STATE, SUCCESS, Library, compile_quickly
from tests.test_nonlinear_networks import Drawn

SIZES = [1e-3, 1.0, 1e3]
KNOTS, LEVELS = [0.0, 0.7, 1.3, 2.1], [0.4, -0.9, 1.2, -0.3]


def wave(t: Any) -> Any:
    return 0.8 * np.sin(3 * t) + 0.2


FORMS: dict[str, Any] = {
    "number": 0.7,
    "constant": ac.samples(KNOTS, LEVELS, "constant"),
    "linear": ac.samples(KNOTS, LEVELS, "linear"),
    "cubic": ac.samples(KNOTS, LEVELS, "cubic"),
    "expression": wave(ac.time),
    "function": wave,
    "with rates": (lambda t: 0.8 * math.sin(3 * t) + 0.2, lambda t: 2.4 * math.cos(3 * t)),
    "with knots": (ac.with_knots(lambda t: 0.9 if t < 1.1 else -0.6, [1.1]), lambda t: 0.0),
}


def pieces(form: str) -> tuple[list[float], Callable[[float], float]]:
    """Where a course jumps or bends, and its value."""
    if form == "number":
        return [], lambda t: 0.7
    if form == "with knots":
        return [1.1], lambda t: 0.9 if t < 1.1 else -0.6
    if form in ("expression", "function", "with rates"):
        return [], wave
    return KNOTS[1:], lambda t: float(FORMS[form](t))


@pytest.mark.parametrize("form", list(FORMS))
@pytest.mark.parametrize("seed", [0, 3, 7])
def test_networks_follow_an_input_in_each_form(seed: int, form: str) -> None:
    """Each quantity in a unit of its own."""
    drawn = Drawn(seed)
    units = 10 ** np.random.default_rng(seed + 200).uniform(-6, 6, (3, drawn.n))
    scene: Any = drawn.scene(*units, push=ac.Input("1"))
    run = ac.build(scene).simulate(3.0, inputs={scene.push: FORMS[form]}, rtol=1e-11, samples=7)
    knots, course = pieces(form)
    ends, x = [0.0, *knots, 3.0], drawn.start
    for begin, end in itertools.pairwise(ends):
        own = (lambda t, last=end: course(min(t, last * (1 - 1e-15)))) if end < 3 else course
        inside = np.append(run.t[(run.t > begin) & (run.t < end)], end)
        found = solve_ivp(
            lambda t, x, u=own: -drawn.T * drawn.found(x + u(t)), (begin, end), x, "DOP853", inside, rtol=1e-11, atol=1e-12
        ).y
        x = found[:, -1]
        for t, wanted in zip(inside[:-1], found.T, strict=False):
            k = int(np.flatnonzero(run.t == t)[0])
            y = [run[getattr(scene.network, f"y{i}")][k] / units[1][i] for i in range(drawn.n)]
            assert (
                np.abs([run[getattr(scene.network, f"x{i}")][k] / units[0][i] - wanted[i] for i in range(drawn.n)]).max() < 1e-9
            )
            assert np.abs(y - drawn.found(wanted + course(t))).max() < 1e-9


def clipper(
    volt: Any, size: float = 1.0, turned_round: bool = False, wire: Any = 100.0, more: tuple[Any, ...] = ()
) -> tuple[Any, ac.Model]:
    """A diode behind a resistor, beside a capacitor behind another; voltages by their size."""
    scene: Any = ac.System()
    scene.volt, scene.ohm, scene.more = volt, wire, list(more)
    parts: dict[str, Any] = {
        "ground": Ground(), "wire": Resistor(wire), "diode": Diode(1e-9 * size, 0.05 * size), "source": VoltageSource(volt), "load": Resistor(1e3),
        "store": Capacitor(2e-5),
    }  # fmt: skip
    for name in reversed(parts) if turned_round else parts:
        setattr(scene, name, parts[name])
    scene.connect(scene.source.pin_a, scene.wire.pin_a)
    scene.connect(scene.wire.pin_b, scene.diode.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.store.pin_a)
    scene.connect(scene.ground.pin, scene.source.pin_b, scene.diode.pin_b, scene.store.pin_b)
    return scene, ac.build(scene)


def node(v: float, source: float) -> float:
    """The diode's voltage of size 1."""
    return brentq(lambda x: (source - x) / 100 - 1e-9 * np.expm1(x / 0.05) - (x - v) / 1e3, -60, 1.4, xtol=1e-15, rtol=1e-14)  # type: ignore[return-value]


def slopes(v: float, source: float) -> tuple[float, float]:
    """Of `node`, by both."""
    total = 1 / 100 + 1e-9 / 0.05 * np.exp(node(v, source) / 0.05) + 1e-3
    return 1e-3 / total, 0.01 / total


def charged(v: float, source: float, time: float) -> float:
    """Of the capacitor from v on, at a constant voltage."""
    return float(
        solve_ivp(lambda t, y: [(node(y[0], source) - y[0]) / 0.02], (0, time), [v], "Radau", rtol=1e-11, atol=1e-13).y[0, -1]
    )


JUMPS, VOLTS = [0.0, 0.004, 0.008, 0.012], [3.0, -40.0, 8.0, 0.0]


@pytest.mark.parametrize("method", ["radau", "cvodes", "idas", "rosenbrock"])
def test_every_method_follows_an_input_that_jumps(method: str) -> None:
    scene, model = clipper(ac.Input("V"))
    course = ac.samples(JUMPS, VOLTS, "constant")
    run, v = model.simulate(0.016, inputs={scene.volt: course}, rtol=1e-9, method=method, samples=2), 0.0
    for source in VOLTS:
        v = charged(v, source, 0.004)
    assert [run[scene.store.v][-1], run[scene.diode.v][-1]] == pytest.approx([v, node(v, VOLTS[-1])], abs=2e-6)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("turned_round", [False, True])
@pytest.mark.parametrize("rtol", [1e-4, 1e-10])
def test_a_diode_jumps_with_its_source(size: float, turned_round: bool, rtol: float) -> None:
    """Its voltage is that of after the jump right at it."""
    scene, model = clipper(ac.Input("V"), size, turned_round)
    course = ac.samples(JUMPS, size * np.array(VOLTS), "constant")
    run = model.simulate(0.016, inputs={scene.volt: course}, rtol=rtol, samples=9)
    v = 0.0
    for k, source in enumerate(VOLTS):
        for half in range(2):
            assert run[scene.store.v][2 * k + half] / size == pytest.approx(v, abs=max(30 * rtol, 1e-10))
            assert run[scene.diode.v][2 * k + half] / size == pytest.approx(node(v, source), abs=max(300 * rtol, 1e-9))
            v = charged(v, source, 0.002)


def test_linear_systems_step_with_their_inputs() -> None:
    scene, model = clipper(ac.Input("V"), 1.0)
    for source, v in ((3.0, 0.2), (-5.0, -1.0), (0.0, 0.0), (0.7, 0.6)):
        found = model.linearize({scene.store.v: v}, inputs={scene.volt: source}, outputs=[scene.diode.v, scene.wire.pin_a.i])
        by_v, by_source = slopes(v, source)
        assert list(found.states) == ["store.v"]
        assert found.A[0, 0] == pytest.approx((by_v - 1) / 0.02)
        assert found.B[:, 0] == pytest.approx(by_source / 0.02)
        assert found.C[:, 0] == pytest.approx([by_v, -by_v / 100]) and found.D[:, 0] == pytest.approx(
            [by_source, (1 - by_source) / 100]
        )
        assert not found.B[:, 1].any() and not found.D[:, 1].any()
    with pytest.raises(OptionError, match="must not depend on an input"):
        model.linearize({scene.store.v: 0.2}, inputs={scene.volt: 3.0}, states=[scene.diode.v])


def test_steps_begin_where_the_input_says() -> None:
    _, model = clipper(ac.Input("V"))
    step, x, v = model.step("radau", 9), model.initial_state().x, 0.0
    assert model.state_names == ("store.v", "diode.v")
    for source in VOLTS:
        x, residual = (np.array(part).ravel() for part in step(0.0, x, [source, 0.0], [], 1e-3))
        v = charged(v, source, 1e-3)
        assert residual < 1e-9 and x == pytest.approx([v, node(v, source)], abs=1e-9)
    assert np.isinf(float(step(0.0, [0.0, 50.0], [1e6, 0.0], [], 1e-3)[1]))  # exp(1e6 / 0.05) is no number on the way: told


@pytest.mark.parametrize("kind", ["constant", "linear", "cubic"])
def test_derivatives_go_through_jumps(kind: str) -> None:
    resistance, volt, gain = ac.Parameter(100.0), ac.Input("V"), ac.Input("1")
    scene, model = clipper(volt * gain, wire=resistance, more=(volt, gain))
    course = ac.samples([0, 0.01, 0.02, 0.03], [5.0, -3.5, 4, -1], kind)
    times, wanted = [0.0, 0.005, 0.01, 0.010001, 0.02, 0.025], [resistance, gain, scene.store.v]

    def motion(ohm: float, factor: float, v: float) -> np.ndarray:
        run = model.simulate(
            0.03, {scene.store.v: v}, inputs={volt: course, gain: factor}, parameters={resistance: ohm}, rtol=1e-12
        ).at(times)
        return np.array([run[scene.store.v], run[scene.diode.v]])

    found = model.sensitivities(times, wanted, {scene.store.v: 0.5}, inputs={volt: course, gain: 1.0}, rtol=1e-10)
    start = np.array([100.0, 1.0, 0.5])
    for k, by in enumerate(np.diag([1e-2, 1e-4, 1e-4])):
        differences = (motion(*(start + by)) - motion(*(start - by))) / (2 * by[k])
        assert np.abs(np.array([found[scene.store.v], found[scene.diode.v]])[:, :, k] - differences).max() < 1e-7
    both = model.trajectory_function(times, scene.diode.v, wanted, {scene.store.v: 0.5}, inputs={volt: course}, rtol=1e-10)
    assert np.array(both(start)).ravel() == pytest.approx(motion(*start)[1], abs=1e-9)
    assert np.array(both.jacobian()(start, 0)) == pytest.approx(found[scene.diode.v], abs=1e-7)


def test_derivatives_follow_what_jumps_with_a_switch() -> None:
    """As with an input that jumps; and by when it does: the capacitor's by how much its rate jumps."""
    when, times = ac.Parameter(0.01), [0.0, 0.0101, 0.02]
    found: list[np.ndarray] = []
    for volt in (ca.if_else(ac.time.sx >= when.sx, -3.5, 5.0), ac.Input("V")):
        scene, model = clipper(volt, more=(when,))
        inputs = {volt: ac.samples([0, 0.01], [5.0, -3.5], "constant")} if isinstance(volt, ac.Input) else {}
        run = model.sensitivities(
            times, [scene.store.v, *([] if inputs else [when])], {scene.store.v: 0.5}, inputs=inputs, rtol=1e-10
        )
        found.append(np.array([run[scene.store.v], run[scene.diode.v]]))
        if not inputs:
            v = charged(0.5, 5.0, 0.01)
            rate = (node(v, 5.0) - node(v, -3.5)) / 0.02
            later = [charged(v + rate * 1e-4 * sign, -3.5, 0.01) for sign in (-1, 1)]
            assert run[scene.store.v][-1, 1] == pytest.approx((later[1] - later[0]) / 2e-4, rel=1e-5)
    assert np.abs(found[0][:, :, 0] - found[1][:, :, 0]).max() < 1e-12


@pytest.mark.parametrize("kind", ["constant", "cubic"])
def test_exported_motions_have_the_same_bits(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, model = clipper(ac.Input("V"))
    course = {scene.volt: ac.samples([0, 0.01, 0.02, 0.03], [5.0, -3.5, 4, -1], kind)}
    times = np.linspace(0, 0.035, 8)
    library = Library(model.export_simulator(tmp_path / kind, inputs=course))
    report, states = library.simulate(times.tolist(), options=library.options(rtol=1e-9))
    assert report.status == SUCCESS
    for how in (How.INTERPRETED, How.COMPILED):
        monkeypatch.setattr(type(model.functions), "native", lambda f, _, how=how: native_problem(f.integrand, how))
        assert np.array_equal(model.simulate(0.035, inputs=course, rtol=1e-9).at(times).x, states)


def test_exported_motions_jump_with_what_is_set(tmp_path: Path) -> None:
    scene, model = clipper(ac.Input("V"))
    library = Library(model.export_simulator(tmp_path / "set", outputs={"current": scene.wire.pin_a.i}))
    instance, v, t = library.instance(library.options(rtol=1e-10)), 0.0, 0.0
    assert instance.started() == SUCCESS
    for k, source in enumerate([*VOLTS, 2.0]):
        assert instance.set(INPUT, 0, source) == SUCCESS
        if k % 2:  # read before the next step
            assert instance.get(STATE, 1) == pytest.approx(node(v, source), abs=1e-11)
            assert instance.get(OUTPUT, 0) == pytest.approx((source - node(v, source)) / 100, abs=1e-12)
        t, v = t + 0.004, charged(v, source, 0.004)
        assert instance.advance(t) == SUCCESS, instance.words()
        assert instance.x == pytest.approx([v, node(v, source)], abs=1e-10)


def test_units_jump_with_what_is_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compile_quickly(monkeypatch)
    scene, model = clipper(ac.Input("V"))
    unit = model.export_fmu(tmp_path / "clipper", outputs={"drop": scene.diode.v})
    given = np.array([*zip(np.arange(4) * 0.004, VOLTS, strict=True)], dtype=[("time", float), ("volt", float)])
    steps = np.repeat(given, 2)[1:]
    steps["volt"] = np.repeat(VOLTS, 2)[:-1]
    found = fmpy.simulate_fmu(
        str(unit), stop_time=0.016, output_interval=0.004, relative_tolerance=1e-10, input=steps, output=["drop", "store.v"]
    )
    v = 0.0
    for k, source in enumerate(VOLTS):
        v = charged(v, source, 0.004)
        assert found["store.v"][k + 1] == pytest.approx(v, abs=1e-9)


class Drag(ac.Component):
    """f = linear v + cubic v^3 on what moves."""

    flange = Translational.port()

    def __init__(self, linear: float, cubic: float) -> None:
        self.linear, self.cubic = linear, cubic

    def equations(self) -> Any:
        v = ac.der(self.flange.s)
        yield ac.equal(self.flange.f, self.linear * v + self.cubic * v**3)


@pytest.mark.parametrize("size", SIZES)
def test_what_drag_alone_holds_moves_as_its_force_says(size: float) -> None:
    """Without a mass: its speed solves a cubic, and jumps with the force."""
    scene: Any = ac.System()
    scene.force = ac.Input("N")
    scene.push, scene.drag = ForceSource(scene.force), Drag(2.0 / size, 5.0 / size**3)
    scene.connect(scene.push.flange, scene.drag.flange)
    course = ac.samples([0, 1, 2], [3.0, -7.0, 20.0], "constant")
    run = ac.build(scene).simulate(3.0, inputs={scene.force: course}, samples=7)

    def speed(force: float) -> float:
        return float(next(r.real for r in np.roots([5.0, 0, 2.0, -force]) if abs(r.imag) < 1e-9))

    speeds = [speed(f) for f in (3.0, -7.0, 20.0)]
    assert run[scene.drag.flange.s][1:] / size == pytest.approx(np.cumsum(np.repeat(speeds, 2)) / 2, rel=1e-10)
    assert run[ac.der(scene.drag.flange.s)][:-1] / size == pytest.approx(np.repeat(speeds, 2), rel=1e-10)


def driven_loop(volt: Any, size: float, flat: bool) -> tuple[Any, ac.Model]:
    """Of three bars, whose first hinge a motor behind a diode turns."""
    scene: Any = ac.System()
    scene.volt = volt
    rods = ((0.5, 0, 0.5), (1.0, 0, 0), (-0.5, 0, -0.5)) if flat else ((0.3, 0, 0), (0.8, 0, 0.9), (0.1, 0, -0.9))
    ends = [size * np.array(end) for end in rods]
    at = [np.zeros(3), *np.cumsum(ends, axis=0)]
    scene.world = World((0, 0, -9.81 * size))
    scene.bars = [RigidBody.rod(1 / size**2, tuple(end), position=tuple(p)) for end, p in zip(ends, at, strict=False)]
    parts = [scene.world, *scene.bars, scene.world]
    scene.hinges = [Revolute.between(a, b, at=tuple(p), axis="y") for a, b, p in zip(parts, parts[1:], at, strict=False)]
    scene.motor, scene.diode = DCMotor(1.0, 2.0), Diode(1e-9, 0.05)
    scene.source, scene.ground = VoltageSource(scene.volt), Ground()
    scene.connect(scene.motor.flange, scene.hinges[0].flange)
    scene.connect(scene.source.pin_a, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.motor.pin_a)
    scene.connect(scene.motor.pin_b, scene.source.pin_b, scene.ground.pin)
    return scene, ac.build(scene)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("flat", [False, True])
def test_a_motor_behind_a_diode_drives_a_loop(flat: bool, size: float) -> None:
    """Also a parallelogram through positions in which it lies flat: energies balance through each jump of the voltage, and the loop of voltages is closed."""
    scene, model = driven_loop(ac.Input("V"), size, flat)
    jumps, volts = [0.0, 0.5, 1.0], [20.0, -20.0, 30.0]
    run = model.simulate(1.3, inputs={scene.volt: ac.samples(jumps, volts, "constant")}, rtol=1e-10, samples=27)
    i, v, w = run[scene.diode.pin_a.i], run[scene.diode.v], run[scene.hinges[0].v]
    assert np.ptp(run[scene.hinges[0].q]) > 6 and run.energy_error() < 1e-9
    assert np.abs(i - 1e-9 * np.expm1(v / 0.05)).max() < 1e-11 and np.abs(2 * i + v + w - run[scene.volt]).max() < 1e-11

    def current(volt: float) -> float:
        drop = brentq(lambda v: 2e-9 * np.expm1(v / 0.05) + v - volt, -90, 1.6, xtol=1e-15, rtol=1e-14)
        return (volt - drop) / 2  # type: ignore[operator]

    if flat:  # one freedom: its cranks turn alike, and its coupler does not turn
        x, weight = [0.0, 0.0], 2 * 9.81 * np.sqrt(0.5)
        for volt, begin, end in zip(volts, jumps, [*jumps[1:], 1.3], strict=True):
            x = solve_ivp(
                lambda t, x, u=volt: [x[1], (current(u - x[1]) + weight * np.cos(np.pi / 4 - x[0])) * 6 / 5],
                (begin, end), x, "Radau", rtol=1e-10, atol=1e-12,
            ).y[:, -1]  # fmt: skip
        assert [run[scene.hinges[0].q][-1], w[-1]] == pytest.approx(x, abs=1e-8)


@pytest.mark.parametrize("volt", [5.0, 20.0, 200.0, 2000.0])
@pytest.mark.parametrize("form", ["number", "parameter", "input", "capacitor"])
def test_a_motor_behind_a_diode_begins_at_rest_however_high_the_voltage_is(form: str, volt: float) -> None:
    """Of a diode that would begin with all of it, exponentials are 1e170 and more."""
    scene: Any = ac.System()
    given = {"number": volt, "parameter": ac.Parameter(volt, "V"), "input": ac.Input("V", default=volt)}
    scene.volt = given.get(form, 0.0)
    scene.source = Capacitor(1.0) if form == "capacitor" else VoltageSource(scene.volt)
    scene.motor, scene.diode, scene.rotor, scene.ground = DCMotor(1.0, 2.0), Diode(1e-9, 0.05), Inertia(0.1), Ground()
    scene.connect(scene.motor.flange, scene.rotor.flange_a)
    scene.connect(scene.source.pin_a, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.motor.pin_a)
    scene.connect(scene.motor.pin_b, scene.source.pin_b, scene.ground.pin)
    start = {scene.source.v: volt} if form == "capacitor" else {}
    run = ac.build(scene).simulate(0.5, start, rtol=1e-10)
    drop = brentq(lambda v: 2e-9 * np.expm1(v / 0.05) + v - volt, 0.0, 1.6, xtol=1e-15, rtol=1e-14)
    assert run[scene.diode.v][0] == pytest.approx(drop, rel=1e-12) and run[scene.rotor.phi][0] == run[scene.rotor.w][0] == 0.0
    assert run.energy_error() < 1e-8


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("flat", [False, True])
def test_a_constant_voltage_drives_a_loop_as_an_input_of_the_same_does(flat: bool, size: float) -> None:
    ends: list[np.ndarray] = []
    for volt in (20.0, ac.Input("V", default=20.0)):
        scene, model = driven_loop(volt, size, flat)
        run = model.simulate(0.4, rtol=1e-10)
        assert run.energy_error() < 1e-9
        ends.append(np.array([run[scene.hinges[0].q][-1], run[scene.hinges[0].v][-1], run[scene.diode.v][-1]]))
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)


@pytest.mark.parametrize("flat", [False, True])
def test_a_switch_and_an_input_jump_alike(flat: bool) -> None:
    """Upwards by 50 V, where exponentials of what has not jumped yet are huge."""
    switch = ca.if_else(ac.time.sx >= 1.0, 30.0, ca.if_else(ac.time.sx >= 0.5, -20.0, 20.0))
    ends: list[np.ndarray] = []
    for volt in (switch, ac.Input("V")):
        scene, model = driven_loop(volt, 1.0, flat)
        inputs = {volt: ac.samples([0.0, 0.5, 1.0], [20.0, -20.0, 30.0], "constant")} if isinstance(volt, ac.Input) else {}
        run = model.simulate(1.3, inputs=inputs, rtol=1e-10)
        ends.append(np.array([run[scene.hinges[0].q][-1], run[scene.hinges[0].v][-1], run[scene.diode.v][-1]]))
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)


def test_an_optimum_finds_the_rate_of_such_an_input() -> None:
    """As its message says."""
    source: Any = ac.System()
    source.rate = ac.Input("V/s")
    source.of, source.volt = Constant(source.rate), Integrator()
    source.connect(source.of.output, source.volt.input)
    scene, model = clipper(source.volt.output.value, more=(source,))
    problem = ac.OptimalControl(model, 0.01)
    problem.start({scene.store.v: 0.0, source.volt.x: 0.0})
    problem.end({scene.store.v: 0.1})
    problem.minimise(ac.integral(1e-4 * source.rate**2))
    problem.guess(model.simulate(0.01, inputs={source.rate: 20.0}))
    best = problem.solve(12)
    assert best.replay_error < 1e-8 and best.run[scene.store.v][-1] == pytest.approx(0.1, abs=1e-8)
