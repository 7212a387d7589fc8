"""Linkages that move only because their dimensions fit: exact ones do, others are refused in words, however little they are off.

The laws hold for any size, attitude and order of declaration. Joints are looked at by the poses of bodies, not by the rows of the model.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import acausal as ac
from acausal.errors import LockedError
from acausal.simulate.trajectory import Trajectory
from components import Revolute, RigidBody, Rod, World
from tests.pairings import each_value

Loop = tuple[np.ndarray, np.ndarray]
"""Points (n, 3) and axes (n, 3) of hinges, closed by the ground."""


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    k = axis / np.linalg.norm(axis)
    K = np.cross(np.eye(3), -k)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def bennett(rng: np.random.Generator) -> Loop:
    """Denavit and Hartenberg's frames of twists a and b, lengths as their sines, tan(q / 2) tan(p / 2) = sin((b + a) / 2) / sin((b - a) / 2)."""
    a, b, q = rng.uniform(0.4, 0.8), rng.uniform(1.1, 1.5), rng.uniform(0.8, 2.0)
    p = 2 * np.arctan(np.sin((b + a) / 2) / np.sin((b - a) / 2) / np.tan(q / 2))
    R, at, points, axes = np.eye(3), np.zeros(3), list[np.ndarray](), list[np.ndarray]()
    for twist, angle in ((a, q), (b, p), (a, -q), (b, -p)):
        points.append(at)
        axes.append(R[:, 2])
        R = R @ turned(np.array([0, 0, 1.0]), angle)
        at = at + np.sin(twist) * R[:, 0]
        R = R @ turned(np.array([1.0, 0, 0]), twist)
    return np.array(points), np.array(axes)


def line_symmetric(rng: np.random.Generator) -> Loop:
    """Bricard's: three hinges anywhere, and these turned by half a turn about a line."""
    P, Z, line = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)
    half = turned(line, np.pi)
    return np.vstack([P, P @ half.T]), np.vstack([Z, Z @ half.T])


def plane_symmetric(rng: np.random.Generator) -> Loop:
    """Bricard's: two hinges in a plane, two anywhere, and the mirror images of these."""
    P, Z, mirror = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), np.array([1, 1, -1])
    P[[0, 3], 2] = Z[[0, 3], 2] = 0
    return np.vstack([P, P[[2, 1]] * mirror]), np.vstack([Z, Z[[2, 1]] * mirror])


def sarrus(rng: np.random.Generator) -> Loop:
    """Three hinges along each of two directions of a level plane."""
    n = np.array([[0, 1.0, 0], [1.0, rng.uniform(-0.5, 0.5), 0]])
    one, two = np.cross(n, [0, 0, 1.0]) * rng.uniform(0.6, 1.0, (2, 1))
    up = np.array([0, 0, 1.2])
    away = 0.3 * n[0] + 0.2 * two
    return np.array([0 * up, one + 0.4 * up, up, away + up, away + two + 0.6 * up, away]), np.repeat(n, 3, axis=0)


def spherical(rng: np.random.Generator) -> Loop:
    """Four hinges whose axes meet in a point."""
    Z = np.array([[1, 0, 0], [0.8, 0.6, 0.1], [0.1, 0.9, 0.5], [0.2, 0.1, 1]]) + rng.uniform(-0.05, 0.05, (4, 3))
    return Z * rng.uniform(0.5, 1.2, (4, 1)), Z


def universal_joints(rng: np.random.Generator) -> Loop:
    """Two in series between parallel shafts, forks in phase."""
    y, z = np.array([0, 1.0, 0]), np.array([0, 0, 1.0])
    shaft = turned(y, rng.uniform(0.3, 0.7)) @ z
    fork = np.cross(y, shaft)
    return np.array([-0.5 * shaft, 0 * z, 0 * z, z, z, z + 0.6 * shaft]), np.array([shaft, fork, y, y, fork, shaft])


FITTING = (bennett, line_symmetric, plane_symmetric, sarrus, spherical, universal_joints)


