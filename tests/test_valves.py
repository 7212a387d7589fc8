"""Ideal diodes, against closed forms."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest

import acausal as ac
from acausal.collocation.modes import WithModes
from acausal.simulate.one_way import warn_if_passed_back
from components import (
    Capacitor,
    Ground,
    IdealDiode,
    Inductor,
    PointOnPlane,
    PrescribedMotion,
    Resistor,
    Thyristor,
    VoltageSource,
    World,
)
from tests.pairings import each_value


def changes(run: Any) -> list[float]:
    """Times of changes of mode after the start."""
    return [change.time for change in run.solution.modes.changes if change.row >= 0]


def rectifier(bulk: Resistor | Inductor, load: float, capacity: float | None, leakage: float = 0.0) -> Any:
    scene = ac.System()
    scene.mains, scene.bulk = VoltageSource(lambda t: 10 * np.sin(100 * t)), bulk
    scene.diode, scene.load, scene.ground = IdealDiode(leakage), Resistor(load), Ground()
    scene.connect(scene.mains.pin_a, scene.bulk.pin_a)
    scene.connect(scene.bulk.pin_b, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.mains.pin_b, scene.ground.pin)
    if capacity is not None:
        scene.store = Capacitor(capacity)
        scene.connect(scene.store.pin_a, scene.diode.pin_b)
        scene.connect(scene.store.pin_b, scene.ground.pin)
    return scene


def test_half_wave_rectifier_conducts_while_the_source_is_above_the_store() -> None:
    """Both parts are linear circuits of one state: v' = (s - v) / (R C) - v / (Q C), and v' = -v / (Q C)."""
    R, Q, C, w = 1.0, 50.0, 2e-4, 100.0
    scene = rectifier(Resistor(R), Q, C)
    run = ac.build(scene).simulate(0.09, {scene.store.v: 0.0}, rtol=1e-12)
    k, a = 1 / (R * C) + 1 / (Q * C), 10 / (R * C)

    def charged(t: float, t0: float, v0: float) -> float:
        def part(t: float) -> float:
            return a * (k * math.sin(w * t) - w * math.cos(w * t)) / (k * k + w * w)

        return (v0 - part(t0)) * math.exp(-k * (t - t0)) + part(t)

    times, values = [0.0, *changes(run)], [0.0]
    assert len(times) == 4
    for n, (begin, end) in enumerate(itertools.pairwise(times)):
        before = values[-1]
        values.append(charged(end, begin, before) if n % 2 == 0 else before * math.exp(-(end - begin) / (Q * C)))
        assert values[-1] == pytest.approx(10 * math.sin(w * end), rel=1e-10)
    assert run[scene.store.v][-1] == pytest.approx(values[-1] * math.exp(-(0.09 - times[-1]) / (Q * C)), rel=1e-10)
    assert np.min(run[scene.diode.i]) > -1e-12
    assert np.max(run[scene.diode.v]) < 1e-12


def test_diode_right_at_a_store_follows_the_source_without_resistance() -> None:
    """Its current is then that of the capacitor, and it blocks where that vanishes: C w cos = -sin / Q."""
    Q, C, w = 50.0, 2e-4, 100.0
    scene = rectifier(Resistor(0.0), Q, C)
    run = ac.build(scene).simulate(0.03, {scene.store.v: 0.0}, rtol=1e-12)
    blocks = (math.pi - math.atan(Q * C * w)) / w
    assert changes(run)[0] == pytest.approx(blocks, rel=1e-11)
    assert run[scene.store.v][-1] == pytest.approx(10 * math.sin(w * blocks) * math.exp(-(0.03 - blocks) / (Q * C)), rel=1e-11)


def test_diode_behind_an_inductor_with_leakage_carries_its_current_on() -> None:
    """It conducts from 0 until the current of L i' + R i = 10 sin has returned to zero, up to the share of the leakage."""
    L, R, w, leak = 0.5, 20.0, 100.0, 1e-9
    scene = rectifier(Inductor(L), R, None, leak)
    run = ac.build(scene).simulate(0.06, {scene.bulk.i: 0.0}, rtol=1e-10)

    def current(t: float) -> float:
        return 10 / (R * R + (w * L) ** 2) * (R * math.sin(w * t) - w * L * math.cos(w * t) + w * L * math.exp(-R / L * t))

    low, high = 0.035, 0.06
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if current(middle) > 0 else (low, middle)
    assert changes(run)[-1] == pytest.approx(low, rel=1e-6)


