"""A force: a law between two points, or any actions on the parts that its connectors touch."""

import casadi as ca
import numpy as np

import acausal as ac
from acausal.parts.force import AbstractForce, AbstractLineForce, Action
from acausal.parts.placement import Placement
from components import Particle, World

LIMIT = 1e-9


class Gravitation(AbstractLineForce):
    """Two points attract each other: tension = strength / length^2, `strength` [N*m^2]. Stores -strength / length."""

    def __init__(self, strength: float) -> None:
        self.strength = strength

    def tension(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        return self.strength / length**2

    def potential(self, length: ca.SX) -> ca.SX:
        return -self.strength / length


class SideWind(AbstractForce):
    """A force across the way that a point moves: `strength` [N*s/m] times its velocity, turned by a right angle about z of the world."""

    point = ac.Point.port(must_connect=True)

    def __init__(self, strength: float) -> None:
        self.strength = strength

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        v = placement.velocity(self.point)
        return (Action(self.point, self.strength * ca.vertcat(-v[1], v[0], 0), ca.SX.zeros(3)),)


def main() -> float:
    """Returns how far a circular orbit and a circle in the side wind are off after one turn [m]."""
    scene = ac.System()
    scene.world, scene.pull, scene.moon = World(gravity=None), Gravitation(4.0), Particle(mass=1.0)
    scene.wind, scene.leaf = SideWind(3.0), Particle(mass=1.0)
    scene.connect(scene.world.frame, scene.pull.point_a)
    scene.connect(scene.pull.point_b, scene.moon.point)
    scene.connect(scene.wind.point, scene.leaf.point)
    start = {
        scene.moon.point.position: (1.0, 0, 0),
        scene.moon.point.velocity: (0, 2.0, 0),
        scene.leaf.point.velocity: (0.5, 0, 0),
    }
    model = ac.build(scene)
    moon = model.simulate(np.pi, start, rtol=1e-12)[scene.moon.point.position][-1]  # v / r = 2 rad/s
    leaf = model.simulate(2 * np.pi / 3, start, rtol=1e-12)[scene.leaf.point.position][-1]  # strength / mass = 3 rad/s
    return float(max(np.linalg.norm(moon - (1, 0, 0)), np.linalg.norm(leaf)))


if __name__ == "__main__":
    print(main())
