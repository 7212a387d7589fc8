"""A spinning rotor on a bar that hangs on a ball joint, its axis at 45 degrees: slow, it falls; fast, it goes around.

Parameters as in Modelica.Mechanics.MultiBody.Examples.Rotational3DEffects.GyroscopicEffects (Modelica Standard Library 4.0).

    python examples/gyroscopic.py
"""

from pathlib import Path
from typing import Any

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, Spherical, World

LIMIT = 1e-12  # of what main returns

STEEL = 7700.0  # kg/m^3


class SpinningRotor(ac.System):
    """Bar of 0.25 m on a ball joint in the origin; at its end the rotor's hinge, without friction. y points up."""

    def __init__(self) -> None:
        self.world, self.ball, self.spin = World(gravity=(0, -9.81, 0)), Spherical(), Revolute("x")
        self.bar, self.rotor = _cylinder(0.25, 0.05), _cylinder(0.2, 0.1)
        self.connect(self.world.frame, self.ball.frame_a)
        self.connect(self.ball.frame_b, self.bar.frame)
        self.connect(self.bar.at((0.25, 0, 0), rotation=("y", np.pi / 4)), self.spin.frame_a)
        self.connect(self.spin.frame_b, self.rotor.at((0.1, 0, 0)))

    def angular_momentum(self, run: Any) -> np.ndarray:
        """Of both bodies about the origin (n, 3) [N*m*s]."""
        total = np.zeros((run.t.size, 3))
        for body in (self.bar, self.rotor):
            R, w = run[body.frame.rotation], run[body.frame.angular_velocity]
            arm = R @ body.centre_of_mass
            velocity = run[body.frame.velocity] + np.cross(w, arm)
            total += np.einsum("nij,jk,nlk,nl->ni", R, body.central_inertia, R, w)
            total += body.mass * np.cross(run[body.frame.position] + arm, velocity)
        return total


def _cylinder(length: float, diameter: float) -> RigidBody:
    """Along x."""
    return RigidBody.rod(STEEL * np.pi * diameter**2 / 4 * length, (length, 0, 0), radius=diameter / 2)


def main(folder: str | Path = "out") -> float:
    """Five seconds with 10 and with 2000 rad/s; returns the largest change of what gravity cannot change, relative."""
    scene = SpinningRotor()
    model = ac.build(scene)
    print(model)
    worst = 0.0
    for spin in (10.0, 2000.0):
        run = model.simulate(5.0, {scene.spin.v: spin}, rtol=1e-11)
        momentum = scene.angular_momentum(run)
        change = float(np.ptp(momentum[:, 1]) / np.max(np.linalg.norm(momentum, axis=1)))
        worst = max(worst, change, run.energy_error())
        lowest = float(np.min(run[scene.spin.frame_a.position][:, 1]))
        print(
            f"{spin:.0f} rad/s: the hinge falls to {lowest:.3f} m; momentum about the vertical is kept to {change:.1e},", end=" "
        )
        print(f"energy to {run.energy_error():.1e}")
    folder = Path(folder)
    print("written:", run.picture(folder / "gyroscopic.png", times=(0.0, 0.5, 1.0)), run.animate(folder / "gyroscopic.html"))
    return worst


if __name__ == "__main__":
    main()
