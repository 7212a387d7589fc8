"""The spanning tree of a mechanism: which joints carry coordinates, which close loops, and which bodies are split for it.

Kruskal's tree of least total freedom. Two things are then put right:

- Behind every joint of the tree there must be mass. A massless link at the end of a branch is moved into the middle of one,
  by cutting its loop elsewhere.
- A joint that must keep its coordinates, or a massless link that cannot be moved, is followed to the next body. That
  body is split into two equal halves: the joint ends on one of them, and a weld holds both together.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from acausal.mechanics.constraint import AbstractConstraint
from acausal.mechanics.joint import AbstractJoint
from acausal.mechanics.weld import Weld
from acausal.topology.mechanism import Edge, Group, TreeEdge

if TYPE_CHECKING:
    import networkx as nx

Joint = Edge[AbstractJoint]


@dataclass(frozen=True)
class SpanningTree:
    """Groups (split ones in two, the second half at the end), tree edges in an order in which parents come first, cut edges."""

    groups: tuple[Group, ...]
    tree: tuple[TreeEdge, ...]
    cuts: tuple[Edge[AbstractConstraint], ...]


def spanning_tree(groups: Sequence[Group], edges: Sequence[Joint], driven: Set[AbstractJoint]) -> SpanningTree:
    """Tree and cuts of the graph with these nodes (the first is the ground) and edges.

    `driven`: joints on whose coordinates something acts: an angle known only up to full turns would not do for them.
    """
    chosen = _with_mass_behind(groups, edges, _least_freedom(len(groups), edges, driven))
    split = _Split(list(groups), list(edges), [])
    for i in [i for i in range(len(edges)) if i not in chosen and _keeps_coordinates(edges[i].joint, driven)]:
        end = next((end for end in (edges[i].b, edges[i].a) if groups[end].kind == "body"), None)
        if end is not None:
            split.end_on_half(i, end)
            chosen.add(i)
    while (found := _body_to_split(split.groups, split.edges, chosen)) is not None:
        added, i, body = found
        split.end_on_half(i, body)
        chosen = chosen | {added}
    rooted = _rooted(len(split.groups), split.edges, chosen)
    return SpanningTree(
        split.shared_groups(),
        tuple(TreeEdge(split.edges[key], parent, child) for key, parent, child in rooted),
        (*(edge for i, edge in enumerate(split.edges) if i not in chosen), *split.welds),
    )


def _least_freedom(count: int, edges: Sequence[Joint], driven: Set[AbstractJoint]) -> set[int]:
    """Among equals the edges that lie nearest to the ground (Kruskal)."""
    import networkx as nx

    graph = _graph(count, edges, range(len(edges)))
    depth = nx.single_source_shortest_path_length(graph, 0)

    def order(i: int) -> tuple[bool, int, int, int]:
        edge = edges[i]
        return (
            not _keeps_coordinates(edge.joint, driven), edge.joint.v.size, max(depth[edge.a], depth[edge.b]), i
        )  # fmt: skip

    weighted: nx.MultiGraph[int] = nx.MultiGraph()
    for rank, i in enumerate(sorted(range(len(edges)), key=order)):
        weighted.add_edge(edges[i].a, edges[i].b, key=i, weight=rank)
    return {key for _, _, key in nx.minimum_spanning_edges(weighted, keys=True, data=False)}


def _keeps_coordinates(joint: AbstractJoint, driven: Set[AbstractJoint]) -> bool:
    return joint in driven or type(joint).closure is AbstractJoint.closure


def _graph(count: int, edges: Sequence[Joint], chosen: Iterable[int]) -> nx.MultiGraph[int]:
    import networkx as nx

    graph: nx.MultiGraph[int] = nx.MultiGraph()
    graph.add_nodes_from(range(count))
    for i in chosen:
        graph.add_edge(edges[i].a, edges[i].b, key=i)
    return graph


def _rooted(count: int, edges: Sequence[Joint], chosen: Set[int]) -> list[tuple[int, int, int]]:
    """(edge, parent, child) of a tree from the ground on."""
    import networkx as nx

    graph = _graph(count, edges, sorted(chosen))
    return [(_key(graph, parent, child), parent, child) for parent, child in nx.bfs_edges(graph, 0)]


def _key(graph: nx.MultiGraph[int], a: int, b: int) -> int:
    """Of the edge between two nodes of a tree."""
    return next(k for x, y, k in graph.edges(a, keys=True) if b in (x, y))


def _light_branches(groups: Sequence[Group], edges: Sequence[Joint], chosen: Set[int]) -> list[set[int]]:
    """Groups of the largest branches of the tree that have no mass at all."""
    rooted = _rooted(len(groups), edges, chosen)
    below: dict[int, set[int]] = {i: {i} for i in range(len(groups))}
    heavy = {i for i, group in enumerate(groups) if group.kind != "massless"}
    for _, parent, child in reversed(rooted):
        if child in heavy:
            heavy.add(parent)
        else:
            below[parent] |= below[child]
    return [below[child] for _, parent, child in rooted if child not in heavy and parent in heavy]


def _with_mass_behind(groups: Sequence[Group], edges: Sequence[Joint], chosen: set[int]) -> set[int]:
    """Exchange tree edges for cut ones while this leaves fewer massless groups at the ends of branches."""
    import networkx as nx

    light = _light_branches(groups, edges, chosen)
    while light:
        best = (sum(map(len, light)), 0, chosen)
        for i in (i for i in range(len(edges)) if i not in chosen and any({edges[i].a, edges[i].b} & own for own in light)):
            graph = _graph(len(groups), edges, sorted(chosen))
            path = nx.shortest_path(graph, edges[i].a, edges[i].b)
            for a, b in itertools.pairwise(path):
                out = _key(graph, a, b)
                other = (chosen - {out}) | {i}
                score = (sum(map(len, _light_branches(groups, edges, other))), edges[i].joint.v.size - edges[out].joint.v.size)
                if score < best[:2]:
                    best = (*score, other)
        if best[2] is chosen or best[0] == sum(map(len, light)):
            break
        chosen = best[2]
        light = _light_branches(groups, edges, chosen)
    return chosen


def _body_to_split(groups: Sequence[Group], edges: Sequence[Joint], chosen: Set[int]) -> tuple[int, int, int] | None:
    """For a massless branch that closes a loop: the edge that joins the tree, the edge that shall end on a half, the body to split."""
    for light in _light_branches(groups, edges, chosen):
        outer = [i for i, edge in enumerate(edges) if (edge.a in light) != (edge.b in light)]
        closing = [i for i in outer if i not in chosen]
        for added, i in [(i, i) for i in closing] + [(closing[0], k) for k in outer if closing and k in chosen]:
            body = edges[i].b if edges[i].a in light else edges[i].a
            if groups[body].kind == "body":
                return added, i, body
    return None


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
        self.groups.append(replace(group, name=f"half of {group.name}", parts=(), part_poses=(), poses={}))
        edge = self.edges[i]
        self.edges[i] = replace(edge, a=copy) if edge.a == body else replace(edge, b=copy)
        self.welds.append(Edge(f"{group.name}.weld", Weld(), whole, copy, implicit=True))

    def shared_groups(self) -> tuple[Group, ...]:
        """The groups, the inertia of split ones shared evenly."""
        whole = {weld.b: weld.a for weld in self.welds}
        shares = Counter(weld.a for weld in self.welds)
        count = [1 + shares[whole.get(k, k)] for k in range(len(self.groups))]
        return tuple(
            replace(group, inertia=group.inertia.shared(n)) if n > 1 else group
            for group, n in zip(self.groups, count, strict=True)
        )
