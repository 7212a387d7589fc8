# Shows FlexibleBeam, Section
import acausal as ac
from components import FlexibleBeam, Revolute, RigidBody, Section, World

scene = ac.System()
scene.world = World()
scene.hinge = Revolute(axis="y")
scene.rod = FlexibleBeam(
    0.5, Section.rectangle(0.008, 0.008), youngs_modulus=2e9, density=1200.0, bending=(0, 2), modes="cantilever"
)
scene.tip = RigidBody.ball(mass=0.05, radius=0.02)
scene.connect(scene.world.frame, scene.hinge.frame_a)
scene.connect(scene.hinge.frame_b, scene.rod.frame_a)
scene.connect(scene.rod.frame_b, scene.tip.frame)

model = ac.build(scene)
print(model)
run = model.simulate(0.5)
print(run)
print(f"energy kept to {run.energy_error():.0e}")
run.picture("picture.png", times=(0.0, 0.2, 0.4))
