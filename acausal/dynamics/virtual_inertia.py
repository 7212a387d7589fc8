"""Motions of the tree that meet no inertia, or hardly any, though closed loops give them one: a massless link, a dusty crank, a thin
rod between ball joints.

There articulated bodies would divide by zero, and A M^-1 A' be made of numbers so large that what heavier links add to them is lost. A
rotor is put on such a joint, so that M becomes M + E'dE, and is taken away again exactly when the loops are closed: with multipliers
mu = d E v',

    [ A W A'   A W E'         ] [lambda]   [ -bias - A v'_free ]
    [ E W A'   E W E' - 1 / d ] [  mu  ] = [ -E v'_free        ],    W = (M + E'dE)^-1.

The matrix is quasi-definite exactly where the constrained system has one acceleration. With rotors of the size of what their joints meet
with closed loops, 1 / (M + E'dE) and 1 / d - E W_closed E' are known to rounding however little there is in the tree.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.forward_dynamics import massless, own_inertia
from acausal.dynamics.slopes import slopes_of_places
from acausal.dynamics.tree import Tree
from acausal.numerics.sizes import positive, power_of_four
from acausal.numerics.thresholds import RANK
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.inertia import Inertia, skew
from acausal.parts.pose import symbolic

_LOST = 1e-9
"""Of what a motion would meet if all joints behind it were locked."""
_ROUNDING = 1e-13
"""Of the inertia behind a joint about all axes."""
_LIGHT = 1e-3
"""Of what the others meet on which its loops also rest: this part of the digits is lost without a rotor."""
_FREE = 1e-10
"""Of the same: motions that loops do not make heavier than this have no inertia, or are light by themselves."""
_MOST_LINKS = 300


@dataclass(frozen=True)
class LoopMotions:
    """What loops ask of the velocities: their rows (m, nv) at each of some configurations, and how much each velocity is (nv,)."""

    jacobians: tuple[np.ndarray, ...]
    rates: np.ndarray
    singular: bool
    """Whether there are positions in which fewer links span the rows than elsewhere."""

    def parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Rows and velocities that belong together."""
        touched = np.any([A != 0 for A in self.jacobians], axis=0)
        left, found = set(range(touched.shape[0])), []
        while left:
            rows, columns = {left.pop()}, set[int]()
            new = set(rows)
            while new:
                columns |= {int(k) for r in new for k in np.flatnonzero(touched[r])}
                new = {int(r) for k in columns for r in np.flatnonzero(touched[:, k])} - rows
                rows |= new
            left -= rows
            found.append((np.array(sorted(rows)), np.array(sorted(columns), dtype=int)))
        return found


def virtual_rotors(
    tree: Tree, parameters: ca.SX, samples: Sequence[np.ndarray], loops: LoopMotions, values: np.ndarray
) -> dict[int, float]:
    """Links whose motion meets no inertia, or too little, at one of the configurations `samples` (nq,), each with the rotor d to put there.

    d [kg m^2, or kg] is what the motion meets with closed loops, or what those meet on which the loops also rest, if less. Cost: one
    elimination of articulated bodies in numbers for each sample, and some singular value decompositions for each group of loops.
    """
    found: dict[int, list[float]] = {}
    data = _link_data(tree, parameters)
    parts = [(rows, _of_whole_links(tree, columns)) for rows, columns in loops.parts()]
    for q, A in zip(samples, loops.jacobians, strict=True):
        met = _articulated(tree, _parts(data, q, values))
        wanted = {i: d for rows, columns in parts for i, d in _light(tree, met, A[np.ix_(rows, columns)], columns, loops)}
        wanted = {i: met.largest(i) for i in met.lost} | wanted
        for i, d in wanted.items():
            found.setdefault(i, []).append(d)
    return {i: float(power_of_four(float(np.median(found[i])))) for i in sorted(found)}


