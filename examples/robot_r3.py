"""A robot of six axes with its drives: path, controllers, motors with their current circuits, elastic gears, arm. No equation by hand.

Parameters as in Modelica.Mechanics.MultiBody.Examples.Systems.RobotR3.FullRobot (Modelica Standard Library 4.0; the Manutec r3, M. Otter
and S. Tuerk, DFVLR-Mitteilung 88-13, 1988). Of its bearings' friction the viscous part is taken, dry friction left out.

    python examples/robot_r3.py
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import acausal as ac
from components import (
    PID,
    Capacitor,
    CurrentSensor,
    ElasticGear,
    ElectromotiveForce,
    Gain,
    Gear,
    Ground,
    Inductor,
    Inertia,
    OperationalAmplifier,
    Resistor,
    Revolute,
    RigidBody,
    RotationalDamper,
    RotationalGround,
    RotationSensor,
    SignalVoltage,
    Sum,
    TimeFunction,
    World,
)

LIMIT = 1e-4  # of what main returns

BEGIN = np.radians((-60, 20, 90, 0, -110, 0))  # rad
END = np.radians((60, -70, -35, 45, 110, 45))
SPEED, ACCELERATION = np.array((3, 1.5, 5, 3.1, 3.1, 4.1)), np.array((15, 15, 15, 60, 60, 60))  # largest ones, rad/s and rad/s^2


class Arm(ac.System):
    """The six links with a load of 15 kg in the hand; y points up. `joints`: the six hinges."""

    def __init__(self, load_at: tuple[float, float, float] = (0.1, 0.25, 0.1)) -> None:
        self.world = World(gravity=(0, -9.81, 0))
        self.joints = [Revolute(axis) for axis in "yxxyxy"]
        small = (0.001, 0.001, 0.001)
        self.links = [
            RigidBody(1.0, (1.16, 1.16, 1.16)),  # it only turns about y
            RigidBody(56.5, (2.58, 0.64, 2.73, -0.46, 0, 0), (0.172, 0.205, 0)),
            RigidBody(26.4, (0.279, 0.245, 0.413, -0.070, 0, 0), (0.064, -0.034, 0)),
            RigidBody(28.7, (1.67, 0.081, 1.67)),
            RigidBody(5.2, (1.25, 0.81, 1.53)),
            RigidBody(0.5, small, (0.05, 0.05, 0.05)),
        ]
        self.load = RigidBody(15.0, small, load_at)
        lengths = ((0, 0.324, 0.3), (0, 0.65, 0), (0, 0.414, -0.155), (0, 0.186, 0), (0, 0.125, 0), (0, 0, 0))
        frame = self.world.at((0, 0.351, 0))
        for joint, link, length in zip(self.joints, self.links, lengths, strict=True):
            self.connect(frame, joint.frame_a)
            self.connect(joint.frame_b, link.frame)
            frame = link.at(length)
        self.connect(frame, self.load.frame)


@dataclass(frozen=True)
class Path6:
    """The quickest motion of all axes together from `begin` to `end` [rad] within speeds and accelerations: ramps of the speed."""

    begin: np.ndarray
    end: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray

    def corners(self) -> tuple[float, np.ndarray]:
        """Acceleration of the path's fraction [1/s^2], and when it begins, ends, is turned round, and ends [s]."""
        change = np.abs(self.end - self.begin)
        v, a = 1 / np.max(change / self.speed), 1 / np.max(change / self.acceleration)
        rise = min(v / a, np.sqrt(1 / a))
        top = a * rise
        return a, np.array((0, rise, 1 / top, 1 / top + rise))

    def fraction(self, t: Any, derivative: int = 0) -> Any:
        """How much of the way is done at the time t, or its rate, made of ramps."""
        a, corners = self.corners()
        ramps = [ca.fmax(t - corner, 0) for corner in corners]
        return sum(a * sign * (ramp if derivative else ramp * ramp / 2) for sign, ramp in zip((1, -1, -1, 1), ramps, strict=True))


