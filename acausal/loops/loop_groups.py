"""Loops that share joints belong together; other loops are closed and examined on their own, so that the cost of many is linear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.dynamics.tree import JointSymbols
from acausal.graphs import Graph
from acausal.loops.loops import LoopRows
from acausal.loops.sketch import drawn_coordinates
from acausal.numerics.sizes import Drawn
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.joint import AbstractJoint
from acausal.parts.turning import all_turning


@dataclass(frozen=True)
class LoopGroup:
    """Loops and the joints of the tree that move them, or a joint in no loop; `q`, `v` and q' = `rates` of these joints.

    `q_places` and `v_places`: where they stand among those of the tree. `invariants` of the joints, and their `domain` (positive inside). `sketch`: what
    coordinates are drawn as, in parameters.
    """

    loops: tuple[LoopRows, ...]
    joints: tuple[JointSymbols, ...]
    q: ca.SX
    v: ca.SX
    rates: ca.SX
    q_places: tuple[int, ...]
    v_places: tuple[int, ...]
    invariants: ca.SX
    domain: ca.SX
    sketch: ca.SX
    turning: np.ndarray
    """(nq,), True for angles and quaternions."""

    @property
    def elastic(self) -> list[int]:
        """Places in q of how much bodies are deformed."""
        deforms = [
            isinstance(joint.edge.joint, AbstractElasticBody) for joint in self.joints for _ in range(joint.q.start, joint.q.stop)
        ]
        return [k for k, elastic in enumerate(deforms) if elastic]

    @property
    def is_bound(self) -> bool:
        """Whether anything is asked of its coordinates."""
        return bool(self.names or self.invariants.numel() or self.domain.numel())

    @property
    def names(self) -> tuple[str, ...]:
        """Of the rows that do not vanish by structure."""
        return tuple(name for rows in self.loops for name in rows.names)

    @property
    def drawn(self) -> Drawn:
        """How well the rows of `closing` are known."""
        return drawn(self.invariants.numel(), self.loops)

    @property
    def closing(self) -> ca.SX:
        """Invariants of joints, then positions of loops (n, 1)."""
        return ca.vertcat(self.invariants, *(rows.position for rows in self.loops))

    @property
    def velocity(self) -> ca.SX:
        """Rows of the loops in the velocities (m, 1)."""
        return ca.vertcat(ca.SX(0, 1), *(rows.velocity for rows in self.loops))


def drawn(before: int, loops: Sequence[LoopRows], after: int = 0) -> Drawn:
    """How well position rows of loops are known, with some rows `before` and `after` that are known exactly."""
    own = [rows.drawn.of(range(rows.position.numel())) for rows in loops]
    return Drawn.joined([Drawn.exact(before), *own, Drawn.exact(after)])


def loop_groups(system: MechanicalSystem, loops: Sequence[LoopRows]) -> tuple[LoopGroup, ...]:
    """All joints of the tree and all loops; groups in the order of their first loop, those without loops last. Linear in the size."""
    tree = system.tree
    owner: dict[int, int] = {}
    for k, joint in enumerate(tree.joints):
        for column, places in ((tree.q, joint.q), (tree.v, joint.v)):
            owner |= {column[i].element_hash(): k for i in range(places.start, places.stop)}
    edges: list[tuple[tuple[str, int], tuple[str, int]]] = []
    for i, rows in enumerate(loops):
        used = {s.element_hash() for s in ca.symvar(ca.vertcat(rows.position, rows.velocity))}
        edges += [(("loop", i), ("joint", owner[h])) for h in used if h in owner]
    nodes = [*(("joint", k) for k in range(len(tree.joints))), *(("loop", i) for i in range(len(loops)))]
    parts = [sorted(part) for part in Graph(nodes, edges).parts()]
    parts.sort(key=lambda part: min((i for kind, i in part if kind == "loop"), default=len(loops)))
    return tuple(
        _group(
            system,
            tuple(loops[i] for kind, i in part if kind == "loop"),
            [tree.joints[k] for kind, k in part if kind == "joint"],
        )
        for part in parts
    )


def _group(system: MechanicalSystem, loops: tuple[LoopRows, ...], joints: Sequence[JointSymbols]) -> LoopGroup:
    tree = system.tree
    q_places = [i for joint in joints for i in range(joint.q.start, joint.q.stop)]
    v_places = [i for joint in joints for i in range(joint.v.start, joint.v.stop)]
    none, edges = ca.SX(0, 1), [*(joint.edge for joint in joints), *(rows.edge for rows in loops)]
    return LoopGroup(
        loops, tuple(joints), tree.q[q_places], tree.v[v_places], tree.rates[q_places], tuple(q_places), tuple(v_places),
        ca.vertcat(none, *(j.edge.joint.invariants(tree.q[j.q], tree.t) for j in joints)),
        ca.vertcat(none, *(j.edge.joint.domain(tree.q[j.q]) for j in joints)),
        ca.vertcat(none, *(drawn_coordinates(edge, edge.joint, system.mechanism.groups) for edge in edges if isinstance(edge.joint, AbstractJoint))),
        all_turning(j.edge.joint for j in joints),
    )  # fmt: skip
