"""A bowling ball: it slides, gets spin from the friction, and rolls from then on with five sevenths of its speed, whatever the friction.

It slides for 2 v / 7 mu g, and 12 v^2 / 49 mu g far; with a spin across its way it goes along a parabola first, and then straight on. O'Reilly, 9.8.
"""

import numpy as np

import acausal as ac
from components import Contact, Coulomb, Hard, Plane, RigidBody, Sphere, World

LIMIT = 1e-9  # of what main returns
G, RADIUS, MU, SPEED, SPIN = 9.81, 0.108, 0.12, 8.0, 25.0


def main(folder: str = "out") -> float:
    """Three seconds; returns how far instant, place and velocity where it begins to roll are from the closed forms, relative."""
    scene = ac.System()
    scene.world, scene.ball = World(), RigidBody.ball(6.0, RADIUS)
    scene.lane = Contact(Sphere(RADIUS), Plane(), Hard(friction=Coulomb(MU)))
    scene.connect(scene.world.frame, scene.lane.frame_a)
    scene.connect(scene.lane.frame_b, scene.ball.frame)
    model = ac.build(scene)
    print(model)
    frame = scene.ball.frame
    start = {frame.position: (0, 0, RADIUS), frame.velocity: (SPEED, 0, 0), frame.angular_velocity: (SPIN, 0, 0)}
    run = model.simulate(3.0, start, rtol=1e-12)
    print(run)
    print(run.transitions)
    slip = np.array([SPEED, SPIN * RADIUS])
    lasts = 2 * np.linalg.norm(slip) / (7 * MU * G)
    push = -MU * G * slip / np.linalg.norm(slip)
    goes = np.array([SPEED, 0]) + push * lasts
    where = np.array([SPEED, 0]) * lasts + push * lasts**2 / 2
    begins = run.transitions[0].time
    at = run.at([begins])[frame.position][0, :2]
    print(f"slides for {begins:.9f} s, rolls with ({goes[0]:.6f}, {goes[1]:.6f}) m/s")
    run.picture(f"{folder}/bowling_ball.png", times=tuple(np.linspace(0, 3, 13)))
    run.animate(f"{folder}/bowling_ball.html")
    return float(max(abs(begins / lasts - 1), np.max(np.abs(at - where)), np.max(np.abs(run[frame.velocity][-1, :2] - goes))))


if __name__ == "__main__":
    print(main())
