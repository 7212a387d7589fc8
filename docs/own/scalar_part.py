"""A part of scalar equations: connectors, variables, and what holds between them. No direction of cause and effect."""

from collections.abc import Iterator

import numpy as np

import acausal as ac
from components import Capacitor, Ground, Resistor, VoltageSource

LIMIT = 1e-8


class Transformer(ac.Component):
    """Ideal transformer: v1 = ratio v2, i2 = -ratio i1. Stores nothing, loses nothing."""

    a1, b1 = ac.Electrical.port(must_connect=True), ac.Electrical.port(must_connect=True)
    a2, b2 = ac.Electrical.port(must_connect=True), ac.Electrical.port(must_connect=True)
    i = ac.Variable("A", "current through the first winding")

    def __init__(self, ratio: float) -> None:
        self.ratio = ratio

    def equations(self) -> Iterator[ac.Equation]:
        yield ac.equal(self.a1.v - self.b1.v, self.ratio * (self.a2.v - self.b2.v))
        yield ac.equal(self.a1.i, self.i)
        yield ac.equal(self.b1.i, -self.i)
        yield ac.equal(self.a2.i, -self.ratio * self.i)
        yield ac.equal(self.b2.i, self.ratio * self.i)

    def stored_energy(self) -> float:
        return 0.0  # said, so that runs look at the energy balance


def main() -> float:
    """A capacitor charged through it; returns the largest difference from the exponential [V]: seen from there, R / ratio^2 at U / ratio."""
    scene = ac.System()
    scene.source, scene.load, scene.store = VoltageSource(12.0), Resistor(100.0), Capacitor(1e-3)
    scene.transformer, scene.ground, scene.other_ground = Transformer(ratio=4.0), Ground(), Ground()
    scene.connect(scene.source.pin_a, scene.load.pin_a)
    scene.connect(scene.load.pin_b, scene.transformer.a1)
    scene.connect(scene.transformer.b1, scene.source.pin_b, scene.ground.pin)
    scene.connect(scene.transformer.a2, scene.store.pin_a)
    scene.connect(scene.transformer.b2, scene.store.pin_b, scene.other_ground.pin)
    run = ac.build(scene).simulate(0.05, {scene.store.v: 0.0}, rtol=1e-11)
    exact = 12 / 4 * (1 - np.exp(-run.t / (100 / 4**2 * 1e-3)))
    return float(np.max(np.abs(run[scene.store.v] - exact)))


if __name__ == "__main__":
    print(main())
