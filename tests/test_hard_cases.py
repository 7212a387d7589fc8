"""Hard motions end where their references say; bounds are about five times what was measured."""

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

BOUNDS = {  # largest error by tolerance
    "simple_pendulum": {1e-6: 2e-5, 1e-12: 1e-10},
    "pendulum_through_upright": {1e-6: 7e-2, 1e-12: 5e-7},
    "andrews": {1e-6: 7e-8, 1e-12: 7e-14},
    "heavy_top": {1e-6: 5e-7, 1e-12: 5e-13},
    "fast_top": {1e-6: 1e-7, 1e-12: 3e-12},
    "dzhanibekov": {1e-6: 1.5e-5, 1e-12: 7e-11},
    "dzhanibekov_in_a_flip": {1e-6: 7e-4, 1e-12: 7e-7},
    "rattleback_first": {1e-6: 5e-5, 1e-12: 7e-13},
    "rattleback_late": {1e-12: 1e-7},
    "disk_nearly_flat": {1e-6: 3e-6, 1e-12: 5e-11},
    "bennett": {1e-6: 1e-3, 1e-12: 1.5e-11},
    "spring_1e4": {1e-6: 7e-6, 1e-12: 3e-11},
    "spring_1e8": {1e-12: 2e-13},
    "heavy_below_light": {1e-6: 3e-6, 1e-12: 3e-12},
    "light_below_heavy": {1e-6: 5e-6, 1e-12: 7e-12},
    "massless_link": {1e-6: 7e-7, 1e-12: 1.5e-12},
    "chain_of_50": {1e-6: 3e-10},
    "kepler_10_turns": {1e-6: 5e-4, 1e-12: 7e-10},
}


@pytest.mark.parametrize(("name", "rtol", "bound"), [(name, *pair) for name, pairs in BOUNDS.items() for pair in pairs.items()])
def test_ends_at_the_reference(name, rtol, bound):
    case = CASES[name]()
    assert case.error(case.simulate(rtol)) < bound


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
    found = long_double_pendulum(200.0)
    assert found.largest < 2e-13
    assert abs(found.trend) < 5e-14


def test_kepler_orbit_with_fixed_steps():
    """The energy comes back after each passage of the sun: an error of each step, but no trend; the phase is what is lost."""
    case, run, found = long_kepler(20)
    assert found.largest < 1e-10
    assert abs(found.trend) < 1e-12
    assert case.error(run) < 1e-7
