"""Optimal control: swing a pendulum on a cart up in two seconds with the least effort, by direct collocation.

The model's CasADi function drops into `casadi.Opti`; no equation is written by hand.

    python examples/cart_swing_up.py
"""

import casadi as ca
import numpy as np

import acausal as ac
from components import ForceSource, Prismatic, Revolute, RigidBody, World

LIMIT = 2e-2  # of what main returns


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
    """Optimise, then simulate the model with the force found; returns the error of the angle at the end [rad]."""
    scene = CartPole()
    model = ac.build(scene)
    print(model, model.state_names)
    f = model.functions.explicit_dynamics
    n, end = 60, 2.0
    h = end / n
    opti = ca.Opti()
    X, U = opti.variable(4, n + 1), opti.variable(1, n + 1)
    for k in range(n):  # Hermite-Simpson: cubic states, linear force
        a, b, ua, ub = X[:, k], X[:, k + 1], U[:, k], U[:, k + 1]
        fa, fb = f(0, a, ua, []), f(0, b, ub, [])
        middle = (a + b) / 2 + h / 8 * (fa - fb)
        opti.subject_to(b == a + h / 6 * (fa + 4 * f(0, middle, (ua + ub) / 2, []) + fb))
    opti.subject_to(X[:, 0] == 0)
    opti.subject_to(X[:, -1] == ca.DM([0, np.pi, 0, 0]))
    opti.subject_to(opti.bounded(-20, U, 20))
    opti.minimize(h * ca.sumsqr(U))
    opti.set_initial(X[1, :], np.linspace(0, np.pi, n + 1))
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    solution = opti.solve()
    times, force = np.linspace(0, end, n + 1), np.array(solution.value(U)).ravel()
    print(f"effort {solution.value(opti.f):.3f} N^2 s, {solution.stats()['iter_count']} iterations")
    run = model.simulate(end, inputs={scene.force: lambda t: np.interp(t, times, force)}, rtol=1e-9)
    error = abs(float(run[scene.hinge.q][-1]) - np.pi)
    print(f"simulated with that force, the pendulum ends {error:.1e} rad from upright")
    run.picture(f"{folder}/cart_swing_up.png", times=(0.0, 0.6, 1.2, 2.0))
    run.animate(f"{folder}/cart_swing_up.html")
    return error


if __name__ == "__main__":
    main()
