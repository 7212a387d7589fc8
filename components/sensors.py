"""Sensors between two connectors, as signals: a current, a torque, a force, and the angle and speed between two shafts.

Each sits in the line that it measures and takes nothing from it. What joints, bodies and frames do needs no sensor to be read from a run;
these feed controllers. RotationSensor and TranslationSensor (components.signals) measure one flange against its ground.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import final

from acausal.language.component import Component
from acausal.language.connector import Electrical, Rotational, Signal, Translational
from acausal.language.equation import Equation, der, equal

_OPEN = "It stands in a line: connect both ends."


@final
class CurrentSensor(Component):
    """Ammeter: v_a = v_b; current = what flows from pin_a to pin_b through it [A].

    scene.hall = CurrentSensor(); scene.connect(scene.winding.pin_b, scene.hall.pin_a)
    """

    pin_a = Electrical.port(must_connect=True, if_unconnected=_OPEN)
    pin_b = Electrical.port(must_connect=True, if_unconnected=_OPEN)
    current = Signal.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.pin_a.v, self.pin_b.v)
        yield equal(self.pin_b.i, -self.pin_a.i)
        yield equal(self.current.value, self.pin_a.i)


@final
class TorqueSensor(Component):
    """A stiff shaft: phi_a = phi_b; torque = what flange_a passes on to flange_b [N*m], so that torque der(phi) is the power through it.

    scene.gauge = TorqueSensor(); scene.connect(scene.gearbox.flange_b, scene.gauge.flange_a)
    """

    flange_a = Rotational.port(must_connect=True, if_unconnected=_OPEN)
    flange_b = Rotational.port(must_connect=True, if_unconnected=_OPEN)
    torque = Signal.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_a.phi, self.flange_b.phi)
        yield equal(self.flange_b.tau, -self.flange_a.tau)
        yield equal(self.torque.value, self.flange_a.tau)


@final
class ForceSensor(Component):
    """A stiff rod: s_a = s_b; force = what flange_a passes on to flange_b [N], so that force der(s) is the power through it.

    scene.gauge = ForceSensor(); scene.connect(scene.ram.flange, scene.gauge.flange_b)
    """

    flange_a = Translational.port(must_connect=True, if_unconnected=_OPEN)
    flange_b = Translational.port(must_connect=True, if_unconnected=_OPEN)
    force = Signal.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_a.s, self.flange_b.s)
        yield equal(self.flange_b.f, -self.flange_a.f)
        yield equal(self.force.value, self.flange_a.f)


@final
class RelativeRotationSensor(Component):
    """Measures flange_b against flange_a without a torque: angle = phi_b - phi_a [rad], speed = its rate [rad/s].

    scene.twist = RelativeRotationSensor(); scene.connect(scene.motor.flange_b, scene.twist.flange_a)
    """

    flange_a = Rotational.port(must_connect=True, if_unconnected=_OPEN)
    flange_b = Rotational.port(must_connect=True, if_unconnected=_OPEN)
    angle = Signal.port()
    speed = Signal.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_a.tau, 0.0)
        yield equal(self.flange_b.tau, 0.0)
        yield equal(self.angle.value, self.flange_b.phi - self.flange_a.phi)
        yield equal(self.speed.value, der(self.flange_b.phi) - der(self.flange_a.phi))
