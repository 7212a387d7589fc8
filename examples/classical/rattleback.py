"""A rattleback: spun the wrong way it begins to rattle, stops, and turns back.

An ellipsoid that rolls without slipping; the axes of its inertia are turned a little against those of its shape. There is no friction that could slow it: energy is
kept, and flows from the spin into rattling and back. J. Walker, Scientific American 241 (1979).
"""

import numpy as np

import acausal as ac
from components import RigidBody, RollingEllipsoid, World

LIMIT = 1e-8  # of what main returns


def main(folder: str = "out") -> float:
    """Ten seconds; returns the error of the energy, relative, or one where the spin does not reverse."""
    c, s = np.cos(0.08), np.sin(0.08)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    scene = ac.System()
    scene.world, scene.contact = World(), RollingEllipsoid((0.2, 0.03, 0.02))
    scene.stone = RigidBody(
        1.0,
        turn @ np.diag([2e-4, 1.6e-3, 1.7e-3]) @ turn.T,
        (0, 0, -0.0025),
        shapes=RigidBody.ellipsoid(1.0, (0.2, 0.03, 0.02)).shapes(),
    )
    scene.connect(scene.world.frame, scene.contact.frame_a)
    scene.connect(scene.contact.frame_b, scene.stone.frame)
    model = ac.build(scene)
    print(model)
    worst = 1.0
    for spin in (5.0, -5.0):
        run = model.simulate(8.0, {scene.contact.v: (0.02, 0.01, spin)}, rtol=1e-10)
        about = run[scene.stone.frame.angular_velocity][:, 2]
        print(
            f"spun with {spin:+.0f} rad/s: between {about.min():.2f} and {about.max():.2f} rad/s; energy kept to {run.energy_error():.0e}"
        )
        if np.min(about * np.sign(spin)) < -0.5:
            worst = run.energy_error()
            run.picture(f"{folder}/rattleback.png", times=(0.0, 0.1, 0.2))
            run.animate(f"{folder}/rattleback.html")
    return worst


if __name__ == "__main__":
    main()
