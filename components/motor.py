"""A motor as one part: pins on one side, a shaft on the other."""

from __future__ import annotations

from collections.abc import Iterable
from typing import final

from acausal.language.component import Component, System
from acausal.language.connector import Connector, Electrical, Rotational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Scalar, Variable, scalar
from components.electrical import ElectromotiveForce, Inductor, Resistor
from components.rotational import Gear, RotationalDamper, RotationalGround, not_zero

_LOOSE = "Connect both pins: to a source, and to its other pole or a Ground."


@final
class DCMotor(System):
    """A geared motor of direct current between two pins and a shaft: R i + L der(i) + k der(phi_m) = v_a - v_b, and on the rotor
    J der^2(phi_m) = k i - d der(phi_m) - tau / ratio, with phi_m = ratio phi.

    `constant` k [N*m/A = V*s/rad] is not zero, `resistance` [Ohm] >= 0, `inductance` [H] >= 0, `inertia` of the rotor [kg m^2] >= 0, `damping` of its
    bearings [N*m*s/rad] >= 0, gear `ratio` (turns of the rotor for one of the shaft) is not zero. What is plainly 0 is left out; an inductance of
    parameters is > 0, since a current is a state with one and follows without. A positive current drives the flange forward. Its housing stands still,
    or is what the joint's frame_a belongs to where `flange` drives a joint.

        scene.motor = DCMotor(constant=0.05, resistance=1.2, inductance=1e-3, inertia=2e-5, ratio=50)
    """

    pin_a = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    pin_b = Electrical.port(must_connect=True, if_unconnected=_LOOSE)
    flange = Rotational.port(must_connect=True, if_unconnected="It drives nothing: connect it to an Inertia or a joint's flange.")

    def __init__(
        self,
        constant: Scalar,
        resistance: Scalar,
        inductance: Scalar = 0.0,
        inertia: Scalar = 0.0,
        ratio: Scalar = 1.0,
        damping: Scalar = 0.0,
    ) -> None:
        constant = not_zero(scalar(constant, "DCMotor's constant", unit="N*m/A"), "DCMotor's constant")
        resistance = scalar(resistance, "DCMotor's resistance", non_negative=True, unit="Ohm")
        ratio = not_zero(scalar(ratio, "DCMotor's ratio", unit="1"), "DCMotor's ratio")
        left_out = _none(inductance)
        inductance = scalar(inductance, "DCMotor's inductance", positive=not left_out, unit="H")
        inertia = scalar(inertia, "DCMotor's inertia", non_negative=True, unit="kg*m^2")
        damping = scalar(damping, "DCMotor's damping", non_negative=True, unit="N*m*s/rad")
        self.emf, self.gear = ElectromotiveForce(constant), Gear(ratio)
        wire: Connector = self.pin_a
        self.winding = Resistor(resistance)
        self.connect(wire, self.winding.pin_a)
        wire = self.winding.pin_b
        if not left_out:
            self.coil = Inductor(inductance)
            self.connect(wire, self.coil.pin_a)
            wire = self.coil.pin_b
        self.connect(wire, self.emf.pin_a)
        self.connect(self.emf.pin_b, self.pin_b)
        self.connect(self.emf.flange, self.gear.flange_a)
        self.connect(self.gear.flange_b, self.flange)
        if not _none(inertia):
            self.rotor = _Rotor(inertia)
            self.connect(self.emf.flange, self.rotor.flange)
        if not _none(damping):
            self.bearing, self.housing = RotationalDamper(damping), RotationalGround()
            self.connect(self.emf.flange, self.bearing.flange_b)
            self.connect(self.bearing.flange_a, self.housing.flange)


@final
class _Rotor(Component):
    """inertia der(w) = tau, der(phi) = w, which may weigh nothing for some values of parameters."""

    flange = Rotational.port()
    phi = Variable("rad", "angle")
    w = Variable("rad/s", "angular velocity")

    def __init__(self, inertia: float | Expression) -> None:
        self.inertia = scalar(inertia, "_Rotor's inertia", non_negative=True, unit="kg*m^2")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.phi, self.phi)
        yield equal(der(self.phi), self.w)
        yield equal(self.inertia * der(self.w), self.flange.tau)

    def stored_energy(self) -> Expression:
        return 0.5 * self.inertia * self.w * self.w


def _none(value: Scalar) -> bool:
    return isinstance(value, float | int) and value == 0
