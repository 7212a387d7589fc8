"""A constraint: residuals in the pose of one frame in the other. It brings no coordinates, only rows that vanish."""

import casadi as ca
import numpy as np

import acausal as ac
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic
from components import Particle, World

LIMIT = 1e-8


class OnParabola(AbstractConstraint):
    """The origin of frame_b stays on z = x^2 / (4 `focus`), y = 0 of frame_a; `focus` [m] > 0. Frictionless, holds on both sides."""

    between_points = True  # orientations do not matter, so particles may be connected

    def __init__(self, focus: float) -> None:
        self.focus = focus

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        x, y, z = ca.vertsplit(symbolic(X_ab.position))
        return ca.vertcat(y, z - x**2 / (4 * self.focus))  # lengths; smooth, with independent slopes


def main() -> float:
    """A bead on a parabola; returns how far its energy and its place are off, from z = x^2 and v^2 = 2 g (z_0 - z)."""
    scene = ac.System()
    scene.world, scene.wire, scene.bead = World(), OnParabola(focus=0.25), Particle(mass=0.2)
    scene.connect(scene.world.frame, scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    run = ac.build(scene).simulate(2.0, {scene.bead.point.position[0]: 0.5}, rtol=1e-11)
    place, velocity = run[scene.bead.point.position], run[scene.bead.point.velocity]
    off_curve = np.abs(place[:, 2] - place[:, 0] ** 2)
    off_speed = np.abs(np.sum(velocity**2, axis=1) - 2 * 9.81 * (0.25 - place[:, 2]))
    return float(max(off_curve.max(), off_speed.max()))


if __name__ == "__main__":
    print(main())
