"""Slip in a plane whose direction turns to where friction makes the normal force grow beyond all bounds (Painleve): it is stopped there by an impact, and the motion goes on.

Compared with the equations of a rod on its foot, integrated in the impulse that presses, in which nothing grows: dt = (compliance along the normal) / (what presses) dP.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal as ac
from components import Coulomb, PointOnPlane, RigidBody, World

G, HALF = 9.81, 0.5


def rod_on_its_foot(mu: float, mass: float, size: float) -> ac.System:
    scene = ac.System()
    scene.world, scene.foot = World(gravity=(0.0, 0.0, -G * size)), PointOnPlane(unilateral=True, friction=Coulomb(mu))
    across = mass * (HALF * size) ** 2 / 3
    scene.rod = RigidBody(mass=mass, inertia=(across, across, 1e-3 * across))
    scene.connect(scene.world.frame, scene.foot.frame_a)
    scene.connect(scene.foot.frame_b, scene.rod.at((0.0, 0.0, -HALF * size)))
    return scene


def leaning(angle: float) -> np.ndarray:
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[s, 0.0, c], [0.0, 1.0, 0.0], [-c, 0.0, s]])


def foot_of(R: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a rod of mass 1 in metres: compliance of its foot (3, 3), its acceleration without a force there, and the arm to it."""
    arm = -HALF * R[:, 2]
    inverse = R @ np.diag([3.0, 3.0, 3e3]) @ R.T / HALF**2
    across = np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
    turning = -inverse @ np.cross(w, np.linalg.inv(inverse) @ w)
    free = np.array([0.0, 0.0, -G]) + np.cross(turning, arm) + np.cross(w, np.cross(w, arm))
    return np.eye(3) - across @ inverse @ across, free, arm


def until_it_jams(mu: float, angle: float, slip: tuple[float, float]) -> tuple[float, np.ndarray, np.ndarray]:
    """Time, slip (2,) and compliance (3, 3) of the foot."""

    def split(y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        return y[:3], y[3:6], y[6:15].reshape(3, 3), y[15:18]

    def along(y: np.ndarray) -> np.ndarray:
        _, v, R, w = split(y)
        u = (v + np.cross(w, -HALF * R[:, 2]))[:2]
        return np.array([*(-mu * u / np.linalg.norm(u)), 1.0])

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        _, v, R, w = split(y)
        W, free, arm = foot_of(R, w)
        push, inverse = along(y), R @ np.diag([3.0, 3.0, 3e3]) @ R.T / HALF**2
        yields, pressed = W[2] @ push, -free[2]  # N = pressed / yields; per N dt = pressed ds and dt = yields ds
        spin = inverse @ (np.cross(arm, pressed * push) - yields * np.cross(w, np.linalg.inv(inverse) @ w))
        wx = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
        return np.concatenate(
            [yields * v, pressed * push + yields * np.array([0, 0, -G]), (yields * wx @ R).ravel(), spin, [yields]]
        )

    def critical(_: float, y: np.ndarray) -> float:
        return float(foot_of(split(y)[2], split(y)[3])[0][2] @ along(y))

    critical.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    R = leaning(angle)
    y = np.concatenate([HALF * R[:, 2], [*slip, 0.0], R.ravel(), np.zeros(4)])
    end = solve_ivp(rate, (0.0, 10.0), y, "DOP853", events=critical, rtol=1e-12, atol=1e-14).y_events[0][0]
    _, v, R, w = split(end)
    W, _, arm = foot_of(R, w)
    return float(end[18]), (v + np.cross(w, arm))[:2], W


@pytest.mark.parametrize("seed", range(6))
def test_rod_whose_foot_turns_to_its_critical_direction_is_stopped(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, mass = [1.0, 1e-3, 1e3][seed % 3], float(10 ** rng.uniform(-3, 3))
    mu, angle = float(rng.uniform(1.4, 2.5)), float(rng.uniform(1.05, 1.2))
    slip = (float(rng.uniform(-0.2, 0.1)), float(rng.uniform(0.4, 1.0)))
    time, left, W = until_it_jams(mu, angle, slip)
    scene = rod_on_its_foot(mu, mass, size)
    frame, R = scene.rod.frame, leaning(angle)
    start: dict[Any, Any] = {
        frame.position: HALF * size * R[:, 2], frame.rotation: R, frame.angular_velocity: np.zeros(3),
        frame.velocity: np.array([*slip, 0.0]) * size,
    }  # fmt: skip
    run = ac.build(scene).simulate(1.5 * time, start, rtol=1e-12)
    jam = run.transitions[0]
    assert jam.time == pytest.approx(time, rel=1e-9)
    assert jam.before[scene.foot.slip][:2] == pytest.approx(left * size, abs=1e-6 * np.linalg.norm(slip) * size)
    # plastic, and the slip ends where that takes no more friction than there is
    push = np.linalg.solve(W, [*-left, 0.0])
    assert np.linalg.norm(push[:2]) < mu * push[2]
    assert jam.after[scene.foot.slip] == pytest.approx(np.zeros(3), abs=1e-12 * size)
    assert jam.energy_lost == pytest.approx(-mass * size**2 * left @ push[:2] / 2, rel=1e-4)
    assert run.energy_error() < 1e-9
    # what presses grows as one over the root of the time that is left, and derivatives do not go through that
    near, nearer = run.at(jam.time - np.array([1e-6, 1e-8]) * jam.time)[scene.foot.normal_force].ravel()
    assert nearer / near == pytest.approx(10, rel=0.05)
    if seed == 0:
        with pytest.raises(ac.errors.SimulationError):
            ac.build(scene).sensitivities([0.0, 1.5 * time], [frame.position[0]], start, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_jam_that_is_near_in_time_to_the_begin_of_slip_is_one_however_late_that_is(seed: int) -> None:
    """Time, of a second, is rounded to 1e-7 of how long it slips."""
    rng = np.random.default_rng(seed)
    size, mu, angle = [1.0, 1e-3, 1e3][seed], float(rng.uniform(1.4, 2.5)), float(rng.uniform(1.05, 1.2))
    slip = (float(rng.uniform(-2e-8, 1e-8)), float(rng.uniform(4e-8, 1e-7)))
    time, left, _ = until_it_jams(mu, angle, slip)
    scene = rod_on_its_foot(mu, 1.0, size)
    frame, R = scene.rod.frame, leaning(angle)
    start: dict[Any, Any] = {
        frame.position: HALF * size * R[:, 2], frame.rotation: R, frame.angular_velocity: np.zeros(3),
        frame.velocity: np.array([*slip, 0.0]) * size,
    }  # fmt: skip
    jam = ac.build(scene).simulate(1.0 + 3 * time, start, t0=1.0, rtol=1e-10).transitions[0]
    assert jam.time - 1 == pytest.approx(time, rel=1e-3)
    assert jam.energy_lost > 0
    assert jam.before[scene.foot.slip][:2] == pytest.approx(left * size, rel=0.2)
    assert jam.after[scene.foot.slip] == pytest.approx(np.zeros(3), abs=1e-9 * np.linalg.norm(slip) * size)
