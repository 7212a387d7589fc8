"""A bead on a helical wire: it slides down like on a straight slope, and the wire pushes it inwards.

O'Reilly, Intermediate Dynamics for Engineers, 3.9.
"""

import numpy as np

import acausal as ac
from components import Helix, Particle, PointOnCurve, World

LIMIT = 1e-9  # of what main returns

RADIUS, LEAD, MASS, G = 0.2, 0.05, 0.1, 9.81


def main(folder: str = "out") -> float:
    """Two seconds; returns the largest difference of the angle [rad] and of the push of the wire [N] from their closed forms."""
    scene = ac.System()
    scene.world, scene.wire, scene.bead = World(gravity=(0, 0, -G)), PointOnCurve(Helix(RADIUS, LEAD)), Particle(MASS)
    scene.connect(scene.world.frame, scene.wire.frame_a)
    scene.connect(scene.wire.frame_b, scene.bead.point)
    model = ac.build(scene)
    print(model)
    run = model.simulate(2.0, rtol=1e-12)
    slope = G * LEAD / (RADIUS**2 + LEAD**2)  # of the angle [rad/s^2]
    off = float(np.max(np.abs(run[scene.wire.q] + slope * run.t**2 / 2)))
    place, push = run[scene.bead.point.position], run[scene.bead.point.force]
    inwards = -np.sum((push * place)[:, :2], axis=1) / RADIUS
    off = max(off, float(np.max(np.abs(inwards - MASS * RADIUS * (slope * run.t) ** 2))))
    print(run)
    print(
        f"down {-place[-1, 2]:.2f} m, {-run[scene.wire.q][-1] / (2 * np.pi):.2f} turns; off by {off:.0e}; energy kept to {run.energy_error():.0e}"
    )
    run.picture(f"{folder}/helix.png", times=(0.0, 0.6, 1.0))
    run.animate(f"{folder}/helix.html")
    return off


if __name__ == "__main__":
    main()
