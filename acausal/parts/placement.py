"""Where connectors are and how they move: what the author of a force asks for."""

from __future__ import annotations

from typing import Protocol

import casadi as ca

from acausal.language.connector import Point
from acausal.parts.pose import Pose


class Placement(Protocol):
    """Poses and velocities of connectors, in symbols; 3-vectors are (3, 1), rotations (3, 3), SI units.

    Connectors of parts that are not in the scene raise `UnknownVariableError`.
    """

    @property
    def t(self) -> ca.SX:
        """Time [s]."""
        ...

    def pose(self, connector: Point) -> Pose:
        """X_WC: the connector's frame in the world."""
        ...

    def relative_pose(self, a: Point, b: Point) -> Pose:
        """X_ab: the frame of b in the frame of a, by the shortest way through the tree."""
        ...

    def velocity(self, connector: Point) -> ca.SX:
        """Of the connector's origin against the world, in the connector's own axes [m/s]."""
        ...

    def angular_velocity(self, connector: Point) -> ca.SX:
        """Against the world, in the connector's own axes [rad/s]."""
        ...

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative of an expression in poses and time."""
        ...
