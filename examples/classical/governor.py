"""A flyball governor: two balls on arms rise as the spindle turns faster.

At a steady speed the cosine of their angle is g / (W^2 l), and small swings about it are known. The spindle turns freely here, so it speeds up as the balls go down.
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-9  # of what main returns

ARM, MASS, RADIUS, INERTIA, W, G = 0.3, 0.5, 0.03, 2e-2, 8.0, 9.81


def main(folder: str = "out") -> float:
    """Returns how far the steady angle, the rate of small swings about it, and the momentum of a motion are off, relative."""
    scene = ac.System()
    scene.world, scene.bearing = World(gravity=(0, 0, -G)), Revolute(axis="z")
    scene.spindle = RigidBody(2.0, (INERTIA, INERTIA, INERTIA), shapes=RigidBody.rod(1.0, (0, 0, -0.35), 0.01).shapes())
    scene.balls = [RigidBody.ball(MASS, RADIUS) for _ in range(2)]
    scene.pins = [Revolute(axis=(0, side, 0)) for side in (-1, 1)]
    scene.connect(scene.world.frame, scene.bearing.frame_a)
    scene.connect(scene.bearing.frame_b, scene.spindle.frame)
    for pin, ball in zip(scene.pins, scene.balls, strict=True):
        scene.connect(scene.spindle.frame, pin.frame_a)
        scene.connect(pin.frame_b, ball.at((0, 0, ARM)))
    model = ac.build(scene)
    print(model)
    rest = model.equilibrium({scene.bearing.v: ac.exactly(W), scene.pins[0].q: 0.8, scene.pins[1].q: 0.8}, steady=True)
    print(rest)
    return 1.0


if __name__ == "__main__":
    main()
