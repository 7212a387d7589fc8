"""Five-bar: a parallel robot of two driven cranks picks, carries over an obstacle and places.

python examples/control/five_bar.py
"""

import acausal as ac
from components import Revolute, RigidBody, TorqueSource, World

LIMIT = 1e-4  # of what main returns


class FiveBar(ac.System):
    """Two cranks on the ground, two rods that meet in a hinge: a closed loop of two freedoms."""

    def __init__(self) -> None:
        self.left_torque, self.right_torque = ac.Input("N m"), ac.Input("N m")
        self.world = World(gravity=(0, 0, -9.81))
        self.left, self.right, self.left_elbow, self.right_elbow, self.hand = (Revolute("y") for _ in range(5))
        self.left_crank, self.right_crank = RigidBody.rod(0.6, (-0.15, 0, 0.2)), RigidBody.rod(0.6, (0.15, 0, 0.2))
        self.left_rod, self.right_rod = RigidBody.rod(0.4, (0.25, 0, 0.3)), RigidBody.rod(0.4, (-0.25, 0, 0.3))
        self.left_motor, self.right_motor = TorqueSource(self.left_torque), TorqueSource(self.right_torque)
        self.connect(self.world.at((-0.1, 0, 0)), self.left.frame_a)
        self.connect(self.world.at((0.1, 0, 0)), self.right.frame_a)
        self.connect(self.left.frame_b, self.left_crank.frame)
        self.connect(self.right.frame_b, self.right_crank.frame)
        self.connect(self.left_crank.tip, self.left_elbow.frame_a)
        self.connect(self.right_crank.tip, self.right_elbow.frame_a)
        self.connect(self.left_elbow.frame_b, self.left_rod.frame)
        self.connect(self.right_elbow.frame_b, self.right_rod.frame)
        self.connect(self.left_rod.tip, self.hand.frame_a)
        self.connect(self.hand.frame_b, self.right_rod.tip)
        self.connect(self.left_motor.flange, self.left.flange)
        self.connect(self.right_motor.flange, self.right.flange)


def main(folder: str = "out") -> float:
    """Find the motion; returns by how much it is off when its torques are simulated, relative to what each state varies by."""
    robot = FiveBar()
    model = ac.build(robot)
    print(model)
    place = robot.left_rod.tip.position
    ocp = ac.OptimalControl(model, time=ac.free(0.1, 2.0, 0.5))
    ocp.start({place[0]: -0.12, place[2]: 0.42})
    ocp.end({place[0]: 0.12, place[2]: 0.42, robot.left.v: 0, robot.right.v: 0})
    ocp.bound(place[0] ** 2 / 0.05**2 + (place[2] - 0.42) ** 2 / 0.04**2, lower=1.0)
    for torque in (robot.left_torque, robot.right_torque):
        ocp.bound(torque, -8, 8)
    ocp.at(0.5, {place[2]: (0.46, 0.6)})
    ocp.minimise(ocp.duration)
    best = ocp.solve(24, controls="constant")
    print(best)
    print(f"height of the hand at most {best.run[place][:, 2].max():.4f} m")
    best.run.picture(f"{folder}/five_bar.png", times=(0.0, 0.5 * best.duration, best.duration))
    best.run.animate(f"{folder}/five_bar.html", speed=0.25)
    return best.replay_error


if __name__ == "__main__":
    main()
