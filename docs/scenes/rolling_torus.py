# Shows RollingTorus
import acausal as ac
from components import RigidBody, RollingTorus, World

scene = ac.System()
scene.world = World()
scene.contact = RollingTorus(radius=0.25, tube=0.05, axis="y")
scene.wheel = RigidBody.disk(mass=2.0, radius=0.3, axis="y")
scene.connect(scene.world.frame, scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.wheel.frame)

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.contact.q: (0.0, 0.2, 0.0, 0.0, 0.0), scene.contact.v: (0.0, 6.0, 1.0)})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0, 1.5))
