"""Surfaces where a function of the place is zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Parameter, Scalar, declared_in, flag, vector
from acausal.language.origin import origin
from acausal.parts.pose import quaternion_rate, rotation_from_quaternion
from components.geometry.laws import place
from components.geometry.surfaces import AbstractSurface

_STEPS = 100
_CLOSE = 1e-9
"""Last step towards the surface, of the distance from where the search began or from the origin, that is short enough to begin with."""


@final
class ImplicitSurface(AbstractSurface):
    """Where `law` (x, y, z) = 0, by numpy's or CasADi's functions; its normal to where the law grows, `flipped`: to where it falls. Without poles or seams.

    `start` (3,) [m]: a place near to it, where a search for it begins. Coordinates: the place (3) [m], and a unit quaternion (4) of axes whose z is the
    normal there and which do not turn about it; velocities: of the place along their x and y [m/s]. Only where the law has a slope: not at a
    cone's apex, not where the surface crosses itself.

        ImplicitSurface(lambda x, y, z: x**2 + 2 * y**2 + z**4 - 1, start=(1.0, 0.0, 0.0))
    """

    def __init__(self, law: Callable[[ca.SX, ca.SX, ca.SX], Any], start: Scalar, *, flipped: bool = False) -> None:
        self._p = ca.SX.sym("p", 3)
        self.law = place("ImplicitSurface", law, "x, y, z", *ca.vertsplit(self._p), rows=1)
        self.side = -1.0 if flag(flipped, "ImplicitSurface's flipped") else 1.0
        near = vector(start, "ImplicitSurface's start", unit="m")
        if not isinstance(near, np.ndarray):
            raise ParameterError(
                f"ImplicitSurface's start is {start!r} ({origin()}). Give three numbers: a search for the surface begins there."
            )
        at, normal = self._found(near)
        self.start = (*at, *turned_to(normal))  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def turns(self) -> tuple[bool, ...]:
        return (False,) * 3 + (True,) * 4

    def point(self, q: ca.SX) -> ca.SX:
        return q[:3]

    def rates(self, q: ca.SX, v: ca.SX) -> ca.SX:
        # the axes turn with the normal, n' = slopes W v, and not about it
        turn = self.curvature(q) @ v
        return ca.vertcat(self.slopes(q) @ v, quaternion_rate(q[3:], ca.vertcat(-turn[1], turn[0], 0)))

    def invariants(self, q: ca.SX) -> ca.SX:
        gradient = self._gradient(q[:3])
        distance = self._law(q[:3]) / ca.norm_2(gradient)
        return ca.vertcat(distance, 0.5 * (ca.sumsqr(q[3:]) - 1), self.slopes(q).T @ gradient / ca.norm_2(gradient))

    def inside(self, q: ca.SX) -> ca.SX:
        gradient = self._gradient(q[:3])
        return ca.dot(self.normal(q), self.side * gradient) / ca.norm_2(gradient)

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.sumsqr(self._gradient(q[:3]))

    def slopes(self, q: ca.SX) -> ca.SX:
        return rotation_from_quaternion(q[3:])[:, :2]

    def normal(self, q: ca.SX) -> ca.SX:
        return rotation_from_quaternion(q[3:])[:, 2]

    def tangents(self, q: ca.SX) -> ca.SX:
        return self.slopes(q)

    def connection(self, q: ca.SX) -> ca.SX:
        return ca.SX(1, 2)

    def metric(self, q: ca.SX) -> ca.SX:
        return ca.SX.eye(2)

    def curvature(self, q: ca.SX) -> ca.SX:
        slopes, bend = self.slopes(q), ca.substitute(ca.hessian(self.law, self._p)[0], self._p, q[:3])
        return self.side * (slopes.T @ bend @ slopes) / ca.norm_2(self._gradient(q[:3]))

    def clearance(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        gradient = self._gradient(p)
        length = ca.norm_2(gradient)
        return self.side * self._law(p) / length, self.side * gradient / length

    def _law(self, p: ca.SX) -> ca.SX:
        return ca.substitute(self.law, self._p, p)

    def _gradient(self, p: ca.SX) -> ca.SX:
        return ca.densify(ca.substitute(ca.gradient(self.law, self._p), self._p, p))

    def _found(self, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A place on the surface and its unit normal, parameters as they are. Raises `ParameterError` where the search comes to none."""
        known = [symbol for symbol in declared_in(self.law) if isinstance(symbol, Parameter)]
        for symbol in declared_in(self.law) - set(known):
            raise ParameterError(
                f"ImplicitSurface's law depends on the {symbol.kind} {symbol.name} ({origin()}). Use numbers and parameters: a surface that moves is fixed in a "
                "frame that does; one that changes its shape with time needs coordinates, e.g. Sphere or ParametricSurface."
            )
        at, values = ca.SX.sym("at", 3), [symbol.value for symbol in known]
        given = ca.vertcat(ca.SX(0, 1), *(symbol.sx for symbol in known))
        f = ca.Function("f", [at, given], [self._law(at), self._gradient(at)])
        p = near
        for _ in range(_STEPS):
            value, slope = (np.array(part).ravel() for part in f(p, values))
            with np.errstate(all="ignore"):
                step = value * slope / (slope @ slope)
            if not np.isfinite(step).all():
                break
            p = p - step
            if np.linalg.norm(step) <= _CLOSE * (np.linalg.norm(p - near) + np.linalg.norm(p)):
                return p, self.side * slope / np.linalg.norm(slope)
        raise ParameterError(
            f"ImplicitSurface: from its start {near} [m] no place is found where the law is zero and has a slope ({origin()}): the search comes to {p}. Give a "
            "start next to the surface, away from where it crosses itself or has an apex."
        )


def turned_to(n: np.ndarray) -> tuple[float, ...]:
    """A unit quaternion (4,) that turns z to a unit vector n (3,): straight, or by way of -z where that is nearer."""
    found = np.array([1 + n[2], -n[1], n[0], 0.0] if n[2] >= 0 else [-n[1], 1 - n[2], 0.0, n[0]])
    return tuple(float(part) for part in found / np.linalg.norm(found))
