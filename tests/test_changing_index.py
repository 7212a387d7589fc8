"""Valves beside inductors: what one of them holds at zero follows at once in some modes, and through states in others. Against closed forms, and by the laws that motions obey."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import networkx as nx
import numpy as np
import pytest

import acausal as ac
from components import Capacitor, Ground, IdealDiode, Inductor, Resistor, Thyristor, VoltageSource
from tests.circuits import between_nodes, check_diodes, element
from tests.pairings import each_value

AMPLITUDE = 10.0


def zero_of(f: Any, low: float, high: float) -> float:
    """By bisection."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if f(low) * f(middle) <= 0 else (middle, high)
    return low


class Branch:
    """L i' + R i = A sin(w t), from i0 at t0 on; A = 0: it decays."""

    def __init__(self, L: float, R: float, w: float, A: float, t0: float, i0: float) -> None:
        self.rate, self.w, self.A, self.t0 = R / L, w, A / (R * R + (w * L) ** 2), t0
        self.R, self.wL = R, w * L
        self.rest = i0 - self.steady(t0)

    def steady(self, t: float) -> float:
        return self.A * (self.R * math.sin(self.w * t) - self.wL * math.cos(self.w * t))

    def __call__(self, t: float) -> float:
        return self.steady(t) + self.rest * math.exp(-self.rate * (t - self.t0))


def circuit(L: Any, R: Any, w: float, *, free: bool = False, first: bool = False, gate: Any = None) -> Any:
    """A source, a valve, an inductor and a resistor in a row; `free`: a diode that lets the inductor's current go round without the source."""
    scene: Any = ac.System()
    valve = IdealDiode() if gate is None else Thyristor(gate)
    if free and first:
        scene.free = IdealDiode()
    scene.mains, scene.valve, scene.coil = VoltageSource(AMPLITUDE * np.sin(w * ac.time)), valve, Inductor(L)
    scene.load, scene.ground = Resistor(R), Ground()
    if free and not first:
        scene.free = IdealDiode()
    scene.connect(scene.mains.pin_a, scene.valve.pin_a)
    scene.connect(scene.valve.pin_b, scene.coil.pin_a)
    scene.connect(scene.coil.pin_b, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.mains.pin_b, scene.ground.pin)
    if free:
        scene.connect(scene.free.pin_a, scene.ground.pin)
        scene.connect(scene.free.pin_b, scene.coil.pin_a)
    return scene


SIZES = [(0.5, 20.0, 100.0), (3e-9, 2e-3, 1e6), (4e4, 1e6, 7.0)]


@pytest.mark.parametrize(("L", "R", "w"), SIZES)
def test_a_diode_in_series_with_an_inductor_holds_its_current_at_zero(L: float, R: float, w: float) -> None:
    scene = circuit(L, R, w)
    model = ac.build(scene)
    run = model.simulate(6.5 * math.pi / w, {scene.coil.i: 0.0}, rtol=1e-12, samples=400)
    ends: list[float] = []
    for k in range(3):
        branch = Branch(L, R, w, AMPLITUDE, 2 * k * math.pi / w, 0.0)
        ends += [zero_of(branch, (2 * k + 1) * math.pi / w, (2 * k + 1.999) * math.pi / w), 2 * (k + 1) * math.pi / w]
    np.testing.assert_allclose([change.time for change in run.transitions], ends, rtol=1e-11)
    ends.append(math.inf)
    assert [change.changes[0].new for change in run.transitions] == ["open", "closed"] * 3
    size = AMPLITUDE / R
    for t, i, v in zip(run.t, run[scene.coil.i].ravel(), run[scene.valve.v].ravel(), strict=True):
        k = int(t * w / (2 * math.pi))
        if t < ends[2 * k]:
            assert i == pytest.approx(Branch(L, R, w, AMPLITUDE, 2 * k * math.pi / w, 0.0)(t), abs=1e-11 * size)
        else:
            assert abs(i) < 1e-15 * size
            assert v == pytest.approx(AMPLITUDE * math.sin(w * t), abs=1e-11 * AMPLITUDE)
    assert str(run.modes(scene.valve).at(0.0)) == "closed"


def free_wheeling(L: float, R: float, w: float, turns: int) -> tuple[list[float], list[Branch]]:
    """Instants at which the other diode takes over, and what flows from each on."""
    times, branches = [0.0], [Branch(L, R, w, AMPLITUDE, 0.0, 0.0)]
    for k in range(1, turns + 1):
        t = k * math.pi / w
        branches.append(Branch(L, R, w, AMPLITUDE if k % 2 == 0 else 0.0, t, branches[-1](t)))
        times.append(t)
    return times, branches


