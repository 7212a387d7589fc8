# Shows PID, RotationSensor, SignalTorque
import acausal as ac
from components import PID, Constant, Revolute, RigidBody, RotationSensor, SignalTorque, World

scene = ac.System()
scene.world, scene.hinge, scene.arm = World(), Revolute(axis="y"), RigidBody.rod(mass=1.0, tip=(0.5, 0, 0))
scene.target, scene.controller = Constant(0.5), PID(proportional=20.0, integral=20.0, derivative=4.0)
scene.encoder, scene.drive = RotationSensor(), SignalTorque()
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.arm.frame)
scene.connect(scene.hinge.flange, scene.encoder.flange, scene.drive.flange)
scene.connect(scene.target.output, scene.controller.setpoint)
scene.connect(scene.encoder.angle, scene.controller.measurement)
scene.connect(scene.controller.output, scene.drive.signal)

model = ac.build(scene)
print(model)
run = model.simulate(5.0)
print(run)
print("angle at the end:", run[scene.hinge.q][-1])
run.plot(scene.hinge.q, path="picture.png")
