"""Exported simulators with switches, tables, formulas, stiffness and longest steps: the bits of the package, whatever it does."""

from __future__ import annotations

import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import acausal as ac
from acausal.errors import ExportError
from components import Force, Particle, Prismatic, World
from tests.exported import AT_EVENT, AUTO, BAD_ARGUMENT, GAUSS, INPUT, MAX_STEPS, PARAMETER, RADAU, SLIDES, SUCCESS, Library
from tests.pairings import each_value

T = ac.time.sx
END = 4.0
METHODS = {"auto": AUTO, "gauss": GAUSS, "radau": RADAU}


class Machine(ac.System):
    """A mass on a rail between a stop and a relay, shaken at times that are part of it, and pulled by inputs of every kind."""

    def __init__(self) -> None:
        self.damping, self.relay, self.friction = ac.Parameter(0.0, "N*s/m"), ac.Parameter(0.0, "N"), ac.Parameter(0.0, "N")
        self.lines, self.held, self.wave, self.stairs, self.plain = (ac.Input("N") for _ in range(5))
        self.world, self.rail, self.mass = World((0, 0, 0)), Prismatic("x"), Particle(1.0)
        q, v = self.rail.q.sx, self.rail.v.sx
        stop = 50 * ca.fmax(q - 0.4, 0)
        shaken = ca.if_else(ca.fmod(T, 0.7) < 0.2, 1.0, -0.5) + ca.fabs(T - 1.1)
        pulled = sum(self[name].sx for name in ("lines", "held", "wave", "stairs", "plain"))
        force = shaken + pulled - 3 * q - stop - self.damping.sx * v - self.relay.sx * ca.sign(q) - self.friction.sx * ca.sign(v)
        self.push = Force((force, 0, 0))
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.mass.point, self.push.point)

    def __getitem__(self, name: str) -> ac.Input:
        return getattr(self, name)

    def inputs(self) -> dict[ac.Input, object]:
        """Lines between samples, values held, a periodic spline, a formula that jumps, a number."""
        return {
            self.lines: ac.samples([0, 1, 2.5, 3], [0, 1, -1, 2.0]),
            self.held: ac.samples([0.3, 1.2, 3.1], [0.0, 1.0, -0.5], "constant"),
            self.wave: CubicSpline([0, 0.5, 1.1], [0, 1, 0], bc_type="periodic"),
            self.stairs: 0.1 * ca.floor(2.3 * T) + 0.2 * ca.sin(3 * T),
            self.plain: 0.25,
        }


@pytest.fixture(scope="module")
def machine():
    scene = Machine()
    model = ac.build(scene)
    start, inputs = {scene.rail.q: 0.3, scene.rail.v: 0.5}, scene.inputs()
    events = [ac.when(scene.rail.v, "falling")]
    with tempfile.TemporaryDirectory() as folder:
        made = model.export_simulator(Path(folder) / "x", start, inputs=inputs, events=events)
        yield scene, model, start, inputs, Library(made)


@each_value(
    ("method", METHODS),
    (
        ("damping", "relay", "options"),
        [(0, 0, {}), (0.1, 2, {"rtol": 1e-12}), (1e5, 0, {"rtol": 1e-6}), (0, 0.5, {"max_step": 0.01}), (0.1, 0, {"step": 0.01})],
    ),
)
def test_whatever_switches_or_is_stiff_the_bits_are_those_of_the_package(machine, method, damping, relay, options):
    scene, model, start, inputs, library = machine
    run = model.simulate(
        END, start, parameters={scene.damping: damping, scene.relay: relay}, inputs=inputs, method=method, **options
    )
    times = np.linspace(0, END, 41)  # knots among them
    chosen = library.options(method=METHODS[method], **options)
    report, x = library.simulate(times, p=[damping, relay, 0.0], options=chosen)
    assert (report.status, report.steps) == (SUCCESS, run.statistics.steps)
    assert np.array_equal(x, run.at(times).x)
    assert (report.radau_steps > 0) == ("radau" in run.statistics.method)


