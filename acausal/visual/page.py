"""The page that plays a motion: template, three.js, viewer and data in one text."""

from __future__ import annotations

import base64
import html
import json
import re
from importlib import resources
from typing import Any

import numpy as np

from acausal.visual.animation import Animation, MovingBody
from acausal.visual.geometry import rotated
from acausal.visual.shapes import Plane, Shape
from acausal.visual.view import view_of


def page(animation: Animation) -> str:
    """HTML that loads nothing: a content policy in it forbids the browser to."""
    files = resources.files("acausal.visual")

    def script(name: str) -> str:
        return files.joinpath(name).read_text(encoding="utf-8").replace("</script", "<\\/script")

    parts = {
        "<!--TITLE-->": html.escape(animation.title),
        "/*THREE*/": script("three.bundle.min.js"),
        "/*SOLIDS*/": script("solids.js"),
        "/*VIEWER*/": script("viewer.js"),
        "/*DATA*/null": json.dumps(page_data(animation), separators=(",", ":"), default=_plain).replace("<", "\\u003c"),
    }
    template = files.joinpath("viewer.html").read_text(encoding="utf-8")
    # one pass, so that a title that looks like a mark stays a title
    return re.sub("|".join(re.escape(mark) for mark in parts), lambda found: parts[found[0]], template)


def page_data(animation: Animation) -> dict[str, Any]:
    """What `viewer.js` reads: numbers per frame as base64 of little-endian float32, everything else as JSON."""
    low, high = animation.bounds()
    view = view_of(animation)
    thickness = animation.thickness()
    # a box around the motion, with the view's axes: the camera is fitted to it
    axes = np.stack([view.right, view.up, view.towards])
    high_seen = np.array([animation.reach(axis, thickness) for axis in axes])
    low_seen = -np.array([animation.reach(-axis, thickness) for axis in axes])
    empty = not np.all(np.isfinite(high_seen))
    return {
        "title": animation.title,
        "speed": animation.speed,
        "times": packed(animation.times),
        "up": (np.array(animation.up) / np.linalg.norm(animation.up)).tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "size": animation.size(),
        "floor": animation.floor(),
        "thickness": thickness,
        "view": {"right": view.right.tolist(), "up": view.up.tolist(), "towards": view.towards.tolist(), "planar": view.planar,
                 "low": [-1.0] * 3 if empty else low_seen.tolist(), "high": [1.0] * 3 if empty else high_seen.tolist()},
        "bodies": [
            {"name": b.name, "colour": colour, "shapes": [_shape(s, b, animation) for s in b.shapes], "p": packed(b.positions), "q": packed(b.quaternions)}
            for b, colour in zip(animation.bodies, animation.colours(), strict=True)
        ],
        "links": [{"name": k.name, "kind": k.kind, "a": packed(k.starts), "b": packed(k.ends), "slope": k.slope} for k in animation.links],
        "joints": [
            {"name": j.name, "kind": j.kind, "axis": [float(a) for a in j.axis], "p": packed(j.positions), "q": packed(j.quaternions)}
            for j in animation.joints
        ],
        "trails": [{"name": t.name, "p": packed(t.points)} for t in animation.trails],
    }  # fmt: skip


def _shape(shape: Shape, body: MovingBody, animation: Animation) -> dict[str, Any]:
    drawn: dict[str, Any] = {}
    if isinstance(shape, Plane):
        drawn = {"size": animation.drawn_size(shape), "squares": not _is_floor(shape, body, animation)}
    return {"kind": shape.kind, **vars(shape), **drawn}


def _is_floor(plane: Plane, body: MovingBody, animation: Animation) -> bool:
    """Whether a plane lies where the page draws its ground, whose squares are seen through it."""
    up = np.array(animation.up) / np.linalg.norm(animation.up)
    R = np.array(plane.rotation)
    normal = rotated(body.quaternions[:1], R @ np.array(plane.normal) / np.linalg.norm(plane.normal))[0]
    point = body.positions[0] + rotated(body.quaternions[:1], np.array(plane.position) + R @ np.array(plane.point))[0]
    return abs(normal @ up) > 0.999 and abs(point @ up - animation.floor()) < 0.01 * animation.size()


def _plain(value: Any) -> Any:
    """A numpy number or array in a shape, for JSON."""
    return np.asarray(value, dtype=float).tolist()


def packed(array: np.ndarray) -> str:
    """Base64 of the array as little-endian float32."""
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")
