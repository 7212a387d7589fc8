"""How far positions are from the sketch, see `joint_distance`, and velocities from rest; made when first asked for, since most sketches are closed."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from acausal.loops.joint_distance import Differences, at_cut, in_tree, rates_at_cut
from acausal.parts.joint_coordinates import joint_coordinates
from acausal.reduce.reduce import ReducedSystem


@dataclass(frozen=True)
class Apart:
    """Differences between the positions y and the sketch `first`: of the joints of the tree, of those that close loops, of scalar positions.

    `drawn`: symbols of the sketch with closed loops.
    """

    system: ReducedSystem
    y: ca.SX
    first: ca.SX
    drawn: ca.SX

    @functools.cached_property
    def all(self) -> Differences:
        """In this order; turns of what gears hold are counted."""
        r = self.system
        counted = {s.element_hash() for s in ca.symvar(r.scalar.position)}
        joints = [c for item in r.tree_joints for c in joint_coordinates(item.edge.name, item.edge.joint, item.q.start)]
        joints = [replace(c, periodic=c.periodic and self.y[c.place.start].element_hash() not in counted) for c in joints]
        scalars = list(r.scalar_places[: r.scalar.positions])
        return Differences.joined([
            in_tree(joints, self.y, self.first),
            *(at_cut(loop, None, self.y, self.drawn) for loop in r.constraints.loops),
            Differences(self.y[scalars, :] - self.first[scalars, :], np.array(scalars, dtype=int)),
        ])  # fmt: skip

    def closed(self, data: np.ndarray) -> np.ndarray:
        """The sketch with closed loops, for the parameters at the end of the `data` of a search."""
        return self.system.q_start_at(data[data.size - self.system.p_values.size :])


@dataclass(frozen=True)
class Moving:
    """The velocities of all joints and scalar states from `y`, those of the tree's: of joints that close loops, too, so that it does not matter
    which ones do.
    """

    system: ReducedSystem
    y: ca.SX
    first: ca.SX
    drawn: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    @functools.cached_property
    def all(self) -> Differences:
        """As they are; those of the tree first."""
        r = self.system
        cuts = [rates_at_cut(loop, r.mechanics.kinematics) for loop in r.constraints.loops]
        return Differences.joined([Differences(self.y, np.arange(self.y.numel())), *cuts])

    def closed(self, data: np.ndarray) -> np.ndarray:
        """Nothing else is needed."""
        return np.zeros(0)
