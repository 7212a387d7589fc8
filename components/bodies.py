"""Particles, rigid bodies and rigid connections."""

from __future__ import annotations

import math
from typing import Any, Self, final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ExpressionError, ParameterError
from acausal.language.connector import Frame, Point
from acausal.language.expression import (
    Expression,
    Scalar,
    check_unit,
    checked,
    evaluated,
    flag,
    is_truth,
    leaves,
    scalar,
    sx,
    vector,
)
from acausal.language.origin import origin
from acausal.parts.inertia import Inertia
from acausal.parts.pose import Matrix, Pose, pose
from acausal.parts.rigid import AbstractRigidPart, Attachment
from acausal.parts.sketch import rough_pose
from acausal.visual import shapes as drawn
from components.orientation import Rotation, rotation_matrix

Number = float | Expression


def _symbol(value: Number) -> float | ca.SX:
    return value.sx if isinstance(value, Expression) else value


@final
class Particle(AbstractRigidPart):
    """A point with mass [kg] > 0: three freedoms, six states, no orientation. `position`: where it is in a rough sketch of the scene [m].

    scene.bob = Particle(mass=1.0)
    """

    point = Point.port()

    def __init__(self, mass: Scalar, *, position: Scalar | None = None) -> None:
        self.mass = scalar(mass, "Particle's mass", positive=True, unit="kg")
        self._sketch = rough_pose(position, None, "Particle")

    def attachments(self) -> tuple[Attachment, ...]:
        return (Attachment(self.point, Pose.identity()),)

    def inertia(self) -> Inertia:
        return Inertia(_symbol(self.mass), np.zeros(3), np.zeros((3, 3)))

    def shapes(self) -> tuple[Any, ...]:
        return (drawn.PointMass(),)

    def sketch_pose(self) -> Pose | None:
        return self._sketch


@final
class Fixed(AbstractRigidPart):
    """A rigid connection without mass: frame_b at `position` (3,) [m] in frame_a and turned by `rotation`.

    scene.offset = Fixed((0, 0, -1.0))
    """

    frame_a = Frame.port()
    frame_b = Frame.port()

    def __init__(self, position: Scalar = (0.0, 0.0, 0.0), rotation: Rotation = None) -> None:
        self.position = vector(position, "Fixed's position", unit="m")
        self._rotation = rotation_matrix(rotation)

    def attachments(self) -> tuple[Attachment, ...]:
        return (Attachment(self.frame_a, Pose.identity()), Attachment(self.frame_b, pose(self.position, self._rotation)))

    def inertia(self) -> Inertia:
        return Inertia.zero()