PATH = Path6(BEGIN, END, SPEED, ACCELERATION)


@dataclass(frozen=True)
class Drive:
    """One axis: `ratio` of the gear; motor `k` [N*m/A], `w` [rad/s] and `D` of its current circuit, `J` [kg m^2]; viscous `friction`
    [N*m*s/rad], at the motor where there is a spring [N*m/rad] and `damping` [N*m*s/rad] between, else at the joint."""

    ratio: float
    friction: float
    k: float = 1.1616
    w: float = 5500.0
    D: float = 0.6
    J: float = 0.0013
    spring: float | None = None
    damping: float = 0.0


DRIVES = (
    Drive(-105, 0.13 / 160, w=4590, spring=43, damping=0.005),
    Drive(210, 0.1 / 130, spring=8, damping=0.01),
    Drive(60, 0.2 / 130, spring=58, damping=0.04),
    Drive(-99, 9.8, k=0.2365, w=6250, D=0.55, J=1.6e-4),
    Drive(79.2, 0.03, k=0.2608, w=6250, D=0.55, J=1.8e-4),
    Drive(-99, 3.92, k=0.0842, w=7400, D=0.27, J=4.3e-5),
)


class Motor(ac.System):
    """A motor on `flange` whose current follows the signal `wanted` [A]: amplifiers subtract, integrate and drive the winding.

    With the winding this is a lag of second order: i'' + 2 D w i' + w^2 i = w^2 wanted, apart from the voltage that the turning induces.
    """

    flange = ac.Rotational.port()
    wanted = ac.Signal.port()

    def __init__(self, k: float, w: float, D: float, J: float) -> None:
        self.difference, self.integral, self.power = (OperationalAmplifier() for _ in range(3))
        self.setpoint, self.measured, self.hall = SignalVoltage(), SignalVoltage(), CurrentSensor()
        self.r1, self.r2, self.r3, self.r4 = (Resistor(100.0) for _ in range(4))
        self.ri, self.c, self.rp1, self.rp2 = Resistor(10.0), Capacitor(0.004 * D / w), Resistor(200.0), Resistor(50.0)
        self.ra, self.la = Resistor(250.0), Inductor(250.0 / (2 * D * w))
        self.emf, self.rotor, self.ground = ElectromotiveForce(k), Inertia(J), Ground()

        self.connect(self.wanted, self.setpoint.signal)
        self.connect(self.hall.current, self.measured.signal)
        self.connect(self.setpoint.pin_a, self.r2.pin_a)
        self.connect(self.r2.pin_b, self.difference.minus, self.r1.pin_a)
        self.connect(self.measured.pin_a, self.r3.pin_a)
        self.connect(self.r3.pin_b, self.difference.plus, self.r4.pin_a)
        self.connect(self.r1.pin_b, self.difference.output, self.ri.pin_a)
        self.connect(self.ri.pin_b, self.integral.minus, self.c.pin_a)
        self.connect(self.c.pin_b, self.integral.output, self.power.plus)
        self.connect(self.power.minus, self.rp1.pin_a, self.rp2.pin_a)
        self.connect(self.rp1.pin_b, self.power.output, self.ra.pin_a)
        self.connect(self.ra.pin_b, self.la.pin_a)
        self.connect(self.la.pin_b, self.emf.pin_a)
        self.connect(self.emf.pin_b, self.hall.pin_a)
        self.connect(self.ground.pin, self.hall.pin_b, self.setpoint.pin_b, self.measured.pin_b, self.r4.pin_b, self.rp2.pin_b)
        self.connect(self.ground.pin, self.integral.plus)
        self.connect(self.emf.flange, self.rotor.flange_a)
        self.connect(self.rotor.flange_b, self.flange)