@each_value(("leakage", [1e-6, 1e-9, 1e-12, 1e-15]), ("rtol", [1e-8, 1e-11]))
def test_the_less_a_valve_leaks_the_nearer_it_is_to_an_ideal_one(leakage: float, rtol: float) -> None:
    """The current through an inductor and what a valve lets through differ by rounding, of which a small leakage must not make a voltage."""
    w, R, L = 100.0, 2.0, 0.05
    scene = ac.System()
    scene.mains, scene.bulk, scene.load = VoltageSource(10 * np.sin(w * ac.time)), Inductor(L), Resistor(R)
    scene.diode, scene.ground = IdealDiode(leakage), Ground()
    scene.connect(scene.mains.pin_a, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.bulk.pin_a)
    scene.connect(scene.bulk.pin_b, scene.mains.pin_b, scene.ground.pin)
    run = ac.build(scene).simulate(0.04, {scene.bulk.i: 0.0}, rtol=rtol, samples=9)
    t, lag = np.linspace(0, 0.04, 9), math.atan2(w * L, R)
    exact = 10 / math.hypot(R, w * L) * (np.sin(w * t - lag) + math.sin(lag) * np.exp(-R / L * t))
    conducts = np.logical_and.accumulate(exact > -1e-12)
    assert np.count_nonzero(conducts) > 6
    assert run[scene.bulk.i][conducts] == pytest.approx(exact[conducts], abs=20 * (leakage + rtol))
    assert run.statistics.steps < 60


@each_value(
    ("turned", [False, True]),
    ("leak", [1e-3, 1e-5, 1e-7]),
    (("V", "f", "R", "lag"), [(1.0, 1.0, 1.0, 0.41), (1e-3, 50.0, 600.0, 1.01), (325.0, 1e6, 0.1, 0.1), (1.0, 1.0, 1.0, 1.42)]),
)
def test_what_a_coil_drives_flows_on_through_a_second_diode(
    V: float, f: float, R: float, lag: float, leak: float, turned: bool
) -> None:
    """Where the source passes zero both have no voltage: only what follows tells that one of them takes over from the other."""
    w, L = 2 * np.pi * f, R * math.tan(lag) / (2 * np.pi * f)
    scene = ac.System()
    scene.ground = Ground()
    parts = {"mains": VoltageSource(-V * np.sin(w * ac.time)), "valve": IdealDiode(leak / R), "load": Resistor(R)}
    parts |= {"wheel": IdealDiode(leak / R), "coil": Inductor(L)}
    for name in sorted(parts, reverse=turned):
        setattr(scene, name, parts[name])
    scene.connect(scene.mains.pin_b, scene.valve.pin_a)
    scene.connect(scene.valve.pin_b, scene.load.pin_a, scene.wheel.pin_b)
    scene.connect(scene.load.pin_b, scene.coil.pin_a)
    scene.connect(scene.coil.pin_b, scene.mains.pin_a, scene.ground.pin, scene.wheel.pin_a)
    run = ac.build(scene).simulate(2.3 / f, {scene.coil.i: 0.0}, rtol=1e-10, samples=47)
    driven, phase, now, exact = V / math.hypot(R, w * L), np.arctan(w * L / R), 0.0, np.zeros(run.t.size)
    for half in range(5):  # each begins with the current `now`
        since = run.t - half / (2 * f)
        own = driven * np.sin(w * since - phase) if half % 2 == 0 else np.zeros(run.t.size)
        decay = np.exp(-w * since / math.tan(phase))
        begun = now + driven * math.sin(phase) * (half % 2 == 0)
        exact = np.where(since > -1e-12 / f, own + begun * decay, exact)
        now = begun * math.exp(-np.pi / math.tan(phase)) + driven * math.sin(phase) * (half % 2 == 0)
    assert run[scene.coil.i] == pytest.approx(exact, abs=10 * leak * driven)
    for valve in (scene.valve, scene.wheel):
        assert np.all(run[valve.v] < (1e-9 + 1e-15 / leak) * V)


