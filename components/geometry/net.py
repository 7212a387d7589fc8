"""What surfaces are drawn as: a net of lines along their coordinates."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from acausal.visual.shapes import PLANE_COLOUR, Wire
from components.geometry.surfaces import TURN, AbstractSurface, Plane

_LINES, _PIECES = 13, 48
"""Across each coordinate, and straight pieces of each."""
_LOOKS, _STEPS = 60, 20
"""Places that are looked at, and steps to the nearest point of the surface for each."""
_MARGIN = 0.35
"""Of how far a motion comes: how far the net goes on."""
_AROUND = 1.5
"""The same of the distance from the surface."""


def net(surface: AbstractSurface, places: np.ndarray, colour: str | None = PLANE_COLOUR) -> tuple[Any, ...]:
    """Lines on a surface of plain numbers about where it is nearest to `places` (n, 3) [m]: all of it where its coordinates end. Nothing for a plane, for
    which there is the floor, and where it has no two coordinates.
    """
    chart = surface.chart()
    if chart is None or isinstance(surface, Plane):
        return ()
    q = ca.SX.sym("q", 2)
    point = chart.point(q)
    rows = [ca.densify(point), ca.densify(ca.jacobian(point, q)), ca.densify(ca.vertcat(1, chart.inside(q)))]
    if any(
        not ca.is_equal(symbol, q[0]) and not ca.is_equal(symbol, q[1]) for symbol in ca.symvar(ca.vertcat(*map(ca.vec, rows)))
    ):
        return ()
    of = ca.Function("surface", [q], rows)
    low, high = np.array(chart.limits, dtype=float).T
    found, away = [], 0.0
    closed = np.array([limits == TURN for limits in chart.limits])
    lowest, highest = np.where(closed, -np.inf, low), np.where(closed, np.inf, high)
    at = np.array(chart.start, dtype=float)
    for place in places[:: max(1, len(places) // _LOOKS)]:
        for _ in range(_STEPS):
            p, J, _ = (np.array(part) for part in of(at))
            if not (np.isfinite(p).all() and np.isfinite(J).all()):
                return ()
            at = np.clip(at + np.linalg.lstsq(J, place - p.ravel(), rcond=1e-6)[0], lowest, highest)
        p, J, _ = (np.array(part) for part in of(at))
        found.append(at)
        away = max(away, float(np.linalg.norm(place - p.ravel())))
    first, last = np.min(found, axis=0), np.max(found, axis=0)
    size = np.linalg.norm(np.array(of((first + last) / 2)[1]), axis=0)
    reach = max(_MARGIN * float(np.linalg.norm(np.ptp(places, axis=0))), _AROUND * away)
    if not reach > 0 and not np.isfinite([low, high]).all():
        return ()
    margin = reach / np.where(size > 0, size, 1.0)
    first, last = np.where(np.isfinite(low), low, first - margin), np.where(np.isfinite(high), high, last + margin)
    if not np.isfinite([first, last]).all():
        return ()
    wires: list[Wire] = []
    for k in (0, 1):
        along = np.linspace(first[1 - k], last[1 - k], _PIECES + 1)
        for value in np.linspace(first[k], last[k], _LINES):
            line = np.empty((2, along.size))
            line[k], line[1 - k] = value, along
            p, _, inside = (np.array(part) for part in of.map(along.size)(line))
            good = np.isfinite(p).all(axis=0) & (inside.reshape(-1, along.size).min(axis=0) >= -1e-9)
            for run in np.split(np.arange(along.size), np.flatnonzero(np.diff(good)) + 1):
                if good[run[0]] and run.size > 1:
                    wires.append(Wire(tuple((float(x), float(y), float(z)) for x, y, z in p[:, run].T), colour=colour))
    return tuple(wires)
