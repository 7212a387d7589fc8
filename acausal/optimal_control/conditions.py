"""What holds at places of a motion: rows that do not follow from others."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from acausal.optimal_control.asked import AS_AT_START, GIVEN, Asked, Limits
from acausal.optimal_control.guess import closed
from acausal.optimal_control.layout import Layout, Rows, column_at, is_unknown
from acausal.optimal_control.separable import Term
from acausal.optimal_control.stage import Stage, independent_rows, independent_states

_CLEAR, _SAME = 1e-3, 1e-7
"""Of the largest slope of a vector's entries: what clearly changes, and what does not at all."""


def conditions(asked: Asked, layout: Layout, rows: Rows, w: np.ndarray, size: np.ndarray) -> list[Term]:
    """What holds at the start, at places of the path and at the end, without what follows from invariants and from one another."""
    stage, mesh = asked.stage, layout.mesh
    nx = stage.sizes[0]
    terms: list[Term] = []
    fixed = np.zeros(nx, dtype=bool) if asked.start is None else np.isfinite(asked.start)
    first = np.concatenate([w[:nx], np.zeros(stage.width - nx), w[layout.extra]])
    if not fixed.all() and stage.invariants[0].numel():
        used = independent_rows(stage.slopes_of(stage.closing, first, 0.0)[:, ~fixed])
        if used:
            number = [rows.add(0.0, 0.0, "closed loops", 0.0) for _ in used]
            terms.append(column_at(layout, 0, stage.put(stage.invariants[0][list(used)]), number))
    at_node: dict[int, list[tuple[float, Limits]]] = {}
    for at, limits in asked.here:
        at_node.setdefault(int(np.argmin(np.abs(mesh.nodes - at))), []).append((at, limits))
    for k, said in at_node.items():
        node = layout.node(k)
        z, much = np.where(node >= 0, w[node], 0.0), np.where(node >= 0, size[node], 1.0)
        needed = _not_following(stage, said, z, much, fixed if k == 0 else np.zeros(nx, dtype=bool))
        for (at, limits), own in zip(said, needed, strict=True):
            if own:
                number = [rows.add(limits.lower[r], limits.upper[r], limits.name, at) for r in own]
                terms.append(column_at(layout, k, stage.put(limits.value)[own], number))
    if asked.periodic is None or not np.isfinite(asked.periodic).all():
        terms += _path_at_start(asked, layout, rows, fixed)
    if asked.periodic is not None:
        turned = [int(i) for i in np.flatnonzero(np.nan_to_num(asked.periodic))]
        kept, _ = independent_states(stage, first, 0.0, np.ones(stage.width), turned)
        end = layout.node(mesh.intervals)
        for i in kept:
            if np.isfinite(asked.periodic[i]):
                row = rows.add(asked.periodic[i], asked.periodic[i], f"{AS_AT_START}{stage.functions.state_names[i]}", 1.0)
                rows.linear += [(row, int(end[i]), 1.0), (row, i, -1.0)]
    return terms


def _path_at_start(asked: Asked, layout: Layout, rows: Rows, fixed: np.ndarray) -> list[Term]:
    """Of what is bounded all the time that which is known by states alone, where these are free: the first point of an interval comes later."""
    stage, terms = asked.stage, list[Term]()
    nx = stage.sizes[0]
    here = {k for k in range(nx) if not fixed[k]} | set(range(stage.width + 1, stage.width + 1 + len(stage.free)))
    known = {*range(nx), *here, stage.width}
    for limits in asked.path:
        value = stage.put(limits.value)
        for r in range(value.numel()):
            used = set(stage.used([value[r]]))
            if not is_unknown(stage, limits.value[r]) and used & here and used <= known:
                number = [rows.add(limits.lower[r], limits.upper[r], limits.name, 0.0)]
                terms.append(column_at(layout, 0, value[r], number))
    return terms


