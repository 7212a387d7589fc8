"""A ball joint."""

from __future__ import annotations

from typing import final

import casadi as ca

from acausal.language.expression import Variable
from acausal.parts.joint import AbstractStepJoint
from acausal.parts.pose import Pose, quaternion_from_matrix, symbolic
from acausal.parts.steps import AbstractStep, Ball


@final
class Spherical(AbstractStepJoint):
    """Ball joint: frame_b turns freely about the common origin. Three freedoms.

    q: unit quaternion of R_ab, scalar first. v: angular velocity of frame_b against frame_a, in frame_b [rad/s].

        scene.socket = Spherical()
    """

    if_given_arguments = (
        'A ball joint has no axis. Its frames may be turned: world.at(place, rotation=("x", 1.57)), body.at(...).'
    )
    q = Variable("", "unit quaternion, scalar first", size=4, start=(1.0, 0.0, 0.0, 0.0))
    v = Variable("rad/s", "angular velocity in frame_b", size=3)

    def steps(self) -> tuple[AbstractStep, ...]:
        return (Ball(slice(0, 4), slice(0, 3)),)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        return symbolic(X_ab.position)

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return quaternion_from_matrix(symbolic(X_ab.rotation))

    def velocities(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX) -> ca.SX:
        return w_ab_b
