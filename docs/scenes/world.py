# Shows World, Fixed, Free
import acausal as ac
from components import Fixed, Free, RigidBody, World

scene = ac.System()
scene.world = World(gravity=(0, 0, -9.81))
scene.corner = Fixed((0.5, 0, 0), rotation=("z", 0.3))
scene.joint = Free()
scene.body = RigidBody.box(mass=1.0, size=(0.3, 0.2, 0.1))
scene.connect(scene.world.frame, scene.corner.frame_a)
scene.connect(scene.corner.frame_b, scene.joint.frame_a)
scene.connect(scene.joint.frame_b, scene.body.frame)

model = ac.build(scene)
print(model)
run = model.simulate(1.0, {scene.body.frame.velocity: (1.0, 0, 3.0), scene.body.frame.angular_velocity: (0, 0.1, 5.0)})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.3, 0.6))
