# Shows Thyristor
import numpy as np

import acausal as ac
from components import Capacitor, Ground, Resistor, Thyristor, VoltageSource

scene = ac.System()
scene.mains, scene.wire, scene.dimmer = (
    VoltageSource(lambda t: 10 * np.sin(314 * t)),
    Resistor(1.0),
    Thyristor(lambda t: np.sin(314 * t - 1) - 0.9),
)
scene.store, scene.lamp, scene.ground = Capacitor(1e-5), Resistor(50.0), Ground()
scene.connect(scene.mains.pin_a, scene.wire.pin_a)
scene.connect(scene.wire.pin_b, scene.dimmer.pin_a)
scene.connect(scene.dimmer.pin_b, scene.store.pin_a, scene.lamp.pin_a)
scene.connect(scene.store.pin_b, scene.lamp.pin_b, scene.mains.pin_b, scene.ground.pin)

model = ac.build(scene)
print(model)
run = model.simulate(0.06, {scene.store.v: 0.0})
print(run)
run.plot(scene.mains.v, scene.lamp.v, path="picture.png")
