"""Overhead crane: a load is carried eight metres as fast as can be, and hangs still where it arrives.

The push on the trolley and the pull of the hoist are bounded; the rope must not go slack, and swings by ten degrees at most.

    python examples/control/overhead_crane.py
"""

import numpy as np

import acausal as ac
from components import ForceSource, Prismatic, Revolute, RigidBody, World

LIMIT = 1e-4  # of what main returns


def main(folder: str = "out") -> float:
    """Find the motion; returns by how much it is off when simulated, relative to what each state varies by."""
    scene = ac.System()
    scene.push, scene.pull = ac.Input("N"), ac.Input("N")
    scene.world, scene.rail, scene.swing, scene.rope = (
        World(gravity=(0, 0, -9.81)),
        Prismatic("x"),
        Revolute("y"),
        Prismatic((0, 0, -1)),
    )
    scene.trolley, scene.load = RigidBody.box(200.0, (1.2, 0.6, 0.4)), RigidBody.ball(1000.0, 0.4)
    scene.drive, scene.winch = ForceSource(scene.push), ForceSource(-scene.pull)
    scene.connect(scene.world.frame, scene.rail.frame_a)
    scene.connect(scene.rail.frame_b, scene.trolley.frame, scene.swing.frame_a)
    scene.connect(scene.swing.frame_b, scene.rope.frame_a)
    scene.connect(scene.rope.frame_b, scene.load.frame)
    scene.connect(scene.drive.flange, scene.rail.flange)
    scene.connect(scene.winch.flange, scene.rope.flange)
    model = ac.build(scene)
    ocp = ac.OptimalControl(model, time=ac.free(3, 20, 8))
    ocp.start({scene.rail.q: 0, scene.swing.q: 0, scene.rope.q: 6})
    ocp.at(0.5, {scene.rope.q: (2.0, 4.0)})  # over an obstacle
    ocp.end({scene.rail.q: 8, scene.swing.q: 0, scene.rope.q: 6, scene.rail.v: 0, scene.swing.v: 0, scene.rope.v: 0})
    ocp.bound(scene.push, -3000, 3000)
    ocp.bound(scene.pull, 2000, 15000)
    ocp.bound(scene.swing.q, -np.radians(10), np.radians(10))
    ocp.minimise(ocp.duration)
    best = ocp.solve(30, controls="constant")
    print(best)
    best.run.picture(f"{folder}/overhead_crane.png", times=[part * best.duration for part in (0.0, 0.3, 0.5, 0.7, 1.0)])
    best.run.animate(f"{folder}/overhead_crane.html")
    return best.replay_error


if __name__ == "__main__":
    main()
