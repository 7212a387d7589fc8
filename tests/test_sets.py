"""What events set: relays, thermostats, samplers, ratchets, jumps of states; against closed forms."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import acausal as ac
from acausal.collocation.problem import StatusKind
from acausal.errors import ModelError, OptionError, ParameterError, SimulationError, StartValueError
from acausal.language.mode_laws import ModeLaw
from components import (
    Brake,
    Clutch,
    EndStop,
    Gain,
    Inertia,
    Integrator,
    Limiter,
    Particle,
    Ratchet,
    Relay,
    Revolute,
    RigidBody,
    RotationalGround,
    RotationalSpring,
    SampleAndHold,
    Sum,
    Thermostat,
    TimeFunction,
    TorqueSource,
    TranslationSensor,
    VelocitySource,
    World,
)
from components.translational import ForceSource, SlidingMass, TranslationalGround
from tests.pairings import each_value


def times(run: Any) -> np.ndarray:
    """Of all transitions."""
    return np.array([transition.time for transition in run.transitions])


class Lag(ac.Component):
    """time x' = input - x."""

    input = ac.Signal.port()
    output = ac.Signal.port()
    x = ac.Variable("")

    def __init__(self, time: float) -> None:
        self.time = time

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.time * ac.der(self.x), self.input.value - self.x)
        yield ac.equal(self.output.value, self.x)


def looped(plant: Any, relay: Any) -> ac.System:
    scene = ac.System()
    scene.plant, scene.relay = plant, relay
    scene.connect(scene.plant.output, scene.relay.input)
    scene.connect(scene.relay.output, scene.plant.input)
    return scene


@pytest.mark.parametrize("start", [False, True])
def test_relay_that_begins_at_a_bound_is_beyond_it(start: bool) -> None:
    h, k = 0.3, 2.0
    for x, on in ((h, True), (-h, False)):
        scene = looped(Integrator(), Relay(-h, h, off=k, on=-k, start=start))
        run = ac.build(scene).simulate(0.7, {scene.plant.x: x}, rtol=1e-12)
        assert run[scene.relay.closed][0] == on
        assert times(run) == pytest.approx([0.3, 0.6], rel=1e-12)


@pytest.mark.parametrize("start", [False, True])
def test_thermostat_begins_by_its_input_and_as_it_is_told_only_between_its_bounds(start: bool) -> None:
    lower, upper, power = 292.0, 295.0, 7.0
    scene = looped(Integrator(), Thermostat(lower, upper, power=power, start=start))
    model = ac.build(scene)
    for x, heats in ((lower - 1.0, True), (lower, True), (293.0, start), (upper, False), (upper + 1.0, False)):
        run = model.simulate(0.1, {scene.plant.x: x}, rtol=1e-12)
        assert run[scene.relay.heats][0] == heats
        assert run[scene.plant.x][-1] == pytest.approx(x + 0.1 * power * heats, rel=1e-12)


@pytest.mark.parametrize("part", [Relay, Thermostat])
def test_what_has_no_play_is_refused(part: Any) -> None:
    for upper in (1.0, 1.0 - 1e-9):
        with pytest.raises(ParameterError, match="Give lower < upper"):
            part(1.0, upper)


@pytest.mark.parametrize("size", [1.0, 1e-7, 1e5])
def test_relay_drives_an_integrator_to_and_fro(size: float) -> None:
    # x' = -+ k between -h and h: a triangle, half a period 2 h / k
    h, k = 0.3 * size, 2.0 * size
    scene = looped(Integrator(), Relay(-h, h, off=k, on=-k))
    run = ac.build(scene).simulate(20.0, {scene.plant.x: 0.1 * size}, rtol=1e-12)
    met = times(run)
    assert met[0] == pytest.approx(0.1, rel=1e-13)
    assert np.diff(met) == pytest.approx(0.3, rel=1e-12)
    assert met.size == 67
    assert np.abs(run[scene.plant.x]).max() <= h * (1 + 1e-12)


@pytest.mark.parametrize("start", [0.0, 0.9, -0.9])
def test_relay_drives_a_lag_to_and_fro(start: float) -> None:
    # towards -U from h: x = -U + (U + h) exp(-t / T) reaches -h after T ln((U + h) / (U - h))
    T, U, h = 0.4, 1.0, 0.25
    scene = looped(Lag(T), Relay(-h, h, off=U, on=-U))
    run = ac.build(scene).simulate(5.0, {scene.plant.x: start}, rtol=1e-12)
    assert np.diff(times(run)) == pytest.approx(T * np.log((U + h) / (U - h)), rel=1e-11)
    assert run[scene.relay.closed][0] == (start > h)


