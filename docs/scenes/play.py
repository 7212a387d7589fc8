# Shows Backlash, Freewheel
import numpy as np

import acausal as ac
from components import Backlash, Freewheel, Inertia, TorqueSource

scene = ac.System()
scene.motor, scene.rotor, scene.gear, scene.load = (
    TorqueSource(lambda t: 2 * np.sin(3 * t)),
    Inertia(0.1),
    Inertia(0.05),
    Inertia(0.3),
)
scene.play = Backlash(scene.rotor.flange_b, scene.gear.flange_a, width=0.1)
scene.hub = Freewheel(scene.gear.flange_b, scene.load.flange_a)
scene.connect(scene.motor.flange, scene.rotor.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(3.0)
print(run)
run.plot(scene.rotor.w, scene.load.w, path="picture.png")
