"""What analysis finds does not depend on units: dynamically similar scenes have the same equilibria, modes and forces without unit.

Powers of four change exponents of numbers only, and so no bit of a result; other factors change it by rounding.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import acausal as ac
from acausal.language.expression import Expression
from components import (
    Fixed,
    NonlinearSpring,
    Particle,
    Prismatic,
    Revolute,
    RigidBody,
    RollingBall,
    RollingDisk,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    Spring,
    TorqueSource,
    World,
)
from tests.pairings import each_value
from tests.scenes import FourBar as ExactFourBar

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


POWERS = [
    Units(4.0**-15, 4.0**15, 4.0**7),
    Units(4.0**15, 4.0**-15, 4.0**-9),
    Units(4.0**-5, 1.0, 4.0**15),
    Units(4.0**6, 4.0**-9, 1.0),
    Units(4.0**-6, 4.0**4, 4.0**-5),
    Units(1.0, 4.0**15, 4.0**-15),
]
FACTORS = [
    Units(1e-9, 1e-9, 1.0),
    Units(1e9, 1e-9, 1e6),
    Units(1e-3, 1e-3, 1e3),
    Units(1.0, 1e9, 1e-9),
    Units(1e-3, 1.0, 1e-6),
    Units(1e9, 1.0, 1e9),
]


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


@functools.cache
def asked(make: Callable[[Units], Arm | FourBar], units: Units) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Without unit: the place of rest, its modes there, the torque that leads the first hinge; and what is said of the scene without numbers."""
    scene = make(units)
    model = ac.build(scene)
    found = model.equilibrium(scene.start(units))
    linear = found.linearize()
    times = units.time * np.array([0.0, 0.03, 0.06])
    turn = float(np.asarray(found[scene.shoulder.q]))
    course = turn + 0.25 * np.sin((2.0 / units.time) * ac.time) ** 2
    forces = model.inverse_dynamics(times, {scene.shoulder.q: course}, [scene.torque], found.start)
    answers = {
        "angle": np.array([turn]),
        "moved": np.array([b for name, _, b in found.moved if name.split(".")[0] not in ("slide",)]),
        "eigenvalues": linear.eigenvalues * units.time,
        "parts": np.array([mode.parts for mode in linear.modes()]),
        "torque": forces.force(scene.torque) / units.torque,
    }
    words = found.stability, str(found.lasting), str(found.dimension), str(model.constraints()), *linear.states
    return answers, words


@pytest.mark.parametrize(("make", "units"), [*((Arm, units) for units in POWERS), *((FourBar, units) for units in POWERS)])
def test_powers_of_four_change_no_bit_of_an_answer(make: Callable[[Units], Arm | FourBar], units: Units):
    (plain, said), (other, words) = asked(make, Units()), asked(make, units)
    for name, value in plain.items():
        np.testing.assert_array_equal(other[name], value, err_msg=name)
    assert words == said


@pytest.mark.parametrize(("make", "units"), [*((Arm, units) for units in FACTORS), *((FourBar, units) for units in FACTORS)])
def test_other_units_change_an_answer_by_rounding(make: Callable[[Units], Arm | FourBar], units: Units):
    (plain, said), (other, words) = asked(make, Units()), asked(make, units)
    for name, value in plain.items():
        if name != "parts":  # of powers of two
            np.testing.assert_allclose(other[name], value, rtol=1e-9, atol=1e-9 * np.max(np.abs(value)), err_msg=name)
    assert words == said


@each_value(("stiffness", [1e-12, 1e-6, 1.0, 1e6, 1e12]), ("mass", [1e-9, 1.0, 1e9]))
def test_slow_and_fast_masses_rest_where_their_spring_is_relaxed(stiffness: float, mass: float):
    scene = ac.System()
    scene.world, scene.slide, scene.load, scene.spring = World(None), Prismatic("z"), Particle(mass), Spring(stiffness, 0.3)
    scene.connect(scene.world.frame, scene.slide.frame_a, scene.spring.point_a)
    scene.connect(scene.slide.frame_b, scene.load.point, scene.spring.point_b)
    found = ac.build(scene).equilibrium({scene.slide.q: 1.0})
    assert found[scene.slide.q] == pytest.approx(0.3, rel=1e-14)
    assert found.linearize().frequencies == pytest.approx([np.sqrt(stiffness / mass) / (2 * np.pi)], rel=1e-12)


