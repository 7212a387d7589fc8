# Shows CentralField
import numpy as np

import acausal as ac
from components import CentralField, Particle, World

scene = ac.System()
scene.world = World(gravity=None)
scene.sun = CentralField(mu=1.0)
scene.planet = Particle(mass=1.0)

model = ac.build(scene)
print(model)
# from the near end of an ellipse with semi-major axis 1 and eccentricity 0.5, once around
run = model.simulate(2 * np.pi, {scene.planet.point.position: (0.5, 0, 0), scene.planet.point.velocity: (0, np.sqrt(3.0), 0)})
print(run)
back = run[scene.planet.point.position][-1] - (0.5, 0, 0)
print(f"after one period it is back to {np.linalg.norm(back):.0e}")
run.picture("picture.png", times=(0.0, 1.0, 2.0, 3.0))
