# Shows IdealDiode
import numpy as np

import acausal as ac
from components import Capacitor, Ground, IdealDiode, Resistor, VoltageSource

scene = ac.System()
scene.mains, scene.wire, scene.diode = VoltageSource(lambda t: 10 * np.sin(314 * t)), Resistor(1.0), IdealDiode()
scene.store, scene.load, scene.ground = Capacitor(1e-3), Resistor(50.0), Ground()
scene.connect(scene.mains.pin_a, scene.wire.pin_a)
scene.connect(scene.wire.pin_b, scene.diode.pin_a)
scene.connect(scene.diode.pin_b, scene.store.pin_a, scene.load.pin_a)
scene.connect(scene.store.pin_b, scene.load.pin_b, scene.mains.pin_b, scene.ground.pin)

model = ac.build(scene)
print(model)
run = model.simulate(0.1, {scene.store.v: 0.0})
print(run)
run.plot(scene.store.v, scene.diode.i, path="picture.png")