@each_value(("first", [False, True]), (("L", "R", "w"), SIZES))
def test_a_current_that_cannot_stop_goes_over_to_the_other_diode(L: float, R: float, w: float, first: bool) -> None:
    scene = circuit(L, R, w, free=True, first=first)
    run = ac.build(scene).simulate(6.5 * math.pi / w, {scene.coil.i: 0.0}, rtol=1e-12, samples=300)
    times, branches = free_wheeling(L, R, w, 6)
    np.testing.assert_allclose([change.time for change in run.transitions], times[1:], rtol=1e-12)
    exact = [branches[int(np.searchsorted(times, t, side="right")) - 1](t) for t in run.t]
    np.testing.assert_allclose(run[scene.coil.i].ravel(), exact, rtol=0, atol=1e-11 * AMPLITUDE / R)
    np.testing.assert_allclose((run[scene.valve.i] + run[scene.free.i]).ravel(), exact, rtol=0, atol=1e-11 * AMPLITUDE / R)
    assert np.minimum(run[scene.valve.i], run[scene.free.i]).max() < 1e-12 * AMPLITUDE / R


def test_derivatives_through_changes_of_the_index() -> None:
    """Of what is left after three and a half periods, against differences of the closed form; of a current that has been zero in between, nothing is left of its start."""
    values, w, h = (0.05, 2.0), 100.0, 1e-6
    end = 7.1 * math.pi / w
    for free in (False, True):
        scene = circuit(ac.Parameter(values[0], "H"), ac.Parameter(values[1], "Ohm"), w, free=free)
        model = ac.build(scene)
        by = [scene.coil.inductance, scene.load.resistance, scene.coil.i]
        found = model.sensitivities([0.0, end], by, {scene.coil.i: 0.0}, rtol=1e-12)[scene.coil.i][-1]

        def left(L: float, R: float, free: bool = free) -> float:
            if not free:
                return Branch(L, R, w, AMPLITUDE, 6 * math.pi / w, 0.0)(end)
            return free_wheeling(L, R, w, 7)[1][-1](end)

        slopes = [
            (
                left(*(v + h * v * (j == k) for j, v in enumerate(values)))
                - left(*(v - h * v * (j == k) for j, v in enumerate(values)))
            )
            / (2 * h * values[k])
            for k in range(2)
        ]
        np.testing.assert_allclose(found[:2], slopes, rtol=1e-7)
        decay = math.exp(-values[1] / values[0] * end) if free else 0.0
        assert found[2] == pytest.approx(decay, rel=1e-9, abs=1e-12)


def test_a_store_behind_a_diode_and_an_inductor_takes_twice_the_voltage_and_keeps_it() -> None:
    """v = V (1 - cos(t / sqrt(L C))), until the current is zero."""
    V, L, C = 12.0, 2e-3, 5e-6
    scene: Any = ac.System()
    scene.source, scene.coil, scene.diode, scene.store, scene.ground = (
        VoltageSource(V),
        Inductor(L),
        IdealDiode(),
        Capacitor(C),
        Ground(),
    )
    scene.connect(scene.source.pin_a, scene.coil.pin_a)
    scene.connect(scene.coil.pin_b, scene.diode.pin_a)
    scene.connect(scene.diode.pin_b, scene.store.pin_a)
    scene.connect(scene.store.pin_b, scene.source.pin_b, scene.ground.pin)
    period = math.pi * math.sqrt(L * C)
    run = ac.build(scene).simulate(5 * period, {scene.coil.i: 0.0, scene.store.v: 0.0}, rtol=1e-12)
    assert [change.time for change in run.transitions] == pytest.approx([period], rel=1e-12)
    assert run[scene.store.v].ravel()[-1] == pytest.approx(2 * V, rel=1e-12)
    assert run[scene.diode.v].ravel()[-1] == pytest.approx(-V, rel=1e-12)
    assert run[scene.coil.i].ravel()[-1] == pytest.approx(0, abs=1e-15 * V)


