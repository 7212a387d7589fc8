# Shows TranslationalGround, TranslationalSpring
import acausal as ac
from components import SlidingMass, TranslationalGround, TranslationalSpring

scene = ac.System()
scene.wall, scene.spring, scene.cart = TranslationalGround(), TranslationalSpring(stiffness=100.0), SlidingMass(2.0)
scene.connect(scene.wall.flange, scene.spring.flange_a)
scene.connect(scene.spring.flange_b, scene.cart.flange_a)

model = ac.build(scene)
print(model)
run = model.simulate(2.0, {scene.cart.flange_a.s: 0.1})
print(run)
run.plot(scene.cart.flange_a.s, scene.cart.v, path="picture.png")
