# Shows Tendon, TotalLength
import acausal as ac
from components import ForceSource, Revolute, RigidBody, RotationalDamper, RotationalGround, Tendon, World

scene = ac.System()
scene.world, scene.elbow = World(), Revolute(axis="y")
scene.upper, scene.fore = RigidBody.rod(mass=2.0, tip=(0, 0, -0.3)), RigidBody.rod(mass=1.5, tip=(0, 0, -0.28))
scene.connect(scene.world.frame, scene.upper.frame)
scene.connect(scene.upper.tip, scene.elbow.frame_a)
scene.connect(scene.elbow.frame_b, scene.fore.frame)
scene.joint, scene.ground = RotationalDamper(0.3), RotationalGround()
scene.connect(scene.joint.flange_a, scene.ground.flange)
scene.connect(scene.joint.flange_b, scene.elbow.flange)
scene.tendon, scene.muscle = Tendon(over=(scene.upper.at((0.03, 0, -0.26)),)), ForceSource(-60.0)
scene.connect(scene.upper.at((0.01, 0, -0.02)), scene.tendon.frame_a)
scene.connect(scene.tendon.frame_b, scene.fore.at((0.02, 0, -0.05)))
scene.connect(scene.muscle.flange, scene.tendon.flange)

model = ac.build(scene)
print(model)
run = model.simulate(2.0)
print(run)
run.plot(scene.elbow.q, scene.tendon.flange.s, path="picture.png")
