# Shows RoughGuide
import acausal as ac
from components import Circle, Coulomb, Particle, PointOnCurve, World

scene = ac.System()
scene.world, scene.bead = World((0, -9.81, 0)), Particle(0.1)
scene.hoop = PointOnCurve(Circle(0.5), friction=Coulomb(0.2))
scene.connect(scene.world.frame, scene.hoop.frame_a)
scene.connect(scene.hoop.frame_b, scene.bead.point)

model = ac.build(scene)
print(model)
# thrown from the bottom: it rises, turns back, and is slower at each pass
run = model.simulate(1.0, {scene.hoop.q: -1.57, scene.hoop.v: 8.0})
print(run)
run.plot(scene.hoop.q, scene.hoop.v, path="picture.png")
