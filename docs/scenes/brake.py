# Shows Brake, EndStop
import acausal as ac
from components import Brake, EndStop, Revolute, RigidBody, World

scene = ac.System()
scene.world, scene.hinge, scene.arm = World(), Revolute(axis="y"), RigidBody.rod(mass=0.5, tip=(0, 0, -0.4))
scene.bearing = Brake(scene.hinge.flange, capacity=0.02, holding=0.03)
scene.stop = EndStop(scene.hinge.flange, lower=-0.5, restitution=0.6)
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.arm.frame)

model = ac.build(scene)
print(model)
run = model.simulate(10.0, {scene.hinge.q: 1.2})
print(run)
run.plot(scene.hinge.q, path="picture.png")
