# Shows DCMotor
import acausal as ac
from components import DCMotor, Ground, Revolute, RigidBody, VoltageSource, World

scene = ac.System()
scene.world, scene.hinge, scene.arm = World(), Revolute(axis="y"), RigidBody.rod(mass=0.5, tip=(0, 0, -0.4))
scene.motor = DCMotor(constant=0.05, resistance=1.2, inductance=1e-3, inertia=2e-5, ratio=50)
scene.battery, scene.ground = VoltageSource(6.0), Ground()
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.arm.frame)
scene.connect(scene.motor.flange, scene.hinge.flange)
scene.connect(scene.battery.pin_a, scene.motor.pin_a)
scene.connect(scene.battery.pin_b, scene.motor.pin_b, scene.ground.pin)

model = ac.build(scene)
print(model)
run = model.simulate(3.0)
print(run)
run.plot(scene.hinge.v, path="picture.png")