@final
class RigidBody(AbstractRigidPart):
    """A rigid body with its frame, and as many further frames as one asks for: `body.at((x, y, z), rotation=...)`.

    `mass` [kg] > 0; `centre_of_mass` (3,) [m] in `frame`; `inertia`: about the centre of mass, in the axes of `frame`
    [kg m^2], as (Ixx, Iyy, Izz), (Ixx, Iyy, Izz, Ixy, Ixz, Iyz) with the entries of the matrix (products with their minus
    sign), or the matrix (3, 3). `position` and `rotation`: where it is in a rough sketch of the scene.
    Raises `ParameterError` for anything not physical, such as principal moments against the triangle inequality.

        scene.top = RigidBody(mass=1.0, centre_of_mass=(0, 0, 0.1), inertia=(0.02, 0.02, 0.01))
    """

    frame = Frame.port()

    def __init__(
        self,
        mass: Scalar,
        inertia: Scalar,
        centre_of_mass: Scalar = (0.0, 0.0, 0.0),
        *,
        position: Scalar | None = None,
        rotation: Rotation = None,
        shapes: tuple[Any, ...] = (),
    ) -> None:
        self.mass = scalar(mass, "RigidBody's mass", positive=True, unit="kg")
        self.centre_of_mass = vector(centre_of_mass, "RigidBody's centre_of_mass", unit="m")
        self.central_inertia = _inertia_matrix(inertia)
        self._sketch = rough_pose(position, rotation, "RigidBody")
        self._frames: list[tuple[Frame, Pose]] = []
        self.places: list[object] = []  # of further frames, where their parameters are found
        self._tip: Frame | None = None
        self._centre: Frame | None = None
        self._shapes = _checked_shapes(shapes)

    def at(self, position: Scalar, rotation: Rotation = None) -> Frame:
        """A frame at `position` (3,) [m] in `frame` and turned by `rotation`, fixed in the body."""
        where = vector(position, "RigidBody.at: position", unit="m")
        shown = ", ".join(f"{p:g}" for p in where) if isinstance(where, np.ndarray) else str(where.sx)
        return self._add_frame(f"at({shown})", where, rotation_matrix(rotation))

    def _add_frame(self, name: str, position: np.ndarray | Expression, rotation: np.ndarray | Expression | None) -> Frame:
        frame = Frame(self, name)
        self.places.append(position)
        self._frames.append((frame, pose(position, rotation)))
        setattr(self, f"_frame{len(self._frames)}", frame)
        return frame

    @property
    def tip(self) -> Frame:
        """The far end of a rod; only rods have one."""
        if self._tip is None:
            raise AttributeError("only a RigidBody.rod(...) has a tip; make other frames with body.at((x, y, z))")
        return self._tip

    @property
    def centre(self) -> Frame:
        """A frame at the centre of mass, with the axes of `frame`."""
        if self._centre is None:
            self._centre = self._add_frame("centre", self.centre_of_mass, None)
        return self._centre

    def attachments(self) -> tuple[Attachment, ...]:
        return (Attachment(self.frame, Pose.identity()), *(Attachment(f, X) for f, X in self._frames))

    def inertia(self) -> Inertia:
        centre = self.centre_of_mass
        return Inertia.about_centre(_symbol(self.mass), centre.sx if isinstance(centre, Expression) else centre, self._matrix())

    def _matrix(self) -> Matrix:
        return self.central_inertia.sx if isinstance(self.central_inertia, Expression) else self.central_inertia

    def shapes(self) -> tuple[Any, ...]:
        return self._shapes

    def sketch_pose(self) -> Pose | None:
        return self._sketch

    def can_hold(self, at: np.ndarray) -> bool:
        """A body with a shape is somewhere; where nobody said that, only its own frames are known."""
        if self._sketch is not None or not self._shapes:
            return True
        size = float(np.linalg.norm(at)) + 1e-300
        return any(
            isinstance(a.pose.position, np.ndarray) and float(np.linalg.norm(at - a.pose.position)) <= 1e-9 * size
            for a in self.attachments()
        )

    @classmethod
    def rod(cls, mass: Scalar, tip: Scalar, radius: Scalar | None = None, **sketch: Any) -> Self:
        """A straight uniform rod from `frame` to `tip` (3,) [m]; thin, or a solid cylinder of `radius` [m] > 0."""
        end = vector(tip, "rod's tip", unit="m")
        m = scalar(mass, "rod's mass", positive=True, unit="kg")
        if isinstance(end, np.ndarray) and float(np.linalg.norm(end)) == 0:
            raise ParameterError(f"rod's tip is its beginning ({origin()}): the rod has length zero.")
        r = 0.0 if radius is None else scalar(radius, "rod's radius", positive=True, unit="m")
        inertia = _rod_inertia(m, end, r)
        shape = drawn.Rod((0.0, 0.0, 0.0), _numbers(end), None if radius is None else _number(r))
        body = cls(mass, inertia, end * 0.5, shapes=(shape,), **sketch)  # pyright: ignore[reportArgumentType]
        body._tip = body._add_frame("tip", end, None)
        return body

    @classmethod
    def box(cls, mass: Scalar, size: Scalar, **sketch: Any) -> Self:
        """A solid box with edges `size` (3,) [m] > 0 along the axes of `frame`, which is at its centre."""
        m = scalar(mass, "box's mass", positive=True, unit="kg")
        x, y, z = (scalar(s, "box's size", positive=True) for s in _components(size, "box's size"))
        inertia = (m * (y * y + z * z) / 12, m * (x * x + z * z) / 12, m * (x * x + y * y) / 12)
        return cls(m, inertia, shapes=(drawn.Box((_number(x), _number(y), _number(z))),), **sketch)

    @classmethod
    def ball(cls, mass: Scalar, radius: Scalar, *, hollow: bool = False, **sketch: Any) -> Self:
        """A solid ball, or a thin spherical shell, of `radius` [m] > 0; `frame` is at its centre."""
        m, r = scalar(mass, "ball's mass", positive=True, unit="kg"), scalar(radius, "ball's radius", positive=True, unit="m")
        moment = m * r * r * (2 / 3 if flag(hollow, "RigidBody.ball's hollow") else 2 / 5)
        return cls(m, (moment,) * 3, shapes=(drawn.Sphere(_number(r)),), **sketch)

    @classmethod
    def cylinder(cls, mass: Scalar, radius: Scalar, length: Scalar, axis: Any = "z", **sketch: Any) -> Self:
        """A solid cylinder about `axis`; `radius`, `length` [m] > 0; `frame` is at its centre."""
        m, r = (
            scalar(mass, "cylinder's mass", positive=True, unit="kg"),
            scalar(radius, "cylinder's radius", positive=True, unit="m"),
        )
        h = scalar(length, "cylinder's length", positive=True, unit="m")
        side, along = m * (3 * r * r + h * h) / 12, m * r * r / 2
        shape = drawn.Cylinder(_number(r), _number(h), _axis_numbers(axis))
        return cls(m, _about_axis(side, along, axis), shapes=(shape,), **sketch)

    @classmethod
    def disk(cls, mass: Scalar, radius: Scalar, axis: Any = "z", *, hoop: bool = False, **sketch: Any) -> Self:
        """A thin uniform disk, or a thin hoop, about `axis`; `radius` [m] > 0; `frame` is at its centre."""
        m, r = scalar(mass, "disk's mass", positive=True, unit="kg"), scalar(radius, "disk's radius", positive=True, unit="m")
        along = m * r * r * (1 if flag(hoop, "RigidBody.disk's hoop") else 0.5)
        size, about = _number(r), _axis_numbers(axis)
        shapes: tuple[Any, ...] = (drawn.Disk(size, 0.06 * size, about),)
        if hoop:
            across = np.cross(about, np.eye(3)[np.argmin(np.abs(about))])
            spoke = size * across / np.linalg.norm(across)
            shapes = drawn.Torus(0.97 * size, 0.03 * size, about), drawn.Rod((0.0, 0.0, 0.0), tuple(spoke.tolist()), 0.015 * size)
        return cls(m, _about_axis(along / 2, along, axis), shapes=shapes, **sketch)

    @classmethod
    def ellipsoid(cls, mass: Scalar, semi_axes: Scalar, **sketch: Any) -> Self:
        """A solid ellipsoid with `semi_axes` (3,) [m] > 0 along the axes of `frame`, which is at its centre."""
        m = scalar(mass, "ellipsoid's mass", positive=True, unit="kg")
        a, b, c = (scalar(s, "ellipsoid's semi_axes", positive=True) for s in _components(semi_axes, "ellipsoid's semi_axes"))
        inertia = (m * (b * b + c * c) / 5, m * (a * a + c * c) / 5, m * (a * a + b * b) / 5)
        return cls(m, inertia, shapes=(drawn.Ellipsoid((_number(a), _number(b), _number(c))),), **sketch)


