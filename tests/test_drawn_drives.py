"""Shafts with clutches, brakes, freewheels and play drawn at random: what these obey at all times, in any order of declaration and at any size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal as ac
from components import (
    Backlash,
    Brake,
    Clutch,
    Freewheel,
    Inertia,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    TorqueSource,
)


def drawn(seed: int, order: np.random.Generator | None) -> tuple[Any, list[Inertia], list[Any], float, float]:
    """Two to five inertias with what holds them and drives them; a time [s] and a torque [N*m] of theirs."""
    g = np.random.default_rng(seed)
    J, T = float(g.choice([1e-6, 1.0, 1e4])), float(g.choice([1e-3, 1.0, 1e2]))
    M, n, ground, scene = J / T / T, int(g.integers(2, 6)), RotationalGround(), ac.System()
    shafts = [Inertia(J * g.uniform(0.3, 2)) for _ in range(n)]
    linked: list[tuple[Any, Any, Any]] = []
    laws: list[Any] = []

    def drive() -> TorqueSource:
        return TorqueSource(M * g.uniform(0.5, 5) * np.sin(g.uniform(1, 6) / T * ac.time + g.uniform(0, 6)))

    for kind in g.choice(list("SDCFBKX"), int(g.integers(n, n + 4)), p=[0.2, 0.1, 0.2, 0.13, 0.15, 0.12, 0.1]):
        a, b = g.choice(n, 2, replace=False)
        one, other = shafts[a].flange_b, shafts[b].flange_a
        if kind in "SD":
            part = RotationalSpring(M * g.uniform(1, 20)) if kind == "S" else RotationalDamper(M * T * g.uniform(0.05, 1))
            linked.append((part, one, other))
        elif kind == "X":
            linked.append((drive(), None, other))
        elif kind in "CB":
            capacity = M * g.uniform(0.2, 3)
            holding = capacity * g.choice([1, 1.5])
            laws.append(Clutch(one, other, capacity, holding) if kind == "C" else Brake(one, capacity, holding))
        elif kind == "F":
            laws.append(Freewheel(one, other))
        else:
            laws.append(Backlash(one, other, g.uniform(0.1, 1), float(g.choice([0, 0.5, 0.9]))))
    linked += [(drive(), None, shafts[0].flange_a), (RotationalSpring(M * g.uniform(1, 5)), ground.flange, shafts[-1].flange_b)]
    parts = [*shafts, *(part for part, _, _ in linked), *laws]
    scene.ground, scene.elements = ground, parts if order is None else [parts[k] for k in order.permutation(len(parts))]
    for part, one, other in linked:
        if isinstance(part, TorqueSource):
            scene.connect(part.flange, other)
        else:
            scene.connect(one, part.flange_a)
            scene.connect(other, part.flange_b)
    return scene, shafts, laws, T, M


def obeys(run: Any, law: Any, T: float, M: float) -> None:
    if isinstance(law, Backlash):
        apart, ends = run[law.moved], [run[end] for end in (law.at_lower, law.at_upper)]
        assert np.abs(apart).max() <= 0.5 * float(law.width) + 1e-12
        for end, gap in zip(ends, (apart + 0.5 * float(law.width), 0.5 * float(law.width) - apart), strict=True):
            assert end.min() >= -1e-9 * M
            assert np.all((end <= 1e-9 * M) | (gap < 1e-9))
        return
    grip, speed = run[law.grip], T * run[law.speed]
    if isinstance(law, Freewheel):
        assert grip.min() >= -1e-9 * M
        assert speed.min() >= -1e-8
        assert np.abs(grip * speed).max() <= 1e-7 * M * max(1.0, np.abs(grip).max() / M)
        return
    slips = np.abs(speed) > 1e-6
    assert np.abs(grip).max() <= float(law.holding) * (1 + 1e-9)
    np.testing.assert_allclose(grip[slips], -float(law.capacity) * np.sign(speed[slips]), rtol=0, atol=1e-9 * float(law.capacity))


SEEDS = [*range(15), 30, 49, 69, 77, 87, 88, 97, 113, 157]


@pytest.mark.parametrize("seed", SEEDS)
def test_drives_hold_slip_and_run_ahead_in_any_order_of_parts(seed: int) -> None:
    runs: list[Any] = []
    for order in (None, np.random.default_rng(seed + 7)):
        scene, shafts, laws, T, M = drawn(seed, order)
        run = ac.build(scene).simulate(10 * T, rtol=1e-10, samples=300)
        for law in laws:
            obeys(run, law, T, M)
        if run.kinetic_energy.max() > 1e-12 * M:  # what is held everywhere has none to compare with
            assert run.energy_error() < 1e-6
        runs.append(np.array([run[shaft.flange_a.phi] for shaft in shafts]))
    assert runs[1] == pytest.approx(runs[0], abs=1e-7 * max(1.0, np.abs(runs[0]).max()))


def test_freewheels_that_lead_each_other_hold_both_ways() -> None:
    scene = ac.System()
    scene.a, scene.b = Inertia(1.0), Inertia(2.0)
    scene.on, scene.back = Freewheel(scene.a.flange_b, scene.b.flange_a), Freewheel(scene.b.flange_a, scene.a.flange_b)
    scene.drive = TorqueSource(np.sin(2 * ac.time + 1))
    scene.connect(scene.drive.flange, scene.a.flange_a)
    run = ac.build(scene).simulate(3.0, rtol=1e-11, samples=50)
    exact = (np.cos(1) * run.t / 2 - (np.sin(2 * run.t + 1) - np.sin(1)) / 4) / 3
    for shaft in (scene.a, scene.b):
        assert run[shaft.flange_a.phi] == pytest.approx(exact, abs=1e-10)
    assert run[scene.on.grip] - run[scene.back.grip] == pytest.approx(2 / 3 * np.sin(2 * run.t + 1), abs=1e-9)
