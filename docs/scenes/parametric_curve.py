# Shows ParametricCurve
import casadi as ca

import acausal as ac
from components import ParametricCurve, Particle, PointOnCurve, World

# Huygens' cycloid: the period does not depend on the amplitude
cycloid = ParametricCurve(lambda s: (s - ca.sin(s), 0, ca.cos(s)), unit="rad")

scene = ac.System()
scene.world, scene.wire, scene.bead = World(), PointOnCurve(cycloid), Particle(mass=0.1)
scene.connect(scene.world.frame, scene.wire.frame_a)
scene.connect(scene.wire.frame_b, scene.bead.point)

model = ac.build(scene)
print(model)
run = model.simulate(4.0, {scene.wire.q: 2.0})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
