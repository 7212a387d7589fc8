"""A flyball governor: two balls on arms rise as the spindle turns faster.

At a steady speed the cosine of their angle is g / (W^2 l). The spindle turns freely here, so it speeds up as the balls go down.
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-9  # of what main returns

ARM, MASS, RADIUS, INERTIA, W, G = 0.3, 0.5, 0.03, 2e-2, 8.0, 9.81


def main(folder: str = "out") -> float:
    """Five seconds steady and five not; returns how far angle, momentum and energy are off."""
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
    angle = np.arccos(G / (W**2 * ARM))
    start = {scene.bearing.v: W, scene.pins[0].q: angle, scene.pins[1].q: angle}
    steady = model.simulate(5.0, start, rtol=1e-12)
    off = float(max(np.max(np.abs(steady[pin.q] - angle)) for pin in scene.pins))
    run = model.simulate(5.0, start | {scene.pins[0].q: angle - 0.3, scene.pins[1].q: angle - 0.3}, rtol=1e-11)
    momentum = INERTIA * run[scene.bearing.v]
    for ball in scene.balls:
        turn = run[ball.frame.angular_velocity][:, 2] * 0.4 * MASS * RADIUS**2
        momentum = momentum + turn + MASS * np.cross(run[ball.frame.position], run[ball.frame.velocity])[:, 2]
    change = float(np.ptp(momentum) / momentum[0])
    print(run)
    print(
        f"steady at {np.degrees(angle):.3f} degrees to {off:.0e} rad; else the spindle turns with {run[scene.bearing.v].min():.2f} to {run[scene.bearing.v].max():.2f} rad/s"
    )
    print(f"momentum about the spindle is kept to {change:.0e}, energy to {run.energy_error():.0e}")
    run.picture(f"{folder}/governor.png", times=(0.0, 0.15, 0.3))
    run.animate(f"{folder}/governor.html")
    return max(off, change, run.energy_error())


if __name__ == "__main__":
    main()
