"""Motions of the tree that meet no inertia, though closed loops may give them one: a massless link, a thin rod between ball joints.

There articulated bodies would divide by zero. A rotor is put on such a joint, so that M becomes M + E'dE, and is taken away again
exactly when the loops are closed: with multipliers mu = d E v',

    [ A W A'   A W E'         ] [lambda]   [ -bias - A v'_free ]
    [ E W A'   E W E' - 1 / d ] [  mu  ] = [ -E v'_free        ],    W = (M + E'dE)^-1.

The matrix is quasi-definite exactly where the constrained system has one acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from acausal.mechanics.inertia import skew
from acausal.mechanics.pose import symbolic
from acausal.mechanics.tree import Tree

_LOST = 1e-9
"""Of what a motion would meet if all joints behind it were locked."""
_ROUNDING = 1e-13
"""Of the inertia behind a joint about all axes."""


def massless_motions(tree: Tree, parameters: ca.SX, samples: Sequence[np.ndarray], values: np.ndarray) -> dict[int, float]:
    """Links whose motion meets no inertia at one of the configurations `samples` (nq,), each with the rotor d to put there.

    d [kg m^2, or kg] has the size of the largest inertia of its kind in the tree. Cost: one elimination of articulated bodies in
    numbers for each sample.
    """
    data = _link_data(tree, parameters)
    found: dict[int, float] = {}
    for q in samples:
        found |= _rotors(tree, [np.array(part) for part in data.call([ca.DM(q), ca.DM(0.0), ca.DM(values)])])
    return found


def _link_data(tree: Tree, parameters: ca.SX) -> ca.Function:
    """(q, t, p) -> for each link X (6, 6) that carries its parent's acceleration to it, its motion subspace, its inertia (6, 6)."""
    parts: list[ca.SX] = []
    for link in tree.links:
        pose = link.offset @ link.motion.pose
        R, p = symbolic(pose.rotation), symbolic(pose.position)
        X = ca.blockcat([[R.T, ca.SX.zeros(3, 3)], [-(R.T @ ca.skew(p)), R.T]])
        H = symbolic(skew(link.inertia.moment))
        inertia = ca.blockcat([[symbolic(link.inertia.second_moment), H], [H.T, ca.SX(link.inertia.mass) * ca.SX.eye(3)]])
        parts += [ca.densify(X), ca.densify(link.motion.subspace), ca.densify(inertia)]
    return ca.Function("links", [tree.q, tree.t, parameters], parts)


def _rotors(tree: Tree, data: Sequence[np.ndarray]) -> dict[int, float]:
    X, subspaces, inertias = data[0::3], data[1::3], data[2::3]
    rigid = [inertia.copy() for inertia in inertias]
    children = [(i, link.parent) for i, link in enumerate(tree.links) if link.parent >= 0]
    for i, parent in reversed(children):
        rigid[parent] += X[i].T @ rigid[i] @ X[i]
    turning, sliding = (max(float(np.trace(inertia[k, k])) / 3 for inertia in rigid) for k in (slice(0, 3), slice(3, 6)))
    felt = [inertia.copy() for inertia in inertias]
    found: dict[int, float] = {}
    for i in reversed(range(len(tree.links))):
        S, parent = subspaces[i], tree.links[i].parent
        if S.shape[1]:
            D = S.T @ felt[i] @ S
            locked = float(np.linalg.eigvalsh(S.T @ rigid[i] @ S)[0])
            spins, slides = float(np.linalg.norm(S[:3])) ** 2, float(np.linalg.norm(S[3:])) ** 2
            around = spins * np.trace(rigid[i][:3, :3]) + slides * rigid[i][5, 5]
            if np.linalg.eigvalsh(D)[0] <= max(_LOST * locked, _ROUNDING * around):
                found[i] = spins * turning + slides * sliding or 1.0
                D = D + found[i] * np.eye(len(D))
            U = felt[i] @ S
            felt[i] = felt[i] - U @ np.linalg.solve(D, U.T)
        if parent >= 0:
            felt[parent] += X[i].T @ felt[i] @ X[i]
    return found
