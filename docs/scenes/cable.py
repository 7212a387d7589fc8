# Shows Cable, ConstantSum, LineOfAction
import acausal as ac
from components import Cable, Particle, Prismatic, RigidBody, World

scene = ac.System()
scene.world, scene.load, scene.weight = World(), RigidBody.ball(3.0, 0.1), Particle(1.0)
scene.rails = [Prismatic("z"), Prismatic("z")]
scene.rope = Cable(length=5.0, over=(scene.load.frame, scene.world.at((0, 0, 2.0))))
scene.connect(scene.world.at((0, 0, 2.0)), scene.rope.frame_a)
scene.connect(scene.world.frame, scene.rails[0].frame_a)
scene.connect(scene.world.at((0.3, 0, 0)), scene.rails[1].frame_a)
scene.connect(scene.rails[0].frame_b, scene.load.frame)
scene.connect(scene.rails[1].frame_b, scene.weight.point, scene.rope.frame_b)

model = ac.build(scene)
print(model)
run = model.simulate(0.6, {scene.rails[0].q: 0.3, scene.rails[1].q: ac.near(0.4)})
print(run)
run.plot(scene.rails[0].q, scene.rope.tension, path="picture.png")
