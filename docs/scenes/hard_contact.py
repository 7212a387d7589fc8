# Shows HardContact, Hard, Coulomb
import acausal as ac
from components import Contact, Coulomb, Hard, Plane, RigidBody, Sphere, World

scene = ac.System()
scene.world, scene.ball = World(), RigidBody.ball(1.0, 0.1)
scene.floor = Contact(Sphere(0.1), Plane(), Hard(friction=Coulomb(0.2, static=0.3)))
scene.connect(scene.world.frame, scene.floor.frame_a)
scene.connect(scene.floor.frame_b, scene.ball.frame)

model = ac.build(scene)
print(model)
frame = scene.ball.frame
run = model.simulate(1.5, {frame.position: (0, 0, 0.6), frame.velocity: (1.0, 0, 0)})
print(run)
run.plot(scene.floor.gap, frame.velocity[0], 0.1 * frame.angular_velocity[1], path="picture.png")
