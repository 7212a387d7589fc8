"""Stops and play that yield, and couplings by any law, on flanges of either kind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline

import acausal as ac
from acausal.errors import ParameterError
from components import (
    Coulomb,
    ElasticBacklash,
    ElasticCoupling,
    ElasticStop,
    EndStop,
    ForceSource,
    HuntCrossley,
    Inertia,
    Revolute,
    RigidBody,
    SlidingMass,
    SmoothCoulomb,
    TorqueSource,
    World,
)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("upper", [False, True])
def test_mass_between_springs_that_it_touches_swings_with_the_period_of_flights_and_half_swings(size: float, upper: bool) -> None:
    """Of an end, and its image: two flights across the gap and two half swings on the springs, for ever."""
    m, k, gap, v = 2.0 * size**3, 500.0 * size**2, 0.3 * size, 1.5 * size
    scene = ac.System()
    scene.mass = SlidingMass(m)
    law = HuntCrossley(k, exponent=1)
    scene.stop = ElasticStop(scene.mass.flange_a, -gap if not upper else None, gap if upper else None, law=law)
    half = np.pi * np.sqrt(m / k)
    sign = 1.0 if upper else -1.0
    run = ac.build(scene).simulate(gap / v + half + 0.1, {scene.mass.s: 0.0, scene.mass.v: sign * v}, rtol=1e-11)
    assert run[scene.mass.v][-1] == pytest.approx(-sign * v, rel=1e-9)
    assert run[scene.mass.s][-1] == pytest.approx(sign * (gap - 0.1 * v), rel=1e-8)
    deepest = run.at([gap / v + half / 2])
    assert abs(deepest[scene.stop.effort][0]) == pytest.approx(v * np.sqrt(k * m), rel=1e-8)
    assert np.min(run[scene.stop.at_lower]) >= 0 and np.min(run[scene.stop.at_upper]) >= 0
    assert run.energy_error() < 1e-9


def test_teeth_with_play_strike_as_their_relative_motion_does() -> None:
    """By Hunt and Crossley, with losses; both turn on."""
    Ja, Jb, width, law = 0.3, 0.5, 0.02, HuntCrossley(2e3, 0.4, exponent=1.5)
    scene = ac.System()
    scene.a, scene.b, scene.drive = Inertia(Ja), Inertia(Jb), TorqueSource(0.7)
    scene.connect(scene.drive.flange, scene.a.flange_a)
    scene.teeth = ElasticBacklash(scene.a.flange_b, scene.b.flange_a, width, law)
    run = ac.build(scene).simulate(1.0, {scene.a.w: 0.5, scene.b.w: 0.0, scene.a.phi: 0.0, scene.b.phi: 0.0}, rtol=1e-11)

    def effort(x: float, v: float) -> float:
        """On b, forward."""
        behind, ahead = max(-x - width / 2, 0.0), max(x - width / 2, 0.0)
        return 2e3 * (behind**1.5 * max(1 - 0.4 * v, 0) - ahead**1.5 * max(1 + 0.4 * v, 0))

    def rates(_t: float, y: np.ndarray) -> list[float]:
        drives = effort(y[1] - y[0], y[3] - y[2])
        return [y[2], y[3], (0.7 - drives) / Ja, drives / Jb]

    y = solve_ivp(rates, (0, 1), [0, 0, 0.5, 0], rtol=1e-12, atol=1e-13, max_step=1e-3, method="DOP853").y[:, -1]
    found = [run[value][-1] for value in (scene.a.phi, scene.b.phi, scene.a.w, scene.b.w)]
    np.testing.assert_allclose(found, y, rtol=1e-6)
    assert run.energy_error() < 1e-8


@pytest.mark.parametrize("law", ["quartic", "curve"])
def test_pendulum_with_a_hardening_spring_swings_with_the_period_of_its_energy(law: str) -> None:
    curve = CubicSpline([-1.0, -0.5, 0.0, 0.5, 1.0], [-3.0, -0.8, 0.0, 0.8, 3.0])
    potential: Callable[[float], float] = (lambda x: x**2 + 2 * x**4) if law == "quartic" else curve.antiderivative()
    J, x0 = 0.4, 0.7
    scene = ac.System()
    scene.world, scene.hinge, scene.body = World((0, 0, 0)), Revolute("y"), RigidBody(1.0, (J, J, J))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.body.frame)
    looked = potential if law == "quartic" else lambda x: ac.lookup(potential, x)
    scene.spring = ElasticCoupling(scene.hinge.flange, None, looked)

    def slowness(u: float) -> float:
        """Of x = x0 (1 - u^2), without the root at the turn."""
        x = x0 * (1 - u * u)
        drop = potential(x0) - potential(x)
        return 2 * x0 * u / np.sqrt(2 * drop / J) if u > 1e-9 else 0.0

    quarter = quad(slowness, 0, 1, epsabs=1e-12, limit=200)[0]
    run = ac.build(scene).simulate(2 * quarter, {scene.hinge.q: x0, scene.hinge.v: 0.0}, rtol=1e-11)
    assert run[scene.hinge.q][-1] == pytest.approx(-x0, abs=1e-7) and run.energy_error() < 1e-9


def test_damper_between_two_masses_lets_their_difference_fade() -> None:
    scene = ac.System()
    scene.a, scene.b = SlidingMass(1.0), SlidingMass(3.0)
    scene.tie = ElasticCoupling(scene.a.flange_b, scene.b.flange_a, lambda x: 8.0 * x**2, damping=0.6)
    run = ac.build(scene).simulate(3.0, {scene.a.s: 0, scene.b.s: 0.2, scene.a.v: 0, scene.b.v: 0}, rtol=1e-10)
    reduced, c, k = 0.75, 0.6, 16.0
    decay, rate = c / (2 * reduced), np.sqrt(k / reduced - (c / (2 * reduced)) ** 2)
    t = run.t
    x = 0.2 * np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))
    np.testing.assert_allclose(run[scene.b.s] - run[scene.a.s], x, atol=1e-9)
    np.testing.assert_allclose(run[scene.a.s] + 3 * run[scene.b.s], 0.6, atol=1e-12)


def test_laws_that_no_flange_has_are_refused() -> None:
    flange = SlidingMass(1.0).flange_a
    rough = HuntCrossley(1e3, friction=SmoothCoulomb(0.3, 1e-3))
    for make, said in (
        (lambda: ElasticStop(flange, 0.0, law=Coulomb(0.3)), "Give HuntCrossley"),
        (lambda: ElasticStop(flange, 0.0, law=rough), "no way to slip"),
        (lambda: ElasticStop(flange, law=HuntCrossley(1e3)), "neither"),
        (lambda: ElasticStop(flange, 1.0, 0.5, law=HuntCrossley(1e3)), "ElasticStop's upper is 0.5 below"),
        (lambda: ElasticCoupling(flange, None, lambda x: 3.0), "function of x"),
    ):
        with pytest.raises(ParameterError, match=said):
            make()


def test_ball_on_an_elastic_floor_rests_where_its_weight_is_borne() -> None:
    scene = ac.System()
    scene.mass, scene.weight = SlidingMass(2.0), ForceSource(-2.0 * 9.81)
    scene.connect(scene.weight.flange, scene.mass.flange_a)
    scene.floor = ElasticStop(scene.mass.flange_b, 0.0, law=HuntCrossley(1e5, 0.5, exponent=1.5))
    rest = ac.build(scene).equilibrium({scene.mass.s: -1e-3})
    assert rest[scene.mass.s] == pytest.approx(-((2.0 * 9.81 / 1e5) ** (2 / 3)), rel=1e-9)


@pytest.mark.parametrize("beside", [lambda f: ElasticStop(f, lower=-0.1, law=HuntCrossley(1e3, 0.3)), lambda f: EndStop(f, lower=-0.1), lambda f: ElasticCoupling(f, None, lambda x: x**4, damping=0.1)])  # fmt: skip
def test_states_keep_their_names_whatever_is_put_beside_them(beside):
    """Those that the mass itself differentiates, though others differentiate its flange."""
    names = []
    for first in (False, True):
        scene = ac.System()
        if first:
            mass = SlidingMass(1.0)
            scene.beside, scene.mass = beside(mass.flange_a), mass
        else:
            scene.mass = SlidingMass(1.0)
            scene.beside = beside(scene.mass.flange_a)
        names.append(ac.build(scene).state_names)
    assert names == [("mass.s", "mass.v")] * 2
