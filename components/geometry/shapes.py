"""Shapes of bodies that are known by the point that touches a plane: round ones, and edges."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Parameter, Scalar, declared_in, scalar, sx, vector
from acausal.language.origin import origin
from acausal.parts.pose import quaternion_rate, rotation_from_quaternion
from components.geometry.implicit import turned_to
from components.geometry.laws import place
from components.geometry.surfaces import LYING, AbstractSurface, Chart, by_normals

_NOTHING, _FLAT = 1e-9, 1e-3
"""Of the width: the radius of an edge; and 1 / that of a flat face."""
_NORMALS = np.vstack([np.eye(3), np.random.default_rng(1).normal(size=(64, 3))])
"""At which a shape is looked at."""
_HALVINGS, _JUMP = 40, 1e-6
"""Towards a switch of a support; of its size, what its point jumps by there and does not move by."""
_SMOOTH = 0.5
"""What is 1 where it is smooth, and is well so."""


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
    def chart(self) -> Chart:
        return by_normals(self.touching)

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
        return ca.norm_2(n[:2]) - LYING


@final
class ConvexShape(AbstractShape):
    """Any convex shape, by its support: `distance` (n) -> how far from the origin the plane with the outward normal n touches it [m], for all n
    (3, 1), of any length: twice the normal gives twice the number. Its point is the gradient. It may have edges; a motion that comes to one of its
    flat faces, where it touches in more than one point, ends there.

    ConvexShape(lambda n: ca.sqrt(n[0]**2 + n[1]**2 + 4 * n[2]**2) + 0.1 * ca.norm_2(n))
    """

    def __init__(self, distance: Callable[[ca.SX], Any]) -> None:
        self._n = ca.SX.sym("n", 3)
        self.distance = place("ConvexShape", distance, "n", self._n, rows=1)
        self._faces = self._flat_faces()
        self.start = self._checked_start()  # pyright: ignore[reportAttributeAccessIssue]

    def touching(self, n: ca.SX) -> ca.SX:
        return ca.substitute(ca.gradient(self.distance, self._n), self._n, n)

    def single(self, n: ca.SX) -> ca.SX:
        # radii of curvature beside the width: both not negative, which is 1 where they are not nothing, and none infinite
        radii, width = self._bending(n), self._distance(n) + self._distance(-n)
        total = ca.trace(radii)
        size, product = width**2 + total**2, (total**2 - ca.trace(radii @ radii)) / 2
        convex = 1 + ca.vertcat(product / size, total / ca.sqrt(size)) / _NOTHING
        angles = ca.fabs(ca.substitute(self._faces, self._n, n))
        off_faces = angles / ca.sqrt(angles**2 + _FLAT**2) - LYING / _FLAT
        return ca.vertcat(convex / ca.sqrt(1 + convex**2), width**2 / (width**2 + (_FLAT * total) ** 2), off_faces)

    def _flat_faces(self) -> ca.SX:
        """Angles (k, 1) from normals of faces and edges that are flat or straight: where the support switches, if its point jumps there, parameters as they are."""
        n, found = self._n, list[ca.SX]()
        known = declared_in(self.distance)
        values = [symbol.value if isinstance(symbol, Parameter) else 0.0 for symbol in known]
        given = ca.vertcat(ca.SX(0, 1), *(symbol.sx for symbol in known))
        for value in _switching(self.distance):
            look = ca.Function("look", [n, given], [value, ca.gradient(self.distance, n)])

            def at(normal: np.ndarray, look: ca.Function = look) -> tuple[float, np.ndarray]:
                seen, point = look(normal / np.linalg.norm(normal), values)
                return float(seen), np.array(point).ravel()

            sides = [[normal for normal in _NORMALS if (at(normal)[0] < 0) is below] for below in (False, True)]
            for first, second in zip(*sides, strict=False):
                pair = first, second
                for _ in range(_HALVINGS):
                    middle = (pair[0] + pair[1]) / 2
                    pair = (pair[0], middle) if at(middle)[0] < 0 else (middle, pair[1])
                points = [at(end)[1] for end in pair]
                if np.linalg.norm(points[0] - points[1]) > _JUMP * np.max(np.abs(points)):
                    found.append(value / ca.norm_2(ca.gradient(value, n)))
                    break
        return ca.vertcat(ca.SX(0, 1), *found)

    def _distance(self, n: ca.SX) -> ca.SX:
        return ca.substitute(self.distance, self._n, n)

    def _checked_start(self) -> tuple[float, ...]:
        """Coordinates where it is smooth. Raises `ParameterError` for what is no support, and where it is that of no convex shape, by some normals and
        parameters as they are.
        """
        known = declared_in(self.distance)
        values = [symbol.value if isinstance(symbol, Parameter) else 0.0 for symbol in known]
        n = ca.SX.sym("n", 3)
        rows = [self._distance(2 * n), 2 * self._distance(n), self.single(n)]
        look = ca.Function("look", [n, ca.vertcat(ca.SX(0, 1), *(symbol.sx for symbol in known))], rows)
        smooth: list[np.ndarray] = []
        for normal in _NORMALS / np.linalg.norm(_NORMALS, axis=1)[:, None]:
            twice, double, convex = (np.array(part).ravel() for part in look(normal, values))
            if abs(twice - double) > 1e-9 * abs(double):
                raise ParameterError(
                    f"ConvexShape's distance is {double[0] / 2:.6g} m for n = {normal}, and {twice[0]:.6g} m for 2 n ({origin()}). Twice the normal must give twice the "
                    "number: divide by ca.norm_2(n) as often as needed."
                )
            if (convex[:2] < 0).any():
                raise ParameterError(
                    f"ConvexShape's distance is that of no convex shape: around n = {normal} it is curved the other way ({origin()}). Give one that is convex, "
                    "or make the body of several."
                )
            smooth += [normal] * bool((convex > _SMOOTH).all())
        return turned_to(smooth[0] if smooth else _NORMALS[0])


def _switching(expression: ca.SX) -> list[ca.SX]:
    """Values whose signs say how it is formed: of absolute values, least and largest ones, and conditions."""
    stack, seen, found = [expression], set[int](), list[ca.SX]()
    while stack:
        node = stack.pop()
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        under = [node.dep(i) for i in range(node.n_dep())]
        stack += under
        if under and node.op() in (ca.OP_FABS, ca.OP_SIGN):
            found.append(under[0])
        elif under and node.op() in (ca.OP_LT, ca.OP_LE, ca.OP_FMIN, ca.OP_FMAX):
            found.append(under[0] - under[1])
    return found
