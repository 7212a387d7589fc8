# Shows ForceSensor
import acausal as ac
from components import ForceSensor, ForceSource, SlidingMass

scene = ac.System()
scene.push, scene.engine, scene.gauge, scene.wagon = ForceSource(3.0), SlidingMass(1.0), ForceSensor(), SlidingMass(2.0)
scene.connect(scene.push.flange, scene.engine.flange_a)
scene.connect(scene.engine.flange_b, scene.gauge.flange_a)
scene.connect(scene.gauge.flange_b, scene.wagon.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(1.0)
print(run)
print("pull between the two:", run[scene.gauge.force.value][-1], "N")
run.plot(scene.gauge.force.value, scene.wagon.v, path="picture.png")
