"""Clutches in series and beside one another, and several brakes on one shaft, by capacities and torques that jump at times: against all patterns of what holds, tried one by one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import acausal as ac
from components import Brake, Clutch, Inertia, TorqueSource

Course = tuple[np.ndarray, np.ndarray]
"""Times at which it jumps, and what it is before and after."""


def at(course: Course, t: float) -> float:
    times, values = course
    return float(values[np.searchsorted(times, t)])


def written(course: Course) -> Any:
    times, values = course
    jumps = (float(jump) * (ac.time > float(t)) for t, jump in zip(times, np.diff(values), strict=True))
    return sum(jumps, float(values[0]) + 0.0 * ac.time)


def accelerations(A: np.ndarray, inertias: np.ndarray, torques: np.ndarray, limits: np.ndarray, slips: np.ndarray) -> np.ndarray:
    """With slips A w, and torques A' g, |g| <= limits: all patterns of sticking, and of slip either way, of those that are zero."""
    still = np.flatnonzero(slips == 0)
    for pattern in itertools.product((0, 1, -1), repeat=still.size):
        grips, ways = -np.sign(slips) * limits, np.array(pattern)
        grips[still] = -ways * limits[still]
        held = still[ways == 0]
        found = (torques + A.T @ grips) / inertias
        if held.size:
            grips[held] = np.linalg.lstsq(A[held] @ np.diag(1 / inertias) @ A[held].T, -A[held] @ found, rcond=None)[0]
            found = (torques + A.T @ grips) / inertias
        least = 1e-10 * max(1.0, np.abs(found).max())
        within, holds = np.all(np.abs(grips) <= limits * (1 + 1e-10)), np.all(np.abs(A[held] @ found) <= least)
        if within and holds and np.all((A @ found)[still] * ways >= -least):
            return found
    raise AssertionError("No pattern obeys the laws.")


def speeds(
    A: np.ndarray, inertias: np.ndarray, torques: Sequence[Course], limits: Sequence[Course], w: np.ndarray, end: float
) -> Any:
    """Times (m,) and speeds (m, n), between which these change evenly."""
    knots = np.sort(np.concatenate([course[0] for course in (*torques, *limits)]))
    t, times, found, fast = 0.0, [0.0], [w], np.abs(w).max()
    while t < end:
        until = min(end, *knots[knots > t + 1e-12], end)
        slips, middle = A @ w, 0.5 * (t + until)
        slips[np.abs(slips) < 1e-11 * fast] = 0.0
        rates = accelerations(
            A, inertias, np.array([at(c, middle) for c in torques]), np.array([at(c, middle) for c in limits]), slips
        )
        closing = slips * (A @ rates) < 0
        step = min([until - t, *(-slips[closing] / (A @ rates)[closing])])
        t, w = until if step == until - t else t + step, w + step * rates
        times.append(t)
        found.append(w)
    return np.array(times), np.array(found)


@pytest.mark.parametrize("seed", range(6))
def test_clutches_and_brakes_on_shafts_in_a_row_hold_and_slip_as_they_must(seed: int) -> None:
    g = np.random.default_rng(seed)
    n, size, end = int(g.integers(2, 5)), 10 ** g.uniform(-3, 3), 5.0
    inertias, w = g.uniform(0.2, 2, n) * size, g.uniform(-3, 3, n)
    pairs = [(k, k + 1) for k in range(n - 1)] + [(int(g.integers(n)), -1) for _ in range(int(g.integers(1, 5)))]
    pairs += [(0, n - 1)] if seed % 2 else []
    A = np.array([np.eye(n)[b] * (b >= 0) - np.eye(n)[a] for a, b in pairs])
    limits = [(np.sort(g.uniform(0, 4, 3)), g.choice([0, 0.3, 1, 2], 4) * g.uniform(0.5, 1.5) * size) for _ in pairs]
    torques = [(np.sort(g.uniform(0, 4, 2)), g.choice([0, 0, 1, -1, 0.5], 3) * g.uniform(0.3, 1) * size) for _ in inertias]
    times, exact = speeds(A, inertias, torques, limits, w, end)
    for order in (1, -1):
        scene: Any = ac.System()
        wheels = [Inertia(float(inertia)) for inertia in inertias]
        drives = [TorqueSource(written(course)) for course in torques]
        grips = [
            Clutch(wheels[a].flange_b, wheels[b].flange_b, written(limit))
            if b >= 0
            else Brake(wheels[a].flange_b, written(limit))
            for (a, b), limit in zip(pairs, limits, strict=True)
        ]
        scene.wheels, scene.grips, scene.drives = wheels[::order], grips[::order], drives
        for wheel, drive in zip(wheels, drives, strict=True):
            scene.connect(wheel.flange_a, drive.flange)
        start = {wheel.w: float(speed) for wheel, speed in zip(wheels, w, strict=True)}
        run = ac.build(scene).simulate(end, start, rtol=1e-10, samples=101)
        for wheel, column in zip(wheels, exact.T, strict=True):
            np.testing.assert_allclose(
                run[wheel.w].ravel(), np.interp(run.t, times, column), rtol=0, atol=1e-11 * np.abs(exact).max()
            )
