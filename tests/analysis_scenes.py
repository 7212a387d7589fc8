"""Scenes that tests of linear systems, equilibria and inverse dynamics share."""

from __future__ import annotations

import acausal as ac
from acausal.language.expression import Scalar
from components import (
    ElectromotiveForce,
    Gear,
    Ground,
    Inductor,
    Inertia,
    Resistor,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    TorqueSource,
    VoltageSource,
    World,
)


class Top(ac.System):
    """A rotor of inertia (A, A, C) about the fixed point, at `height` along its axis; angles: precession, nutation, spin."""

    def __init__(self, A: float = 0.02, C: float = 0.01, mass: float = 1.5, height: float = 0.1) -> None:
        self.world = World()
        self.precession, self.nutation, self.spin = Revolute("z"), Revolute("x"), Revolute("z")
        across = A - mass * height**2
        self.rotor = RigidBody(mass, (across, across, C), (0, 0, height))
        self.connect(self.world.frame, self.precession.frame_a)
        self.connect(self.precession.frame_b, self.nutation.frame_a)
        self.connect(self.nutation.frame_b, self.spin.frame_a)
        self.connect(self.spin.frame_b, self.rotor.frame)


class Arm(ac.System):
    """Two links with a torque at each hinge."""

    def __init__(self) -> None:
        self.world, self.shoulder, self.elbow = World(), Revolute("y"), Revolute("y")
        self.upper, self.lower = RigidBody.rod(2.0, (0.8, 0, 0)), RigidBody.rod(1.0, (0.5, 0, 0))
        self.torques = [ac.Input("N*m"), ac.Input("N*m")]
        self.motors = [TorqueSource(u) for u in self.torques]
        self.connect(self.world.frame, self.shoulder.frame_a)
        self.connect(self.shoulder.frame_b, self.upper.frame)
        self.connect(self.upper.tip, self.elbow.frame_a)
        self.connect(self.elbow.frame_b, self.lower.frame)
        for motor, joint in zip(self.motors, (self.shoulder, self.elbow), strict=True):
            self.connect(motor.flange, joint.flange)


class Motor(ac.System):
    """A voltage over R and L turns a rotor J by the motor constant k, against the friction d; between them a gear to a load, if given."""

    def __init__(
        self, voltage: Scalar, R: float, L: float, k: float, J: float, d: float, gear: tuple[float, float] | None = None
    ) -> None:
        self.voltage = voltage
        self.ground, self.source, self.resistor, self.inductor = Ground(), VoltageSource(voltage), Resistor(R), Inductor(L)
        self.motor, self.rotor = ElectromotiveForce(k), Inertia(J)
        self.friction, self.base = RotationalDamper(d), RotationalGround()
        self.connect(self.source.pin_b, self.ground.pin)
        self.connect(self.source.pin_a, self.resistor.pin_a)
        self.connect(self.resistor.pin_b, self.inductor.pin_a)
        self.connect(self.inductor.pin_b, self.motor.pin_a)
        self.connect(self.motor.pin_b, self.ground.pin)
        self.connect(self.motor.flange, self.rotor.flange_a)
        slow = self.rotor
        if gear is not None:
            ratio, load = gear
            self.gear, self.load = Gear(ratio), Inertia(load)
            self.connect(self.rotor.flange_b, self.gear.flange_a)
            self.connect(self.gear.flange_b, self.load.flange_a)
            slow = self.load
        self.connect(slow.flange_b, self.friction.flange_a)
        self.connect(self.friction.flange_b, self.base.flange)