class Axis(ac.System):
    """Reference, controller (position: proportional; speed: PI), motor and gearbox of one axis, on `flange`."""

    flange = ac.Rotational.port()

    def __init__(self, drive: Drive, begin: float, end: float) -> None:
        ratio, way = drive.ratio, end - begin
        self.angle = TimeFunction(lambda t: ratio * (begin + way * PATH.fraction(t)))
        self.speed = TimeFunction(lambda t: ratio * way * PATH.fraction(t, 1))
        self.encoder, self.error, self.stiffness, self.target = RotationSensor(), Sum(1, -1), Gain(5.0), Sum(1, 1)
        self.control, self.motor = PID(0.5, 0.5 / 0.05), Motor(drive.k, drive.w, drive.D, drive.J)
        self.friction, self.ground = RotationalDamper(drive.friction), RotationalGround()
        self.gear = Gear(ratio) if drive.spring is None else ElasticGear(ratio, drive.spring, drive.damping)

        self.connect(self.motor.flange, self.encoder.flange)
        self.connect(self.angle.output, self.error.inputs[0])
        self.connect(self.encoder.angle, self.error.inputs[1])
        self.connect(self.error.output, self.stiffness.input)
        self.connect(self.speed.output, self.target.inputs[0])
        self.connect(self.stiffness.output, self.target.inputs[1])
        self.connect(self.target.output, self.control.setpoint)
        self.connect(self.encoder.speed, self.control.measurement)
        self.connect(self.control.output, self.motor.wanted)
        self.connect(self.ground.flange, self.friction.flange_a)
        self.connect(self.motor.flange, self.gear.flange_a)
        self.connect(self.gear.flange_b, self.flange)
        self.connect(self.friction.flange_b, self.flange if drive.spring is None else self.motor.flange)


class Robot(ac.System):
    """The arm on its six drives."""

    def __init__(self) -> None:
        self.arm = Arm()
        self.axes = [Axis(*of_axis) for of_axis in zip(DRIVES, BEGIN, END, strict=True)]
        for axis, joint in zip(self.axes, self.arm.joints, strict=True):
            self.connect(axis.flange, joint.flange)

    def start(self) -> dict[ac.Expression, object]:
        """At rest where the path begins, springs relaxed, no current."""
        rest = {joint.q: angle for joint, angle in zip(self.arm.joints, BEGIN, strict=True)}
        elastic = {axis.motor.rotor.phi: d.ratio * q for axis, d, q in zip(self.axes, DRIVES, BEGIN, strict=True) if d.spring}
        return {**rest, **elastic}


def main(folder: str | Path = "out") -> float:
    """The move and a second of rest; returns the largest deviation of a motor from the end of the path, in the joint's angle [rad]."""
    scene = Robot()
    began = time.perf_counter()
    model = ac.build(scene)
    print(model)
    print(f"built in {time.perf_counter() - began:.2f} s")
    arrival = PATH.corners()[1][-1]
    run = model.simulate(arrival + 1.0, scene.start(), rtol=1e-7)
    print(run)
    off = [float(run[axis.motor.rotor.phi][-1]) / d.ratio - q for axis, d, q in zip(scene.axes, DRIVES, END, strict=True)]
    sag = [float(run[joint.q][-1]) - q for joint, q in zip(scene.arm.joints, END, strict=True)]
    print(f"the path ends at {arrival:.2f} s; a second later the motors are off by (mrad)", np.round(1e3 * np.array(off), 3))
    print("and the joints, whose gears give way under the load, by (mrad)", np.round(1e3 * np.array(sag), 3))
    print(f"energy balance of arm, gears and circuits to {run.energy_error():.1e}")
    folder = Path(folder)
    run.plot(*(joint.q for joint in scene.arm.joints), path=folder / "robot_r3_angles.png")
    print("written:", run.picture(folder / "robot_r3.png", times=(0.0, 0.8, arrival)), run.animate(folder / "robot_r3.html"))
    return float(np.max(np.abs(off)))


if __name__ == "__main__":
    main()
