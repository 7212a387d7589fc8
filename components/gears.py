"""Transmissions: rack and pinion, planetary gear, a gear with an elastic shaft. No mass, no play.

A flange of a joint carries what acts between the joint's two frames, so that a transmission between the flanges of joints reacts on
whatever carries these joints, in the directions of their axes. Between joints it holds one freedom by an invariant.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import final

from acausal.language.component import Component, System
from acausal.language.connector import Rotational, Translational
from acausal.language.equation import Equation, equal
from acausal.language.expression import Scalar, scalar
from components.rotational import Gear, RotationalDamper, RotationalSpring, not_zero

_HELD = "Connect all its flanges; to hold one, connect it to a RotationalGround or a TranslationalGround."


@final
class RackAndPinion(Component):
    """A pinion of `radius` [m] that rolls on a rack: s = radius phi, tau + radius f = 0. A negative radius turns the sense; zero is refused.

    Where the pinion's axle or the rack moves too, s and phi are those of the joints that the flanges belong to: between the two parts of
    each joint.

        scene.steering = RackAndPinion(radius=0.02)
        scene.connect(scene.column.flange, scene.steering.pinion); scene.connect(scene.rail.flange, scene.steering.rack)
    """

    pinion = Rotational.port(must_connect=True, if_unconnected=_HELD)
    rack = Translational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, radius: Scalar) -> None:
        self.radius = not_zero(scalar(radius, "RackAndPinion's radius", unit="m"), "RackAndPinion's radius")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.rack.s, self.radius * self.pinion.phi)
        yield equal(self.pinion.tau + self.radius * self.rack.f, 0.0)


@final
class PlanetaryGear(Component):
    """Sun, ring and carrier on one axis: phi_sun + ratio phi_ring = (1 + ratio) phi_carrier; planets without mass. Two freedoms.

    `ratio` > 0: teeth of the ring per tooth of the sun. tau_ring = ratio tau_sun, tau_carrier = -(1 + ratio) tau_sun, so that torques and
    powers sum to zero. R. Willis, Principles of Mechanism (1841), the formula of epicyclic trains.

        scene.gear = PlanetaryGear(ratio=100 / 50)
    """

    sun = Rotational.port(must_connect=True, if_unconnected=_HELD)
    carrier = Rotational.port(must_connect=True, if_unconnected=_HELD)
    ring = Rotational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, ratio: Scalar) -> None:
        self.ratio = scalar(ratio, "PlanetaryGear's ratio", positive=True, unit="1")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.sun.phi + self.ratio * self.ring.phi, (1.0 + self.ratio) * self.carrier.phi)
        yield equal(self.ring.tau, self.ratio * self.sun.tau)
        yield equal(self.carrier.tau, -1.0 * (1.0 + self.ratio) * self.sun.tau)


@final
class ElasticGear(System):
    """A gear on a shaft that twists: spring and damper between `flange_a` and an ideal gear whose other side is `flange_b`.

    tau_a = stiffness (phi_a - ratio phi_b) + damping (its rate), ratio tau_a + tau_b = 0. `ratio` is not zero, `stiffness` [N*m/rad] and
    `damping` [N*m*s/rad] are on the side of flange_a: seen from flange_b the stiffness is ratio^2 times as large.

        scene.gearbox = ElasticGear(ratio=50, stiffness=40.0, damping=0.01)
    """

    flange_a = Rotational.port(must_connect=True, if_unconnected=_HELD)
    flange_b = Rotational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, ratio: Scalar, stiffness: Scalar, damping: Scalar = 0.0) -> None:
        self.gear, self.spring, self.damper = Gear(ratio), RotationalSpring(stiffness), RotationalDamper(damping)
        self.connect(self.flange_a, self.spring.flange_a, self.damper.flange_a)
        self.connect(self.spring.flange_b, self.damper.flange_b, self.gear.flange_a)
        self.connect(self.gear.flange_b, self.flange_b)
