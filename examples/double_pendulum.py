"""A first scene: two uniform rods on two hinges, built from 3-D parts.

python examples/double_pendulum.py
"""

import acausal as ac
from components import Revolute, RigidBody, World

LIMIT = 1e-9  # of what main returns


class DoublePendulum(ac.System):
    """Two uniform rods on two hinges."""

    def __init__(self, length: float = 1.0, mass: float = 1.0) -> None:
        self.world = World(gravity=(0, 0, -9.81))
        self.shoulder = Revolute(axis="y")
        self.upper = RigidBody.rod(mass=mass, tip=(0, 0, -length))
        self.elbow = Revolute(axis="y")
        self.lower = RigidBody.rod(mass=mass, tip=(0, 0, -length))
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.upper.frame)
        self.connect(self.upper.tip, self.elbow.frame_a)
        self.connect(self.elbow.frame_b, self.lower.frame)


def main(folder: str = "out") -> float:
    """Simulate ten seconds; returns the relative error of the energy."""
    scene = DoublePendulum()
    model = ac.build(scene)
    print(model)
    run = model.simulate(10.0, start={scene.shoulder.q: 0.6, scene.elbow.q: 0.0}, rtol=1e-10)
    print(run)
    print("tip at the end:", run[scene.lower.tip.position][-1])
    print(f"energy kept to {run.energy_error():.1e}")
    run.picture(f"{folder}/double_pendulum.png", times=(0.0, 0.4, 0.8))
    run.animate(f"{folder}/double_pendulum.html")
    return run.energy_error()


if __name__ == "__main__":
    main()
