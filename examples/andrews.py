"""Andrews' squeezing mechanism: seven bodies, three loops, one spring, a motor's constant torque.

Schiehlen, Multibody Systems Handbook (1990); geometry as in the test set of Mazzia and Magherini (problem "Andrews").
The reference was computed in quadruple precision by an independent program; published digits end at 1.4e-9.

    python examples/andrews.py
"""

import time
from pathlib import Path

import acausal as ac
from components import Revolute, RigidBody, Spring, Torque, World

LIMIT = 1e-11  # of what main returns

REFERENCE = {  # angles [rad] of the joints at t = 0.03 s
    "O": 15.81077119515371018081515, "F": -15.75637105841184331506904, "B": 0.04082224011964586472819047,
    "G": -0.5347301163420795409883205, "A5": 0.5244099658799540645348654, "H": 0.5347301163420795409883205,
    "A7": 1.048080741041937867546718,
}  # fmt: skip


class Andrews(ac.System):
    """Planar mechanism in x and y; named points as in the literature. Bodies K1 ... K7."""

    def __init__(self) -> None:
        A, B, C = (-0.06934, -0.00227, 0.0), (-0.03635, 0.03273, 0.0), (0.014, 0.072, 0.0)
        self.world = World(gravity=None)
        self.K1 = _body(0.04325, 2.194e-6, (0.00092, 0))
        self.K2 = _body(0.00365, 4.410e-7, (-0.0115, 0))
        self.K3 = _body(0.02373, 5.255e-6, (0.01043, -0.01874))
        self.K4 = _body(0.00706, 5.667e-7, (0, 0.01421 - 0.02))
        self.K5 = _body(0.07050, 1.169e-5, (0.02308, -0.00916))
        self.K6 = _body(0.00706, 5.667e-7, (0.02 - 0.01421, 0))
        self.K7 = _body(0.05498, 1.912e-5, (-0.00449, -0.01228))

        self.O, self.F, self.B, self.G, self.A5, self.H, self.A7 = (Revolute("z") for _ in range(7))
        self.E3, self.E4, self.E6 = (Revolute("z") for _ in range(3))
        self._join(self.O, self.world.frame, self.K1.frame)
        self._join(self.F, self.K1.at((0.007, 0, 0)), self.K2.frame)
        self._join(self.B, self.world.at(B), self.K3.frame)
        self._join(self.A5, self.world.at(A), self.K5.frame)
        self._join(self.A7, self.world.at(A), self.K7.frame)
        self._join(self.G, self.K5.at((0.04, 0, 0)), self.K4.frame)
        self._join(self.H, self.K7.at((0, -0.04, 0)), self.K6.frame)
        E = self.K3.at((0, -0.035, 0))
        self._join(self.E3, E, self.K2.at((-0.028, 0, 0)))
        self._join(self.E4, E, self.K4.at((0, -0.02, 0)))
        self._join(self.E6, E, self.K6.at((0.02, 0, 0)))

        self.spring = Spring(stiffness=4530.0, natural_length=0.07785)
        self.connect(self.spring.point_a, self.K3.at((0.02, -0.018, 0)))
        self.connect(self.spring.point_b, self.world.at(C))
        self.motor = Torque((0, 0, 0.033))
        self.connect(self.motor.frame, self.K1.frame)

    def _join(self, joint: Revolute, a: ac.Frame, b: ac.Frame) -> None:
        self.connect(a, joint.frame_a)
        self.connect(joint.frame_b, b)

    def start(self) -> dict[ac.Expression, object]:
        """At rest; the first crank angle exactly, the others as a rough sketch."""
        rough = {self.F: 0.0, self.B: 0.46, self.G: 0.22, self.A5: 0.49, self.H: -0.22, self.A7: 1.23}
        return {self.O.q: -0.0617138900142764496358948458001, **{joint.q: ac.near(angle) for joint, angle in rough.items()}}


def _body(mass: float, inertia: float, centre: tuple[float, float]) -> RigidBody:
    """A flat body; only its moment about z matters in the plane."""
    return RigidBody(mass, (inertia / 2, inertia / 2, inertia), (*centre, 0.0))


def main(folder: str | Path = "out") -> float:
    """Compose, reduce, simulate, compare, draw; returns the largest error of an angle at 0.03 s [rad]."""
    scene = Andrews()
    began = time.perf_counter()
    model = ac.build(scene)
    built = time.perf_counter()
    run = model.simulate(0.05, scene.start(), rtol=1e-12, atol=1e-10)
    print(model)
    print(f"built in {1e3 * (built - began):.0f} ms; {run}")
    at = run.at(0.03)
    errors = {name: abs(float(at[getattr(scene, name).q][0]) - value) for name, value in REFERENCE.items()}
    worst = max(errors.values())
    print(f"largest error of an angle at 0.03 s: {worst:.1e} rad (after {REFERENCE['O'] / 6.2832:.1f} turns of the crank)")
    print(f"loops closed to {run.constraint_error():.1e}, energy balance to {run.energy_error():.1e}")
    print("states:", ", ".join(model.state_names))
    folder = Path(folder)
    print("written:", run.picture(folder / "andrews.png", times=(0.0, 0.008, 0.016)), run.animate(folder / "andrews.html"))
    return worst


if __name__ == "__main__":
    main()
