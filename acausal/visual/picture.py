"""A still picture of a mechanism at a few instants, without a browser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arguments import path_of
from acausal.errors import OptionError
from acausal.visual.animation import Animation, MovingBody, MovingLink, Trail, check_ending
from acausal.visual.geometry import across, arrow_points, rotated, support_points, turned_back
from acausal.visual.pyplot import new_figure, plain, saved
from acausal.visual.shapes import Arrow, Box, Cylinder, Disk, Plane, PointMass, Polygon, Rod, Shape, Torus, Wire
from acausal.visual.view import View, view_of

_LINK_COLOURS = {"spring": "#3d4957", "damper": "#8a63c4", "force": "#d1495b", "string": "#8d7b68", "cone": "#e09f3e"}
_MOST_LABELS = 12


@dataclass(frozen=True)
class _Canvas:
    axes: Any
    animation: Animation
    view: View
    thickness: float

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Coordinates (k, 2) in the picture of points (k, 3)."""
        return points @ np.stack([self.view.right, self.view.up], axis=1)


def write_png(animation: Animation, path: str | Path, *, times: Sequence[float] = ()) -> Path:
    """Orthographic view, straight onto a planar mechanism, at `times` [s], by default the first; earlier instants are fainter.

    Returns the path. Raises `OptionError` for times outside of the motion, and for names of another kind of file.
    """
    check_ending(path_of(path, "picture: the file"), ("", ".png"), "a picture", "picture.png")
    moments = tuple(times) or (float(animation.times[0]),)
    first, last = float(animation.times[0]), float(animation.times[-1])
    slack = 1e-9 * max(abs(first), abs(last), 1e-300)
    for moment in moments:
        if not first - slack <= moment <= last + slack:
            raise OptionError(
                f"There is no picture of '{animation.title}' at {moment:g} s: the motion lasts from {first:g} s to {last:g} s."
            )
    frames = [int(np.argmin(np.abs(animation.times - moment))) for moment in moments]
    view, thickness = view_of(animation), animation.thickness()
    left, right, low, high = _limits(_only(animation, frames), animation.trails, view, thickness)
    figure, axes = new_figure(7.5, float(np.clip(7.0 * (high - low) / (right - left), 2.5, 12.0)) + 0.8)
    canvas = _Canvas(axes, animation, view, thickness)
    owners = {body.name: colour for body, colour in zip(animation.bodies, animation.colours(), strict=True)}
    for trail in animation.trails:
        line = canvas.flat(trail.points)
        axes.plot(line[:, 0], line[:, 1], color=owners.get(trail.name, "#7d8a99"), linewidth=0.9, alpha=0.6, zorder=0.5)
    for k, frame in enumerate(frames):
        _draw_frame(canvas, frame, 1.0 if k == len(frames) - 1 else 0.2 + 0.5 * k / len(frames), 1 + 10 * k)
    unit, scale = _unit(max(right - left, high - low))
    axes.set(xlim=(left, right), ylim=(low, high), xlabel=f"[{unit}]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{round(value / scale, 9) + 0.0:g}")
    axes.set_aspect("equal", adjustable="box")
    instants = ", ".join(f"{m:g}" for m in moments) if len(moments) <= 6 else f"{moments[0]:g} to {moments[-1]:g}"
    axes.set_title(plain(f"{animation.title}, t = {instants} s"), loc="left", fontsize=11)
    axes.grid(alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)
    if 0 < len(animation.bodies) <= _MOST_LABELS:
        _add_legend(axes, animation)
    saved(figure, path)
    return Path(path)


def _only(animation: Animation, frames: list[int]) -> Animation:
    """The motion at some frames, without trails."""
    return replace(
        animation,
        times=np.arange(float(len(frames))),
        bodies=tuple(replace(b, positions=b.positions[frames], quaternions=b.quaternions[frames]) for b in animation.bodies),
        links=tuple(replace(k, starts=k.starts[frames], ends=k.ends[frames]) for k in animation.links),
        joints=tuple(replace(j, positions=j.positions[frames], quaternions=j.quaternions[frames]) for j in animation.joints),
        trails=(),
    )


def _limits(animation: Animation, trails: tuple[Trail, ...], view: View, thickness: float) -> tuple[float, float, float, float]:
    """Left, right, low, high [m] of what is in the picture, with a margin."""
    directions = (-view.right, view.right, -view.up, view.up)
    edges = [max([animation.reach(d, 2 * thickness), *(float(np.max(t.points @ d)) for t in trails)]) for d in directions]
    if not np.all(np.isfinite(edges)):
        return -1.0, 1.0, -1.0, 1.0
    margin = 0.04 * max(edges[0] + edges[1], edges[2] + edges[3]) or 1.0
    wide, high = edges[0] + edges[1] + 2 * margin, edges[2] + edges[3] + 2 * margin
    # neither a ribbon nor a tower
    sideways, upwards = margin + max(0.0, 0.6 * high - wide) / 2, margin + max(0.0, 0.3 * wide - high) / 2
    return -edges[0] - sideways, edges[1] + sideways, -edges[2] - upwards, edges[3] + upwards


