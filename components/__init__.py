"""The catalogue of parts.

Bodies: World, RigidBody, Particle, Fixed; elastic: FlexibleBeam (with its Section), FlexibleBody (by ShapeIntegrals). Joints: Revolute, Prismatic, Cylindrical, Screw, Universal, Spherical, Planar,
CartesianTranslation, Free, PrescribedMotion, Rod (massless). Contacts: RollingBall, RollingDisk, RollingTorus, RollingEllipsoid, PointOnPlane. Forces: Spring, Damper,
SpringDamper, NonlinearSpring, NonlinearDamper, Force, Torque. On shafts and joints' flanges: Inertia, RotationalSpring,
RotationalDamper, Gear, ElasticGear, PlanetaryGear, RackAndPinion, TorqueSource, AngleSource, SpeedSource, RotationalGround; along lines: SlidingMass, TranslationalSpring,
TranslationalDamper, ForceSource, PositionSource, VelocitySource, TranslationalGround. In circuits: Resistor, Capacitor, Inductor, Diode,
VoltageSource, CurrentSource, SignalVoltage, Ground, ElectromotiveForce, OperationalAmplifier. Signals: Constant, TimeFunction, Table, Gain, Sum, Integrator,
PID, RotationSensor, TranslationSensor, CurrentSensor, TorqueSensor, ForceSensor,
RelativeRotationSensor, SignalTorque, SignalForce.
"""

from components.amplifier import OperationalAmplifier
from components.bodies import Fixed, Particle, RigidBody
from components.contacts.point_on_plane import PointOnPlane
from components.contacts.rolling_body import RollingBall, RollingEllipsoid
from components.contacts.rolling_wheel import RollingDisk, RollingTorus
from components.electrical import (
    Capacitor,
    CurrentSource,
    Diode,
    ElectromotiveForce,
    Ground,
    Inductor,
    Resistor,
    SignalVoltage,
    VoltageSource,
)
from components.flexible import FlexibleBody, ShapeIntegrals
from components.flexible_beam import FlexibleBeam, Section
from components.forces.applied import Force, Torque
from components.forces.spring import Damper, NonlinearDamper, NonlinearSpring, Spring, SpringDamper
from components.gears import ElasticGear, PlanetaryGear, RackAndPinion
from components.joints.cartesian_translation import CartesianTranslation
from components.joints.cylindrical import Cylindrical
from components.joints.free import Free
from components.joints.planar import Planar
from components.joints.prescribed_motion import PrescribedMotion
from components.joints.prismatic import Prismatic
from components.joints.revolute import Revolute
from components.joints.rod import Rod
from components.joints.screw import Screw
from components.joints.spherical import Spherical
from components.joints.universal import Universal
from components.rotational import (
    AngleSource,
    Gear,
    Inertia,
    RotationalDamper,
    RotationalGround,
    RotationalSpring,
    SpeedSource,
    TorqueSource,
)
from components.sensors import CurrentSensor, ForceSensor, RelativeRotationSensor, TorqueSensor
from components.signals import (
    PID,
    Constant,
    Gain,
    Integrator,
    RotationSensor,
    SignalForce,
    SignalTorque,
    Sum,
    Table,
    TimeFunction,
    TranslationSensor,
)
from components.translational import (
    ForceSource,
    PositionSource,
    SlidingMass,
    TranslationalDamper,
    TranslationalGround,
    TranslationalSpring,
    VelocitySource,
)
from components.world import World

__all__ = [
    "PID", "AngleSource", "Capacitor", "CartesianTranslation", "Constant", "CurrentSensor", "CurrentSource", "Cylindrical", "Damper", "Diode",
    "ElasticGear", "ElectromotiveForce", "Fixed", "FlexibleBeam", "FlexibleBody", "Force", "ForceSensor", "ForceSource", "Free", "Gain", "Gear", "Ground", "Inductor", "Inertia", "Integrator",
    "NonlinearDamper", "NonlinearSpring", "OperationalAmplifier", "Particle", "Planar", "PlanetaryGear", "PointOnPlane", "PositionSource", "PrescribedMotion", "Prismatic", "RackAndPinion", "RelativeRotationSensor", "Resistor", "Revolute", "RigidBody", "Rod",
    "RollingBall", "RollingDisk", "RollingEllipsoid", "RollingTorus", "RotationSensor", "RotationalDamper", "RotationalGround",
    "RotationalSpring", "Screw", "Section", "ShapeIntegrals", "SignalForce", "SignalTorque", "SignalVoltage", "SlidingMass", "SpeedSource", "Spherical", "Spring",
    "SpringDamper", "Sum", "Table", "TimeFunction", "Torque", "TorqueSensor", "TorqueSource", "TranslationSensor", "TranslationalDamper",
    "TranslationalGround", "TranslationalSpring", "Universal", "VelocitySource", "VoltageSource", "World",
]  # fmt: skip
