"""A spherical pendulum: a bead in a smooth round bowl, which swings and goes around at once.

With the right speed it stays at its height, the conical pendulum; W^2 = g / (R cos a). A little aside, it bobs up and down sqrt(4 - 3 sin(a)^2) times a turn.
The coordinates of the sphere have no pole.
"""

import numpy as np

import acausal as ac
from components import Particle, PointOnSurface, Sphere, World

LIMIT = 1e-8  # of what main returns

R, ANGLE, G = 1.0, 0.8, 9.81


def main(folder: str = "out") -> float:
    """One turn on the cone, and a longer motion; returns how far the circle, and energy and momentum of the other motion are off."""
    scene = ac.System()
    scene.world, scene.bowl, scene.bead = World(gravity=(0, 0, -G)), PointOnSurface(Sphere(R, inside_out=True)), Particle(0.1)
    scene.connect(scene.world.frame, scene.bowl.frame_a)
    scene.connect(scene.bowl.frame_b, scene.bead.point)
    model = ac.build(scene)
    print(model)
    place, velocity = scene.bead.point.position, scene.bead.point.velocity
    rate = np.sqrt(G / (R * np.cos(ANGLE)))
    start = R * np.array([np.sin(ANGLE), 0, -np.cos(ANGLE)])
    cone = model.simulate(2 * np.pi / rate, {place: start, velocity[1]: rate * start[0]}, rtol=1e-11)
    circle = start[0] * np.stack([np.cos(rate * cone.t), np.sin(rate * cone.t)], axis=1)
    off = float(np.max(np.abs(cone[place] - np.column_stack([circle, np.full(cone.t.size, start[2])]))))
    run = model.simulate(10.0, {place: start, velocity[1]: 0.5}, rtol=1e-11)
    momentum = np.cross(run[place], run[velocity])[:, 2]
    change = float(np.ptp(momentum) / momentum[0])
    print(run)
    print(
        f"on the cone to {off:.0e} m; of a motion that nearly meets the bottom, momentum to {change:.0e}, energy to {run.energy_error():.0e}"
    )
    run.picture(f"{folder}/conical_pendulum.png", times=(0.0, 0.5, 1.0))
    run.animate(f"{folder}/conical_pendulum.html")
    return max(off, change, run.energy_error())


if __name__ == "__main__":
    main()
