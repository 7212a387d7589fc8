# Shows Ratchet
import numpy as np

import acausal as ac
from components import Inertia, Ratchet, RotationalGround, TorqueSource

scene = ac.System()
scene.motor, scene.drum, scene.base = TorqueSource(lambda t: 0.3 * np.cos(3 * t)), Inertia(0.1), RotationalGround()
scene.pawl = Ratchet(scene.base.flange, scene.drum.flange_b, pitch=0.3)
scene.connect(scene.motor.flange, scene.drum.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(5.0)
print(run.transitions)
run.plot(scene.drum.phi, scene.pawl.tooth, path="picture.png")
