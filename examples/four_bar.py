"""A four-bar of four plain hinges in a skewed plane: assembled, reported, simulated without drift.

python examples/four_bar.py
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-13  # of what main returns

NORMAL = np.array([1.0, 2.0, 2.0]) / 3
ALONG = np.array([2.0, -2.0, 1.0]) / 3


class FourBar(ac.System):
    """Crank 0.4 m, coupler 1.2 m, rocker 0.8 m, ground 1 m, in the plane with normal (1, 2, 2)."""

    def __init__(self) -> None:
        self.world = World()
        self.crank, self.coupler, self.rocker = (RigidBody.rod(m, tuple(m * ALONG)) for m in (0.4, 1.2, 0.8))
        self.a, self.b, self.c, self.d = (Revolute(tuple(NORMAL)) for _ in range(4))
        for joint, one, two in (
            (self.a, self.world.frame, self.crank.frame),
            (self.b, self.crank.tip, self.coupler.frame),
            (self.c, self.coupler.tip, self.rocker.tip),
            (self.d, self.world.at(tuple(ALONG)), self.rocker.frame),
        ):
            self.connect(one, joint.frame_a)
            self.connect(joint.frame_b, two)


def main(folder: str = "out") -> float:
    """Simulate ten seconds; returns the largest gap of the loop [m]."""
    scene = FourBar()
    model = ac.build(scene)
    print(model.report())
    run = model.simulate(10.0, {scene.a.q: -0.5, scene.a.v: 3.0, scene.d.q: ac.near(-1.0)}, rtol=1e-10)
    gap = float(np.max(np.abs(run[scene.coupler.tip.position] - run[scene.rocker.tip.position])))
    print(run)
    print(f"loop closed to {gap:.1e} m, energy kept to {run.energy_error():.1e}")
    print("largest pull in the coupler's pin:", np.max(np.linalg.norm(run[scene.c.frame_b.force], axis=1)), "N")
    run.picture(f"{folder}/four_bar.png", times=(0.0, 0.3, 0.6))
    run.animate(f"{folder}/four_bar.html")
    model.draw_graph(f"{folder}/four_bar_graph.png")
    return gap


if __name__ == "__main__":
    main()
