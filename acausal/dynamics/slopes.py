"""How far joints move by their coordinates: curves and surfaces may have parameters that are neither lengths nor angles."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.dynamics.tree import Tree
from acausal.numerics.sizes import positive
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.pose import symbolic


def slopes_of_places(tree: Tree, parameters: ca.SX, q: np.ndarray, values: np.ndarray, time: float = 0.0) -> np.ndarray:
    """By how much places change with each entry of q (nq,), in metres, where it has no unit and turns nothing; 1 for lengths and turns."""
    found = np.ones(q.size)
    plain = [j for j in tree.joints if not j.edge.joint.q.unit and not isinstance(j.edge.joint, AbstractElasticBody)]
    plain = [j for j in plain if not tree.turning[0][j.q].all()]
    if not plain:
        return found
    slopes: list[ca.SX] = []
    for joint in plain:
        at = tree.q[joint.q]
        J = ca.jacobian(symbolic(joint.edge.joint.pose(at, tree.t).position), at)
        slopes.append(ca.sqrt(ca.sum1(J * J)).T)
    of = ca.Function("slopes", [tree.q, tree.t, parameters], [ca.densify(ca.vertcat(*slopes))])
    places = [i for joint in plain for i in range(joint.q.start, joint.q.stop)]
    found[places] = positive(np.array(of(q, time, values)).ravel())
    return np.where(tree.turning[0], 1.0, found)
