"""A ball down endless stairs: it comes to the same bounce, whatever it began with, since what it loses at each it gains from the step.

Where it falls by h from bounce to bounce, v^2 = (e v)^2 + 2 g h: it tends to strike with v = sqrt(2 g h / (1 - e^2)), if it goes one step's depth meanwhile.

python examples/classical/ball_down_the_stairs.py
"""

import casadi as ca
import numpy as np

import acausal as ac
from components import HeightField, Particle, PointOnSurface, World

LIMIT = 1e-11  # of what main returns
G, STEP, DEPTH, BOUNCE = 9.81, 0.2, 0.3, 0.8


def bounces(x: float, z: float, speed: float, number: int) -> list[tuple[float, float]]:
    """Instant and speed of each strike, by parabolas: the first step below that the ball comes down on while it is over it."""
    t, up, found = 0.0, 0.0, []
    for _ in range(number):
        for step in range(int(np.floor(x / DEPTH)), 10**6):
            lasts = (up + np.sqrt(up**2 + 2 * G * (z + STEP * step))) / G
            if np.floor((x + speed * lasts) / DEPTH) == step:
                break
        t, x, z, up = t + lasts, x + speed * lasts, -STEP * step, BOUNCE * (G * lasts - up)
        found.append((t, up / BOUNCE))
    return found


def main(folder: str = "out") -> float:
    """Thirty bounces; returns how far their instants are from those of parabolas [s]."""
    scene = ac.System()
    scene.world, scene.ball = World(), Particle(0.1)
    stairs = HeightField(lambda x, y: -STEP * ca.floor(x / DEPTH))
    scene.stairs = PointOnSurface(stairs, unilateral=True, restitution=BOUNCE)
    scene.connect(scene.world.frame, scene.stairs.frame_a)
    scene.connect(scene.stairs.frame_b, scene.ball.point)
    model = ac.build(scene)
    print(model)

    lasting = np.sqrt(2 * G * STEP / (1 - BOUNCE**2))
    speed = DEPTH * G / ((1 + BOUNCE) * lasting)
    exact = bounces(0.01, 1.0, speed, 30)
    p = scene.ball.point
    run = model.simulate(exact[-1][0] + 0.1, {p.position: (0.01, 0, 1.0), p.velocity: (speed, 0, 0)}, rtol=1e-12)
    print(run)
    struck = np.array([transition.time for transition in run.transitions])
    print(f"strikes with {', '.join(f'{v:.3f}' for _, v in exact[::6])} m/s; for ever {lasting:.3f} m/s")
    run.picture(f"{folder}/ball_down_the_stairs.png", times=tuple(np.linspace(0, 4, 30)))
    run.animate(f"{folder}/ball_down_the_stairs.html")
    return float(np.max(np.abs(struck - [t for t, _ in exact])))


if __name__ == "__main__":
    print(main())