def test_thermostat_keeps_a_room_warm() -> None:
    # T' = (a - T) / tau + P on: heats for tau ln((top - lower) / (top - upper)), top = a + P tau, cools for tau ln((upper - a) / (lower - a))
    tau, outside, heating, lower, upper = 500.0, 273.0, 0.08, 291.0, 294.0
    scene = ac.System()
    scene.room, scene.thermostat, scene.weather = Lag(tau), Thermostat(lower, upper, power=heating * tau), ac.Input()

    class Outside(ac.Component):
        input, output = ac.Signal.port(), ac.Signal.port()

        def __init__(self, temperature: ac.Expression) -> None:
            self.temperature = temperature

        def equations(self) -> Iterable[ac.Equation]:
            yield ac.equal(self.output.value, self.input.value + self.temperature)

    scene.outside = Outside(1.0 * scene.weather)
    scene.connect(scene.room.output, scene.thermostat.input)
    scene.connect(scene.thermostat.output, scene.outside.input)
    scene.connect(scene.outside.output, scene.room.input)
    run = ac.build(scene).simulate(4000.0, {scene.room.x: 280.0}, rtol=1e-12, inputs={scene.weather: outside})
    top = outside + heating * tau
    met = np.diff(times(run))
    assert met[::2] == pytest.approx(tau * np.log((upper - outside) / (lower - outside)), rel=1e-11)
    assert met[1::2] == pytest.approx(tau * np.log((top - lower) / (top - upper)), rel=1e-11)
    assert times(run)[0] == pytest.approx(tau * np.log((top - 280.0) / (top - upper)), rel=1e-11)


def falling(mass: float = 2.0, gravity: float = 9.81) -> ac.System:
    scene = ac.System()
    scene.mass, scene.weight = SlidingMass(mass), ForceSource(-mass * gravity)
    scene.connect(scene.mass.flange_b, scene.weight.flange)
    return scene


@each_value(("direction", ["falling", "both"]), ("size", [1.0, 1e-9, 1e6]))
def test_ball_that_is_set_bounces_as_one_that_strikes(direction: str, size: float) -> None:
    free, struck = falling(gravity=9.81 * size), falling(gravity=9.81 * size)
    struck.floor = EndStop(struck.mass.flange_a, lower=0.0, restitution=0.8)
    bounce = ac.when(free.mass.s, direction, set={free.mass.v: -0.8 * free.mass.v})
    one = ac.build(free).simulate(2.5, {free.mass.s: size}, rtol=1e-12, events=[bounce])
    other = ac.build(struck).simulate(2.5, {struck.mass.s: size}, rtol=1e-12)
    assert times(one) == pytest.approx(times(other), rel=1e-13)
    assert one[free.mass.s] == pytest.approx(other[struck.mass.s], abs=1e-12 * size)
    assert one.energy_error() < 1e-11
    first = one.transitions[0]
    assert first.parts == ("mass.v",)
    assert first.after[free.mass.v] == pytest.approx(-0.8 * first.before[free.mass.v], rel=1e-15)
    assert [event.time for event in one.events] == pytest.approx(times(one))


@pytest.mark.parametrize("restitution", [0.95, 0.8, 0.5, 0.1])
def test_bounces_without_end_that_are_set_are_named(restitution: float) -> None:
    # nothing holds the ball when they are over, as a contact would
    scene = falling()
    bounce = ac.when(scene.mass.s, "falling", set={scene.mass.v: -restitution * scene.mass.v})
    run = ac.build(scene).simulate(30.0, {scene.mass.s: 1.0}, events=[bounce], raise_on_failure=False)
    assert run.status.kind is StatusKind.CHATTERS
    assert "test_sets.py" in run.status.message
    assert run.t[-1] == pytest.approx(np.sqrt(2 / 9.81) * (1 + restitution) / (1 - restitution), rel=2e-2)


