"""Optimal control: swing a pendulum on a cart up in two seconds with the least effort.

The problem is said in variables of the scene; the force found is simulated at once, as proof.

    python examples/cart_swing_up.py
"""

import numpy as np

import acausal as ac
from components import ForceSource, Prismatic, Revolute, RigidBody, World

LIMIT = 1e-4  # of what main returns


class CartPole(ac.System):
    """A cart on a rail with a rod on a hinge; the force on the cart is an input."""

    def __init__(self) -> None:
        self.force = ac.Input("N")
        self.world, self.rail, self.hinge = World(), Prismatic("x"), Revolute("y")
        self.cart, self.rod = RigidBody.box(1.0, (0.4, 0.2, 0.1)), RigidBody.rod(0.3, (0, 0, -0.6))
        self.motor = ForceSource(self.force)
        self.connect(self.world.frame, self.rail.frame_a)
        self.connect(self.rail.frame_b, self.cart.frame)
        self.connect(self.cart.frame, self.hinge.frame_a)
        self.connect(self.hinge.frame_b, self.rod.frame)
        self.connect(self.motor.flange, self.rail.flange)


def main(folder: str = "out") -> float:
    """Find the motion of least effort; returns by how much it is off when its force is simulated, relative to what each state varies by."""
    scene = CartPole()
    model = ac.build(scene)
    print(model)
    ocp = ac.OptimalControl(model, time=2.0)
    ocp.start({scene.rail.q: 0, scene.hinge.q: 0})
    ocp.end({scene.rail.q: 0, scene.hinge.q: np.pi, scene.rail.v: 0, scene.hinge.v: 0})
    ocp.bound(scene.force, -20, 20)
    ocp.minimise(ac.integral(scene.force**2))
    best = ocp.solve()
    print(best)
    run = best.run  # the force found, simulated from the start on
    print(f"the pendulum ends {abs(float(run[scene.hinge.q][-1]) - np.pi):.1e} rad from upright")
    run.picture(f"{folder}/cart_swing_up.png", times=(0.0, 0.6, 1.2, 2.0))
    run.animate(f"{folder}/cart_swing_up.html")
    return best.replay_error


if __name__ == "__main__":
    main()
