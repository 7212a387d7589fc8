"""A ski jump without air: down the in-run, off its end, and down on a slope, where what strikes is lost and the rest slides on.

At the end of the track the speed is that of the fall, along the tangent; from there on it is a parabola. O'Reilly, 2.11.
"""

import casadi as ca
import numpy as np

import acausal as ac
from components import ParametricCurve, Particle, PointOnCurve, World

LIMIT = 1e-9  # of what main returns
G, HEIGHT, LENGTH, TABLE, SLOPE = 9.81, 40.0, 60.0, 2.0, 0.6


def flight() -> tuple[float, float]:
    """How long it lasts [s], and how far down the slope it leads [m]."""
    fall = HEIGHT * (1 - np.exp(-3.0))
    rise = -3.0 * HEIGHT / LENGTH * np.exp(-3.0)  # of the track at its end
    v = np.sqrt(2 * G * fall) / np.hypot(1, rise) * np.array([1, rise])
    across, along = np.array([np.sin(SLOPE), np.cos(SLOPE)]), np.array([np.cos(SLOPE), -np.sin(SLOPE)])
    a, b, c = -G / 2 * np.cos(SLOPE), v @ across, TABLE * np.cos(SLOPE)
    lasts = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
    return lasts, along @ (v * lasts + np.array([0, TABLE - G / 2 * lasts**2]))


def main(folder: str = "out") -> float:
    """From the gate to the slope; returns how far it is from the closed form where and when it lands [m]."""
    scene = ac.System()
    scene.world, scene.skier = World(), Particle(70.0)
    in_run = ParametricCurve(
        lambda x: (x - LENGTH, 0.0, TABLE + HEIGHT * (ca.exp(-3 * x / LENGTH) - np.exp(-3.0))), (0.0, LENGTH), "m"
    )
    hill = ParametricCurve(lambda s: (s * np.cos(SLOPE), 0.0, -s * np.sin(SLOPE)), (0.0, 200.0), "m")
    scene.track, scene.slope = PointOnCurve(in_run, unilateral=True), PointOnCurve(hill, unilateral=True)
    scene.connect(scene.world.frame, scene.track.frame_a)
    scene.connect(scene.track.frame_b, scene.skier.point)
    scene.connect(scene.world.frame, scene.slope.frame_a)
    scene.connect(scene.slope.frame_b, scene.skier.point)
    model = ac.build(scene)
    print(model)
    run = model.simulate(8.0, {scene.track.q: (0.0, 0.0), scene.track.v: (0.0, 0.0)}, rtol=1e-12)
    print(run)
    print(run.transitions)
    off, lands = (t.time for t in run.transitions)
    x, _, z = run.at([lands])[scene.skier.point.position][0]
    speed = np.linalg.norm(run.transitions[-1].before[scene.skier.point.velocity])
    down = x * np.cos(SLOPE) - z * np.sin(SLOPE)
    print(f"flies for {lands - off:.9f} s, and lands {down:.9f} m down the slope")
    run.picture(f"{folder}/ski_jump.png", times=tuple(np.linspace(0, run.t[-1], 41)))
    run.animate(f"{folder}/ski_jump.html")
    lasts, far = flight()
    return max(speed * abs(lands - off - lasts), abs(down - far))


if __name__ == "__main__":
    print(main())
