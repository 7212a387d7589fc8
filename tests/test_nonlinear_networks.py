"""Networks of nonlinear scalar equations, drawn at random, each quantity in a unit of its own."""

from __future__ import annotations

import functools
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

import acausal as ac
from components import Capacitor, Diode, Ground, Resistor, VoltageSource
from tests.pairings import each_value

LAWS: dict[str, Callable] = {
    "sinh": lambda y, d: y + np.sinh(d * y),
    "cubic": lambda y, d: y + d * y**3,
    "root": lambda y, d: 0.5 * y + y * np.sqrt(1 + y**2),
}
"""Increasing functions; what is solved for one unknown after the other nests them."""


class Drawn:
    """x_i' = -T_i y_i and law(y_i) + sum C_ij y_j = x_i + push, from x_i = 0.3 (i + 1)."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.n = int(rng.integers(2, 8))
        self.law = LAWS[str(rng.choice(list(LAWS)))]
        self.C = rng.uniform(-0.4, 0.4, (self.n, self.n)) * (rng.random((self.n, self.n)) < 0.7)
        self.D, self.T = rng.uniform(0.1, 2, self.n), 10 ** rng.uniform(-0.5, 0.5, self.n)
        self.start = 0.3 * np.arange(1, self.n + 1)

    def found(self, x: np.ndarray, share: float = 1.0) -> np.ndarray:
        """y by x, with laws times `share`."""
        answer = root(lambda y: share * self.law(y, self.D) + self.C @ y - x, np.zeros(self.n), method="hybr", tol=1e-14)
        assert np.abs(answer.fun).max() < 1e-12
        return answer.x

    def scene(
        self,
        x_unit: np.ndarray,
        y_unit: np.ndarray,
        row_unit: np.ndarray,
        share: float | ac.Parameter = 1.0,
        push: float | ac.Input = 0.0,
    ) -> ac.System:
        n = self.n
        own = {f"x{i}": ac.Variable("1", start=float(self.start[i] * x_unit[i])) for i in range(n)}
        own |= {f"y{i}": ac.Variable("1") for i in range(n)}

        def equations(part):
            x = [getattr(part, f"x{i}") / x_unit[i] + push for i in range(n)]
            y = [getattr(part, f"y{i}") / y_unit[i] for i in range(n)]
            for i in range(n):
                others = [self.C[i, j] * y[j] for j in range(n) if self.C[i, j]]
                yield ac.equal(row_unit[i] * (share * self.law(y[i], self.D[i]) + sum(others) - x[i]), 0.0)
                yield ac.equal(ac.der(getattr(part, f"x{i}")), -x_unit[i] * self.T[i] * y[i])

        scene = ac.System()
        scene.share, scene.push = share, push
        scene.network = type("Network", (ac.Component,), {**own, "equations": equations})()
        return scene


@functools.cache
def by_plain_numbers(seed: int) -> np.ndarray:
    """x (n, 4) at 0, 1, 2, 3 s."""
    drawn = Drawn(seed)
    return solve_ivp(
        lambda t, x: -drawn.T * drawn.found(x), (0, 3), drawn.start, "DOP853", [0, 1, 2, 3], rtol=1e-11, atol=1e-12
    ).y


@each_value(("decades", [0.0, 6.0]), ("seed", range(12)))
def test_what_other_quantities_follow_from_starts_where_it_was_told_to(seed: int, decades: float):
    """Nothing but these say what the others are at the start, however their equations are nested."""
    drawn, units = (
        Drawn(seed),
        10 ** np.random.default_rng(seed + 100).uniform(-decades, decades, 3 * Drawn(seed).n).reshape(3, -1),
    )
    scene = drawn.scene(*units)
    run = ac.build(scene).simulate(3.0, rtol=1e-11, samples=4)
    x = np.array([run[getattr(scene.network, f"x{i}")] for i in range(drawn.n)]) / units[0][:, None]
    y = np.array([run[getattr(scene.network, f"y{i}")] for i in range(drawn.n)]) / units[1][:, None]
    assert np.abs(x[:, 0] - drawn.start).max() < 1e-15
    assert np.abs(x - by_plain_numbers(seed)).max() < 1e-9
    assert np.abs(y[:, 0] - drawn.found(drawn.start)).max() < 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_functions_find_the_start_at_other_parameters_as_a_run_does(seed: int):
    """Each law grows thirtyfold: states that others follow from stay, in functions for other programs too."""
    drawn, ones, share = Drawn(seed), np.ones((3, Drawn(seed).n)), ac.Parameter(1.0, "1")
    scene = drawn.scene(*ones, share)
    model = ac.build(scene)
    names = [getattr(scene.network, f"{what}{i}") for what in "xy" for i in range(drawn.n)]
    started = model.assembly_function(None, [share])
    for value in (1.0, 3.0, 30.0):
        x = np.array(started(value)).ravel()
        run = model.simulate(1e-3, parameters={share: value}, samples=2)
        assert x == pytest.approx(run.x[:, 0], rel=1e-11, abs=1e-13)
        assert [run[name][0] for name in names] == pytest.approx(
            np.append(drawn.start, drawn.found(drawn.start, value)), rel=1e-8
        )


@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-11])
def test_what_follows_from_others_jumps_with_a_source(rtol: float):
    """A diode beside a capacitor behind resistors: its voltage jumps with a square wave that stands in no rate, only in what it follows from."""
    scene = ac.System()
    scene.ground, scene.wire, scene.diode = Ground(), Resistor(100.0), Diode(1e-9, 0.05)
    scene.source = VoltageSource(ca.if_else(ca.sin(100 * np.pi * ac.time) >= 0, 5.0, -3.5))
    scene.load, scene.store = Resistor(1e3), Capacitor(2e-5)
    scene.connect(scene.source.pin_a, scene.wire.pin_a)
    scene.connect(scene.wire.pin_b, scene.diode.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.store.pin_a)
    scene.connect(scene.ground.pin, scene.source.pin_b, scene.diode.pin_b, scene.store.pin_b)
    model = ac.build(scene)
    run = model.simulate(0.04, rtol=rtol, samples=9)
    assert model.state_names == ("store.v", "diode.v")

    def node(v: float, source: float) -> float:
        return brentq(lambda x: (source - x) / 100 - 1e-9 * np.expm1(x / 0.05) - (x - v) / 1e3, -6, 1.2, xtol=1e-15, rtol=1e-14)

    v = 0.0
    for half in range(4):
        source = -3.5 if half % 2 else 5.0
        found = solve_ivp(
            lambda t, y, s=source: [(node(y[0], s) - y[0]) / 0.02], (0, 0.01), [v], "Radau", [0.005, 0.01], rtol=1e-11, atol=1e-13
        ).y[0]
        assert run[scene.store.v][2 * half + 1 : 2 * half + 3] == pytest.approx(found, abs=max(100 * rtol * 1e-2, 1e-10))
        assert run[scene.diode.v][2 * half + 1] == pytest.approx(node(found[0], source), abs=max(100 * rtol, 1e-9))
        v = found[1]
