"""What falls, bounces, rocks and slides never goes through what it falls on, however loosely it is followed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal as ac
from components import Coulomb, Planar, PointOnPlane, RigidBody, World


def _feet(scene: ac.System, places: np.ndarray) -> None:
    scene.mass, scene.mu, scene.e = ac.Parameter(1.0, "kg"), ac.Parameter(0.2, ""), ac.Parameter(0.3, "")
    scene.world = World(gravity=(0, 0, -9.81 * float(places[0, 0]) / 0.3))  # the same motion at any size
    scene.inertia = ac.Parameter(0.1 * (float(places[0, 0]) / 0.3) ** 2, "kg*m^2")
    scene.box = RigidBody(scene.mass, inertia=(scene.inertia,) * 3)
    scene.feet = [PointOnPlane(unilateral=True, restitution=scene.e, friction=Coulomb(scene.mu)) for _ in places]
    for foot, place in zip(scene.feet, places, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at(tuple(place)))


def _drawn(rng: np.random.Generator, scene: ac.System) -> dict[ac.Expression, float]:
    inertia = rng.uniform(0.03, 0.3) * 10 * float(scene.inertia.value)
    e = rng.choice([0.0, rng.uniform(0.05, 0.8)])
    return {scene.mass: rng.uniform(0.5, 3), scene.mu: rng.choice([0.0, 0.1, 0.3, 0.6]), scene.e: e, scene.inertia: inertia}


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_two_feet_in_a_plane(size: float) -> None:
    """Each bounces while the other one does: gaps close soon after others have opened, in steps that were planned to be long."""
    rng, scene = np.random.default_rng(5), ac.System()
    _feet(scene, size * np.array([(0.3, 0, -0.2), (-0.3, 0, -0.2)]))
    scene.plane = Planar("y")
    scene.connect(scene.world.frame, scene.plane.frame_a)
    scene.connect(scene.plane.frame_b, scene.box.frame)
    model = ac.build(scene)
    for rtol in 10.0 ** -np.arange(2, 12):
        start = {scene.plane.q: (0.5 * size, 0, rng.uniform(-0.3, 0.3)), scene.plane.v: (0, size * rng.uniform(-1, 1), 0)}
        for values in (_drawn(rng, scene), _drawn(rng, scene)):
            run = model.simulate(1.5, start, parameters=values, rtol=rtol, samples=2)
            z, _, turned = run.solution.x[:3]
            gaps = [z - 0.2 * size * np.cos(turned) - side * 0.3 * size * np.sin(turned) for side in (1, -1)]
            assert np.min(gaps) > -1e-13 * size, (rtol, values)


@pytest.mark.slow
def test_four_feet_in_space() -> None:
    """The box rocks on its edges and corners, and comes to rest on all of them, or nearly."""
    rng, scene = np.random.default_rng(9), ac.System()
    places = np.array([(0.3, 0.2, -0.2), (0.3, -0.2, -0.2), (-0.3, 0.2, -0.2), (-0.3, -0.2, -0.2)])
    _feet(scene, places)
    model, frame = ac.build(scene), scene.box.frame
    for rtol in 10.0 ** -np.arange(3, 9, 2):
        start = {
            frame.position: (0, 0, 0.5),
            frame.velocity: tuple(rng.uniform(-1, 1, 3)),
            frame.angular_velocity: tuple(rng.uniform(-1, 1, 3)),
        }
        run = model.simulate(1.0, start, parameters=_drawn(rng, scene), rtol=rtol, samples=2)
        x = run.solution.x
        turned = Rotation.from_quat(x[:4].T, scalar_first=True)
        for place in places:
            assert np.min(x[6] + turned.apply(place)[:, 2]) > -1e-13, rtol
