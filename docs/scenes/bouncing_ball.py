# Shows SmoothCoulomb
import acausal as ac
from components import Contact, HuntCrossley, Plane, RigidBody, SmoothCoulomb, Sphere, World

scene = ac.System()
scene.world = World()
scene.ball = RigidBody.ball(mass=1.0, radius=0.1)
scene.contact = Contact(Sphere(0.1), Plane(), HuntCrossley(1e6, damping=0.3, friction=SmoothCoulomb(0.3, speed=1e-2)))
scene.connect(scene.world.frame, scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.ball.frame)

model = ac.build(scene)
print(model)
run = model.simulate(1.5, {scene.ball.frame.position: (0, 0, 0.5), scene.ball.frame.velocity: (1.0, 0, 0)})
print(run)
print(f"deepest {-float(run[scene.contact.gap].min()) * 1e3:.2f} mm, energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