def _add_legend(axes: Any, animation: Animation) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(color=c, label=plain(body.name)) for body, c in zip(animation.bodies, animation.colours(), strict=True)]
    axes.legend(handles=handles, frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _unit(size: float) -> tuple[str, float]:
    """Unit of length that keeps the numbers along a picture of `size` [m] short, and its value [m]."""
    return ("mm", 1e-3) if size < 0.3 else ("m", 1.0) if size < 5e3 else ("km", 1e3)


def _draw_frame(canvas: _Canvas, frame: int, strength: float, layer: float) -> None:
    """Everything at one instant; what is nearer to the viewer is drawn later."""
    animation, towards, colours = canvas.animation, canvas.view.towards, canvas.animation.colours()
    depths = {(i, k): _depth(b, s, frame, towards) for i, b in enumerate(animation.bodies) for k, s in enumerate(b.shapes)}
    order = sorted(depths, key=lambda key: depths[key])
    height = {key: layer + 5 * rank / len(order) for rank, key in enumerate(order)}
    for i, k in order:
        body = animation.bodies[i]
        colour = body.shapes[k].colour or colours[i]
        _draw_shape(canvas, body, body.shapes[k], frame, colour=colour, strength=strength, height=height[i, k])
    for link in animation.links:
        _draw_link(canvas, link, frame, strength, layer + 6)
    if animation.joints:
        places = canvas.flat(np.stack([joint.positions[frame] for joint in animation.joints]))
        size = 5 if len(animation.joints) < 30 else 3
        axes = canvas.axes
        axes.plot(
            places[:, 0],
            places[:, 1],
            "o",
            markersize=size,
            markerfacecolor="white",
            markeredgecolor="#3d4957",
            alpha=strength,
            zorder=layer + 7,
        )


def _depth(body: MovingBody, shape: Shape, frame: int, towards: np.ndarray) -> float:
    """How near to the viewer the middle of a shape is [m]; planes are behind all."""
    if isinstance(shape, Plane):
        return -np.inf
    seen = turned_back(body.quaternions[frame : frame + 1], towards)
    middle = (support_points(shape, seen) + support_points(shape, -seen)) / 2
    return float((body.positions[frame] + rotated(body.quaternions[frame : frame + 1], middle)[0]) @ towards)


def _draw_shape(
    canvas: _Canvas, body: MovingBody, shape: Shape, frame: int, *, colour: str, strength: float, height: float
) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    def placed(points: np.ndarray) -> np.ndarray:
        return canvas.flat(
            body.positions[frame] + rotated(np.repeat(body.quaternions[frame : frame + 1], len(points), axis=0), points)
        )

    if isinstance(shape, Wire):
        line = placed(np.array(shape.position) + np.array(shape.points) @ np.array(shape.rotation).T)
        canvas.axes.plot(line[:, 0], line[:, 1], color=colour, linewidth=1.6, alpha=strength, zorder=height)
        return
    angle = np.linspace(0, 2 * np.pi, 97)[:, None]
    seen = turned_back(
        np.repeat(body.quaternions[frame : frame + 1], 97, axis=0),
        np.cos(angle) * canvas.view.right + np.sin(angle) * canvas.view.up,
    )
    rings = [placed(ring) for ring in _outlines(shape, seen, canvas)]
    opacity = 0.25 if isinstance(shape, Plane) else 0.55 if isinstance(shape, Polygon) else 0.85
    path = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
    canvas.axes.add_patch(
        PathPatch(path, facecolor=colour, edgecolor="#1d2733", linewidth=0.7, alpha=opacity * strength, zorder=height)
    )
    towards = turned_back(body.quaternions[frame : frame + 1], canvas.view.towards)[0]
    for inner in _inner_lines(shape, np.array(shape.rotation).T @ towards):
        line = placed(np.array(shape.position) + inner @ np.array(shape.rotation).T)
        canvas.axes.plot(line[:, 0], line[:, 1], color="#1d2733", linewidth=0.7, alpha=0.7 * strength, zorder=height + 1e-3)


def _outlines(shape: Shape, seen: np.ndarray, canvas: _Canvas) -> list[np.ndarray]:
    """Closed curves (k, 3) in the body's frame that bound what is seen along directions (k, 3) around the picture; a ring has two."""
    match shape:
        case Torus():
            outer = support_points(shape, seen)
            unit = seen / np.linalg.norm(seen, axis=1, keepdims=True)
            face_on = abs(float(np.cross(unit[0], unit[len(unit) // 4]) @ np.array(shape.rotation) @ np.array(shape.axis)))
            face_on /= float(np.linalg.norm(shape.axis))
            # the hole is seen as long as the circle's image bends less than the tube is thick
            inner = outer - 2 * shape.tube * unit
            return [outer, inner[::-1]] if shape.radius * face_on**2 > shape.tube else [outer]
        case Arrow():
            return arrow_points(shape, seen, canvas.thickness)
        case PointMass() | Rod() | Polygon():
            return [support_points(shape, seen, canvas.thickness)]
        case _:
            return [support_points(shape, seen)]


def _inner_lines(shape: Shape, towards: np.ndarray) -> list[np.ndarray]:
    """Lines (k, 3), in the shape's frame, on the side that faces the viewer: edges of a box, rims, and a disk's spoke."""
    if isinstance(shape, Box):
        nearest = np.where(towards >= 0, 0.5, -0.5) * np.array(shape.size)
        return [np.stack([nearest, nearest * (1 - 2 * e)]) for e in np.eye(3)]
    if not isinstance(shape, Cylinder | Disk):
        return []
    axis = np.array(shape.axis) / np.linalg.norm(shape.axis)
    facing = float(axis @ towards)
    if abs(facing) < 0.02:
        return []
    u, v = across(axis)
    angle = np.linspace(0, 2 * np.pi, 73)[:, None]
    height = (shape.length if isinstance(shape, Cylinder) else shape.thickness) / 2
    face = np.sign(facing) * height * axis
    rim = face + shape.radius * (np.cos(angle) * u + np.sin(angle) * v)
    return [rim, face + 0.85 * shape.radius * np.stack([-u, u])] if isinstance(shape, Disk) else [rim]


def _draw_link(canvas: _Canvas, link: MovingLink, frame: int, strength: float, height: float) -> None:
    ends = canvas.flat(np.stack([link.starts[frame], link.ends[frame]]))
    colour = _LINK_COLOURS[link.kind]
    if link.kind == "force" and np.array_equal(ends[0], ends[1]):
        return
    if link.kind == "force":
        canvas.axes.annotate("", ends[1], ends[0], arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "alpha": strength, "shrinkA": 0, "shrinkB": 0}, zorder=height)  # fmt: skip
        return
    if link.kind == "cone":
        outline = _cone(canvas, link.starts[frame], link.ends[frame], link.slope)
        canvas.axes.fill(outline[:, 0], outline[:, 1], color=colour, alpha=0.3 * strength, linewidth=0.8, zorder=height)
        return
    if link.kind == "damper":
        # the cylinder; the piston rod comes out of it
        cylinder = ends[0] + np.array([[0.0], [0.5]]) * (ends[1] - ends[0])
        canvas.axes.plot(cylinder[:, 0], cylinder[:, 1], color=colour, linewidth=5, alpha=0.7 * strength, solid_capstyle="butt", zorder=height)  # fmt: skip
    line = _zigzag(ends, 2.0 * canvas.thickness) if link.kind == "spring" else ends
    width = {"spring": 1.1, "damper": 1.4, "string": 0.9}[link.kind]
    canvas.axes.plot(line[:, 0], line[:, 1], color=colour, linewidth=width, alpha=strength, zorder=height)


def _cone(canvas: _Canvas, tip: np.ndarray, middle: np.ndarray, slope: float) -> np.ndarray:
    """Outline (k, 2) in the picture of a cone from its tip to the middle of its base (3,)."""
    axis = middle - tip
    length = float(np.linalg.norm(axis))
    if length == 0:
        return canvas.flat(tip[None, :])
    u, v = across(axis / length)
    angle = np.linspace(0, 2 * np.pi, 49)[:-1, None]
    rim = canvas.flat(middle + slope * length * (np.cos(angle) * u + np.sin(angle) * v))
    points = np.vstack([canvas.flat(tip[None, :]), rim])
    return points[_around(points)]


def _around(points: np.ndarray) -> list[int]:
    """Numbers of points (n, 2) on the line around all of them, in order (Andrew's monotone chain)."""
    order = np.lexsort(points.T[::-1])
    halves: list[list[int]] = []
    for numbers in (order, order[::-1]):
        chain: list[int] = []
        for k in map(int, numbers):
            while len(chain) > 1:
                (ax, ay), (bx, by) = points[chain[-1]] - points[chain[-2]], points[k] - points[chain[-1]]
                if ax * by - ay * bx > 0:
                    break
                chain.pop()
            chain.append(k)
        halves.append(chain[:-1])
    return halves[0] + halves[1]


def _zigzag(ends: np.ndarray, width: float) -> np.ndarray:
    """Line (k, 2) between two points of the picture."""
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if length == 0:
        return ends
    across = np.array([-along[1], along[0]]) / length
    s = np.concatenate([[0.0], np.linspace(0.12, 0.88, 18), [1.0]])
    swing = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], 8), [0.0, 0.0]]) * min(width, 0.15 * length)
    return ends[0] + s[:, None] * along + swing[:, None] * across
