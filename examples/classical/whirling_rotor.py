"""A whirling rotor: out of balance on an elastic shaft, it runs around wide near one speed, and calms down above it.

Its centre circles with the radius e r^2 / (1 - r^2), r the speed as part of the critical one: below it the heavy side is outside, above it inside, so that far above
it turns about its centre of mass. O'Reilly, Intermediate Dynamics for Engineers, chapter 11.
"""

import numpy as np

import acausal as ac
from acausal.visual.shapes import Disk, Rod
from components import Prismatic, Revolute, RigidBody, SpeedSource, TranslationalGround, TranslationalSpring, World

LIMIT = 1e-9  # of what main returns

MASS, STIFFNESS, OFF = 2.0, 400.0, 0.02
CRITICAL = np.sqrt(STIFFNESS / MASS)


class Rotor(ac.System):
    """It turns at `speed` in a plane, its centre of mass beside its centre, which springs hold."""

    def __init__(self) -> None:
        self.world, self.x, self.y, self.turn = World(gravity=None), Prismatic("x"), Prismatic("y"), Revolute("z")
        shapes = (Disk(radius=0.15, thickness=0.02), Rod((0, 0, 0), (0.15, 0, 0)))
        self.rotor = RigidBody(MASS, (0.01, 0.01, 0.02), centre_of_mass=(OFF, 0, 0), shapes=shapes)
        self.speed = ac.Parameter(1.0, "rad/s")
        self.motor = SpeedSource(self.speed)
        self.shaft, self.bearings = [TranslationalSpring(STIFFNESS) for _ in "xy"], [TranslationalGround() for _ in "xy"]
        self.connect(self.world.frame, self.x.frame_a)
        self.connect(self.x.frame_b, self.y.frame_a)
        self.connect(self.y.frame_b, self.turn.frame_a)
        self.connect(self.turn.frame_b, self.rotor.frame)
        self.connect(self.turn.flange, self.motor.flange)
        for joint, spring, bearing in zip((self.x, self.y), self.shaft, self.bearings, strict=True):
            self.connect(joint.flange, spring.flange_b)
            self.connect(spring.flange_a, bearing.flange)


def main(folder: str = "out") -> float:
    """Two seconds at five speeds; returns how far paths are off their circles, as part of these."""
    scene = Rotor()
    model = ac.build(scene)
    print(model)
    off = 0.0
    for part in (0.5, 0.9, 1.1, 2.0, 8.0):
        w, radius = part * CRITICAL, OFF * part**2 / (1 - part**2)
        start = {scene.x.q: radius, scene.y.q: 0.0, scene.x.v: 0.0, scene.y.v: radius * w}
        run = model.simulate(2.0, start, parameters={scene.speed: w}, rtol=1e-12)
        circle = radius * np.exp(1j * w * run.t)
        off = max(off, float(np.max(np.abs(run[scene.x.q] + 1j * run[scene.y.q] - circle)) / abs(radius)))
        print(
            f"at {part:g} of the critical speed its centre runs {1e3 * radius:+.2f} mm off the axis, beside {1e3 * OFF:g} mm of its centre of mass"
        )
        if part == 0.9:
            run.picture(f"{folder}/whirling_rotor.png", times=(0.0, 0.1, 0.2))
            run.animate(f"{folder}/whirling_rotor.html", speed=0.1)
    print(f"circles are kept to {off:.0e} of their radii")
    return off


if __name__ == "__main__":
    main()
