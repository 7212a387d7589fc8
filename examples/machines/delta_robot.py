"""A delta robot: three arms, three pairs of rods, and a platform that moves in all directions without ever turning.

The rods have no mass and ball joints at both ends. Each pair is a parallelogram; three of them hold the platform's orientation, which no part says.
R. Clavel, DELTA, a fast robot with parallel geometry, 18th International Symposium on Industrial Robots (1988).
"""

import numpy as np

import acausal as ac
from components import Revolute, RigidBody, Rod, TorqueSource, World

LIMIT = 1e-10  # of what main returns

BASE, ARM, FOREARM, HAND, WIDTH = 0.2, 0.3, 0.7, 0.05, 0.04


def main(folder: str = "out") -> float:
    """One second with three torques; returns how far the platform turns [rad] and the three spheres are missed [m]."""
    scene = ac.System()
    scene.world, scene.torques = World(), [ac.Input("N*m") for _ in range(3)]
    depth = np.sqrt(FOREARM**2 - (BASE + ARM - HAND) ** 2)
    scene.platform = RigidBody.cylinder(0.5, HAND, 0.02, position=(0, 0, -depth))
    scene.arms, scene.hinges, scene.motors, scene.rods = [], [], [], []
    for k in range(3):
        angle = 2 * np.pi * k / 3
        out, side = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
        arm = RigidBody.rod(0.4, ARM * out, position=BASE * out)
        scene.arms.append(arm)
        scene.hinges.append(Revolute.between(scene.world, arm, at=BASE * out, axis=side))
        scene.motors.append(TorqueSource(scene.torques[k]))
        scene.connect(scene.motors[k].flange, scene.hinges[k].flange)
        for way in (-WIDTH, WIDTH):
            scene.rods.append(Rod(FOREARM))
            scene.connect(arm.at(ARM * out + way * side), scene.rods[-1].frame_a)
            scene.connect(scene.rods[-1].frame_b, scene.platform.at(HAND * out + way * side))

    model = ac.build(scene)
    print(model)
    # about what holds the weight, and a little more or less
    pushes = {u: -1.08 + 0.25 * np.sin(6 * ac.time + 2 * np.pi * k / 3) for k, u in enumerate(scene.torques)}
    run = model.simulate(1.0, {hinge.q: ac.near(0.0) for hinge in scene.hinges}, inputs=pushes, rtol=1e-10)
    turn = float(np.max(np.abs(run[scene.platform.frame.rotation] - np.eye(3))))
    place, off = run[scene.platform.frame.position], 0.0
    for k, arm in enumerate(scene.arms):
        out = np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0])
        off = max(off, float(np.max(np.abs(np.linalg.norm(place + HAND * out - run[arm.tip.position], axis=1) - FOREARM))))
    print(run)
    print(
        f"the platform moves over {np.ptp(place, axis=0).round(3)} m and turns by {turn:.0e} rad; on its three spheres to {off:.0e} m"
    )
    run.picture(f"{folder}/delta_robot.png", times=(0.0, 0.5, 1.0))
    run.animate(f"{folder}/delta_robot.html")
    return max(turn, off)


if __name__ == "__main__":
    main()
