"""Published problems in scalar equations: F. Mazzia and C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4 (2008), whose
reference solutions these are; E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, IV.10.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

import acausal as ac

Law = Callable[[Sequence[Any], Sequence[Any]], Iterator[tuple[Any, Any]]]


def scene_of(start: Sequence[float], law: Law, unit: str = "1") -> tuple[ac.System, list[ac.Expression]]:
    """Variables y_1 ... y_n and `law`(y, y'): pairs that are equal."""
    own: dict[str, Any] = {f"y{k + 1}": ac.Variable(unit, start=float(value)) for k, value in enumerate(start)}

    def equations(part):
        y = [getattr(part, name) for name in own if name != "equations"]
        for one, other in law(y, [ac.der(v) for v in y]):
            yield ac.equal(one, other)

    own["equations"] = equations
    scene = ac.System()
    scene.part = type("Part", (ac.Component,), own)()
    return scene, [getattr(scene.part, f"y{k + 1}") for k in range(len(start))]


def robertson(y, rates):
    slow, fast, quick = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    yield rates[0], fast - slow
    yield rates[1], slow - fast - quick
    yield rates[2], quick


def robertson_with_all_that_is_there(y, rates):
    yield from list(robertson(y, rates))[:2]
    yield y[0] + y[1] + y[2], 1.0


@pytest.mark.parametrize("law", [robertson, robertson_with_all_that_is_there])
@pytest.mark.parametrize(("rtol", "error"), [(1e-4, 0.5), (1e-6, 1e-2), (1e-8, 1e-2), (1e-10, 1e-5), (1e-12, 1e-7)])
def test_a_slow_reaction_is_followed_for_three_thousand_years(law: Law, rtol: float, error: float) -> None:
    """A first step that is a part of the whole would be a billion times too long: nothing that is looked at there may be remembered. `error`: of what is
    left, a fifty-millionth of what the tolerance belongs to.
    """
    scene, y = scene_of((1, 0, 0), law)
    run = ac.build(scene).simulate(1e11, rtol=rtol, samples=np.concatenate([[0.0], np.logspace(-4, 11, 61)]))
    wanted = (0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050)
    for k in range(3):
        assert run[y[k]][-1] == pytest.approx(wanted[k], rel=error)
        assert run[y[k]].min() >= 0
    assert run.statistics.steps < 400


def test_eight_reactions_of_plants() -> None:
    def law(y, rates):
        caught = 280 * y[5] * y[7]
        yield rates[0], -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007
        yield rates[1], 1.71 * y[0] - 8.75 * y[1]
        yield rates[2], -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4]
        yield rates[3], 8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3]
        yield rates[4], -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6]
        yield rates[5], -caught + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6]
        yield rates[6], caught - 1.81 * y[6]
        yield rates[7], -caught + 1.81 * y[6]

    scene, y = scene_of((1, 0, 0, 0, 0, 0, 0, 0.0057), law)
    run = ac.build(scene).simulate(321.8122, rtol=1e-11)
    wanted = (
        0.7371312573325668e-3, 0.1442485726316185e-3, 0.5888729740967575e-4, 0.1175651343283149e-2,
        0.2386356198831331e-2, 0.6238968252742796e-2, 0.2849998395185769e-2, 0.2850001604814231e-2,
    )  # fmt: skip
    assert [run[v][-1] for v in y] == pytest.approx(wanted, rel=1e-11)


def test_reactions_one_of_which_is_in_balance() -> None:
    def law(y, rates):
        root = np.sqrt(y[1])
        r1, r2, r3 = 18.7 * y[0] ** 4 * root, 0.58 * y[2] * y[3], 0.58 / 34.4 * y[0] * y[4]
        r4, r5 = 0.09 * y[0] * y[3] ** 2, 0.42 * y[5] ** 2 * root
        yield rates[0], -2 * r1 + r2 - r3 - r4
        yield rates[1], -0.5 * r1 - r4 - 0.5 * r5 + 3.3 * (0.9 / 737 - y[1])
        yield rates[2], r1 - r2 + r3
        yield rates[3], -r2 + r3 - 2 * r4
        yield rates[4], r2 - r3 + r5
        yield 115.83 * y[0] * y[3], y[5]

    scene, y = scene_of((0.444, 0.00123, 0, 0.007, 0, 115.83 * 0.444 * 0.007), law)
    run = ac.build(scene).simulate(180.0, rtol=1e-11)
    wanted = (
        0.1150794920661702,
        0.1203831471567715e-2,
        0.1611562887407974,
        0.3656156421249283e-3,
        0.1708010885264404e-1,
        0.4873531310307455e-2,
    )
    assert [run[v][-1] for v in y] == pytest.approx(wanted, rel=1e-11)