@pytest.mark.parametrize("t0", [0.0, 0.013])
def test_sampled_controller_moves_as_the_discrete_system_does(t0: float) -> None:
    # x' = A x + B u, u = -K x at the last sample: x_{k + 1} = (exp(A T) - int exp(A s) ds B K) x_k
    mass, k, d, T = 2.0, 30.0, 9.0, 0.02

    class Plant(ac.Component):
        force, place, rate = ac.Signal.port(), ac.Signal.port(), ac.Signal.port()
        x, v = ac.Variable("m"), ac.Variable("m/s")

        def equations(self) -> Iterable[ac.Equation]:
            yield ac.equal(ac.der(self.x), self.v)
            yield ac.equal(mass * ac.der(self.v), self.force.value)
            yield ac.equal(self.place.value, self.x)
            yield ac.equal(self.rate.value, self.v)

    scene = ac.System()
    scene.plant, scene.law, scene.hold = Plant(), Sum(-k, -d), SampleAndHold(T)
    scene.connect(scene.plant.place, scene.law.inputs[0])
    scene.connect(scene.plant.rate, scene.law.inputs[1])
    scene.connect(scene.law.output, scene.hold.input)
    scene.connect(scene.hold.output, scene.plant.force)
    start = np.array([1.0, -0.3])
    run = ac.build(scene).simulate(
        t0 + 4.0, {scene.plant.x: start[0], scene.plant.v: start[1]}, t0=t0, rtol=1e-12, samples=[t0, *(T * np.arange(1, 200))]
    )

    def over(h: float) -> np.ndarray:
        whole = scipy.linalg.expm(h * np.array([[0, 1, 0], [0, 0, 1 / mass], [0, 0, 0]]))
        return whole[:2, :2] + whole[:2, 2:] @ np.array([[-k, -d]])

    expected = [start, over(T - t0) @ start]
    for _ in range(198):
        expected.append(over(T) @ expected[-1])
    assert pytest.approx(np.array(expected), abs=1e-12) == run.x.T
    assert times(run) == pytest.approx(T * np.arange(1, times(run).size + 1), rel=1e-14)


def test_ratchet_keeps_what_has_been_climbed() -> None:
    # thrown up to v^2 / 2 g, it falls back on the last tooth below
    v, g, pitch = 3.0, 9.81, 0.13
    scene = falling(gravity=g)
    scene.wall = TranslationalGround()
    scene.ratchet = Ratchet(scene.wall.flange, scene.mass.flange_a, pitch)
    run = ac.build(scene).simulate(2.0, {scene.mass.v: v}, rtol=1e-12)
    teeth = np.floor(v**2 / (2 * g) / pitch)
    assert run[scene.ratchet.tooth][-1] == teeth
    assert run[scene.mass.s][-1] == pytest.approx(pitch * teeth, rel=1e-13)
    passed = [(v - np.sqrt(v**2 - 2 * g * pitch * n)) / g for n in range(1, int(teeth) + 1)]
    struck = (v + np.sqrt(v**2 - 2 * g * pitch * teeth)) / g
    assert times(run) == pytest.approx([*passed, struck], rel=1e-12)
    assert run[scene.ratchet.push][-1] == pytest.approx(2 * g, rel=1e-12)
    assert run.transitions.energy_lost.sum() == pytest.approx(v**2 - 2 * g * pitch * teeth, rel=1e-11)
    assert run.energy_error() < 1e-11


def test_what_is_remembered_begins_with_a_number_or_says_what_does_not() -> None:
    """Teeth whose pitch grows as the time, which is nothing at the start: 0 / 0 of them are passed. Later it counts."""
    rate, v = 0.3, 2.0
    scene = falling(gravity=0.0)
    scene.wall = TranslationalGround()
    scene.ratchet = Ratchet(scene.wall.flange, scene.mass.flange_a, rate * ac.time)
    model = ac.build(scene)
    with pytest.raises(SimulationError, match=r"ratchet\.tooth begins with what is no number"):
        model.simulate(1.0, {scene.mass.v: v})
    for ask in (model.equilibrium, model.linearize):
        with pytest.raises(StartValueError, match=r"ratchet\.tooth begins with what is no number"):
            ask()
    run = model.simulate(5.0, {scene.mass.s: 0.25, scene.mass.v: v}, t0=0.5)
    assert run[scene.ratchet.tooth] == pytest.approx(np.floor(run[scene.mass.s] / (rate * run.t)))
    assert run.constraint_error() < 1e-12


def test_limiter_saturates() -> None:
    # v' = -clip(k v, 1): straight, then exponential from v = 1 / k on
    k, v = 4.0, 2.0
    scene = ac.System()
    scene.plant, scene.gain, scene.limiter = Integrator(), Gain(-k), Limiter(-1.0, 1.0)
    scene.connect(scene.plant.output, scene.gain.input)
    scene.connect(scene.gain.output, scene.limiter.input)
    scene.connect(scene.limiter.output, scene.plant.input)
    run = ac.build(scene).simulate(4.0, {scene.plant.x: v}, rtol=1e-12)
    bend = v - 1 / k
    expected = np.where(run.t < bend, v - run.t, np.exp(-k * (run.t - bend)) / k)
    assert run[scene.plant.x] == pytest.approx(expected, abs=1e-12)