@pytest.mark.parametrize(
    ("order", "w", "height", "leak"),
    [
        ((0, 1, 2, 3), 100.0, 10.0, 1e-6),
        ((3, 1, 0, 2), 100.0, 10.0, 1e-6),
        ((2, 0, 3, 1), 72.6534163623149, 14.91410316415956, 4.043492863427721e-06),
        ((1, 2, 3, 0), 731.0, 0.3, 3e-7),
    ],
)
def test_bridge_of_four_diodes_gives_the_modulus(order: tuple[int, ...], w: float, height: float, leak: float) -> None:
    scene = ac.System()
    scene.diodes = [IdealDiode(leak) for _ in range(4)]
    a, b, c, d = (scene.diodes[k] for k in order)
    scene.mains, scene.bulk, scene.load, scene.ground = (
        VoltageSource(lambda t: height * np.sin(w * t)),
        Resistor(1.0),
        Resistor(9.0),
        Ground(),
    )
    scene.beside, scene.slow = Capacitor(1e-3), Resistor(2.0)
    scene.connect(scene.mains.pin_a, scene.bulk.pin_a)
    scene.connect(scene.bulk.pin_b, a.pin_a, d.pin_b)
    scene.connect(scene.beside.pin_a, scene.mains.pin_a)
    scene.connect(scene.beside.pin_b, scene.slow.pin_a)
    scene.connect(scene.slow.pin_b, scene.mains.pin_b)
    scene.connect(scene.mains.pin_b, b.pin_a, c.pin_b)
    scene.connect(a.pin_b, b.pin_b, scene.load.pin_a)
    scene.connect(c.pin_a, d.pin_a, scene.load.pin_b, scene.ground.pin)
    run = ac.build(scene).simulate(10 / w, {scene.beside.v: 0.0}, rtol=1e-10)
    share = 1 / (1 + 1.0 * (1 / 9 + 2 * leak))  # the pair that blocks lies beside the load
    assert run[scene.load.v] == pytest.approx(share * height * np.abs(np.sin(w * run.t)), abs=1e-10 * height)


@pytest.mark.parametrize("seed", range(16))
def test_bridges_of_four_diodes_pass_zero_in_any_units(seed: int) -> None:
    """All four change at one instant, at which their voltages are the rounding of their leaks."""
    rng = np.random.default_rng(seed)
    order, f, height, leak = rng.permutation(4), 10 ** rng.uniform(1, 3), 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(-6.5, -5)
    scene = ac.System()
    scene.diodes = [IdealDiode(leak) for _ in range(4)]
    a, b, c, d = (scene.diodes[k] for k in order)
    scene.mains, scene.bulk = VoltageSource(lambda t: height * np.sin(f * t)), Resistor(1.0)
    scene.load, scene.ground, scene.beside, scene.slow = Resistor(9.0), Ground(), Capacitor(1e-3), Resistor(2.0)
    scene.connect(scene.mains.pin_a, scene.bulk.pin_a, scene.beside.pin_a)
    scene.connect(scene.bulk.pin_b, a.pin_a, d.pin_b)
    scene.connect(scene.beside.pin_b, scene.slow.pin_a)
    scene.connect(scene.slow.pin_b, scene.mains.pin_b, b.pin_a, c.pin_b)
    scene.connect(a.pin_b, b.pin_b, scene.load.pin_a)
    scene.connect(c.pin_a, d.pin_a, scene.load.pin_b, scene.ground.pin)
    run = ac.build(scene).simulate(10 / f, {scene.beside.v: 0.0}, rtol=10 ** -rng.uniform(6, 12))
    share = 1 / (1 + (1 / 9 + 2 * leak))  # the pair that blocks lies beside the load
    assert run[scene.load.v] == pytest.approx(share * height * np.abs(np.sin(f * run.t)), abs=1e-10 * height)
    assert [t.time * f / np.pi for t in run.transitions if t.changes] == pytest.approx([1, 2, 3], rel=1e-11)


def test_laws_between_what_is_moved_as_given_are_refused() -> None:
    """Nothing could yield."""
    scene = ac.System()
    scene.world, scene.hand, scene.floor = World(), PrescribedMotion(position=(0, 0, 1 - ac.time)), PointOnPlane(unilateral=True)
    scene.connect(scene.world.frame, scene.hand.frame_a, scene.floor.frame_a)
    scene.connect(scene.hand.frame_b, scene.floor.frame_b)
    with pytest.raises(ac.errors.ModelError, match="nothing in the scene has a state"):
        ac.build(scene)


