"""Attitudes of one motion in twelve sets of Euler angles: a body turns at a constant angular velocity, and each set tells it in its own way.

The body turns about a fixed axis by w t: R = exp(w t) R(0), whatever the angles say. Each set has attitudes at which two of its axes agree and its rates grow without
bound; that is a matter of words, and the body does not notice. O'Reilly, Intermediate Dynamics for Engineers, 6 and 7.11.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import acausal as ac
from acausal import rotations
from components import PrescribedAngularVelocity, RigidBody, World

LIMIT = 1e-11  # of what main returns

RATE, FIRST = (0.9, -0.5, 0.7), Rotation.from_euler("ZXZ", (0.4, 0.9, -0.3))  # rad/s; where it begins
SETS = ("xyz", "yzx", "zxy", "xzy", "yxz", "zyx", "xyx", "yzy", "zxz", "xzx", "yxy", "zyz")


def main(folder: str = "out") -> float:
    """Ten seconds, given and as a free ball that starts at angles; returns how far attitudes are from the closed form, and angles and rates from SciPy's."""
    scene = ac.System()
    scene.world, scene.turn = World(gravity=None), PrescribedAngularVelocity(RATE)
    scene.held, scene.free = RigidBody.box(1.0, (0.4, 0.2, 0.1)), RigidBody.ball(1.0, 0.1, position=(0.6, 0, 0))
    scene.connect(scene.world.frame, scene.turn.frame_a)
    scene.connect(scene.turn.frame_b, scene.held.at((0, 0, 0), rotation=FIRST.inv()))
    model = ac.build(scene)
    print(model)
    told = [rotations.euler_angles(scene.held.frame.rotation, f"intrinsic {name}") for name in SETS]
    start = {
        scene.free.frame.angular_velocity: RATE,
        rotations.euler_angles(scene.free.frame.rotation, "intrinsic zxz"): (0.4, 0.9, -0.3),
    }
    run = model.simulate(10.0, start, rtol=1e-12)
    exact = Rotation.from_rotvec(np.outer(run.t, RATE)) * FIRST
    off = max(float(np.max(np.abs(run[body.frame.rotation] - exact.as_matrix()))) for body in (scene.held, scene.free))
    print(run)
    print(f"the body's attitude is exp(w t) R(0) to {off:.0e}; it is told by")
    for name, angles in zip(SETS, told, strict=True):
        a, rates = run[angles], run[ac.der(angles)]
        near = np.abs(np.sin(a[:, 1]) if name[0] == name[2] else np.cos(a[:, 1]))
        back = np.max(np.abs(Rotation.from_euler(name.upper(), a).as_matrix() - exact.as_matrix()))
        # the rates along the three axes, each turned by the angles before it, add up to the angular velocity
        axes = [np.eye(3)["xyz".index(letter)] for letter in name]
        first = np.tile(axes[0], (run.t.size, 1))
        second = Rotation.from_euler(name[0].upper(), a[:, :1]).apply(axes[1])
        third = Rotation.from_euler(name[:2].upper(), a[:, :2]).apply(axes[2])
        sum_of = rates[:, :1] * first + rates[:, 1:2] * second + rates[:, 2:] * third
        off = max(off, float(back), float(np.max(np.abs(sum_of - RATE) * near[:, None])))
        print(
            f"  {name}: {np.degrees(a[-1]).round(3)} degrees at the end; within {np.degrees(near.min()):.1f} degrees of where it fails, rates up to {np.abs(rates).max():.1f} rad/s"
        )
    print(f"all to {off:.0e}")
    run.picture(f"{folder}/attitudes.png", times=(0.0, 0.5, 1.0))
    run.animate(f"{folder}/attitudes.html")
    return off


if __name__ == "__main__":
    main()
