"""A universal joint between two shafts: one turns evenly, the other one does not.

The tangents of the angles have the ratio of the cosine of the bend, as Hooke knew. The loop through the bearings closes without a word about it.
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, SpeedSource, Universal, World

LIMIT = 1e-9  # of what main returns

BEND, SPEED = 0.6, 5.0


def main(folder: str = "out") -> float:
    """Three seconds; returns the largest difference of the second angle from Hooke's [rad]."""
    out = np.array([np.cos(BEND), 0, np.sin(BEND)])
    scene = ac.System()
    scene.world = World()
    scene.first = RigidBody.rod(2.0, (0.5, 0, 0), 0.03, position=(-0.5, 0, 0))
    scene.second = RigidBody.rod(2.0, 0.5 * out, 0.03, position=(0, 0, 0))
    scene.bearing = Revolute.between(scene.world, scene.first, at=(-0.5, 0, 0), axis="x")
    scene.cross = Universal.between(scene.first, scene.second, at=(0, 0, 0), axis_a="y", axis_b=np.cross(out, (0, 1, 0)))
    scene.far_bearing = Revolute.between(scene.world, scene.second, at=0.5 * out, axis=out)
    scene.motor = SpeedSource(SPEED)
    scene.connect(scene.motor.flange, scene.bearing.flange)
    model = ac.build(scene)
    print(model)
    run = model.simulate(3.0, rtol=1e-11)
    given, found = run[scene.bearing.q], run[scene.far_bearing.q]
    # the first fork lies across the plane of the shafts at the start
    exact = np.unwrap(np.arctan2(np.sin(given) * np.cos(BEND), np.cos(given)))
    off = float(np.max(np.abs(found - exact)))
    print(run)
    speed = run[scene.far_bearing.v] / SPEED
    print(
        f"the second shaft turns between {speed.min():.4f} and {speed.max():.4f} times as fast (cosine of the bend: {np.cos(BEND):.4f}); off by {off:.0e} rad"
    )
    run.picture(f"{folder}/universal_joint.png", times=(0.0, 0.2))
    run.animate(f"{folder}/universal_joint.html")
    return off


if __name__ == "__main__":
    main()
