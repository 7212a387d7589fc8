"""A ball in an upright pipe: it rolls around inside, goes down, and comes up again.

That is why a golf ball sometimes leaves the hole. The height swings harmonically, sqrt(2 / 7) times as often as the ball goes around.
Gualtieri, Tokieda, Advis-Gaete, Carry, Reffet and Guthmann, American Journal of Physics 74 (2006).
"""

import numpy as np

import acausal as ac
from components import Cylinder, RigidBody, RollingBallOnSurface, World

LIMIT = 1e-8  # of what main returns

PIPE, BALL, W = 0.3, 0.05, 5.0


def main(folder: str = "out") -> float:
    """Five seconds; returns the largest difference of the height from its cosine [m]."""
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(0.2, BALL)
    scene.contact = RollingBallOnSurface(BALL, Cylinder(PIPE, inside_out=True))
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    model = ac.build(scene)
    print(model)
    place, turn = scene.ball.frame.position, scene.ball.frame.angular_velocity
    spin = -W * (PIPE - BALL) / BALL  # about z, so that the point that touches is at rest
    run = model.simulate(5.0, {place[:2]: (PIPE - BALL, 0.0), turn: (0.0, 0.0, spin)}, rtol=1e-11)
    slow = np.sqrt(2 / 7) * W
    exact = -9.81 * 5 / 7 / slow**2 * (1 - np.cos(slow * run.t))
    off = float(np.max(np.abs(run[place][:, 2] - run[place][0, 2] - exact)))
    print(run)
    print(f"falls {np.ptp(exact):.3f} m and comes back; the height is its cosine to {off:.0e} m")
    run.picture(f"{folder}/ball_in_cylinder.png", times=(0.0, 0.6, 1.2))
    run.animate(f"{folder}/ball_in_cylinder.html")
    return off


if __name__ == "__main__":
    main()
