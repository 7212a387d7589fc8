# Shows Table
import acausal as ac
from components import Inertia, SignalTorque, Table, TimeFunction

scene = ac.System()
scene.clock, scene.plan = TimeFunction(lambda t: t), Table((0.0, 1.0, 2.0), (0.0, 0.5, 0.5))
scene.drive, scene.rotor = SignalTorque(), Inertia(0.5)
scene.connect(scene.clock.output, scene.plan.input)
scene.connect(scene.plan.output, scene.drive.signal)
scene.connect(scene.drive.flange, scene.rotor.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(2.0)
print(run)
run.plot(scene.plan.output.value, scene.rotor.w, path="picture.png")
