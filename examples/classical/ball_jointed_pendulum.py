"""A double pendulum on ball joints: two round rods that swing and turn in space as they like.

Each rod keeps its spin about its own axis, since a ball joint on that axis has no moment about it, and both together their angular momentum about the vertical.
Small motions are those of the double pendulum in a plane, in two planes at once. O'Reilly, Intermediate Dynamics for Engineers, 11.
"""

import numpy as np
from scipy.linalg import eigh

import acausal as ac
from components import RigidBody, Spherical, World

LIMIT = 1e-9  # of what main returns

MASS, LENGTH, RADIUS, G = 1.0, 0.5, 0.02, 9.81


def main(folder: str = "out") -> float:
    """Ten seconds; returns how far frequencies, spins, momentum and energy are off, relative."""
    scene = ac.System()
    scene.world, scene.joints = World(gravity=(0, 0, -G)), [Spherical(), Spherical()]
    scene.rods = [RigidBody.rod(MASS, (0, 0, -LENGTH), radius=RADIUS) for _ in range(2)]
    scene.connect(scene.world.frame, scene.joints[0].frame_a)
    scene.connect(scene.joints[0].frame_b, scene.rods[0].frame)
    scene.connect(scene.rods[0].tip, scene.joints[1].frame_a)
    scene.connect(scene.joints[1].frame_b, scene.rods[1].frame)
    model = ac.build(scene)
    print(model)

    # hanging: m l^2 (4/3, 1/2; 1/2, 1/3) and m g l (3/2, 0; 0, 1/2) of thin rods; a round one has m r^2 / 4 more
    inertia = MASS * LENGTH**2 * np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]]) + MASS * RADIUS**2 / 4 * np.eye(2)
    exact = np.sqrt(eigh(MASS * G * LENGTH * np.diag([1.5, 0.5]), inertia, eigvals_only=True))
    modes = model.linearize().modes()
    found = np.sort([mode.angular_frequency for mode in modes if mode.frequency > 0])  # each in two planes
    off = float(np.max(np.abs(found / np.repeat(exact, 2) - 1)))
    print(modes)

    quarter = (np.cos(0.6), 0, np.sin(0.6), 0)
    turning = {scene.joints[0].v: (1.0, 0.0, 4.0), scene.joints[1].v: (0.0, -2.0, -3.0)}
    run = model.simulate(10.0, {scene.joints[0].q: quarter, **turning}, rtol=1e-12)
    upright, spins = np.zeros(run.t.size), []
    for rod in scene.rods:
        R, w = run[rod.frame.rotation], run[rod.frame.angular_velocity]
        spins.append(np.einsum("ni,ni->n", R[:, :, 2], w))
        own = np.einsum("nij,jk,nlk,nl->ni", R, rod.central_inertia, R, w)
        upright += own[:, 2] + MASS * np.cross(run[rod.centre.position], run[rod.centre.velocity])[:, 2]
    kept = [float(np.ptp(s) / np.max(np.abs(s))) for s in (*spins, upright)]
    print(run)
    print(f"spins about the rods are kept to {max(kept[:2]):.0e}, the momentum about the vertical to {kept[2]:.0e}")
    print(f"frequencies are met to {off:.0e}, energy is kept to {run.energy_error():.0e}")
    run.picture(f"{folder}/ball_jointed_pendulum.png", times=(0.0, 0.3, 0.6))
    run.animate(f"{folder}/ball_jointed_pendulum.html")
    return max(off, *kept, run.energy_error())


if __name__ == "__main__":
    main()
