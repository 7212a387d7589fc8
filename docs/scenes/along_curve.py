# Shows AlongCurve, SplineCurve
import acausal as ac
from components import AlongCurve, RigidBody, SplineCurve, World

track = SplineCurve([(0, 0, 2), (1, 0, 0.6), (2, 0, 0.2), (3, 0, 0.9), (4, 0, 0.5), (5, 0, 0.8)])

scene = ac.System()
scene.world = World()
scene.rails = AlongCurve(track, side="y")
scene.car = RigidBody.box(mass=300.0, size=(0.4, 0.2, 0.15))
scene.connect(scene.world.frame, scene.rails.frame_a)
scene.connect(scene.rails.frame_b, scene.car.at((0, 0, -0.1)))

model = ac.build(scene)
print(model)
run = model.simulate(1.2, {scene.rails.q: 0.1})
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.4, 0.8, 1.2))
