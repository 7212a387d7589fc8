"""How far shapes reach: the one question behind bounding boxes, the ground's height and outlines in a picture."""

from __future__ import annotations

import numpy as np

from acausal.visual.shapes import (
    Arrow,
    Box,
    Cylinder,
    Disk,
    Ellipsoid,
    Plane,
    PointMass,
    Polygon,
    Rod,
    Shape,
    Sphere,
    Torus,
    Vector,
    Wire,
)

_TINY = 1e-300
WIRE = 0.3
"""Radius of a wire beside that of bars."""


def rotated(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(n, 3): R(q) v for quaternions (n, 4), scalar first, and vectors (3,) or (n, 3)."""
    w, u = quaternions[:, :1], quaternions[:, 1:]
    t = 2 * np.cross(u, vectors)
    return vectors + w * t + np.cross(u, t)


def turned_back(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(n, 3): R(q)^T v."""
    return rotated(quaternions * np.array([1.0, -1.0, -1.0, -1.0]), vectors)


def support_points(shape: Shape, directions: np.ndarray, thickness: float = 0.0) -> np.ndarray:
    """Points (k, 3) [m] of a shape that reach furthest along `directions` (k, 3), in the body's frame.

    `thickness` [m] is the radius where the shape leaves it to the drawer. Exact for convex shapes; for a torus its outer hull.
    """
    R = np.array(shape.rotation, dtype=float)
    return np.array(shape.position, dtype=float) + _support(shape, directions @ R, thickness) @ R.T


def outside(shape: Shape, place: np.ndarray) -> tuple[float, np.ndarray]:
    """How far a `place` (3,) [m] is outside of a shape, 0 within, and the point (3,) of its middle that is nearest, both in the body's frame: of bars along
    their axis, else the centre. Of a solid as far as is told by the directions of its axes, across these, and from its centre.
    """
    R, p = np.array(shape.rotation, dtype=float), np.array(shape.position, dtype=float)
    own = R.T @ (place - p)
    middle = np.zeros(3)
    if isinstance(shape, Rod | Arrow):
        start, along = np.array(shape.start), np.array(shape.end) - np.array(shape.start)
        middle = start + np.clip((own - start) @ along / max(float(along @ along), _TINY), 0.0, 1.0) * along
        return max(float(np.linalg.norm(own - middle)) - (shape.radius or 0.0), 0.0), p + R @ middle
    if isinstance(shape, Polygon | Wire | Plane):
        return 0.0, p  # made of such places, or of no end
    axes = np.eye(3)
    if isinstance(shape, Cylinder | Disk | Torus):
        axes = np.array(shape.axis, dtype=float)[None, :] / max(float(np.linalg.norm(shape.axis)), _TINY)
    u = np.array([own, *axes, *-axes, *(own - axes * (axes @ own)[:, None])])
    u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), _TINY)
    return max(float(np.max(u @ own - np.sum(u * _support(shape, u, 0.0), axis=1))), 0.0), p


def vector_of(place: np.ndarray) -> Vector:
    """As shapes have them."""
    return float(place[0]), float(place[1]), float(place[2])


def _support(shape: Shape, u: np.ndarray, thickness: float) -> np.ndarray:
    unit = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), _TINY)
    match shape:
        case Box():
            return np.sign(u) * np.array(shape.size) / 2
        case Sphere():
            return shape.radius * unit
        case Ellipsoid():
            s = np.array(shape.semi_axes)
            return s**2 * u / np.maximum(np.linalg.norm(s * u, axis=1, keepdims=True), _TINY)
        case Cylinder():
            return _around(u, shape.axis, shape.radius, shape.length / 2)
        case Disk():
            return _around(u, shape.axis, shape.radius, shape.thickness / 2)
        case Torus():
            return _around(u, shape.axis, shape.radius, 0.0) + shape.tube * unit
        case Rod():
            return _furthest(u, (shape.start, shape.end)) + (thickness if shape.radius is None else shape.radius) * unit
        case Arrow():
            return _further(u, *_arrow(u, shape, thickness))
        case PointMass():
            return (2.2 * thickness if shape.radius is None else shape.radius) * unit
        case Polygon():
            return _furthest(u, shape.points) + thickness * unit
        case Wire():
            return _furthest(u, shape.points) + (WIRE * thickness if shape.radius is None else shape.radius) * unit
        case Plane():
            return _furthest(u, plane_corners(shape, shape.size))


def arrow_points(arrow: Arrow, directions: np.ndarray, thickness: float) -> list[np.ndarray]:
    """As `support_points`, of the arrow's shaft and of its head."""
    R = np.array(arrow.rotation, dtype=float)
    return [np.array(arrow.position, dtype=float) + piece @ R.T for piece in _arrow(directions @ R, arrow, thickness)]


def _arrow(u: np.ndarray, arrow: Arrow, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Shaft and head; the head is 9 radii of the shaft long and 3.2 wide, less for short arrows."""
    base, tip = np.array(arrow.start, dtype=float), np.array(arrow.end, dtype=float)
    along = tip - base
    length = float(np.linalg.norm(along))
    radius = min(0.4 * thickness if arrow.radius is None else arrow.radius, length / 18)
    neck = tip - 9 * radius * along / max(length, _TINY)
    shaft, wide = _rim(u, along, radius), _rim(u, along, 3.2 * radius)
    return _further(u, base + shaft, neck + shaft), _further(u, neck + wide, np.broadcast_to(tip, u.shape))


def _further(u: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Row by row, the point that reaches further along u."""
    return np.where((np.sum(u * first, axis=1) >= np.sum(u * second, axis=1))[:, None], first, second)


def _around(u: np.ndarray, axis: tuple[float, float, float], radius: float, half_length: float) -> np.ndarray:
    """Support points of a cylinder about `axis`."""
    a = np.array(axis) / np.linalg.norm(axis)
    return _rim(u, a, radius) + half_length * np.sign(u @ a)[:, None] * a


def _rim(u: np.ndarray, axis: np.ndarray, radius: float) -> np.ndarray:
    """Support points of a circle of `radius` [m] about `axis` (3,); its centre where u is along the axis."""
    a = axis / max(float(np.linalg.norm(axis)), _TINY)
    across = u - (u @ a)[:, None] * a
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return np.where(size > 1e-12, radius * across / np.maximum(size, _TINY), 0.0)


def _furthest(u: np.ndarray, points: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    corners = np.array(points, dtype=float).reshape(-1, 3)
    return corners[np.argmax(u @ corners.T, axis=1)]


def plane_corners(plane: Plane, size: float) -> tuple[tuple[float, float, float], ...]:
    """Corners of the square of edge `size` [m], in order around it."""
    n = np.array(plane.normal) / np.linalg.norm(plane.normal)
    first, second = across(n)
    h, p = size / 2, np.array(plane.point)
    corners = [p + h * (i * first + j * second) for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return tuple((float(c[0]), float(c[1]), float(c[2])) for c in corners)


def across(n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3,) that complete the unit vector n to a right-handed frame; the first is along a world axis if it can."""
    helper = np.eye(3)[np.argsort(np.abs(n), kind="stable")[0]]
    first = helper - n * float(helper @ n)
    first = first / np.linalg.norm(first)
    return first, np.cross(n, first)
