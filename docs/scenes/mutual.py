# Shows MutualGravitation
import numpy as np

import acausal as ac
from components import MutualGravitation, Particle, World

# three equal stars at the corners of a turning triangle, as Lagrange found
scene = ac.System()
scene.world, scene.gravitation = World(gravity=None), MutualGravitation(constant=1.0)
scene.stars = [Particle(mass=1.0) for _ in range(3)]

model = ac.build(scene)
print(model)
rate, start = 3**-0.25, {}
for k, star in enumerate(scene.stars):
    out = np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0])
    start |= {star.point.position: out, star.point.velocity: rate * np.cross([0, 0, 1], out)}
run = model.simulate(3.0, start)
print(run)
print(f"distance from the middle: {np.linalg.norm(run[scene.stars[0].point.position][-1]):.9f}")
run.picture("picture.png", times=(0.0, 1.0, 2.0))
