"""The spanning tree of a mechanism: which joints carry coordinates, which close loops, and which bodies are split for it.

Kruskal's tree of least total freedom. A joint that must keep its coordinates though it closes a loop ends on a half of its body:
the body is split into two equal halves, and a weld holds them together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import casadi as ca

from acausal.graphs import Graph, least_tree
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from acausal.parts.weld import Weld
from acausal.topology.mechanism import Edge, Group, TreeEdge

Joint = Edge[AbstractJoint]


@dataclass(frozen=True)
class SpanningTree:
    """Groups (split ones in two, the second half at the end), tree edges in an order in which parents come first, cut edges."""

    groups: tuple[Group, ...]
    tree: tuple[TreeEdge, ...]
    cuts: tuple[Edge[AbstractConstraint], ...]


def spanning_tree(groups: Sequence[Group], edges: Sequence[Joint], driven: Set[AbstractJoint]) -> SpanningTree:
    """Tree and cuts of the graph with these nodes (the first is the ground) and edges; where nothing else decides, by their order.

    `driven`: joints on whose coordinates something acts: an angle known only up to full turns would not do for them.
    """
    chosen = _least_freedom(groups, edges, driven)
    split = _Split(list(groups), list(edges), [])
    for i in [i for i in range(len(edges)) if i not in chosen and _keeps_coordinates(edges[i].joint, driven)]:
        ends = sorted((edges[i].b, edges[i].a), key=lambda end: ("body", "massless", "ground", "point").index(groups[end].kind))
        split.end_on_half(i, ends[0])
        chosen.add(i)
    rooted = _rooted(len(split.groups), split.edges, chosen)
    return SpanningTree(
        split.shared_groups(),
        tuple(TreeEdge(split.edges[key], parent, child) for key, parent, child in rooted),
        (*(edge for i, edge in enumerate(split.edges) if i not in chosen), *split.welds),
    )


def _least_freedom(groups: Sequence[Group], edges: Sequence[Joint], driven: Set[AbstractJoint]) -> set[int]:
    """Among equals the edges that lie nearest to the ground (Kruskal); points, which hand on no orientation, at its ends;
    rather hinges than slides."""
    depth = {0: 0}
    for near, far, _ in Graph(range(len(groups)), ((edge.a, edge.b) for edge in edges)).tree(0):
        depth[far] = depth[near] + 1

    def order(i: int) -> tuple[bool, int, bool, int, bool, int]:
        edge = edges[i]
        return (
            not _keeps_coordinates(edge.joint, driven), edge.joint.v.size, "point" in (groups[edge.a].kind, groups[edge.b].kind), max(depth[edge.a], depth[edge.b]), not edge.joint.q.is_angle, i
        )  # fmt: skip

    ranked = sorted(range(len(edges)), key=order)
    return {ranked[k] for k in least_tree((edges[i].a, edges[i].b) for i in ranked)}


def _keeps_coordinates(joint: AbstractJoint, driven: Set[AbstractJoint]) -> bool:
    if joint in driven or type(joint).closure is AbstractJoint.closure:
        return True
    return joint.closure(Pose(ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)), ca.SX.sym("t")) is None


def _rooted(count: int, edges: Sequence[Joint], chosen: Set[int]) -> list[tuple[int, int, int]]:
    """(edge, parent, child) of a tree from the ground on."""
    places = sorted(chosen)
    tree = Graph(range(count), ((edges[i].a, edges[i].b) for i in places)).tree(0)
    return [(places[k], parent, child) for parent, child, k in tree]


@dataclass(frozen=True)
class _Split:
    """Groups and edges while bodies are split."""

    groups: list[Group]
    edges: list[Joint]
    welds: list[Edge[AbstractConstraint]]

    def end_on_half(self, i: int, body: int) -> None:
        """Let edge `i` end on a copy of `body` that a weld holds to it."""
        whole = next((weld.a for weld in self.welds if weld.b == body), body)
        group, copy = self.groups[whole], len(self.groups)
        kind = "massless" if group.kind == "ground" else group.kind
        self.groups.append(replace(group, name=f"half of {group.name}", kind=kind, parts=(), part_poses=(), poses={}))
        edge = self.edges[i]
        self.edges[i] = replace(edge, a=copy) if edge.a == body else replace(edge, b=copy)
        self.welds.append(Edge(f"{group.name}.weld", Weld(), whole, copy, implicit=True))

    def shared_groups(self) -> tuple[Group, ...]:
        """The groups, the inertia of split ones shared evenly (that of the ground is nothing)."""
        whole = {weld.b: weld.a for weld in self.welds}
        shares = Counter(weld.a for weld in self.welds)
        count = [1 + shares[whole.get(k, k)] for k in range(len(self.groups))]
        return tuple(
            replace(group, inertia=group.inertia.shared(n)) if n > 1 else group
            for group, n in zip(self.groups, count, strict=True)
        )
