"""A pendulum on a string, too slow to go round: it leaves the circle, flies along a parabola, and is caught by the string again, and again.

With v^2 = 7/2 g l below it leaves at the height l / 2 over the pivot; where the string is taut again the velocity along it is lost.

python examples/classical/string_pendulum.py
"""

import numpy as np

import acausal as ac
from components import Particle, Rope, World

LIMIT = 1e-11  # of what main returns
G, LENGTH = 9.81, 1.0


def main(folder: str = "out") -> float:
    """Simulate ten seconds; returns how far from l / 2 it leaves the circle [m]."""
    scene = ac.System()
    scene.world, scene.bob = World(), Particle(1.0)
    scene.string = Rope(LENGTH)
    scene.connect(scene.world.frame, scene.string.frame_a)
    scene.connect(scene.string.frame_b, scene.bob.point)
    model = ac.build(scene)
    print(model)
    p = scene.bob.point
    start = {p.position: (0, 0, -LENGTH), p.velocity: (np.sqrt(3.5 * G * LENGTH), 0, 0)}
    run = model.simulate(10.0, start, rtol=1e-12)
    print(run)
    print(run.transitions)
    leaves = run.at([run.transitions[0].time])[p.position][0, 2]
    print(f"leaves the circle at {leaves:.12f} m; {run.energy[0] - run.energy[-1]:.3f} J lost where the string was taut again")
    run.picture(f"{folder}/string_pendulum.png", times=tuple(np.linspace(0, 1.4, 20)))
    run.animate(f"{folder}/string_pendulum.html")
    return abs(leaves - LENGTH / 2)


if __name__ == "__main__":
    print(main())
