"""Chaplygin's sphere: a ball whose inside is not round rolls on a plane, and wobbles along a path that looks like none.

Its centre of mass is in the middle, its moments of inertia differ. What stays is the angular momentum about the point that touches, in all three directions.
S. A. Chaplygin (1903).
"""

import numpy as np

import acausal as ac
from components import RigidBody, RollingBall, World

LIMIT = 1e-9  # of what main returns

RADIUS, MASS = 0.1, 1.0
INERTIA = np.diag([2e-3, 3e-3, 4e-3])


def main(folder: str = "out") -> float:
    """Ten seconds; returns the change of momentum about the contact and of the energy, relative."""
    scene = ac.System()
    scene.world, scene.contact = World(), RollingBall(RADIUS)
    scene.ball = RigidBody(MASS, tuple(np.diag(INERTIA)), shapes=RigidBody.ball(1.0, RADIUS).shapes())
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.ball.frame)
    model = ac.build(scene)
    print(model)
    run = model.simulate(10.0, {scene.contact.v: (1.0, 4.0, 3.0)}, rtol=1e-11)
    R, w = run[scene.ball.frame.rotation], run[scene.ball.frame.angular_velocity]
    momentum = np.einsum("nij,jk,nlk,nl->ni", R, INERTIA, R, w) + MASS * np.cross([0, 0, RADIUS], run[scene.ball.frame.velocity])
    change = float(np.max(np.abs(momentum - momentum[0])) / np.linalg.norm(momentum[0]))
    print(run)
    print(f"momentum about the point that touches is kept to {change:.0e}, energy to {run.energy_error():.0e}")
    run.picture(f"{folder}/chaplygin_sphere.png", times=(0.0, 1.0, 2.0))
    run.animate(f"{folder}/chaplygin_sphere.html")
    return max(change, run.energy_error())


if __name__ == "__main__":
    main()
