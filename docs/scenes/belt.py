# Shows Belt, StiffBelt, ElasticBelt, SlippingBelt
import acausal as ac
from components import Belt, Coulomb, Pulley, RigidBody, TorqueSource, World

scene = ac.System()
scene.world, scene.small, scene.large = World(), RigidBody.disk(2.0, 0.1, axis="y"), RigidBody.disk(8.0, 0.2, axis="y")
left = Pulley(scene.world.frame, 0.1, middle="-x", along="z", wheel=scene.small)
right = Pulley(scene.world.at((0.7, 0, 0)), 0.2, middle="x", along="-z", wheel=scene.large)
scene.belt = Belt([left, right], preload=50.0, friction=Coulomb(0.3, static=0.4))
scene.motor = TorqueSource(6.0 * ac.time)
scene.connect(scene.motor.flange, scene.belt.hinges[0].flange)

model = ac.build(scene)
print(model)
run = model.simulate(2.0)
print(run.transitions)
run.plot(scene.belt.tension, scene.belt.slip, path="picture.png")
