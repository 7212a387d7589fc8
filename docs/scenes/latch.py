# Shows Latch, PointLatch, Gripper
import acausal as ac
from components import Gripper, Latch, Particle, PointLatch, Revolute, RigidBody, World

scene = ac.System()
scene.world, scene.hinge, scene.arm = World(), Revolute(axis="y"), RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.arm.frame)
scene.ball, scene.box = Particle(0.2), RigidBody.box(mass=0.1, size=(0.1, 0.1, 0.1))
scene.hook = PointLatch(held=True, opens=scene.hinge.q - 0.6)
scene.connect(scene.arm.at((0.9, 0, 0)), scene.hook.frame_a)
scene.connect(scene.hook.frame_b, scene.ball.point)
scene.hand = Gripper(held=True, opens=scene.hinge.q - 0.3)
scene.connect(scene.arm.frame, scene.hand.frame_a)
scene.connect(scene.hand.frame_b, scene.box.frame)
scene.stop = Latch(closes=scene.hinge.q - 1.0)
scene.connect(scene.world.at((0, 0, 0), ("y", 1.0)), scene.stop.frame_a)
scene.connect(scene.stop.frame_b, scene.arm.frame)

model = ac.build(scene)
print(model)
ball, box = scene.ball.point, scene.box.frame
run = model.simulate(
    0.8,
    {
        scene.hinge.v: 7.0,
        ball.position: (0.9, 0, 0),
        ball.velocity: (0, 0, -6.3),
        box.position: (0.3, 0, 0),
        box.velocity: (0, 0, -2.1),
        box.angular_velocity: (0, 7, 0),
    },
)
print(run.transitions)
run.plot(ball.position[2], box.position[2], scene.hinge.q, path="picture.png")