class Linkage(ac.System):
    """Bodies with their own axes between hinges, which are drawn where they are; declared in any order."""

    def __init__(self, points: np.ndarray, axes: np.ndarray, order: np.ndarray) -> None:
        self.size, n = float(np.max(np.ptp(points, axis=0))), len(points)
        self.world = World(tuple(self.size * np.array([2.0, -1.0, -9.5])))
        rng = np.random.default_rng(4)
        centres = [(points[k] + points[k + 1]) / 2 for k in range(n - 1)]
        turns = [turned(rng.normal(size=3), 2.0) for _ in centres]
        moments = tuple(self.size**2 * np.array([0.05, 0.07, 0.09]))
        self.bodies = [
            RigidBody(1 + 0.3 * k, moments, position=tuple(c), rotation=R)
            for k, (c, R) in enumerate(zip(centres, turns, strict=True))
        ]
        parts = [self.world, *self.bodies, self.world]
        self.hinges = [Revolute.between(parts[k], parts[k + 1], at=tuple(points[k]), axis=tuple(axes[k])) for k in order]
        places, attitudes = [np.zeros(3), *centres, np.zeros(3)], [np.eye(3), *turns, np.eye(3)]
        self.ends = [
            [
                (j, attitudes[j].T @ (points[k] - places[j]), attitudes[j].T @ axes[k] / np.linalg.norm(axes[k]))
                for j in (k, k + 1)
            ]
            for k in range(n)
        ]

    def gap(self, run: Trajectory) -> float:
        """Of any hinge, as part of the size, or the sine of an angle, by the poses of the bodies at its ends."""
        still = np.zeros((run.t.size, 3)), np.tile(np.eye(3), (run.t.size, 1, 1))
        moved = [(run[body.frame.position], run[body.frame.rotation].reshape(-1, 3, 3)) for body in self.bodies]
        poses = [still, *moved, still]
        gaps = list[float]()
        for ends in self.ends:
            (p, z), (p2, z2) = (((poses[j][0] + poses[j][1] @ at) / self.size, poses[j][1] @ along) for j, at, along in ends)
            gaps += [float(np.max(np.abs(p2 - p))), float(np.max(np.abs(np.cross(z, z2))))]
        return max(gaps)


def drawn(make: Callable[[np.random.Generator], Loop], seed: int, off: float = 0.0) -> Linkage:
    """Of any size, attitude and order; one hinge turned by `off` rad."""
    rng = np.random.default_rng([seed, 8])
    points, axes = make(rng)
    R, size = turned(rng.normal(size=3), 1.0), 10 ** rng.uniform(-6, 6)
    points, axes = size * points @ R.T, axes @ R.T
    k = int(rng.integers(len(points)))
    axes[k] = turned(np.cross(axes[k], rng.normal(size=3)), off) @ axes[k]
    return Linkage(points, axes, rng.permutation(len(points)))


@pytest.mark.parametrize("make", FITTING)
def test_dimensions_that_fit_let_a_linkage_move_as_one_freedom(make: Callable[[np.random.Generator], Loop]):
    scene = drawn(make, 0)
    model = ac.build(scene)
    run = model.simulate(1.5, {scene.hinges[0].v: 1.0}, rtol=1e-9, samples=11)
    assert model.degrees_of_freedom == 1 and model.system.constraints.redundant
    assert scene.gap(run) < 1e-13 and run.energy_error() < 1e-9


@each_value(("far", [1e4, 1e6, 1e8]), ("make", [bennett, plane_symmetric]))
def test_what_is_drawn_far_away_loses_the_digits_of_its_drawing_only(make: Callable[[np.random.Generator], Loop], far: float):
    """Places so far from the origin are rounded, and then nothing fits better: what rows that follow from others miss these by must not push the motion."""
    points, axes = make(np.random.default_rng([0, 8]))
    order = np.arange(len(points))
    near, away = Linkage(points, axes, order), Linkage(points + far * np.array([0.4, 0.9, -0.2]), axes, order)
    one, other = (ac.build(scene).simulate(1.5, {scene.hinges[0].v: 1.0}, rtol=1e-9, samples=11) for scene in (near, away))
    known = far * float(np.finfo(float).eps)
    assert other.energy_error() < 200 * known + 1e-11
    assert other.statistics.steps <= one.statistics.steps + 4
    for a, b in zip(near.hinges, away.hinges, strict=True):
        assert np.max(np.abs(one[a.q] - other[b.q])) < 2000 * known + 1e-9


