"""Estimates over many noisy repetitions: chi squared has its mean, and the truth lies within a standard error as often as it should."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import acausal as ac
from components import DCMotor, Fixed, Ground, Particle, Revolute, RigidBody, RollingDisk, VoltageSource, World


class Motor(ac.System):
    """Turns an arm, by a voltage that is known."""

    def __init__(self) -> None:
        self.voltage = ac.Input("V")
        self.constant, self.resistance = ac.Parameter(0.05, "N*m/A"), ac.Parameter(1.2, "Ohm")
        self.damping = ac.Parameter(1e-4, "N*m*s/rad")
        self.world, self.hinge, self.arm = World(gravity=(0, 0, -9.81)), Revolute("y"), RigidBody.rod(0.5, (0, 0, -0.4))
        self.motor = DCMotor(self.constant, self.resistance, inductance=5e-3, inertia=2e-5, ratio=20, damping=self.damping)
        self.battery, self.ground = VoltageSource(self.voltage), Ground()
        self.connect(self.world.frame, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.arm.frame)
        self.connect(self.motor.flange, self.hinge.flange)
        self.connect(self.battery.pin_a, self.motor.pin_a)
        self.connect(self.battery.pin_b, self.motor.pin_b, self.ground.pin)


class Bicycle(ac.System):
    """Rolls on two wheels, and steers by itself; the mass of its rider and how high that sits are not known."""

    def __init__(self) -> None:
        self.mass, self.height = ac.Parameter(75.0, "kg"), ac.Parameter(1.0, "m")
        self.road = World()
        self.rear_wheel = RigidBody(2.0, (0.0603, 0.12, 0.0603), position=(0, 0, 0.3))
        self.rear_frame = RigidBody(10.0, (1.2, 1.4, 0.8), position=(0.3, 0, 0.6))
        self.seat, self.rider = Fixed((0.0, 0, self.height - 0.6)), Particle(self.mass)
        self.fork = RigidBody(4.0, (0.05892, 0.06, 0.00708, 0, 0.00756, 0), position=(0.9, 0, 0.7))
        self.front_wheel = RigidBody(3.0, (0.1405, 0.28, 0.1405), position=(1.02, 0, 0.35))
        self.rear_hub = Revolute.between(self.rear_frame, self.rear_wheel, at=(0, 0, 0.3), axis="y")
        down = (np.sin(np.pi / 10), 0, -np.cos(np.pi / 10))
        self.steering = Revolute.between(self.rear_frame, self.fork, at=(1.1, 0, 0), axis=down)
        self.front_hub = Revolute.between(self.fork, self.front_wheel, at=(1.02, 0, 0.35), axis="y")
        self.rear_contact, self.front_contact = RollingDisk(0.3), RollingDisk(0.35)
        self.connect(self.rear_frame.frame, self.seat.frame_a)
        self.connect(self.seat.frame_b, self.rider.point)
        for contact, wheel in ((self.rear_contact, self.rear_wheel), (self.front_contact, self.front_wheel)):
            self.connect(self.road.frame, contact.frame_a)
            self.connect(contact.frame_b, wheel.frame)


def repeated(
    model: ac.Model, truth: Mapping[Any, float], start: Any, inputs: Any, seen: Mapping[Any, float], end: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Of `count` repetitions: chi squared over its freedom, and how far off the values are in standard errors (count, unknowns)."""
    rng, t = np.random.default_rng(3), np.linspace(end / 20, end, 20)
    run = model.simulate(end, start, inputs=inputs, parameters=truth, rtol=1e-9).at(t)
    chi2, off = list[float](), list[list[float]]()
    for _ in range(count):
        data: Any = {key: (t, run[key] + noise * rng.normal(size=t.size), noise) for key, noise in seen.items()}
        found = ac.estimate(model, data, list(truth), start, inputs=inputs, parameters=truth, rtol=1e-6)
        chi2.append(found.chi2 / found.freedom)
        off.append([(found[key] - value) / found.standard_error(key) for key, value in truth.items()])
    return np.array(chi2), np.array(off)


@pytest.mark.slow
def test_standard_errors_of_a_motor_cover_the_truth() -> None:
    scene = Motor()
    truth = {scene.constant: 0.055, scene.resistance: 1.1, scene.damping: 2e-4}
    chi2, off = repeated(
        ac.build(scene),
        truth,
        {scene.hinge.q: 0.0},
        {scene.voltage: 6.0},
        {scene.hinge.q: 0.01, scene.motor.coil.i: 0.05},
        1.0,
        25,
    )
    covered(chi2, off, 37)


@pytest.mark.slow
def test_standard_errors_of_a_bicycle_cover_the_truth() -> None:
    scene = Bicycle()
    truth = {scene.mass: 80.0, scene.height: 1.1}
    start = {
        scene.rear_contact.q: (0, 0, 0, 0, 0),
        scene.rear_contact.v: (0.3, 5.0 / 0.3, 0),
        scene.steering.q: 0.0,
        scene.steering.v: 0.0,
    }
    chi2, off = repeated(ac.build(scene), truth, start, None, {scene.steering.q: 0.002, scene.steering.v: 0.01}, 1.0, 10)
    covered(chi2, off, 38)


def covered(chi2: np.ndarray, off: np.ndarray, freedom: int) -> None:
    """To four standard deviations of what so many repetitions tell."""
    n = len(chi2)
    assert np.mean(chi2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / freedom / n))
    assert np.allclose(np.mean(off**2, axis=0), 1.0, atol=4 * np.sqrt(2 / n))
    assert np.allclose(np.mean(np.abs(off) < 1, axis=0), 0.6827, atol=4 * np.sqrt(0.6827 * 0.3173 / n))
