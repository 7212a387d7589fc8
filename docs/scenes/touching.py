# Shows Touching, Ellipsoid, Rolling
import acausal as ac
from components import Ellipsoid, HeightField, RigidBody, Rolling, Touching, World

bowl = HeightField(lambda x, y: 0.4 * (x**2 + y**2))

scene = ac.System()
scene.world = World()
scene.contact = Touching(Ellipsoid((0.15, 0.1, 0.08)), bowl, Rolling())
scene.egg = RigidBody.ellipsoid(mass=1.0, semi_axes=(0.15, 0.1, 0.08))
scene.connect(scene.world.frame, scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.egg.frame)

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.egg.frame.position[:2]: ac.near((0.5, 0.1)), scene.contact.v: (0.5, 1.0, 1.0)})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.3, 0.6))
