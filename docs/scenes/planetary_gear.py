# Shows PlanetaryGear, RotationalGround
import acausal as ac
from components import Inertia, PlanetaryGear, RotationalGround, TorqueSource

scene = ac.System()
scene.motor, scene.rotor = TorqueSource(0.1), Inertia(0.001)
scene.gear, scene.housing, scene.load = PlanetaryGear(ratio=100 / 50), RotationalGround(), Inertia(0.02)
scene.connect(scene.motor.flange, scene.rotor.flange_a)
scene.connect(scene.rotor.flange_b, scene.gear.sun)
scene.connect(scene.housing.flange, scene.gear.ring)
scene.connect(scene.gear.carrier, scene.load.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(2.0)
print(run)
print("sun against carrier:", run[scene.rotor.w][-1] / run[scene.load.w][-1])
run.plot(scene.rotor.w, scene.load.w, path="picture.png")
