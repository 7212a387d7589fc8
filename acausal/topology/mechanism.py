"""The mechanism as a graph: rigid groups are nodes, joints are edges; a spanning tree, and cut edges that close loops."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from acausal.language.connector import Point
from acausal.language.flatten import FlatSystem, Part
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.inertia import Inertia
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose
from acausal.wording import compact, shortened

if TYPE_CHECKING:
    import networkx as nx


Kind = TypeVar("Kind", bound=AbstractConstraint, covariant=True)


@dataclass(frozen=True)
class Group:
    """Rigid parts that move as one. `poses` places each connector in the group's own frame."""

    name: str
    kind: str
    """'ground', 'body', 'point' (particles only: no orientation) or 'massless'."""
    parts: tuple[Part, ...]
    part_poses: tuple[Pose, ...]
    poses: dict[Point, Pose]
    inertia: Inertia
    sketch: Pose | None = None


@dataclass(frozen=True)
class Edge(Generic[Kind]):
    """A joint or constraint between two groups; frame_a at `a`, frame_b at `b`."""

    name: str
    joint: Kind
    a: int
    b: int
    implicit: bool = False
    """Added because a group is held by nothing."""
    pose_a: Pose = field(default_factory=Pose.identity)
    pose_b: Pose = field(default_factory=Pose.identity)
    """Of frame_a in group a and of frame_b in group b."""

    def seen_from(self, group: int) -> tuple[Pose, Pose, bool]:
        """Pose of the near and the far frame, and whether the joint is passed from frame_b to frame_a."""
        return (self.pose_a, self.pose_b, False) if group == self.a else (self.pose_b, self.pose_a, True)


@dataclass(frozen=True)
class TreeEdge:
    """An edge of the spanning tree, from the group nearer to the ground to the farther one."""

    edge: Edge[AbstractJoint]
    parent: int
    child: int


@dataclass(frozen=True, repr=False)
class Mechanism:
    """Groups (the ground is the first), the spanning tree in an order in which parents come first, and the cut edges."""

    flat: FlatSystem
    groups: tuple[Group, ...]
    tree: tuple[TreeEdge, ...]
    cuts: tuple[Edge[AbstractConstraint], ...]
    forces: tuple[Part, ...]
    gravity: np.ndarray | None

    def group_of(self, connector: Point) -> int:
        """Index of the group in which a connector is fixed."""
        return next(i for i, group in enumerate(self.groups) if connector in group.poses)

    @property
    def graph(self) -> nx.MultiGraph[int]:
        """Nodes: groups, with `label` and `kind`; edges: joints ('joint' or 'cut') and forces ('force'), with `label`."""
        import networkx as nx

        graph: nx.MultiGraph[int] = nx.MultiGraph()
        for i, group in enumerate(self.groups):
            graph.add_node(i, label=group.name, kind=group.kind)
        for tree_edge in self.tree:
            graph.add_edge(tree_edge.parent, tree_edge.child, label=tree_edge.edge.name, kind="joint")
        for cut in self.cuts:
            graph.add_edge(cut.a, cut.b, label=cut.name, kind="cut")
        for part in self.forces:
            ends = [self.group_of(c) for c in part.component.connectors() if isinstance(c, Point)]
            if len(ends) == 2:
                graph.add_edge(ends[0], ends[1], label=part.path, kind="force")
        return graph

    def __str__(self) -> str:
        rows = [f"{self.flat.name}: {len(self.groups)} rigid groups, {len(self.tree)} tree edges, {len(self.cuts)} cut edges"]
        groups = [f"  {g.kind:<9} {g.name:<20} {compact(part.path for part in g.parts)}" for g in self.groups]
        tree = [f"  tree  {self.groups[i.parent].name} -- {i.edge.name} --> {self.groups[i.child].name}" for i in self.tree]
        cuts = [f"  cut   {self.groups[c.a].name} -- {c.name} --> {self.groups[c.b].name}" for c in self.cuts]
        rows += [*shortened(groups), *shortened(tree), *shortened(cuts)]
        return "\n".join(rows)
