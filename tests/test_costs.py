"""What parts cost: states, exactly, and operations of right sides, at most, of the scenes on their pages."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.append(str(Path(__file__).parents[1] / "docs"))

from tools.catalogue import catalogue
from tools.scenes import script_of

COSTS = {
    "Fixed": (13, 43), "Particle": (13, 43), "RigidBody": (13, 115), "FlexibleBeam": (6, 296), "FlexibleBody": (4, 47),
    "CartesianTranslation": (6, 0), "Cylindrical": (4, 7), "Planar": (6, 53), "PrescribedAngularVelocity": (4, 18), "PrescribedMotion": (0, 0),
    "Prismatic": (2, 0), "Revolute": (2, 7), "Rod": (6, 61), "Screw": (2, 7), "Spherical": (7, 91), "Universal": (4, 91), "AlongCurve": (2, 279),
    "PointOnCurve": (2, 20), "PointOnSurface": (4, 32), "RoughGuide": (2, 100), "Circle": (2, 21), "Cone": (4, 53), "ConvexShape": (9, 308),
    "Cylinder": (4, 20), "Disk": (9, 175), "Ellipsoid": (9, 445), "HeightField": (4, 33), "Helix": (2, 23), "ImplicitSurface": (9, 191),
    "Line": (2, 0), "Parallel": (4, 319), "ParametricCurve": (2, 18), "ParametricSurface": (4, 56), "Plane": (4, 0), "Plate": (4, 0),
    "Revolution": (4, 72), "Sphere": (6, 188), "Torus": (4, 78), "Apart": (13, 657), "Contact": (13, 110), "Coulomb": (13, 450), "Creep": (22, 1033),
    "HardPoint": (4, 352), "KnifeEdge": (6, 10), "PointOnPlane": (11, 154), "PointOverSurface": (13, 417), "RollingBall": (9, 202),
    "RollingBallOnSurface": (9, 348), "RollingCone": (2, 360), "RollingCylinder": (2, 77), "RollingDisk": (8, 49), "RollingEllipsoid": (9, 237),
    "RollingTorus": (8, 115), "RollingWithoutPivoting": (8, 335), "RoughContact": (11, 948), "Sliding": (11, 483), "SmoothCoulomb": (13, 174),
    "SteeredAxle": (6, 78), "Bushing": (13, 441), "Damper": (2, 32), "Drag": (13, 115), "Force": (13, 86), "MagnusForce": (13, 113),
    "NonlinearDamper": (2, 34), "NonlinearSpring": (2, 26), "PitchingMoment": (13, 94), "Spring": (2, 21), "SpringDamper": (2, 34),
    "Torque": (13, 44), "CentralField": (6, 16), "MutualGravitation": (18, 69), "PotentialField": (13, 148), "RotatingEarth": (6, 16),
    "UniformField": (13, 87), "AngleSource": (0, 0), "AngularAccelerationSource": (2, 0), "CamFollower": (2, 19), "ElasticGear": (4, 14),
    "Gear": (2, 4), "Inertia": (2, 4), "LossyGear": (2, 33), "PlanetaryGear": (2, 0), "RackAndPinion": (2, 8), "Mimic": (4, 78), "RotationalDamper": (4, 11),
    "RotationalSpring": (4, 11), "SpeedSource": (1, 0), "TorqueSource": (2, 4), "AccelerationSource": (2, 0), "ForceSource": (2, 3),
    "PositionSource": (0, 0), "SlidingMass": (2, 6), "TranslationalDamper": (4, 11), "TranslationalGround": (2, 3), "VelocitySource": (1, 0),
    "Capacitor": (1, 3), "CurrentSource": (1, 4), "DCMotor": (3, 11), "Diode": (2, 10), "ElectromotiveForce": (3, 11),
    "OperationalAmplifier": (1, 3), "SignalVoltage": (1, 7), "Constant": (1, 0), "ForceSensor": (2, 0), "Gain": (2, 5), "Integrator": (2, 2),
    "PID": (4, 17), "RelativeRotationSensor": (4, 9), "Table": (2, 6), "Belt": (4, 22), "Cable": (4, 46), "Tendon": (2, 27), "Brake": (2, 40),
    "Clutch": (4, 13), "Freewheel": (6, 70), "ElasticBacklash": (6, 38), "ElasticStop": (2, 8), "Accelerometer": (13, 43), "Gyro": (13, 43),
    "JointFriction": (2, 60), "Gripper": (21, 3114), "CommonTangent": (12, 707), "IdealDiode": (1, 31), "Thyristor": (1, 31), "Limiter": (1, 4),
    "Ratchet": (2, 11), "Relay": (1, 2), "SampleAndHold": (1, 0), "Thermostat": (1, 1), "LimitedSum": (6, 51),
}  # fmt: skip
"""By part: states, operations; of other parts that a scene shows, too, by the first of them."""


def scenes() -> dict[str, str]:
    """Scripts of different scenes until they are built, by the first part that each shows."""
    found: dict[str, str] = {}
    for kind in catalogue():
        script, built, _ = script_of(kind).partition("model = ac.build(scene)\n")
        if built:
            found.setdefault(script + built, kind.name)
    return {name: script for script, name in found.items()}


SCENES = scenes()


def test_each_scene_of_a_part_s_page_has_its_costs() -> None:
    assert SCENES.keys() == COSTS.keys()


@pytest.mark.parametrize("name", SCENES)
def test_what_a_part_costs(name: str) -> None:
    space: dict[str, Any] = {}
    exec(SCENES[name], space)  # a page of ours
    states, operations = COSTS[name]
    model = space["model"]
    assert len(model.state_names) == states and model.operations <= operations
