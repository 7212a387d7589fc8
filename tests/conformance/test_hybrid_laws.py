"""What slides, spins and strikes on patches: the same in any units, and whatever values it was built at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import acausal as ac
from components import Contact, Coulomb, Hard, JointFriction, Patch, Planar, Plane, RigidBody, Sphere, World

HERTZ = ac.Pressure.HERTZ


@dataclass
class Made:
    """A scene in units of so many metres and seconds; its values are parameters where `built` says at which of them it is built."""

    length: float = 1.0
    time: float = 1.0
    built: dict[str, float] | None = None
    scene: ac.System = field(default_factory=ac.System)
    given: dict[ac.Parameter, float] = field(default_factory=dict)

    @property
    def speed(self) -> float:
        return self.length / self.time

    def value(self, name: str, value: float, unit: str = "1") -> Any:
        if self.built is None:
            return value
        parameter = ac.Parameter(self.built.get(name, value), unit)
        setattr(self.scene, f"value_{name}", parameter)
        self.given[parameter] = value
        return parameter

    def world(self, slope: float) -> World:
        g = 9.81 * self.length / self.time**2
        return World((g * np.sin(slope), 0, -g * np.cos(slope)))

    def run(self, end: float, start: dict[Any, Any], seen: dict[Any, float]) -> np.ndarray:
        """What is seen at the end, in units of its own."""
        run = ac.build(self.scene).simulate(end * self.time, start, parameters=self.given, rtol=1e-12)
        return np.concatenate([np.ravel(run[what][-1]) / unit for what, unit in seen.items()])


def puck(of: Made) -> np.ndarray:
    """A disk that slides and spins down a slope until it stands."""
    scene, mass = of.scene, of.value("mass", 0.57, "kg")
    scene.world, scene.table = of.world(0.1), Planar()
    scene.disk = RigidBody(mass, 0.0009 * of.length**2 * np.eye(3))
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.disk.frame)
    patch = Patch(of.value("radius", 0.06 * of.length, "m"))
    scene.rub = JointFriction(scene.table, Coulomb(of.value("mu", 0.2), patch=patch))
    q, v = scene.table.q, scene.table.v
    start = {q: (0, 0, 0), v: (of.speed, 0.2 * of.speed, 20 / of.time)}
    return of.run(1.5, start, {q[0]: of.length, q[1]: of.length, q[2]: 1.0, v[0]: of.speed, v[2]: 1 / of.time})


def ball(of: Made) -> np.ndarray:
    """A ball with a patch is thrown down, bounces, slips and spins."""
    scene, d = of.scene, of.length
    scene.world, scene.ball = of.world(0.2), RigidBody(of.value("mass", 0.57, "kg"), 0.4 * 0.57 * 0.01 * d * d * np.eye(3))
    law = Hard(of.value("back", 0.5), Coulomb(of.value("mu", 0.3), patch=Patch(of.value("radius", 0.01 * d, "m"), HERTZ)))
    scene.floor = Contact(Sphere(0.1 * d), Plane(), law)
    scene.connect(scene.world.frame, scene.floor.frame_a)
    scene.connect(scene.floor.frame_b, scene.ball.frame)
    frame = scene.ball.frame
    start = {
        frame.position: (0, 0, 0.25 * d), frame.velocity: (0.5 * of.speed, 0.2 * of.speed, -of.speed),
        frame.angular_velocity: (3 / of.time, -4 / of.time, 9 / of.time),
    }  # fmt: skip
    return of.run(0.3, start, {frame.position: d, frame.velocity: of.speed, frame.angular_velocity: 1 / of.time})


@pytest.mark.parametrize("make", [puck, ball])
def test_patches_have_the_same_bits_in_units_of_powers_of_four(make: Callable[[Made], np.ndarray]) -> None:
    here = make(Made())
    for units in ((4.0**-9, 1.0), (1.0, 4.0**5), (4.0**7, 4.0**-3)):
        assert np.array_equal(make(Made(*units)), here)


def test_a_patch_does_not_know_the_values_that_it_was_built_at() -> None:
    here = puck(Made())
    for built in ({"mu": 0.0, "back": 0.0, "mass": 90.0, "radius": 3.0}, {"mu": 1.5, "back": 1.0, "mass": 1e-4, "radius": 1e-5}):
        assert puck(Made(built=built)) == pytest.approx(here, abs=1e-12)
