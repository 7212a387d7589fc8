"""A frame that moves as it is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Parameter, Scalar, Time, Variable, of_time, scalar, sx, time, vector
from acausal.language.origin import origin
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, product, rotation_about_z, symbolic, vee
from components.orientation import Axis, axis_vector, mounting


@final
class PrescribedMotion(AbstractJoint):
    """frame_b moves in frame_a as functions of time say: a shaking table, a ship, a crane's trolley. No freedom.

    `position` (3,) [m]: of frame_b's origin in frame_a; `angle` [rad] about `axis`. Numbers, expressions in `ac.time` and
    parameters, or functions of time. R_ab = exp([axis]x angle). Its power is counted in the energy balance.
    Raises `ParameterError` for what has no known rate (inputs, variables), and for an axis of length zero.

        scene.table = PrescribedMotion(position=(0.1 * ca.sin(3.0 * ac.time), 0.0, 0.0))
    """

    q = Variable("", "none", size=0)
    v = Variable("", "none", size=0)

    def __init__(
        self,
        position: Scalar | Callable[[Any], Any] = (0.0, 0.0, 0.0),
        angle: Scalar | Callable[[Any], Any] = 0.0,
        axis: Axis = "z",
    ) -> None:
        self.position = vector(of_time(position), "PrescribedMotion's position", unit="m")
        self.angle = scalar(of_time(angle), "PrescribedMotion's angle", unit="rad")
        self.axis = axis_vector(axis, "PrescribedMotion's axis")
        for name in ("position", "angle", "axis"):
            _check_known(name, getattr(self, name))

    def given_motions(self) -> tuple[Expression, ...]:
        return tuple(given for given in (self.position, self.angle) if isinstance(given, Expression))

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        M = mounting(self.axis)
        R = product(product(M, rotation_about_z(sx(self.angle))), M.T)
        at = ca.substitute([symbolic(R), sx(self.position)], [time.sx], [t])
        return Pose(at[0], at[1])

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        gap = self.pose(ca.SX(0, 1), t).inverse() @ X_ab
        return ca.vertcat(symbolic(gap.position), vee(symbolic(gap.rotation)))

    def coordinates(self, X_ab: Pose) -> ca.SX:
        return ca.SX(0, 1)


def _check_known(name: str, value: object) -> None:
    if isinstance(value, Expression):
        for leaf in value.leaves:
            if not isinstance(leaf, Time | Parameter):
                raise ParameterError(
                    f"PrescribedMotion's {name} depends on the {leaf.kind} {leaf.name}, whose rate is not known ({origin()}). Use functions "
                    "of ac.time and parameters; to follow an input or a variable, put a source on a joint's flange."
                )
