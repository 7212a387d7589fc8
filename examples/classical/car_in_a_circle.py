"""A car in a circle: two axles that do not move across themselves leave it one way to go.

Their lines meet in the centre of a circle, whose radius is the wheelbase by the tangent of the steering angle; nothing brakes. Both constraints are of velocities, but with
the steering held one way is left, and what is left of one freedom can be integrated: that is the circle. O'Reilly, Intermediate Dynamics for Engineers, 8.3 and chapter 11.
"""

import numpy as np

import acausal as ac
from components import Planar, RigidBody, SteeredAxle, World

LIMIT = 1e-9  # of what main returns

BEFORE, BEHIND, STEER, SPEED = 1.1, 1.5, 0.3, 8.0


def main(folder: str = "out") -> float:
    """Once round and more; returns how far the path, its rate and the push of an axle are off, as part of what they are."""
    scene = ac.System()
    scene.world, scene.ground = World(), Planar(normal="z")
    scene.car = RigidBody.box(mass=1000.0, size=(3.6, 1.6, 0.8))
    scene.front, scene.rear = SteeredAxle(steer=STEER), SteeredAxle()
    scene.connect(scene.world.frame, scene.ground.frame_a, scene.front.road, scene.rear.road)
    scene.connect(scene.ground.frame_b, scene.car.frame)
    scene.connect(scene.car.at((BEFORE, 0, 0)), scene.front.chassis)
    scene.connect(scene.car.at((-BEHIND, 0, 0)), scene.rear.chassis)
    model = ac.build(scene)
    print(model)
    print(model.constraints())
    radius = (BEFORE + BEHIND) / np.tan(STEER)
    run = model.simulate(10.0, {scene.car.at((-BEHIND, 0, 0)).velocity[0]: SPEED}, rtol=1e-11)
    rear = scene.car.at((-BEHIND, 0, 0))
    path = run[rear.position]
    off = np.max(np.abs(np.linalg.norm(path - (-BEHIND, radius, 0), axis=1) - radius)) / radius
    rate = np.max(np.abs(run[scene.ground.v][:, 2] - SPEED / radius)) * radius / SPEED
    print(run)
    print(f"radius {radius:.6f} m, kept to {off:.0e} of it; turning rate to {rate:.0e}, energy to {run.energy_error():.0e}")
    run.picture(f"{folder}/car_in_a_circle.png", times=(0.0, 1.5, 3.0))
    run.animate(f"{folder}/car_in_a_circle.html")
    return float(max(off, rate, run.energy_error()))


if __name__ == "__main__":
    main()
