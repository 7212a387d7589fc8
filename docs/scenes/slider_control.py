# Shows TranslationSensor, SignalForce, Sum, Gain
import acausal as ac
from components import Constant, Gain, Prismatic, RigidBody, SignalForce, Sum, TranslationSensor, World

scene = ac.System()
scene.world, scene.rail, scene.cart = World(), Prismatic(axis="x"), RigidBody.box(mass=2.0, size=(0.3, 0.1, 0.1))
scene.target, scene.error, scene.amplifier = Constant(0.5), Sum(1.0, -1.0, -0.7), Gain(10.0)
scene.scale, scene.drive = TranslationSensor(), SignalForce()
scene.connect(scene.world.frame, scene.rail.frame_a)
scene.connect(scene.rail.frame_b, scene.cart.frame)
scene.connect(scene.rail.flange, scene.scale.flange, scene.drive.flange)
scene.connect(scene.target.output, scene.error.inputs[0])
scene.connect(scene.scale.position, scene.error.inputs[1])
scene.connect(scene.scale.speed, scene.error.inputs[2])
scene.connect(scene.error.output, scene.amplifier.input)
scene.connect(scene.amplifier.output, scene.drive.signal)

model = ac.build(scene)
print(model)
run = model.simulate(5.0)
print(run)
run.plot(scene.rail.q, scene.drive.signal.value, path="picture.png")
