"""A scissor lift: three crossed pairs of bars, seven loops, one freedom.

The height of the platform is three times the length of a bar times the sine of its angle, and the energy gives its speed.
"""

import numpy as np

import acausal as ac
from components import Prismatic, Revolute, RigidBody, World

LIMIT = 1e-8  # of what main returns

STAGES, LENGTH, ANGLE = 3, 1.0, 0.9


def main(folder: str = "out") -> float:
    """It sinks for 0.4 s; returns how far height and energy are off their closed forms, relative."""
    wide, high = LENGTH * np.cos(ANGLE), LENGTH * np.sin(ANGLE)
    scene = ac.System()
    scene.world = World()
    scene.rising = [RigidBody.rod(2.0, (wide, 0, high), position=(0, 0, k * high)) for k in range(STAGES)]
    scene.falling = [RigidBody.rod(2.0, (-wide, 0, high), position=(wide, 0, k * high)) for k in range(STAGES)]
    scene.platform = RigidBody.box(10.0, (1.2, 0.6, 0.04), position=(wide / 2, 0, STAGES * high))
    scene.shoes = [RigidBody.box(0.5, (0.08, 0.08, 0.08), position=(wide, 0, z)) for z in (0.0, STAGES * high)]

    scene.rails = [Prismatic.between(scene.world, scene.shoes[0], at=(wide, 0, 0), axis="x"),
                   Prismatic.between(scene.platform, scene.shoes[1], at=(wide, 0, STAGES * high), axis="x")]  # fmt: skip
    pins = [(scene.world, scene.rising[0], 0.0, 0.0), (scene.shoes[0], scene.falling[0], wide, 0.0)]
    for k in range(STAGES):
        pins.append((scene.rising[k], scene.falling[k], wide / 2, (k + 0.5) * high))
        above = (scene.falling[k + 1], scene.rising[k + 1]) if k + 1 < STAGES else (scene.shoes[1], scene.platform)
        pins += [(scene.rising[k], above[0], wide, (k + 1) * high), (scene.falling[k], above[1], 0.0, (k + 1) * high)]
    scene.pins = [Revolute.between(a, b, at=(x, 0, z), axis="y") for a, b, x, z in pins]

    model = ac.build(scene)
    print(model)
    run = model.simulate(0.4, rtol=1e-10)
    foot = run[scene.shoes[0].frame.position][:, 0]
    height = run[scene.platform.frame.position][:, 2]
    off = float(np.max(np.abs(height - STAGES * np.sqrt(LENGTH**2 - foot**2)))) / height[0]
    print(run)
    print(
        f"the platform sinks from {height[0]:.2f} m to {height[-1]:.2f} m; 3 sin of the angle to {off:.0e}, energy kept to {run.energy_error():.0e}"
    )
    run.picture(f"{folder}/scissor_lift.png", times=(0.0, 0.2, 0.4))
    run.animate(f"{folder}/scissor_lift.html")
    return max(off, run.energy_error())


if __name__ == "__main__":
    main()
