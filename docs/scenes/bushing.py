# Shows Bushing
import acausal as ac
from components import Bushing, RigidBody, World

scene = ac.System()
scene.world, scene.engine = World(), RigidBody.box(80.0, (0.6, 0.4, 0.4))
scene.mounts = [Bushing(stiffness=(50, 50, 20, 4e5, 4e5, 2e5), damping=(0, 0, 0, 800, 800, 400)) for _ in range(3)]
for mount, place in zip(scene.mounts, ((0.3, 0.2, -0.2), (0.3, -0.2, -0.2), (-0.3, 0.0, -0.2)), strict=True):
    scene.connect(scene.world.at(place), mount.frame_a)
    scene.connect(mount.frame_b, scene.engine.at(place))

model = ac.build(scene)
print(model)
frame = scene.engine.frame
# let go where the mounts are at rest, it sinks into them and rings down
run = model.simulate(0.6, {frame.position: (0, 0, 0), frame.velocity: (0, 0.2, 0)})
print(run)
run.plot(frame.position[1], frame.position[2], path="picture.png")