@pytest.mark.parametrize("inductive", [False, True])
def test_thyristor_waits_for_its_gate_and_then_conducts_to_the_end(inductive: bool) -> None:
    """It fires where sin(w t - 1) exceeds 0.9, and goes out where its current vanishes, each period again."""
    w, R, L, leak = 100.0, 20.0, 0.5, 1e-9
    scene = ac.System()
    scene.mains, scene.valve = VoltageSource(lambda t: 10 * np.sin(w * t)), Thyristor(lambda t: np.sin(w * t - 1) - 0.9, leak)
    scene.load, scene.coil, scene.ground = Resistor(R), Inductor(L) if inductive else Resistor(0.0), Ground()
    scene.beside, scene.slow = Capacitor(1e-3), Resistor(2.0)
    scene.connect(scene.mains.pin_a, scene.coil.pin_a, scene.beside.pin_a)
    scene.connect(scene.coil.pin_b, scene.valve.pin_a)
    scene.connect(scene.valve.pin_b, scene.load.pin_a)
    scene.connect(scene.beside.pin_b, scene.slow.pin_a)
    scene.connect(scene.load.pin_b, scene.slow.pin_b, scene.mains.pin_b, scene.ground.pin)
    run = ac.build(scene).simulate(0.1, {scene.beside.v: 0.0}, rtol=1e-10)
    fires, period = (1 + math.asin(0.9)) / w, 2 * math.pi / w

    def current(t: float) -> float:
        def steady(t: float) -> float:
            return 10 / (R * R + (w * L) ** 2) * (R * math.sin(w * t) - w * L * math.cos(w * t))

        return steady(t) - steady(fires) * math.exp(-R / L * (t - fires)) if inductive else math.sin(w * t)

    low, high = 0.025, 0.06
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if current(middle) > 0 else (low, middle)
    assert changes(run)[0:3:2] == pytest.approx([fires, fires + period], rel=1e-10)
    assert changes(run)[1] == pytest.approx(low, rel=1e-6 if inductive else 1e-10)


def test_thyristor_whose_gate_is_shut_does_not_fire_again() -> None:
    """The gate is an input that is zero but for a while."""
    scene = ac.System()
    scene.mains, scene.bulk = VoltageSource(lambda t: 10 * np.sin(100 * t)), Resistor(5.0)
    scene.valve, scene.load, scene.store, scene.ground = Thyristor(ac.Input("V")), Resistor(1e3), Capacitor(1e-5), Ground()
    scene.connect(scene.mains.pin_a, scene.bulk.pin_a)
    scene.connect(scene.bulk.pin_b, scene.valve.pin_a)
    scene.connect(scene.valve.pin_b, scene.load.pin_a, scene.store.pin_a)
    scene.connect(scene.load.pin_b, scene.store.pin_b, scene.mains.pin_b, scene.ground.pin)
    pulse = ac.samples([0, 0.01, 0.0105], [0, 1, 0], kind="constant")
    run = ac.build(scene).simulate(0.2, {scene.store.v: 0.0}, inputs={scene.valve.fires: pulse}, rtol=1e-10)
    assert len(changes(run)) == 1
    assert 0.01 < changes(run)[0] < 0.03
    assert abs(run[scene.store.v][-1]) < 1e-5


def test_thyristor_that_fires_onto_an_empty_store_loses_half_of_what_it_takes() -> None:
    """The charge flows in no time; as much energy as it stores becomes heat."""
    C, v = 1e-3, 5.0
    scene = ac.System()
    scene.battery, scene.valve, scene.store, scene.load, scene.ground = (
        VoltageSource(v),
        Thyristor(ac.Input("V")),
        Capacitor(C),
        Resistor(1e2),
        Ground(),
    )
    scene.connect(scene.battery.pin_a, scene.valve.pin_a)
    scene.connect(scene.valve.pin_b, scene.store.pin_a, scene.load.pin_a)
    scene.connect(scene.store.pin_b, scene.load.pin_b, scene.battery.pin_b, scene.ground.pin)
    fires = ac.samples([0, 0.05], [0, 1], kind="constant")
    run = ac.build(scene).simulate(0.1, {scene.store.v: 0.0}, inputs={scene.valve.fires: fires}, rtol=1e-10)
    struck = run.transitions[0]
    assert struck.time == pytest.approx(0.05, rel=1e-12)
    assert struck.energy_lost == pytest.approx(0.5 * C * v * v, rel=1e-11)
    assert run[scene.store.v][-1] == pytest.approx(v, rel=1e-12)
    assert run[scene.valve.i][-1] == pytest.approx(v / 1e2, rel=1e-10)