def check_tree_inertia(tree: Tree, parameters: ca.SX, q: np.ndarray, values: np.ndarray) -> None:
    """Raise `MasslessError` for a motion that meets no inertia wherever it is, as a point mass on a line through a ball joint.

    What is zero by structure is found without this. Looks at two places beside q (nq,), only where there are points, thin rods or
    elastic bodies: undeformed, they may be thin, or have a joint's motion among their shapes.
    """
    if not (_elastic(tree) or any(_is_thin(group.inertia) for group in tree.mechanism.groups)):
        return
    for i in TreeInertia(tree, parameters, q).massless(values):
        raise massless(tree.links[i])


@dataclass(frozen=True)
class TreeInertia:
    """What motions of the tree meet at any values of the `parameters` (np, 1), near a configuration q (nq,)."""

    tree: Tree
    parameters: ca.SX
    q: np.ndarray

    def massless(self, values: np.ndarray) -> tuple[int, ...]:
        """Links whose motion meets no inertia at two places beside q; none of very many links."""
        tree, q = self.tree, self.q
        if not 0 < len(tree.links) <= _MOST_LINKS:
            return ()
        rng, much = np.random.default_rng(6), _much(tree, self.parameters, self._near, q, values)
        places = [q + 0.3 * much * rng.uniform(-1, 1, q.size) for _ in range(2)]
        for place, amplitudes in ((place, part) for place in places for part in _elastic(tree)):
            place[amplitudes] = 0.0
        one, two = (_articulated(tree, _parts(self._data, place, values)).lost for place in places)
        return tuple(sorted(set(one) & set(two)))

    def depends_on(self, places: Sequence[int]) -> bool:
        """Whether the parameters at these places have to do with it."""
        return not self._used.isdisjoint(places)

    @functools.cached_property
    def _used(self) -> set[int]:
        """Places of the parameters that have to do with it."""
        by = self._data[0].jac_sparsity(0, 2) if self.parameters.numel() else ca.Sparsity(0, 0)
        return set(by.get_col())

    @functools.cached_property
    def _data(self) -> LinkData:
        return _link_data(self.tree, self.parameters)

    @functools.cached_property
    def _near(self) -> ca.Function:
        return _lengths(self.tree, self.parameters)


def _elastic(tree: Tree) -> list[slice]:
    """Places in q of amplitudes."""
    return [joint.q for joint in tree.joints if isinstance(joint.edge.joint, AbstractElasticBody)]


def _lengths(tree: Tree, parameters: ca.SX) -> ca.Function:
    """(q, t, p) -> distances of links from their parents, and their radii of gyration, squared; where there is no mass 0 / 0."""
    near = [ca.norm_2(symbolic(link.offset.position)) for link in tree.links]
    wide = [ca.SX(ca.trace(symbolic(link.inertia.second_moment))) / link.inertia.mass for link in tree.links]
    return ca.Function("near", [tree.q, tree.t, parameters], [ca.vertcat(ca.SX(0, 1), *near), ca.vertcat(ca.SX(0, 1), *wide)])


def _much(tree: Tree, parameters: ca.SX, lengths: ca.Function, q: np.ndarray, values: np.ndarray) -> np.ndarray:
    """What is much for each entry of q (nq,): 1 for turns, else a length near the joint; 1 where there is none in the whole tree."""
    turns, much = tree.turning[0], np.ones(q.size)
    if turns.all():
        return much
    offsets, spread = (np.nan_to_num(np.array(part).ravel(), posinf=0.0) for part in lengths(q, 0.0, values))
    own = np.maximum(offsets, np.sqrt(np.maximum(spread, 0.0)))
    around = own.copy()
    for i, link in enumerate(tree.links):
        if link.parent >= 0:
            around[i], around[link.parent] = max(around[i], own[link.parent]), max(around[link.parent], own[i])
    around = positive(np.where(around > 0, around, np.max(own, initial=0.0)))
    for joint in tree.joints:
        much[joint.q] = np.where(turns[joint.q], 1.0, around[joint.link])
    return much / slopes_of_places(tree, parameters, q, values)


