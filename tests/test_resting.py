"""Bodies at rest on more than carries them: what they do is decided for all contacts together, whatever the forces that are not unique."""

from __future__ import annotations

import numpy as np
import pytest

import acausal as ac
from components import Coulomb, Force, PointOnPlane, RigidBody, World

G = 9.81
CORNERS = ((0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15))


def pushed(order: tuple[int, ...], mu: float, direction: tuple[float, float], size: float = 1.0) -> tuple[ac.System, dict]:
    """A box of 2 kg and height 0.4 on four feet, declared in an order, pushed 0.1 above its centre by 10 N/s; and its start."""
    scene = ac.System()
    scene.world, scene.box = World((0, 0, -G * size)), RigidBody.box(mass=2.0, size=(0.4 * size, 0.3 * size, 0.4 * size))
    feet = [PointOnPlane(unilateral=True, friction=Coulomb(mu)) for _ in CORNERS]
    scene.feet = [feet[k] for k in order]
    for foot, (x, y) in zip(feet, CORNERS, strict=True):
        scene.connect(scene.world.frame, foot.frame_a)
        scene.connect(foot.frame_b, scene.box.at((x * size, y * size, -0.2 * size)))
    scene.push = Force(lambda t: (10 * size * t * direction[0], 10 * size * t * direction[1], 0))
    scene.connect(scene.push.point, scene.box.at((0, 0, 0.1 * size)))
    frame = scene.box.frame
    start = {frame.position: (0, 0, 0.2 * size), frame.rotation: np.eye(3), frame.velocity: (0, 0, 0)}
    return scene, start | {frame.angular_velocity: (0, 0, 0)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "direction", "size"), [((0, 1, 2, 3), (1.0, 0.0), 1e-6), ((3, 1, 0, 2), (0.6, 0.8), 1.0)], ids=["edge", "askew"]
)
def test_a_pushed_box_tips_when_its_load_leaves_its_feet_and_no_foot_opens_before(
    order: tuple[int, ...], direction: tuple[float, float], size: float
) -> None:
    """F H = m g a about the first edge that is reached; single feet of least norm are at their limits long before."""
    scene, start = pushed(order, 0.9, direction, size)
    run = ac.build(scene).simulate(1.4, start, rtol=1e-12)
    tips = 2 * G / (10 * 0.3) * min(0.2 / direction[0], 0.15 / direction[1] if direction[1] else np.inf)
    assert [t.time for t in run.transitions if t.changes] == pytest.approx([tips], rel=1e-11)
    before = run.at([0.999 * tips])
    assert sum(before[foot.normal_force].item() for foot in scene.feet) == pytest.approx(2 * G * size, rel=1e-9)
    assert all(before[foot.normal_force].item() > 0 for foot in scene.feet)
    drag = sum(before[foot.friction_force][0] for foot in scene.feet)
    assert drag[:2] == pytest.approx(-9.99 * tips * size * np.array(direction), rel=1e-9)
    assert np.max(np.abs(before[scene.box.frame.position] - [[0, 0, 0.2 * size]])) < 1e-12 * size