def test_an_amplifier_of_two_transistors() -> None:
    """Capacitors between nodes: of eight voltages five are states, and the start that is given is met."""

    def law(y, rates):
        R, C, supply = 9000.0, 1e-6, 6.0
        begins = 0.1 * np.sin(200 * np.pi * ac.time)
        one, other = (1e-6 * (np.exp((y[a] - y[b]) / 0.026) - 1) for a, b in ((1, 2), (4, 5)))
        yield C * (rates[1] - rates[0]), (y[0] - begins) / 1000
        yield C * (rates[0] - rates[1]), 2 * y[1] / R - supply / R + 0.01 * one
        yield -2 * C * rates[2], y[2] / R - one
        yield 3 * C * (rates[4] - rates[3]), y[3] / R - supply / R + 0.99 * one
        yield 3 * C * (rates[3] - rates[4]), 2 * y[4] / R - supply / R + 0.01 * other
        yield -4 * C * rates[5], y[5] / R - other
        yield 5 * C * (rates[7] - rates[6]), y[6] / R - supply / R + 0.99 * other
        yield 5 * C * (rates[6] - rates[7]), y[7] / R

    start = (0, 3, 3, 6, 3, 3, 6, 0)
    scene, y = scene_of(start, law, "V")
    model = ac.build(scene)
    run = model.simulate(0.2, rtol=1e-10)
    wanted = (
        -0.5562145012262709e-2, 3.006522471903042, 2.849958788608128, 2.926422536206241,
        2.704617865010554, 2.761837778393145, 4.770927631616772, 1.236995868091548,
    )  # fmt: skip
    assert len(model.state_names) == 5
    assert [run[v][0] for v in y] == pytest.approx(start, abs=1e-14)
    assert [run[v][-1] for v in y] == pytest.approx(wanted, abs=1e-10)


def test_an_oscillation_with_sudden_turns() -> None:
    """Van der Pol's, 1e-6 times as quick at its turns."""
    scene, y = scene_of((2, 0), lambda y, rates: iter([(rates[0], y[1]), (rates[1], 1e6 * ((1 - y[0] ** 2) * y[1] - y[0]))]))
    run = ac.build(scene).simulate(2.0, rtol=1e-11)
    assert [run[v][-1] for v in y] == pytest.approx((0.1706167732170469e1, -0.8928097010248125), rel=1e-11)


def test_an_oscillating_reaction() -> None:
    """Field and Noyes's, through its three turns."""

    def law(y, rates):
        yield rates[0], 77.27 * (y[1] + y[0] * (1 - 8.375e-6 * y[0] - y[1]))
        yield rates[1], (y[2] - (1 + y[0]) * y[1]) / 77.27
        yield rates[2], 0.161 * (y[0] - y[2])

    scene, y = scene_of((1, 2, 3), law)
    run = ac.build(scene).simulate(360.0, rtol=1e-12)
    assert [run[v][-1] for v in y] == pytest.approx((0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3), rel=1e-9)


def test_a_car_on_a_bumpy_road_held_by_two_conditions() -> None:
    """Two masses of a stiff axle, held at a distance from each other and at right angles to the road: two hidden conditions behind each of them, which change with time."""

    def law(y, rates):
        xl, yl, xr, yr, ul, vl, ur, vr, left, right = y
        m, height = 10 * 1e-2**2 / 2, 0.1 * np.sin(10 * ac.time)
        along = np.sqrt(1 - height**2)
        one, other = np.sqrt(xl**2 + yl**2), np.sqrt((xr - along) ** 2 + (yr - height) ** 2)
        yield from zip(rates[:4], (ul, vl, ur, vr), strict=True)
        yield m * rates[4], (0.5 - one) * xl / one + left * along + 2 * right * (xl - xr)
        yield m * rates[5], (0.5 - one) * yl / one + left * height + 2 * right * (yl - yr) - m
        yield m * rates[6], (0.5 - other) * (xr - along) / other - 2 * right * (xl - xr)
        yield m * rates[7], (0.5 - other) * (yr - height) / other - 2 * right * (yl - yr) - m
        yield xl * along + yl * height, 0.0
        yield (xl - xr) ** 2 + (yl - yr) ** 2, 1.0

    scene, y = scene_of((0, 0.5, 1, 0.5, -0.5, 0, -0.5, 0, 0, 0), law)
    run = ac.build(scene).simulate(3.0, rtol=1e-10)
    wanted = (
        0.4934557842755629e-1, 0.4969894602303324, 0.1041742524885400e1, 0.3739110272652214, -0.7705836840321485e-1,
        0.7446866596327776e-2, 0.1755681574942899e-1, 0.7703410437794031, -0.4736886750784630e-2, -0.1104680411345730e-2,
    )  # fmt: skip
    assert [run[v][-1] for v in y] == pytest.approx(wanted, abs=1e-9)
    assert run.constraint_error() < 1e-14