def test_modes_of_a_slow_part_are_those_that_it_has_alone():
    def springs(*rates: float) -> ac.System:
        scene = ac.System()
        scene.world = World(None)
        scene.slides, scene.loads = [Prismatic("z") for _ in rates], [Particle(1.0) for _ in rates]
        scene.springs = [Spring(rate**2, 0.3) for rate in rates]
        for slide, load, spring in zip(scene.slides, scene.loads, scene.springs, strict=True):
            scene.connect(scene.world.frame, slide.frame_a, spring.point_a)
            scene.connect(slide.frame_b, load.point, spring.point_b)
        return scene

    def frequencies(*rates: float) -> np.ndarray:
        scene = springs(*rates)
        return ac.build(scene).equilibrium(dict.fromkeys([slide.q for slide in scene.slides], 0.4)).linearize().frequencies

    together = np.concatenate([frequencies(rate) for rate in (1e-7, 1.0, 1e7)])
    np.testing.assert_allclose(frequencies(1e7, 1e-7, 1.0), together, rtol=1e-12)  # slowest first, whatever was declared first


def orbit(potential: Callable[[Any], Any]) -> ac.System:
    scene = ac.System()
    scene.world, scene.planet, scene.pull = World(None), Particle(1.0), NonlinearSpring(potential)
    scene.connect(scene.world.frame, scene.pull.point_a)
    scene.connect(scene.pull.point_b, scene.planet.point)
    return scene


@each_value(
    ("scale", [1e-6, 1.0, 1e6]),
    (("power", "stability"), [(-1, "undecided"), (1, "undecided"), (2, "neutral"), (-3, "unstable"), (-4, "unstable")]),
)
def test_a_circular_orbit_is_unstable_only_where_its_radius_runs_away(power: int, stability: str, scale: float):
    """Under r^p / p (p > -2: stable in first order; p = 2: the linear system stays the same all around)."""
    scene = orbit(lambda r: (r / scale) ** power / power * scale**2)
    place, velocity = scene.planet.point.position, scene.planet.point.velocity
    start = {place: scale * np.array([0.6, 0.8, 0.0]), velocity: scale * np.array([-0.8, 0.6, 0.0])}
    found = ac.build(scene).equilibrium(start, steady=[np.sqrt(place.T @ place)])
    assert found.lasting and found.stability == stability and f"stability: {stability}" in str(found)
    # the distance swings about the circle's, or runs away
    assert found.steady_stability == ("unstable" if power < -2 else "neutral")
    assert ("neutral in what is steady" in str(found)) == (stability == "undecided")


def test_the_same_orbit_in_polar_coordinates_is_neutral():
    scene = ac.System()
    scene.world, scene.turn, scene.slide = World(None), Revolute("z"), Prismatic("x")
    scene.planet, scene.pull = Particle(1.0), NonlinearSpring(lambda r: -1 / r)
    scene.connect(scene.world.frame, scene.turn.frame_a, scene.pull.point_a)
    scene.connect(scene.turn.frame_b, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.planet.point, scene.pull.point_b)
    start = {scene.slide.q: ac.exactly(1.0), scene.turn.v: 1.1}
    found = ac.build(scene).equilibrium(start, steady={scene.slide.q: 0.0, scene.turn.q: None})
    assert found[scene.turn.v] == pytest.approx(1.0, rel=1e-12) and found.lasting and found.stability == "neutral"


