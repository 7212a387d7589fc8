"""A one-cylinder engine: crank, connecting rod, piston, the pressure of the gas as a part of one's own, a flywheel on the crank's flange.

Parameters as in Modelica.Mechanics.MultiBody.Examples.Loops.Engine1b (Modelica Standard Library 4.0): steel of 7700 kg/m^3, crank radius
0.1 m, rod 0.2 m, bore 0.1 m. The planar loop needs no special joint.

    python examples/engine.py
"""

from collections.abc import Iterable
from pathlib import Path

import casadi as ca
import numpy as np

import acausal as ac
from components import Inertia, Prismatic, Revolute, RigidBody, World

LIMIT = 1e-13  # of what main returns

STEEL = 7700.0  # kg/m^3
CRANK, ROD, BORE, STROKE = 0.1, 0.2, 0.1, 0.35  # m; STROKE: length of the cylinder in the pressure's law
COMPRESSION = (177.4132, -287.2189, 151.8252, -24.9973, 2.4)  # bar, polynomials of 1 - s / STROKE, highest power first
EXPANSION = (145.930, -131.707, 17.3438, 17.9272, 2.4)


class GasForce(ac.Component):
    """Pressure of the gas on a piston: it pushes the flange towards larger s with pressure(s, sign of s') area.

    One polynomial while the piston goes up, another while it goes down, for s / STROKE > 0.067, so that a turn of the crank gives work:
    the rough law of the Modelica library's GasForce2.
    """

    flange = ac.Translational.port(
        must_connect=True, if_unconnected="It pushes nothing: connect it to the piston's prismatic joint."
    )

    def push(self) -> ac.Expression:
        """Force on the piston [N]."""
        s, rate = self.flange.s, ac.der(self.flange.s)
        x = 1 - s.sx / STROKE
        up, down = (sum(c * x ** (4 - k) for k, c in enumerate(law)) for law in (COMPRESSION, EXPANSION))
        pressure = 1e5 * ca.if_else(rate.sx < 0, up, down)
        return ac.Expression(pressure * np.pi * BORE**2 / 4, s.leaves | rate.leaves)

    def equations(self) -> Iterable[ac.Equation]:
        yield ac.equal(self.flange.f, -1.0 * self.push())

    def supplied_power(self) -> ac.Expression:
        return self.push() * ac.der(self.flange.s)


def steel_cylinder(tip: tuple[float, float, float], diameter: float) -> RigidBody:
    """A solid cylinder from `frame` to `tip`."""
    return RigidBody.rod(STEEL * np.pi * diameter**2 / 4 * float(np.linalg.norm(tip)), tip, radius=diameter / 2)


def steel_bar(tip: tuple[float, float, float], width: float, height: float, across: tuple[float, float, float]) -> RigidBody:
    """A solid bar from `frame` to `at(tip)` with a rectangular section: `width` along the unit vector `across`, which is square to it."""
    length = float(np.linalg.norm(tip))
    along = np.array(tip) / length
    third = np.cross(along, across)
    mass = STEEL * length * width * height
    axes = ((along, width, height), (np.array(across), length, height), (third, length, width))
    inertia = sum(mass * (a * a + b * b) / 12 * np.outer(e, e) for e, a, b in axes)
    return RigidBody(mass, inertia, tuple(np.array(tip) / 2))


class Engine(ac.System):
    """The crank turns about x, the piston slides along -y from (0.15, 0.45, 0); s = 0.05 m at the upper dead centre."""

    def __init__(self, gas: bool = True) -> None:
        x = (1.0, 0.0, 0.0)
        self.world, self.bearing, self.crank_pin, self.piston_pin = (
            World(gravity=(0, -9.81, 0)),
            *(Revolute("x") for _ in range(3)),
        )
        self.cylinder, self.flywheel = Prismatic((0, -1, 0)), Inertia(1.0)
        self.shaft_in, self.shaft_out = steel_cylinder((0.1, 0, 0), 0.05), steel_cylinder((0.1, 0, 0), 0.03)
        self.web_in, self.web_out = (steel_bar(tip, 0.02, 0.05, x) for tip in ((0, CRANK, 0), (0, -CRANK, 0)))
        self.rod, self.piston = steel_bar((0, -ROD, 0), 0.02, 0.06, x), steel_cylinder((0, -0.1, 0), BORE)

        self.connect(self.world.frame, self.bearing.frame_a)
        self.connect(self.bearing.frame_b, self.shaft_in.frame)
        self.connect(self.shaft_in.tip, self.web_in.frame)
        pin = self.web_in.at((0, CRANK, 0))
        self.connect(pin, self.shaft_out.frame)
        self.connect(self.shaft_out.tip, self.web_out.frame)
        self.connect(self.web_in.at((0.05, CRANK, 0)), self.crank_pin.frame_a)
        self.connect(self.crank_pin.frame_b, self.rod.at((0, -ROD, 0)))
        self.connect(self.rod.frame, self.piston_pin.frame_b)
        self.connect(self.piston_pin.frame_a, self.piston.tip)
        self.connect(self.piston.frame, self.cylinder.frame_b)
        self.connect(self.cylinder.frame_a, self.world.at((0.15, 0.45, 0)))
        self.connect(self.bearing.flange, self.flywheel.flange_b)
        if gas:
            self.gas = GasForce()
            self.connect(self.cylinder.flange, self.gas.flange)

    def start(self) -> dict[ac.Expression, object]:
        """At the upper dead centre with 10 rad/s; the piston above the crank."""
        return {self.bearing.q: 0.0, self.bearing.v: 10.0, self.cylinder.q: ac.near(0.05)}


def main(folder: str | Path = "out") -> float:
    """Half a second with gas; returns the largest difference from the slider-crank's closed form [m]."""
    scene = Engine()
    model = ac.build(scene)
    print(model)
    run = model.simulate(0.5, scene.start(), rtol=1e-9)
    print(run)
    angle, s = run[scene.bearing.q], run[scene.cylinder.q]
    exact = 0.35 - CRANK * np.cos(angle) - np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2)
    worst = float(np.max(np.abs(s - exact)))
    print(f"piston on its closed form to {worst:.1e} m, energy balance with the gas to {run.energy_error():.1e}")
    print(f"{angle[-1] / (2 * np.pi):.2f} turns, from 10 rad/s to {run[scene.bearing.v][-1]:.2f} rad/s")
    folder = Path(folder)
    print("written:", run.picture(folder / "engine.png", times=(0.0, 0.1, 0.2)), run.animate(folder / "engine.html"))
    return worst


if __name__ == "__main__":
    main()
