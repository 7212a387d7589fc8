"""Motion in a plane."""

from __future__ import annotations

from typing import final

import casadi as ca
import numpy as np

from acausal.language.expression import Variable
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Matrix, Pose, product, rotation_to_axis, symbolic
from acausal.parts.steps import AbstractStep, Slide, Turn
from components.orientation import Axis, axis_vector, mounting

_ALONG = (rotation_to_axis(np.array([1.0, 0.0, 0.0])), rotation_to_axis(np.array([0.0, 1.0, 0.0])))


@final
class Planar(AbstractStepJoint):
    """frame_b shifts by q[0], q[1] [m] in a plane of frame_a and turns by q[2] [rad] about its `normal`. Three freedoms.

    v = q'. The directions of the shifts follow cyclically on the normal: x, y for normal z; y, z for x; z, x for y.

        scene.table = Planar(normal="z")
    """

    q = Variable("", "displacements [m] (2), angle [rad]", size=3)
    v = Variable("", "velocities [m/s] (2), angular velocity [rad/s]", size=3)

    def __init__(self, normal: Axis = "z") -> None:
        self.normal = axis_vector(normal, "Planar's normal")

    def steps(self) -> tuple[AbstractStep, ...]:
        M = self.mounting()
        return (
            Slide(slice(0, 1), slice(0, 1), product(M, _ALONG[0])),
            Slide(slice(1, 2), slice(1, 2), product(M, _ALONG[1])),
            Turn(slice(2, 3), slice(2, 3), M),
        )

    def mounting(self) -> Matrix:
        return mounting(self.normal)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R = symbolic(X_ab.rotation)
        return ca.vertcat(symbolic(X_ab.position)[2], R[0, 2], R[1, 2])

    def closure_sign(self, X_ab: Pose) -> ca.SX:
        return symbolic(X_ab.rotation)[2, 2]

    def coordinates(self, X_ab: Pose) -> ca.SX:
        R, p = symbolic(X_ab.rotation), symbolic(X_ab.position)
        return ca.vertcat(p[0], p[1], ca.atan2(R[1, 0], R[0, 0]))
