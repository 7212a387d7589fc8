"""The catalogue of parts.

Bodies: World, RigidBody, Particle, Fixed. Joints: Revolute, Prismatic, Cylindrical, Screw, Universal, Spherical, Planar,
CartesianTranslation, Free. Contacts: RollingBall, RollingDisk, RollingTorus, RollingEllipsoid. Forces: Spring, Damper,
SpringDamper, NonlinearSpring, NonlinearDamper, Force, Torque. On shafts and joints' flanges: Inertia, RotationalSpring,
RotationalDamper, Gear, TorqueSource, RotationalGround; along lines: SlidingMass, TranslationalSpring, TranslationalDamper,
ForceSource, TranslationalGround.
"""

from components.bodies import Fixed, Particle, RigidBody
from components.contacts.rolling import RollingBall, RollingDisk, RollingEllipsoid, RollingTorus
from components.forces.applied import Force, Torque
from components.forces.spring import Damper, NonlinearDamper, NonlinearSpring, Spring, SpringDamper
from components.joints.cartesian_translation import CartesianTranslation
from components.joints.cylindrical import Cylindrical
from components.joints.free import Free
from components.joints.planar import Planar
from components.joints.prismatic import Prismatic
from components.joints.revolute import Revolute
from components.joints.screw import Screw
from components.joints.spherical import Spherical
from components.joints.universal import Universal
from components.rotational import Gear, Inertia, RotationalDamper, RotationalGround, RotationalSpring, TorqueSource
from components.translational import ForceSource, SlidingMass, TranslationalDamper, TranslationalGround, TranslationalSpring
from components.world import World

__all__ = [
    "CartesianTranslation", "Cylindrical", "Damper", "Fixed", "Force", "ForceSource", "Free", "Gear", "Inertia", "NonlinearDamper",
    "NonlinearSpring", "Particle", "Planar", "Prismatic", "Revolute", "RigidBody", "RollingBall", "RollingDisk", "RollingEllipsoid",
    "RollingTorus", "RotationalDamper", "RotationalGround", "RotationalSpring", "Screw", "SlidingMass", "Spherical", "Spring",
    "SpringDamper", "Torque", "TorqueSource", "TranslationalDamper", "TranslationalGround", "TranslationalSpring", "Universal", "World",
]  # fmt: skip