class Counts(ac.Component):
    """Events that set what other events look at."""

    x = ac.Variable("")

    def __init__(self, first: float = 0.5, most: float = 3.0) -> None:
        self.first, self.most = first, most
        self.one, self.two = ac.Discrete(), ac.Discrete(start=2.0)

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(ac.der(self.x), 1.0 + 0.0 * self.one)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.when(self.x - self.first, "rising", set={self.one: self.two, self.two: self.one + 10.0})
        yield ac.when(self.two - 9.0, "rising", set={self.x: self.x + 1.0})


def test_what_is_set_is_set_at_once_and_sets_off_what_follows() -> None:
    scene = ac.System()
    scene.counts = Counts()
    run = ac.build(scene).simulate(1.0, {scene.counts.x: 0.0}, rtol=1e-12)
    assert run[scene.counts.one][-1] == 2.0
    assert run[scene.counts.two][-1] == 10.0
    assert run[scene.counts.x][-1] == pytest.approx(2.0, rel=1e-13)
    assert times(run) == pytest.approx(0.5)
    assert run.transitions[-1].before[scene.counts.x] == pytest.approx(0.5)
    assert run.transitions[-1].after[scene.counts.x] == pytest.approx(1.5)


def test_discrete_values_have_start_values() -> None:
    scene = ac.System()
    scene.counts = Counts()
    model = ac.build(scene)
    run = model.simulate(1.0, {scene.counts.x: 0.0, scene.counts.two: 5.0})
    assert run[scene.counts.two][0] == 5.0
    assert run[scene.counts.one][-1] == 5.0


def test_runs_with_what_is_set_are_pickled() -> None:
    free = falling()
    bounce = ac.when(free.mass.s, "falling", set={free.mass.v: -0.8 * free.mass.v})
    run = ac.build(free).simulate(1.5, {free.mass.s: 1.0}, events=[bounce])
    again = pickle.loads(pickle.dumps(run))
    assert str(again.transitions) == str(run.transitions)
    assert np.array_equal(again["mass.v"], run["mass.v"])


@pytest.mark.parametrize("compiled", [True, False])
def test_who_carries_out_the_arithmetic_changes_nothing(compiled: bool) -> None:
    scene = looped(Lag(0.4), Relay(-0.25, 0.25, off=1.0, on=-1.0))
    run = ac.build(scene).simulate(3.0, {scene.plant.x: 0.1}, rtol=1e-12, compiled=compiled)
    assert np.diff(times(run)) == pytest.approx(0.4 * np.log(1.25 / 0.75), rel=1e-11)


def test_thrown_back_by_an_event_a_block_that_stuck_slides() -> None:
    # mu N = 3 holds it against 2; set to speed 1 at t = 1 it stops after m / (3 - 2)
    scene = ac.System()
    scene.mass, scene.push = SlidingMass(2.0), ForceSource(2.0)
    scene.connect(scene.mass.flange_b, scene.push.flange)
    scene.brake = Brake(scene.mass.flange_a, 3.0)
    kick = ac.when(ac.time - 1.0, set={scene.mass.v: 1.0})
    run = ac.build(scene).simulate(4.0, {}, rtol=1e-12, events=[kick])
    assert run[scene.mass.s][-1] == pytest.approx(1.0, rel=1e-12)
    assert [t for t in times(run) if t > 0] == pytest.approx([1.0, 1.0, 3.0][-len([t for t in times(run) if t > 0]) :])
    assert run[scene.mass.v][-1] == 0.0
    assert run.energy_error() < 1e-11


