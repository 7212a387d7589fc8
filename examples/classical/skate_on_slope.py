"""A skate on a slope does not slide down: spinning, it stays at its height on average, and drifts sideways along cycloids.

The knife edge forbids to move across the blade; the constraint is not integrable. Neimark and Fufaev, Dynamics of Nonholonomic Systems (1972).
"""

import numpy as np

import acausal as ac
from components import KnifeEdge, Planar, RigidBody, World

LIMIT = 1e-9  # of what main returns

SLOPE, SPIN = 0.3, 2.0


def main(folder: str = "out") -> float:
    """Ten seconds from rest with a spin; returns the largest difference from the cycloid [m]."""
    scene = ac.System()
    scene.world, scene.ice, scene.blade = World(), Planar(normal="z"), KnifeEdge()
    scene.skate = RigidBody.box(2.0, (0.3, 0.04, 0.06))
    slope = scene.world.at((0, 0, 0), rotation=("y", SLOPE))  # x points down
    scene.connect(slope, scene.ice.frame_a, scene.blade.frame_a)
    scene.connect(scene.ice.frame_b, scene.skate.frame, scene.blade.frame_b)
    model = ac.build(scene)
    print(model)
    run = model.simulate(10.0, {scene.ice.v[2]: SPIN}, rtol=1e-11)
    pull, angle = 9.81 * np.sin(SLOPE), SPIN * run.t
    x = pull / (2 * SPIN**2) * np.sin(angle) ** 2
    y = pull / (2 * SPIN**2) * (angle - np.sin(2 * angle) / 2)
    off = float(np.max(np.abs(run[scene.ice.q][:, :2] - np.stack([x, y], axis=1))))
    print(run)
    print(f"down by at most {x.max():.3f} m, along the slope {y[-1]:.2f} m; on the cycloid to {off:.0e} m")
    run.picture(f"{folder}/skate_on_slope.png", times=(0.0, 1.0, 2.0, 3.0))
    run.animate(f"{folder}/skate_on_slope.html")
    return off


if __name__ == "__main__":
    main()
