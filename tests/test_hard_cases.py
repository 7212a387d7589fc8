"""Hard motions end where their references say; bounds are about five times the largest error measured near that tolerance."""

from __future__ import annotations

import numpy as np
import pytest

import acausal as ac
from tests.hard_cases import (
    CASES,
    REVERSALS,
    long_double_pendulum,
    long_kepler,
    rattleback_scene,
    spin_reversals,
    there_and_back,
)
from tests.scenes import SprungBody

BOUNDS = {  # largest error by tolerance
    "simple_pendulum": {1e-6: 5e-5, 1e-12: 5e-12},
    "pendulum_through_upright": {1e-9: 5e-4, 1e-12: 7e-7},
    "andrews": {1e-6: 5e-8, 1e-12: 3e-13},
    "heavy_top": {1e-6: 1e-6, 1e-12: 2e-13},
    "fast_top": {1e-6: 5e-10, 1e-12: 2e-12},
    "dzhanibekov": {1e-6: 1.5e-6, 1e-12: 1.5e-10},
    "dzhanibekov_in_a_flip": {1e-6: 5e-5, 1e-12: 3e-7},
    "rattleback_first": {1e-6: 1e-6, 1e-12: 1e-11},
    "rattleback_late": {1e-9: 1e-5, 1e-12: 5e-9},
    "disk_nearly_flat": {1e-6: 1.5e-6, 1e-12: 1.5e-11},
    "four_bars_through_singularity": {1e-6: 3e-6, 1e-12: 5e-9},
    "bennett": {1e-6: 1e-4, 1e-12: 5e-11},
    "spring_1e4": {1e-6: 3e-8, 1e-12: 2e-13},
    "spring_1e8": {1e-6: 1.5e-8, 1e-12: 2e-13},
    "micrometres": {1e-6: 2e-8, 1e-12: 5e-13},
    "heavy_below_light": {1e-6: 2e-7, 1e-12: 2e-13},
    "light_below_heavy": {1e-6: 2e-7, 1e-12: 2e-12},
    "massless_link": {1e-6: 3e-7, 1e-12: 1e-13},
    "chain_of_50": {1e-6: 1e-10, 1e-12: 1.5e-13},
    "spherical_pendulum_near_pole": {1e-6: 3e-7, 1e-12: 7e-11},
    "massless_coupler": {1e-6: 1e-8, 1e-12: 3e-13},
    "nearly_folding": {1e-6: 3e-9, 1e-12: 5e-12},
    "overdamped": {1e-6: 5e-12, 1e-12: 1e-13},
    "kepler_10_turns": {1e-6: 7e-5, 1e-12: 1e-10},
    "kepler_1000_turns": {1e-9: 3e-3, 1e-12: 7e-7},
}


@pytest.mark.parametrize(("name", "rtol", "bound"), [(name, *pair) for name, pairs in BOUNDS.items() for pair in pairs.items()])
def test_ends_at_the_reference(name, rtol, bound):
    case = CASES[name]()
    assert case.error(case.simulate(rtol)) < bound


@pytest.mark.parametrize(("name", "bound"), [("switched_force", 3e-8), ("bounces", 1.5e-7)])
def test_radau_sees_kinks(name, bound):
    """Gauss does not yet: it takes steps whose kink lies before the first node or after the last one."""
    case = CASES[name]()
    assert case.error(case.simulate(1e-9, method="radau")) < bound


def test_rattleback_reverses_when_it_should():
    scene, contact = rattleback_scene()
    run = ac.build(scene).simulate(42.0, {contact.v: (0.01, -0.02, -2.0)}, rtol=1e-12, samples=2)
    found = spin_reversals(run, contact.v.sx[2])
    assert found.size == len(REVERSALS)
    assert np.max(np.abs(found - REVERSALS)) < 1e-7


def test_chain_of_50_runs_backwards():
    case = CASES["chain_of_50"]()
    run = case.simulate(1e-8)
    assert run.energy_error() < 1e-11
    assert there_and_back(case, run, 1e-8) < 5e-8


def test_double_pendulum_keeps_its_energy():
    """1e4 s: what is left is a drift of 3e-19 per step, from the method's coefficients being rounded to doubles."""
    found = long_double_pendulum(1e4)
    assert found.largest < 5e-13
    assert abs(found.trend) < 3e-13
    assert found.scatter < 6e-14


def test_kepler_orbit_with_fixed_steps():
    """1000 revolutions of 400 steps each."""
    case, run, found = long_kepler(1000)
    assert found.largest < 4e-12
    assert abs(found.trend) < 4e-12
    assert found.scatter < 3e-13
    assert case.error(run) < 1.5e-6


def test_fast_oscillations_of_small_amplitude_follow_the_tolerance():
    """What oscillates is hidden among the coefficients of what follows the hand, in long steps."""
    scene = SprungBody()
    model = ac.build(scene)
    draw, end = np.random.default_rng(1), 5.0
    for _ in range(40):
        w, b, rtol = 10 ** draw.uniform(1, 2.7), 10 ** draw.uniform(-12, -4), 10 ** draw.uniform(-12, -8)
        a = w**2 / (w**2 - 1)
        run = model.simulate(end, {scene.rail.q: b, scene.rail.v: a}, parameters={scene.rate: w}, rtol=rtol, max_steps=100_000)
        assert abs(run[scene.rail.q][-1] - a * np.sin(end) - b * np.cos(w * end)) < 3 * rtol, (w, b, rtol)


@pytest.mark.parametrize("name", ["spring_1e4", "micrometres"])
def test_first_steps_over_springs_at_rest_follow_the_tolerance(name):
    """The first step that the slow motion asks for spans ten radians of the spring, which does not move yet."""
    case = CASES[name]()
    for rtol in np.geomspace(1e-12, 1e-9, 16):
        assert case.error(case.simulate(rtol)) < 2e-13 + 0.1 * rtol, rtol
