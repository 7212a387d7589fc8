"""A body of any shape that touches a surface of any shape: a joint in least velocities."""

from __future__ import annotations

from typing import Any, final

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Parameter, Variable, declared_in
from acausal.language.origin import origin
from acausal.parts.contact import AbstractContact, read
from acausal.parts.joint import AbstractJoint
from acausal.parts.motion import Motion
from acausal.parts.pose import Pose, symbolic
from acausal.parts.seen import AbstractSeenAlong
from components.contacts.laws import AbstractTouchingLaw, Rolling, checked_touching
from components.contacts.meeting import SURFACE_ENDS, AbstractMeeting, MeetingByCoordinates, meeting
from components.contacts.nearness import Nearness, nearness, touched
from components.geometry.net import net
from components.geometry.shapes import AbstractShape
from components.geometry.surfaces import APEX, AbstractSurface, Parallel, checked_surface

_ANGLES = (0.0, np.pi / 2, np.pi / 4, 3 * np.pi / 4)
"""From the surface's first tangent to the shape's [rad], that a search for start values may begin with; those that fit better by less than
`_ALIKE`, of a fit of size 1, are not better."""
_ALIKE = 1e-6


@final
class Touching(AbstractJoint, AbstractContact, AbstractSeenAlong):
    """A body with the outside `shape`, fixed in frame_b, touches the `surface` fixed in frame_a in one point, on the side of its normal.

    `law`: Rolling() (three velocities), RollingWithoutPivoting() (two), Sliding() (five); no multiplier. Apart(): six, and the gap is a coordinate. q of
    Sphere, Ellipsoid, Disk, Torus, ConvexShape: unit quaternion of R_ab (4, scalar first), then the coordinates of the touching point on the surface; of
    Cylinder, Cone, Revolution, ParametricSurface: coordinates of that point on the shape, the angle from the surface's first tangent to the shape's
    [rad], and its coordinates on the surface. v: angular velocity of frame_b against frame_a, in frame_b (3) [rad/s], or what the law says. Only while the
    shape is curved more than the surface in all directions, which `domain` says. It can pull. D. J. Montana, Int. J. Robotics Research 7 (1988).

        scene.contact = Touching(Ellipsoid((0.2, 0.1, 0.1)), Sphere(0.5))
    """

    if_singular = APEX
    q = Variable("", "coordinates of the body, then of the touching point on the surface", size=6)
    v = Variable("rad/s", "angular velocity in frame_b", size=3)

    def __init__(self, shape: AbstractSurface, surface: AbstractSurface, law: AbstractTouchingLaw | None = None) -> None:
        self.shape, self.surface = checked_surface(shape, "Touching", "shape"), checked_surface(surface, "Touching")
        self.law = checked_touching(Rolling() if law is None else law, "Touching")
        if isinstance(surface, AbstractShape) and _value(ca.det(surface.metric(ca.SX(ca.DM(surface.start)))))[0] == 0:
            raise ParameterError(
                f"The surface of {type(surface).__name__} has edges or corners, along which nothing rolls ({origin()}). If it rolls itself, exchange shape and surface, "
                "and with them frame_a and frame_b: the shape is that of frame_b's body."
            )
        own = len(meeting(shape, surface).start)
        start = (*_start(shape, surface), *(() if self.law.holds else (0.0,)))
        self._own, self._place = slice(0, own), slice(own, own + len(surface.start))
        self._declare("q", "", len(start), start)
        self._declare("v", self.law.unit, self.law.freedoms)

    def pose(self, q: ca.SX, t: ca.SX) -> Pose:
        own, place, both = self._parts(q)
        R = both.rotation(own, place)
        return Pose(R, both.surface.point(place) - R @ both.arm(own, place))

    def seen_along(self, places: np.ndarray) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return net(self.surface, places), net(self.shape, np.zeros((1, 3)), None)

    def rates(self, q: ca.SX, v: ca.SX, t: ca.SX) -> ca.SX:
        own, place, both = self._parts(q)
        w, slip = self._turning(q, v), self._slip(q, v)
        u = both.gliding(own, place, w, slip)
        opening = () if self.law.holds else (v[-1],)
        return ca.vertcat(both.rates(own, place, w, slip, u), self.surface.rates(place, u), *opening)

    def invariants(self, q: ca.SX, t: ca.SX) -> ca.SX:
        own, place, both = self._parts(q)
        return ca.vertcat(both.invariants(own), self.surface.invariants(place))

    def domain(self, q: ca.SX) -> ca.SX:
        own, place, both = self._parts(q)
        return ca.vertcat(both.fit(own, place), both.surface.inside(place))

    def why_outside(self, rows: int) -> tuple[str, ...]:
        _, place, both = self._parts(self.q.sx)
        of_surface = self.surface.inside(place).numel()
        first, second, others = both.outside
        return (first, second, *(others,) * (rows - 2 - of_surface), *(SURFACE_ENDS,) * of_surface)

    def regular(self, q: ca.SX) -> ca.SX:
        own, place, both = self._parts(q)
        return ca.vertcat(both.regular(own), self.surface.regular(place))

    def closure(self, X_ab: Pose, t: ca.SX) -> ca.SX | None:
        near = nearness(self.shape, self.surface, X_ab) if self.law.holds else None
        return None if near is None else near.gap

    def closure_rates(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> ca.SX:
        near = nearness(self.shape, self.surface, X_ab)
        return ca.SX(0, 1) if near is None else self.law.forbidden(near, w_ab_b, v_ab_b)

    def turns(self) -> tuple[bool, ...]:
        return (*meeting(self.shape, self.surface).turns, *self.surface.turns, *(() if self.law.holds else (False,)))

    def touch(self) -> tuple[Expression, Expression]:
        if self.law.holds and (found := touched(self.shape, self.surface, self.frame_a, self.frame_b)):
            return found
        _, place, both = self._parts(self.q.sx)
        frame = self.frame_a
        return frame.position + frame.rotation @ read(both.surface.point(place)), frame.rotation @ read(
            self.surface.normal(place)
        )

    @property
    def holds(self) -> bool:
        return self.law.holds

    @property
    def gap(self) -> Expression:
        return read(ca.SX(0)) if self.law.holds else self.q[-1]

    def axes(self, q: ca.SX) -> ca.SX:
        """(3, 3) both tangents of the surface and its normal where it touches, in frame_a."""
        place = q[self._place]
        return ca.horzcat(self.surface.tangents(place), self.surface.normal(place))

    def nearness(self) -> Nearness:
        """Where the bodies touch, or are nearest."""
        _, place, both = self._parts(self.q.sx)
        X, axes = self.pose(self.q.sx, ca.SX(0)), self.axes(self.q.sx)
        return Nearness(X, self.gap.sx, both.surface.point(place), axes[:, 2], axes[:, :2])

    def velocity(self) -> ca.SX:
        """Of the body's point over the surface (3, 1), in frame_a [m/s]."""
        return self.axes(self.q.sx) @ (self.law.slipping() @ self.v.sx)

    def motions(self, q: ca.SX, v: ca.SX, t: ca.SX) -> tuple[Motion, ...]:
        own, place, both = self._parts(q)
        X = self.pose(q, t)
        R, arm, w, slip = symbolic(X.rotation), both.arm(own, place), self._turning(q, v), self._slip(q, v)
        u = both.gliding(own, place, w, slip)
        axes, slipping = R.T @ self.axes(q), self.law.slipping()
        turning = self.law.turning(axes[:, :2])
        subspace = ca.sparsify(ca.vertcat(turning, ca.skew(arm) @ turning + axes @ slipping))
        velocity = ca.cross(arm, w) + axes @ (slipping @ v)
        over = axes[:, :2] @ (slipping[:2, :] @ v)
        arm_rate = R.T @ (both.surface.slopes(place) @ u) - over
        # rates of the axes in frame_b, along which the law has velocities
        turned = R.T @ self._axes_rate(place, u) - ca.cross(ca.horzcat(w, w, w), axes)
        bias_w = (self.law.turning(turned[:, :2]) - self.law.turning(ca.SX(3, 2))) @ v
        bias_v = ca.cross(arm_rate, w) + ca.cross(arm, bias_w) + turned @ (slipping @ v) + ca.cross(w, velocity)
        return (Motion(X, self.rates(q, v, t), subspace, ca.vertcat(w, velocity), ca.vertcat(ca.densify(bias_w), bias_v), v),)

    def _parts(self, q: ca.SX) -> tuple[ca.SX, ca.SX, AbstractMeeting]:
        """Own coordinates, those on the surface, and what touches: where there is a gap, the parallel surface at its distance."""
        surface = self.surface if self.law.holds else Parallel(self.surface, read(q[-1]))
        return q[self._own], q[self._place], meeting(self.shape, surface)

    def _axes_rate(self, place: ca.SX, u: ca.SX) -> ca.SX:
        """In frame_a, where the touching point glides over the surface with u."""
        surface = self.surface
        tangents, normal, turn = surface.tangents(place), surface.normal(place), surface.connection(place) @ u
        bent = surface.slopes(place) @ (surface.curvature(place) @ u)
        about = ca.horzcat(turn * tangents[:, 1], -turn * tangents[:, 0])
        return ca.horzcat(about - normal @ (tangents.T @ bent).T, bent)

    def _turning(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """Angular velocity in frame_b."""
        own, place, both = self._parts(q)
        return self.law.turning(both.rotation(own, place).T @ self.surface.tangents(place)) @ v

    def _slip(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """Velocity of the body's point along the surface, in frame_a."""
        return self.surface.tangents(q[self._place]) @ (self.law.slipping()[:2, :] @ v)


def _start(shape: AbstractSurface, surface: AbstractSurface) -> tuple[float, ...]:
    """Coordinates where a search for start values begins; they may depend on parameters as they are."""
    both, place = (
        meeting(shape, surface),
        surface.start_for(float(np.linalg.norm(_value(shape.point(ca.SX(ca.DM(shape.start))))))),
    )
    if isinstance(both, MeetingByCoordinates):
        # turned so that it fits best: axes of cylinders cross
        at = shape.start_for(_radius(surface, place) / 4)
        fits = [np.min(_value(both.fit(ca.SX(ca.DM((*at, angle))), ca.SX(ca.DM(place))))) for angle in _ANGLES]
        best = np.nanmax(fits, initial=-np.inf)
        return (*at, next((angle for angle, fit in zip(_ANGLES, fits, strict=True) if fit > best - _ALIKE), 0.0), *place)
    own, normal = both.start, _value(surface.normal(ca.SX(ca.DM(place))))
    if not np.all(_value(shape.single(ca.SX(ca.DM(-normal)))) > 0.5):
        # a wheel stands: the half turn about the middle between its normal and that of the ground
        middle = _value(shape.normal(ca.SX(ca.DM(shape.start)))) - normal
        own = (0.0, *(middle / np.linalg.norm(middle)))
    return (*own, *place)


def _radius(surface: AbstractSurface, place: tuple[float, ...]) -> float:
    """Of curvature at a place [m], where it is least; 1 where it is flat."""
    W = surface.curvature(ca.SX(ca.DM(place)))
    bend = float(_value(ca.sqrt(ca.trace(W @ W)))[0])
    return 1 / bend if 0 < bend < np.inf else 1.0


def _value(column: ca.SX) -> np.ndarray:
    """(n,) with parameters as they are. Raises `ParameterError` for what depends on anything else."""
    known = [symbol for symbol in declared_in(column) if isinstance(symbol, Parameter)]
    for symbol in declared_in(column) - set(known):
        raise ParameterError(
            f"What touches depends on the {symbol.kind} {symbol.name} ({origin()}), but its shape is to stay as it is. Use numbers and parameters, and let "
            "frame_a move, e.g. on a PrescribedMotion. A ball may change, or change its ground, where it parts: by Hard(...) or HuntCrossley(...), over a "
            "Plane, Sphere, Cylinder, Cone or Torus."
        )
    given = ca.vertcat(ca.SX(0, 1), *(symbol.sx for symbol in known))
    return np.array(ca.Function("value", [given], [ca.densify(column)])([symbol.value for symbol in known])).ravel()
