"""The order of joints: by what they are and where they sit on their bodies, so that the order of declaration decides nothing.

Names decide only between joints that nothing else tells apart. All measures are those within a rigid group: they do not change when
the scene is moved or turned, and only as a whole when it is drawn in other units.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from acausal.parts.joint import AbstractJoint
from acausal.topology.mechanism import Edge, Group

_SAME = 1e-6
"""Lengths on one group, as parts of the largest, that differ by less are the same."""
_DIGITS = 2.0**20

Joint = Edge[AbstractJoint]
Key = tuple[float, ...]


def in_order(groups: Sequence[Group], edges: Sequence[Joint]) -> list[Joint]:
    """The edges in an order that neither their own nor that of the groups has to do with. Cost: quadratic in the joints of one group."""
    ends: list[list[tuple[int, np.ndarray]]] = [[] for _ in groups]
    for i, edge in enumerate(edges):
        for group, pose in ((edge.a, edge.pose_a), (edge.b, edge.pose_b)):
            if isinstance(pose.position, np.ndarray):
                ends[group].append((i, np.asarray(pose.position, dtype=float)))
    around: list[dict[int, Key]] = [_distances(end) for end in ends]

    def key(i: int) -> tuple[bool, str, list[tuple[Key, float]], list[tuple[bool, str | int]]]:
        edge = edges[i]
        places = sorted((around[group].get(i, ()), _rounded(_mass(groups[group]))) for group in (edge.a, edge.b))
        return edge.implicit, type(edge.joint).__name__, places, _natural(edge.name)

    return [edges[i] for i in sorted(range(len(edges)), key=key)]


def _distances(ends: Sequence[tuple[int, np.ndarray]]) -> dict[int, Key]:
    """For each edge that ends on a group the distances of its end from all others there, in order; those at the same place last."""
    places = np.array([place for _, place in ends]).reshape(-1, 3)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    apart[apart <= _SAME * np.max(apart, initial=0.0)] = np.inf
    return {i: tuple(sorted(_rounded(float(d)) for d in row)) for (i, _), row in zip(ends, apart, strict=True)}


def _rounded(value: float) -> float:
    """To six digits, in a way that powers of two have no influence on."""
    mantissa, exponent = np.frexp(value)
    return float(np.ldexp(np.round(mantissa * _DIGITS) / _DIGITS, exponent))


def _mass(group: Group) -> float:
    return group.inertia.mass if isinstance(group.inertia.mass, float) else 0.0


def _natural(name: str) -> list[tuple[bool, str | int]]:
    """Numbers in a name count as numbers."""
    return [(True, int(part)) if part.isdigit() else (False, part) for part in re.split(r"(\d+)", name)]
