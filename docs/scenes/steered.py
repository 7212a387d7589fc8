# Shows SteeredAxle
import numpy as np

import acausal as ac
from components import Planar, RigidBody, SteeredAxle, World

scene = ac.System()
scene.world, scene.ground = World(), Planar(normal="z")
scene.car = RigidBody.box(mass=1000.0, size=(3.6, 1.6, 1.0))
scene.front, scene.rear = SteeredAxle(steer=lambda t: 0.3 * np.sin(t)), SteeredAxle()
scene.connect(scene.world.frame, scene.ground.frame_a, scene.front.road, scene.rear.road)
scene.connect(scene.ground.frame_b, scene.car.frame)
scene.connect(scene.car.at((1.3, 0, 0)), scene.front.chassis)
scene.connect(scene.car.at((-1.3, 0, 0)), scene.rear.chassis)

model = ac.build(scene)
print(model)
run = model.simulate(4.0, {scene.ground.v[0]: 5.0})
print(run)
run.picture("picture.png", times=(0.0, 1.5, 3.0))
