"""A Cardan joint."""

from __future__ import annotations

from typing import final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Variable
from acausal.language.origin import origin
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Matrix, Pose, rotation_to_axis, snapped, symbolic
from acausal.parts.steps import AbstractStep, Turn
from components.orientation import Axis, axis_vector


@final
class Universal(AbstractStepJoint):
    """Cardan joint: a turn by q[0] about `axis_a`, fixed in frame_a, then by q[1] about `axis_b`, fixed in frame_b [rad].

    Two freedoms; the axes are perpendicular and cross at the frames' common origin. v = q'.
    Raises `ParameterError` for axes that are not perpendicular.

        scene.cardan = Universal(axis_a="x", axis_b="y")
    """

    q = Variable("rad", "angles", size=2)
    v = Variable("rad/s", "rates of the angles", size=2)

    def __init__(self, axis_a: Axis = "x", axis_b: Axis = "y") -> None:
        a, b = axis_vector(axis_a, "Universal's axis_a"), axis_vector(axis_b, "Universal's axis_b")
        if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
            raise ParameterError(f"Universal's axes must be numbers ({origin()}).")
        if abs(float(a @ b)) > 1e-9:
            raise ParameterError(f"Universal's axes {a} and {b} are not perpendicular ({origin()}).")
        self.axis_a, self.axis_b = a, b

    def steps(self) -> tuple[AbstractStep, ...]:
        first, second = rotation_to_axis(self.axis_a), rotation_to_axis(self.axis_b)
        return (Turn(slice(0, 1), slice(0, 1), first), Turn(slice(1, 2), slice(1, 2), second))

    def mounting(self) -> Matrix:
        return snapped(np.column_stack([self.axis_b, np.cross(self.axis_a, self.axis_b), self.axis_a]))

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return ca.vertcat(symbolic(X_ab.position), symbolic(X_ab.rotation)[2, 0])

    def coordinates(self, X_ab: Pose) -> ca.SX:
        R = symbolic(X_ab.rotation)
        return ca.vertcat(ca.atan2(R[1, 0], R[0, 0]), ca.atan2(R[2, 1], R[2, 2]))
