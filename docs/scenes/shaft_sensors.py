# Shows TorqueSensor, RelativeRotationSensor
import acausal as ac
from components import Inertia, RelativeRotationSensor, RotationalSpring, TorqueSensor, TorqueSource

scene = ac.System()
scene.motor, scene.rotor, scene.load = TorqueSource(0.1), Inertia(0.01), Inertia(0.02)
scene.shaft, scene.gauge, scene.twist = RotationalSpring(stiffness=5.0), TorqueSensor(), RelativeRotationSensor()
scene.connect(scene.motor.flange, scene.rotor.flange_a)
scene.connect(scene.rotor.flange_b, scene.gauge.flange_a)
scene.connect(scene.gauge.flange_b, scene.shaft.flange_a, scene.twist.flange_a)
scene.connect(scene.shaft.flange_b, scene.load.flange_a, scene.twist.flange_b)

model = ac.build(scene)
print(model)
run = model.simulate(1.0)
print(run)
run.plot(scene.gauge.torque.value, scene.twist.angle.value, path="picture.png")
