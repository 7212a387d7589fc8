# Shows FlexibleBody, ShapeIntegrals
import numpy as np

import acausal as ac
from components import FlexibleBody, Revolute, World

# four lumped masses along x; one shape, in which they bend along z as the square of x
places = np.array([[0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0], [0.4, 0.01, 0]])
shapes = np.zeros((4, 3, 1))
shapes[:, 2, 0] = (places[:, 0] / 0.4) ** 2

scene = ac.System()
scene.world, scene.hinge = World(), Revolute(axis="y")
scene.arm = FlexibleBody.lumped(np.full(4, 0.1), places, shapes, [[20.0]], tip=places[-1], tip_shapes=shapes[-1])
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.arm.frame_a)

model = ac.build(scene)
print(model)
run = model.simulate(1.0)
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.plot(scene.arm.q, path="picture.png")
