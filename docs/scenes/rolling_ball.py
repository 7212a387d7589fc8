# Shows RollingBall
import acausal as ac
from components import RigidBody, RollingBall, World

scene = ac.System()
scene.world = World()
scene.contact = RollingBall(radius=0.1)
scene.ball = RigidBody.ball(mass=1.0, radius=0.1)
scene.connect(scene.world.at((0, 0, 0), rotation=("y", 0.1)), scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.ball.frame)

model = ac.build(scene)
print(model)
run = model.simulate(1.5, {scene.contact.v: (3.0, 0.0, 0.0)})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.5, 1.0, 1.5))
