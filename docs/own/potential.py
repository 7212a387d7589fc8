"""A potential: an energy of the pose of one frame in another. Forces and moments follow by virtual work."""

import casadi as ca
import numpy as np

import acausal as ac
from acausal.parts.pose import Pose, symbolic
from acausal.parts.potential import AbstractPotential
from components import Revolute, RigidBody, World

LIMIT = 1e-9


class Magnet(AbstractPotential):
    """A needle along z of frame_b in a uniform field along z of frame_a: energy = -`strength` z_a . z_b, `strength` [N*m]."""

    def __init__(self, strength: float, damping: float = 0.0) -> None:
        self.strength, self.loss = strength, damping

    def potential(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return -self.strength * symbolic(X_ab.rotation)[2, 2]

    def damping(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
        return -self.loss * w_ab_b, ca.SX(3, 1)  # torque and force on frame_b that the potential does not give


def main() -> float:
    """Small swings of a needle; returns the difference of its frequency from sqrt(strength / inertia), relative."""
    scene = ac.System()
    scene.world, scene.pivot, scene.magnet = World(gravity=None), Revolute("y"), Magnet(strength=0.5)
    scene.needle = RigidBody(mass=0.1, inertia=(2e-3, 2e-3, 1e-4))
    scene.connect(scene.world.frame, scene.pivot.frame_a, scene.magnet.frame_a)
    scene.connect(scene.pivot.frame_b, scene.needle.frame, scene.magnet.frame_b)
    found = ac.build(scene).linearize().modes()[0].frequency
    return float(abs(found / (np.sqrt(0.5 / 2e-3) / (2 * np.pi)) - 1))


if __name__ == "__main__":
    print(main())
