"""A still picture of a mechanism at a few instants, without a browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from acausal.visual.animation import PALETTE, Animation, MovingBody, rotated
from acausal.visual.pyplot import new_figure, saved
from acausal.visual.shapes import Box, Cylinder, Disk, Ellipsoid, PointMass, Polygon, Rod, Shape, Sphere


def write_png(animation: Animation, path: str | Path, *, times: Sequence[float]) -> Path:
    """Orthographic view, straight onto a planar mechanism; earlier instants are drawn fainter. Returns the path."""
    right, up = _view(animation)
    figure, axes = new_figure(7.5, 6.5)
    for trail in animation.trails:
        axes.plot(trail.points @ right, trail.points @ up, color="#9aa7b5", linewidth=0.8, zorder=1)
    for k, moment in enumerate(times):
        frame = int(np.argmin(np.abs(animation.times - moment)))
        strength = 1.0 if len(times) == 1 else 0.25 + 0.75 * k / (len(times) - 1)
        _draw_frame(axes, animation, frame, right, up, strength)
    axes.set_aspect("equal")
    axes.set_title(animation.title + ("" if len(times) != 1 else f", t = {times[0]:g} s"), loc="left", fontsize=11)
    axes.set_xlabel("[m]")
    axes.grid(alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)
    saved(figure, path)
    return Path(path)


def _view(animation: Animation) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (3,) of the picture's right and up."""
    up = np.array(animation.up)
    normal = animation.plane_normal()
    if normal is None:
        helper = np.array([1.0, 0, 0]) if abs(up[0]) < 0.9 else np.array([0, 1.0, 0])
        side = np.cross(up, helper)
        normal = helper * 0.5 - side * 0.8 + up * 0.35
    normal = normal / np.linalg.norm(normal)
    if (normal[np.argmax(np.abs(normal))] < 0 and abs(normal[1]) < 0.9) or normal[1] > 0.9:
        normal = -normal
    if abs(float(normal @ up)) > 0.99:
        up = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    up = up - normal * float(normal @ up)
    up = up / np.linalg.norm(up)
    return np.cross(up, normal), up


def _draw_frame(axes: Any, animation: Animation, frame: int, right: np.ndarray, up: np.ndarray, strength: float) -> None:
    width = 2.5
    for link in animation.links:
        line = (
            _coil(link.starts[frame], link.ends[frame], right, up, animation.size())
            if link.kind == "spring"
            else np.stack([[p @ right, p @ up] for p in (link.starts[frame], link.ends[frame])])
        )
        axes.plot(line[:, 0], line[:, 1], color="#3d4957", linewidth=1.0, alpha=strength, zorder=3)
    for i, body in enumerate(animation.bodies):
        colour = PALETTE[i % len(PALETTE)]
        label = body.name if strength == 1.0 and len(animation.bodies) <= 12 else None
        for shape in body.shapes:
            outline, filled = _outline(shape)
            if outline is None:
                centre = body.positions[frame]
                axes.plot(centre @ right, centre @ up, "o", color=colour, markersize=8, alpha=strength, zorder=5, label=label)
                continue
            points = _placed(body, frame, outline)
            flat = np.stack([points @ right, points @ up], axis=1)
            if filled:
                axes.fill(flat[:, 0], flat[:, 1], facecolor=colour, alpha=0.28 * strength, zorder=2)
            axes.plot(
                flat[:, 0],
                flat[:, 1],
                color=colour,
                linewidth=width,
                alpha=strength,
                solid_capstyle="round",
                zorder=4,
                label=label,
            )
            label = None
    for joint in animation.joints:
        p = joint.positions[frame]
        axes.plot(
            p @ right, p @ up, "o", markersize=5, markerfacecolor="white", markeredgecolor="#3d4957", alpha=strength, zorder=6
        )
    if strength == 1.0 and 0 < len(animation.bodies) <= 12:
        axes.legend(frameon=False, fontsize=8, loc="best")


def _placed(body: MovingBody, frame: int, points: np.ndarray) -> np.ndarray:
    q = body.quaternions[frame : frame + 1]
    return np.array([body.positions[frame] + rotated(q, p)[0] for p in points])


def _outline(shape: Shape) -> tuple[np.ndarray | None, bool]:
    """Points (k, 3) of a closed or open line in the body's frame, and whether it is filled; None for a dot."""
    circle = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 49)), np.sin(a), 0 * a], axis=1)
    match shape:
        case Rod():
            return np.array([shape.start, shape.end]), False
        case Polygon():
            return np.array([*shape.points, shape.points[0]]), len(shape.points) > 2
        case Sphere():
            return shape.radius * circle, True
        case Disk() | Cylinder():
            return _about(shape.radius * circle, np.array(shape.axis)), True
        case Ellipsoid():
            return np.array(shape.semi_axes) * circle[:, [0, 2, 1]], True
        case Box():
            x, y, z = np.array(shape.size) / 2
            return np.array(
                [
                    (-x, -y, -z),
                    (x, -y, -z),
                    (x, y, -z),
                    (-x, y, -z),
                    (-x, -y, -z),
                    (-x, -y, z),
                    (x, -y, z),
                    (x, y, z),
                    (-x, y, z),
                    (-x, -y, z),
                ]
            ), False
        case PointMass():
            return None, False


def _about(points: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Points around z, turned to be around `axis`."""
    from acausal.mechanics.pose import rotation_to_axis

    return points @ rotation_to_axis(axis / np.linalg.norm(axis)).T


def _coil(start: np.ndarray, end: np.ndarray, right: np.ndarray, up: np.ndarray, size: float) -> np.ndarray:
    """Zig-zag line (k, 2) between two points in the picture."""
    a, b = np.array([start @ right, start @ up]), np.array([end @ right, end @ up])
    along = b - a
    length = float(np.linalg.norm(along))
    if length == 0:
        return np.stack([a, b])
    across = np.array([-along[1], along[0]]) / length
    s = np.concatenate([[0.0], np.linspace(0.12, 0.88, 17), [1.0]])
    swing = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], 8)[:15], [0.0, 0.0]]) * 0.018 * size
    return a + s[:, None] * along + swing[:, None] * across
