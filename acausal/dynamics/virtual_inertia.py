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

from acausal.dynamics.forward_dynamics import massless, own_inertia
from acausal.dynamics.tree import Tree
from acausal.numerics.sizes import positive
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.inertia import Inertia, skew
from acausal.parts.pose import symbolic

_LOST = 1e-9
"""Of what a motion would meet if all joints behind it were locked."""
_ROUNDING = 1e-13
"""Of the inertia behind a joint about all axes."""
_MOST_LINKS = 300


def massless_motions(tree: Tree, parameters: ca.SX, samples: Sequence[np.ndarray], values: np.ndarray) -> dict[int, float]:
    """Links whose motion meets no inertia at one of the configurations `samples` (nq,), each with the rotor d to put there.

    d [kg m^2, or kg] has the size of the largest inertia of its kind in the tree. Cost: one elimination of articulated bodies in
    numbers for each sample.
    """
    data, shapes = _link_data(tree, parameters)
    ends = np.cumsum([m * n for m, n in shapes])[:-1]
    found: dict[int, float] = {}
    for q in samples:
        parts = np.split(np.array(data(q, 0.0, values)).ravel(), ends)
        found |= _rotors(tree, [part.reshape(shape, order="F") for part, shape in zip(parts, shapes, strict=True)])
    return found


def check_tree_inertia(tree: Tree, parameters: ca.SX, q: np.ndarray, values: np.ndarray) -> None:
    """Raise `MasslessError` for a motion that meets no inertia wherever it is, as a point mass on a line through a ball joint.

    What is zero by structure is found without this. Looks at two places beside q (nq,), only where there are points, thin rods or
    elastic bodies: undeformed, they may be thin, or have a joint's motion among their shapes.
    """
    elastic = [joint.q for joint in tree.joints if isinstance(joint.edge.joint, AbstractElasticBody)]
    if len(tree.links) > _MOST_LINKS or not (elastic or any(_is_thin(group.inertia) for group in tree.mechanism.groups)):
        return
    rng, much = np.random.default_rng(6), _sizes(tree, parameters, q, values)
    places = [q + 0.3 * much * rng.uniform(-1, 1, q.size) for _ in range(2)]
    for place, amplitudes in ((place, part) for place in places for part in elastic):
        place[amplitudes] = 0.0
    one, two = (massless_motions(tree, parameters, [place], values) for place in places)
    for i in sorted(one.keys() & two.keys()):
        raise massless(tree.links[i])


def _sizes(tree: Tree, parameters: ca.SX, q: np.ndarray, values: np.ndarray) -> np.ndarray:
    """What is much for each entry of q (nq,): 1 for turns, else a length near the joint; 1 where there is none in the whole tree."""
    turns, much = tree.turning[0], np.ones(q.size)
    if turns.all():
        return much
    near = [ca.norm_2(symbolic(link.offset.position)) for link in tree.links]
    # radii of gyration, squared; where there is no mass 0 / 0
    wide = [ca.SX(ca.trace(symbolic(link.inertia.second_moment))) / link.inertia.mass for link in tree.links]
    offsets, spread = (
        np.nan_to_num(np.array(part).ravel(), posinf=0.0)
        for part in ca.Function("near", [tree.q, tree.t, parameters], [ca.vertcat(*near), ca.vertcat(*wide)])(q, 0.0, values)
    )
    own = np.maximum(offsets, np.sqrt(np.maximum(spread, 0.0)))
    around = own.copy()
    for i, link in enumerate(tree.links):
        if link.parent >= 0:
            around[i], around[link.parent] = max(around[i], own[link.parent]), max(around[link.parent], own[i])
    around = positive(np.where(around > 0, around, np.max(own, initial=0.0)))
    for joint in tree.joints:
        much[joint.q] = np.where(turns[joint.q], 1.0, around[joint.link])
    return much


def _is_thin(inertia: Inertia) -> bool:
    """Whether its moment of inertia vanishes about some axis through the centre of mass; unknown for adjustable ones: no."""
    if not (isinstance(inertia.mass, float) and isinstance(inertia.moment, np.ndarray)) or not inertia.mass:
        return False
    second, c = inertia.second_moment, inertia.moment / inertia.mass
    if not isinstance(second, np.ndarray):
        return False
    levels = np.linalg.eigvalsh(second - inertia.mass * (c @ c * np.eye(3) - np.outer(c, c)))
    return bool(levels[0] <= 1e-12 * max(np.trace(second), 1e-300))


def _link_data(tree: Tree, parameters: ca.SX) -> tuple[ca.Function, list[tuple[int, int]]]:
    """(q, t, p) -> for each link X (6, 6) that carries its parent's acceleration to it, its motion subspace, its inertia (6, 6), and
    what its motion meets besides: (6, n), (n, n); all in one column, with the shapes of its parts.
    """
    parts: list[ca.SX] = []
    for link in tree.links:
        pose = link.offset @ link.motion.pose
        R, p = symbolic(pose.rotation), symbolic(pose.position)
        X = ca.blockcat([[R.T, ca.SX.zeros(3, 3)], [-(R.T @ ca.skew(p)), R.T]])
        H = symbolic(skew(link.inertia.moment))
        inertia = ca.blockcat([[symbolic(link.inertia.second_moment), H], [H.T, ca.SX(link.inertia.mass) * ca.SX.eye(3)]])
        parts += [ca.densify(part) for part in (X, link.motion.subspace, inertia, *own_inertia(link, 0.0))]
    column = ca.vertcat(ca.SX(0, 1), *(ca.vec(part) for part in parts))
    return ca.Function("links", [tree.q, tree.t, parameters], [column]), [part.shape for part in parts]


def _rotors(tree: Tree, data: Sequence[np.ndarray]) -> dict[int, float]:
    X, subspaces, inertias, couplings, own = (data[k::5] for k in range(5))
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
            D = S.T @ felt[i] @ S + own[i]
            locked = float(np.linalg.eigvalsh(S.T @ rigid[i] @ S)[0])
            spins, slides = float(np.linalg.norm(S[:3])) ** 2, float(np.linalg.norm(S[3:])) ** 2
            around = spins * np.trace(rigid[i][:3, :3]) + slides * rigid[i][5, 5]
            if tree.links[i].modal is None and np.linalg.eigvalsh(D)[0] <= max(_LOST * locked, _ROUNDING * around):
                found[i] = spins * turning + slides * sliding or 1.0
                D = D + found[i] * np.eye(len(D))
            U = felt[i] @ S + couplings[i]
            felt[i] = felt[i] - U @ np.linalg.solve(D, U.T)
        if parent >= 0:
            felt[parent] += X[i].T @ felt[i] @ X[i]
    return found