def test_velocities_in_space_are_set() -> None:
    scene = ac.System()
    scene.world, scene.ball, scene.box = World(), Particle(0.3), RigidBody.box(mass=1.0, size=(0.1, 0.2, 0.3))
    model = ac.build(scene)
    ball, box = scene.ball.point, scene.box.frame
    turn = ac.when(ac.time - 0.25, set={ball.velocity: [1.0, 2.0, 3.0], box.velocity: [0.5, 0.0, 0.0]})
    run = model.simulate(0.5, {box.angular_velocity: (0.3, 2.0, 1.0)}, rtol=1e-12, events=[turn])
    assert run[ball.velocity][-1] == pytest.approx([1.0, 2.0, 3.0 - 0.25 * 9.81], rel=1e-12)
    assert run[box.velocity][-1] == pytest.approx([0.5, 0.0, -0.25 * 9.81], abs=1e-12)
    assert run[box.angular_velocity][-1] != pytest.approx([0.3, 2.0, 1.0], abs=1e-3)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (lambda s: {s.mass.v: float("nan")}, "finite"),
        (lambda s: {s.limit: 1.0}, "parameter"),
        (lambda s: {s.force: 1.0}, "input"),
        (lambda s: {s.mass.v: [1.0, 2.0]}, "entries"),
        (lambda s: {s.mass.flange_a.f: 1.0}, "no state"),
        (lambda s: {ac.time: 1.0}, "time"),
        (lambda s: {s.mass.v: 1.0, "mass.v": 2.0}, "twice"),
        (lambda s: {ac.Discrete(): 1.0}, "belongs to no part"),
    ],
)
def test_what_cannot_be_set_is_refused(what: Any, words: str) -> None:
    scene = ac.System()
    scene.limit, scene.force = ac.Parameter(1.0), ac.Input("N")
    scene.mass, scene.source = SlidingMass(2.0 * scene.limit), ForceSource(scene.force)
    scene.connect(scene.mass.flange_b, scene.source.flange)
    given: Mapping[Any, Any] = what(scene)
    with pytest.raises(ModelError, match=words) as caught:
        ac.build(scene).simulate(1.0, {}, events=[ac.when(scene.mass.s - 1.0, set=given)])
    assert "test_sets.py" in str(caught.value)


def test_guards_that_are_always_zero_are_refused() -> None:
    scene = falling()
    event = ac.when(scene.mass.s - scene.mass.flange_a.s, set={scene.mass.v: 0.0})
    with pytest.raises(ModelError, match="zero at all times"):
        ac.build(scene).simulate(1.0, {}, events=[event])


def test_events_that_set_do_not_stop_and_set_something() -> None:
    scene = falling()
    with pytest.raises(OptionError, match="do not go together"):
        ac.when(scene.mass.s, stop=True, set={scene.mass.v: 0.0})
    with pytest.raises(OptionError, match="new values"):
        ac.when(scene.mass.s, set={})


def test_what_becomes_no_number_and_what_is_set_twice_is_told() -> None:
    scene = falling()
    model, start = ac.build(scene), {scene.mass.s: 1.0}
    root = ac.when(scene.mass.s, "falling", set={scene.mass.v: np.sqrt(scene.mass.v)})
    run = model.simulate(2.0, start, events=[root], raise_on_failure=False)
    assert run.status.kind is StatusKind.CANNOT_SET
    assert "mass.v" in run.status.message
    assert "no number" in run.status.message
    twice = [ac.when(scene.mass.s, "falling", set={scene.mass.v: value}) for value in (1.0, 2.0)]
    run = model.simulate(2.0, start, events=twice, raise_on_failure=False)
    assert run.status.kind is StatusKind.CANNOT_SET
    assert "same instant" in run.status.message
    assert run.t[-1] == pytest.approx(np.sqrt(2 / 9.81), rel=1e-9)


def test_coordinates_that_loops_tie_are_not_set_alone() -> None:
    scene = ac.System()
    scene.world = World()
    for name, length in (("crank", 0.3), ("coupler", 0.6), ("rocker", 0.5)):
        setattr(scene, name, RigidBody.rod(mass=1.0, tip=(length, 0.0, 0.0)))
    for name in "abcd":
        setattr(scene, name, Revolute(axis=(0, 1, 0)))
    ends = [scene.world.frame, scene.crank.frame, scene.crank.tip, scene.coupler.frame, scene.coupler.tip, scene.rocker.tip]
    ends += [scene.rocker.frame, scene.world.at((0.5, 0.0, 0.0))]
    for joint, first, second in zip((scene.a, scene.b, scene.c, scene.d), ends[::2], ends[1::2], strict=True):
        scene.connect(first, joint.frame_a)
        scene.connect(joint.frame_b, second)
    model = ac.build(scene)
    free = model.simulate(0.2, {scene.a.q: ac.near(0.3)})
    event = ac.when(ac.time - 0.1, set={scene.a.v: 5.0})
    run = model.simulate(0.2, {scene.a.q: ac.near(0.3)}, events=[event], raise_on_failure=False)
    assert free.status.kind is StatusKind.SUCCESS
    assert run.status.kind is StatusKind.CANNOT_SET
    assert "tie together" in run.status.message


class Remembers(ac.Component):
    """Reflects a mass at zero, and integrates the speed that it struck with."""

    x = ac.Variable("")

    def __init__(self, restitution: ac.Parameter, mass: SlidingMass) -> None:
        self.restitution, self.mass, self.met = restitution, mass, ac.Discrete("m/s")

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(ac.der(self.x), 1.0 * self.met)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.when(self.mass.s, "falling", set={self.mass.v: -self.restitution * self.mass.v, self.met: self.mass.v})


