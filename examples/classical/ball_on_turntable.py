"""A ball on a turntable: it does not fly off, but runs around a circle, two sevenths as fast as the table turns.

Earnshaw (1844). The table turns steadily; the ball is solid and rolls without slipping.
"""

import numpy as np

import acausal as ac
from components import PrescribedMotion, RigidBody, RollingBall, World

LIMIT = 1e-8  # of what main returns

W, RADIUS = 3.0, 0.05


def main(folder: str = "out") -> float:
    """Around once; returns the largest difference from the circle [m]."""
    scene = ac.System()
    scene.world, scene.table = World(), PrescribedMotion(angle=W * ac.time)
    scene.contact, scene.ball = RollingBall(RADIUS), RigidBody.ball(0.2, RADIUS)
    scene.connect(scene.world.frame, scene.table.frame_a)
    scene.connect(scene.table.frame_b, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    model = ac.build(scene)
    print(model)
    place, velocity = scene.ball.frame.position, scene.ball.frame.velocity
    run = model.simulate(2 * np.pi / (2 / 7 * W), {place[:2]: (0.3, 0.0), velocity[:2]: (0.1, 0.2)}, rtol=1e-11)
    # c' = i 2/7 W (c - middle), in complex numbers
    c, v = run[place][:, 0] + 1j * run[place][:, 1], 0.1 + 0.2j
    middle = 0.3 - v / (2j / 7 * W)
    off = float(np.max(np.abs(c - middle - (0.3 - middle) * np.exp(2j / 7 * W * run.t))))
    print(run)
    print(f"on a circle of {abs(0.3 - middle):.3f} m about ({middle.real:.3f}, {middle.imag:.3f}), to {off:.0e} m")
    run.picture(f"{folder}/ball_on_turntable.png", times=(0.0, 2.0, 4.0))
    run.animate(f"{folder}/ball_on_turntable.html")
    return off


if __name__ == "__main__":
    main()
