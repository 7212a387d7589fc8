"""Topology: from a flat system to a mechanism. The graph alone decides on groups, tree, cuts and free bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from acausal.errors import GroundError, IncompatibleError, LockedError
from acausal.language.connector import Point
from acausal.language.flatten import FlatSystem, Part
from acausal.mechanics.force import AbstractForce
from acausal.mechanics.free import FreeJoint, FreePoint
from acausal.mechanics.inertia import Inertia
from acausal.mechanics.joint import AbstractJoint, AbstractStepJoint
from acausal.mechanics.pose import Pose
from acausal.mechanics.rigid import AbstractGround, AbstractRigidPart
from acausal.mechanics.steps import Shift, Slide
from acausal.topology.mechanism import Edge, Group, Mechanism, TreeEdge
from acausal.topology.rigid_groups import rigid_groups

if TYPE_CHECKING:
    import networkx as nx


def build_mechanism(flat: FlatSystem) -> Mechanism:
    """Groups, spanning tree and cuts; only a ground if nothing in the scene is mechanical in three dimensions.

    Raises `GroundError` without a ground or with contradicting ones, `LockedError` for a joint with both ends on one
    group, `IncompatibleError` for a joint held by points only.
    """
    joints = [part for part in flat.parts if isinstance(part.component, AbstractJoint)]
    forces = tuple(part for part in flat.parts if isinstance(part.component, AbstractForce))
    rigid = [part for part in flat.parts if isinstance(part.component, AbstractRigidPart)]
    gravity = _gravity(rigid) if joints or forces or rigid else None
    groups = rigid_groups(flat)
    index = {connector: i for i, group in enumerate(groups) for connector in group.poses}
    edges = [_edge(part, groups, index) for part in joints]
    _check_points(edges, groups)
    graph = _joint_graph(len(groups), edges)
    edges += _free_edges(graph, groups)
    tree, cuts = _spanning_tree(len(groups), edges)
    return Mechanism(flat, groups, tree, cuts, forces, gravity)


def _gravity(rigid: Sequence[Part]) -> np.ndarray | None:
    worlds = [part for part in rigid if isinstance(part.component, AbstractGround)]
    if not worlds:
        raise GroundError(
            "The scene has no ground. Add one, e.g. scene.world = World(), and connect its frame where something is held."
        )
    values = [part.component.gravity() for part in worlds if isinstance(part.component, AbstractGround)]
    for part, value in zip(worlds[1:], values[1:], strict=True):
        if not np.array_equal(np.asarray(value), np.asarray(values[0])):
            raise GroundError(
                f"Two grounds contradict each other: {worlds[0].where} has gravity {values[0]}, {part.where} has {value}. Keep one World."
            )
    return values[0]


def _edge(part: Part, groups: Sequence[Group], index: dict[Point, int]) -> Edge:
    joint = part.component
    assert isinstance(joint, AbstractJoint)
    a, b = index[joint.frame_a], index[joint.frame_b]
    if a == b:
        raise LockedError(
            f"Both ends of joint {part.where} are fixed to the same rigid group ({', '.join(p.path for p in groups[a].parts)}), "
            "so it cannot move. Connect one end to another part."
        )
    return Edge(part.path, joint, a, b, pose_a=groups[a].poses[joint.frame_a], pose_b=groups[b].poses[joint.frame_b])


def _joint_graph(count: int, edges: Sequence[Edge]) -> nx.MultiGraph[int]:
    import networkx as nx

    graph: nx.MultiGraph[int] = nx.MultiGraph()
    graph.add_nodes_from(range(count))
    graph.add_edges_from((edge.a, edge.b) for edge in edges)
    return graph


def _free_edges(graph: nx.MultiGraph[int], groups: Sequence[Group]) -> list[Edge]:
    """A free joint from the ground to the heaviest group of every part of the graph that the ground does not reach."""
    import networkx as nx

    edges: list[Edge] = []
    for island in nx.connected_components(graph):
        if 0 in island:
            continue
        root = max(sorted(island), key=lambda i: (groups[i].kind == "body", _mass(groups[i].inertia)))
        group = groups[root]
        if group.kind == "point":
            edges.append(Edge(f"{group.name}.free", FreePoint(), 0, root, True))
        else:
            joint = FreeJoint()
            edges.append(Edge(f"{group.name}.free", joint, 0, root, True, pose_b=_central_pose(group.inertia)))
    return edges


def _mass(inertia: Inertia) -> float:
    return inertia.mass if isinstance(inertia.mass, float) else 1.0


def _central_pose(inertia: Inertia) -> Pose:
    """Frame at the centre of mass, where a free body's equations are shortest."""
    if isinstance(inertia.mass, float) and isinstance(inertia.moment, np.ndarray) and inertia.mass > 0:
        return Pose(np.eye(3), inertia.moment / inertia.mass)
    return Pose.identity()


def _check_points(edges: Sequence[Edge], groups: Sequence[Group]) -> None:
    """A joint that lets its ends turn against one another needs a frame at both."""
    for edge in edges:
        for end, connector in ((edge.a, edge.joint.frame_a), (edge.b, edge.joint.frame_b)):
            if groups[end].kind == "point" and _turns(edge.joint):
                raise IncompatibleError(
                    f"{edge.name}.{connector.name} ({edge.joint.created_at}) needs a frame, but '{groups[end].name}' that it is connected to "
                    f"({groups[end].parts[0].component.created_at}) is a point: it has a position and no orientation. Connect the joint to a body, "
                    "or put a Fixed between joint and particle."
                )


def _turns(joint: AbstractJoint) -> bool:
    return not isinstance(joint, AbstractStepJoint) or not all(isinstance(step, Slide | Shift) for step in joint.steps())


def _spanning_tree(count: int, edges: Sequence[Edge]) -> tuple[tuple[TreeEdge, ...], tuple[Edge, ...]]:
    """Spanning tree of least total freedom; among equals the one whose edges lie nearest to the ground (Kruskal)."""
    import networkx as nx

    graph = _joint_graph(count, edges)
    depth = nx.single_source_shortest_path_length(graph, 0)
    order = sorted(range(len(edges)), key=lambda i: (edges[i].joint.v.size, max(depth[edges[i].a], depth[edges[i].b]), i))
    weighted: nx.MultiGraph[int] = nx.MultiGraph()
    for rank, i in enumerate(order):
        weighted.add_edge(edges[i].a, edges[i].b, key=i, weight=rank)
    chosen = {key for _, _, key in nx.minimum_spanning_edges(weighted, keys=True, data=False)}
    tree_graph: nx.MultiGraph[int] = nx.MultiGraph()
    tree_graph.add_nodes_from(range(count))
    for i in sorted(chosen):
        tree_graph.add_edge(edges[i].a, edges[i].b, key=i)
    tree: list[TreeEdge] = []
    for parent, child in nx.bfs_edges(tree_graph, 0):
        key = min(k for a, b, k in tree_graph.edges(parent, keys=True) if child in (a, b))
        tree.append(TreeEdge(edges[key], parent, child))
    return tuple(tree), tuple(edges[i] for i in range(len(edges)) if i not in chosen)
