"""A coin rolls on a table in a script of a few lines: three velocities, no multiplier, and it never slips.

python examples/rolling_disk.py
"""

import numpy as np

import acausal as ac
from components import RigidBody, RollingDisk, World

LIMIT = 1e-12  # of what main returns


def main(folder: str = "out") -> float:
    """Simulate five seconds; returns the largest slip velocity of the contact point [m/s]."""
    scene = ac.System()
    scene.table = World()
    scene.coin = RigidBody.disk(mass=0.01, radius=0.05, axis="y")
    scene.contact = RollingDisk(radius=0.05, axis="y")
    scene.connect(scene.table.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.coin.frame)
    model = ac.build(scene)
    print(model)
    lean = 0.3
    run = model.simulate(5.0, {scene.contact.q: (0, lean, 0, 0, 0), scene.contact.v: (0.2, 12.0, 0.5)}, rtol=1e-10)
    centre, w = run[scene.coin.frame.velocity], run[scene.coin.frame.angular_velocity]
    axis = run[scene.coin.frame.rotation][:, :, 1]
    down = -np.array([0, 0, 1.0]) + axis * axis[:, 2:]
    arm = 0.05 * down / np.linalg.norm(down, axis=1, keepdims=True)
    slip = float(np.max(np.abs(centre + np.cross(w, arm))))
    print(run)
    print(f"contact point at rest to {slip:.1e} m/s, energy kept to {run.energy_error():.1e}")
    run.picture(f"{folder}/rolling_disk.png", times=(0.0, 1.0, 2.0))
    run.animate(f"{folder}/rolling_disk.html")
    return slip


if __name__ == "__main__":
    main()