def test_derivatives_go_through_what_is_set() -> None:
    # falls from h in T = sqrt(2 h / g), strikes with -g T, rises with e g T: s = e g T (t - T) - g (t - T)^2 / 2, x = -g T (t - T)
    g, h, e, t = 9.81, 1.0, 0.8, 0.8
    scene = falling(gravity=g)
    scene.e = ac.Parameter(e)
    scene.memory = Remembers(scene.e, scene.mass)
    found = ac.build(scene).sensitivities([0.0, 0.2, t], [scene.mass.s, scene.e], {scene.mass.s: h}, rtol=1e-12)
    T = np.sqrt(2 * h / g)
    by_height = T / (2 * h)
    assert found[scene.mass.s][2] == pytest.approx([(e * g * (t - 2 * T) + g * (t - T)) * by_height, g * T * (t - T)], rel=1e-10)
    assert found[scene.mass.v][2] == pytest.approx([(e * g + g) * by_height, g * T], rel=1e-10)
    assert found[scene.memory.x][2] == pytest.approx([-g * (t - 2 * T) * by_height, 0.0], abs=1e-11)
    assert found[scene.memory.met][2] == pytest.approx([-g * by_height, 0.0], abs=1e-11)
    assert found[scene.memory.met][1] == pytest.approx([0.0, 0.0])


class Brakes(ac.Component):
    """x' = - held x, held as x was at the start."""

    x = ac.Variable("")

    def __init__(self) -> None:
        self.held = ac.Discrete(start=2.0 * self.x)

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(ac.der(self.x), -1.0 * self.held * self.x)


def test_linear_systems_are_those_of_what_is_remembered() -> None:
    scene = ac.System()
    scene.brakes = Brakes()
    model = ac.build(scene)
    assert model.linearize({scene.brakes.x: 3.0}).A[0, 0] == pytest.approx(-6.0)
    assert model.linearize({scene.brakes.x: 3.0, scene.brakes.held: 0.5}).A[0, 0] == pytest.approx(-0.5)
    assert model.simulate(1.0, {scene.brakes.x: 3.0})[scene.brakes.x][-1] == pytest.approx(3 * np.exp(-6), rel=1e-6)


def test_minimal_models_refuse_what_is_set() -> None:
    scene = looped(Lag(0.4), Relay(-0.25, 0.25, off=1.0, on=-1.0))
    with pytest.raises(OptionError, match="minimal does not go"):
        ac.build(scene).minimal()
    free = falling()
    with pytest.raises(OptionError, match=r"model\.simulate only"):
        ac.build(free).minimal({free.mass.s: 1.0}).simulate(1.0, events=[ac.when(free.mass.s, set={free.mass.v: 0.0})])


@each_value(("method", ["gauss", "radau"]), ("rtol", [1e-4, 1e-8, 1e-12]), ("size", [1.0, 1e-3]))
def test_what_a_motion_keeps_at_zero_sets_nothing(method: str, rtol: float, size: float) -> None:
    """The energy against that of the start: what the tolerance makes of it passes nothing, in either direction; a small multiple of what moves does."""
    scene = ac.System()
    scene.world, scene.hinge, scene.rod = World((0, 0, -9.81 * size)), Revolute("y"), RigidBody.rod(1.0, (0, 0, -size))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.rod.frame)
    q, v = scene.hinge.q, scene.hinge.v
    energy = size**2 * (v**2 / 6 - 9.81 / 2 * (np.cos(q) - np.cos(0.5)))
    run = ac.build(scene).simulate(
        10.0,
        {q: 0.5},
        rtol=rtol,
        method=method,
        events=[ac.when(energy, "both", set={v: 2 * v}), ac.when(1e-3 * q, "falling", set={v: v})],
    )
    counted = [change.time for change in run.transitions]
    assert len(counted) == 6 and abs(run[q]).max() < 0.5 + 10 * rtol


class Escapement(ac.Component):
    """Lets a wheel on by one tooth whenever a balance goes through its middle."""

    balance, wheel = ac.Rotational.port(), ac.Rotational.port()

    def __init__(self, pitch: float) -> None:
        self.pitch, self.push, self.count = pitch, ac.Reaction("N*m"), ac.Discrete(start=0)

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.wheel.tau, self.push)
        yield ac.equal(self.balance.tau, 0.0)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.OneSided(self.push, self.pitch * self.count - self.wheel.phi)
        for direction in ("rising", "falling"):
            yield ac.when(self.balance.phi, direction, set={self.count: self.count + 1.0})


