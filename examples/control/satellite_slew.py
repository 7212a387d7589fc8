"""Satellite slew: three wheels turn a satellite by 120 degrees, with least effort, and all is at rest at the end.

No torque acts from outside: the angular momentum stays zero. Attitude is a quaternion; of its four numbers three are free.

    python examples/control/satellite_slew.py
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, TorqueSource, World

LIMIT = 1e-6  # of what main returns


class Satellite(ac.System):
    """A body with a wheel along each axis."""

    def __init__(self) -> None:
        self.world = World(gravity=None)
        self.body = RigidBody(100.0, (30.0, 20.0, 25.0), shapes=RigidBody.box(1.0, (1.0, 1.6, 1.2)).shapes())
        self.torques = [ac.Input("N m") for _ in range(3)]
        self.wheels = [RigidBody.disk(4.0, 0.25, axis) for axis in "xyz"]
        self.bearings = [Revolute(axis) for axis in "xyz"]
        self.motors = [TorqueSource(torque) for torque in self.torques]
        for wheel, bearing, motor in zip(self.wheels, self.bearings, self.motors, strict=True):
            self.connect(self.body.frame, bearing.frame_a)
            self.connect(bearing.frame_b, wheel.frame)
            self.connect(motor.flange, bearing.flange)


def main(folder: str = "out") -> float:
    """Find the motion; returns by how much it is off when its torques are simulated, relative to what each state varies by."""
    scene = Satellite()
    model = ac.build(scene)
    print(model)
    frame, turn = scene.body.frame, 2 * np.pi / 3
    ocp = ac.OptimalControl(model, time=60.0)
    ocp.start(
        {frame.position: (0, 0, 0), frame.velocity: (0, 0, 0), frame.rotation: np.eye(3), frame.angular_velocity: (0, 0, 0)}
    )
    ocp.end({frame.rotation: ac.rotations.axis_angle((1, 1, 1), turn), frame.angular_velocity: (0, 0, 0)})
    for torque in scene.torques:
        ocp.bound(torque, -0.5, 0.5)
    ocp.minimise(ac.integral(sum(torque**2 for torque in scene.torques)))
    best = ocp.solve(16)
    print(best)
    print("the wheels turn by at most", np.round([np.max(np.abs(best.run[bearing.v])) for bearing in scene.bearings], 2), "rad/s")
    best.run.picture(f"{folder}/satellite_slew.png", times=(0.0, 30.0, 60.0))
    best.run.animate(f"{folder}/satellite_slew.html", speed=10.0)
    return best.replay_error


if __name__ == "__main__":
    main()