@pytest.mark.parametrize("V", [1e-6, 1.0, 1e6])
def test_a_valve_in_a_mode_that_is_not_its_own_is_told(V: float) -> None:
    """One that is taken for closed passes back, and one that is taken for open keeps back what would go its way."""
    scene = ac.System()
    scene.mains, scene.valve, scene.load, scene.ground = (
        VoltageSource(V * np.sin(6 * ac.time)),
        IdealDiode(),
        Resistor(2.0),
        Ground(),
    )
    scene.connect(scene.mains.pin_b, scene.valve.pin_a)
    scene.connect(scene.valve.pin_b, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.mains.pin_a, scene.ground.pin)
    model = ac.build(scene)
    run = model.simulate(2.5, rtol=1e-10)
    assert not warn_if_passed_back(model.functions, run)
    met = run.solution.modes
    assert met is not None
    for changed in range(1, met.begins.size):
        masks = met.masks.copy()
        masks[:, changed] = masks[:, changed - 1]
        other = dataclasses.replace(met, masks=masks)
        inputs = run.problem.inputs
        assert isinstance(inputs, WithModes)
        piece = dataclasses.replace(run.pieces[0], solution=dataclasses.replace(run.solution, modes=other))
        wrong = dataclasses.replace(
            run, pieces=(piece,), problem=dataclasses.replace(run.problem, inputs=dataclasses.replace(inputs, met=other))
        )
        with pytest.warns(ac.errors.AccuracyWarning, match="taken for closed" if masks[0, changed] == 1 else "taken for open"):
            assert warn_if_passed_back(model.functions, wrong)


@pytest.mark.parametrize("closed", [1e5, 1e6, 1e7])
def test_a_coil_that_a_bridge_of_switches_lets_go_is_dead_in_few_steps(closed: float) -> None:
    """Through open switches its current dies in 0.2 us and less, to what an iteration leaves of it, which is not how the current goes on."""
    volts, ohms, coil, off = 24.0, 1.5, 0.02, 0.01
    scene = ac.System()
    scene.battery, scene.ground, scene.resistor, scene.coil = VoltageSource(volts), Ground(), Resistor(ohms), Inductor(coil)
    opens = np.where(ac.time < off, 1e-3, closed)
    scene.switches = [Resistor(opens), Resistor(closed), Resistor(closed), Resistor(opens)]
    scene.valves = [IdealDiode() for _ in range(4)]
    plus, minus = scene.battery.pin_a, scene.battery.pin_b
    for pin, upper, lower in ((scene.resistor.pin_a, 0, 1), (scene.coil.pin_b, 2, 3)):
        scene.connect(plus, scene.switches[upper].pin_a, scene.valves[upper].pin_b)
        scene.connect(minus, scene.switches[lower].pin_b, scene.valves[lower].pin_a)
        scene.connect(pin, scene.switches[upper].pin_b, scene.valves[upper].pin_a)
        scene.connect(pin, scene.switches[lower].pin_a, scene.valves[lower].pin_b)
    scene.connect(minus, scene.ground.pin)
    scene.connect(scene.resistor.pin_b, scene.coil.pin_a)
    run = ac.build(scene).simulate(0.03, {scene.coil.i: 0.0})
    t, on = run.t, ohms + 2e-3
    most = volts / on * (1 - np.exp(-on / coil * off))
    falls = (most + volts / ohms) * np.exp(-ohms / coil * (t - off)) - volts / ohms
    exact = np.where(t < off, volts / on * (1 - np.exp(-on / coil * t)), np.maximum(falls, 0))
    assert np.abs(run[scene.coil.i].ravel() - exact).max() < 5 * volts / closed
    assert run.statistics.steps < 100
