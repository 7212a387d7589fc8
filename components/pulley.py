"""Ropes around pulleys: the tangents between circles and points, and what pulleys with inertia do to the pull."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.component import Component
from acausal.language.connector import Frame, Rotational, Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Scalar, Variable, scalar, sx
from acausal.language.origin import origin
from acausal.parts.bounded import AbstractBounded
from acausal.parts.contact import read
from acausal.parts.pose import Pose, pose_between, symbolic
from acausal.parts.span import AbstractSpan
from acausal.visual.shapes import Torus
from components.bodies import RigidBody
from components.orientation import Axis, axis_vector

_RING = 0.08
"""Thickness of a ring that is drawn for a pulley, of its radius."""
_ACROSS = 1e-9
"""Cosine of the angle between two directions that are to be at right angles, at most."""


@dataclass(frozen=True, eq=False)
class Pulley:
    """A pulley of `radius` [m] > 0 about the origin of a `frame` that carries it and does not turn with it; what a `Cable` runs over.

    `middle`: the direction in the frame from the centre to about the middle of the arc on which the rope lies, less than half a turn from where it
    comes on and goes off; `along`, across it: where the rope runs there, on its way from frame_a to frame_b. The rope stays in the plane of both.
    Without a `wheel` it has no mass, and the pull is the same on both sides. A `wheel`, a body with its centre at its frame's origin, is put on a
    hinge there about middle x along and turns with the rope, which does not slip.

        Pulley(scene.world.at((0, 0, 2.0)), radius=0.1, wheel=scene.disk)
    """

    frame: Frame
    radius: float | Expression
    middle: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    along: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    wheel: RigidBody | None = None

    def __init__(
        self, frame: Frame, radius: Scalar, middle: Axis = "z", along: Axis = "x", wheel: RigidBody | None = None
    ) -> None:
        given: Any = (frame, wheel)
        if not isinstance(given[0], Frame):
            raise ParameterError(
                f"Pulley's frame is {shown(frame)} ({origin()}). Give a frame of a part, e.g. scene.world.at((0, 0, 2.0))."
            )
        if not isinstance(given[1], RigidBody | None):
            raise ParameterError(f"Pulley's wheel is {shown(wheel)} ({origin()}). Give a RigidBody, or leave it out.")
        m, t = _unit(middle, "middle"), _unit(along, "along")
        if abs(m @ t) > _ACROSS:
            raise ParameterError(
                f"Pulley's middle {m} and along {t} are not at right angles ({origin()}): the rope runs along the rim. Give two directions in its plane."
            )
        for name, value in (("frame", frame), ("middle", m), ("along", t), ("wheel", wheel)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "radius", scalar(radius, "Pulley's radius", positive=True, unit="m"))

    def arc(self, u: ca.SX) -> ca.SX:
        """Length [m] of the rope from the middle to where it goes off in the direction u (3, 1); turned round, from where it comes on."""
        return sx(self.radius) * ca.atan2(-ca.dot(u, ca.SX(ca.DM(self.middle))), ca.dot(u, ca.SX(ca.DM(self.along))))

    def rim(self, u: ca.SX) -> ca.SX:
        """Where on the rim (3, 1) [m] the rope runs in the direction u (3, 1)."""
        return sx(self.radius) * ca.cross(u, ca.SX(ca.DM(self.axis)))

    def shapes(self) -> tuple[Any, ...]:
        """A ring, where no wheel has shapes of its own and the radius is a number."""
        known = (self.wheel is None or not self.wheel.shapes()) and not isinstance(self.radius, Expression)
        return (Torus(float(self.radius), _RING * float(self.radius), _vector(self.axis)),) if known else ()

    @property
    def turned_round(self) -> Pulley:
        """The same for a rope on its way back."""
        return Pulley(self.frame, self.radius, _vector(self.middle), _vector(-self.along), self.wheel)

    @property
    def axis(self) -> np.ndarray:
        """middle x along, about which a wheel turns forwards (3,)."""
        return np.cross(self.middle, self.along)


@final
class Tangent(AbstractSpan, AbstractBounded):
    """A straight piece of rope from a `pulley` about frame_a to a point, frame_b, with its arc from the pulley's middle on, as a slide: s of `flange` is
    its length [m]. Made by `Cable`; frame_a is the pulley's.

        scene.piece = Tangent(Pulley(scene.world.at((0, 0, 2.0)), 0.1))
    """

    between_points = True
    if_outside = "A rope cannot end inside of its pulley: begin with its end farther off, or make the radius smaller."
    flange = Translational.port()

    def __init__(self, pulley: Pulley) -> None:
        self.pulley = checked_pulley(pulley, "Tangent")

    def coordinate(self, X_ab: Pose) -> ca.SX:
        u, length = self._straight(X_ab)
        return length + self.pulley.arc(u)

    def line(self, X_ab: Pose) -> tuple[ca.SX, ca.SX]:
        u, _ = self._straight(X_ab)
        return self.pulley.rim(u), symbolic(X_ab.position)

    def inside(self) -> Expression:
        p, axis = symbolic(pose_between(self.frame_a, self.frame_b).position), ca.SX(ca.DM(self.pulley.axis))
        return read(1 - sx(self.pulley.radius) ** 2 / (ca.sumsqr(p) - ca.dot(p, axis) ** 2))

    def shapes(self) -> tuple[Any, ...]:
        return self.pulley.shapes()

    def _straight(self, X_ab: Pose) -> tuple[ca.SX, ca.SX]:
        return _tangent(symbolic(X_ab.position), ca.SX(ca.DM(self.pulley.axis)), sx(self.pulley.radius))


@final
class CommonTangent(AbstractSpan, AbstractBounded):
    """A straight piece of rope from `pulley_a` about frame_a to `pulley_b` about frame_b, in one plane, with its arcs from both middles on, as a slide: s
    of `flange` is its length [m]. It crosses from side to side where they turn in opposite senses. Made by `Cable`.

        scene.piece = CommonTangent(Pulley(scene.world.frame, 0.1), Pulley(scene.world.at((1, 0, 0)), 0.2))
    """

    if_outside = "No straight piece runs from one pulley to the other: they overlap, or one is inside of the other. Move them apart, or make radii smaller."
    flange = Translational.port()

    def __init__(self, pulley_a: Pulley, pulley_b: Pulley) -> None:
        self.pulley_a, self.pulley_b = checked_pulley(pulley_a, "CommonTangent"), checked_pulley(pulley_b, "CommonTangent")

    def coordinate(self, X_ab: Pose) -> ca.SX:
        return self._straight(X_ab)[1] + sum(self.arcs(X_ab), ca.SX(0))

    def arcs(self, X_ab: Pose) -> tuple[ca.SX, ca.SX]:
        """Lengths [m] on both pulleys, from the middle of the first and to that of the second."""
        u, _ = self._straight(X_ab)
        return self.pulley_a.arc(u), self.pulley_b.turned_round.arc(-(symbolic(X_ab.rotation).T @ u))

    def line(self, X_ab: Pose) -> tuple[ca.SX, ca.SX]:
        (u, _), R = self._straight(X_ab), symbolic(X_ab.rotation)
        return self.pulley_a.rim(u), symbolic(X_ab.position) + R @ self.pulley_b.rim(R.T @ u)

    def inside(self) -> Expression:
        X = pose_between(self.frame_a, self.frame_b)
        p, axis = symbolic(X.position), ca.SX(ca.DM(self.pulley_a.axis))
        return read(1 - self._apart(X) ** 2 / (ca.sumsqr(p) - ca.dot(p, axis) ** 2))

    def shapes(self) -> tuple[Any, ...]:
        return self.pulley_a.shapes()

    def _apart(self, X_ab: Pose) -> ca.SX:
        """By how much the radii differ, the second one negative where it turns the other way."""
        a, b = self.pulley_a, self.pulley_b
        same = ca.dot(ca.SX(ca.DM(a.axis)), symbolic(X_ab.rotation) @ ca.SX(ca.DM(b.axis)))
        return sx(a.radius) - same * sx(b.radius)

    def _straight(self, X_ab: Pose) -> tuple[ca.SX, ca.SX]:
        return _tangent(symbolic(X_ab.position), ca.SX(ca.DM(self.pulley_a.axis)), self._apart(X_ab))


def _tangent(p: ca.SX, axis: ca.SX, apart: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Direction in the plane (3, 1) and length [m] of the straight piece to a centre at p (3, 1), radii about the axis differing by `apart` [m]."""
    across = ca.dot(p, axis)
    flat = p - across * axis
    d = ca.norm_2(flat)
    sine = apart / d
    u = (flat * ca.sqrt(1 - sine**2) + ca.cross(axis, flat) * sine) / d
    return u, ca.sqrt(ca.sumsqr(p) - apart**2)