def beside(stage: Stage, z: np.ndarray, much: np.ndarray, at: float) -> np.ndarray:
    """A point a little away from `z` with its loops closed: at rest, stretched or straight up slopes vanish that do not elsewhere."""
    nx, moved = stage.sizes[0], z + 0.03 * much * np.random.default_rng(0).uniform(-1, 1, z.size)
    moved[nx:] = z[nx:]
    moved[:nx] = closed(stage, moved[None, :nx], np.array([at]), z[stage.width], z[stage.width + 1 :], much[:nx])[0]
    return moved


def _not_following(
    stage: Stage, said: Sequence[tuple[float, Limits]], z: np.ndarray, much: np.ndarray, fixed: np.ndarray
) -> list[list[int]]:
    """Rows of each of these conditions that invariants and other rows do not imply, the best conditioned ones; bounds that leave room are all kept."""
    free = np.append(~fixed, np.ones(z.size - fixed.size, dtype=bool))
    needed: list[list[int]] = [[] for _ in said]
    equal = [np.flatnonzero(limits.lower == limits.upper) for _, limits in said]
    for there, least in ((z, _CLEAR), (beside(stage, z, much, said[0][0]), _SAME)):
        known = (
            np.pad(stage.slopes_of(stage.closing, there, said[0][0]), ((0, 0), (0, z.size - fixed.size)))[:, free] * much[free]
        )
        slopes = [_slopes(stage, limits, there, at)[:, free] * much[free] for at, limits in said]
        for c, (_, limits) in enumerate(said):
            if limits.name == GIVEN and there is z:
                needed[c] = given_rows(limits, slopes[c], known)
            room = (limits.lower < limits.upper) & slopes[c].any(axis=1) & (limits.name != GIVEN)
            needed[c] = sorted({*needed[c], *np.flatnonzero(room).tolist()})
        had = [_unit(slopes[c][r]) for c, (_, limits) in enumerate(said) for r in needed[c] if limits.lower[r] == limits.upper[r]]
        size = [np.max(np.linalg.norm(own, axis=1), initial=0.0) or 1.0 for own in slopes]
        wanted = [
            (c, r) for c, (_, limits) in enumerate(said) if limits.name != GIVEN for r in equal[c].tolist() if r not in needed[c]
        ]
        for k in _independent([*map(_unit, known), *had], [slopes[c][r] / size[c] for c, r in wanted], least):
            needed[wanted[k][0]].append(wanted[k][1])
    return [sorted(own) for own in needed]


def _slopes(stage: Stage, limits: Limits, z: np.ndarray, at: float) -> np.ndarray:
    value = stage.put(limits.value)
    slope = ca.Function("slope", [stage.unknowns, stage.data], [ca.densify(ca.jacobian(value, stage.unknowns))])
    return np.array(slope(z, [at, 0.0])).reshape(value.numel(), -1)


def given_rows(limits: Limits, own: np.ndarray, known: np.ndarray) -> list[int]:
    """Of what is given at the start: all else is as at the guess where nothing is said of it; what leaves room there says something."""
    basis, needed = [*map(_unit, known)], list[int]()
    for r, row in enumerate(own):
        if limits.lower[r] < limits.upper[r] or _independent(basis, [_unit(row)], 1e-6):
            needed.append(r)
            basis.append(_unit(row))
    return needed


def _unit(row: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(row))
    return row / length if length > 0 else row


def _independent(basis: Sequence[np.ndarray], rows: Sequence[np.ndarray], least: float) -> list[int]:
    """Numbers of rows that are not combinations of the basis and of one another by more than `least`, the farthest from these first."""
    if not rows:
        return []
    rest, found = np.array(rows), list[int]()
    if basis:
        _, s, V = np.linalg.svd(np.array(basis), full_matrices=False)
        V = V[s > 1e-9 * np.max(s, initial=0.0)]
        rest = rest - rest @ V.T @ V
    while True:
        length = np.linalg.norm(rest, axis=1)
        k = int(np.argmax(length))
        if length[k] <= least:
            return found
        found.append(k)
        rest = rest - np.outer(rest @ rest[k], rest[k]) / length[k] ** 2
        rest[k] = 0.0
