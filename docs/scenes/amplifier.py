# Shows OperationalAmplifier
import numpy as np

import acausal as ac
from components import Capacitor, Ground, OperationalAmplifier, Resistor, VoltageSource

# an inverting integrator
scene = ac.System()
scene.source, scene.ground = VoltageSource(lambda t: np.sin(10 * t)), Ground()
scene.inlet, scene.feedback, scene.load = Resistor(1e4), Capacitor(1e-5), Resistor(1e3)
scene.amplifier = OperationalAmplifier()
scene.connect(scene.source.pin_a, scene.inlet.pin_a)
scene.connect(scene.inlet.pin_b, scene.amplifier.minus, scene.feedback.pin_b)
scene.connect(scene.amplifier.output, scene.feedback.pin_a, scene.load.pin_a)
scene.connect(scene.amplifier.plus, scene.source.pin_b, scene.load.pin_b, scene.ground.pin)

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.feedback.v: 0.0})
print(run)
run.plot(scene.source.v, scene.load.v, path="picture.png")