def _is_thin(inertia: Inertia) -> bool:
    """Whether its moment of inertia vanishes about some axis through the centre of mass; unknown for adjustable ones: no."""
    if not (isinstance(inertia.mass, float) and isinstance(inertia.moment, np.ndarray)) or not inertia.mass:
        return False
    if not isinstance(central := inertia.central, np.ndarray):
        return False
    return bool(np.linalg.eigvalsh(central)[0] <= 1e-12 * max(float(np.trace(np.asarray(inertia.second_moment))), 1e-300))


LinkData = tuple[ca.Function, list[tuple[int, int]]]


def _link_data(tree: Tree, parameters: ca.SX) -> LinkData:
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


def _parts(data: LinkData, q: np.ndarray, values: np.ndarray) -> list[np.ndarray]:
    """These in numbers."""
    function, shapes = data
    parts = np.split(np.array(function(q, 0.0, values)).ravel(), np.cumsum([m * n for m, n in shapes])[:-1])
    return [part.reshape(shape, order="F") for part, shape in zip(parts, shapes, strict=True)]


@dataclass(frozen=True)
class _Met:
    """What the motion of each link meets, (n, n): `free` with all joints behind it free, and `locked`; X, S and what else it meets as in
    `_link_data`. `rigid` (6, 6): inertia of all that is behind a link. `lost`: links that meet nothing.
    """

    X: Sequence[np.ndarray]
    S: Sequence[np.ndarray]
    couplings: Sequence[np.ndarray]
    own: Sequence[np.ndarray]
    rigid: Sequence[np.ndarray]
    free: Sequence[np.ndarray]
    lost: tuple[int, ...]

    def largest(self, i: int) -> float:
        """The size of the largest inertia in the tree of the kind that link i's motion would meet."""
        turning, sliding = (max(float(np.trace(inertia[k, k])) / 3 for inertia in self.rigid) for k in (slice(0, 3), slice(3, 6)))
        S = self.S[i]
        return float(np.linalg.norm(S[:3])) ** 2 * turning + float(np.linalg.norm(S[3:])) ** 2 * sliding or 1.0


def _articulated(tree: Tree, data: Sequence[np.ndarray]) -> _Met:
    X, S, inertias, couplings, own = (data[k::5] for k in range(5))
    rigid = [inertia.copy() for inertia in inertias]
    for i, link in reversed(list(enumerate(tree.links))):
        if link.parent >= 0:
            rigid[link.parent] += X[i].T @ rigid[i] @ X[i]
    felt = [inertia.copy() for inertia in inertias]
    free = [np.zeros((0, 0))] * len(felt)
    lost: list[int] = []
    for i in reversed(range(len(tree.links))):
        link = tree.links[i]
        if S[i].shape[1]:
            D = free[i] = S[i].T @ felt[i] @ S[i] + own[i]
            locked = float(np.linalg.eigvalsh(S[i].T @ rigid[i] @ S[i])[0])
            spins, slides = float(np.linalg.norm(S[i][:3])) ** 2, float(np.linalg.norm(S[i][3:])) ** 2
            around = spins * np.trace(rigid[i][:3, :3]) + slides * rigid[i][5, 5]
            if link.modal is None and np.linalg.eigvalsh(D)[0] <= max(_LOST * locked, _ROUNDING * around):
                lost.append(i)
                D = D + (float(np.trace(D)) or 1.0) * np.eye(len(D))
            U = felt[i] @ S[i] + couplings[i]
            felt[i] = felt[i] - U @ np.linalg.solve(D, U.T)
        if link.parent >= 0:
            felt[link.parent] += X[i].T @ felt[i] @ X[i]
    return _Met(X, S, couplings, own, rigid, free, tuple(lost))


