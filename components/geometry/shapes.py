"""Shapes of bodies that are known by the point that touches a plane: round ones, and edges."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Scalar, scalar, sx, vector
from acausal.language.origin import origin
from acausal.parts.pose import quaternion_rate, rotation_from_quaternion
from components.geometry.laws import place
from components.geometry.surfaces import AbstractSurface


class AbstractShape(AbstractSurface, ABC):
    """A convex shape, its normal outwards: each direction has one point where it is the normal. Must provide `touching`.

    Coordinates: a unit quaternion (4) of axes whose z is the normal and which never turn about z; velocities: their angular velocity about their
    own x and y [rad/s]. Without poles. A shape with edges, where many normals have one point, can roll, but nothing rolls on it.
    """

    unit = "rad"
    start = (1.0, 0.0, 0.0, 0.0)

    @abstractmethod
    def touching(self, n: ca.SX) -> ca.SX:
        """Its point (3, 1) [m] with the outward unit normal `n` (3, 1), with two derivatives in n."""

    @final
    def point(self, q: ca.SX) -> ca.SX:
        return self.touching(self.normal(q))

    @final
    def normal(self, q: ca.SX) -> ca.SX:
        return rotation_from_quaternion(q)[:, 2]

    @final
    def tangents(self, q: ca.SX) -> ca.SX:
        return rotation_from_quaternion(q)[:, :2]

    @final
    def connection(self, q: ca.SX) -> ca.SX:
        return ca.SX(1, 2)

    @final
    def slopes(self, q: ca.SX) -> ca.SX:
        return self._bending(self.normal(q)) @ self._turning(q)

    @final
    def curvature(self, q: ca.SX) -> ca.SX:
        return ca.solve(self.metric(q), self.slopes(q).T @ self._turning(q))

    @final
    def rates(self, q: ca.SX, v: ca.SX) -> ca.SX:
        return quaternion_rate(q, ca.vertcat(v, 0))

    @final
    def invariants(self, q: ca.SX) -> ca.SX:
        return 0.5 * (ca.sumsqr(q) - 1)

    @final
    def inside(self, q: ca.SX) -> ca.SX:
        return self.single(self.normal(q))

    @final
    def regular(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def _turning(self, q: ca.SX) -> ca.SX:
        """How the normal moves with the velocities, (3, 2)."""
        R = rotation_from_quaternion(q)
        return ca.horzcat(-R[:, 1], R[:, 0])

    def _bending(self, n: ca.SX) -> ca.SX:
        """How the point moves with the normal, (3, 3) [m]."""
        at = ca.SX.sym("n", 3)
        return ca.substitute(ca.jacobian(self.touching(at), at), at, n)


@final
class Ellipsoid(AbstractShape):
    """With `semi_axes` (3,) [m] > 0 along the axes, about the origin.

    Ellipsoid((0.2, 0.03, 0.02))
    """

    def __init__(self, semi_axes: Scalar) -> None:
        self.semi_axes = vector(semi_axes, "Ellipsoid's semi_axes", unit="m")
        if isinstance(self.semi_axes, np.ndarray) and np.any(self.semi_axes <= 0):
            raise ParameterError(f"Ellipsoid's semi_axes are {self.semi_axes} ({origin()}). They must be positive.")

    def touching(self, n: ca.SX) -> ca.SX:
        squares = sx(self.semi_axes) ** 2
        return squares * n / ca.sqrt(ca.dot(squares * n, n))


@final
class Disk(AbstractShape):
    """The edge of a thin disk of `radius` [m] > 0 about z, its centre at the origin: what touches, as long as the disk does not lie flat.

    Disk(radius=0.3)
    """

    start = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)

    def __init__(self, radius: Scalar) -> None:
        self.radius = scalar(radius, "Disk's radius", positive=True, unit="m")

    def touching(self, n: ca.SX) -> ca.SX:
        return sx(self.radius) * ca.vertcat(n[:2], 0) / ca.norm_2(n[:2])

    def single(self, n: ca.SX) -> ca.SX:
        return ca.norm_2(n[:2])


@final
class ConvexShape(AbstractShape):
    """Any convex shape, by its support: `distance` (n) -> how far from the origin the plane with the outward normal n touches it [m], for all n
    (3, 1), of any length: twice the normal gives twice the number. Its point is the gradient.

    ConvexShape(lambda n: ca.sqrt(n[0]**2 + n[1]**2 + 4 * n[2]**2) + 0.1 * ca.norm_2(n))
    """

    def __init__(self, distance: Callable[[ca.SX], Any]) -> None:
        self._n = ca.SX.sym("n", 3)
        self.distance = place("ConvexShape", distance, self._n, rows=1)

    def touching(self, n: ca.SX) -> ca.SX:
        return ca.substitute(ca.gradient(self.distance, self._n), self._n, n)
