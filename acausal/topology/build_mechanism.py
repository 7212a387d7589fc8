"""Topology: from a flat system to a mechanism. The graph alone decides on groups, tree, cuts and free bodies."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from acausal.errors import GroundError, IncompatibleError, LockedError
from acausal.graphs import Graph
from acausal.language.connector import Point, Rotational
from acausal.language.expression import Derivative
from acausal.language.flatten import FlatSystem, Part, leaves_inside
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.force import AbstractForce
from acausal.parts.free import FreeJoint, FreePoint
from acausal.parts.inertia import Inertia
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbolic
from acausal.parts.rigid import AbstractGround, AbstractRigidPart
from acausal.parts.span import AbstractSpan
from acausal.topology.canonical_order import Name, canonical_order, natural, rounded
from acausal.topology.mechanism import Edge, Group, Kind, Mechanism
from acausal.topology.rigid_groups import rigid_groups
from acausal.topology.spanning_tree import spanning_tree


def build_mechanism(flat: FlatSystem) -> Mechanism:
    """Groups, spanning tree and cuts; only a ground if nothing in the scene is mechanical in three dimensions.

    Raises `GroundError` without a ground or with contradicting ones, `LockedError` for a joint with both ends on one
    group, `IncompatibleError` for a joint held by points only.
    """
    forces = tuple(part for part in flat.parts if isinstance(part.component, AbstractForce))
    rigid = [part for part in flat.parts if isinstance(part.component, AbstractRigidPart)]
    joints = [(part.path, part.component) for part in flat.parts if isinstance(part.component, AbstractJoint)]
    others = [
        (part.path, part.component)
        for part in flat.parts
        if isinstance(part.component, AbstractConstraint) and not isinstance(part.component, AbstractJoint)
    ]
    gravity = _gravity(rigid) if joints or others or forces or rigid else None
    groups, edges, held = _in_order(rigid_groups(flat), joints, others, gravity)
    _check_points([*edges, *held], forces, groups)
    forces = tuple(sorted(forces, key=functools.partial(_force_key, groups)))
    free = _free_edges(len(groups), edges, groups)
    found = spanning_tree(groups, [*edges, *free], _driven(flat, forces))
    names = {symbol: f"{edge.name}.{symbol.name}" for edge in free for symbol in (edge.joint.q, edge.joint.v)}
    return Mechanism(replace(flat, free=names), found.groups, found.tree, (*found.cuts, *held), forces, gravity)


def _in_order(
    groups: tuple[Group, ...],
    joints: Sequence[tuple[str, AbstractJoint]],
    others: Sequence[tuple[str, AbstractConstraint]],
    gravity: np.ndarray | None,
) -> tuple[tuple[Group, ...], list[Edge[AbstractJoint]], list[Edge[AbstractConstraint]]]:
    """Groups, joints and other constraints in an order with which that of declaration has nothing to do."""
    order = canonical_order(groups, [*_edges(groups, joints), *_edges(groups, others)], gravity)
    groups = tuple(groups[k] for k in sorted(range(len(groups)), key=order.groups.__getitem__))
    edges, held, n = _edges(groups, joints), _edges(groups, others), len(joints)
    return (
        groups,
        [edges[i] for i in sorted(range(n), key=order.edges.__getitem__)],
        [held[i] for i in sorted(range(len(held)), key=order.edges[n:].__getitem__)],
    )


def _force_key(groups: Sequence[Group], part: Part) -> tuple[str, list[tuple[int, tuple[float, ...]]], Name]:
    """Kind, where it acts, and name: sums of forces have rounding errors, too."""
    own = [c for c in part.component.connectors() if isinstance(c, Point)]
    ends = [(k, group.poses[c].position) for k, group in enumerate(groups) for c in own if c in group.poses]
    places = sorted((k, tuple(rounded(at).tolist()) if isinstance(at, np.ndarray) else ()) for k, at in ends)
    return type(part.component).__name__, places, natural(part.path)


def _edges(groups: Sequence[Group], joints: Sequence[tuple[str, Kind]]) -> list[Edge[Kind]]:
    index = {connector: i for i, group in enumerate(groups) for connector in group.poses}
    return [_edge(path, joint, groups, index) for path, joint in joints]


def _driven(flat: FlatSystem, forces: Sequence[Part]) -> set[AbstractJoint]:
    """Joints on whose angle something acts: through their flanges, or because a force reads it."""
    connected = [c for members in flat.connection_sets if len(members) > 1 for c in members if isinstance(c, Rotational)]
    others = [
        part for part in flat.parts if not isinstance(part.component, AbstractRigidPart | AbstractConstraint | AbstractForce)
    ]
    return {c.owner for c in connected if isinstance(c.owner, AbstractJoint)} | _read_by(flat, [*forces, *others])


def _read_by(flat: FlatSystem, parts: Sequence[Part]) -> set[AbstractJoint]:
    """Joints whose coordinates or velocities stand in parts, or that parts know."""
    held = [value for part in parts for value in vars(part.component).values()]
    symbols = {s.of if isinstance(s, Derivative) else s for value in held for s in leaves_inside(value)}
    known = {value for value in held if isinstance(value, AbstractJoint)}
    if not (symbols or known):
        return set()
    joints = [part.component for part in flat.parts if isinstance(part.component, AbstractJoint)]
    own = [
        (j, {*j.variables(), *(s for c in j.connectors() if isinstance(c, Rotational) for s in vars(c).values())}) for j in joints
    ]
    return {joint for joint, variables in own if joint in known or symbols & variables}


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


def _edge(path: str, joint: Kind, groups: Sequence[Group], index: dict[Point, int]) -> Edge[Kind]:
    a, b = index[joint.frame_a], index[joint.frame_b]
    if a == b and not isinstance(joint, AbstractElasticBody | AbstractSpan):
        raise LockedError(
            f"Both ends of joint '{path}' ({joint.created_at}) are fixed to the same rigid group ({', '.join(p.path for p in groups[a].parts)}), "
            "so it cannot move. Connect one end to another part."
        )
    behind_a = groups[a].inertia.seen_from(groups[a].poses[joint.frame_a].inverse())
    if b == 0 and joint.looks_turned_round(behind_a):
        raise IncompatibleError(
            f"{path} ({joint.created_at}) is connected the wrong way round: what rolls belongs to frame_b, the plane that it rolls on to frame_a, but "
            f"frame_b is on the ground and frame_a on {groups[a].name}, which is round. Exchange the two."
        )
    return Edge(path, joint, a, b, pose_a=groups[a].poses[joint.frame_a], pose_b=groups[b].poses[joint.frame_b])


def _free_edges(count: int, joints: Sequence[Edge[AbstractJoint]], groups: Sequence[Group]) -> list[Edge[AbstractJoint]]:
    """A free joint from the ground to the heaviest group of every part of the graph that the ground does not reach."""
    edges: list[Edge[AbstractJoint]] = []
    for island in Graph(range(count), ((edge.a, edge.b) for edge in joints)).parts():
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


def _check_points(edges: Sequence[Edge[AbstractConstraint]], forces: Sequence[Part], groups: Sequence[Group]) -> None:
    """What turns its ends, or lets them turn against one another, needs a frame at each."""
    held = {connector: group for group in groups if group.kind == "point" for connector in group.poses}
    turning: list[tuple[str, AbstractConstraint | AbstractForce, Sequence[Point]]] = [
        (edge.name, edge.joint, (edge.joint.frame_a, edge.joint.frame_b)) for edge in edges if _turns(edge.joint)
    ]
    for part in forces:
        if isinstance(part.component, AbstractForce) and part.component.turns:
            turning.append((part.path, part.component, tuple(c for c in part.component.connectors() if isinstance(c, Point))))
    for path, part, ends in turning:
        for end in ends:
            if end in held:
                force = isinstance(part, AbstractForce)
                advice = "it to a body" if force else "the joint to a body, or put a Fixed between joint and particle"
                raise IncompatibleError(
                    f"{path}.{end.name} ({part.created_at}) needs a frame, but '{held[end].name}' that it is connected to "
                    f"({held[end].parts[0].component.created_at}) is a point: it has a position and no orientation. Connect {advice}."
                )


def _turns(joint: AbstractConstraint) -> bool:
    if joint.between_points or not isinstance(joint, AbstractJoint):
        return not joint.between_points
    q, t = joint.q.sx, ca.SX.sym("t")
    return ca.depends_on(symbolic(joint.pose(q, t).rotation), ca.vertcat(q, t))
