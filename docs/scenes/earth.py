# Shows RotatingEarth
import numpy as np

import acausal as ac
from components import Particle, RotatingEarth

# a stone falls 100 m at a latitude of 45 degrees, and lands to the east
scene = ac.System()
scene.earth, scene.stone = RotatingEarth(), Particle(mass=1.0)
scene.pad = scene.earth.level(np.pi / 4, 0.0)

model = ac.build(scene)
print(model)
print(model.state_names)
run = model.simulate(1.0, {scene.stone.point.position: (6371100.0 * np.cos(np.pi / 4), 0.0, 6371100.0 * np.sin(np.pi / 4))})
print(run)
run.plot(scene.stone.point.position, path="picture.png")
