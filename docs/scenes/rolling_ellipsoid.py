# Shows RollingEllipsoid
import acausal as ac
from components import RigidBody, RollingEllipsoid, World

scene = ac.System()
scene.world = World()
scene.contact = RollingEllipsoid(semi_axes=(0.2, 0.06, 0.04))
scene.egg = RigidBody.ellipsoid(mass=1.0, semi_axes=(0.2, 0.06, 0.04))
scene.connect(scene.world.frame, scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.egg.frame)

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.contact.v: (0.1, 0.4, 4.0)})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.3, 0.6))
