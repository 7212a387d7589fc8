# Shows PointOnPlane
import acausal as ac
from components import PointOnPlane, RigidBody, World

scene = ac.System()
scene.world, scene.foot = World(), PointOnPlane()
scene.top = RigidBody.disk(mass=0.2, radius=0.05, rotation=("x", 0.2))
scene.connect(scene.world.frame, scene.foot.frame_a)
scene.connect(scene.foot.frame_b, scene.top.at((0, 0, -0.05)))

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.foot.v: (0.0, 0.0, 150.0, 0.1, 0.0)})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0))
