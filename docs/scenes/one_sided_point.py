# Shows OneSidedPoint, HardPoint, PointOverCurve
import numpy as np

import acausal as ac
from components import Circle, Particle, PointOnCurve, World

scene = ac.System()
scene.world, scene.car = World((0, -9.81, 0)), Particle(1.0)
scene.loop = PointOnCurve(Circle(0.5), unilateral=True, restitution=0.3, side=(0, 0, -1))
scene.connect(scene.world.frame, scene.loop.frame_a)
scene.connect(scene.loop.frame_b, scene.car.point)

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.loop.q: (-np.pi / 2, 0), scene.car.point.velocity[0]: 4.2})
print(run)
run.plot(scene.loop.gap, scene.loop.normal_force, path="picture.png")