def _components(value: Scalar, what: str) -> tuple[Number, ...]:
    checked = vector(value, what, unit="m")
    return tuple(checked[i] if isinstance(checked, Expression) else float(checked[i]) for i in range(3))


def _number(value: Number) -> float:
    """For drawing: the present value of an expression."""
    if isinstance(value, Expression):
        current = evaluated(value)
        return 0.1 if current is None else float(current[0, 0])
    return value


def _numbers(value: np.ndarray | Expression) -> tuple[float, float, float]:
    if isinstance(value, Expression):
        current = evaluated(value)
        value = np.array([0.0, 0.0, 1.0]) if current is None else current.ravel()
    return float(value[0]), float(value[1]), float(value[2])


def _axis_numbers(axis: Any) -> tuple[float, float, float]:
    from components.orientation import axis_vector

    return _numbers(axis_vector(axis, "axis"))


def _rod_inertia(m: Number, end: np.ndarray | Expression, r: Number) -> np.ndarray | Expression:
    """Central inertia (3, 3) of a uniform rod along `end`; a solid cylinder of radius r."""
    d = sx(end)
    square = ca.dot(d, d)
    m_, r_ = sx(m), sx(r)
    matrix = m_ / 12 * (square * ca.SX.eye(3) - d @ d.T) + m_ * r_ * r_ / 4 * (ca.SX.eye(3) + d @ d.T / square)
    found = leaves(m, end, r)
    return Expression(matrix, found) if found else np.array(ca.DM(ca.evalf(matrix)))


