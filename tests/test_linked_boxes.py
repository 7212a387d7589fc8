"""Boxes on feet, linked by ball joints, thrown down on rough ground: whatever holds, slides and lands obeys the laws of contact at all times, and the balances of energy and momentum of the whole."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal as ac
from components import Coulomb, PointOnPlane, RigidBody, Spherical, World
from tests.drawn import Drawn


@pytest.mark.parametrize("seed", [0, 1, 12, 16, 24])
def test_linked_boxes_obey_all_laws_of_contact(seed: int) -> None:
    drawn = Drawn(seed)
    rng, L, count, mu = drawn.rng, drawn.L, 2 + seed % 2, drawn.within(0.3, 0.6)
    scene = ac.System()
    scene.world = World((0, 0, -drawn.g))
    masses = drawn.M * rng.uniform(0.3, 3, count)
    scene.boxes = [RigidBody.box(mass, tuple(2 * L * rng.uniform(0.15, 0.5, 3))) for mass in masses]
    turns, spins = [Rotation.from_rotvec(0.2 * rng.normal(size=3)) for _ in masses], rng.uniform(-3, 3, (count, 3)) / drawn.T
    places, speeds = [np.zeros(3)], [rng.uniform(-2, 2, 3) * drawn.speed]
    scene.links = [Spherical() for _ in masses[1:]]
    for k, link in enumerate(scene.links):
        a, b = rng.uniform(-0.5, 0.5, (2, 3)) * L
        scene.connect(scene.boxes[k].at(tuple(a)), link.frame_a)
        scene.connect(link.frame_b, scene.boxes[k + 1].at(tuple(b)))
        a, b = turns[k].apply(a), turns[k + 1].apply(b)
        places.append(places[k] + a - b)
        speeds.append(speeds[k] + np.cross(spins[k], a) - np.cross(spins[k + 1], b))
    corners = [
        (k, np.array(corner) * L) for k in range(count) for corner in itertools.product((-0.3, 0.3), (-0.25, 0.25), (-0.3,))
    ]
    low = min((places[k] + turns[k].apply(corner))[2] for k, corner in corners)
    scene.feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in corners]
    start = {}
    for (k, corner), foot in zip(corners, scene.feet, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.boxes[k].at(tuple(corner)))
    for k, box in enumerate(scene.boxes):
        frame = box.frame
        start |= {
            frame.position: places[k] - (0, 0, low),
            frame.rotation: turns[k].as_matrix(),
            frame.velocity: speeds[k],
            frame.angular_velocity: spins[k],
        }
    run = ac.build(scene).simulate(drawn.T, start, rtol=1e-9, max_steps=4000)
    assert run.energy_error() < 1e-7
    inside = run.at(0.5 * (run.steps.t[1:] + run.steps.t[:-1])[np.diff(run.steps.t) > 1e-3 * drawn.T])
    assert inside.t.size > 10
    total, bears = np.zeros((inside.t.size, 3)), drawn.g * masses.sum()
    for (k, corner), foot in zip(corners, scene.feet, strict=True):
        frame = scene.boxes[k].frame
        R, w = inside[frame.rotation], inside[frame.angular_velocity]
        at = inside[frame.position] + R @ corner
        slip = inside[frame.velocity] + np.cross(w, R @ corner)
        push, drag = inside[foot.normal_force], inside[foot.friction_force]
        assert at[:, 2].min() > -1e-11 * L and push.min() >= -1e-9 * bears
        assert np.all((push == 0) | (np.abs(at[:, 2]) < 1e-9 * L))
        size, speed = np.linalg.norm(drag, axis=1), np.linalg.norm(slip, axis=1)
        assert np.all(size <= mu * push + 1e-8 * (push.max() + bears))
        slides = (push > 1e-6 * bears) & (speed > 1e-6 * drawn.speed)
        against = drag[slides] + mu * (push[slides] / speed[slides])[:, None] * slip[slides]
        assert np.abs(against).max(initial=0) < 1e-6 * (push.max() + bears)
        total += np.stack([drag[:, 0], drag[:, 1], push], axis=1)
    h = 1e-5 * drawn.T
    near = [
        sum(m * run.at(inside.t + k * h)[box.frame.position] for m, box in zip(masses, scene.boxes, strict=True))
        for k in (-1, 0, 1)
    ]
    pulled = (near[0] - 2 * near[1] + near[2]) / h**2 + (0, 0, bears)
    assert pulled == pytest.approx(total, abs=2e-4 * np.abs(total).max())
