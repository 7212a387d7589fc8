"""A joint: frame_b slides down a helix of frame_a and turns with it. One function says everything."""

import casadi as ca
import numpy as np

import acausal as ac
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, rotation_about_z
from components import RigidBody, World

LIMIT = 1e-9


class HelicalSlide(AbstractJoint):
    """frame_b sits on a helix of `radius` [m] about z of frame_a, rises by `lead` [m] each radian, and turns along."""

    q = ac.Variable("rad", "angle")
    v = ac.Variable("rad/s", "its rate")

    def __init__(self, radius: float, lead: float) -> None:
        self.radius, self.lead = radius, lead

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(rotation_about_z(q), ca.vertcat(self.radius * ca.cos(q), self.radius * ca.sin(q), self.lead * q))


def main() -> float:
    """A ball slides down; returns the largest difference from (I + m (radius^2 + lead^2)) q'' = -m g lead [rad]."""
    scene = ac.System()
    scene.world, scene.slide, scene.ball = World(), HelicalSlide(radius=0.1, lead=0.02), RigidBody.ball(2.0, 0.03)
    scene.connect(scene.world.frame, scene.slide.frame_a)
    scene.connect(scene.slide.frame_b, scene.ball.frame)
    run = ac.build(scene).simulate(2.0, rtol=1e-12)
    inertia = 0.4 * 2.0 * 0.03**2 + 2.0 * (0.1**2 + 0.02**2)
    return float(np.max(np.abs(run[scene.slide.q] + 0.5 * 2.0 * 9.81 * 0.02 / inertia * run.t**2)))


if __name__ == "__main__":
    print(main())
