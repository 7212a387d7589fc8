"""Forces and torques applied from outside: constants, functions of time, inputs, or what the scene's state makes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.connector import Frame, Point
from acausal.language.expression import Expression, Scalar, of_time, sx, vector
from acausal.language.origin import origin
from acausal.parts.force import AbstractForce, Action
from acausal.parts.placement import Placement
from acausal.parts.pose import symbolic

_UNCONNECTED = "It acts on nothing: connect it to a body."


@final
class Force(AbstractForce):
    """A force on a point: `force` (3,) [N], constants, a function of time, or any expression of inputs, time, and positions, velocities,
    rotations, joints' coordinates, signals, accelerations and reactions of the scene. The latter depend on all forces, this one too: both are
    solved together, beginning without this force; where there is no solution, a run ends.

    `resolved_in`: "world", or "body" for the axes of the body's frame that it is connected to.

        scene.push = Force((1.0, 0, 0))
        scene.shake = Force(lambda t: (ca.sin(t), 0, 0))
        scene.wind = Force(-0.3 * scene.sail.frame.velocity)
        scene.water = Force(-2.0 * scene.hull.frame.acceleration)
    """

    point = Point.port(must_connect=True, if_unconnected=_UNCONNECTED)

    def __init__(self, force: Scalar | Callable[[Any], Any], *, resolved_in: str = "world") -> None:
        self.value = vector(of_time(force), "Force's value", unit="N")
        self.resolved_in = _checked_axes(resolved_in)

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        return (Action(self.point, _resolved(self.value, self.resolved_in, self.point, placement), ca.SX.zeros(3)),)


@final
class Torque(AbstractForce):
    """A torque on a body: `torque` (3,) [N*m]; the value and `resolved_in` as in `Force`.

    scene.motor = Torque((0, 0, 0.1), resolved_in="body")
    """

    turns = True
    frame = Frame.port(must_connect=True, if_unconnected=_UNCONNECTED)

    def __init__(self, torque: Scalar | Callable[[Any], Any], *, resolved_in: str = "world") -> None:
        self.value = vector(of_time(torque), "Torque's value", unit="N*m")
        self.resolved_in = _checked_axes(resolved_in)

    def actions(self, placement: Placement) -> tuple[Action, ...]:
        return (Action(self.frame, ca.SX.zeros(3), _resolved(self.value, self.resolved_in, self.frame, placement)),)


def _checked_axes(resolved_in: Any) -> str:
    if not isinstance(resolved_in, str) or resolved_in not in ("world", "body"):
        raise ParameterError(f"resolved_in is {resolved_in!r} ({origin()}). Use 'world' or 'body'.")
    return resolved_in


def _resolved(value: np.ndarray | Expression, axes: str, connector: Point, placement: Placement) -> ca.SX:
    """In the connector's own axes."""
    given = sx(value)
    return given if axes == "body" else symbolic(placement.pose(connector).rotation).T @ given
