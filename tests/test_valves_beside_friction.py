"""Circuits whose valves change the index, beside dry friction, stops and contacts: against an event code of their own with matrix exponentials, and by the laws that motions obey."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import networkx as nx
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import acausal as ac
from components import (
    Brake,
    Capacitor,
    Clutch,
    ElectromotiveForce,
    EndStop,
    ForceSource,
    Ground,
    IdealDiode,
    Inductor,
    Inertia,
    Resistor,
    SlidingMass,
    VoltageSource,
)
from tests.circuits import between_nodes, check_diodes, element
from tests.pairings import each_value

SIZES = [(1.0, 1.0, 1.0), (1e-3, 1e4, 1.0), (1e4, 1.0, 1e-3)]
"""Of volts, amperes and seconds."""


class Pieces:
    """x' = A x + b between events: at times (n,), states (n, nx), from a start on, and what `after(t, x, event)` says is the next piece: x, A, b, guards g (k, nx) and levels (k,), with
    g x >= level until the next event, and a time at which there is one anyway."""

    def __init__(self, x: Sequence[float], end: float, after: Callable[..., Any]) -> None:
        self.begins, self.flows = [0.0], list[tuple[np.ndarray, np.ndarray]]()
        t, event = 0.0, -1
        at = np.array(x, dtype=float)
        while t < end:
            at, A, b, guards, levels, until = after(t, at, event)
            n = at.size
            whole = np.zeros((n + 1, n + 1))
            whole[:n, :n], whole[:n, n] = A, b
            start = np.append(at, 1.0)
            span = min(until, end) - t
            step, now, event, found = expm(whole * span / 100), start, len(levels), span
            for k in range(100):
                then = step @ now
                for j, (g, level) in enumerate(zip(guards, levels, strict=True)):
                    if not (g @ then[:n] - level < 0 <= g @ now[:n] - level + 1e-13 * (abs(level) + np.abs(g) @ np.abs(now[:n]))):
                        continue

                    def value(
                        s: float, g: Any = g, level: float = level, now: Any = now, whole: Any = whole, n: int = n
                    ) -> float:
                        return float(g @ (expm(whole * s) @ now)[:n] - level)

                    tau = span / 100
                    root = brentq(value, 0.0, tau, xtol=1e-300, rtol=1e-15) if value(0.0) > 0 else 0.0
                    if k * tau + root < found:
                        found, event = k * tau + root, j
                if event < len(levels):
                    break
                now = then
            self.flows.append((whole, start))
            at = (expm(whole * found) @ start)[:n]
            t = until if event == len(levels) else t + found
            self.begins.append(t)

    def __call__(self, t: float) -> np.ndarray:
        """The state (nx,)."""
        k = int(np.clip(np.searchsorted(self.begins, t, side="right") - 1, 0, len(self.flows) - 1))
        whole, start = self.flows[k]
        return (expm(whole * (t - self.begins[k])) @ start)[:-1]


class Drive:
    """A motor behind a diode at a source of pulses, another diode that its current goes round through, dry friction and an end stop that it strikes without bouncing."""

    def __init__(self, volts: float, amperes: float, seconds: float) -> None:
        self.V, self.R, self.L = 24.0 * volts, 1.2 * volts / amperes, 5e-3 * volts * seconds / amperes
        self.k, self.tau = 0.05 * volts * seconds, 0.02 * volts * seconds * amperes
        self.J, self.stop, self.T = 1e-3 * volts * amperes * seconds**3, 4.0, 0.02 * seconds

    def scene(self, mechanics_first: bool) -> Any:
        scene: Any = ac.System()

        def circuit() -> None:
            scene.mains = VoltageSource(self.V * (1.2 * (np.cos(2 * np.pi / self.T * ac.time) > 0) - 0.2))
            scene.valve, scene.coil, scene.winding = IdealDiode(), Inductor(self.L), Resistor(self.R)
            scene.free, scene.machine, scene.ground = IdealDiode(), ElectromotiveForce(self.k), Ground()

        def shaft() -> None:
            scene.rotor = Inertia(self.J)
            scene.friction = Brake(scene.rotor.flange_b, self.tau)
            scene.stop = EndStop(scene.rotor.flange_b, upper=self.stop)

        for part in (shaft, circuit) if mechanics_first else (circuit, shaft):
            part()
        scene.connect(scene.mains.pin_a, scene.valve.pin_a)
        scene.connect(scene.valve.pin_b, scene.free.pin_b, scene.coil.pin_a)
        scene.connect(scene.coil.pin_b, scene.winding.pin_a)
        scene.connect(scene.winding.pin_b, scene.machine.pin_a)
        scene.connect(scene.machine.pin_b, scene.mains.pin_b, scene.free.pin_a, scene.ground.pin)
        scene.connect(scene.machine.flange, scene.rotor.flange_a)
        return scene

    def after(self, t: float, x: np.ndarray, event: int) -> Any:
        """x = (i, w, phi)."""
        half = int(np.floor(2 * t / self.T + 0.5 + 1e-9))
        volts = self.V if half % 2 == 0 else 0.0
        i, w, phi = x
        if phi >= self.stop * (1 - 1e-12):
            w, phi = 0.0, self.stop
        w, i = (0.0 if abs(w) < 1e-9 / self.T else w), (0.0 if i < 1e-12 * self.V / self.R else i)
        flows, turns = (
            i > 0 or volts > self.k * w,
            w > 0 or (self.k * i >= self.tau * (1 - 1e-12) and phi < self.stop and volts > 0),
        )
        A, b = np.zeros((3, 3)), np.zeros(3)
        if flows:
            A[0], b[0] = [-self.R / self.L, -self.k / self.L, 0.0], volts / self.L
        if turns:
            A[1, 0], b[1], A[2, 1] = self.k / self.J, -self.tau / self.J, 1.0
        guards, levels = [], []
        if flows:
            guards.append([1.0, 0.0, 0.0]), levels.append(0.0)
        if turns:
            guards += [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]
            levels += [0.0, -self.stop]
        elif phi < self.stop:
            guards.append([-self.k, 0.0, 0.0]), levels.append(-self.tau)
        if not flows:
            guards.append([0.0, self.k, 0.0]), levels.append(volts)
        return np.array([i, w, phi]), A, b, np.array(guards).reshape(-1, 3), np.array(levels), (half + 0.5) * self.T / 2


@pytest.mark.parametrize("sizes", SIZES)
def test_a_chopped_drive_with_dry_friction_runs_against_its_stop(sizes: tuple[float, float, float]) -> None:
    drive = Drive(*sizes)
    exact = Pieces([0.0, 0.0, 0.0], 12.3 * drive.T, drive.after)
    for mechanics_first in (False, True):
        scene = drive.scene(mechanics_first)
        run = ac.build(scene).simulate(12.3 * drive.T, {scene.coil.i: 0.0}, rtol=1e-11, samples=30)
        states = np.array([exact(t) for t in run.t])
        assert states[-1, 2] == drive.stop
        for entry, states_of in zip((scene.coil.i, scene.rotor.w, scene.rotor.phi), states.T, strict=True):
            np.testing.assert_allclose(run[entry].ravel(), states_of, rtol=0, atol=1e-11 * np.abs(states_of).max())
        assert np.abs(run.energy_error()).max() < 1e-11
        assert run.statistics.steps < 150


def generator(drive: Drive, brakes: float, mechanics_first: bool) -> Any:
    """Of a machine behind an inductor a bridge of four diodes charges a store, while a brake acts."""
    scene: Any = ac.System()

    def shaft() -> None:
        scene.rotor = Inertia(drive.J)
        scene.brake = Brake(scene.rotor.flange_b, brakes * drive.tau)

    def circuit() -> None:
        scene.machine, scene.coil, scene.winding = ElectromotiveForce(drive.k), Inductor(drive.L), Resistor(drive.R)
        scene.diodes = [IdealDiode() for _ in range(4)]
        scene.store, scene.ground = Capacitor(drive.T / drive.R), Ground()

    for part in (shaft, circuit) if mechanics_first else (circuit, shaft):
        part()
    one, two, three, four = scene.diodes
    scene.connect(scene.machine.flange, scene.rotor.flange_a)
    scene.connect(scene.machine.pin_a, scene.coil.pin_a)
    scene.connect(scene.coil.pin_b, scene.winding.pin_a)
    scene.connect(scene.winding.pin_b, one.pin_a, three.pin_b)
    scene.connect(scene.machine.pin_b, two.pin_a, four.pin_b)
    scene.connect(one.pin_b, two.pin_b, scene.store.pin_a)
    scene.connect(three.pin_a, four.pin_a, scene.store.pin_b, scene.ground.pin)
    return scene


def charging(drive: Drive, brakes: float, t: float, x: np.ndarray, event: int) -> Any:
    """x = (i, v, w) of that; the machine turns one way."""
    i, v, w = x
    i, w = (0.0 if event == 0 or (t > 0 and i == 0.0) else i), (0.0 if event == 1 or (t > 0 and w == 0.0) else w)
    A, b = np.zeros((3, 3)), np.zeros(3)
    if i > 0 or t == 0:
        A[0], A[1, 0] = [-drive.R / drive.L, -1 / drive.L, drive.k / drive.L], drive.R / drive.T
    if w > 0:
        A[2, 0], b[2] = -drive.k / drive.J, -brakes * drive.tau / drive.J
    guards = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moves = [i > 0 or t == 0, w > 0]
    return np.array([i, v, w]), A, b, np.where(np.array(moves)[:, None], guards, 0.0), np.zeros(2), np.inf


@each_value(("sizes", SIZES), ("brakes", [400, 4000]))
def test_a_generator_charges_a_store_through_a_bridge_while_a_brake_acts(
    sizes: tuple[float, float, float], brakes: float
) -> None:
    """Forwards as backwards; where the brake is strong the machine stands before the current has ended."""
    drive = Drive(*sizes)
    w = 6 * drive.V / drive.k
    exact = Pieces([0.0, 0.0, w], 40 * drive.T, lambda t, x, event: charging(drive, brakes, t, x, event))
    for mechanics_first, sense in ((False, 1.0), (True, -1.0)):
        scene = generator(drive, brakes, mechanics_first)
        start = {scene.coil.i: 0.0, scene.store.v: 0.0, scene.rotor.w: sense * w}
        run = ac.build(scene).simulate(40 * drive.T, start, rtol=1e-11, samples=40)
        states = np.array([exact(t) for t in run.t])
        assert states[-1, 2] == states[-1, 0] == 0
        for entry, states_of in zip((sense * scene.coil.i, scene.store.v, sense * scene.rotor.w), states.T, strict=True):
            np.testing.assert_allclose(run[entry].ravel(), states_of, rtol=0, atol=1e-10 * np.abs(states_of).max())
        assert np.abs(run.energy_error()).max() < 1e-11


class Solenoid(ac.Component):
    """Pulls a slider with i^2 slope / 2 [N] towards where its inductance, least + slope s [H], is larger."""

    pin_a, pin_b = ac.Electrical.port(must_connect=True), ac.Electrical.port(must_connect=True)
    flange = ac.Translational.port(must_connect=True)
    v, i = ac.Variable("V", "voltage from pin_b up to pin_a"), ac.Variable("A", "current from pin_a to pin_b")
    flux = ac.Variable("V*s", "what its current keeps")

    def __init__(self, least: float, slope: float) -> None:
        self.least, self.slope = least, slope

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.v, self.pin_a.v - self.pin_b.v)
        yield ac.equal(self.pin_a.i, self.i)
        yield ac.equal(self.pin_b.i, -self.i)
        yield ac.equal(self.flux, (self.least + self.slope * self.flange.s) * self.i)
        yield ac.equal(self.v, ac.der(self.flux))
        yield ac.equal(self.flange.f, -0.5 * self.slope * self.i**2)

    def stored_energy(self) -> ac.Expression:
        return 0.5 * self.flux * self.i


class Lifted:
    """A slider on a stop, with friction, which a solenoid behind a diode lifts. `size`: its lengths [m]."""

    V, w, R, least = 10.0, 200.0, 2.0, 0.01

    def __init__(self, size: float) -> None:
        self.slope, self.mass, self.weight, self.friction, self.size = 1 / size, 0.05 / size**2, 1.2 / size, 0.3 / size, size

    def scene(self, mechanics_first: bool) -> Any:
        scene: Any = ac.System()

        def slider() -> None:
            scene.mass, scene.weight = SlidingMass(self.mass), ForceSource(-self.weight)
            scene.friction, scene.stop = Brake(scene.mass.flange_b, self.friction), EndStop(scene.mass.flange_b, lower=0.0)

        def circuit() -> None:
            scene.mains, scene.diode = VoltageSource(self.V * np.sin(self.w * ac.time)), IdealDiode()
            scene.coil, scene.wire, scene.ground = Solenoid(self.least, self.slope), Resistor(self.R), Ground()

        for part in (slider, circuit) if mechanics_first else (circuit, slider):
            part()
        scene.connect(scene.mains.pin_a, scene.diode.pin_a)
        scene.connect(scene.diode.pin_b, scene.coil.pin_a)
        scene.connect(scene.coil.pin_b, scene.wire.pin_a)
        scene.connect(scene.wire.pin_b, scene.mains.pin_b, scene.ground.pin)
        scene.connect(scene.coil.flange, scene.mass.flange_a, scene.weight.flange)
        return scene

    def at(self, times: np.ndarray) -> tuple[np.ndarray, int]:
        """(i, s, v) at times (n,), by DOP853 between events, and how many events there are."""
        t, x, found, events = 0.0, np.zeros(3), np.zeros((3, times.size)), 0
        flows, moves = True, 0.0
        while t < times[-1]:

            def rates(t: float, x: np.ndarray, flows: bool = flows, moves: float = moves) -> list[float]:
                i, s, v = x
                i_dot = (self.V * np.sin(self.w * t) - self.R * i - self.slope * v * i) / (self.least + self.slope * s)
                push = 0.5 * self.slope * i * i - self.weight - moves * self.friction
                return [i_dot * flows, v * (moves != 0), push / self.mass * (moves != 0)]

            def pull(x: np.ndarray) -> float:
                return 0.5 * self.slope * x[0] ** 2 - self.weight

            borne = 1e3 * self.weight * (x[1] <= 0)
            watched: list[Any] = [lambda t, x, flows=flows: x[0] if flows else -np.sin(self.w * t)]
            if moves:
                watched += [lambda t, x: x[2], lambda t, x: x[1]]
            else:
                watched += [
                    lambda t, x: self.friction - pull(x),
                    lambda t, x, borne=borne: pull(x) + self.friction + borne,
                ]
            for event, sense in zip(watched, (-1, -moves if moves else -1, -1), strict=True):
                event.terminal, event.direction = True, sense
            piece = solve_ivp(rates, (t, times[-1]), x, "DOP853", dense_output=True, events=watched, rtol=1e-13, atol=1e-15)
            inside = (times >= t) & (times <= piece.t[-1])
            found[:, inside] = np.reshape([piece.sol(at) for at in times[inside]], (-1, 3)).T
            t, x, events = piece.t[-1], piece.y[:, -1].copy(), events + 1
            which = next((k for k, hit in enumerate(piece.t_events) if hit.size), -1)
            if which == 0:
                flows, x[0] = not flows, 0.0
            elif moves and which == 2:  # strikes
                moves, x[1], x[2] = 0.0, 0.0, 0.0
            elif moves and which == 1:
                x[2] = 0.0
                moves = 0.0 if abs(pull(x)) <= self.friction else np.sign(pull(x))
            elif which > 0:
                moves = 1.0 if which == 1 else -1.0
        return found, events


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_rectifier_feeds_a_solenoid_that_lifts_a_slider_off_its_stop(size: float) -> None:
    lifted = Lifted(size)
    times = np.linspace(0, 0.2, 50)
    exact, events = Lifted(1.0).at(times)
    exact = exact * np.array([[1.0], [size], [size]])
    for mechanics_first in (False, True):
        scene = lifted.scene(mechanics_first)
        run = ac.build(scene).simulate(0.2, {scene.coil.i: 0.0, scene.mass.s: 0.0, scene.mass.v: 0.0}, rtol=1e-11, samples=50)
        for entry, states in zip((scene.coil.i, scene.mass.s, scene.mass.v), exact, strict=True):
            np.testing.assert_allclose(run[entry].ravel(), states, rtol=0, atol=1e-9 * np.abs(states).max())
        assert len(run.transitions) >= events - 1 > 8
        assert np.abs(run.energy_error()).max() < 1e-11


def test_derivatives_through_changes_of_the_index_and_of_what_sticks() -> None:
    """Of a chopped drive that begins to turn, runs and strikes, against differences of the event code."""
    values, h = {"L": 5e-3, "k": 0.05, "tau": 0.02, "J": 1e-3}, 1e-6
    drive = Drive(1.0, 1.0, 1.0)
    parameters = {name: ac.Parameter(value) for name, value in values.items()}
    vars(drive).update(parameters)
    scene = drive.scene(mechanics_first=False)
    model = ac.build(scene)
    for end, entries in ((4.3, [0, 1, 2]), (12.3, [0])):
        found = model.sensitivities([0.0, end * drive.T], list(parameters.values()), {scene.coil.i: 0.0}, rtol=1e-11)
        for k, (name, value) in enumerate(values.items()):
            ends: list[np.ndarray] = []
            for sign in (1, -1):
                other = Drive(1.0, 1.0, 1.0)
                vars(other).update({name: value * (1 + sign * h)})
                ends.append(Pieces([0.0, 0.0, 0.0], end * drive.T, other.after)(end * drive.T))
            slopes = (ends[0] - ends[1]) / (2 * h * value)
            for entry in entries:
                expression = (scene.coil.i, scene.rotor.w, scene.rotor.phi)[entry]
                assert found[expression][-1][k] == pytest.approx(slopes[entry], rel=1e-6, abs=1e-8 * ends[0][entry] / value)


def test_nothing_moves_what_is_held_by_several_and_others_move_as_if_it_were_not_there() -> None:
    """By a stop, and friction: how they share it is rounding, and so is what a direction moves it by. The current is that of no machine."""
    V, L, k, tau = ac.Parameter(5.0), ac.Parameter(5e-3), ac.Parameter(0.05), ac.Parameter(0.4)
    scene: Any = ac.System()
    scene.mains, scene.coil, scene.wire, scene.ground = VoltageSource(V), Inductor(L), Resistor(1.0), Ground()
    scene.machine, scene.rotor = ElectromotiveForce(k), Inertia(1e-3)
    scene.friction, scene.stop = Brake(scene.rotor.flange_b, tau), EndStop(scene.rotor.flange_b, upper=4.0)
    scene.connect(scene.mains.pin_a, scene.coil.pin_a)
    scene.connect(scene.coil.pin_b, scene.wire.pin_a)
    scene.connect(scene.wire.pin_b, scene.machine.pin_a)
    scene.connect(scene.machine.pin_b, scene.mains.pin_b, scene.ground.pin)
    scene.connect(scene.machine.flange, scene.rotor.flange_a)
    model, g = ac.build(scene), np.random.default_rng(1)
    for _ in range(60):
        volts, henries, rtol, end = g.uniform(3, 7), g.uniform(2e-3, 1e-2), 10 ** g.uniform(-12, -8), g.uniform(0.005, 0.015)
        given = {V: volts, L: henries}
        found = model.sensitivities([0.0, end], [L, k, tau], {scene.coil.i: 0.0}, rtol=rtol, parameters=given)[scene.coil.i][-1]
        exact = [-volts * end / henries**2 * np.exp(-end / henries), 0.0, 0.0]
        assert found == pytest.approx(exact, rel=max(10 * rtol, 1e-9), abs=1e-12)


def test_a_source_that_jumps_hands_over_without_delay_whatever_its_voltage_is() -> None:
    """All is in proportion to it. What a valve blocks has not come to zero there, but jumped."""
    V = ac.Parameter(24.0)
    scene: Any = ac.System()
    scene.mains = VoltageSource(V * ((np.cos(300.0 * ac.time) > 0) - 0.2 + 0.1 * np.sin(700.0 * ac.time)))
    scene.valve, scene.free, scene.coil, scene.load, scene.ground = (
        IdealDiode(),
        IdealDiode(),
        Inductor(5e-3),
        Resistor(1.2),
        Ground(),
    )
    scene.connect(scene.mains.pin_a, scene.valve.pin_a)
    scene.connect(scene.valve.pin_b, scene.free.pin_b, scene.coil.pin_a)
    scene.connect(scene.coil.pin_b, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.mains.pin_b, scene.free.pin_a, scene.ground.pin)
    model = ac.build(scene)
    times = [0.0, 0.011, 0.03, 0.086]
    found = model.sensitivities(times, [V], {scene.coil.i: 0.0}, rtol=1e-11)[scene.coil.i]
    run = model.simulate(times[-1], {scene.coil.i: 0.0}, rtol=1e-11, samples=times)
    assert found.ravel() == pytest.approx(run[scene.coil.i].ravel() / 24.0, rel=1e-9)


def drawn(seed: int, order: np.random.Generator | None) -> Any:
    """A source, diodes with a little resistance, inductors and other parts, which connect all nodes, and one or two machines with friction, some with stops or a clutch between them; with all circuit
    elements, frictions, and times [s], voltages [V] and speeds [rad/s]."""
    g = np.random.default_rng(seed)
    V, R, T = float(g.choice([1e-3, 1.0, 1e4])), float(g.choice([1e-2, 1.0, 1e5])), float(g.choice([1e-6, 1.0, 1e2]))
    nodes = int(g.integers(3, 6))
    while True:
        kinds = (
            "V" + "D" * int(g.integers(1, 5)) + "LM" + "".join(g.choice(list("RRRCLLM"), int(g.integers(nodes - 1, nodes + 3))))
        )
        ends = [g.choice(nodes, 2, replace=False) for _ in kinds]
        beside = any(kind == "D" and set(pair) == set(ends[0]) for kind, pair in zip(kinds, ends, strict=True))
        joined: Any = nx.MultiGraph([(int(a), int(b)) for kind, (a, b) in zip(kinds, ends, strict=True) if kind != "D"])
        rigid: Any = nx.MultiGraph([(int(a), int(b)) for kind, (a, b) in zip(kinds, ends, strict=True) if kind in "VCM"])
        joined.add_nodes_from(range(nodes))
        rigid.add_nodes_from(range(nodes))
        loops = rigid.number_of_edges() > nodes - nx.number_connected_components(rigid)
        uses = Counter(int(node) for pair in ends for node in pair)
        used = all(uses[node] + (node == 0) > 1 for node in range(nodes))
        if nx.is_connected(joined) and not loops and not beside and used and kinds.count("M") < 3:
            break
    torque = 0.7 * V * T * V / R
    drawn_values = zip(kinds, g.uniform(0.5, 2, len(kinds)), g.uniform(0, 6, len(kinds)), strict=True)
    elements = [element(kind, value, phase, V, R, T) for kind, value, phase in drawn_values]
    scene = between_nodes(elements, ends, nodes, order)
    machines = [one for one in elements if isinstance(one, ElectromotiveForce)]
    given = [(g.uniform(0.1, 1), g.uniform(0.02, 0.3) * torque, int(g.integers(3)), g.uniform(0.05, 0.4)) for _ in machines]
    wheels = [Inertia(inertia * torque * T**2) for inertia, *_ in given]
    frictions: list[Any] = []
    for wheel, (_, limit, kind, _) in zip(wheels, given, strict=True):
        frictions.append(Brake(wheel.flange_b, limit, holding=(1.3 if kind == 1 else 1.0) * limit))
    stops = [EndStop(wheel.flange_b, -at, at, 0.4) for wheel, (_, _, kind, at) in zip(wheels, given, strict=True) if kind == 2]
    if len(wheels) > 1:
        frictions.append(Clutch(wheels[0].flange_b, wheels[1].flange_b, g.uniform(0.02, 0.2) * torque))
    scene.wheels = wheels
    if order is None:
        scene.frictions, scene.stops = frictions, stops
    else:
        scene.stops, scene.frictions = stops[::-1], frictions[::-1]
    for machine, wheel in zip(machines, wheels, strict=True):
        scene.connect(machine.flange, wheel.flange_a)
    return scene, elements, frictions, T, V, 1 / T


@pytest.mark.parametrize("seed", [2, 7, 15, 22, 24, 32, 55, 59, 105])
def test_drawn_drives_obey_the_laws_of_valves_and_of_friction_in_any_order(seed: int) -> None:
    ends: list[np.ndarray] = []
    for order in (None, np.random.default_rng(seed)):
        scene, elements, frictions, T, V, speed = drawn(seed, order)
        run = ac.build(scene).simulate(2 * T, rtol=1e-10, samples=100)
        most = check_diodes(run, elements, V)
        for friction in frictions:
            grip, slip = run[friction.grip], run[friction.speed]
            slides = np.abs(slip) > 1e-9 * speed
            assert np.abs(grip).max() <= (1 + 1e-9) * float(friction.holding)
            np.testing.assert_allclose(grip[slides], -np.sign(slip[slides]) * float(friction.capacity), rtol=1e-9)
        assert run.statistics.steps < 500
        assert np.abs(run.energy_error()).max() < 1e-8
        ends.append(np.array([run[one.i].ravel()[-1] for one in elements]) / most)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-7)