def test_parameters_far_from_their_values_at_build_give_the_equilibrium_of_a_build_with_them():
    def sag(stiffness: float, mass: float, built: tuple[float, float]) -> float:
        scene = ac.System()
        scene.k, scene.m = ac.Parameter(built[0], "N/m"), ac.Parameter(built[1], "kg")
        scene.world, scene.slide, scene.load, scene.spring = World(), Prismatic("z"), Particle(scene.m), Spring(scene.k, 0.3)
        scene.connect(scene.world.frame, scene.slide.frame_a, scene.spring.point_a)
        scene.connect(scene.slide.frame_b, scene.load.point, scene.spring.point_b)
        given = {scene.k: stiffness, scene.m: mass}
        return float(np.asarray(ac.build(scene).equilibrium({scene.slide.q: -1.0}, parameters=given)[scene.slide.q]))

    for stiffness, mass in ((1e-3, 1e-6), (1e6, 1e3), (1e9, 1.0)):
        here = sag(stiffness, mass, (stiffness, mass))
        assert here == pytest.approx(-0.3 - mass * G / stiffness, rel=1e-14)
        assert sag(stiffness, mass, (1.0, 1.0)) == pytest.approx(here, rel=1e-15)


def rolling(make: Callable[[float], tuple[Any, RigidBody]]) -> Callable[[Units], ac.System]:
    def scene(units: Units) -> ac.System:
        scene = ac.System()
        scene.world = World(gravity(units))
        scene.contact, scene.body = make(units.length)
        scene.connect(scene.world.frame, scene.contact.frame_a)
        scene.connect(scene.contact.frame_b, scene.body.frame)
        return scene

    return scene


def geared_slide(units: Units) -> ac.System:
    """A disk on a sledge that rolls along a line."""
    L = units.length
    scene = ac.System()
    scene.world, scene.stand = World(gravity(units)), Fixed((0, 0, 0.3 * L))
    scene.slide, scene.hinge, scene.contact = Prismatic("x"), Revolute("y"), RollingDisk(0.3 * L, "y")
    scene.disk = RigidBody.disk(units.mass, 0.3 * L, "y")
    scene.connect(scene.world.frame, scene.stand.frame_a, scene.contact.frame_a)
    scene.connect(scene.stand.frame_b, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.disk.frame, scene.contact.frame_b)
    return scene


ROLLING = [
    rolling(lambda L: (RollingDisk(0.3 * L, "y"), RigidBody.disk(1.0, 0.3 * L, "y"))),
    rolling(lambda L: (RollingBall(0.1 * L), RigidBody.ball(1.0, 0.1 * L))),
    geared_slide,
]


@functools.cache
def forbidden(make: Callable[[Units], ac.System], length: float) -> Any:
    """The table of constraints of a scene in a unit of length."""
    return ac.build(make(Units(length))).constraints()


@each_value(("make", ROLLING), ("length", [1e-9, 4.0**5, 1e9]))
def test_what_rolling_forbids_is_the_same_in_any_unit(make: Callable[[Units], ac.System], length: float):
    plain, other = forbidden(make, 1.0), forbidden(make, length)
    assert [(e.name, e.kind, e.kept) for e in other] == [(e.name, e.kind, e.kept) for e in plain]
    assert (other.configuration_freedom, other.velocity_freedom, other.hidden) == (
        plain.configuration_freedom,
        plain.velocity_freedom,
        plain.hidden,
    )
    for here, there in zip(plain.velocity.blocks, other.velocity.blocks, strict=True):
        assert here.growth == there.growth and here.alone == there.alone and len(here.integrals) == len(there.integrals)


@pytest.mark.parametrize("order", ["dcba", "bdac"])
def test_the_order_of_declaration_changes_no_frequency(order: str):
    """Another order cuts the loop elsewhere, and so has other states."""

    def asked(order: str) -> tuple[np.ndarray, float]:
        scene = ExactFourBar(order=order)
        found = ac.build(scene).equilibrium({scene.a.q: 0.5, scene.b.q: 0.2, scene.d.q: 1.2})
        return found.linearize().eigenvalues, float(np.asarray(found[scene.crank.tip.position])[2])

    (plain, height), (other, low) = asked("abcd"), asked(order)
    np.testing.assert_allclose(other, plain, rtol=1e-9)
    assert low == pytest.approx(height, abs=1e-12)