def test_events_between_knots_and_switches_are_found_alike_step_by_step(machine):
    scene, model, start, inputs, library = machine
    run = model.simulate(END, start, inputs=inputs, events=[ac.when(scene.rail.v, "falling")])
    instance = library.instance()
    assert instance.started() == instance.set_end(END) == SUCCESS
    assert [event.time for event in instance.events(END)] == [event.time for event in run.events] and run.events
    assert np.array_equal(instance.x, run.x[:, -1])


def test_real_time_in_short_periods_ends_steps_at_knots_too(machine):
    """Without an end, step by step: rounding beside the motion in one run, tight as it is."""
    _, model, start, inputs, library = machine
    instance = library.instance(library.options(rtol=1e-12))
    assert instance.started() == SUCCESS
    for t in np.linspace(0.05, END, 80):
        list(instance.events(t))
    assert np.max(np.abs(instance.x - model.simulate(END, start, inputs=inputs, rtol=1e-12).x[:, -1])) < 1e-11


@pytest.mark.parametrize("method", ["auto", "gauss"])
def test_pieces_go_on_by_the_method_of_what_was_before_and_their_steps_add_up(machine, method):
    _, model, _, _, library = machine
    stiff = list(model.parameter_names).index("damping"), 1e5

    def moved(**more):
        options = library.options(method=METHODS[method], rtol=1e-6, **more)
        instance, found = library.instance(options), []
        assert instance.set(PARAMETER, *stiff) == instance.started() == SUCCESS
        for end in np.linspace(3.0, END, 21):
            while (status := instance.advance(end)) == AT_EVENT:
                pass
            found.append(instance.summary())
            if status != SUCCESS:
                break
            assert instance.renew() == SUCCESS
        return found

    reports = moved()
    assert reports[0].newton_steps > 0 and len({r.steps - r.newton_steps for r in reports}) == 1
    assert method == "gauss" or (reports[0].radau_steps > 0 and len({r.steps - r.radau_steps for r in reports[1:]}) == 1)
    enough = reports[0].steps + 10
    last = moved(max_steps=enough)[-1]
    assert (last.status, last.steps) == (MAX_STEPS, enough) and enough < reports[-1].steps


def test_a_motion_that_slides_along_a_switch_says_so(machine):
    scene, model, start, inputs, library = machine
    p = {scene.damping: 1.0, scene.friction: 20.0}
    status = model.simulate(END, start, parameters=p, inputs=inputs, raise_on_failure=False).status
    report, _ = library.simulate([END], p=[1.0, 0.0, 20.0])
    assert report.status == SLIDES and report.time == status.time
    assert report.message.decode() == status.message


def test_tables_stay_tables_and_numbers_may_be_set(machine):
    _, _, _, _, library = machine
    instance = library.instance()
    assert [instance.set(INPUT, k, 1.0) for k in range(5)] == [*[BAD_ARGUMENT] * 4, SUCCESS]
    assert instance.started() == SUCCESS
    list(instance.events(1.5))
    now = instance.all(INPUT)
    assert np.allclose(now[[0, 1, 4]], [1 / 3, 1.0, 1.0], atol=1e-15) and now[3] == 0.1 * np.floor(2.3 * 1.5) + 0.2 * np.sin(4.5)


@pytest.mark.parametrize(
    ("given", "words"),
    [(lambda t: t, "function of Python"), (ca.sign(ca.sin(T)), "do not follow one another regularly")],
    ids=["function", "formula"],
)
def test_inputs_that_are_no_data_are_refused_by_name(machine, tmp_path, given, words):
    scene, model, start, inputs, _ = machine
    with pytest.raises(ExportError, match=f"the input plain is .*{words}"):
        model.export_simulator(tmp_path, start, inputs={**inputs, scene.plain: given})
