"""A car on a roller coaster without wheels below the rails: too fast over a hill it leaves the track, flies, and comes down on it again.

It leaves where gravity holds it on the curve no more: v^2 k = g cos(slope), k the curvature, with v^2 = v0^2 + 2 g (z0 - z). O'Reilly, 2.11.
"""

import casadi as ca
import numpy as np
from scipy.optimize import brentq

import acausal as ac
from components import ParametricCurve, Particle, PointOnCurve, World

LIMIT = 1e-9  # of what main returns
G, HILL, SPEED = 9.81, 1.5, 9.6


def track(x: float) -> float:
    """Height [m] over the way along."""
    return HILL * np.cos(x / 2)


def leaves() -> float:
    """Where it does [m]."""

    def push(x: float) -> float:
        slope, bend = -HILL / 2 * np.sin(x / 2), -HILL / 4 * np.cos(x / 2)
        square = SPEED**2 + 2 * G * (track(-2 * np.pi) - track(x))
        return G + square * bend / (1 + slope**2)

    return brentq(push, -np.pi, 0.0, xtol=1e-15)


def main(folder: str = "out") -> float:
    """From one valley over the hill; returns how far the place where it leaves is from the closed form [m]."""
    scene = ac.System()
    scene.world, scene.car = World(), Particle(300.0)
    scene.rails = PointOnCurve(ParametricCurve(lambda x: (x, 0.0, HILL * ca.cos(x / 2)), unit="m"), unilateral=True)
    scene.connect(scene.world.frame, scene.rails.frame_a)
    scene.connect(scene.rails.frame_b, scene.car.point)
    model = ac.build(scene)
    print(model)
    start = {scene.rails.q: (-2 * np.pi, 0.0), scene.rails.v: (SPEED, 0.0)}
    run = model.simulate(3.0, start, rtol=1e-12)
    print(run)
    print(run.transitions)
    off = next(t for t in run.transitions if "closed -> open" in str(t)).time
    x = run.at([off])[scene.car.point.position][0, 0]
    print(f"leaves the track at x = {x:.12f} m")
    run.picture(f"{folder}/roller_coaster.png", times=tuple(np.linspace(0, 3, 31)))
    run.animate(f"{folder}/roller_coaster.html")
    return abs(x - leaves())


if __name__ == "__main__":
    print(main())
