"""Motion of a mechanism with one freedom from its closed-form geometry: an independent formulation without constraints.

Every body's pose is a function of one angle q, so that T = m(q) q'^2 / 2 with m = sum of mass |c'|^2 + w' I w, and Lagrange's equation
is m q'' + m' q'^2 / 2 + V' = Q. Derivatives by CasADi, integrated by scipy's DOP853.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Moving:
    """A body: mass [kg], central inertia (3, 3) in body axes, centre (3, 1) and rotation (3, 3) as functions of the angle."""

    mass: float
    inertia: Any
    centre: ca.SX
    rotation: ca.SX


@dataclass(frozen=True)
class OneFreedom:
    """`q`: the angle; `rate`: its rate; `bodies`; `gravity` (3,); `effort`: generalised force Q(q, rate); `inertia`: more of it."""

    q: ca.SX
    rate: ca.SX
    bodies: Sequence[Moving]
    gravity: tuple[float, float, float]
    effort: ca.SX | float = 0.0
    inertia: float = 0.0

    def acceleration(self, *more: ca.SX) -> ca.Function:
        """(q, rate, `more` symbols of the effort) -> q''."""
        m, V = ca.SX(self.inertia), ca.SX(0)
        for body in self.bodies:
            velocity = ca.jacobian(body.centre, self.q)
            spin = ca.inv_skew(body.rotation.T @ ca.reshape(ca.jacobian(ca.vec(body.rotation), self.q), 3, 3))
            m += body.mass * ca.dot(velocity, velocity) + ca.dot(spin, ca.DM(body.inertia) @ spin)
            V -= body.mass * ca.dot(ca.DM(self.gravity), body.centre)
        slope = ca.jacobian(m, self.q) * self.rate**2 / 2 + ca.jacobian(V, self.q)
        return ca.Function("acceleration", [self.q, self.rate, *more], [(self.effort - slope) / m])

    def motion(self, q: float, rate: float, times: Sequence[float]) -> np.ndarray:
        """Angle and rate (2, n) at `times`, from the first of them."""
        f = self.acceleration()

        def derivative(t: float, y: np.ndarray) -> list[float]:
            return [y[1], float(f(y[0], y[1]))]

        span = (times[0], times[-1])
        return solve_ivp(derivative, span, [q, rate], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=times).y


def turn_x(a: ca.SX) -> ca.SX:
    """Rotation about x."""
    c, s = ca.cos(a), ca.sin(a)
    return ca.blockcat([[1, 0, 0], [0, c, -s], [0, s, c]])


def turn_y(a: ca.SX) -> ca.SX:
    """Rotation about y."""
    c, s = ca.cos(a), ca.sin(a)
    return ca.blockcat([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def turn_z(a: ca.SX) -> ca.SX:
    """Rotation about z."""
    c, s = ca.cos(a), ca.sin(a)
    return ca.blockcat([[c, -s, 0], [s, c, 0], [0, 0, 1]])
