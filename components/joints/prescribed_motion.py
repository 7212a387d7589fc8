"""A frame that moves as it is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Input, Parameter, Scalar, Time, Variable, of_time, scalar, sx, time, vector
from acausal.language.origin import origin
from acausal.parts.courses import Courses
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, product, rotation_about_z, symbolic, vee
from components.orientation import Axis, Rotation, axis_vector, mounting, rotation_matrix


@final
class PrescribedMotion(AbstractJoint):
    """frame_b moves in frame_a as functions of time or inputs say: a shaking table, a ship, a crane's trolley. No freedom.

    `position` (3,) [m]: of frame_b's origin in frame_a; `angle` [rad] about `axis`. Numbers, expressions in `ac.time`, parameters and inputs, or
    functions of time. `rotation` (before that turn): any way to give one, of such values; samples of quaternions by a spline,
    ("quaternion xyzw", CubicSpline(times, q)), whose values are brought to length 1. R_ab = rotation exp([axis]x angle).

    Each input makes two states, q: the values of all inputs, then their rates. Numbers (held), smooth splines and formulas of time have two rates;
    of other functions give them too: inputs={scene.x: (function, its rate, its second rate)}. Its power is counted in the energy balance.
    Raises `ParameterError` for what has no known rate (variables), for an axis of length zero, and for what is no rotation at some time.

        scene.table = PrescribedMotion(position=(0.1 * ca.sin(3.0 * ac.time), 0.0, 0.0))
        scene.ship = PrescribedMotion(rotation=("intrinsic zyx", lambda t: (0.1 * t, 0.05 * ca.sin(t), 0.2 * ca.cos(t))))
    """

    q = Variable("", "none", size=0)
    v = Variable("", "none", size=0)

    def __init__(
        self,
        position: Scalar | Callable[[Any], Any] = (0.0, 0.0, 0.0),
        angle: Scalar | Callable[[Any], Any] = 0.0,
        axis: Axis = "z",
        rotation: Rotation | Callable[[Any], Any] = None,
    ) -> None:
        self.position = vector(of_time(position), "PrescribedMotion's position", unit="m")
        self.angle = scalar(of_time(angle), "PrescribedMotion's angle", unit="rad")
        self.axis = axis_vector(axis, "PrescribedMotion's axis")
        self.rotation = _rotation_of_time(rotation)
        for name in ("position", "angle", "axis", "rotation"):
            _check_known(name, getattr(self, name))
        self._courses = Courses.of(self.position, self.angle, self.rotation, rates=2)
        self._declare("q", "", self._courses.size)
        if isinstance(self.rotation, Expression):
            _check_rotation(self.rotation)

    def given_motions(self) -> tuple[Expression, ...]:
        return tuple(given for given in (self.position, self.angle, self.rotation) if isinstance(given, Expression))

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        M = mounting(self.axis)
        R = product(product(M, rotation_about_z(sx(self.angle))), M.T)
        if self.rotation is not None:
            R = product(self.rotation.sx if isinstance(self.rotation, Expression) else self.rotation, R)
        at = ca.substitute([symbolic(R), sx(self.position)], [time.sx], [t])
        return Pose(self._courses.put(at[0], q), self._courses.put(at[1], q))

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        n = len(self._courses.inputs)
        return ca.vertcat(q[n:], self._courses.changes[n:])

    def followed(self, q: ca.SX) -> ca.SX:
        return q - self._courses.symbols

    def turns(self) -> tuple[bool, ...]:
        return 2 * tuple(entry.is_angle for entry in self._courses.inputs)

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX | None:
        if self._courses.size:
            return None
        gap = self.pose(ca.SX(0, 1), t).inverse() @ X_ab
        return ca.vertcat(symbolic(gap.position), vee(symbolic(gap.rotation)))

    def coordinates(self, X_ab: Pose) -> ca.SX | None:
        return None if self._courses.size else ca.SX(0, 1)


def _rotation_of_time(rotation: Any) -> np.ndarray | Expression | None:
    """A matrix (3, 3), of numbers or of time. Raises `ParameterError`."""
    given = rotation
    if isinstance(given, tuple) and len(given) == 2:
        given = (given[0], of_time(given[1]))
    elif type(given).__name__ in ("RotationSpline", "Slerp"):
        raise ParameterError(
            f"PrescribedMotion's rotation is a {type(given).__name__} of scipy ({origin()}), which is no formula that can be differentiated twice. Give a spline "
            'of its quaternions, ("quaternion xyzw", CubicSpline(times, rotations.as_quat())), or of Euler angles.'
        )
    elif callable(given) and not isinstance(given, Expression):
        given = of_time(given)
    return rotation_matrix(given)


def _check_rotation(R: Expression) -> None:
    """At some times, the present values of parameters put in; not where inputs stand in it."""
    parameters = [leaf for leaf in R.leaves if isinstance(leaf, Parameter)]
    if any(isinstance(leaf, Input) for leaf in R.leaves):
        return
    f = ca.Function("R", [time.sx, *(p.sx for p in parameters)], [ca.densify(R.sx)])
    for t in (0.0, 0.37, 1.91):
        found = np.array(f(t, *(p.value for p in parameters)))
        if np.isfinite(found).all() and (np.max(np.abs(found.T @ found - np.eye(3))) > 1e-9 or np.linalg.det(found) < 0):
            raise ParameterError(
                f"PrescribedMotion's rotation is no right-handed orthogonal matrix at t = {t} s ({origin()}): {found.tolist()}. Give Euler angles, a quaternion "
                "or a rotation vector as functions of time, and the matrix follows."
            )


def _check_known(name: str, value: object) -> None:
    if isinstance(value, Expression):
        for leaf in value.leaves:
            if not isinstance(leaf, Time | Parameter | Input):
                raise ParameterError(
                    f"PrescribedMotion's {name} depends on the {leaf.kind} {leaf.name}, whose rate is not known ({origin()}). Use functions "
                    "of ac.time, parameters and inputs; to follow a variable, put a source on a joint's flange."
                )
