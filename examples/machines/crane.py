"""A crane: a trolley on its rail, a rope that is hoisted, a load that swings. The speed of the hoist and the push on the trolley are inputs.

The swing is compared with the equations of a pendulum whose length changes while its pivot moves, solved by scipy.
"""

import numpy as np
from scipy.integrate import solve_ivp

import acausal as ac
from components import ForceSource, Prismatic, Revolute, RigidBody, VelocitySource, World

LIMIT = 1e-8  # of what main returns

TROLLEY, LOAD, RADIUS, ROPE, G = 200.0, 1000.0, 0.4, 8.0, 9.81


def main(folder: str = "out") -> float:
    """Ten seconds; returns the largest difference of the swing's angle from scipy's [rad]."""
    scene = ac.System()
    scene.world, scene.push, scene.hoist = World(gravity=(0, 0, -G)), ac.Input("N"), ac.Input("m/s")
    scene.trolley, scene.load = RigidBody.box(TROLLEY, (1.2, 0.6, 0.4)), RigidBody.ball(LOAD, RADIUS)
    scene.rail, scene.swing, scene.rope = Prismatic(axis="x"), Revolute(axis="y"), Prismatic(axis=(0, 0, -1))
    scene.drive, scene.winch = ForceSource(scene.push), VelocitySource(scene.hoist)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.trolley.frame, scene.swing.frame_a)
    scene.connect(scene.swing.frame_b, scene.rope.frame_a)  # the rope has no mass
    scene.connect(scene.rope.frame_b, scene.load.frame)
    scene.connect(scene.drive.flange, scene.rail.flange)
    scene.connect(scene.winch.flange, scene.rope.flange)

    model = ac.build(scene)
    print(model)
    inputs = {scene.push: 600 * np.sin(ac.time), scene.hoist: 0.1 * ac.time - 0.5}
    run = model.simulate(10.0, {scene.rope.q: ROPE}, inputs=inputs, rtol=1e-11)
    reference = solve_ivp(_by_hand, (0, 10), np.zeros(4), method="DOP853", rtol=1e-12, atol=1e-14, t_eval=run.t)
    off = float(np.max(np.abs(-run[scene.swing.q] - reference.y[1])))
    print(run)
    print(
        f"swings by {np.degrees(np.ptp(run[scene.swing.q])):.1f} degrees, rope {run[scene.rope.q].min():.2f} to {run[scene.rope.q].max():.2f} m"
    )
    print(
        f"scipy's angle is {off:.0e} rad away; pull of the hoist {-run[scene.winch.flange.f].min():.0f} to {-run[scene.winch.flange.f].max():.0f} N"
    )
    run.picture(f"{folder}/crane.png", times=(0.0, 2.0, 4.0))
    run.animate(f"{folder}/crane.html")
    return off


def _by_hand(t: float, y: np.ndarray) -> np.ndarray:
    """Lagrange's equations of trolley place and angle to the right; y: both, then their rates."""
    length, rate, change = ROPE + 0.05 * t**2 - 0.5 * t, 0.1 * t - 0.5, 0.1
    _, angle, v, w = y
    s, c = np.sin(angle), np.cos(angle)
    mass = np.array([[TROLLEY + LOAD, LOAD * length * c], [LOAD * length * c, LOAD * (length**2 + 0.4 * RADIUS**2)]])
    forces = [
        600 * np.sin(t) - LOAD * (change * s + 2 * rate * w * c - length * w**2 * s),
        -2 * LOAD * length * rate * w - LOAD * G * length * s,
    ]
    return np.concatenate([[v, w], np.linalg.solve(mass, forces)])


if __name__ == "__main__":
    main()
