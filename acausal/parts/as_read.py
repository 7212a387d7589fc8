"""Places and motions of connectors as they are read of them: for energies and powers of single parts, as expressions."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.connector import Frame, Point
from acausal.language.equation import der
from acausal.language.expression import Expression, declared_in, time
from acausal.parts.pose import Pose, symbolic


@final
class AsRead:
    """A `Placement` whose symbols are those of the connectors; the axes of a point alone are the world's."""

    @property
    def t(self) -> ca.SX:
        """Time [s]."""
        return time.sx

    def pose(self, connector: Point) -> Pose:
        """X_WC."""
        return Pose(_rotation(connector), connector.position.sx)

    def relative_pose(self, a: Point, b: Point) -> Pose:
        """X_ab."""
        return self.pose(a).inverse() @ self.pose(b)

    def velocity(self, connector: Point) -> ca.SX:
        """Of its origin, in its own axes [m/s]."""
        return _rotation(connector).T @ connector.velocity.sx

    def angular_velocity(self, connector: Point) -> ca.SX:
        """In its own axes [rad/s]; zero of a point alone."""
        return _rotation(connector).T @ connector.angular_velocity.sx if isinstance(connector, Frame) else ca.SX.zeros(3)

    def rate(self, expression: ca.SX) -> ca.SX:
        """Time derivative."""
        return der(as_read(expression)).sx


def as_read(value: ca.SX) -> Expression:
    """Of symbols that were declared."""
    return Expression(value, declared_in(value))


def _rotation(connector: Point) -> ca.SX:
    return symbolic(connector.rotation.sx) if isinstance(connector, Frame) else ca.SX.eye(3)
