"""What parts look like: solids and lines in a body's frame, SI units. Pure data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

PLANE_COLOUR = "#9fb0c1"
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class AbstractShape:
    """A shape about a place of its own in the body's frame.

    `position` [m] and `rotation` (rows of R_BodyShape) place the shape; `colour` is a CSS name or '#rrggbb', None: the body's.
    """

    kind: ClassVar[str]
    """What drawers call it."""
    colour: str | None = None
    position: Vector = (0.0, 0.0, 0.0)
    rotation: Matrix = IDENTITY


@dataclass(frozen=True)
class Box(AbstractShape):
    """Edges `size` [m] along the axes, centred."""

    kind = "Box"
    size: Vector


@dataclass(frozen=True)
class Sphere(AbstractShape):
    """Ball of `radius` [m]; bands show its rotation."""

    kind = "Sphere"
    radius: float


@dataclass(frozen=True)
class Cylinder(AbstractShape):
    """Solid cylinder of `radius` and `length` [m] about `axis`, centred."""

    kind = "Cylinder"
    radius: float
    length: float
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Disk(AbstractShape):
    """Flat disk of `radius` and `thickness` [m] about `axis`, centred; a spoke shows its rotation."""

    kind = "Disk"
    radius: float
    thickness: float
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Torus(AbstractShape):
    """Ring about `axis`: a tube of radius `tube` [m] around a circle of `radius` [m], centred."""

    kind = "Torus"
    radius: float
    tube: float
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Ellipsoid(AbstractShape):
    """`semi_axes` [m] along the axes, centred; bands show its rotation."""

    kind = "Ellipsoid"
    semi_axes: Vector


@dataclass(frozen=True)
class Rod(AbstractShape):
    """Round bar from `start` to `end` [m]; `radius` [m], None: chosen by the drawer from the scene's size."""

    kind = "Rod"
    start: Vector
    end: Vector
    radius: float | None = None


@dataclass(frozen=True)
class Arrow(AbstractShape):
    """Arrow from `start` to `end` [m], the head included; `radius` [m] of its shaft, None: chosen by the drawer."""

    kind = "Arrow"
    start: Vector
    end: Vector
    radius: float | None = None


@dataclass(frozen=True)
class PointMass(AbstractShape):
    """Small ball of `radius` [m], None: chosen by the drawer from the scene's size."""

    kind = "PointMass"
    radius: float | None = None


@dataclass(frozen=True)
class Polygon(AbstractShape):
    """Flat plate between `points` [m], for parts known only by their connection points; two points are a bar, one is a ball."""

    kind = "Polygon"
    points: tuple[Vector, ...]


@dataclass(frozen=True)
class Wire(AbstractShape):
    """Thin line through `points` [m] in turn: a track, a guide; `radius` [m], None: chosen by the drawer from the scene's size."""

    kind = "Wire"
    points: tuple[Vector, ...]
    radius: float | None = None


@dataclass(frozen=True)
class Plane(AbstractShape):
    """Square of edge `size` [m] across `normal`, centred at `point` [m]: a floor or an incline, drawn with faint squares."""

    kind = "Plane"
    normal: Vector
    point: Vector
    size: float


Shape = Box | Sphere | Cylinder | Disk | Torus | Ellipsoid | Rod | Arrow | PointMass | Polygon | Wire | Plane
