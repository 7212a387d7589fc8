# Shows Ground, Resistor, Capacitor, VoltageSource
import acausal as ac
from components import Capacitor, Ground, Resistor, VoltageSource

scene = ac.System()
scene.battery, scene.load, scene.filter, scene.ground = VoltageSource(12.0), Resistor(100.0), Capacitor(1e-4), Ground()
scene.connect(scene.battery.pin_a, scene.load.pin_a)
scene.connect(scene.load.pin_b, scene.filter.pin_a)
scene.connect(scene.filter.pin_b, scene.battery.pin_b, scene.ground.pin)

model = ac.build(scene)
print(model)
run = model.simulate(0.05, {scene.filter.v: 0.0})
print(run)
run.plot(scene.filter.v, scene.load.v, path="picture.png")