@pytest.mark.parametrize("inertia", [3e-7, 0.7])
def test_a_wheel_turns_on_from_where_it_stands_when_its_pallet_is_set_further(inertia: float) -> None:
    torque, balance, pitch, swing = 2.0 * inertia, 2.1, 0.3, 0.9
    half, falls = np.pi / np.sqrt(5.3 / balance), np.sqrt(2 * pitch * inertia / torque)
    scene = ac.System()
    scene.ground, scene.spring, scene.balance = RotationalGround(), RotationalSpring(5.3), Inertia(balance)
    scene.drive, scene.wheel, scene.pallets = TorqueSource(torque), Inertia(inertia), Escapement(pitch)
    scene.connect(scene.ground.flange, scene.spring.flange_a)
    scene.connect(scene.spring.flange_b, scene.balance.flange_a)
    scene.connect(scene.balance.flange_b, scene.pallets.balance)
    scene.connect(scene.drive.flange, scene.wheel.flange_a)
    scene.connect(scene.wheel.flange_b, scene.pallets.wheel)
    model, start = ac.build(scene), {scene.balance.phi: swing, scene.balance.w: 0.0, scene.wheel.phi: 0.0, scene.wheel.w: 0.0}
    assert falls < half
    for after, phi, speed in ((0.4, 7.16 * pitch, 0.4), (1.3, 8 * pitch, 0.0)):
        run = model.simulate(7.5 * half + after * falls, start, rtol=1e-12)
        assert run[scene.pallets.count][-1] == 8
        assert run[scene.wheel.phi][-1] == pytest.approx(phi, rel=1e-12)
        assert run[scene.wheel.w][-1] == pytest.approx(speed * falls * torque / inertia, rel=1e-11, abs=1e-11)


class SetBelt(ac.Component):
    """A belt that rubs, whose speed is set when a signal has risen above a level."""

    flange, input = ac.Translational.port(), ac.Signal.port()

    def __init__(self, limit: ac.Scalar, first: ac.Scalar, second: ac.Scalar, level: ac.Scalar) -> None:
        self.drag, self.limit, self.second, self.level = ac.Reaction("N"), limit, second, level
        self.speed = ac.Discrete("m/s", start=first)

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange.f, -1.0 * self.drag)

    def laws(self) -> Iterable[ModeLaw]:
        yield ac.DryFriction(self.drag, ac.der(self.flange.s) - self.speed, self.limit, self.limit)
        yield ac.when(self.input.value - self.level, "rising", set={self.speed: self.second})


@pytest.mark.parametrize("size", [1.0, 1e3])
def test_what_sticks_to_a_belt_slips_when_the_speed_of_that_is_set_and_derivatives_follow(size: float) -> None:
    """It sticks until s = level, slips from the first speed to the second, and sticks again, also to what speeds become by parameters."""
    mass, numbers, t = 2.0, np.array([1.0, 0.4, -0.3, 0.2]) * size, 3.0
    scene = ac.System()
    scene.limit, scene.first, scene.second, scene.level = (
        ac.Parameter(value, unit) for value, unit in zip(numbers, ("N", "m/s", "m/s", "m"), strict=True)
    )
    scene.mass, scene.where = SlidingMass(mass), TranslationSensor()
    scene.belt = SetBelt(scene.limit, scene.first, scene.second, scene.level)
    scene.connect(scene.mass.flange_a, scene.belt.flange, scene.where.flange)
    scene.connect(scene.where.position, scene.belt.input)

    def place(limit: complex, first: complex, second: complex, level: complex) -> complex:
        slips = (first - second) * mass / limit
        return level + (first + second) / 2 * slips + second * (t - level / first - slips)

    model = ac.build(scene)
    start = {scene.mass.s: 0.0, scene.mass.v: numbers[1]}
    run = model.simulate(t, start, rtol=1e-12)
    assert run[scene.mass.s][-1] == pytest.approx(place(*numbers), rel=1e-12)
    assert run[scene.mass.v][-1] == pytest.approx(numbers[2], rel=1e-13)
    wrt = [scene.limit, scene.first, scene.second, scene.level]
    found = model.sensitivities([0.0, t], wrt, start, rtol=1e-12)
    steps = 1e-30j * np.eye(4)
    assert found[scene.mass.s][-1] == pytest.approx([place(*(numbers + step)).imag / 1e-30 for step in steps], rel=1e-9)
    assert found[scene.mass.v][-1] == pytest.approx([0.0, 0.0, 1.0, 0.0], abs=1e-10)


