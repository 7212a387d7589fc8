"""The catalogue of parts.

Bodies: World, RigidBody, Particle, Fixed; elastic: FlexibleBeam (with its Section), FlexibleBody (by ShapeIntegrals). Joints: Revolute, Prismatic, Cylindrical, Screw, Universal, Spherical, Planar,
CartesianTranslation, Free, PrescribedMotion, PrescribedAngularVelocity, Rod (massless), Cable (over eyelets and pulleys: Pulley; Tangent, CommonTangent, RopeOverWheels), Tendon (TotalLength), Belt (open, crossed, elastic, slipping; StiffBelt, ElasticBelt, SlippingBelt), Rope (taut or slack; LimitedSum), LineOfAction. Guides: PointOnCurve, AlongCurve (curves: Line, Circle, Helix, ParametricCurve, SplineCurve), PointOnSurface (surfaces: Plane, Plate, Sphere,
Cylinder, Torus, Cone, HeightField, Revolution, ParametricSurface, ImplicitSurface). Contacts: Contact (any shape on any surface by any law; shapes: also
Ellipsoid, Disk, ConvexShape, Parallel; laws: Rolling, RollingWithoutPivoting, Sliding, Viscous, Creep, HuntCrossley with SmoothCoulomb, Hard with Coulomb, of a Patch; made of Touching, ContactForce and HardContact), OneSidedPoint (by PointOverSurface, PointOverCurve and HardPoint), RollingCylinder, RollingCone (along a line), KnifeEdge, SteeredAxle, RollingBallOnSurface, RollingBall, RollingDisk, RollingTorus, RollingEllipsoid, PointOnPlane. Forces: Spring, Damper,
SpringDamper, NonlinearSpring, NonlinearDamper, Force, Torque, Bushing, Drag, MagnusForce, PitchingMoment. Held and let go: Latch, PointLatch, Gripper. Robots as their makers describe them: Robot (URDF). Fields on all bodies: CentralField, UniformField, PotentialField, MutualGravitation; RotatingEarth. On shafts and joints' flanges: Inertia, RotationalSpring,
RotationalDamper, Gear, ElasticGear, LossyGear, PlanetaryGear, RackAndPinion, Mimic, TorqueSource, AngleSource, SpeedSource, AngularAccelerationSource, CamFollower, RotationalGround; on flanges of either kind: EndStop, Backlash, ElasticStop, ElasticBacklash, ElasticCoupling, Clutch, Brake, Freewheel, Ratchet; along lines: SlidingMass, TranslationalSpring,
TranslationalDamper, ForceSource, PositionSource, VelocitySource, AccelerationSource, ConstantSum, TranslationalGround. In circuits: Resistor, Capacitor, Inductor, Diode, IdealDiode, Thyristor,
VoltageSource, CurrentSource, SignalVoltage, Ground, ElectromotiveForce, DCMotor, OperationalAmplifier. Signals: Constant, TimeFunction, Table, Gain, Sum, Integrator,
PID, Limiter, Relay, Thermostat, SampleAndHold, RotationSensor, TranslationSensor, CurrentSensor, TorqueSensor, ForceSensor,
RelativeRotationSensor, Accelerometer, Gyro, SignalTorque, SignalForce.
"""

