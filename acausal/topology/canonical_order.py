"""The order of rigid groups and joints: by what they are and where they sit, so that the order of declaration decides nothing.

Colour refinement (Weisfeiler and Leman 1968): groups and joints are told apart by their own measures, then by what they are connected to,
and so on until nothing new is told. Joints that are still alike are told apart by their places in the sketch, and where these are
alike, too, by names: one of them is put first, and refined again. Measures within a rigid group and distances in the sketch do not change
when the scene is moved or turned, and all of them only as a whole when it is drawn in other units.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose
from acausal.topology.mechanism import Edge, Group

_SAME = 1e-6
"""Lengths on one group, as parts of the largest, that differ by less are the same."""
_DIGITS = 2.0**20
_NAMED = 64
"""So often joints are told apart by name and then refined; after that by name alone."""

Joint = Edge[AbstractConstraint]
Key = tuple[float, ...]
Name = list[tuple[bool, str | int]]


@dataclass(frozen=True)
class Order:
    """Ranks of groups and of edges, all different: the ground's is 0."""

    groups: tuple[int, ...]
    edges: tuple[int, ...]


def canonical_order(groups: Sequence[Group], edges: Sequence[Joint], gravity: np.ndarray | None = None) -> Order:
    """Ranks that neither the order of the edges nor that of the groups has to do with.

    Cost: quadratic in the joints of one group, n log n in their number for each link between those that are alike.
    """
    names = [natural(edge.name) for edge in edges]
    of_groups = _ranks(_group_keys(groups, edges))
    around = _around(groups, edges)
    of_edges = _ranks([_edge_key(i, edge, groups, around) for i, edge in enumerate(edges)])
    of_groups, of_edges = _refined(edges, of_groups, of_edges)
    for places in _places(groups, edges, gravity) if len(set(of_edges)) < len(edges) else ():
        of_edges = _ranks(list(zip(of_edges, places, strict=True)))
        of_groups, of_edges = _refined(edges, of_groups, of_edges)
    for _ in range(_NAMED):
        alike = _first_alike(of_edges)
        if not alike:
            break
        chosen = min(alike, key=names.__getitem__)
        of_edges = _ranks([(rank, i != chosen) for i, rank in enumerate(of_edges)])
        of_groups, of_edges = _refined(edges, of_groups, of_edges)
    of_edges = _ranks(list(zip(of_edges, names, strict=True)))
    of_groups = _ranks([(rank, natural(group.name), k) for k, (rank, group) in enumerate(zip(of_groups, groups, strict=True))])
    return Order(tuple(of_groups), tuple(of_edges))


def natural(name: str) -> Name:
    """A key in which numbers in a name count as numbers."""
    return [(True, int(part)) if part.isdecimal() else (False, part) for part in re.split(r"(\d+)", name)]


