# Shows ElasticStop
import acausal as ac
from components import ElasticStop, HuntCrossley, Prismatic, RigidBody, World

scene = ac.System()
scene.world, scene.slide, scene.wagon = World(), Prismatic("x"), RigidBody.box(mass=0.2, size=(0.2, 0.1, 0.1))
scene.connect(scene.world.frame, scene.slide.frame_a)
scene.connect(scene.slide.frame_b, scene.wagon.frame)
scene.buffer = ElasticStop(scene.slide.flange, lower=0.0, law=HuntCrossley(20.0, damping=0.4, exponent=1))

model = ac.build(scene)
print(model)
run = model.simulate(1.5, {scene.slide.q: 0.5, scene.slide.v: -1.0})
print(run)
run.plot(scene.slide.q, scene.slide.v, scene.buffer.at_lower, path="picture.png")
