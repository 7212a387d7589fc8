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


def sketch_configuration(system: MechanicalSystem, parameters: ca.SX, values: np.ndarray) -> np.ndarray:
    """First guess for q (nq,), with these values (np,) of the parameters (np, 1)."""
    guess: list[float] = []
    for item in system.tree.joints:
        guess += sketched(item.edge, item.edge.joint, system.mechanism.groups, parameters, values)
    return np.array(guess)


def sketched(
    edge: Edge[AbstractConstraint], joint: AbstractJoint, groups: Sequence[Group], parameters: ca.SX, values: np.ndarray
) -> tuple[float, ...]:
    """Coordinates of a `joint`, which an edge holds: from the rough poses of bodies where both its ends have one, else the joint's own start."""
    found = drawn_coordinates(edge, joint, groups)
    if found.numel():
        if not found.is_constant():
            found = ca.substitute(found, parameters, ca.DM(values))
        if found.is_constant():
            return tuple(float(f) for f in np.array(ca.DM(ca.evalf(found))).ravel())
    return joint.start_q()


def drawn_coordinates(edge: Edge[AbstractConstraint], joint: AbstractJoint, groups: Sequence[Group]) -> ca.SX:
    """What rough poses say of the coordinates (n, 1) of a `joint`, where places and axes depend on parameters by these; empty where they say nothing."""
    a, b = groups[edge.a].sketch, groups[edge.b].sketch
    if edge.a == 0 or edge.b == 0:
        a = Pose.identity() if edge.a == 0 else a
        b = Pose.identity() if edge.b == 0 else b
    if a is None or b is None:
        return ca.SX(0, 1)
    mounting = Pose(joint.mounting(), np.zeros(3))
    X = (a @ edge.pose_a @ mounting).inverse() @ (b @ edge.pose_b @ mounting)
    found = joint.coordinates(symbols(X))
    return ca.SX(0, 1) if found is None else ca.densify(found)
