# Shows RollingBallOnSurface
import acausal as ac
from components import HeightField, RigidBody, RollingBallOnSurface, World

bowl = HeightField(lambda x, y: 0.5 * (x**2 + y**2))

scene = ac.System()
scene.world = World()
scene.contact = RollingBallOnSurface(radius=0.05, surface=bowl)
scene.ball = RigidBody.ball(mass=0.5, radius=0.05)
scene.connect(scene.world.frame, scene.contact.frame_a)
scene.connect(scene.contact.frame_b, scene.ball.frame)

model = ac.build(scene)
print(model)
run = model.simulate(3.0, {scene.ball.frame.position[:2]: (0.5, 0.0), scene.ball.frame.velocity[1]: 0.8})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.4, 0.8))