from acausal.language import component as _component
from acausal.language import construction as _construction
from components.amplifier import OperationalAmplifier
from components.belt import Belt, ElasticBelt, SlippingBelt, StiffBelt
from components.bodies import Fixed, Particle, RigidBody
from components.cable import Cable, ConstantSum, LineOfAction, Tendon, TotalLength
from components.cam import CamFollower
from components.clutches import Brake, Clutch, Freewheel
from components.contacts.ball_on_surface import RollingBallOnSurface
from components.contacts.contact import Contact
from components.contacts.contact_force import ContactForce
from components.contacts.hard_contact import HardContact, HardPoint
from components.contacts.knife_edge import KnifeEdge
from components.contacts.laws import (
    Apart,
    Coulomb,
    Creep,
    Hard,
    HuntCrossley,
    Patch,
    Rolling,
    RollingWithoutPivoting,
    Sliding,
    SmoothCoulomb,
    Viscous,
)
from components.contacts.one_sided_point import OneSidedPoint
from components.contacts.point_on_plane import PointOnPlane
from components.contacts.point_over import PointOverCurve, PointOverSurface
from components.contacts.rolling_body import RollingBall, RollingEllipsoid
from components.contacts.rolling_line import RollingCone, RollingCylinder
from components.contacts.rolling_wheel import RollingDisk, RollingTorus
from components.contacts.rough_contact import RoughContact
from components.contacts.steered_axle import SteeredAxle
from components.contacts.touching import Touching
from components.earth import RotatingEarth, Whereabouts
from components.elastic_flanges import ElasticBacklash, ElasticCoupling, ElasticStop
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
from components.fields import CentralField, MutualGravitation, PotentialField, UniformField
from components.flexible import FlexibleBody, ShapeIntegrals
from components.flexible_beam import FlexibleBeam, Section
from components.forces.air import Drag, MagnusForce, PitchingMoment
from components.forces.applied import Force, Torque
from components.forces.bushing import Bushing
from components.forces.spring import Damper, NonlinearDamper, NonlinearSpring, Spring, SpringDamper
from components.gears import ElasticGear, LossyGear, PlanetaryGear, RackAndPinion
from components.geometry.curves import Circle, Helix, Line, ParametricCurve, SplineCurve
from components.geometry.implicit import ImplicitSurface
from components.geometry.shapes import ConvexShape, Disk, Ellipsoid
from components.geometry.surfaces import (
    Cone,
    Cylinder,
    HeightField,
    Parallel,
    ParametricSurface,
    Plane,
    Plate,
    Revolution,
    Sphere,
    Torus,
)
from components.guides.along_curve import AlongCurve
from components.guides.point_on_curve import PointOnCurve
from components.guides.point_on_surface import PointOnSurface
from components.guides.rough_guide import RoughGuide
from components.imu import Accelerometer, Gyro
from components.joint_friction import JointFriction
from components.joints.cartesian_translation import CartesianTranslation
from components.joints.cylindrical import Cylindrical
from components.joints.free import Free
from components.joints.planar import Planar
from components.joints.prescribed_angular_velocity import PrescribedAngularVelocity
from components.joints.prescribed_motion import PrescribedMotion
from components.joints.prismatic import Prismatic
from components.joints.revolute import Revolute
from components.joints.rod import Rod
from components.joints.screw import Screw
from components.joints.spherical import Spherical
from components.joints.universal import Universal
from components.latches import Gripper, Latch, PointLatch
from components.motor import DCMotor
from components.pulley import CommonTangent, Pulley, RopeOverWheels, Tangent
from components.rectifiers import IdealDiode, Thyristor
from components.relays import Limiter, Ratchet, Relay, SampleAndHold, Thermostat
from components.robot import Mimic, Robot
from components.rope import LimitedSum, Rope
from components.rotational import (
    AngleSource,
    AngularAccelerationSource,
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
from components.stops import Backlash, EndStop
from components.translational import (
    AccelerationSource,
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
    "PID",
    "AccelerationSource",
    "Accelerometer",
    "AlongCurve",
    "AngleSource",
    "AngularAccelerationSource",
    "Apart",
    "Backlash",
    "Belt",
    "Brake",
    "Bushing",
    "Cable",
    "CamFollower",
    "Capacitor",
    "CartesianTranslation",
    "CentralField",
    "Circle",
    "Clutch",
    "CommonTangent",
    "Cone",
    "Constant",
    "ConstantSum",
    "Contact",
    "ContactForce",
    "ConvexShape",
    "Coulomb",
    "Creep",
    "CurrentSensor",
    "CurrentSource",
    "Cylinder",
    "Cylindrical",
    "DCMotor",
    "Damper",
    "Diode",
    "Disk",
    "Drag",
    "ElasticBacklash",
    "ElasticBelt",
    "ElasticCoupling",
    "ElasticGear",
    "ElasticStop",
    "ElectromotiveForce",
    "Ellipsoid",
    "EndStop",
    "Fixed",
    "FlexibleBeam",
    "FlexibleBody",
    "Force",
    "ForceSensor",
    "ForceSource",
    "Free",
    "Freewheel",
    "Gain",
    "Gear",
    "Gripper",
    "Ground",
    "Gyro",
    "Hard",
    "HardContact",
    "HardPoint",
    "HeightField",
    "Helix",
    "HuntCrossley",
    "IdealDiode",
    "ImplicitSurface",
    "Inductor",
    "Inertia",
    "Integrator",
    "JointFriction",
    "KnifeEdge",
    "Latch",
    "LimitedSum",
    "Limiter",
    "Line",
    "LineOfAction",
    "LossyGear",
    "MagnusForce",
    "Mimic",
    "MutualGravitation",
    "NonlinearDamper",
    "NonlinearSpring",
    "OneSidedPoint",
    "OperationalAmplifier",
    "Parallel",
    "ParametricCurve",
    "ParametricSurface",
    "Particle",
    "Patch",
    "PitchingMoment",
    "Planar",
    "Plane",
    "PlanetaryGear",
    "Plate",
    "PointLatch",
    "PointOnCurve",
    "PointOnPlane",
    "PointOnSurface",
    "PointOverCurve",
    "PointOverSurface",
    "PositionSource",
    "PotentialField",
    "PrescribedAngularVelocity",
    "PrescribedMotion",
    "Prismatic",
    "Pulley",
    "RackAndPinion",
    "Ratchet",
    "RelativeRotationSensor",
    "Relay",
    "Resistor",
    "Revolute",
    "Revolution",
    "RigidBody",
    "Robot",
    "Rod",
    "Rolling",
    "RollingBall",
    "RollingBallOnSurface",
    "RollingCone",
    "RollingCylinder",
    "RollingDisk",
    "RollingEllipsoid",
    "RollingTorus",
    "RollingWithoutPivoting",
    "Rope",
    "RopeOverWheels",
    "RotatingEarth",
    "RotationSensor",
    "RotationalDamper",
    "RotationalGround",
    "RotationalSpring",
    "RoughContact",
    "RoughGuide",
    "SampleAndHold",
    "Screw",
    "Section",
    "ShapeIntegrals",
    "SignalForce",
    "SignalTorque",
    "SignalVoltage",
    "Sliding",
    "SlidingMass",
    "SlippingBelt",
    "SmoothCoulomb",
    "SpeedSource",
    "Sphere",
    "Spherical",
    "SplineCurve",
    "Spring",
    "SpringDamper",
    "SteeredAxle",
    "StiffBelt",
    "Sum",
    "Table",
    "Tangent",
    "Tendon",
    "Thermostat",
    "Thyristor",
    "TimeFunction",
    "Torque",
    "TorqueSensor",
    "TorqueSource",
    "Torus",
    "TotalLength",
    "Touching",
    "TranslationSensor",
    "TranslationalDamper",
    "TranslationalGround",
    "TranslationalSpring",
    "UniformField",
    "Universal",
    "VelocitySource",
    "Viscous",
    "VoltageSource",
    "Whereabouts",
    "World",
]

for _kind in map(globals().__getitem__, __all__):  # shapes, curves and laws are no parts, whose arguments are checked anyway
    if not issubclass(_kind, _component.Component):
        _construction.checked_arguments(_kind)
