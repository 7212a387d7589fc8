"""Surfaces in space, given by coordinates on them."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, checked, flag, scalar, sx
from acausal.language.origin import origin
from acausal.parts.pose import quaternion_rate, rotation_from_quaternion, rotation_to_axis_symbolic
from components.geometry.curves import within
from components.geometry.laws import moving, place

LYING = 1e-6
"""Sine of the angle at which a ring lies flat: what is nearest then jumps from one side to the other, and steps that passed it would not see where."""
APEX = "The surface has an apex there, or its coordinates a pole: no plane touches it, or they have no two directions; or its slope is infinite, as at the rim of a root: let it end before, or give it by other coordinates."
"""Said where `AbstractSurface.regular` is zero."""


_WITHOUT_VALUE = (ca.OP_DIV, ca.OP_INV, ca.OP_SQRT, ca.OP_LOG, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_ASIN, ca.OP_ACOS, ca.OP_TAN)
"""Operations that have no value, or no slope, at some arguments."""


@dataclass(frozen=True)
class Chart:
    """A surface, or most of it, by two coordinates: `point` (2, 1) -> place (3, 1) [m]; `limits` of each, infinite where it goes on; `inside` (2, 1) ->
    not negative on the surface; `start`: coordinates where it is smooth.
    """

    point: Callable[[ca.SX], ca.SX]
    limits: tuple[tuple[float, float], tuple[float, float]]
    inside: Callable[[ca.SX], ca.SX]
    start: tuple[float, ...]


ENDLESS = (-np.inf, np.inf)
TURN = (-np.pi, np.pi)


class AbstractSurface(ABC):
    """A surface in the axes of the frame that it is fixed in. Must provide `point`; with two coordinates new ones need nothing else.

    The side that matters for what rolls is that of `normal`, the one that first and second coordinate turn about to the left.
    """

    unit: ClassVar[str] = "m"
    """Of the coordinates: "m" for lengths, "rad" for angles, "" for what is neither or mixed."""
    start: ClassVar[tuple[float, ...]] = (0.0, 0.0)
    """Coordinates where a search for start values begins, where the surface is smooth."""

    def start_for(self, length: float) -> tuple[float, ...]:
        """`start` where something of this size [m] touches it: of a surface that has no size of its own, that far from where it is not smooth."""
        return self.start

    @property
    def turns(self) -> tuple[bool, ...]:
        """Which coordinates are no lengths."""
        return (self.unit != "m",) * len(self.start)

    @abstractmethod
    def point(self, q: ca.SX) -> ca.SX:
        """Place (3, 1) [m] at the coordinates q, with two derivatives; its slopes are independent."""

    def chart(self) -> Chart | None:
        """By which it is drawn; None where there is none. Of two coordinates these, as if they did not end."""
        return Chart(self.point, (ENDLESS, ENDLESS), self.inside, self.start) if len(self.start) == 2 else None

    def rates(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """q' by two velocities v (2, 1): q' = v, but where a surface needs more coordinates than it has dimensions."""
        return v

    def invariants(self, q: ca.SX) -> ca.SX:
        """What stays zero because of how q' is made; see `AbstractJoint.invariants`."""
        return ca.SX(0, 1)

    def inside(self, q: ca.SX) -> ca.SX:
        """Positive where the coordinates are good, (n, 1), without unit and of size 1 well inside. Empty where they are everywhere."""
        return ca.SX(0, 1)

    def regular(self, q: ca.SX) -> ca.SX:
        """Zero where the surface, or its coordinates, have no two directions, or infinite slopes, else positive, (n, 1); of any unit. Empty where that is nowhere."""
        square = ca.det(self.metric(q))
        return ca.vertcat(square, 1 / square)

    def slopes(self, q: ca.SX) -> ca.SX:
        """How the point moves with the velocities, (3, 2)."""
        at, v = ca.SX.sym("q", q.numel()), ca.SX.sym("v", 2)
        return ca.substitute(ca.jacobian(ca.jtimes(self.point(at), at, self.rates(at, v)), v), at, q)

    def normal(self, q: ca.SX) -> ca.SX:
        """Unit normal (3, 1)."""
        slopes = self.slopes(q)
        across = ca.cross(slopes[:, 0], slopes[:, 1])
        return across / ca.norm_2(across)

    def tangents(self, q: ca.SX) -> ca.SX:
        """Unit vectors (3, 2) at right angles along the surface: the first slope's direction, and to the left of it about the normal."""
        first = self.slopes(q)[:, 0]
        x = first / ca.norm_2(first)
        return ca.horzcat(x, ca.cross(self.normal(q), x))

    def connection(self, q: ca.SX) -> ca.SX:
        """(1, 2): moving by velocities v the tangents turn about the normal at the rate connection v."""
        at, v = ca.SX.sym("q", q.numel()), ca.SX.sym("v", 2)
        tangents = self.tangents(at)
        turn = ca.dot(tangents[:, 1], ca.jtimes(tangents[:, 0], at, self.rates(at, v)))
        return ca.substitute(ca.jacobian(turn, v), at, q)

    def touching(self, n: ca.SX) -> ca.SX | None:
        """Of a surface around a body: its point (3, 1) [m] with the outward unit normal `n` (3, 1), with two derivatives in n; None where that has
        no closed form, or more points than one have this normal.
        """
        return None

    def single(self, n: ca.SX) -> ca.SX:
        """Positive where only one point has the normal n, (k, 1), without unit and of size 1 well inside. Empty where that is everywhere."""
        return ca.SX(0, 1)

    def across(self, n: ca.SX) -> ca.SX:
        """Two unit vectors (3, 2) across a normal n (3, 1) and one another. On a ball no such choice is smooth: it jumps where z of n is -0.41."""
        return rotation_to_axis_symbolic(n)[:, :2]

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        """The point nearest to a place p (3, 1) [m] that is not far off, and the normal there; None where that has no closed form."""
        return None

    def clearance(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        """How far a place p (3, 1) [m] is off, positive on the side of the normal, and the unit normal: the distance where `nearest` is known, else a number
        that is so near to the surface; None where there is no closed form.
        """
        found = self.nearest(p)
        return None if found is None else (ca.dot(found[1], p - found[0]), found[1])

    def metric(self, q: ca.SX) -> ca.SX:
        """Products of the slopes, (2, 2)."""
        slopes = self.slopes(q)
        return slopes.T @ slopes

    def curvature(self, q: ca.SX) -> ca.SX:
        """W (2, 2) [1/m]: moving by velocities v the normal changes at the rate slopes W v (Weingarten). Positive where the normal points away from the
        centre of curvature.
        """
        at, v = ca.SX.sym("q", q.numel()), ca.SX.sym("v", 2)
        change = ca.substitute(ca.jacobian(ca.jtimes(self.normal(at), at, self.rates(at, v)), v), at, q)
        return ca.solve(self.metric(q), self.slopes(q).T @ change)


def by_normals(touching: Callable[[ca.SX], ca.SX]) -> Chart:
    """Of what has one point for each outward normal: by longitude and latitude of that [rad]."""

    def point(q: ca.SX) -> ca.SX:
        c = ca.cos(q[1])
        return touching(ca.vertcat(c * ca.cos(q[0]), c * ca.sin(q[0]), ca.sin(q[1])))

    return Chart(point, (TURN, (-np.pi / 2, np.pi / 2)), lambda q: ca.SX(0, 1), (0.1, 0.1))


def _across(n: ca.SX) -> ca.SX:
    """The unit vector from the axis z, in a direction n (3, 1)."""
    return ca.vertcat(n[:2], 0) / ca.norm_2(n[:2])


def _around_and_along(n: ca.SX) -> ca.SX:
    """Unit vectors (3, 2) around z, and across that and a normal n (3, 1) that is not along z."""
    around = ca.vertcat(-n[1], n[0], 0) / ca.norm_2(n[:2])
    return ca.horzcat(around, ca.cross(n, around))


def sharp(half_angle: Scalar, what: str) -> float | Expression:
    """A cone's half angle [rad], from its axis to its side. Raises `ParameterError` where it is none."""
    angle = scalar(half_angle, what, positive=True, unit="rad")
    check = functools.partial(_check_sharp, what=what)
    if isinstance(angle, Expression):
        return checked(angle, check)
    check(np.array(angle))
    return angle


def _check_sharp(angle: np.ndarray, what: str) -> None:
    if not angle.item() < np.pi / 2:
        raise ParameterError(
            f"{what} is {angle.item():g} rad ({origin()}), from the axis to the side: it must be below pi / 2. Degrees are np.radians(30)."
        )


def checked_surface(surface: object, part: str, role: str = "surface") -> AbstractSurface:
    """Raises `ParameterError` for anything else."""
    if not isinstance(surface, AbstractSurface):
        raise ParameterError(
            f"{part}'s {role} is {shown(surface)} ({origin()}). Give a surface of components, e.g. Sphere(radius=0.5)."
        )
    return surface


@final
class Plane(AbstractSurface):
    """z = 0, its normal along z. Coordinates: x and y [m]."""

    def point(self, q: ca.SX) -> ca.SX:
        return ca.vertcat(q, 0)

    def normal(self, q: ca.SX) -> ca.SX:
        return ca.SX([0, 0, 1])

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def slopes(self, q: ca.SX) -> ca.SX:
        return ca.SX(ca.DM([[1, 0], [0, 1], [0, 0]]))

    def across(self, n: ca.SX) -> ca.SX:
        return ca.SX(ca.DM([[1, 0], [0, 1], [0, 0]]))

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        return ca.vertcat(p[:2], 0), ca.SX([0, 0, 1])

    def tangents(self, q: ca.SX) -> ca.SX:
        return self.slopes(q)

    def connection(self, q: ca.SX) -> ca.SX:
        return ca.SX(1, 2)

    def metric(self, q: ca.SX) -> ca.SX:
        return ca.SX.eye(2)

    def curvature(self, q: ca.SX) -> ca.SX:
        return ca.SX(2, 2)


@final
class Plate(AbstractSurface):
    """The rectangle |x| <= `length` / 2, |y| <= `width` / 2 [m] of z = 0, without thickness, with its edges and corners: a table that balls roll off.

    For balls, and whatever has a radius, on either side of it; its normal, in the middle of it along z, turns about edges. Coordinates: x and y [m].

        Plate(2.0, 1.0)
    """

    def __init__(self, length: Scalar, width: Scalar) -> None:
        self.length = scalar(length, "Plate's length", positive=True, unit="m")
        self.width = scalar(width, "Plate's width", positive=True, unit="m")

    def point(self, q: ca.SX) -> ca.SX:
        return ca.vertcat(q, 0)

    def inside(self, q: ca.SX) -> ca.SX:
        half = ca.vertcat(sx(self.length), sx(self.width)) / 2
        return 1 - (q / half) ** 2

    def chart(self) -> Chart:
        sides = [(-size / 2, size / 2) if isinstance(size, float) else ENDLESS for size in (self.length, self.width)]
        return Chart(self.point, (sides[0], sides[1]), self.inside, self.start)

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        half = ca.vertcat(sx(self.length), sx(self.width)) / 2
        # conditions, not bounds: slopes then switch by the same ones
        inside = [ca.if_else(p[k] < -half[k], -half[k], ca.if_else(p[k] > half[k], half[k], p[k])) for k in (0, 1)]
        found = ca.vertcat(*inside, 0)
        return found, (p - found) / ca.norm_2(p - found)

    def clearance(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        raise ParameterError(
            f"A point has no normal at an edge of a Plate ({origin()}). Give it a radius: Contact(Sphere(0.01), Plate(...), ...)."
        )


@final
class Sphere(AbstractSurface):
    """Of `radius` [m] > 0 about the origin, its normal outwards; `inside_out`: inwards. Without poles.

    Coordinates: a unit quaternion (4) of axes whose z goes through the point and which never turn about z; velocities: their angular velocity
    about their own x and y [rad/s].

        Sphere(radius=0.3, inside_out=True)  # a bowl
    """

    unit = "rad"
    start = (1.0, 0.0, 0.0, 0.0)

    def __init__(self, radius: Scalar, *, inside_out: bool = False) -> None:
        self.radius = scalar(radius, "Sphere's radius", positive=True, unit="m")
        self.side = -1.0 if flag(inside_out, "Sphere's inside_out") else 1.0

    def point(self, q: ca.SX) -> ca.SX:
        return sx(self.radius) * rotation_from_quaternion(q)[:, 2]

    def chart(self) -> Chart:
        return by_normals(lambda n: sx(self.radius) * n)

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def rates(self, q: ca.SX, v: ca.SX) -> ca.SX:
        return quaternion_rate(q, ca.vertcat(v, 0))

    def invariants(self, q: ca.SX) -> ca.SX:
        return 0.5 * (ca.sumsqr(q) - 1)

    def slopes(self, q: ca.SX) -> ca.SX:
        R = rotation_from_quaternion(q)
        return sx(self.radius) * ca.horzcat(-R[:, 1], R[:, 0])

    def normal(self, q: ca.SX) -> ca.SX:
        return self.side * rotation_from_quaternion(q)[:, 2]

    def tangents(self, q: ca.SX) -> ca.SX:
        R = rotation_from_quaternion(q)
        return ca.horzcat(-R[:, 1], self.side * R[:, 0])

    def connection(self, q: ca.SX) -> ca.SX:
        return ca.SX(1, 2)

    def touching(self, n: ca.SX) -> ca.SX | None:
        return sx(self.radius) * n if self.side > 0 else None

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        outwards = p / ca.norm_2(p)
        return sx(self.radius) * outwards, self.side * outwards

    def metric(self, q: ca.SX) -> ca.SX:
        return sx(self.radius) ** 2 * ca.SX.eye(2)

    def curvature(self, q: ca.SX) -> ca.SX:
        return self.side / sx(self.radius) * ca.SX.eye(2)


@final
class Cylinder(AbstractSurface):
    """Of `radius` [m] > 0 about z, its normal outwards; `inside_out`: inwards. Coordinates: the way around from x, and z [m].

    Cylinder(radius=0.5)
    """

    def __init__(self, radius: Scalar, *, inside_out: bool = False) -> None:
        self.radius = scalar(radius, "Cylinder's radius", positive=True, unit="m")
        self.side = -1.0 if flag(inside_out, "Cylinder's inside_out") else 1.0

    def point(self, q: ca.SX) -> ca.SX:
        radius = sx(self.radius)
        return ca.vertcat(radius * ca.cos(q[0] / radius), radius * ca.sin(q[0] / radius), q[1])

    def chart(self) -> Chart:
        return Chart(lambda q: self.point(ca.vertcat(sx(self.radius) * q[0], q[1])), (TURN, ENDLESS), self.inside, self.start)

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def slopes(self, q: ca.SX) -> ca.SX:
        angle = q[0] / sx(self.radius)
        return ca.blockcat([[-ca.sin(angle), 0], [ca.cos(angle), 0], [0, 1]])

    def normal(self, q: ca.SX) -> ca.SX:
        angle = q[0] / sx(self.radius)
        return self.side * ca.vertcat(ca.cos(angle), ca.sin(angle), 0)

    def across(self, n: ca.SX) -> ca.SX:
        return _around_and_along(n)

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        outwards = _across(p)
        return sx(self.radius) * outwards + ca.vertcat(0, 0, p[2]), self.side * outwards

    def tangents(self, q: ca.SX) -> ca.SX:
        slopes = self.slopes(q)
        return ca.horzcat(slopes[:, 0], self.side * slopes[:, 1])

    def connection(self, q: ca.SX) -> ca.SX:
        return ca.SX(1, 2)

    def metric(self, q: ca.SX) -> ca.SX:
        return ca.SX.eye(2)

    def curvature(self, q: ca.SX) -> ca.SX:
        return ca.diag(ca.vertcat(self.side / sx(self.radius), 0))


@final
class Torus(AbstractSurface):
    """A tube of radius `tube` about the circle of `radius` > tube > 0 [m] in the plane z = 0, its normal outwards.

    Coordinates: the angle around z from x, and around the tube from the outermost circle upwards [rad].

        Torus(radius=1.0, tube=0.2)
    """

    unit = "rad"

    def __init__(self, radius: Scalar, tube: Scalar) -> None:
        self.radius = scalar(radius, "Torus's radius", positive=True, unit="m")
        self.tube = scalar(tube, "Torus's tube", positive=True, unit="m")
        if isinstance(self.radius, float) and isinstance(self.tube, float) and self.tube >= self.radius:
            raise ParameterError(
                f"Torus's tube of {self.tube:g} m is as thick as its circle of radius {self.radius:g} m is wide ({origin()}): it has no hole. "
                "Give the radius of the circle in its middle, and a smaller one of the tube around that."
            )

    def point(self, q: ca.SX) -> ca.SX:
        reach = sx(self.radius) + sx(self.tube) * ca.cos(q[1])
        return ca.vertcat(reach * ca.cos(q[0]), reach * ca.sin(q[0]), sx(self.tube) * ca.sin(q[1]))

    def chart(self) -> Chart:
        return Chart(self.point, (TURN, TURN), self.inside, self.start)

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def touching(self, n: ca.SX) -> ca.SX | None:
        return sx(self.radius) * _across(n) + sx(self.tube) * n

    def single(self, n: ca.SX) -> ca.SX:
        return ca.norm_2(n[:2]) - LYING

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        ring = sx(self.radius) * _across(p)
        normal = (p - ring) / ca.norm_2(p - ring)
        return ring + sx(self.tube) * normal, normal


@final
class Cone(AbstractSurface):
    """z = r / tan(`half_angle`), r the distance from z, 0 < half_angle < pi / 2 [rad]; its normal inwards, that is upwards, or `outside`: outwards.
    Coordinates: x and y [m].

    Not at the apex, which has no normal.

        Cone(half_angle=0.5)
    """

    start = (1.0, 0.0)

    def __init__(self, half_angle: Scalar, *, outside: bool = False) -> None:
        self.half_angle = sharp(half_angle, "Cone's half_angle")
        self.side = -1.0 if flag(outside, "Cone's outside") else 1.0

    def start_for(self, length: float) -> tuple[float, ...]:
        return (4 * length, 0.0)

    def point(self, q: ca.SX) -> ca.SX:
        return ca.vertcat(q, ca.norm_2(q) / ca.tan(sx(self.half_angle)))

    def chart(self) -> Chart:
        def around(q: ca.SX) -> ca.SX:
            return ca.vertcat(q[1] * ca.cos(q[0]), q[1] * ca.sin(q[0]), q[1] / ca.tan(sx(self.half_angle)))

        return Chart(around, (TURN, (0.0, np.inf)), self.inside, (0.0, 1.0))

    def regular(self, q: ca.SX) -> ca.SX:
        return ca.sumsqr(q)

    def normal(self, q: ca.SX) -> ca.SX:
        slope = 1 / ca.tan(sx(self.half_angle))
        return self.side * ca.vertcat(-slope * q / ca.norm_2(q), 1) / ca.sqrt(1 + slope**2)

    def across(self, n: ca.SX) -> ca.SX:
        return _around_and_along(n)

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        outwards, up = _across(p), ca.SX([0, 0, 1])
        c, s = ca.cos(sx(self.half_angle)), ca.sin(sx(self.half_angle))
        along = s * outwards + c * up
        return along * ca.dot(along, p), self.side * (s * up - c * outwards)


@final
class HeightField(AbstractSurface):
    """z = `height` (x, y) [m], its normal upwards, by numpy's or CasADi's functions, or by a table of scipy or CasADi, see `ac.lookup`.
    Coordinates: x and y [m].

    HeightField(lambda x, y: 0.5 * (x**2 + y**2)); HeightField(RectBivariateSpline(x, y, heights))
    """

    def __init__(self, height: Callable[[ca.SX, ca.SX], Any]) -> None:
        self._q = ca.SX.sym("q", 2)
        self.law = place("HeightField", height, "x, y", self._q[0], self._q[1], rows=1)

    def point(self, q: ca.SX) -> ca.SX:
        return ca.vertcat(q, ca.substitute(self.law, self._q, q))

    def regular(self, q: ca.SX) -> ca.SX:
        law = ca.Function("law", [self._q], [self.law], {"allow_free": True})
        ends = any(law.instruction_id(k) in _WITHOUT_VALUE for k in range(law.n_instructions()))
        return 1 / ca.det(self.metric(q)) if ends else ca.SX(0, 1)

    def clearance(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        height, slope = ca.substitute([self.law, ca.gradient(self.law, self._q)], [self._q], [p[:2]])
        normal = ca.vertcat(-slope, 1) / ca.sqrt(1 + ca.sumsqr(slope))
        return (p[2] - height) * normal[2], normal


@final
class ParametricSurface(AbstractSurface):
    """Any surface: `law` (a, b) -> (x, y, z) [m], by numpy's or CasADi's functions; its normal along d law/da x d law/db: exchange a and b to turn it.

    `unit` of a and b; `ends`: ((a0, a1), (b0, b1)), where it has ends, or where its coordinates do; `start`: (a, b) where a search for start values begins.

    ParametricSurface(lambda a, b: (a * ca.cos(b), a * ca.sin(b), 0.1 * b), start=(1.0, 0.0))  # a helicoid
    """

    def __init__(
        self,
        law: Callable[[ca.SX, ca.SX], Any],
        unit: str = "",
        ends: tuple[tuple[float, float], tuple[float, float]] | None = None,
        start: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._q = ca.SX.sym("q", 2)
        given = place("ParametricSurface", law, "a, b", self._q[0], self._q[1])
        self.law = moving("ParametricSurface", given, "a, b", self._q[0], self._q[1])
        self.ends = ends
        self.unit, self.start = unit, start  # pyright: ignore[reportAttributeAccessIssue]

    def point(self, q: ca.SX) -> ca.SX:
        return ca.substitute(self.law, self._q, q)

    def inside(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1) if self.ends is None else ca.vertcat(*(within(q[k], ends) for k, ends in enumerate(self.ends)))

    def chart(self) -> Chart:
        return Chart(self.point, self.ends or (ENDLESS, ENDLESS), self.inside, self.start)


@final
class Revolution(AbstractSurface):
    """A curve turned about z: `profile` (s) -> (r, z) [m], r > 0, by numpy's or CasADi's functions; its normal to the right of the curve, `flipped`: to the left.

    Coordinates: the parameter s, of this `unit`, and the angle around z from x [rad]. `ends` of s, where the curve has ends; `start`: s where a search
    for start values begins.

        Revolution(lambda s: (0.2 + 0.05 * ca.cos(s), s), start=0.3)  # the outside of a spindle along z, drawn upwards
    """

    def __init__(
        self,
        profile: Callable[[ca.SX], Any],
        unit: str = "m",
        *,
        ends: tuple[float, float] | None = None,
        start: float = 0.0,
        flipped: bool = False,
    ) -> None:
        self._s = ca.SX.sym("s")
        self.profile = place("Revolution", profile, "s", self._s, rows=2)
        self.ends, self.side = ends, 1.0 if flag(flipped, "Revolution's flipped") else -1.0
        self.unit, self.start = unit, (start, 0.0)  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def turns(self) -> tuple[bool, ...]:
        return (self.unit != "m", True)

    def point(self, q: ca.SX) -> ca.SX:
        return self._around(ca.substitute(self.profile, self._s, q[0]), q[1])

    def slopes(self, q: ca.SX) -> ca.SX:
        r, slope = self._profile(q[0])[:2]
        return ca.horzcat(self._around(slope, q[1]), r[0] * ca.vertcat(-ca.sin(q[1]), ca.cos(q[1]), 0))

    def normal(self, q: ca.SX) -> ca.SX:
        slope = self._profile(q[0])[1]
        return self.side * self._around(ca.vertcat(-slope[1], slope[0]) / ca.norm_2(slope), q[1])

    def metric(self, q: ca.SX) -> ca.SX:
        r, slope = self._profile(q[0])[:2]
        return ca.diag(ca.vertcat(ca.sumsqr(slope), r[0] ** 2))

    def connection(self, q: ca.SX) -> ca.SX:
        slope = self._profile(q[0])[1]
        return ca.horzcat(0, self.side * slope[0] / ca.norm_2(slope))

    def curvature(self, q: ca.SX) -> ca.SX:
        r, slope, bend = self._profile(q[0])
        length = ca.norm_2(slope)
        along = (slope[1] * bend[0] - slope[0] * bend[1]) / length**3
        return self.side * ca.diag(ca.vertcat(along, -slope[1] / (length * r[0])))

    def inside(self, q: ca.SX) -> ca.SX:
        return ca.SX(0, 1) if self.ends is None else within(q[0], self.ends)

    def chart(self) -> Chart:
        return Chart(self.point, (self.ends or ENDLESS, TURN), self.inside, self.start)

    def _profile(self, s: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The curve and its two derivatives."""
        slope = ca.jacobian(self.profile, self._s)
        r, first, second = ca.substitute([self.profile, slope, ca.jacobian(slope, self._s)], [self._s], [s])
        return r, first, second

    @staticmethod
    def _around(r: ca.SX, angle: ca.SX) -> ca.SX:
        return ca.vertcat(r[0] * ca.cos(angle), r[0] * ca.sin(angle), r[1])


@final
class Parallel(AbstractSurface):
    """At a `distance` [m] from another `surface`, on the side of its normal where it is positive; with its coordinates and normals.

    Only where it is smooth: 1 + distance * curvature > 0 in all directions.

        Parallel(Torus(1.0, 0.2), 0.05)
    """

    def __init__(self, surface: AbstractSurface, distance: Scalar) -> None:
        self.surface = checked_surface(surface, "Parallel")
        self.distance = scalar(distance, "Parallel's distance", unit="m")
        self.unit, self.start = surface.unit, surface.start  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def turns(self) -> tuple[bool, ...]:
        return self.surface.turns

    def start_for(self, length: float) -> tuple[float, ...]:
        return self.surface.start_for(length)

    def point(self, q: ca.SX) -> ca.SX:
        return self.surface.point(q) + sx(self.distance) * self.surface.normal(q)

    def chart(self) -> None:
        return None

    def rates(self, q: ca.SX, v: ca.SX) -> ca.SX:
        return self.surface.rates(q, v)

    def invariants(self, q: ca.SX) -> ca.SX:
        return self.surface.invariants(q)

    def inside(self, q: ca.SX) -> ca.SX:
        stretch = self._stretch(q)
        return ca.vertcat(self.surface.inside(q), ca.det(stretch), ca.trace(stretch) / 2)

    def regular(self, q: ca.SX) -> ca.SX:
        return self.surface.regular(q)

    def slopes(self, q: ca.SX) -> ca.SX:
        return self.surface.slopes(q) @ self._stretch(q)

    def normal(self, q: ca.SX) -> ca.SX:
        return self.surface.normal(q)

    def tangents(self, q: ca.SX) -> ca.SX:
        return self.surface.tangents(q)

    def connection(self, q: ca.SX) -> ca.SX:
        return self.surface.connection(q)

    def curvature(self, q: ca.SX) -> ca.SX:
        W = self.surface.curvature(q)
        return ca.solve(self._stretch(q), W) if W.nnz() else W

    def touching(self, n: ca.SX) -> ca.SX | None:
        found = self.surface.touching(n)
        return None if found is None else found + sx(self.distance) * n

    def single(self, n: ca.SX) -> ca.SX:
        return self.surface.single(n)

    def nearest(self, p: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        found = self.surface.nearest(p)
        return None if found is None else (found[0] + sx(self.distance) * found[1], found[1])

    def _stretch(self, q: ca.SX) -> ca.SX:
        return ca.SX.eye(2) + sx(self.distance) * self.surface.curvature(q)