@final
class RopeOverWheels(Component):
    """A rope of constant length `total` [m] that does not slip on wheels: between two of them it has one pull, and gets as much as they feed.

    `sections`: numbers of flanges, the pieces of rope from wheel to wheel; `radii` [m] of these. With the lengths S of the sections and the turns phi of
    the wheels: S_1 + S_2 + ... = total, S_k' = r_(k-1) phi_(k-1)' - r_k phi_k'. Its pull turns wheel k by r_k (T_(k+1) - T_k).
    """

    tension = Variable("N", "pull of each section")

    def __init__(self, total: Scalar, sections: Sequence[int], radii: Sequence[float | Expression]) -> None:
        given: tuple[Any, Any] = sections, radii
        if not isinstance(given[0], list | tuple) or not all(type(n) is int and n > 0 for n in sections):
            raise ParameterError(
                f"RopeOverWheels's sections are {shown(sections)} ({origin()}). Give a list of whole numbers of at least 1."
            )
        if not isinstance(given[1], list | tuple) or len(radii) != len(sections) - 1:
            raise ParameterError(
                f"RopeOverWheels's radii are {shown(radii)} for {len(sections)} sections ({origin()}). Give a list with one radius between any two sections."
            )
        self.total = scalar(total, "RopeOverWheels's total", unit="m")
        self.radii = tuple(scalar(radius, "RopeOverWheels's radii", positive=True, unit="m") for radius in radii)
        vars(self)["tension"] = Variable("N", "pull of each section", size=len(sections), name="tension")
        self.pieces = [[self._port(Translational, f"piece_{k}_{i}") for i in range(n)] for k, n in enumerate(sections)]
        self.shafts = [self._port(Rotational, f"shaft_{k}") for k in range(len(self.radii))]
        self.flanges = tuple(port for section in self.pieces for port in section)

    def _port(self, kind: type[Any], name: str) -> Any:
        port = kind(self, name, must_connect=True, if_unconnected="Connect all its flanges.")
        setattr(self, name, port)
        return port

    def equations(self) -> Iterable[Equation]:
        lengths: list[Expression] = []
        for section in self.pieces:
            lengths.append(1.0 * section[0].s)
            for port in section[1:]:
                lengths[-1] = lengths[-1] + port.s
        yield equal(sum(lengths[1:], lengths[0]), self.total)
        for k, (radius, shaft) in enumerate(zip(self.radii, self.shafts, strict=True)):
            fed = self.radii[k - 1] * der(self.shafts[k - 1].phi) if k else 0.0
            yield equal(der(lengths[k]), fed - radius * der(shaft.phi))
            yield equal(shaft.tau, radius * (self.tension[k] - self.tension[k + 1]))
        for k, section in enumerate(self.pieces):
            for port in section:
                yield equal(port.f, self.tension[k])


def checked_pulley(pulley: object, part: str) -> Pulley:
    """Raises `ParameterError` for anything else."""
    if not isinstance(pulley, Pulley):
        raise ParameterError(f"{part}'s pulley is {shown(pulley)} ({origin()}). Give a Pulley(frame, radius).")
    return pulley


def _vector(direction: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, direction)
    return x, y, z


def _unit(direction: Axis, name: str) -> np.ndarray:
    found = axis_vector(direction, f"Pulley's {name}")
    if isinstance(found, Expression):
        raise ParameterError(f"Pulley's {name} is {direction!r} ({origin()}). Give a direction of numbers.")
    return np.asarray(found, dtype=float).ravel()