@pytest.mark.parametrize("make", FITTING)
def test_dimensions_that_nearly_fit_are_told_however_near(make: Callable[[np.random.Generator], Loop]):
    """Drawn so that they close where they are drawn. A few hinges may be turned so that the rest still fits."""
    refused = 0
    for seed, off in enumerate((1e-9, 1e-7, 1e-4)):
        scene = drawn(make, seed, off)
        try:
            run = ac.build(scene).simulate(1.0, {scene.hinges[0].v: 1.0}, rtol=1e-9, samples=5)
            assert scene.gap(run) < 1e-13
        except LockedError as told:
            assert "hinges[" in str(told)
            refused += 1
    assert refused


def test_parameters_that_nearly_fit_are_told_by_name():
    """A linkage that was built with dimensions that fit; and what is off by rounding fits."""
    points, axes = bennett(np.random.default_rng(1))
    scene = ac.System()
    scene.world = World((0, 0, -9.81))
    scene.twist = ac.Parameter(float(axes[2, 0]))
    scene.links = [RigidBody.rod(1.0, tuple(points[k + 1] - points[k]), radius=0.05) for k in range(3)]
    ends = [scene.world.at(tuple(points[0])), *(link.tip for link in scene.links)]
    begins = [*(link.frame for link in scene.links), scene.world.at(tuple(points[3]))]
    scene.hinges = [
        Revolute(axis) for axis in (tuple(axes[0]), tuple(axes[1]), (scene.twist, *axes[2, 1:].tolist()), tuple(axes[3]))
    ]
    for end, hinge, begin in zip(ends, scene.hinges, begins, strict=True):
        scene.connect(end, hinge.frame_a)
        scene.connect(hinge.frame_b, begin)
    model, start = ac.build(scene), {scene.hinges[0].q: 0.0, scene.hinges[0].v: 1.0}
    for off in (1e-10, 1e-8, 1e-5, 1e-2):
        with pytest.raises(LockedError, match="With other values of twist"):
            model.simulate(0.1, start, parameters={scene.twist: scene.twist.value + off})
    assert model.simulate(0.1, start, parameters={scene.twist: scene.twist.value * (1 + 1e-15)}, samples=2).energy_error() < 1e-9


@pytest.mark.parametrize("apart", [1e-5, 1e-4, 1e-3, 1e-2])
def test_rods_that_are_nearly_one_hold_to_all_digits(apart: float):
    """A plate on three rods and a fourth one from the same point to one beside the other's end: rates by plain numbers have no digits there."""
    scene = ac.System()
    scene.world, centre = World(), np.array([0.2, 0, -1])
    scene.plate = RigidBody(1.0, (0.1, 0.2, 0.3), position=tuple(centre))
    ends = [(1, 0, 0), (-0.4, 0.8, 0), (-0.5, -0.7, 0), (1, apart, 0)]
    fixed = [(1.1, 0.1, 0.2), (-0.5, 0.9, 0.1), (-0.4, -0.7, 0), (1.1, 0.1, 0.2)]
    lengths = [float(np.linalg.norm(centre + end - there)) for end, there in zip(ends, fixed, strict=True)]
    scene.rods = [Rod(length) for length in lengths]
    for rod, there, end in zip(scene.rods, fixed, ends, strict=True):
        scene.connect(scene.world.at(there), rod.frame_a)
        scene.connect(rod.frame_b, scene.plate.at(end))
    model = ac.build(scene)
    run = model.simulate(2.0, {scene.plate.frame.angular_velocity[2]: 1.0}, rtol=1e-9, samples=11)
    places, R = run[scene.plate.frame.position], run[scene.plate.frame.rotation].reshape(-1, 3, 3)
    for length, there, end in zip(lengths, fixed, ends, strict=True):
        assert np.max(np.abs(np.linalg.norm(places + R @ np.array(end) - there, axis=1) - length)) < 1e-14
    assert model.degrees_of_freedom == 2 and run.energy_error() < 1e-11 and run.statistics.steps < 50
