"""The sketch in coordinates of joints: from rough poses of bodies, or from where joints begin."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import Pose, symbols
from acausal.topology.mechanism import Edge, Group


def sketch_configuration(system: MechanicalSystem) -> np.ndarray:
    """First guess for q (nq,)."""
    guess: list[float] = []
    for item in system.tree.joints:
        guess += sketched(item.edge, item.edge.joint, system.mechanism.groups)
    return np.array(guess)


def sketched(edge: Edge[AbstractConstraint], joint: AbstractJoint, groups: Sequence[Group]) -> tuple[float, ...]:
    """Coordinates of a `joint`, which an edge holds: from the rough poses of bodies where both its ends have one, else the joint's own start."""
    a, b = groups[edge.a].sketch, groups[edge.b].sketch
    if edge.a == 0 or edge.b == 0:
        a = Pose.identity() if edge.a == 0 else a
        b = Pose.identity() if edge.b == 0 else b
    if a is not None and b is not None:
        mounting = Pose(joint.mounting(), np.zeros(3))
        X = (a @ edge.pose_a @ mounting).inverse() @ (b @ edge.pose_b @ mounting)
        found = joint.coordinates(symbols(X))
        if found is not None and ca.densify(found).is_constant():
            return tuple(float(f) for f in np.array(ca.DM(ca.evalf(found))).ravel())
    return joint.start_q()
