# Shows RackAndPinion
import acausal as ac
from components import Prismatic, RackAndPinion, Revolute, RigidBody, World

scene = ac.System()
scene.world = World()
scene.column, scene.rail = Revolute(axis="y"), Prismatic(axis="x")
scene.wheel = RigidBody.disk(mass=1.0, radius=0.1, axis="y")
scene.bar = RigidBody.box(mass=2.0, size=(0.6, 0.03, 0.03))
scene.weight = RigidBody.ball(mass=0.3, radius=0.03)
scene.steering = RackAndPinion(radius=0.1)
scene.connect(scene.world.frame, scene.column.frame_a)
scene.connect(scene.column.frame_b, scene.wheel.frame)
scene.connect(scene.wheel.at((0.1, 0, 0)), scene.weight.frame)
scene.connect(scene.world.at((0, 0, 0.115)), scene.rail.frame_a)
scene.connect(scene.rail.frame_b, scene.bar.frame)
scene.connect(scene.column.flange, scene.steering.pinion)
scene.connect(scene.rail.flange, scene.steering.rack)

model = ac.build(scene)
print(model)
run = model.simulate(3.0)
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
