"""A football: the air turns its nose away from the path, and the spin of a spiral makes it go around instead, as a top does.

The overturning moment c |v| v x e on the nose e is that of gravity on a top, m g l = c v^2. Steady precession about the velocity at an angle A has a
rate p with I p^2 cos(A) - C w p + c v^2 = 0, where C w is the spin's momentum and I the moment across. O'Reilly, Intermediate Dynamics for
Engineers, 9.6; Rae, Flight dynamics of an American football in a forward pass, Sports Engineering 6 (2003).
"""

import numpy as np
from scipy.spatial.transform import Rotation

import acausal as ac
from components import Drag, PitchingMoment, RigidBody, World

LIMIT = 1e-9  # of what main returns

MASS, ALONG, ACROSS, MOMENT, SPEED, SPIN, ANGLE = 0.42, 0.00194, 0.0032, 6e-4, 25.0, 60.0, 0.2


def pass_of(gravity: float, resistance: float, start: dict[str, object], seconds: float):
    """Of a football, its nose along x: the scene and its motion."""
    scene = ac.System()
    scene.world = World((0, 0, -gravity))
    scene.ball = RigidBody(MASS, (ALONG, ACROSS, ACROSS), shapes=RigidBody.ellipsoid(1.0, (1.4, 0.85, 0.85)).shapes())
    scene.nose, scene.drag = PitchingMoment(MOMENT, axis="x"), Drag(quadratic=resistance)
    scene.connect(scene.ball.frame, scene.nose.frame, scene.drag.point)
    begin = {getattr(scene.ball.frame, name): value for name, value in start.items()}
    return scene, ac.build(scene).simulate(seconds, begin, rtol=1e-12)


def main(folder: str = "out") -> float:
    """A spiral without gravity and drag, and a pass, the ball drawn ten times as large; returns the largest difference of the nose from its cone."""
    A, B, C = ACROSS * np.cos(ANGLE), -ALONG * SPIN, MOMENT * SPEED**2
    slow = 2 * C / (-B + np.sqrt(B**2 - 4 * A * C))
    nose = np.array([np.cos(ANGLE), 0.0, np.sin(ANGLE)])
    rotation = np.column_stack([nose, [0, 1, 0], np.cross(nose, [0, 1, 0])])
    # the nose goes around the velocity with the slow rate; along the nose the whole spin
    velocity = np.array([slow, 0.0, 0.0])
    turning = velocity - (velocity @ nose) * nose + SPIN * nose
    start = {"position": (0, 0, 0), "velocity": (SPEED, 0, 0), "rotation": rotation, "angular_velocity": turning}
    scene, spiral = pass_of(0.0, 0.0, start, 3.0)
    cone = np.column_stack(
        [np.full(spiral.t.size, nose[0]), -nose[2] * np.sin(slow * spiral.t), nose[2] * np.cos(slow * spiral.t)]
    )
    off = float(np.max(np.abs(spiral[scene.ball.frame.rotation][:, :, 0] - cone)))

    up = 0.6
    begin = {
        "position": (0, 0, 1.8),
        "velocity": (SPEED * np.cos(up), 0, SPEED * np.sin(up)),
        "rotation": Rotation.from_euler("ZYX", (0.05, -up, 0)).as_matrix(),
    }
    scene, run = pass_of(
        9.81,
        0.5 * 1.2 * 0.15 * np.pi * 0.085**2,
        {**begin, "angular_velocity": SPIN * np.array([np.cos(up), 0, np.sin(up)])},
        2.7,
    )
    print(run)
    place = run[scene.ball.frame.position]
    along = run[scene.ball.frame.velocity]
    tilt = np.degrees(np.arccos(np.sum(run[scene.ball.frame.rotation][:, :, 0] * along, axis=1) / np.linalg.norm(along, axis=1)))
    print(
        f"precesses with {slow:.3f} rad/s, on its cone to {off:.0e}; the pass goes {place[-1, 0]:.1f} m, its nose at most {tilt.max():.1f} degrees off the path"
    )
    run.picture(f"{folder}/football.png", times=tuple(np.linspace(0, 2.7, 10)))
    run.animate(f"{folder}/football.html", speed=0.5)
    return off


if __name__ == "__main__":
    main()
