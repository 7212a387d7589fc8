"""Graphs: what hangs together, and in which order it is reached. Everything is in the order in which nodes and edges were given."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable
from typing import TypeVar

Node = TypeVar("Node", bound=Hashable)


class Graph(dict[Node, list[tuple[Node, int]]]):
    """Nodes, and for each its neighbours, with the places of the edges between among those given."""

    def __init__(self, nodes: Iterable[Node], edges: Iterable[tuple[Node, Node]]) -> None:
        super().__init__((node, []) for node in nodes)
        for place, (a, b) in enumerate(edges):
            self.setdefault(a, []).append((b, place))
            self.setdefault(b, []).append((a, place))

    def tree(self, root: Node) -> list[tuple[Node, Node, int]]:
        """(nearer node, farther node, edge) of all that is reached from a root, nearest first."""
        found: list[tuple[Node, Node, int]] = []
        seen, queue = {root}, deque([root])
        while queue:
            near = queue.popleft()
            for far, edge in self[near]:
                if far not in seen:
                    seen.add(far)
                    queue.append(far)
                    found.append((near, far, edge))
        return found

    def parts(self) -> list[list[Node]]:
        """Nodes that hang together."""
        found: list[list[Node]] = []
        seen: set[Node] = set()
        for node in self:
            if node not in seen:
                found.append([node, *(far for _, far, _ in self.tree(node))])
                seen.update(found[-1])
        return found


def least_tree(edges: Iterable[tuple[Node, Node]]) -> list[int]:
    """Places of the edges that close no loop with those before them (Kruskal 1956)."""
    parent: dict[Node, Node] = {}

    def root(node: Node) -> Node:
        while (above := parent.setdefault(node, node)) != node:
            parent[node] = node = parent[above]
        return node

    chosen: list[int] = []
    for place, (a, b) in enumerate(edges):
        if (one := root(a)) != (other := root(b)):
            parent[one] = other
            chosen.append(place)
    return chosen
