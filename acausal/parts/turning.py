"""Which coordinates of a joint are turns: angles and quaternions, that have no length as a unit."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.joint import AbstractJoint
from acausal.parts.pose import symbolic


def turning(joint: AbstractJoint) -> np.ndarray:
    """(nq,), True where an entry of q turns frame_b against frame_a; where q has a unit, that says it."""
    size, told = joint.q.size, joint.turns()
    if told is not None:
        return np.array(told, dtype=bool)
    if joint.q.unit or isinstance(joint, AbstractElasticBody):
        return np.full(size, joint.q.is_angle)
    q = ca.SX.sym("q", size)
    R = ca.densify(symbolic(joint.pose(q, ca.SX.sym("t")).rotation))
    return np.array([ca.depends_on(R, q[i]) for i in range(size)], dtype=bool)


def all_turning(joints: Iterable[AbstractJoint]) -> np.ndarray:
    """The same of several joints, one after the other."""
    return np.concatenate([np.zeros(0, dtype=bool), *map(turning, joints)])
