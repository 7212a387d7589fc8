"""Acrobot: a double pendulum that stands up by a torque at its elbow alone.

Spong, The swing up control problem for the acrobot (1995), with uniform rods; the least effort in four seconds.

    python examples/control/acrobot.py
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, TorqueSource, World

LIMIT = 1e-6  # of what main returns


class Acrobot(ac.System):
    """Two rods; the elbow is driven, the shoulder is not."""

    def __init__(self) -> None:
        self.torque = ac.Input("N m")
        self.world, self.shoulder, self.elbow = World(gravity=(0, 0, -9.81)), Revolute("y"), Revolute("y")
        self.upper, self.lower = RigidBody.rod(1.0, (0, 0, -1.0)), RigidBody.rod(1.0, (0, 0, -1.0))
        self.motor = TorqueSource(self.torque)
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.upper.frame)
        self.connect(self.upper.tip, self.elbow.frame_a)
        self.connect(self.elbow.frame_b, self.lower.frame)
        self.connect(self.motor.flange, self.elbow.flange)


def main(folder: str = "out") -> float:
    """Find the motion; returns by how much it is off when its torque is simulated, over how much it magnifies errors."""
    scene = Acrobot()
    model = ac.build(scene)
    ocp = ac.OptimalControl(model, time=4.0)
    ocp.start({scene.shoulder.q: 0, scene.elbow.q: 0})
    ocp.end({scene.shoulder.q: np.pi, scene.elbow.q: 0, scene.shoulder.v: 0, scene.elbow.v: 0})
    ocp.bound(scene.torque, -40, 40)
    ocp.minimise(ac.integral(scene.torque**2))
    best = ocp.solve(30)
    print(best)
    follow = ac.lqr(
        best.run, {scene.shoulder.q: 10, scene.elbow.q: 10, scene.shoulder.v: 1, scene.elbow.v: 1}, {scene.torque: 0.1}
    )
    print("gains that hold it on its way, at the start:", np.round(follow.gain(0.0), 2))
    best.run.picture(f"{folder}/acrobot.png", times=(0.0, 1.5, 2.5, 3.2, 4.0))
    best.run.animate(f"{folder}/acrobot.html")
    return best.replay_error / best.growth


if __name__ == "__main__":
    main()
