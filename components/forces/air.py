"""What a medium does to a point or a body that moves through it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.language.connector import Frame, Point
from acausal.language.expression import Expression, Scalar, of_time, scalar, sx, vector
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic
from components.orientation import Axis, axis_vector

_UNCONNECTED = "It acts on nothing: connect it to a body."
_LEAST = 1e-300
"""Added to squares of speeds, where it changes nothing but the slope at rest, which is 0 / 0 otherwise."""


class AbstractAirForce(AbstractForce, ABC):
    """A force by the velocity relative to a medium that moves with `wind` (3,) [m/s] in the world. Must provide `push`."""

    point = Point.port(must_connect=True, if_unconnected=_UNCONNECTED)

    def _set_wind(self, wind: Scalar | Callable[[Any], Any]) -> None:
        self.wind = vector(of_time(wind), f"{type(self).__name__}'s wind", unit="m/s")

    @abstractmethod
    def push(self, velocity: ca.SX, placement: Placement) -> ca.SX:
        """Force (3, 1) [N] for the velocity through the medium (3, 1) [m/s], both in the axes of the point."""

    @final
    def actions(self, placement: Placement) -> tuple[Action, ...]:
        return (Action(self.point, self.push(_through_air(self.point, self.wind, placement), placement), ca.SX.zeros(3)),)


@final
class Drag(AbstractAirForce):
    """Resistance against the motion through a medium: linear v + quadratic |v| v, against the velocity v relative to it.

    `linear` [N*s/m] >= 0 (Stokes: 6 pi viscosity radius), `quadratic` [kg/m] >= 0 (density C_d area / 2); `wind` (3,) [m/s]: velocity of the medium.

        scene.drag = Drag(quadratic=0.5 * 1.2 * 0.47 * 0.004)
    """

    def __init__(
        self, *, linear: Scalar = 0.0, quadratic: Scalar = 0.0, wind: Scalar | Callable[[Any], Any] = (0.0, 0.0, 0.0)
    ) -> None:
        self.linear = scalar(linear, "Drag's linear", non_negative=True, unit="N*s/m")
        self.quadratic = scalar(quadratic, "Drag's quadratic", non_negative=True, unit="kg/m")
        self._set_wind(wind)

    def push(self, velocity: ca.SX, placement: Placement) -> ca.SX:
        quadratic = sx(self.quadratic)
        return -(sx(self.linear) + (0 if quadratic.is_zero() else quadratic * _speed(velocity))) * velocity


@final
class MagnusForce(AbstractAirForce):
    """Lift of a spinning ball: coefficient w x v, w its angular velocity, v the velocity of its centre through the medium.

    `coefficient` [kg]; of a smooth ball in a perfect fluid 8/3 pi density radius^3, of real ones a part of it. Connect its `point` to a frame of the
    ball's centre. `wind` as for `Drag`.

        scene.lift = MagnusForce(coefficient=5e-4)
    """

    turns = True
    point = Frame.port(must_connect=True, if_unconnected=_UNCONNECTED)

    def __init__(self, coefficient: Scalar, *, wind: Scalar | Callable[[Any], Any] = (0.0, 0.0, 0.0)) -> None:
        self.coefficient = scalar(coefficient, "MagnusForce's coefficient", unit="kg")
        self._set_wind(wind)

    def push(self, velocity: ca.SX, placement: Placement) -> ca.SX:
        return sx(self.coefficient) * ca.cross(placement.angular_velocity(self.point), velocity)


@final
class PitchingMoment(AbstractForce):
    """Moment that a medium exerts on a slender body: coefficient |v| (v x axis), v the velocity of its frame through it.

    Positive coefficients [kg] turn the axis away from the velocity, as the air does to the nose of a football (overturning: density C_M' area
    length / 2); negative ones into it, as tail fins do. `axis` of the frame points to the nose. `wind` as for `Drag`.

        scene.nose = PitchingMoment(coefficient=1e-3, axis="x")
    """

    turns = True
    frame = Frame.port(must_connect=True, if_unconnected=_UNCONNECTED)

    def __init__(self, coefficient: Scalar, axis: Axis = "x", *, wind: Scalar | Callable[[Any], Any] = (0.0, 0.0, 0.0)) -> None:
        self.coefficient = scalar(coefficient, "PitchingMoment's coefficient", unit="kg")
        self.axis = axis_vector(axis, "PitchingMoment's axis")
        self.wind = vector(of_time(wind), "PitchingMoment's wind", unit="m/s")

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        velocity = _through_air(self.frame, self.wind, placement)
        moment = sx(self.coefficient) * _speed(velocity) * ca.cross(velocity, sx(self.axis))
        return (Action(self.frame, ca.SX.zeros(3), moment),)


def _speed(velocity: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(velocity) + _LEAST)


def _through_air(connector: Point, wind: np.ndarray | Expression, placement: Placement) -> ca.SX:
    """Velocity of a connector against a medium that moves with `wind` in the world, in the connector's axes."""
    velocity, moved = placement.velocity(connector), sx(wind)
    return velocity if moved.is_zero() else velocity - symbolic(placement.pose(connector).rotation).T @ moved