def test_a_thyristor_hands_its_current_over_to_a_diode_beside_it() -> None:
    """It is fired a third of a half period late; the current starts from zero, and goes round through the diode from the source's zero on, without end."""
    L, R, w = 0.05, 2.0, 100.0
    late = math.pi / 3
    scene = circuit(L, R, w, free=True, gate=np.sin(w * ac.time - late))
    run = ac.build(scene).simulate(4.9 * math.pi / w, {scene.coil.i: 0.0}, rtol=1e-12)
    t, now = late / w, 0.0
    for k in range(2):
        rises = Branch(L, R, w, AMPLITUDE, t, now)
        over = (2 * k + 1) * math.pi / w
        again = ((2 * k + 2) * math.pi + late) / w
        now = Branch(L, R, w, 0.0, over, rises(over))(again)
        t = again
    rises = Branch(L, R, w, AMPLITUDE, t, now)
    assert run[scene.coil.i].ravel()[-1] == pytest.approx(rises(run.t[-1]), rel=1e-11)


@each_value((("L", "R", "w"), SIZES), ("late", [0.4, 1.8]))
def test_a_thyristor_alone_with_an_inductor_waits_for_its_gate_and_conducts_until_nothing_flows(
    L: float, R: float, w: float, late: float
) -> None:
    """It is fired `late` in each period, for a sixteenth of that, and blocks either way until then."""
    gate = np.cos(w * ac.time - late - math.pi / 16) - math.cos(math.pi / 16)
    scene = circuit(L, R, w, gate=gate)
    run = ac.build(scene).simulate(5.8 * math.pi / w, {scene.coil.i: 0.0}, rtol=1e-12, samples=300)
    exact, voltage = np.zeros(run.t.size), AMPLITUDE * np.sin(w * run.t)
    for k in range(3):
        branch = Branch(L, R, w, AMPLITUDE, (2 * k * math.pi + late) / w, 0.0)
        end = zero_of(branch, ((2 * k + 1) * math.pi) / w, ((2 * k + 1.999) * math.pi) / w)
        now = (run.t > branch.t0) & (run.t < end)
        exact[now] = [branch(t) for t in run.t[now]]
        voltage[now] = 0.0
    np.testing.assert_allclose(run[scene.coil.i].ravel(), exact, rtol=0, atol=1e-11 * AMPLITUDE / R)
    np.testing.assert_allclose(run[scene.valve.v].ravel(), voltage, rtol=0, atol=1e-11 * AMPLITUDE)


def bridge(before: float, behind: float, store: float, resistance: float, at_source: bool) -> Any:
    """Four diodes between a source with an inductor `before` them, and a load with one `behind` them, and a capacitor; the ground on one side or the other."""
    scene: Any = ac.System()
    scene.mains, scene.ground, scene.load = VoltageSource(AMPLITUDE * np.sin(100.0 * ac.time)), Ground(), Resistor(5.0)
    scene.diodes = [IdealDiode(resistance=resistance) for _ in range(4)]
    first, second, third, fourth = scene.diodes
    one, other, top = scene.mains.pin_a, scene.mains.pin_b, first.pin_b
    if before:
        scene.line = Inductor(before)
        scene.connect(one, scene.line.pin_a)
        one = scene.line.pin_b
    scene.connect(one, first.pin_a, third.pin_b)
    scene.connect(other, second.pin_a, fourth.pin_b)
    scene.connect(first.pin_b, second.pin_b)
    scene.connect(third.pin_a, fourth.pin_a, scene.load.pin_b)
    if behind:
        scene.choke = Inductor(behind)
        scene.connect(top, scene.choke.pin_a)
        top = scene.choke.pin_b
    scene.connect(top, scene.load.pin_a)
    if store:
        scene.store = Capacitor(store)
        scene.connect(top, scene.store.pin_a)
        scene.connect(scene.store.pin_b, scene.load.pin_b)
    scene.connect(scene.ground.pin, other if at_source else scene.load.pin_b)
    return scene


def rectified(scene: Any, end: float) -> Any:
    start = {scene.line.i: 0.0} if hasattr(scene, "line") else {}
    start |= {scene.choke.i: 0.0} if hasattr(scene, "choke") else {}
    start |= {scene.store.v: 0.0} if hasattr(scene, "store") else {}
    return ac.build(scene).simulate(end, start, rtol=1e-10, samples=150)


