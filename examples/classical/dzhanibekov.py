"""A body that flips: free rotation about the middle axis is unstable, and the body turns over again and again.

Euler's equations are solved by Jacobi's elliptic functions. Landau and Lifshitz, Mechanics, section 37.
"""

import numpy as np
from scipy.special import ellipj, ellipk

import acausal as ac
from components import RigidBody, World

LIMIT = 1e-7  # of what main returns

INERTIA = np.array([1.0, 2.0, 3.0])


def main(folder: str = "out") -> float:
    """Twenty seconds; returns the largest difference from the elliptic functions [rad/s]."""
    scene = ac.System()
    scene.world, scene.body = (
        World(gravity=None),
        RigidBody(3.0, tuple(INERTIA), shapes=RigidBody.box(1.0, (0.6, 0.4, 0.15)).shapes()),
    )
    model = ac.build(scene)
    print(model)
    start = np.array([0.0, 3.0, 0.01])
    run = model.simulate(20.0, {scene.body.frame.angular_velocity: tuple(start)}, rtol=1e-12)
    w = np.einsum("nji,nj->ni", run[scene.body.frame.rotation], run[scene.body.frame.angular_velocity])

    (a, b, c), energy, momentum = (
        INERTIA,
        INERTIA @ start**2,
        INERTIA**2 @ start**2,
    )  # twice the energy; the square of the momentum
    few, many = energy * c - momentum, momentum - energy * a
    m = (b - a) * few / ((c - b) * many)
    sn, cn, dn, _ = ellipj(ellipk(m) + run.t * np.sqrt((c - b) * many / (a * b * c)), m)
    exact = np.stack(
        [np.sqrt(few / (a * (c - a))) * cn, np.sqrt(few / (b * (c - b))) * sn, np.sqrt(many / (c * (c - a))) * dn], axis=1
    )
    off = float(np.max(np.abs(w - exact)))
    flips = int(np.sum(np.diff(np.sign(w[:, 1])) != 0))
    print(run)
    print(f"turns over {flips} times in 20 s; on Jacobi's functions to {off:.0e} rad/s; energy kept to {run.energy_error():.0e}")
    run.picture(f"{folder}/dzhanibekov.png", times=(0.0, 1.9))
    run.animate(f"{folder}/dzhanibekov.html")
    return off


if __name__ == "__main__":
    main()
