# Shows Clutch
import acausal as ac
from components import Clutch, Inertia, TorqueSource

scene = ac.System()
scene.motor, scene.rotor, scene.load = TorqueSource(2.0), Inertia(0.1), Inertia(0.3)
scene.pressure = ac.Input("Pa")
scene.clutch = Clutch(scene.rotor.flange_b, scene.load.flange_a, capacity=3e-5 * scene.pressure)
scene.connect(scene.motor.flange, scene.rotor.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(3.0, {scene.rotor.w: 50.0, scene.load.w: 0.0}, inputs={scene.pressure: lambda t: 2e5 * t})
print(run)
run.plot(scene.rotor.w, scene.load.w, path="picture.png")
