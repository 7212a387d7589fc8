"""A frame that turns as fast as it is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Input, Parameter, Scalar, Time, Variable, of_time, sx, time, vector
from acausal.language.origin import origin
from acausal.parts.courses import Courses
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, quaternion_rate, rotation_from_quaternion


@final
class PrescribedAngularVelocity(AbstractJoint):
    """frame_b turns about the common origin with a given angular velocity against frame_a, seen in frame_b. No freedom; q, a unit quaternion of
    R_ab with the scalar first, is a state: q' = q (0, w) / 2. Behind it stand the values of the inputs in w.

    `angular_velocity` (3,) [rad/s]: numbers, expressions in `ac.time`, parameters and inputs, a function of time, or a spline of scipy. The course of an
    input has a rate, see SpeedSource. Its power is counted in the energy balance. Raises `ParameterError` for what has no known rate (variables).

        scene.spun = PrescribedAngularVelocity(lambda t: (0.1, 0.0, ca.sin(t)))
    """

    q = Variable("", "unit quaternion, scalar first", size=4, start=(1.0, 0.0, 0.0, 0.0))
    v = Variable("", "none", size=0)

    def __init__(self, angular_velocity: Scalar | Callable[[Any], Any]) -> None:
        self.angular_velocity = vector(of_time(angular_velocity), "PrescribedAngularVelocity's angular_velocity", unit="rad/s")
        given = self.angular_velocity
        for leaf in given.leaves if isinstance(given, Expression) else ():
            if not isinstance(leaf, Time | Parameter | Input):
                raise ParameterError(
                    f"PrescribedAngularVelocity's angular_velocity depends on the {leaf.kind} {leaf.name}, whose rate is not known ({origin()}). Use "
                    "functions of ac.time, parameters and inputs; to follow a variable, put a SpeedSource on a joint's flange."
                )
        self._courses = Courses.of(given, rates=1)
        self._declare("q", "", 4 + self._courses.size, (1.0, 0.0, 0.0, 0.0) + (0.0,) * self._courses.size)

    def given_motions(self) -> tuple[Expression, ...]:
        return (self.angular_velocity,) if isinstance(self.angular_velocity, Expression) else ()

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        return Pose(rotation_from_quaternion(q[:4]), np.zeros(3))

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        w = self._courses.put(ca.substitute(sx(self.angular_velocity), time.sx, t), q[4:])
        return ca.vertcat(quaternion_rate(q[:4], w), self._courses.changes)

    def followed(self, q: ca.SX) -> ca.SX:
        return q[4:] - self._courses.symbols

    def turns(self) -> tuple[bool, ...]:
        return (True,) * self.q.size

    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        return 0.5 * (ca.sumsqr(q[:4]) - 1)
