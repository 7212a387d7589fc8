"""Dry friction by what joints and guides truly bear, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import acausal as ac
from components import (
    Circle,
    Coulomb,
    JointFriction,
    Line,
    Particle,
    PointOnCurve,
    Revolute,
    RigidBody,
    RoughGuide,
    World,
)

G = 9.81


def zero(f: Callable[[float], Any], low: float, high: float) -> float:
    return float(brentq(f, low, high, xtol=1e-15))


def changes(run: ac.Trajectory) -> list[float]:
    """When something begins to slip, stops, or turns back."""
    return [transition.time for transition in run.transitions]


def bead(wire: RoughGuide, gravity: tuple[float, float, float], mass: float = 0.3) -> ac.System:
    scene = ac.System()
    scene.world, scene.wire, scene.bead = World(gravity=gravity), wire, Particle(mass)
    scene.connect(scene.world.frame, scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    return scene


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize("mu", [0.3, 0.8])
def test_bead_on_an_inclined_wire_stops_and_slides_back_or_stays(mu: float, size: float) -> None:
    slope = 0.6
    wire = PointOnCurve(Line((np.cos(slope), 0.0, np.sin(slope))), friction=Coulomb(mu))
    scene = bead(wire, (0.0, 0.0, -G * size), mass=2e-5)
    run = ac.build(scene).simulate(2.0, {scene.wire.q: 0.0, scene.wire.v: 4.0 * size}, rtol=1e-12)
    up, down = G * (np.sin(slope) + mu * np.cos(slope)), max(G * (np.sin(slope) - mu * np.cos(slope)), 0.0)
    stop = 4.0 / up
    assert changes(run) == pytest.approx([stop], rel=1e-11)
    assert run[scene.wire.q][-1] == pytest.approx(size * (8.0 / up - down / 2 * (2.0 - stop) ** 2), rel=1e-11)
    assert run.modes(scene.wire).words[-1] == ("slides -" if down else "sticks")
    assert run.energy_error() < 1e-11


def ring_speed(k: float, c: float, begin: float, w: float, angle: np.ndarray | float) -> Any:
    """Square of the angular velocity along a ring in gravity, from that at the angle `begin`: w' + k w = c (k sin - 2 cos), by the angle, where c = g / R,
    k = 2 mu times the signs of slip and normal force."""

    def special(at: np.ndarray | float) -> Any:
        return c / (1 + k**2) * ((k**2 - 2) * np.sin(at) - 3 * k * np.cos(at))

    return special(angle) + (w - special(begin)) * np.exp(-k * (angle - begin))


def passing(k: float, c: float, begin: float, w: float, end: float) -> float:
    """Time from one angle to another, at which it may come to rest."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    u = np.sqrt(abs(end - begin)) * (nodes + 1) / 2  # the square root of the way that is left
    left = np.sqrt(abs(end - begin)) * weights / 2
    return float(left @ (2 * u / np.sqrt(ring_speed(k, c, begin, w, end - np.sign(end - begin) * u**2))))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("mu", "start"), [(0.2, 8.0), (0.5, 13.0), (0.9, 40.0)])
def test_bead_in_a_rough_ring_leans_on_its_outside_and_then_its_inside(mu: float, start: float, turned: bool) -> None:
    radius, mass = 0.5, 0.3
    c = G / radius
    Q = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0] if turned else np.eye(3)
    Q = Q * np.linalg.det(Q)
    wire = PointOnCurve(Circle(radius), friction=Coulomb(mu))
    scene = ac.System()
    scene.world, scene.wire, scene.bead = World(gravity=tuple(Q @ (0.0, -G, 0.0))), wire, Particle(mass)
    scene.connect(scene.world.at((0.1, 0.2, 0.3), rotation=Q), scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    low = -np.pi / 2
    run = ac.build(scene).simulate(1.5, {wire.q: low, wire.v: np.sqrt(start * c)}, rtol=1e-12)
    # from the bottom it is pressed inwards, until R w = g sin, then outwards
    over = zero(lambda at: ring_speed(2 * mu, c, low, start * c, at) - c * np.sin(at), 0.0, np.pi / 2)
    rest = zero(lambda at: ring_speed(-2 * mu, c, over, c * np.sin(over), at), over, np.pi / 2 + 0.5)
    assert over < rest < np.pi / 2
    time = passing(2 * mu, c, low, start * c, over) + passing(-2 * mu, c, over, c * np.sin(over), rest)
    assert changes(run)[0] == pytest.approx(time, rel=1e-11)
    q, v = run[wire.q], run[wire.v]
    first, second = run.t <= time, q < over
    for some, k, begin, w in ((second & first, 2 * mu, low, start * c), (~second & first, -2 * mu, over, c * np.sin(over))):
        assert np.count_nonzero(some) > 2
        assert v[some] ** 2 == pytest.approx(ring_speed(k, c, begin, w, q[some]), abs=1e-10 * start * c)
    assert run.energy_error() < 1e-11


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_disk_on_a_plain_bearing_spins_down_by_its_weight(size: float) -> None:
    scene = ac.System()
    scene.world, scene.hinge = World(gravity=(0.0, 0.0, -G * size)), Revolute(axis="y")
    scene.disk = RigidBody(mass=2.0, inertia=(0.02 * size**2, 0.03 * size**2, 0.02 * size**2))
    scene.connect(scene.world.frame, scene.hinge.frame_a)
    scene.connect(scene.hinge.frame_b, scene.disk.frame)
    scene.bearing = JointFriction(scene.hinge, Coulomb(0.1, static=0.15), radius=0.02 * size)
    run = ac.build(scene).simulate(5.0, {scene.hinge.q: 0.0, scene.hinge.v: -5.0}, rtol=1e-12)
    stop = 5.0 * 0.03 / (0.1 * 0.02 * 2.0 * G)
    assert changes(run) == pytest.approx([stop], rel=1e-11)
    assert run[scene.hinge.q][-1] == pytest.approx(-2.5 * stop, rel=1e-11)
    assert run[scene.bearing.drag[0]][0] == pytest.approx(0.1 * 0.02 * 2.0 * G * size**2, rel=1e-12)
    assert run.energy_error() < 1e-11
