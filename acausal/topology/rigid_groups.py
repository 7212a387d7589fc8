"""Rigid groups: parts and connection sets that cannot move against one another, with the place of every connector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.errors import AssemblyError, GroundError
from acausal.graphs import Graph
from acausal.language.connector import Frame, Point
from acausal.language.flatten import FlatSystem, Part
from acausal.numerics.thresholds import EDGE
from acausal.parts.inertia import Inertia
from acausal.parts.pose import Pose, snapped
from acausal.parts.rigid import AbstractGround, AbstractRigidPart, Attachment
from acausal.topology.canonical_order import Name, natural, rounded
from acausal.topology.mechanism import Group

_GROUND = "ground"


def rigid_groups(flat: FlatSystem) -> tuple[Group, ...]:
    """All groups, the ground first. A loop of rigid parts must fit: else `AssemblyError` or, at the ground, `GroundError`."""
    sets = [tuple(c for c in members if isinstance(c, Point)) for members in flat.connection_sets]
    sets = [members for members in sets if members]
    set_of = {connector: i for i, members in enumerate(sets) for connector in members}
    parts = {part.path: part for part in flat.parts if isinstance(part.component, AbstractRigidPart)}
    links: list[_Link] = []
    for path, part in parts.items():
        if isinstance(part.component, AbstractGround):
            links.append(_Link(_GROUND, path, Pose.identity()))
        links += [
            _Link(path, set_of[attachment.connector], attachment.pose)
            for attachment in _attachments(part)
            if attachment.connector in set_of
        ]
    graph: Graph[str | int] = Graph([_GROUND, *parts, *range(len(sets))], [(link.start, link.end) for link in links])
    islands = sorted(graph.parts(), key=lambda nodes: _GROUND not in nodes)
    return tuple(_group(flat, graph, links, nodes, parts, sets) for nodes in islands)


@dataclass(frozen=True)
class _Link:
    """Of two nodes, the ground, parts and connection sets: `pose` of the `end` seen from the `start`."""

    start: str | int
    end: str | int
    pose: Pose

    def seen_from(self, near: str | int) -> Pose:
        pose = self.pose if self.start == near else self.pose.inverse()
        return Pose(snapped(pose.rotation), pose.position) if isinstance(pose.rotation, np.ndarray) else pose


def _attachments(part: Part) -> tuple[Attachment, ...]:
    assert isinstance(part.component, AbstractRigidPart)
    return part.component.attachments()


def _group(
    flat: FlatSystem,
    graph: Graph[str | int],
    links: Sequence[_Link],
    nodes: Sequence[str | int],
    parts: dict[str, Part],
    sets: Sequence[tuple[Point, ...]],
) -> Group:
    members = tuple(sorted((parts[node] for node in nodes if isinstance(node, str) and node in parts), key=_rank))
    root: str | int = _GROUND
    if _GROUND not in nodes:
        root = members[0].path if members else min(n for n in nodes if isinstance(n, int))
    placed: dict[str | int, Pose] = {root: Pose.identity()}
    for near, far, k in graph.tree(root):
        placed[far] = placed[near] @ links[k].seen_from(near)
    _check_loops([links[k] for k in dict.fromkeys(k for node in nodes for _, k in graph[node])], placed, parts)
    poses = {connector: placed[node] for node in nodes if isinstance(node, int) for connector in sets[node]}
    inertia = Inertia.zero()
    for part in members:
        assert isinstance(part.component, AbstractRigidPart)
        inertia = inertia + part.component.inertia().seen_from(placed[part.path])
    kind = _kind(root, members, inertia)
    name = (
        "ground"
        if kind == "ground"
        else next((p.path for p in members), flat.connector_paths[next(iter(poses))] if poses else "nothing")
    )
    return Group(name, kind, members, tuple(placed[part.path] for part in members), poses, inertia, _sketch(members, placed))


def _rank(part: Part) -> tuple[float, str, Name]:
    """The heaviest comes first: the group has its name and its frame."""
    assert isinstance(part.component, AbstractRigidPart)
    mass = part.component.inertia().mass
    return -float(rounded(mass)) if isinstance(mass, float) else 0.0, type(part.component).__name__, natural(part.path)


def _kind(root: str | int, members: Sequence[Part], inertia: Inertia) -> str:
    if root == _GROUND:
        return "ground"
    if members and all(not isinstance(a.connector, Frame) for part in members for a in _attachments(part)):
        return "point"
    return "massless" if inertia.is_zero else "body"


def _sketch(members: Sequence[Part], placed: dict[str | int, Pose]) -> Pose | None:
    for part in members:
        assert isinstance(part.component, AbstractRigidPart)
        rough = part.component.sketch_pose()
        if rough is not None:
            return rough @ placed[part.path].inverse()
    return None


def _extent(pose: Pose) -> float:
    """Distance of its origin, 0 where that depends on parameters."""
    return float(np.linalg.norm(pose.position)) if isinstance(pose.position, np.ndarray) else 0.0


def _check_loops(links: Sequence[_Link], placed: dict[str | int, Pose], parts: dict[str, Part]) -> None:
    extent = max((_extent(pose) for pose in placed.values()), default=0.0)
    for link in links:
        near, far, along = link.start, link.end, link.seen_from(link.start)
        gap = (placed[near] @ along).inverse() @ placed[far]
        if not (isinstance(gap.rotation, np.ndarray) and isinstance(gap.position, np.ndarray)):
            continue
        distance, turn = float(np.linalg.norm(gap.position)), float(np.linalg.norm(gap.rotation - np.eye(3)))
        is_point = (
            isinstance(far, int)
            and near in parts
            and not any(isinstance(a.connector, Frame) for a in _attachments(parts[str(near)]))
        )
        lengths = extent + _extent(along)
        if distance > EDGE * lengths or (turn > EDGE and not is_point):
            who = ", ".join(parts[str(n)].where for n in placed if n in parts)
            message = (
                f"Rigid parts are connected in a loop that does not fit: a gap of {distance:.3g} m and a turn of {turn:.3g} rad "
                f"remain. Parts: {who}. Change the offsets so that they agree, or remove one connection."
            )
            raise GroundError("Grounds in conflict. " + message) if _GROUND in placed else AssemblyError(message)
