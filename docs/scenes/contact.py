# Shows Contact, ContactForce, HuntCrossley
import acausal as ac
from components import Contact, HuntCrossley, Plane, RigidBody, Sphere, World

scene = ac.System()
scene.world = World()
scene.bump = Contact(Sphere(0.1), Plane(), HuntCrossley(1e5))
scene.ball = RigidBody.ball(mass=0.5, radius=0.1)
scene.connect(scene.world.frame, scene.bump.frame_a)
scene.connect(scene.bump.frame_b, scene.ball.frame)

model = ac.build(scene)
print(model)
run = model.simulate(1.5, {scene.ball.frame.position: (0, 0, 0.6), scene.ball.frame.velocity: (0.5, 0, 0)})
print(run)
run.picture("picture.png", times=(0.0, 0.5, 1.0))
