"""What analysis finds does not depend on units: dynamically similar scenes have the same equilibria, modes and forces without unit.

Powers of four change exponents of numbers only, and so no bit of a result; other factors change it by rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

import acausal as ac
from acausal.language.expression import Expression
from components import (
    NonlinearSpring,
    Particle,
    Prismatic,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    Spring,
    TorqueSource,
    World,
)

G = 9.81


@dataclass(frozen=True)
class Units:
    """What a length, a mass and a time of 1 are called."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def force(self) -> float:
        return self.mass * self.length / self.time**2

    @property
    def torque(self) -> float:
        return self.force * self.length


POWERS = [Units(4.0**-5), Units(4.0**6), Units(1.0, 4.0**-9), Units(1.0, 1.0, 4.0**7), Units(4.0**-6, 4.0**4, 4.0**-5)]
FACTORS = [Units(1e-9), Units(1e9), Units(1.0, 1e-9), Units(1.0, 1e9), Units(1.0, 1.0, 1e-6), Units(1.0, 1.0, 1e6), Units(1e-6, 1e-9, 1e3)]


def gravity(units: Units) -> tuple[float, float, float]:
    return (0.0, 0.0, -G * units.length / units.time**2)


class Arm(ac.System):
    """Two links with a spring and a damper at the elbow, a slide with a particle on a spring at the tip."""

    def __init__(self, units: Units) -> None:
        L, M, T = units.length, units.mass, units.time
        self.world = World(gravity(units))
        self.shoulder, self.elbow, self.slide = Revolute("y"), Revolute("y"), Prismatic("z")
        self.upper, self.lower = RigidBody.rod(2.0 * M, (0, 0, -0.5 * L)), RigidBody.rod(1.0 * M, (0.25 * L, 0, 0))
        self.spring, self.damper = RotationalSpring(8.0 * units.torque), RotationalDamper(0.125 * units.torque * T)
        self.load, self.string = Particle(0.5 * M), Spring(40.0 * M / T**2, 0.125 * L)
        self.torque = ac.Input("N*m")
        self.motor = TorqueSource(self.torque)
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.upper.frame)
        self.connect(self.upper.tip, self.elbow.frame_a)
        self.connect(self.elbow.frame_b, self.lower.frame)
        self.connect(self.lower.tip, self.slide.frame_a)
        self.connect(self.slide.frame_b, self.load.point)
        self.connect(self.string.point_a, self.lower.tip)
        self.connect(self.string.point_b, self.load.point)
        self.still = RotationalGround()
        for part in (self.spring, self.damper):
            self.connect(part.flange_a, self.still.flange)
            self.connect(part.flange_b, self.elbow.flange)
        self.connect(self.motor.flange, self.shoulder.flange)

    def start(self, units: Units) -> dict[Expression, float]:
        return {self.shoulder.q: 0.3, self.elbow.q: -0.2, self.slide.q: -0.2 * units.length}


class FourBar(ac.System):
    """A closed loop with a torque at its crank."""

    def __init__(self, units: Units) -> None:
        L, M = units.length, units.mass
        self.world, self.torque = World(gravity(units)), ac.Input("N*m")
        self.crank, self.coupler = RigidBody.rod(1.0 * M, (0.375 * L, 0, 0)), RigidBody.rod(2.0 * M, (1.25 * L, 0, 0))
        self.rocker = RigidBody.rod(1.5 * M, (0.75 * L, 0, 0))
        self.shoulder, self.b, self.c, self.d = (Revolute("y") for _ in range(4))
        self.motor = TorqueSource(self.torque)
        for joint, one, two in (
            (self.shoulder, self.world.frame, self.crank.frame),
            (self.b, self.crank.tip, self.coupler.frame),
            (self.c, self.coupler.tip, self.rocker.tip),
            (self.d, self.world.at((L, 0, 0)), self.rocker.frame),
        ):
            self.connect(one, joint.frame_a)
            self.connect(joint.frame_b, two)
        self.connect(self.motor.flange, self.shoulder.flange)

    def start(self, units: Units) -> dict[Expression, float]:
        return {self.shoulder.q: 0.4}


def answers(make: Callable[[Units], Arm | FourBar], units: Units) -> dict[str, np.ndarray]:
    """Without unit: the place of rest, its modes there, the torque that leads the first hinge."""
    scene = make(units)
    model = ac.build(scene)
    found = model.equilibrium(scene.start(units))
    linear = found.linearize()
    times = units.time * np.array([0.0, 0.125, 0.25])
    turn = float(np.asarray(found[scene.shoulder.q]))
    course = turn + 0.25 * np.sin((2.0 / units.time) * ac.time) ** 2
    forces = model.inverse_dynamics(times, {scene.shoulder.q: course}, [scene.torque], found.start)
    return {
        "angle": np.array([turn]),
        "moved": np.array([b for name, _, b in found.moved if name.split(".")[0] not in ("slide",)]),
        "eigenvalues": linear.eigenvalues * units.time,
        "torque": forces.force(scene.torque) / units.torque,
    }


def words(make: Callable[[Units], Arm | FourBar], units: Units) -> tuple[str, ...]:
    """What is said of the scene without numbers."""
    scene = make(units)
    model = ac.build(scene)
    found = model.equilibrium(scene.start(units))
    return found.stability, str(found.lasting), str(found.dimension), str(model.constraints()), *found.linearize().states


@pytest.mark.parametrize("make", [Arm, FourBar])
@pytest.mark.parametrize("units", POWERS)
def test_powers_of_four_change_no_bit_of_an_answer(make: Callable[[Units], Arm | FourBar], units: Units):
    plain, other = answers(make, Units()), answers(make, units)
    for name, value in plain.items():
        np.testing.assert_array_equal(other[name], value, err_msg=name)
    assert words(make, units) == words(make, Units())


@pytest.mark.parametrize("make", [Arm, FourBar])
@pytest.mark.parametrize("units", FACTORS)
def test_other_units_change_an_answer_by_rounding(make: Callable[[Units], Arm | FourBar], units: Units):
    plain, other = answers(make, Units()), answers(make, units)
    for name, value in plain.items():
        np.testing.assert_allclose(other[name], value, rtol=1e-9, atol=1e-9 * np.max(np.abs(value)), err_msg=name)
    assert words(make, units) == words(make, Units())
