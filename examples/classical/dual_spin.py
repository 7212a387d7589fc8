"""A dual-spin satellite: a rotor inside lets it spin calmly about the axis of middle inertia, about which it would tumble without.

Spinning with W about the rotor's axis, whose momentum relative to the body is h, it nods with the rate
sqrt((I_3 W + h - I_1 W) (I_3 W + h - I_2 W) / (I_1 I_2)), where the root is real; else it tumbles. The rotor keeps its own momentum along its axis.
O'Reilly, Intermediate Dynamics for Engineers, chapter 11; Hughes, Spacecraft Attitude Dynamics (1986), 6.
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-5  # of what main returns

INERTIA, ROTOR, W = np.array([300.0, 200.0, 250.0]), np.array([2.0, 2.0, 4.0]), 0.5


def satellite() -> ac.System:
    """A body that spins about its axis of middle inertia, z, and a rotor on that axis."""
    scene = ac.System()
    scene.world = World(gravity=None)
    scene.body = RigidBody(100.0, tuple(INERTIA), shapes=RigidBody.box(1.0, (1.0, 1.6, 1.2)).shapes())
    scene.rotor = RigidBody(10.0, tuple(ROTOR), shapes=RigidBody.cylinder(1.0, 0.6, 1.5).shapes())
    scene.bearing = Revolute("z")
    scene.connect(scene.body.frame, scene.bearing.frame_a)
    scene.connect(scene.bearing.frame_b, scene.rotor.frame)
    return scene


def spun(speed: float, nudge: float, seconds: float, events: bool = False):
    """The satellite with the rotor at this speed [rad/s] over the body, and a nudge [rad/s] across: scene and motion."""
    scene = satellite()
    frame = scene.body.frame
    begin = {
        frame.position: (0, 0, 0),
        frame.velocity: (0, 0, 0),
        frame.rotation: np.eye(3),
        frame.angular_velocity: (nudge, 0, W),
        scene.bearing.v: speed,
    }
    across = sum(frame.rotation[k, 0] * frame.angular_velocity[k] for k in range(3))
    return scene, ac.build(scene).simulate(seconds, begin, rtol=1e-12, events=[ac.when(across)] if events else [])


def main(folder: str = "out") -> float:
    """Nods with a rotor, tumbling without; returns the largest difference from the closed forms, relative."""
    whole, speed = INERTIA + ROTOR, 60.0
    h = ROTOR[2] * speed
    exact = np.sqrt((whole[2] * W + h - whole[0] * W) * (whole[2] * W + h - whole[1] * W) / (whole[0] * whole[1]))
    scene, calm = spun(speed, 1e-4, 20 * np.pi / exact, events=True)
    rate = np.pi / np.mean(np.diff([event.time for event in calm.events]))
    off = abs(rate / exact - 1)

    scene, run = spun(0.0, 1e-3, 120.0)
    body, rotor = scene.body.frame, scene.rotor.frame
    momentum = 0.0
    for frame, inertia in ((body, INERTIA), (rotor, ROTOR)):
        R, w = run[frame.rotation], run[frame.angular_velocity]
        momentum = momentum + np.einsum("nij,j,nkj,nk->ni", R, inertia, R, w)
    kept = float(np.max(np.abs(momentum - momentum[0])) / np.linalg.norm(momentum[0]))
    tilt = [
        np.degrees(np.arccos(np.clip(motion[one.body.frame.rotation][:, 2, 2], -1, 1))).max()
        for one, motion in (spun(speed, 1e-3, 120.0), (scene, run))
    ]
    print(run)
    print(
        f"with the rotor it nods with {rate:.6f} rad/s (closed form {exact:.6f}) and tilts by {tilt[0]:.2f} degrees, without by {tilt[1]:.0f}; "
        f"angular momentum kept to {kept:.0e}, energy to {run.energy_error():.0e}"
    )
    late = run.at(np.linspace(60.0, 120.0, 900))
    late.picture(f"{folder}/dual_spin.png", times=(60.0, 70.0, 75.0, 80.0))
    late.animate(f"{folder}/dual_spin.html", speed=5.0)
    return max(off, kept)


if __name__ == "__main__":
    main()
