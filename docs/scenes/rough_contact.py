# Shows RoughContact
import acausal as ac
from components import Coulomb, Plane, RigidBody, RoughContact, Sphere, World

scene = ac.System()
scene.world, scene.ball = World(), RigidBody.ball(6.0, 0.11)
scene.contact = RoughContact(Sphere(0.11), Plane(), Coulomb(0.2))
scene.connect(scene.world.frame, scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.ball.frame)

model = ac.build(scene)
print(model)
f = scene.ball.frame
run = model.simulate(2.0, {f.velocity[0]: 5.0, f.angular_velocity: (0, 0, 0)})  # thrown without spin
print(run.transitions)
print(f"it rolls with {run[f.velocity[0]][-1]:.9f} m/s, five sevenths of the speed that it had")
print(f"energy accounted for to {run.energy_error():.0e}")
run.plot(f.velocity[0], scene.contact.slip[0], path="picture.png")
