"""A motion as plain data, and as one self-contained HTML page."""

from __future__ import annotations

import base64
import html
import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from acausal.visual.shapes import Box, Cylinder, Disk, Ellipsoid, PointMass, Polygon, Rod, Shape, Sphere

PALETTE = ("#4C78A8", "#F58518", "#54A24B", "#E45756", "#72B7B2", "#B279A2", "#EECA3B", "#9D755D", "#5F9ED1", "#FF9DA6")


@dataclass(frozen=True)
class MovingBody:
    """`shapes` in a frame with `positions` (n, 3) [m] and `quaternions` (n, 4), scalar first, in the world."""

    name: str
    shapes: tuple[Shape, ...]
    positions: np.ndarray
    quaternions: np.ndarray


@dataclass(frozen=True)
class MovingLink:
    """A line from `starts` to `ends`, (n, 3) [m] each, drawn as a coil for kind 'spring', else as a line."""

    name: str
    kind: str
    starts: np.ndarray
    ends: np.ndarray


@dataclass(frozen=True)
class JointMarker:
    """A joint at `positions` (n, 3) [m]; `axes` (n, 3) are unit vectors in the world; kind 'hinge', 'slider', 'ball' or 'other'."""

    name: str
    kind: str
    positions: np.ndarray
    axes: np.ndarray


@dataclass(frozen=True)
class Trail:
    """The path (n, 3) [m] of a point."""

    name: str
    points: np.ndarray


@dataclass(frozen=True)
class Animation:
    """Everything that is drawn, at `times` (n,) [s]. `up` is the direction against gravity. `speed`: shown against real time."""

    title: str
    times: np.ndarray
    bodies: tuple[MovingBody, ...]
    links: tuple[MovingLink, ...]
    joints: tuple[JointMarker, ...]
    trails: tuple[Trail, ...]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    speed: float = 1.0

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (3,), (3,) [m] of a box around the whole motion."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for body in self.bodies:
            for corner in shape_points(body.shapes):
                moved = body.positions + rotated(body.quaternions, corner)
                low, high = np.minimum(low, moved.min(axis=0)), np.maximum(high, moved.max(axis=0))
        others = [link.starts for link in self.links] + [link.ends for link in self.links] + [j.positions for j in self.joints]
        for points in others:
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        if not np.all(np.isfinite(low)):
            return np.full(3, -1.0), np.full(3, 1.0)
        return low, high

    def size(self) -> float:
        """Diagonal of the bounds [m]."""
        low, high = self.bounds()
        return max(float(np.linalg.norm(high - low)), 1e-6)

    def plane_normal(self) -> np.ndarray | None:
        """Unit normal (3,) of the plane in which all joints, links and body origins stay; None if the motion is spatial."""
        points = [b.positions for b in self.bodies] + [j.positions for j in self.joints] + [link.ends for link in self.links]
        points += [
            b.positions + rotated(b.quaternions, np.array(s.end)) for b in self.bodies for s in b.shapes if isinstance(s, Rod)
        ]
        if not points:
            return None
        cloud = np.vstack(points)
        _, spread, axes = np.linalg.svd(cloud - cloud.mean(axis=0), full_matrices=False)
        if spread[2] < 1e-4 * spread[0] and spread[1] > 1e-3 * spread[0]:
            return axes[2]
        return None


def shape_points(shapes: tuple[Shape, ...]) -> list[np.ndarray]:
    """Points (3,) of the body whose bounding box holds the shapes."""
    points: list[np.ndarray] = []
    for shape in shapes:
        match shape:
            case Rod():
                points += [np.array(shape.start), np.array(shape.end)]
            case Polygon():
                points += [np.array(p) for p in shape.points]
            case PointMass():
                points.append(np.zeros(3))
            case _:
                r = extent(shape)
                points += [r * np.array(corner) for corner in ((1, 1, 1), (-1, -1, -1), (1, -1, 1), (-1, 1, -1))]
    return points


def extent(shape: Shape) -> np.ndarray:
    """Half sizes (3,) [m] of a solid about the origin."""
    match shape:
        case Box():
            return np.array(shape.size) / 2
        case Ellipsoid():
            return np.array(shape.semi_axes)
        case Sphere():
            return np.full(3, shape.radius)
        case Cylinder():
            n = np.abs(np.array(shape.axis))
            return n * shape.length / 2 + (1 - n) * shape.radius
        case Disk():
            return np.full(3, shape.radius)
        case _:
            return np.zeros(3)


def rotated(quaternions: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """(n, 3): R(q) v for quaternions (n, 4), scalar first."""
    w, u = quaternions[:, :1], quaternions[:, 1:]
    t = 2 * np.cross(u, vector)
    return vector + w * t + np.cross(u, t)


def write_html(animation: Animation, path: str | Path) -> Path:
    """Write one page that needs no network: three.js, the viewer and the motion inside. Returns the path."""
    data = json.dumps(_data(animation), separators=(",", ":")).replace("<", "\\u003c")
    files = resources.files("acausal.visual")
    page = files.joinpath("viewer.html").read_text(encoding="utf-8")
    for mark, text in (
        ("<!--TITLE-->", html.escape(animation.title)),
        ("/*THREE*/", files.joinpath("three.bundle.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script")),
        ("/*VIEWER*/", files.joinpath("viewer.js").read_text(encoding="utf-8")),
        ("/*DATA*/null", data),
    ):
        page = page.replace(mark, text)
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(page, encoding="utf-8")
    return target


def _data(animation: Animation) -> dict[str, Any]:
    low, high = animation.bounds()
    normal = animation.plane_normal()
    return {
        "title": animation.title,
        "speed": animation.speed,
        "times": _packed(animation.times),
        "up": list(animation.up),
        "low": low.tolist(),
        "high": high.tolist(),
        "normal": None if normal is None else normal.tolist(),
        "palette": list(PALETTE),
        "bodies": [
            {"name": b.name, "shapes": [_shape(s) for s in b.shapes], "p": _packed(b.positions), "q": _packed(b.quaternions)}
            for b in animation.bodies
        ],
        "links": [{"name": k.name, "kind": k.kind, "a": _packed(k.starts), "b": _packed(k.ends)} for k in animation.links],
        "joints": [{"name": j.name, "kind": j.kind, "p": _packed(j.positions), "axis": _packed(j.axes)} for j in animation.joints],
        "trails": [{"name": t.name, "p": _packed(t.points)} for t in animation.trails],
    }  # fmt: skip


def _shape(shape: Shape) -> dict[str, Any]:
    return {"kind": type(shape).__name__, **vars(shape)}


def _packed(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")
