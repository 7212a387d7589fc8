"""A field: the potential energy of one kilogram, anywhere. It acts on all bodies of a scene by itself."""

import casadi as ca
import numpy as np

import acausal as ac
from acausal.parts.field import AbstractField
from components import Particle, World

LIMIT = 1e-9


class HarmonicTrap(AbstractField):
    """Pulls everything to the origin of `frame`: potential = w . p^2 / 2, with three squared frequencies `w` [1/s^2] along its axes."""

    def __init__(self, w: tuple[float, float, float]) -> None:
        self.w = w

    def potential(self, p: ca.SX, t: ca.SX) -> ca.SX:
        return 0.5 * ca.dot(ca.SX(self.w), p**2)


def main() -> float:
    """Returns the largest difference from cosines of the three frequencies [m]."""
    scene = ac.System()
    scene.world, scene.trap, scene.bead = World(gravity=None), HarmonicTrap((1.0, 4.0, 9.0)), Particle(mass=3.0)
    run = ac.build(scene).simulate(5.0, {scene.bead.point.position: (0.1, 0.2, 0.3)}, rtol=1e-12)
    exact = np.array([0.1, 0.2, 0.3]) * np.cos(run.t[:, None] * [1.0, 2.0, 3.0])
    return float(np.max(np.abs(run[scene.bead.point.position] - exact)))


if __name__ == "__main__":
    print(main())