def rounded(values: np.ndarray | float) -> np.ndarray:
    """To six digits each, in a way that powers of two have no influence on."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.round(mantissa * _DIGITS) / _DIGITS, exponent)


def on_grid(places: np.ndarray, far: float) -> np.ndarray:
    """Places to six digits of the farthest distance, in a way that powers of two have no influence on."""
    step = 2.0 ** np.ceil(np.log2(far)) / _DIGITS if far > 0 else 1.0
    return np.round(places / step) * step + 0.0  # no -0


def _ranks(keys: Sequence[Any]) -> list[int]:
    """Numbers in the order of the keys, the same for the same ones."""
    order = sorted(range(len(keys)), key=keys.__getitem__)
    ranks, rank = [0] * len(keys), -1
    for k, i in enumerate(order):
        rank += k == 0 or keys[i] != keys[order[k - 1]]
        ranks[i] = rank
    return ranks


def _refined(edges: Sequence[Joint], of_groups: list[int], of_edges: list[int]) -> tuple[list[int], list[int]]:
    """Told apart by what is connected to what, until that tells nothing new."""
    while True:
        at: list[list[int]] = [[] for _ in of_groups]
        for rank, edge in zip(of_edges, edges, strict=True):
            at[edge.a].append(rank)
            at[edge.b].append(rank)
        groups = _ranks([(rank, sorted(own)) for rank, own in zip(of_groups, at, strict=True)])
        ends = [sorted((groups[edge.a], groups[edge.b])) for edge in edges]
        found = _ranks(list(zip(of_edges, ends, strict=True)))
        told = len(set(found)) > len(set(of_edges)) or len(set(groups)) > len(set(of_groups))
        of_groups, of_edges = groups, found
        if not told:
            return of_groups, of_edges


def _first_alike(ranks: Sequence[int]) -> list[int]:
    """Places of the lowest rank that several have."""
    at: dict[int, list[int]] = {}
    for i, rank in enumerate(ranks):
        at.setdefault(rank, []).append(i)
    return next((at[rank] for rank in sorted(at) if len(at[rank]) > 1), [])


def _group_keys(groups: Sequence[Group], edges: Sequence[Joint]) -> list[tuple[float, str, float]]:
    """Distance from the ground in joints, kind, mass."""
    beside: list[list[int]] = [[] for _ in groups]
    for edge in edges:
        beside[edge.a].append(edge.b)
        beside[edge.b].append(edge.a)
    depth = [0.0] + [np.inf] * (len(groups) - 1)
    reached = [0]
    for group in reached:  # grows on the way
        for other in beside[group]:
            if depth[other] == np.inf:
                depth[other] = depth[group] + 1
                reached.append(other)
    return [(far, group.kind, _mass(group)) for far, group in zip(depth, groups, strict=True)]


def _mass(group: Group) -> float:
    return float(rounded(group.inertia.mass)) if isinstance(group.inertia.mass, float) else 0.0


def _edge_key(
    i: int, edge: Joint, groups: Sequence[Group], around: Sequence[Mapping[int, Key]]
) -> tuple[bool, str, list[tuple[Key, float]]]:
    ends = sorted((around[group].get(i, ()), _mass(groups[group])) for group in (edge.a, edge.b))
    return edge.implicit, type(edge.joint).__name__, ends


def _around(groups: Sequence[Group], edges: Sequence[Joint]) -> list[dict[int, Key]]:
    """For each group and each edge that ends on it the distances of its end from all others there, in order; those at the same place last."""
    ends: list[list[tuple[int, np.ndarray]]] = [[] for _ in groups]
    for i, edge in enumerate(edges):
        for group, pose in ((edge.a, edge.pose_a), (edge.b, edge.pose_b)):
            if isinstance(pose.position, np.ndarray):
                ends[group].append((i, np.asarray(pose.position, dtype=float)))
    return [_distances(end) for end in ends]


def _distances(ends: Sequence[tuple[int, np.ndarray]]) -> dict[int, Key]:
    places = np.array([place for _, place in ends]).reshape(-1, 3)
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    apart[apart <= _SAME * np.max(apart, initial=0.0)] = np.inf
    return {i: tuple(row) for (i, _), row in zip(ends, np.sort(rounded(apart), axis=1).tolist(), strict=True)}


def _places(groups: Sequence[Group], edges: Sequence[Joint], gravity: np.ndarray | None) -> Iterable[list[Any]]:
    """Keys of edges by where their ends are drawn in the world: distances from all other ends, then heights."""
    drawn = [np.full((2, 3), np.nan) for _ in edges]
    for i, edge in enumerate(edges):
        for k, (group, pose) in enumerate(((edge.a, edge.pose_a), (edge.b, edge.pose_b))):
            base = Pose.identity() if group == 0 else groups[group].sketch
            if base is not None and isinstance(pose.position, np.ndarray):
                place = (base @ pose).position
                drawn[i][k] = place if isinstance(place, np.ndarray) else np.nan
    all = np.array(drawn).reshape(-1, 3)
    known = all[~np.isnan(all[:, 0])]
    yield [_far(own, known) for own in drawn]
    if isinstance(gravity, np.ndarray) and gravity.dtype == float and np.any(gravity):
        heights = (all - np.mean(known, axis=0)) @ (gravity / np.linalg.norm(gravity)) if known.size else np.zeros(len(all))
        far = float(np.max(np.abs(known - np.mean(known, axis=0)), initial=0.0)) if known.size else 0.0
        yield [sorted(pair) for pair in on_grid(np.nan_to_num(heights), far).reshape(-1, 2).tolist()]


def _far(own: np.ndarray, all: np.ndarray) -> list[Key]:
    """Sums of distances of the ends of one edge from all ends, to the first, second and third power."""
    ends = own[~np.isnan(own[:, 0])]
    apart = [np.linalg.norm(all - end, axis=1) for end in ends]
    return sorted(tuple(rounded(np.array([np.sum(d**k) for k in (1, 2, 3)])).tolist()) for d in apart)