@pytest.mark.parametrize("at_source", [False, True])
def test_a_bridge_with_one_inductor_against_closed_forms(at_source: bool) -> None:
    """Behind it, the current is that of a source that is rectified; before it, that of no bridge at all."""
    L, w, R = 0.05, 100.0, 5.0
    run = rectified(scene := bridge(0.0, L, 0.0, 0.0, at_source), 0.2)
    times, branches = [0.0], [Branch(L, R, w, AMPLITUDE, 0.0, 0.0)]
    for k in range(1, 7):
        t = k * math.pi / w
        branches.append(Branch(L, R, w, (-1) ** k * AMPLITUDE, t, branches[-1](t)))
        times.append(t)
    exact = [branches[int(np.searchsorted(times, t, side="right")) - 1](t) for t in run.t]
    np.testing.assert_allclose(run[scene.choke.i].ravel(), exact, rtol=0, atol=1e-10 * AMPLITUDE / R)

    run = rectified(scene := bridge(L, 0.0, 0.0, 0.0, at_source), 0.2)
    line = [Branch(L, R, w, AMPLITUDE, 0.0, 0.0)(t) for t in run.t]
    np.testing.assert_allclose(run[scene.line.i].ravel(), line, rtol=0, atol=1e-10 * AMPLITUDE / R)
    np.testing.assert_allclose(run[scene.load.i].ravel(), np.abs(line), rtol=0, atol=1e-10 * AMPLITUDE / R)


@each_value(("resistance", [0.0, 1e-3]), (("behind", "store"), [(0.0, 1e-3), (0.05, 0.0), (0.05, 1e-3)]))
def test_a_bridge_between_inductors_and_stores_moves_alike_wherever_its_ground_is(
    behind: float, store: float, resistance: float
) -> None:
    """Where all four block, the source floats: nothing says how they share the voltage, and nothing depends on it."""
    found: list[np.ndarray] = []
    for at_source in (False, True):
        scene = bridge(5e-3, behind, store, resistance, at_source)
        run = rectified(scene, 0.2)
        for diode in scene.diodes:
            current, over = run[diode.current], run[diode.v] - resistance * run[diode.current]
            assert current.min() >= -1e-12
            assert over.max() <= 1e-12 * AMPLITUDE
            assert np.abs(current * over).max() <= 1e-12 * AMPLITUDE
        assert run.statistics.steps < 200
        found.append(np.concatenate([run[scene.load.v], run[scene.line.i]]))
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-8 * AMPLITUDE)


def drawn(seed: int, order: np.random.Generator | None) -> tuple[Any, list[Any], float, float]:
    """A source, diodes with a little resistance, and other parts, which connect all nodes; with its times [s] and voltages [V]."""
    g = np.random.default_rng(seed)
    V, R, T = float(g.choice([1e-3, 1.0, 1e4])), float(g.choice([1e-2, 1.0, 1e5])), float(g.choice([1e-6, 1.0, 1e2]))
    nodes = int(g.integers(3, 6))
    while True:
        kinds = "V" + "D" * int(g.integers(1, 5)) + "L" + "".join(g.choice(list("RRRCLL"), int(g.integers(nodes - 1, nodes + 3))))
        ends = [g.choice(nodes, 2, replace=False) for _ in kinds]
        beside = any(kind == "D" and set(pair) == set(ends[0]) for kind, pair in zip(kinds, ends, strict=True))
        others: Any = nx.Graph()
        others.add_nodes_from(range(nodes))
        others.add_edges_from([(int(a), int(b)) for kind, (a, b) in zip(kinds, ends, strict=True) if kind != "D"])
        uses = Counter(int(node) for pair in ends for node in pair)
        if nx.is_connected(others) and not beside and all(uses[node] + (node == 0) > 1 for node in range(nodes)):
            break
    drawn_values = zip(kinds, g.uniform(0.5, 2, len(kinds)), g.uniform(0, 6, len(kinds)), strict=True)
    parts = [element(kind, value, phase, V, R, T) for kind, value, phase in drawn_values]
    return between_nodes(parts, ends, nodes, order), parts, T, V


@pytest.mark.parametrize(
    "seed", [4, 18, 32, 45, 47, 63, 66, 95, 126, 213, 227, 254, 373, 455, 462, 505, 550, 620, 775, 1033, 1063, 1445, 1490]
)
def test_drawn_circuits_conduct_one_way_without_voltage_in_any_order(seed: int) -> None:
    """Currents of inductors and voltages of capacitors being continuous, a motion that obeys the laws at all times is the only one there is (a monotone inclusion)."""
    ends: list[np.ndarray] = []
    for order in (None, np.random.default_rng(seed)):
        scene, parts, T, V = drawn(seed, order)
        model = ac.build(scene)
        run = model.simulate(2 * T, rtol=1e-10, samples=200)
        most = check_diodes(run, parts, V, known=1e-10)
        assert run.statistics.steps < 300
        ends.append(np.array([run[part.i].ravel()[-1] for part in parts]) / (most or 1.0))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-7)


