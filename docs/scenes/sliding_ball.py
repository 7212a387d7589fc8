# Shows Viscous, Creep
import acausal as ac
from components import Contact, Creep, Plane, RigidBody, Sphere, Viscous, World

scene = ac.System()
scene.world = World()
scene.both = [Viscous(2.0), Creep(stiffness=4.0, limit=1.0, speed=1.0)]
scene.contacts = [Contact(Sphere(0.1), Plane(), law) for law in scene.both]
scene.balls = [RigidBody.ball(mass=1.0, radius=0.1) for _ in scene.both]
for k, contact in enumerate(scene.contacts):
    scene.connect(scene.world.at((0, 0.3 * k, 0)), contact.frame_a)
    scene.connect(contact.frame_b, scene.balls[k].frame)

model = ac.build(scene)
print(model)
run = model.simulate(3.0, {contact.v: (0, 0, 0, 1.0, 0) for contact in scene.contacts})
print(run)
for ball in scene.balls:
    print(f"ends with {float(run[ball.frame.velocity][-1, 0]):.4f} m/s; rolling has 5/7 of the first metre per second")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
