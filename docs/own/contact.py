"""A contact: a constraint that in nature could only push. Its row is the gap along z of frame_a; sliding rows make it roll."""

import casadi as ca
import numpy as np

import acausal as ac
from acausal.parts.contact import AbstractContact
from acausal.parts.pose import Pose, symbolic
from components import RigidBody, World

LIMIT = 1e-8


class BallRollsOnGround(AbstractContact):
    """A ball of `radius` [m] about the origin of frame_b touches the plane z = 0 of frame_a and rolls on it without slipping.

    `RollingBall` is the same as a joint with coordinates of its own and without multipliers; this one shows the rows.
    """

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return symbolic(X_ab.position)[2] - self.radius  # the gap [m], positive apart

    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        R = symbolic(X_ab.rotation)
        lowest = -self.radius * R[2, :].T  # the point that touches, from the centre, in frame_b
        return (R @ (v_ab_b + ca.cross(w_ab_b, lowest)))[:2]  # its velocity along the plane [m/s]

    def touch(self) -> tuple[ac.Expression, ac.Expression]:
        normal = self.frame_a.rotation[:, 2]  # what is read of it, in the world: the point that touches, and the normal
        return self.frame_b.position - self.radius * normal, normal


def main() -> float:
    """Down an incline of 0.2 rad; returns the largest difference from x = 5/7 g sin(0.2) t^2 / 2 [m]."""
    scene = ac.System()
    scene.world, scene.contact, scene.ball = (
        World(),
        BallRollsOnGround(radius=0.1),
        RigidBody.ball(1.0, 0.1, position=(0, 0, 0.1)),
    )
    incline = scene.world.at((0, 0, 0), rotation=("y", 0.2))
    scene.connect(incline, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    run = ac.build(scene).simulate(2.0, rtol=1e-10)
    way = np.linalg.norm(run[scene.ball.frame.position] - run[scene.ball.frame.position][0], axis=1)
    return float(np.max(np.abs(way - 5 / 14 * 9.81 * np.sin(0.2) * run.t**2)))


if __name__ == "__main__":
    print(main())
