"""Two surfaces that touch in one point: coordinates of the place, and how they change when one turns and slips over the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import casadi as ca

from acausal.language.connector import Frame
from acausal.language.expression import Expression
from acausal.parts.contact import read
from acausal.parts.pose import quaternion_rate, rotation_from_quaternion
from components.geometry.surfaces import AbstractSurface

LESS_CURVED = "The body is curved less than the hollow that it lies in."
INWARDS = f"{LESS_CURVED} Or the normal of its shape points into it."
ALONG_A_LINE = f"{LESS_CURVED} Or both are flat in one direction: for cylinders and cones that touch along a line there are RollingCylinder and RollingCone."
SEVERAL = (
    "The body touches in more than one point, or is not convex there: along an edge or on a face, as a wheel does that lies flat."
)
SHAPE_ENDS = "The body's shape ends there, or its coordinates do."
SURFACE_ENDS = "The surface ends there, or its coordinates do."


@dataclass(frozen=True)
class AbstractMeeting(ABC):
    """Of a body B with the outside `shape` on a `surface` fixed in A. Coordinates: `own` ones, and those of the point on the surface, `place`.

    w (3, 1): angular velocity of B against A, in B [rad/s]; slip (3, 1): velocity of B's point over A, in A [m/s]; u (2, 1): velocities of the
    touching point on the surface.
    """

    shape: AbstractSurface
    surface: AbstractSurface

    @property
    @abstractmethod
    def start(self) -> tuple[float, ...]:
        """Own coordinates where a search for start values begins."""

    @property
    @abstractmethod
    def turns(self) -> tuple[bool, ...]:
        """Which of the own coordinates are no lengths."""

    @abstractmethod
    def rotation(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """R_ab."""

    @abstractmethod
    def arm(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """The point of the shape that touches (3, 1) [m], in B."""

    @abstractmethod
    def gliding(self, own: ca.SX, place: ca.SX, w: ca.SX, slip: ca.SX) -> ca.SX:
        """u by w and slip."""

    @abstractmethod
    def rates(self, own: ca.SX, place: ca.SX, w: ca.SX, slip: ca.SX, u: ca.SX) -> ca.SX:
        """Of the own coordinates."""

    @abstractmethod
    def fit(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """Positive where the shape is curved more than the surface in all directions, and coordinates are good: (n, 1), see `AbstractJoint.domain`."""

    @property
    @abstractmethod
    def outside(self) -> tuple[str, ...]:
        """What is said where the rows of `fit` are not positive: of the first ones, and of all others."""

    @abstractmethod
    def regular(self, own: ca.SX) -> ca.SX:
        """Of the own coordinates: zero at an apex of the shape, see `AbstractJoint.regular`."""

    @abstractmethod
    def invariants(self, own: ca.SX) -> ca.SX:
        """Of the own coordinates."""


def meeting(shape: AbstractSurface, surface: AbstractSurface) -> AbstractMeeting:
    """By the shape's point for each normal where there is a closed form: then an edge may touch; else by coordinates on both."""
    by_normal = shape.touching(ca.SX.sym("n", 3)) is not None
    return MeetingByNormal(shape, surface) if by_normal else MeetingByCoordinates(shape, surface)


