"""The Whipple bicycle: two wheels, a frame with its rider, a fork; three hinges and two rolling contacts, and nothing else.

Parameters as in Meijaard, Papadopoulos, Ruina and Schwab, Proceedings of the Royal Society A 463 (2007), table 1, with z up and y to
the left. The manoeuvre is M1 of the IFToMM benchmark "Uncontrolled bicycle": 4 m/s, a roll rate of 0.05 rad/s, nobody steers. The
reference was computed in quadruple precision by an independent program.

    python examples/bicycle.py
"""

import time
from pathlib import Path

import numpy as np

import acausal as ac
from acausal.simulate.trajectory import Trajectory
from acausal.visual.shapes import Polygon, Torus
from components import Revolute, RigidBody, RollingDisk, World

LIMIT = 1e-11  # of what main returns

WHEELBASE, TRAIL, TILT = 1.02, 0.08, np.pi / 10  # of the steering axis from the vertical
REAR, FRONT = 0.3, 0.35  # radii of the wheels [m]
REFERENCE = {  # time [s]: lean of the rear frame [rad], its rate about its own x [rad/s], steering angle [rad], its rate [rad/s],
    # centre of mass of the rear frame and rider [m]
    0.5: (0.0137482715243, -0.0082032510388, 0.0191508615325, 0.0175974083882, 2.299906362384, -0.03087359747, 0.899907790789),
    1.0: (-0.0081241839414, -0.0636197231468, 0.002722108692, -0.0756599285875, 4.299145135354, -0.090658096554, 0.89997076838),
    2.0: (0.0079521966131, 0.0996882005496, -0.0078718320387, 0.1133051385606, 8.298995308816, -0.122790719256, 0.899972729992),
    3.0: (-0.0093356836891, -0.1484957601858, 0.014879377108, -0.1641845157908, 12.297732934052, -0.207584905774, 0.899963123973),
    5.0: (-0.0047144889905, -0.3052955617074, 0.0449609740443, -0.3178133264406, 20.2927432516, -0.312856647831, 0.89998775242),
}


class Bicycle(ac.System):
    """Ground point of the rear wheel at the origin, heading along x. Three freedoms, seven of configuration."""

    def __init__(self) -> None:
        self.road = World()
        rider = ((-0.3, 0, -0.6), (0.05, 0, 0.05), (0, 0, 0.5), (0.1, 0, 0.2), (0.55, 0, 0.05), (0, 0, -0.6))
        handle = ((0.12, 0, -0.35), (0, 0, 0), (-0.1, 0, 0.3))
        self.rear_wheel = RigidBody(2.0, (0.0603, 0.12, 0.0603), position=(0, 0, REAR), shapes=_wheel(REAR))
        self.rear_frame = RigidBody(85.0, (9.2, 11.0, 2.8, 0, -2.4, 0), position=(0.3, 0, 0.9), shapes=(Polygon(rider),))
        self.fork = RigidBody(4.0, (0.05892, 0.06, 0.00708, 0, 0.00756, 0), position=(0.9, 0, 0.7), shapes=(Polygon(handle),))
        self.front_wheel = RigidBody(3.0, (0.1405, 0.28, 0.1405), position=(WHEELBASE, 0, FRONT), shapes=_wheel(FRONT))
        self.rear_hub = Revolute.between(self.rear_frame, self.rear_wheel, at=(0, 0, REAR), axis="y")
        down = (np.sin(TILT), 0, -np.cos(TILT))
        self.steering = Revolute.between(self.rear_frame, self.fork, at=(WHEELBASE + TRAIL, 0, 0), axis=down)
        self.front_hub = Revolute.between(self.fork, self.front_wheel, at=(WHEELBASE, 0, FRONT), axis="y")
        self.rear_contact, self.front_contact = RollingDisk(REAR), RollingDisk(FRONT)
        for contact, wheel in ((self.rear_contact, self.rear_wheel), (self.front_contact, self.front_wheel)):
            self.connect(self.road.frame, contact.frame_a)
            self.connect(contact.frame_b, wheel.frame)

    def start(self, speed: float, roll_rate: float = 0.0) -> dict[ac.Expression, object]:
        """Upright, straight ahead at `speed` [m/s], while it tips to the right at `roll_rate` [rad/s]."""
        return {
            self.rear_contact.q: (0, 0, 0, 0, 0),
            self.rear_contact.v: (roll_rate, speed / REAR, 0),
            self.steering.q: 0.0,
            self.steering.v: 0.0,
        }

    def seen(self, run: Trajectory) -> np.ndarray:
        """What `REFERENCE` tells, instant by instant (n, 7)."""
        frame = self.rear_frame.frame
        R, w = run[frame.rotation], run[frame.angular_velocity]
        lean, roll_rate = np.arcsin(R[:, 2, 1]), np.sum(R[:, :, 0] * w, axis=1)
        return np.column_stack([lean, roll_rate, run[self.steering.q], run[self.steering.v], run[frame.position]])


def _wheel(radius: float) -> tuple[Torus]:
    return (Torus(radius - 0.015, 0.015, (0, 1, 0)),)


def main(folder: str | Path = "out") -> float:
    """Compose, reduce, simulate, compare, draw; returns the largest difference from the reference [rad, rad/s, m]."""
    scene = Bicycle()
    began = time.perf_counter()
    model = ac.build(scene)
    built = time.perf_counter()
    run = model.simulate(5.0, scene.start(4.0, 0.05), rtol=1e-12)
    print(model)
    print(f"built in {1e3 * (built - began):.0f} ms; {run}")
    worst = float(np.max(np.abs(scene.seen(run.at(list(REFERENCE))) - np.array(list(REFERENCE.values())))))
    print(f"largest difference from the reference in 5 s: {worst:.1e} (its digits end at 1e-12)")
    print(f"contacts closed to {run.constraint_error():.1e}, energy kept to {run.energy_error():.1e}")
    folder = Path(folder)
    print("written:", run.picture(folder / "bicycle.png", times=(0.0, 0.3, 0.6)), run.animate(folder / "bicycle.html"))
    return worst


if __name__ == "__main__":
    main()
