"""From where a motion is best seen: squarely if it is planar, else from in front, above and to the side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.visual.animation import Animation
from acausal.visual.geometry import across, rotated
from acausal.visual.shapes import Rod

_FLAT = 0.3  # a planar motion is seen squarely if its depth is less than this part of its size


@dataclass(frozen=True)
class View:
    """Unit vectors (3,) of the picture: `right`, `up`, and `towards` the viewer; right x up = towards."""

    right: np.ndarray
    up: np.ndarray
    towards: np.ndarray
    planar: bool


def view_of(animation: Animation) -> View:
    """The view that both the page and the picture start with."""
    up = np.array(animation.up, dtype=float) / np.linalg.norm(animation.up)
    normal = motion_normal(animation)
    if normal is None:
        side, back = across(up)
        return _facing(0.55 * side - 0.75 * back + 0.36 * up, up, planar=False)
    if abs(float(normal @ up)) > 0.9999:
        # seen from above, as on a map: the second world axis of the plane points up
        return _facing(up, np.cross(up, across(up)[0]), planar=True)
    # a tilted plane from above, else the viewer stands below the ground; an upright one with a world axis to the right
    right, height = np.cross(up, normal), float(normal @ up)
    front = height > 0 if abs(height) > 0.02 else right[np.argmax(np.abs(right))] > 0
    return _facing(normal if front else -normal, up, planar=True)


def _facing(towards: np.ndarray, up: np.ndarray, *, planar: bool) -> View:
    towards = towards / np.linalg.norm(towards)
    up = up - towards * float(up @ towards)
    up = up / np.linalg.norm(up)
    return View(np.cross(up, towards), up, towards, planar)


def motion_normal(animation: Animation) -> np.ndarray | None:
    """Unit normal (3,) across which nothing moves, about which everything turns; None if there is none or it is deep.

    The least eigenvector of the sum of displacements d d^T (scaled by the size) and turns |r|^2 - r r^T. Where that leaves a
    choice (motion along a line), the plane in which the parts lie decides.
    """
    scale = animation.size()
    paths = [b.positions for b in animation.bodies] + [j.positions for j in animation.joints]
    paths += [p for link in animation.links for p in (link.starts, link.ends)] + [t.points for t in animation.trails]
    paths += [
        b.positions + rotated(b.quaternions, np.array(s.end)) for b in animation.bodies for s in b.shapes if isinstance(s, Rod)
    ]
    if not paths:
        return None
    moved = np.zeros((3, 3))
    for path in paths:
        d = (path - path[0]) / scale
        moved += d.T @ d / len(d)
    for body in animation.bodies:
        r = _turns(body.quaternions)
        moved += (np.sum(r**2) * np.eye(3) - r.T @ r) / len(r)
    cloud = np.vstack(paths) / scale
    cloud = cloud - cloud.mean(axis=0)
    weights, axes = np.linalg.eigh(moved + 1e-6 * cloud.T @ cloud / len(cloud))
    normal = axes[:, 0]
    depth = float(np.ptp(cloud @ normal))
    still = float(normal @ moved @ normal) < 1e-8
    unique = weights[1] > 4 * weights[0] and weights[1] > 1e-10
    return normal if still and unique and depth < _FLAT else None


def _turns(q: np.ndarray) -> np.ndarray:
    """Vector parts (n, 3), in the world, of the rotations q conj(q[0])."""
    w0, u0 = q[0, 0], -q[0, 1:]
    return q[:, :1] * u0 + w0 * q[:, 1:] + np.cross(q[:, 1:], u0)
