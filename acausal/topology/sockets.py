"""Joints that end in a point: a body there hangs on it by a ball joint."""

from __future__ import annotations

from dataclasses import replace

from acausal.language.flatten import FlatSystem, Part
from acausal.parts.joint import AbstractJoint
from acausal.topology.rigid_groups import rigid_groups


def with_sockets(flat: FlatSystem) -> FlatSystem:
    """The scene with the `socket` of each joint that ends in a point, where a body is fixed there or the ground; particles and massless frames need none."""
    ending = [
        (part, socket) for part in flat.parts if isinstance(part.component, AbstractJoint) if (socket := part.component.socket)
    ]
    if not ending:
        return flat
    kinds = {connector: group.kind for group in rigid_groups(flat) for connector in group.poses}
    parts, paths, names = list(flat.parts), dict(flat.connector_paths), dict(flat.names)
    sets = [list(members) for members in flat.connection_sets]
    for part, socket in ending:
        joint = part.component
        assert isinstance(joint, AbstractJoint)
        if kinds[joint.frame_b] not in ("body", "ground"):
            continue
        path = f"{part.path}.socket"
        parts.append(Part(path, socket))
        paths |= {end: f"{path}.{end.name}" for end in socket.connectors()}
        names |= {variable: f"{path}.{variable.name}" for variable in socket.variables()}
        behind = next(members for members in sets if joint.frame_b in members)
        behind[behind.index(joint.frame_b)] = socket.frame_b
        sets.append([joint.frame_b, socket.frame_a])
    return replace(flat, parts=tuple(parts), names=names, connector_paths=paths, connection_sets=tuple(map(tuple, sets)))
