# Shows JointFriction
import acausal as ac
from components import Coulomb, JointFriction, Revolute, RigidBody, World

scene = ac.System()
scene.world, scene.hinge = World(), Revolute(axis="y")
scene.rod = RigidBody.rod(mass=1.0, tip=(0, 0, -0.5))
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.rod.frame)
scene.bearing = JointFriction(scene.hinge, Coulomb(0.3), radius=0.02)

model = ac.build(scene)
print(model)
# swings become smaller by the same angle each time, until the bearing holds
run = model.simulate(6.0, {scene.hinge.q: 0.4})
print(run)
run.plot(scene.hinge.q, path="picture.png")