def test_what_is_set_beyond_what_keeps_it_is_told_by_part_and_not_moved() -> None:
    def scene(after: float) -> tuple[ac.Model, SlidingMass]:
        scene = ac.System()
        scene.mass, scene.push, scene.clock = SlidingMass(2.0), ForceSource(3.0), TimeFunction(lambda t: t)
        scene.relay = Relay(-1.0, 1.0, off=0.5, on=after)
        scene.stop = EndStop(scene.mass.flange_a, upper=scene.relay.output.value)
        scene.connect(scene.clock.output, scene.relay.input)
        scene.connect(scene.mass.flange_b, scene.push.flange)
        return ac.build(scene), scene.mass

    model, mass = scene(0.2)
    with pytest.raises(SimulationError, match=r"gap of stop .* is negative at t = 1 s, where it jumps \(-0\.3 m\)"):
        model.simulate(2.0, {mass.s: 0.5})
    with pytest.raises(SimulationError, match=r"gap of stop .* is negative at t = 0\.5 s, where it jumps \(-0\.1 m\)"):
        model.simulate(2.0, {mass.s: 0.5}, events=[ac.when(ac.time - 0.5, "rising", set={mass.s: 0.6})])
    model, mass = scene(0.8)
    assert model.simulate(1.3, {mass.s: 0.5}, rtol=1e-12)[mass.s][-1] == pytest.approx(0.5 + 0.75 * 0.09, rel=1e-12)


class Setter(ac.Component):
    """What it is given as its laws."""

    def __init__(self, *laws: ModeLaw) -> None:
        self.given = laws

    def laws(self) -> Iterable[ModeLaw]:
        yield from self.given


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_what_depends_on_what_is_set_by_what_is_set_is_heeded_in_the_same_instant(seed: int, turned: bool) -> None:
    """A time sets a, that sets b, and where b is more than a half a belt runs, on which a block slides until it is as fast."""
    rng = np.random.default_rng(seed)
    late, speed, mass = rng.integers(4, 60) / 64, 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-2, 2)
    drag = mass * speed * rng.uniform(0.2, 3)
    scene = ac.System()
    scene.a, scene.b = ac.Discrete(), ac.Discrete()
    scene.mass, scene.belt = SlidingMass(mass), VelocitySource(np.where(scene.b > 0.5, speed, 0.0))
    scene.rub = Clutch(scene.belt.flange, scene.mass.flange_a, capacity=drag, holding=rng.uniform(1, 2) * drag)
    laws = ac.when(ac.time - late, set={scene.a: 1.0}), ac.when(scene.a - 0.5, set={scene.b: scene.a})
    scene.setter = Setter(*(reversed(laws) if turned else laws))
    sticks = late + speed * mass / drag
    run = ac.build(scene).simulate(1.2 * sticks, {scene.mass.s: 0.0, scene.mass.v: 0.0, scene.belt.flange.s: 0.0}, rtol=1e-12)
    assert run.transitions[-1].time == pytest.approx(sticks, rel=1e-12)
    assert run[scene.mass.s][-1] == pytest.approx(speed**2 * mass / drag / 2 + speed * 0.2 * sticks, rel=1e-11)


@pytest.mark.parametrize("t0", [-0.7, 0.3, 1.0, 2.6])
def test_samples_are_taken_at_whole_periods_whenever_a_motion_begins(t0: float) -> None:
    period, rate = 0.5, 3.0
    scene = ac.System()
    scene.plant, scene.hold, scene.rate = Integrator(), SampleAndHold(period), TimeFunction(lambda t: rate + 0 * t)
    scene.connect(scene.rate.output, scene.plant.input)
    scene.connect(scene.plant.output, scene.hold.input)
    run = ac.build(scene).simulate(t0 + 1.2, {scene.plant.x: rate * t0}, t0=t0, samples=np.linspace(t0, t0 + 1.2, 25), rtol=1e-11)
    ticks = period * np.arange(np.floor(t0 / period) + 1, np.floor((t0 + 1.2) / period) + 1)
    assert times(run) == pytest.approx(ticks, rel=1e-12)
    between = np.array([np.min(np.abs(np.append(ticks, 9.0) - t)) > 1e-6 for t in run.t])
    last = np.array([max([t0, *ticks[ticks <= t]]) for t in run.t])
    assert np.ravel(run[scene.hold.output.value])[between] == pytest.approx(rate * last[between], rel=1e-11)
