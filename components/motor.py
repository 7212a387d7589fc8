"""A motor as one part: pins on one side, a shaft on the other."""

from __future__ import annotations

from typing import final

from acausal.language.component import System
from acausal.language.connector import Connector, Electrical, Rotational
from acausal.language.expression import Expression, Scalar, scalar
from components.electrical import ElectromotiveForce, Inductor, Resistor
from components.rotational import Gear, Inertia, RotationalDamper, RotationalGround, not_zero

_LOOSE = "Connect both pins: to a source, and to its other pole or a Ground."


@final
class DCMotor(System):
    """A geared motor of direct current between two pins and a shaft: R i + L der(i) + k der(phi_m) = v_a - v_b, and on the rotor
    J der^2(phi_m) = k i - d der(phi_m) - tau / ratio, with phi_m = ratio phi.

    `constant` k [N*m/A = V*s/rad] is not zero, `resistance` [Ohm] >= 0, `inductance` [H] >= 0, `inertia` of the rotor [kg m^2] >= 0, `damping` of its
    bearings [N*m*s/rad] >= 0, gear `ratio` (turns of the rotor for one of the shaft) is not zero. What is plainly 0 is left out. A positive
    current drives the flange forward. Its housing stands still, or is what the joint's frame_a belongs to where `flange` drives a joint.

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
        inductance = scalar(inductance, "DCMotor's inductance", non_negative=True, unit="H")
        inertia = scalar(inertia, "DCMotor's inertia", non_negative=True, unit="kg*m^2")
        damping = scalar(damping, "DCMotor's damping", non_negative=True, unit="N*m*s/rad")
        self.emf, self.gear = ElectromotiveForce(constant), Gear(ratio)
        wire: Connector = self.pin_a
        self.winding = Resistor(resistance)
        self.connect(wire, self.winding.pin_a)
        wire = self.winding.pin_b
        if not _none(inductance):
            self.coil = Inductor(inductance)
            self.connect(wire, self.coil.pin_a)
            wire = self.coil.pin_b
        self.connect(wire, self.emf.pin_a)
        self.connect(self.emf.pin_b, self.pin_b)
        self.connect(self.emf.flange, self.gear.flange_a)
        self.connect(self.gear.flange_b, self.flange)
        if not _none(inertia):
            self.rotor = Inertia(inertia)
            self.connect(self.emf.flange, self.rotor.flange_a)
        if not _none(damping):
            self.bearing, self.housing = RotationalDamper(damping), RotationalGround()
            self.connect(self.emf.flange, self.bearing.flange_b)
            self.connect(self.bearing.flange_a, self.housing.flange)


def _none(value: float | Expression) -> bool:
    return not isinstance(value, Expression) and value == 0.0
