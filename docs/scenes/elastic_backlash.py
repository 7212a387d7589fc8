# Shows ElasticBacklash, ElasticCoupling
import numpy as np

import acausal as ac
from components import ElasticBacklash, ElasticCoupling, HuntCrossley, Inertia, TorqueSource

scene = ac.System()
scene.engine, scene.clutch, scene.gearbox = Inertia(0.2), Inertia(0.02), Inertia(0.05)
scene.torque = TorqueSource(lambda t: 2.0 * np.cos(20 * t))
scene.connect(scene.torque.flange, scene.engine.flange_a)
scene.damper = ElasticCoupling(scene.engine.flange_b, scene.clutch.flange_a, lambda x: 400 * x**2 + 6e3 * x**4, damping=0.5)
scene.teeth = ElasticBacklash(scene.clutch.flange_b, scene.gearbox.flange_a, width=0.01, law=HuntCrossley(2e4, 0.1, exponent=1))

model = ac.build(scene)
print(model)
run = model.simulate(0.5)
print(run)
run.plot(scene.engine.w, scene.gearbox.w, scene.teeth.at_lower, path="picture.png")