@final
@dataclass(frozen=True)
class MeetingByNormal(AbstractMeeting):
    """Own coordinates: the unit quaternion of R_ab (4, scalar first)."""

    @property
    def start(self) -> tuple[float, ...]:
        return (1.0, 0.0, 0.0, 0.0)

    @property
    def turns(self) -> tuple[bool, ...]:
        return (True,) * 4

    def rotation(self, own: ca.SX, place: ca.SX) -> ca.SX:
        return rotation_from_quaternion(own)

    def arm(self, own: ca.SX, place: ca.SX) -> ca.SX:
        return self._point(self._normal(own, place))

    def gliding(self, own: ca.SX, place: ca.SX, w: ca.SX, slip: ca.SX) -> ca.SX:
        # S u = R arm' + slip with arm' = C m', and the normal m in B changes by m' = -(R' S W u) - w x m
        slopes = self.surface.slopes(place)
        seen = slopes.T @ rotation_from_quaternion(own)
        turned = self._bending(own, place) @ ca.cross(w, self._normal(own, place))
        return solved(self.surface.metric(place) @ self._stretch(own, place), slopes.T @ slip - seen @ turned)

    def rates(self, own: ca.SX, place: ca.SX, w: ca.SX, slip: ca.SX, u: ca.SX) -> ca.SX:
        return quaternion_rate(own, w)

    def fit(self, own: ca.SX, place: ca.SX) -> ca.SX:
        stretch = self._stretch(own, place)
        return ca.vertcat(ca.det(stretch), ca.trace(stretch) / 2, self.shape.single(self._normal(own, place)))

    @property
    def outside(self) -> tuple[str, ...]:
        return (LESS_CURVED, LESS_CURVED, SEVERAL)

    def regular(self, own: ca.SX) -> ca.SX:
        return ca.SX(0, 1)

    def invariants(self, own: ca.SX) -> ca.SX:
        return 0.5 * (ca.sumsqr(own) - 1)

    def _normal(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """Of the shape, outwards, in B."""
        return -(rotation_from_quaternion(own).T @ self.surface.normal(place))

    def _bending(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """How the shape's point moves with its normal, (3, 3) [m]."""
        n = ca.SX.sym("n", 3)
        return ca.substitute(ca.jacobian(self._point(n), n), n, self._normal(own, place))

    def _point(self, n: ca.SX) -> ca.SX:
        found = self.shape.touching(n)
        assert found is not None, "there is a closed form, see `meeting`"
        return found

    def _stretch(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """1 + radii of curvature of the shape times curvature of the surface, (2, 2)."""
        curvature, metric = self.surface.curvature(place), self.surface.metric(place)
        if curvature.nnz() == 0:
            return ca.SX.eye(2)
        seen = self.surface.slopes(place).T @ rotation_from_quaternion(own)
        radii = seen @ self._bending(own, place) @ seen.T
        return ca.SX.eye(2) + inverse(metric) @ radii @ curvature


@final
@dataclass(frozen=True)
class MeetingByCoordinates(AbstractMeeting):
    """Own coordinates: of the point on the shape, and the angle from the first tangent of the surface to that of the shape [rad] (Montana)."""

    @property
    def start(self) -> tuple[float, ...]:
        return (*self.shape.start, 0.0)

    @property
    def turns(self) -> tuple[bool, ...]:
        return (*self.shape.turns, True)

    def rotation(self, own: ca.SX, place: ca.SX) -> ca.SX:
        c, s = ca.cos(own[-1]), ca.sin(own[-1])
        x, y, n = ca.horzsplit(ca.horzcat(self.surface.tangents(place), self.surface.normal(place)))
        turned = ca.horzcat(c * x + s * y, s * x - c * y, -n)
        at = own[:-1]
        return turned @ ca.horzcat(self.shape.tangents(at), self.shape.normal(at)).T

    def arm(self, own: ca.SX, place: ca.SX) -> ca.SX:
        return self.shape.point(own[:-1])

    def gliding(self, own: ca.SX, place: ca.SX, w: ca.SX, slip: ca.SX) -> ca.SX:
        # normals stay opposite: S W u + R S_b W_b u_b = w x n, and S u = R S_b u_b + slip
        R, slopes, normal = self.rotation(own, place), self.surface.slopes(place), self.surface.normal(place)
        of_shape = self._bend(own) @ (self._seen(own, place).T @ slip)
        turned = slopes.T @ ca.cross(R @ w, normal) + self._between(own, place) @ of_shape
        return solved(self.surface.metric(place) @ self._curvature(own, place), turned)

    def rates(self, own: ca.SX, place: ca.SX, w: ca.SX, slip: ca.SX, u: ca.SX) -> ca.SX:
        at = own[:-1]
        moved = self.surface.slopes(place) @ u - slip
        on_shape = solved(self.shape.metric(at), self._seen(own, place).T @ moved)
        turning = -ca.dot(w, self.shape.normal(at)) - self.surface.connection(place) @ u - self.shape.connection(at) @ on_shape
        return ca.vertcat(self.shape.rates(at, on_shape), turning)

    def fit(self, own: ca.SX, place: ca.SX) -> ca.SX:
        both = self._curvature(own, place)
        W, own_W = self.surface.curvature(place), self.shape.curvature(own[:-1])
        size = ca.trace(W @ W) + ca.trace(own_W @ own_W)
        return ca.vertcat(4 * ca.det(both) / size, ca.trace(both) / ca.sqrt(size), self.shape.inside(own[:-1]))

    @property
    def outside(self) -> tuple[str, ...]:
        return (ALONG_A_LINE, INWARDS, SHAPE_ENDS)

    def regular(self, own: ca.SX) -> ca.SX:
        return self.shape.regular(own[:-1])

    def invariants(self, own: ca.SX) -> ca.SX:
        return self.shape.invariants(own[:-1])

    def _seen(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """Slopes of the shape in A, (3, 2)."""
        return self.rotation(own, place) @ self.shape.slopes(own[:-1])

    def _between(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """Products of the slopes of both, (2, 2)."""
        return self.surface.slopes(place).T @ self._seen(own, place)

    def _bend(self, own: ca.SX) -> ca.SX:
        """The shape's curvature for products of slopes, (2, 2)."""
        at = own[:-1]
        return self.shape.curvature(at) @ inverse(self.shape.metric(at))

    def _curvature(self, own: ca.SX, place: ca.SX) -> ca.SX:
        """Of both together, (2, 2) [1/m], as `AbstractSurface.curvature`."""
        D = self._between(own, place)
        return self.surface.curvature(place) + inverse(self.surface.metric(place)) @ D @ self._bend(own) @ D.T


def on_surface(surface: AbstractSurface, place: Expression, frame: Frame) -> tuple[Expression, Expression]:
    """Point [m] and normal (3, 1) in the world frame, at a place on the surface that is fixed in a frame."""
    point, normal = read(surface.point(place.sx)), read(surface.normal(place.sx))
    return frame.position + frame.rotation @ point, frame.rotation @ normal


def inverse(A: ca.SX) -> ca.SX:
    """Of a matrix (2, 2)."""
    return ca.blockcat([[A[1, 1], -A[0, 1]], [-A[1, 0], A[0, 0]]]) / ca.det(A)


def solved(A: ca.SX, b: ca.SX) -> ca.SX:
    """A^-1 b for a matrix (2, 2), pivots unseen: zeros stay zeros."""
    return ca.vertcat(A[1, 1] * b[0] - A[0, 1] * b[1], A[0, 0] * b[1] - A[1, 0] * b[0]) / (A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])
