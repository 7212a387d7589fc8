# Shows Rope, LimitedSum
import acausal as ac
from components import Particle, Rope, World

scene = ac.System()
scene.world, scene.bob = World(), Particle(1.0)
scene.string = Rope(length=1.0)
scene.connect(scene.world.frame, scene.string.frame_a)
scene.connect(scene.string.frame_b, scene.bob.point)

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.bob.point.position: (0, 0, -1), scene.bob.point.velocity: (5.5, 0, 0)})
print(run)
run.plot(scene.string.slack, scene.string.tension, path="picture.png")
