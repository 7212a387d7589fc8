# Shows CamFollower
import numpy as np

import acausal as ac
from components import CamFollower, Inertia, SlidingMass, TorqueSource, TranslationalGround, TranslationalSpring

scene = ac.System()
scene.motor, scene.wheel, scene.cam = TorqueSource(0.02), Inertia(0.002), CamFollower(lambda phi: 0.01 * (1 - np.cos(phi)))
scene.valve, scene.spring, scene.head = SlidingMass(0.2), TranslationalSpring(stiffness=500.0), TranslationalGround()
scene.connect(scene.motor.flange, scene.wheel.flange_a)
scene.connect(scene.wheel.flange_b, scene.cam.shaft)
scene.connect(scene.cam.follower, scene.valve.flange_a)
scene.connect(scene.valve.flange_b, scene.spring.flange_b)
scene.connect(scene.spring.flange_a, scene.head.flange)

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.wheel.w: 20.0})
print(run)
print(f"energy accounted for to {run.energy_error():.0e}")
run.plot(scene.valve.s, path="picture.png")