@pytest.mark.parametrize(("seed", "tolerances"), [(63, np.geomspace(1e-6, 1e-10, 15)), (550, np.geomspace(1e-9, 1e-12, 60))])
def test_drawn_circuits_run_at_any_tolerance(seed: int, tolerances: np.ndarray) -> None:
    """Steps end anywhere: also right before a valve changes, and in the middle of what decays."""
    scene, parts, T, V = drawn(seed, None)
    model = ac.build(scene)
    for rtol in tolerances:
        run = model.simulate(2 * T, rtol=rtol, samples=20)
        check_diodes(run, parts, V, known=1e-10)
        assert run.statistics.steps < 120


@pytest.mark.parametrize(("V", "R", "T"), [(1e-3, 1e5, 1e-6), (1.0, 1.0, 1.0), (1e4, 1e-2, 1e2)])
def test_what_decays_through_a_valve_comes_to_no_zero_at_any_tolerance(V: float, R: float, T: float) -> None:
    """A capacitor is discharged beside something slow: steps become longer than it takes, and the inside of a step is known to the tolerance only."""
    scene: Any = ac.System()
    scene.ground, scene.store, scene.valve = Ground(), Capacitor(T / R), IdealDiode(resistance=R)
    scene.mains, scene.load, scene.coil = VoltageSource(V * np.sin(0.05 * ac.time / T)), Resistor(20 * R), Inductor(400 * R * T)
    scene.connect(scene.store.pin_a, scene.valve.pin_a)
    scene.connect(scene.store.pin_b, scene.valve.pin_b, scene.ground.pin, scene.mains.pin_b, scene.coil.pin_b)
    scene.connect(scene.mains.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.coil.pin_a)
    model = ac.build(scene)
    for rtol in np.geomspace(1e-4, 1e-12, 16):
        run = model.simulate(300 * T, {scene.store.v: V, scene.coil.i: 0.0}, rtol=rtol, samples=61)
        np.testing.assert_allclose(run[scene.store.v].ravel(), V * np.exp(-run.t / T), rtol=0, atol=30 * rtol * V)
        assert run.statistics.steps < 60


@each_value(
    ("several", [False, True]), (("V", "R", "T"), [(1e4, 1e-2, 1e-3), (1.0, 1.0, 1.0), (1e4, 1e-2, 1e2), (1e-3, 1e5, 1.0)])
)
def test_circuits_of_parameters_move_as_those_of_numbers(several: bool, V: float, R: float, T: float) -> None:
    """What valves do to themselves at once is nothing by the circuit's laws, beside an inductor, whatever its values are: not what rounding makes of these."""
    kinds, ends = "VDDLRRL", [(2, 3), (1, 0), (0, 2), (3, 2), (1, 2), (3, 1), (1, 0)]
    values, phases = (0.93, 1.5, 0.8, 0.5, 1.68, 1.56, 1.67), (1.4, *[0.0] * 6)
    if several:
        kinds, ends, values, phases = kinds + "DL", [*ends, (1, 0), (1, 2)], (*values, 0.7, 1.5), (*phases, 0.0, 0.0)
    ends_of, changes = list[np.ndarray](), list[list[float]]()
    for of in (float, lambda value: ac.Parameter(value)):
        parts = [element(kind, of(value), phase, V, R, T) for kind, value, phase in zip(kinds, values, phases, strict=True)]
        run = ac.build(between_nodes(parts, ends, 4, None)).simulate(2 * T, rtol=1e-10, samples=50)
        if of is float:
            check_diodes(run, parts, V, known=1e-10)
        ends_of.append(np.array([run[part.v] for part in parts]) / V)
        changes.append([change.time for change in run.transitions])
    np.testing.assert_allclose(ends_of[0], ends_of[1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(changes[0], changes[1], rtol=0, atol=1e-9 * T)


def test_parameters_may_change_after_the_build() -> None:
    L, R = ac.Parameter(0.05, "H"), ac.Parameter(2.0, "Ohm")
    scene = circuit(L, R, 100.0, free=True)
    model = ac.build(scene)
    for inductance, resistance in ((5e-5, 2.0), (50.0, 1e3), (0.05, 0.02)):
        end = 5.3 * math.pi / 100
        run = model.simulate(end, {scene.coil.i: 0.0}, parameters={L: inductance, R: resistance}, rtol=1e-12)
        exact = free_wheeling(inductance, resistance, 100.0, 5)[1][-1](end)
        assert run[scene.coil.i].ravel()[-1] == pytest.approx(exact, rel=1e-9, abs=1e-11 * AMPLITUDE / resistance)
