"""Transmissions: rack and pinion, planetary gear, gears with an elastic shaft or with losses. No mass, no play.

A flange of a joint carries what acts between the joint's two frames, so that a transmission between the flanges of joints reacts on
whatever carries these joints, in the directions of their axes. Between joints it holds one freedom by an invariant.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import final

from acausal.errors import ParameterError
from acausal.language.component import Component, System
from acausal.language.connector import Rotational, Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Magnitude, Reaction, Scalar, scalar
from acausal.language.mode_laws import DryFriction, ModeLaw
from acausal.language.origin import origin
from components.flanges import asked
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

    `ratio`, not zero: teeth of the ring per tooth of the sun; negative where planets mesh in pairs, so that sun and ring turn alike against the
    carrier (a Ravigneaux set is two of these that share ring and carrier, one of them with pairs). tau_ring = ratio tau_sun, tau_carrier =
    -(1 + ratio) tau_sun, so that torques and powers sum to zero. With the ratio 1 it is a differential: its cage the carrier, sun and ring its
    two shafts. R. Willis, Principles of Mechanism (1841), the formula of epicyclic trains.

        scene.gear = PlanetaryGear(ratio=100 / 50)
    """

    sun = Rotational.port(must_connect=True, if_unconnected=_HELD)
    carrier = Rotational.port(must_connect=True, if_unconnected=_HELD)
    ring = Rotational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, ratio: Scalar) -> None:
        self.ratio = not_zero(scalar(ratio, "PlanetaryGear's ratio", unit="1"), "PlanetaryGear's ratio")

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


@final
class LossyGear(Component):
    """A gear without mass whose teeth rub by what they carry: the part `efficiency` of the power that flange_a is driven with comes out at flange_b,
    and `back_efficiency` of what flange_b is driven with at flange_a. Where the teeth can hold, it sticks.

    phi_a = ratio phi_b, ratio (tau_a + loss) + tau_b = 0. `ratio` is not zero, 0 < `efficiency` <= 1; `back_efficiency`, as much unless given, is below
    1, and so is `efficiency` then. Where it is 0 or less, as of many worms, the gear holds itself: flange_b cannot turn it, however hard it is driven,
    and flange_a has to drive it in either sense. Numbers, parameters, or expressions, such as of the speed. A bearing that rubs whatever it
    carries is a Brake beside it.

    `loss` [N*m] drives flange_a forward, against its slip: Coulomb's friction, at most mu times what the teeth carry, |tau_a + share loss|, with
    mu = 2 (1 - e) (1 - b) / (1 - e b) and share = (1 - b (2 - e)) / (2 (1 - e) (1 - b)), e and b the efficiencies. Dissipates -loss der(phi_a). These
    are the torques of C. Pelchen, C. Schweiger and M. Otter, Modeling and Simulating the Efficiency of Gearboxes and of Planetary Gearboxes, 2nd
    Modelica Conference (2002).

        scene.worm = LossyGear(ratio=40, efficiency=0.6, back_efficiency=0.3)
    """

    flange_a = Rotational.port(must_connect=True, if_unconnected=_HELD)
    flange_b = Rotational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, ratio: Scalar, efficiency: Scalar, back_efficiency: Scalar | None = None) -> None:
        self.ratio = not_zero(scalar(ratio, "LossyGear's ratio", unit="1"), "LossyGear's ratio")
        e = self.efficiency = _part(efficiency, "efficiency", alike=back_efficiency is None)
        if back_efficiency is None:
            self.back_efficiency, self._mu, self._share = e, 2.0 * (1.0 - e) / (1.0 + e), 0.5
        else:
            b = self.back_efficiency = _part(back_efficiency, "back_efficiency")
            lost = 2.0 * (1.0 - e) * (1.0 - b)
            self._mu, self._share = lost / (1.0 - e * b), (1.0 - b * (2.0 - e)) / lost
        self.loss = Reaction("N*m", "what friction drives flange_a forward with")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_a.phi, self.ratio * self.flange_b.phi)
        yield equal(self.ratio * (self.flange_a.tau + self.loss) + self.flange_b.tau, 0.0)

    def laws(self) -> Iterable[ModeLaw]:
        load = Magnitude(self.flange_a.tau + self._share * self.loss, "N*m")
        yield DryFriction(self.loss, der(self.flange_a.phi), self._mu * load)

    def dissipated_power(self) -> Expression:
        return -1.0 * self.loss * der(self.flange_a.phi)


def _part(value: Scalar, name: str, alike: bool = False) -> float | Expression:
    """An efficiency, checked: `alike`, that both ways are."""
    return asked(scalar(value, f"LossyGear's {name}", unit="1"), functools.partial(_check_part, name=name, alike=alike))


def _check_part(value: float, name: str, alike: bool) -> None:
    if name == "efficiency" and not value > 0:
        raise ParameterError(
            f"LossyGear's efficiency is {value:g} ({origin()}): flange_a could not drive it. Give a number above 0, and a back_efficiency of 0 or less to a gear that holds itself."
        )
    if not (value <= 1 if alike else value < 1):
        why = "nothing gains power" if value > 1 else "what loses nothing one way loses nothing the other"
        raise ParameterError(
            f"LossyGear's {name} is {value:g} ({origin()}): {why}. Give a number below 1, or a Gear, which has no losses."
        )
