"""A double wishbone with a rack: two arms, an upright, a tie rod, a spring, and a wheel that is steered while its spring moves.

Ball joints hold the upright at the tips of the arms; the tie rod has no mass. The rack is moved to and fro, the chassis stands still, and a force under
the wheel lifts it. The wheel spins freely.
"""

import casadi as ca
import numpy as np

import acausal as ac
from components import Force, PositionSource, Prismatic, Revolute, RigidBody, Rod, Spherical, SpringDamper, World

LIMIT = 1e-9  # of what main returns

LOWER_TIP, UPPER_TIP = np.array([0.0, 0.75, 0.2]), np.array([-0.02, 0.70, 0.5])  # y to the left, x ahead, z up [m]
LOWER_AXLE, UPPER_AXLE = np.array([0.0, 0.35, 0.22]), np.array([-0.02, 0.42, 0.47])
ARM_OF_STEERING, RACK_END = np.array([-0.14, 0.73, 0.28]), np.array([-0.14, 0.36, 0.29])
HUB = np.array([0.0, 0.76, 0.33])


def main(folder: str = "out") -> float:
    """Three seconds; returns how far energy and the distance of the ball joints are off."""
    scene = ac.System()
    scene.world = World()
    scene.lower = RigidBody.rod(6.0, LOWER_TIP - LOWER_AXLE, 0.02, position=LOWER_AXLE)
    scene.upper = RigidBody.rod(4.0, UPPER_TIP - UPPER_AXLE, 0.02, position=UPPER_AXLE)
    scene.upright = RigidBody.rod(10.0, UPPER_TIP - LOWER_TIP, 0.03, position=LOWER_TIP)
    scene.wheel = RigidBody.cylinder(18.0, 0.3, 0.18, axis="y", position=HUB)
    scene.rack = RigidBody.rod(2.0, (0, -2 * RACK_END[1], 0), 0.015, position=RACK_END)

    scene.lower_bush = Revolute.between(scene.world, scene.lower, at=LOWER_AXLE, axis="x")
    scene.upper_bush = Revolute.between(scene.world, scene.upper, at=UPPER_AXLE, axis="x")
    scene.lower_ball = Spherical.between(scene.lower, scene.upright, at=LOWER_TIP)
    scene.upper_ball = Spherical.between(scene.upper, scene.upright, at=UPPER_TIP)
    scene.bearing = Revolute.between(scene.upright, scene.wheel, at=HUB, axis="y")
    scene.guide = Prismatic.between(scene.world, scene.rack, at=RACK_END, axis="y")
    scene.steering = PositionSource(lambda t: 0.04 * ca.sin(2 * t))
    scene.connect(scene.guide.flange, scene.steering.flange)
    scene.tie_rod = Rod(float(np.linalg.norm(ARM_OF_STEERING - RACK_END)))
    scene.connect(scene.rack.frame, scene.tie_rod.frame_a)
    scene.connect(scene.tie_rod.frame_b, scene.upright.at(ARM_OF_STEERING - LOWER_TIP))
    scene.strut = SpringDamper(stiffness=4e4, natural_length=0.5, damping=2e3)
    scene.connect(scene.world.at((0, 0.5, 0.66)), scene.strut.point_a)
    scene.connect(scene.strut.point_b, scene.lower.at(0.7 * (LOWER_TIP - LOWER_AXLE)))
    scene.load = Force(lambda t: (0, 0, 3000.0 + 800 * ca.sin(5 * t)))
    scene.connect(scene.load.point, scene.wheel.frame)

    model = ac.build(scene)
    print(model)
    run = model.simulate(3.0, {scene.bearing.v: 40.0}, rtol=1e-10)
    balls = run[scene.upright.tip.position] - run[scene.lower.tip.position]
    off = float(np.max(np.abs(np.linalg.norm(balls, axis=1) - np.linalg.norm(UPPER_TIP - LOWER_TIP))))
    axle = run[scene.upright.frame.rotation][:, :, 1]
    toe, camber = np.degrees(np.arctan2(-axle[:, 0], axle[:, 1])), np.degrees(np.arcsin(axle[:, 2]))
    print(run)
    print(
        f"hub from {run[scene.wheel.frame.position][:, 2].min():.3f} to {run[scene.wheel.frame.position][:, 2].max():.3f} m high"
    )
    print(
        f"steered from {toe.min():.1f} to {toe.max():.1f} degrees, camber from {camber.min():.2f} to {camber.max():.2f} degrees"
    )
    print(f"ball joints keep their distance to {off:.0e} m; energy, damper and drives accounted for to {run.energy_error():.0e}")
    run.picture(f"{folder}/double_wishbone.png", times=(0.0, 0.8))
    run.animate(f"{folder}/double_wishbone.html")
    return max(off, run.energy_error())


if __name__ == "__main__":
    main()