def _about_axis(side: Number, along: Number, axis: Any) -> Any:
    """Central inertia (3, 3) of a body of revolution."""
    n = np.array(_axis_numbers(axis))
    matrix = sx(side) * (np.eye(3) - np.outer(n, n)) + sx(along) * np.outer(n, n)
    found = leaves(side, along)
    return Expression(matrix, found) if found else np.array(ca.DM(ca.evalf(matrix)))


def _checked_shapes(shapes: Any) -> tuple[drawn.AbstractShape, ...]:
    if not isinstance(shapes, list | tuple) or not all(isinstance(shape, drawn.AbstractShape) for shape in shapes):
        raise ParameterError(
            f"RigidBody's shapes are {shown(shapes)} ({origin()}). Give a tuple of shapes of acausal.visual.shapes, e.g. (Sphere(0.1),)."
        )
    return tuple(shapes)


def _inertia_matrix(inertia: Scalar) -> np.ndarray | Expression:
    """Checked central inertia (3, 3)."""
    check_unit(inertia, "RigidBody's inertia", "kg*m^2")
    if is_truth(inertia):
        raise ParameterError(f"RigidBody's inertia must be numbers, not {shown(inertia)} ({origin()}).")
    try:
        found, entries = leaves(inertia), sx(inertia)
    except ExpressionError as error:
        raise ParameterError(f"RigidBody's inertia: {error}") from None
    if entries.shape == (3, 1):
        matrix = ca.diag(entries)
    elif entries.shape == (6, 1):
        xx, yy, zz, xy, xz, yz = (entries[i] for i in range(6))
        matrix = ca.blockcat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    elif entries.shape == (3, 3):
        matrix = entries
    elif entries.shape == (9, 1) and isinstance(inertia, list | tuple):
        matrix = ca.reshape(entries, 3, 3).T
    else:
        raise ParameterError(f"inertia must have 3 or 6 numbers or be a matrix (3, 3), not shape {entries.shape} ({origin()}).")
    dense = Expression(ca.densify(matrix), found)
    if found:
        checked(dense, check_physical)
        return Expression(matrix, found)
    current = evaluated(dense)
    if current is None:
        return Expression(matrix, found)
    check_physical(current)
    return current


def check_physical(matrix: np.ndarray) -> None:
    """Raise `ParameterError` for an inertia (3, 3) that no body has about its centre of mass."""
    if not np.all(np.isfinite(matrix)):
        raise ParameterError(f"inertia is {matrix.tolist()} ({origin()}). Give finite numbers.")
    scale = float(np.max(np.abs(matrix)))
    if np.max(np.abs(matrix - matrix.T)) > 1e-9 * scale:
        raise ParameterError(f"inertia is not symmetric ({origin()}): {matrix.tolist()}.")
    a, b, c = np.linalg.eigvalsh(matrix)
    if a < -1e-9 * scale:
        raise ParameterError(f"inertia has a negative principal moment {a:g} kg m^2 ({origin()}).")
    if a + b < c * (1 - 1e-9) or not math.isfinite(a):
        raise ParameterError(
            f"inertia has principal moments {a:g}, {b:g}, {c:g} kg m^2 ({origin()}): no body has a moment larger than the sum of "
            "the other two. Check units and signs."
        )
