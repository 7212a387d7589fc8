"""Robot arm: six axes move a tool in half a second, with the least torques relative to what their motors can.

Torques and speeds of all axes are bounded; between start and end the tool may take any way.

    python examples/control/robot_arm.py
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, TorqueSource, World

LIMIT = 1e-4  # of what main returns

AXES = ("z", "y", "y", "x", "y", "x")
LINKS = ((0, 0, 0.4), (0, 0, 0.5), (0.2, 0, 0), (0.3, 0, 0), (0.08, 0, 0), (0.06, 0, 0))
MASSES = (12.0, 8.0, 4.0, 3.0, 1.2, 0.6)
TORQUES = (120.0, 150.0, 70.0, 15.0, 12.0, 6.0)
START = (0.0, 0.3, 0.2, 0.0, 0.5, 0.0)
END = (1.8, 0.9, -0.4, 0.5, 0.8, -1.0)


class Arm(ac.System):
    """Six hinges in a row, each with a motor."""

    def __init__(self) -> None:
        self.torques = [ac.Input("N m") for _ in AXES]
        self.world = World(gravity=(0, 0, -9.81))
        self.hinges = [Revolute(axis) for axis in AXES]
        self.links = [RigidBody.rod(mass, tip, radius=0.05) for mass, tip in zip(MASSES, LINKS, strict=True)]
        self.motors = [TorqueSource(torque) for torque in self.torques]
        before = self.world.frame
        for hinge, link, motor in zip(self.hinges, self.links, self.motors, strict=True):
            self.connect(before, hinge.frame_a)
            self.connect(hinge.frame_b, link.frame)
            self.connect(motor.flange, hinge.flange)
            before = link.tip


def main(folder: str = "out") -> float:
    """Find the motion; returns by how much it is off when its torques are simulated, relative to what each state varies by."""
    arm = Arm()
    model = ac.build(arm)
    print(model)
    ocp = ac.OptimalControl(model, time=0.5)
    ocp.start(dict(zip([hinge.q for hinge in arm.hinges], START, strict=True)))
    ocp.end(dict(zip([hinge.q for hinge in arm.hinges], END, strict=True)))
    ocp.end({hinge.v: 0 for hinge in arm.hinges})
    for hinge, torque, most in zip(arm.hinges, arm.torques, TORQUES, strict=True):
        ocp.bound(torque, -most, most)
        ocp.bound(hinge.v, -6, 6)
    ocp.minimise(ac.integral(sum((torque / most) ** 2 for torque, most in zip(arm.torques, TORQUES, strict=True))))
    best = ocp.solve(12)
    print(best)
    used = [
        float(np.max(np.abs(best.inputs[torque](np.linspace(0, 0.499, 100))))) / most
        for torque, most in zip(arm.torques, TORQUES, strict=True)
    ]
    print("largest torques, of what the motors can:", np.round(used, 3))
    best.run.picture(f"{folder}/robot_arm.png", times=(0.0, 0.5 * best.duration, best.duration))
    best.run.animate(f"{folder}/robot_arm.html", speed=0.5)
    return best.replay_error


if __name__ == "__main__":
    main()
