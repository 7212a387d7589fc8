"""A particle thrown across a rough slope that just holds it: it turns downhill, and ends with half of its speed.

With tan(slope) = mu friction takes from the speed what gravity gives to its part downhill: v + v_down stays, so that v = v0 / (1 + cos(heading)) against the
line of fall. O'Reilly, 2.6.
"""

import numpy as np

import acausal as ac
from components import Coulomb, Particle, Plane, PointOnSurface, World

LIMIT = 1e-8  # of what main returns
SLOPE, SPEED = 0.4, 3.0


def main(folder: str = "out") -> float:
    """Six seconds; returns how far v + v_down is from what it was [m/s]."""
    scene = ac.System()
    scene.world, scene.puck = World(), Particle(0.2)
    scene.slope = PointOnSurface(Plane(), friction=Coulomb(np.tan(SLOPE)))
    scene.connect(scene.world.at((0, 0, 0), rotation=("y", SLOPE)), scene.slope.frame_a)  # x points down
    scene.connect(scene.slope.frame_b, scene.puck.point)
    model = ac.build(scene)
    print(model)
    run = model.simulate(6.0, {scene.slope.v: (0, SPEED)}, rtol=1e-12)
    print(run)
    v = run[scene.slope.v]
    whole = np.linalg.norm(v, axis=1)
    print(f"in the end {whole[-1]:.9f} m/s, straight down to {np.degrees(np.arctan2(v[-1, 1], v[-1, 0])):.1e} degrees")
    run.picture(f"{folder}/rough_slope.png", times=tuple(np.linspace(0, 6, 25)))
    run.animate(f"{folder}/rough_slope.html")
    return float(np.max(np.abs(whole + v[:, 0] - SPEED)))


if __name__ == "__main__":
    main()
