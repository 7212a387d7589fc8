"""What parts look like: solids and lines in a body's frame, SI units. Pure data."""

from __future__ import annotations

from dataclasses import dataclass

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Box:
    """Edges `size` [m] along the axes, centred at the origin."""

    size: Vector


@dataclass(frozen=True)
class Sphere:
    """`radius` [m] about the origin."""

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """Solid cylinder of `radius` and `length` [m] about `axis`, centred at the origin."""

    radius: float
    length: float
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Disk:
    """Flat disk of `radius` and `thickness` [m] about `axis`, centred at the origin; spokes show its rotation."""

    radius: float
    thickness: float
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Ellipsoid:
    """`semi_axes` [m] along the axes, centred at the origin."""

    semi_axes: Vector


@dataclass(frozen=True)
class Rod:
    """Round bar from `start` to `end` [m]; the drawer chooses the radius if none is given."""

    start: Vector
    end: Vector
    radius: float | None = None


@dataclass(frozen=True)
class PointMass:
    """A small ball at the origin, of a size that the drawer chooses."""


@dataclass(frozen=True)
class Polygon:
    """Flat plate between `points` [m] of the body, for parts known only by their connection points."""

    points: tuple[Vector, ...]


Shape = Box | Sphere | Cylinder | Disk | Ellipsoid | Rod | PointMass | Polygon
