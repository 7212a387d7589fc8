"""What surfaces are drawn as: a net of lines along their coordinates, or of cuts by planes; a plane as a patch."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np

from acausal.visual import shapes
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
_CELLS = 36
"""Squares across a box in which a surface is cut."""


def net(surface: AbstractSurface, places: np.ndarray, colour: str | None = PLANE_COLOUR) -> tuple[Any, ...]:
    """Lines on a surface of plain numbers about where it is nearest to `places` (n, 3) [m]: all of it where its coordinates end; cuts of it, where it has no two
    coordinates but a clearance; of a plane a patch.
    """
    if isinstance(surface, Plane):
        return _patch(places)
    chart = surface.chart()
    if chart is None:
        return _cuts(surface, places, colour)
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


def _patch(places: np.ndarray) -> tuple[Any, ...]:
    """Of z = 0, under all `places`; nothing where these are one point of it."""
    low, high = places.min(axis=0), places.max(axis=0)
    reach = max(_MARGIN * float(np.linalg.norm(high - low)), _AROUND * float(np.abs(places[:, 2]).max()))
    middle = 0.5 * (low + high)
    size = float(np.max((high - low)[:2])) + 2 * reach
    return (shapes.Plane((0.0, 0.0, 1.0), (float(middle[0]), float(middle[1]), 0.0), size),) if size > 0 else ()


def _cuts(surface: AbstractSurface, places: np.ndarray, colour: str | None) -> tuple[Any, ...]:
    """Lines where planes across x, y and z cut a surface, in a box about `places`."""
    p = ca.SX.sym("p", 3)
    found = surface.clearance(p)
    rows = [] if found is None else [ca.densify(row) for row in found]
    if not rows or len(ca.symvar(ca.vertcat(p, *rows))) > p.numel():
        return ()
    off = ca.Function("off", [p], rows)

    def at(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, normals = (np.array(part) for part in off.map(len(points))(points.T))
        return values[0], normals.T

    low, high = places.min(axis=0), places.max(axis=0)
    reach = max(_MARGIN * float(np.linalg.norm(high - low)), _AROUND * float(np.max(np.abs(at(places)[0]))))
    if not reach > 0:
        return ()
    axes = np.linspace(low - reach, high + reach, _CELLS + 1)
    grid = np.stack(np.meshgrid(*axes.T, indexing="ij"), axis=-1)
    values = at(grid.reshape(-1, 3))[0].reshape(grid.shape[:3])
    wires: list[Wire] = []
    for across, k in itertools.product(range(3), range(0, _CELLS + 1, _CELLS // (_LINES - 1))):
        for line in zero_lines(np.take(values, k, axis=across)):
            points = np.insert(line, across, k, axis=1) / _CELLS * (axes[-1] - axes[0]) + axes[0]
            for _ in range(_STEPS):  # onto the surface
                value, normal = at(points)
                points = points - value[:, None] * normal
            good = np.isfinite(points).all() and (np.abs(points - (low + high) / 2) <= (high - low) / 2 + 2 * reach).all()
            if good:
                wires.append(Wire(tuple((float(x), float(y), float(z)) for x, y, z in points), colour=colour))
    return tuple(wires)


def zero_lines(values: np.ndarray) -> Iterator[np.ndarray]:
    """Where values at the corners of a grid of squares (n, m) are zero, linear between corners: lines (k, 2) in numbers of squares from the first corner."""
    import networkx as nx

    places: dict[tuple[int, int, int], tuple[float, float]] = {}
    cells: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
    for along, (first, second) in enumerate(((values[:-1], values[1:]), (values[:, :-1], values[:, 1:]))):
        for i, j in np.argwhere((first < 0) != (second < 0)).tolist():
            part, edge = float(first[i, j] / (first[i, j] - second[i, j])), (along, i, j)
            places[edge] = (i + part, float(j)) if along == 0 else (float(i), j + part)
            for cell in ((i, j), (i - along, j - 1 + along)):
                cells.setdefault(cell, []).append(edge)
    lines = nx.Graph()
    for met in cells.values():
        lines.add_edges_from(zip(met[::2], met[1::2], strict=False))  # cells beside the grid have one
    for some in nx.connected_components(lines):
        ends = [edge for edge in some if lines.degree[edge] == 1]
        order = list(nx.dfs_preorder_nodes(lines, ends[0] if ends else next(iter(some))))
        yield np.array([places[edge] for edge in (order if ends else [*order, order[0]])])
