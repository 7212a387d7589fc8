# Shows SignalVoltage, TimeFunction
import numpy as np

import acausal as ac
from components import Ground, Inductor, Resistor, SignalVoltage, TimeFunction

scene = ac.System()
scene.wave, scene.amplifier = TimeFunction(lambda t: 5 * np.sin(300 * t)), SignalVoltage()
scene.load, scene.winding, scene.ground = Resistor(10.0), Inductor(0.05), Ground()
scene.connect(scene.wave.output, scene.amplifier.signal)
scene.connect(scene.amplifier.pin_a, scene.load.pin_a)
scene.connect(scene.load.pin_b, scene.winding.pin_a)
scene.connect(scene.winding.pin_b, scene.amplifier.pin_b, scene.ground.pin)

model = ac.build(scene)
print(model)
run = model.simulate(0.05)
print(run)
run.plot(scene.amplifier.v, scene.load.v, path="picture.png")
