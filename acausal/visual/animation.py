"""A motion as plain data: what is drawn, and where everything is at every instant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from acausal.arguments import path_of
from acausal.errors import OptionError
from acausal.visual.geometry import rotated, support_points, turned_back
from acausal.visual.shapes import PLANE_COLOUR, Arrow, Plane, Polygon, Rod, Shape, Vector, Wire

PALETTE = ("#4C78A8", "#F58518", "#54A24B", "#E45756", "#72B7B2", "#B279A2", "#EECA3B", "#9D755D", "#5F9ED1", "#FF9DA6")
LINK_KINDS = ("spring", "damper", "force", "string", "cone")


@dataclass(frozen=True)
class MovingBody:
    """`shapes` in a frame with `positions` (n, 3) [m] and `quaternions` (n, 4), scalar first, in the world."""

    name: str
    shapes: tuple[Shape, ...]
    positions: np.ndarray
    quaternions: np.ndarray


@dataclass(frozen=True)
class MovingLink:
    """From `starts` to `ends`, (n, 3) [m] each: kind 'spring' (a coil), 'damper', 'force' (an arrow), 'string', or 'cone' (of friction: from its tip to
    the middle of its base, which is `slope` times as wide as it is high).
    """

    name: str
    kind: str
    starts: np.ndarray
    ends: np.ndarray
    slope: float = 0.0


@dataclass(frozen=True)
class JointMarker:
    """A joint at `positions` (n, 3) [m], turned by `quaternions` (n, 4); `axis` (3,) is in its own frame.

    Kind 'hinge', 'slider', 'ball', or anything else.
    """

    name: str
    kind: str
    positions: np.ndarray
    quaternions: np.ndarray
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Trail:
    """The path (n, 3) [m] of a point; in the colour of the body of the same name, if there is one."""

    name: str
    points: np.ndarray


@dataclass(frozen=True)
class Animation:
    """Everything that is drawn, at `times` (n,) [s], increasing. `up`: against gravity. `speed`: shown against real time.

    Raises `OptionError` if an array does not have n rows, or is not finite.
    """

    title: str
    times: np.ndarray
    bodies: tuple[MovingBody, ...]
    links: tuple[MovingLink, ...] = ()
    joints: tuple[JointMarker, ...] = ()
    trails: tuple[Trail, ...] = ()
    up: Vector = (0.0, 0.0, 1.0)
    speed: float = 1.0

    def __post_init__(self) -> None:
        n = len(self.times)
        _check("times", self.times, (n,))
        if n == 0 or np.any(np.diff(self.times) < 0):
            raise OptionError(
                f"The times of animation '{self.title}' must increase; there are {n}. Give one time per frame, in order."
            )
        if not np.linalg.norm(self.up) > 0:
            raise OptionError(f"The up direction of animation '{self.title}' is {self.up}. Give a vector that is not zero.")
        if not 0 < self.speed < np.inf:
            raise OptionError(
                f"The speed of animation '{self.title}' is {self.speed}. Give shown seconds per second, above zero."
            )
        for body in self.bodies:
            _check(f"positions of body '{body.name}'", body.positions, (n, 3))
            _check(f"quaternions of body '{body.name}'", body.quaternions, (n, 4))
        for joint in self.joints:
            _check(f"positions of joint '{joint.name}'", joint.positions, (n, 3))
            _check(f"quaternions of joint '{joint.name}'", joint.quaternions, (n, 4))
        for link in self.links:
            _check(f"starts of link '{link.name}'", link.starts, (n, 3))
            _check(f"ends of link '{link.name}'", link.ends, (n, 3))
            if link.kind not in LINK_KINDS:
                raise OptionError(f"Link '{link.name}' is of kind '{link.kind}'. Choose one of {', '.join(LINK_KINDS)}.")
        for trail in self.trails:
            _check(f"points of trail '{trail.name}'", trail.points, (n, 3))

    def colours(self) -> tuple[str, ...]:
        """Of each body: its first shape's own colour, else a plane's grey, else the palette's next, as if planes were not there."""
        chosen: list[str] = []
        used = 0
        for body in self.bodies:
            own = [shape.colour for shape in body.shapes if shape.colour]
            flat = bool(body.shapes) and all(isinstance(shape, Plane) for shape in body.shapes)
            chosen.append(own[0] if own else PLANE_COLOUR if flat else PALETTE[used % len(PALETTE)])
            used += not flat
        return tuple(chosen)

    def reach(self, direction: np.ndarray, thickness: float = 0.0) -> float:
        """Largest coordinate [m] along a unit vector (3,) over the whole motion; planes count only where there is nothing else.

        `thickness` [m] is the radius of what has none of its own. -inf if the scene is empty.
        """
        paths = [p for link in self.links for p in (link.starts, link.ends)] + [j.positions for j in self.joints]
        paths += [b.positions for b in self.bodies if not b.shapes] + [t.points for t in self.trails]
        solid = [(b, s) for b in self.bodies for s in b.shapes if not isinstance(s, Plane)]
        if not paths and not solid:
            solid = [(b, s) for b in self.bodies for s in b.shapes]
        return max(
            [float(np.max(p @ direction)) for p in paths] + [_reach(b, s, direction, thickness) for b, s in solid],
            default=-np.inf,
        )

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (3,), (3,) [m] of a box around the whole motion."""
        low, high = -np.array([self.reach(-e) for e in np.eye(3)]), np.array([self.reach(e) for e in np.eye(3)])
        return (low, high) if np.all(np.isfinite(high)) else (np.full(3, -1.0), np.full(3, 1.0))

    def size(self) -> float:
        """Diagonal of the bounds [m]; 1 where that is zero."""
        low, high = self.bounds()
        diagonal = float(np.linalg.norm(high - low))
        return diagonal if diagonal > 0 else 1.0

    def thickness(self) -> float:
        """Radius [m] of a bar that suits the scene: a part of its size, less where its parts lie closer together."""
        size = self.size()
        anchors = [j.positions[0] for j in self.joints]
        for body in self.bodies:
            ends = [np.array(p) for s in body.shapes for p in _places(s)]
            anchors += [body.positions[0] + rotated(body.quaternions[:1], p)[0] for p in ends]
        if len(anchors) < 2:
            return 0.010 * size
        points = np.array(anchors[:400])
        distances = np.linalg.norm(points[:, None] - points[None], axis=2)
        distances[distances < 1e-3 * size] = np.inf
        nearest = distances.min(axis=1)
        near = nearest[np.isfinite(nearest)]
        return 0.010 * size if near.size == 0 else float(np.clip(0.14 * np.median(near), 0.002 * size, 0.010 * size))

    def floor(self) -> float:
        """Height [m] along `up` of the lowest point of the whole motion, planes included as far as they are drawn."""
        down = -np.array(self.up) / np.linalg.norm(self.up)
        planes = [
            _reach(b, replace(s, size=self.drawn_size(s)), down, 0.0)
            for b in self.bodies
            for s in b.shapes
            if isinstance(s, Plane)
        ]
        lowest = max([self.reach(down, self.thickness()), *planes])
        return -lowest if np.isfinite(lowest) else -1.0

    def drawn_size(self, plane: Plane) -> float:
        """Edge [m] of a plane as drawn: not much larger than the rest."""
        return min(plane.size, 4 * self.size())


def _reach(body: MovingBody, shape: Shape, direction: np.ndarray, thickness: float) -> float:
    seen = turned_back(body.quaternions, direction)
    extent = np.sum(seen * support_points(shape, seen, thickness), axis=1)
    return float(np.max(body.positions @ direction + extent))


def write_html(animation: Animation, path: str | Path) -> Path:
    """Write one page that needs no network: three.js, the viewer and the motion inside. Returns the path.

    Raises `OptionError` for a name that promises something else, such as a film.
    """
    from acausal.visual.page import page

    target = path_of(path, "animate: the page")
    check_ending(target, ("", ".html", ".htm"), "a page for a browser", "motion.html")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(page(animation), encoding="utf-8")
    return target


def check_ending(path: Path, endings: tuple[str, ...], kind: str, example: str) -> None:
    """Raises `OptionError` for a file name that promises another kind of file than what is written."""
    if path.suffix.lower() not in endings:
        raise OptionError(
            f"'{path.name}' ends with '{path.suffix}', but what is written is {kind}. Give a name like '{example}'."
        )


def _places(shape: Shape) -> tuple[Vector, ...]:
    match shape:
        case Rod() | Arrow():
            return (shape.start, shape.end)
        case Polygon() | Wire():
            return shape.points
        case Plane():
            return ()
        case _:
            return (shape.position,)


def _check(what: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise OptionError(f"The {what} have shape {array.shape}; expected {shape}: one row per time.")
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        raise OptionError(f"The {what} are not finite from frame {bad[0][0]} on. Cut the motion before that instant.")