def _light(tree: Tree, met: _Met, A: np.ndarray, columns: np.ndarray, loops: LoopMotions) -> list[tuple[int, float]]:
    """Links of a group of loops, with rows A (m, n) in the velocities `columns` (n,), that need a rotor, and its size."""
    own, rates = _owners(tree, columns), loops.rates
    if not own:
        return []
    rate = {i: float(np.max(rates[columns[places]])) for i, places in own.items()}
    least = {i: 0.0 if i in met.lost else max(0.0, float(np.linalg.eigvalsh(met.free[i])[0])) * rate[i] ** 2 for i in own}
    most = max(least.values())
    light = [i for i in own if least[i] <= _LIGHT * most and tree.links[i].modal is None]
    if not light or most == 0.0:
        return []
    A = A * rates[columns]
    A = A / np.where((length := np.linalg.norm(A, axis=1)) > 0, length, 1.0)[:, None]
    closed = _closed_response(A, _inertia(tree, met, own) * np.outer(rates[columns], rates[columns]))
    found: list[tuple[int, float]] = []
    for i in light:
        enough = most if loops.singular else _spanning(A, own, least, i)
        if enough == 0.0 and i not in met.lost:
            continue
        response = float(np.linalg.eigvalsh(closed[np.ix_(own[i], own[i])])[-1])
        d = min(1 / response if response > 0 else np.inf, enough or np.inf)
        if max(least[i] / _LIGHT, _FREE * (enough or most)) < d < np.inf:
            found.append((i, d / rate[i] ** 2))
    return found


def _of_whole_links(tree: Tree, columns: np.ndarray) -> np.ndarray:
    """All velocities of the links that some velocities move."""
    moved = [np.arange(v.start, v.stop) for i in _moved(tree, columns) for v in (tree.links[i].v,)]
    return np.concatenate(moved) if moved else columns


def _owners(tree: Tree, columns: np.ndarray) -> dict[int, np.ndarray]:
    """Links that some velocities move, parents first, and the places of these among `columns`."""
    place = {int(k): n for n, k in enumerate(columns)}
    return {
        i: np.array([place[k] for k in range(v.start, v.stop) if k in place])
        for i in _moved(tree, columns)
        for v in (tree.links[i].v,)
    }


def _moved(tree: Tree, columns: np.ndarray) -> list[int]:
    """The links that some velocities move, parents first."""
    return sorted({tree.owners[int(k)] for k in columns})


def _spanning(A: np.ndarray, own: Mapping[int, np.ndarray], least: Mapping[int, float], i: int) -> float:
    """The inertia of the last one of the links, lightest first, that are needed to span the rows that link i moves; 0 if those about as
    light as it is do.
    """
    rows = A[np.any(A[:, own[i]] != 0, axis=1)]
    rank, order = _rank(rows), sorted(own, key=lambda j: least[j])
    for n, j in enumerate(order, start=1):
        if _rank(rows[:, np.concatenate([own[k] for k in order[:n]])]) >= rank:
            return least[j] if least[i] < _LIGHT * least[j] else 0.0
    return 0.0


def _rank(A: np.ndarray) -> int:
    return int(np.sum(np.linalg.svd(A, compute_uv=False) > RANK))


def _closed_response(A: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Accelerations (n, n) by unit forces where A v' = 0, finite where motions meet no inertia M (n, n)."""
    _, s, Vt = np.linalg.svd(A)
    Z = Vt[int(np.sum(s > RANK)) :].T
    levels, axes = np.linalg.eigh(Z.T @ M @ Z)
    Z = Z @ axes
    return (Z / np.maximum(levels, _ROUNDING * np.max(levels, initial=1e-300))) @ Z.T


def _inertia(tree: Tree, met: _Met, own: Mapping[int, np.ndarray]) -> np.ndarray:
    """M (n, n) of some velocities, all others zero: composite rigid bodies."""
    n = sum(len(places) for places in own.values())
    M = np.zeros((n, n))
    for i, places in own.items():
        force = met.rigid[i] @ met.S[i] + met.couplings[i]
        M[np.ix_(places, places)] = met.S[i].T @ met.rigid[i] @ met.S[i] + met.own[i]
        while i >= min(own):
            force = met.X[i].T @ force
            i = tree.links[i].parent
            if i in own:
                M[np.ix_(own[i], places)] = met.S[i].T @ force
                M[np.ix_(places, own[i])] = M[np.ix_(own[i], places)].T
    return M
