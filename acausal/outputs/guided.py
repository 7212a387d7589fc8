"""Guides whose functions switch: what slides along them may come to a corner."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from acausal.numerics.switching import COMPARED, JUMPS, switches
from acausal.outputs.outputs import Outputs
from acausal.parts.joint import AbstractJoint, AbstractStepJoint
from acausal.parts.pose import symbolic


@dataclass(frozen=True)
class Guide:
    """`who`, a joint of the tree with its line; `velocity` (3, 1) of frame_b in frame_a, by t, x, u and p; its `coordinates`, called `names`."""

    who: str
    velocity: ca.SX
    coordinates: ca.SX
    names: tuple[str, ...]


def guides(outputs: Outputs) -> tuple[Guide, ...]:
    """Of the tree's joints those whose place is a function that switches with their coordinates."""
    return tuple(
        _guide(outputs, item.edge.name, item.edge.joint)
        for item in outputs.system.tree_joints
        if not isinstance(item.edge.joint, AbstractStepJoint) and _switches(item.edge.joint)
    )


def _switches(joint: AbstractJoint) -> bool:
    q = joint.q.sx
    if not q.numel():
        return False
    place = symbolic(joint.pose(q, ca.SX.sym("t")).position)
    return any(ca.depends_on(found, q) for found in switches(place, {*COMPARED, *JUMPS, ca.OP_FABS}))


def _guide(outputs: Outputs, name: str, joint: AbstractJoint) -> Guide:
    q, v, t = joint.q.sx, joint.v.sx, ca.SX.sym("t")
    velocity = ca.jtimes(symbolic(joint.pose(q, t).position), q, joint.rates(q, v, t))
    seen = ca.substitute(velocity, t, outputs.system.t)
    called = outputs.name(joint.q)
    names = tuple(f"{called}[{k}]" for k in range(q.numel())) if q.numel() > 1 else (called,)
    return Guide(f"'{name}' ({joint.created_at})", outputs.resolve(seen), outputs.resolve(q), names)
