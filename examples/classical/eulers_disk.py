"""Euler's disk: a coin that is almost flat goes around faster and faster, the less it leans, while its face hardly turns.

Whether it rolls or slides without friction: with its centre at rest it goes around at W^2 = 4 g / (r sin a) in both cases, and its face turns at W (1 - cos a).
H. K. Moffatt, Nature 404 (2000); O'Reilly, Intermediate Dynamics for Engineers, 10.8.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import acausal as ac
from components import Contact, Disk, Plane, RigidBody, Rolling, Sliding, World

LIMIT = 1e-9  # of what main returns

RADIUS, G = 0.0375, 9.81


class Coin(ac.System):
    """A thin coin on a table."""

    def __init__(self, law: Rolling | Sliding) -> None:
        self.world, self.contact = World(gravity=(0, 0, -G)), Contact(Disk(RADIUS), Plane(), law)
        self.coin = RigidBody.disk(0.4, RADIUS, axis="z")
        self.connect(self.world.frame, self.contact.frame_a)
        self.connect(self.contact.frame_b, self.coin.frame)


def main(folder: str = "out") -> float:
    """Two seconds each, leaning by 20, 5 and 1 degrees; returns how far lean, centre, rate and the turn of the face are off, relative."""
    off = 0.0
    for law in (Rolling(), Sliding()):
        scene = Coin(law)
        model = ac.build(scene)
        print(model)
        for lean in np.radians((1, 5, 20)):
            rate = np.sqrt(4 * G / (RADIUS * np.sin(lean)))
            turn = Rotation.from_euler("x", lean)
            along = rate * np.sin(lean) * turn.apply((0, 1, 0))  # up its face, through the point that touches
            start = {
                scene.coin.frame.rotation: turn,
                scene.coin.frame.angular_velocity: along,
                scene.coin.frame.position[:2]: (0, 0),
            }
            run = model.simulate(2.0, start, rtol=1e-12)
            R = run[scene.coin.frame.rotation]
            around = np.unwrap(np.arctan2(R[:, 0, 2], -R[:, 1, 2]))
            spin = np.unwrap(np.arctan2(R[:, 2, 0], R[:, 2, 1]))  # about its axis
            found = (
                np.max(np.abs(np.arccos(R[:, 2, 2]) / lean - 1)),
                np.max(np.abs(run[scene.coin.frame.position][:, :2])) / RADIUS,
                abs((around[-1] - around[0]) / (2.0 * rate)) - 1,
                abs((around + spin)[-1] - (around + spin)[0]) / (2.0 * rate * (1 - np.cos(lean))) - 1,
            )
            off = max(off, *map(abs, found))
            print(
                f"{type(law).__name__}, {np.degrees(lean):.0f} degrees: {rate / (2 * np.pi):.2f} rounds a second, met to {off:.0e}"
            )
    run.picture(f"{folder}/eulers_disk.png", times=(0.0, 0.02, 0.04))
    run.animate(f"{folder}/eulers_disk.html", speed=0.05)
    return off


if __name__ == "__main__":
    main()
