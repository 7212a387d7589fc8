"""How far configurations are apart: over the coordinates of all joints, also of those that close loops.

Angles and turns count as they are, the shortest way round, lengths as parts of the loop's own size. So it does not matter which joints
close the loops, nor in which units or where the mechanism is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.kinematics import Kinematics
from acausal.loops.loops import LoopRows
from acausal.parts.joint import AbstractJoint
from acausal.parts.joint_coordinates import Coordinate, joint_coordinates

_TURN, _LOOP = -1, -2


@dataclass(frozen=True)
class Differences:
    """Rows (k, 1) that are zero at the sketch, and what measures each: nothing (turns), an unknown of this place, or the loops."""

    rows: ca.SX
    measured_by: np.ndarray

    @staticmethod
    def joined(parts: Sequence[Differences]) -> Differences:
        """One after the other."""
        measures = [np.zeros(0, dtype=int), *(part.measured_by for part in parts)]
        return Differences(ca.vertcat(ca.SX(0, 1), *(part.rows for part in parts)), np.concatenate(measures))

    def of(self, y: ca.SX) -> Differences:
        """Those that depend on some of y."""
        if not self.rows.numel() or not y.numel():
            return Differences(ca.SX(0, 1), self.measured_by[:0])
        kept = sorted(set(ca.jacobian_sparsity(self.rows, y).get_triplet()[0]))
        return Differences(self.rows[kept, :], self.measured_by[kept])

    def sizes(self, unknowns: np.ndarray, loop: float, turn: float = 1.0) -> np.ndarray:
        """What is much for each row (k,), for unknowns of these sizes, loops of this one, and turns, or rates of these."""
        own = unknowns[np.maximum(self.measured_by, 0)] if unknowns.size else np.ones(self.measured_by.size)
        return np.where(self.measured_by == _TURN, turn, np.where(self.measured_by == _LOOP, loop, own))


def in_tree(all: Sequence[Coordinate], y: ca.SX, sketch: ca.SX) -> Differences:
    """Of coordinates that are among y."""
    found = [(c, c.difference(sketch, y)) for c in all]
    return Differences.joined([Differences(d, np.full(d.numel(), _TURN if c.turns else c.place.start)) for c, d in found])


def at_cut(loop: LoopRows, drawn: ca.SX | None, y: ca.SX, sketch: ca.SX) -> Differences:
    """Of the coordinates that a cut joint would have, from those that are `drawn`, or else from those at the sketch of y.

    None where the joint has no closed form for them.
    """
    joint = loop.edge.joint
    if not isinstance(joint, AbstractJoint):
        return Differences.joined([])
    values = joint.coordinates(loop.pose)
    if values is None:
        return Differences.joined([])
    values = ca.densify(values)
    at = ca.substitute(values, y, sketch) if drawn is None else drawn
    found = [(c, c.difference(at, values)) for c in joint_coordinates(loop.edge.name, joint)]
    return Differences.joined([Differences(d, np.full(d.numel(), _TURN if c.turns else _LOOP)) for c, d in found])


def rates_at_cut(loop: LoopRows, kinematics: Kinematics) -> Differences:
    """Of the same coordinates, their rates."""
    joint = loop.edge.joint
    values = joint.coordinates(loop.pose) if isinstance(joint, AbstractJoint) else None
    if values is None or not isinstance(joint, AbstractJoint):
        return Differences.joined([])
    values = ca.densify(values)
    here = ca.SX.sym("here", values.numel())
    found = at_cut(loop, here, ca.SX(0, 1), ca.SX(0, 1))
    return Differences(ca.substitute(kinematics.rate(found.rows), here, values), found.measured_by)
