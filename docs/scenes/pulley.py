# Shows Pulley, Tangent, CommonTangent, RopeOverWheels
import numpy as np

import acausal as ac
from components import Cable, Particle, Prismatic, Pulley, RigidBody, World

scene = ac.System()
scene.world, scene.rail, scene.load, scene.weight = World(), Prismatic("z"), RigidBody.box(3.0, (0.3, 0.1, 0.1)), Particle(2.0)
scene.small, scene.large = RigidBody.disk(0.4, 0.1, axis="y"), RigidBody.disk(0.9, 0.15, axis="y")
# from the ceiling around under the load's pulley, up and over a fixed one, down to a weight
loose = Pulley(scene.load.frame, 0.1, middle=(0, 0, -1), along=(1, 0, 0), wheel=scene.small)
fixed = Pulley(scene.world.at((0.25, 0, 2)), 0.15, middle=(0, 0, 1), along=(1, 0, 0), wheel=scene.large)
scene.rope = Cable(length=3.4 + np.pi * 0.25 + 1.1, over=(loose, fixed))
scene.connect(scene.world.at((-0.1, 0, 2)), scene.rope.frame_a)
scene.connect(scene.rope.frame_b, scene.weight.point)
scene.connect(scene.world.frame, scene.rail.frame_a)
scene.connect(scene.rail.frame_b, scene.load.frame)

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.rail.q: 0.3, scene.weight.point.position: (0.4, 0, 0.9)})
print(run)
run.picture("picture.png", times=(0.0, 0.5, 1.0))
