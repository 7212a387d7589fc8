"""A rotating earth: inertial, earth-fixed and local-level frames, and what a traveller's place and velocity are called there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import casadi as ca
import numpy as np

import acausal.language.expression as language
from acausal.errors import ParameterError
from acausal.language.component import System
from acausal.language.connector import Frame, Point
from acausal.language.expression import Expression, Scalar, scalar, sx
from acausal.language.origin import origin
from acausal.parts.rotations import rotation_about
from components.bodies import Fixed
from components.fields import CentralField
from components.joints.prescribed_motion import PrescribedMotion
from components.world import World


@dataclass(frozen=True)
class Whereabouts:
    """`latitude`, `longitude` [rad], `height` [m] over the sphere, `velocity` (3, 1) [m/s] over the turning ground along north, east and down, and
    `axes` R_EN (3, 3): north, east and down as columns in the earth-fixed frame."""

    latitude: Expression
    longitude: Expression
    height: Expression
    velocity: Expression
    axes: Expression


def _present(value: float | Expression) -> float:
    found = language.evaluated(value) if isinstance(value, Expression) else np.array(value)
    assert found is not None
    return float(found.item())


@final
class RotatingEarth(System):
    """A round earth that turns about z of the inertial frame, and attracts with mu / r^2. The scene's only ground: leave World out.

    `mu` [m^3/s^2] > 0, `radius` [m] > 0, `rate` [rad/s]. Frames: `inertial` (at rest), `fixed` (turns with the earth; x through latitude and longitude 0),
    and as many local-level ones as one asks for, `earth.level(latitude, longitude, height)`, whose axes point north, east and down. Whatever moves is
    simulated in the inertial frame: Coriolis' and centrifugal terms are none of its own. J. Wertz, Spacecraft Attitude Determination (1978).

        scene.earth = RotatingEarth(); scene.pad = scene.earth.level(0.5, 0.1)
    """

    def __init__(self, mu: Scalar = 3.986004418e14, radius: Scalar = 6371000.0, rate: Scalar = 7.292115e-5) -> None:
        self.radius = scalar(radius, "RotatingEarth's radius", positive=True, unit="m")
        self.rate = scalar(rate, "RotatingEarth's rate", unit="rad/s")
        self.world, self.attraction = World(None), CentralField(scalar(mu, "RotatingEarth's mu", positive=True, unit="m^3/s^2"))
        self.turning = PrescribedMotion(angle=self.rate * language.time, axis="z")
        self.ground = Fixed()
        self.connect(self.world.frame, self.turning.frame_a)
        self.connect(self.turning.frame_b, self.ground.frame_a)
        self.stations: list[Fixed] = []

    @property
    def inertial(self) -> Frame:
        """At rest, its origin in the middle of the earth, z to the north."""
        return self.world.frame

    @property
    def fixed(self) -> Frame:
        """It turns with the earth."""
        return self.ground.frame_b

    def level(self, latitude: float, longitude: float, height: Scalar = 0.0) -> Frame:
        """A frame fixed in the earth at latitude and longitude [rad] and a height [m] over the sphere: x to the north, y to the east, z down."""
        lat, lon = (
            language.number(value, f"RotatingEarth.level's {name}")
            for value, name in ((latitude, "latitude"), (longitude, "longitude"))
        )
        if not abs(lat) <= np.pi / 2:
            raise ParameterError(
                f"RotatingEarth.level's latitude is {lat:g} rad ({origin()}), beyond a pole: it must be from -pi / 2 to pi / 2. Degrees are np.radians(48)."
            )
        R = rotation_about(np.array([0.0, 0.0, 1.0]), lon) @ rotation_about(np.array([0.0, 1.0, 0.0]), -lat - np.pi / 2)
        out = -R[:, 2]
        distance = self.radius + scalar(height, "RotatingEarth.level's height", unit="m")
        position = [float(x) * distance for x in out]
        station = Fixed(position, rotation=R)
        self.connect(self.fixed, station.frame_a)
        self.stations.append(station)
        return station.frame_b

    def place(self, latitude: float, longitude: float, height: float = 0.0, t: float = 0.0) -> np.ndarray:
        """(3,) [m] in the inertial frame at time t [s], for start values; of parameters the present values."""
        radius, rate = (_present(value) for value in (self.radius, self.rate))
        turn = longitude + rate * t
        flat = np.cos(latitude)
        return (radius + height) * np.array([flat * np.cos(turn), flat * np.sin(turn), np.sin(latitude)])

    def whereabouts(self, traveller: Point) -> Whereabouts:
        """Of a point of the scene, as expressions: for outputs, start values, forces. At the poles the longitude has no value."""
        turned = self.fixed.rotation.T
        p, leaves = (turned @ traveller.position).sx, turned.leaves | traveller.position.leaves
        along = Expression(
            turned.sx @ (traveller.velocity.sx - ca.cross(self.fixed.angular_velocity.sx, traveller.position.sx)),
            leaves | traveller.velocity.leaves | self.fixed.angular_velocity.leaves,
        )
        across = ca.sqrt(p[0] * p[0] + p[1] * p[1])
        r = ca.sqrt(ca.sumsqr(p))
        s, c, sl, cl = p[2] / r, across / r, p[1] / across, p[0] / across
        axes = ca.vertcat(ca.horzcat(-s * cl, -sl, -c * cl), ca.horzcat(-s * sl, cl, -c * sl), ca.horzcat(c, 0, -s))
        R = Expression(axes, leaves)
        return Whereabouts(
            Expression(ca.atan2(p[2], across), leaves),
            Expression(ca.atan2(p[1], p[0]), leaves),
            Expression(r, leaves) - Expression(sx(self.radius), language.leaves(self.radius)),
            R.T @ along,
            R,
        )
