"""From a problem in the user's words to a nonlinear program: direct collocation in residual form.

At each point of the mesh stand states, accelerations, multipliers and inputs. Only independent coordinates and velocities are collocated, chosen for each
interval by the conditioning of its loops; all others follow from the invariants, which hold at each point: loops cannot drift open, and nothing is
asked twice.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.folding import folded_function
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.mesh import Mesh
from acausal.optimal_control.separable import COST, NOWHERE, Program, Term
from acausal.optimal_control.stage import Stage, independent_rows, independent_states


@dataclass(frozen=True, eq=False)
class Limits:
    """`value` (n, 1) of a stage's unknowns, between `lower` and `upper` (n,); `name`: what it is, in words."""

    value: ca.SX
    lower: np.ndarray
    upper: np.ndarray
    name: str


@dataclass(frozen=True, eq=False)
class Asked:
    """A problem, by unknowns of a `stage`. `path`: at every point; `here`: at parts of the duration; `start` (nx,): all states, NaN what is open;
    `integrals`, `averages`, `starts`, `ends`: sums of what is minimised, with `per_second` times the duration. `periodic`: by what the states
    (nx,) are more at the end than at the start, NaN what is open. `held`: inputs are constant in each interval. `duration` and `geometry`:
    (2,) and (free parameters, 2) bounds.
    """

    stage: Stage
    path: Sequence[Limits]
    here: Sequence[tuple[float, Limits]]
    start: np.ndarray | None
    periodic: np.ndarray | None
    integrals: ca.SX
    averages: ca.SX
    starts: ca.SX
    ends: ca.SX
    per_second: float
    held: bool
    duration: np.ndarray
    geometry: np.ndarray


@dataclass(frozen=True, eq=False)
class Transcribed:
    """A `program` in unknowns of size 1: those of the motion are `units` (n,) times them. `labels`: of each row what it is, and where: a part of the
    duration.
    """

    asked: Asked
    mesh: Mesh
    program: Program
    units: np.ndarray
    places: np.ndarray
    labels: list[tuple[str, float]]

    @functools.cached_property
    def layout(self) -> Layout:
        """Where unknowns stand."""
        return Layout(self.asked.stage, self.mesh, self.asked.held)

    def motion(self, w: np.ndarray) -> Guess:
        """What the unknowns of the program say of the motion."""
        stage, full = self.asked.stage, w * self.units
        values = full[self.places]
        nx = stage.sizes[0]
        first = np.append(full[:nx], values[0, 0, nx:])
        times = np.append(0.0, self.mesh.points.ravel())
        values = np.vstack([first, values.reshape(-1, stage.width)])
        count = len(stage.free)
        return Guess(times, values, float(full[full.size - count - 1]), full[full.size - count :])

    def unknowns(self, guess: Guess) -> np.ndarray:
        """Those of the program for a motion."""
        return _values(self.layout, guess, self.mesh) / self.units


class _Rows:
    """Constraint rows as they are added."""

    def __init__(self) -> None:
        self.lower: list[float] = []
        self.upper: list[float] = []
        self.labels: list[tuple[str, float]] = []
        self.linear: list[tuple[int, int, float]] = []

    def add(self, lower: float, upper: float, name: str, at: float) -> int:
        """The number of a new one."""
        self.lower.append(lower)
        self.upper.append(upper)
        self.labels.append((name, at))
        return len(self.lower) - 1


@dataclass(frozen=True, eq=False)
class Layout:
    """Where unknowns stand: states at the start, then all of each point, then the duration and free parameters."""

    stage: Stage
    mesh: Mesh
    held: bool

    @functools.cached_property
    def places(self) -> np.ndarray:
        """(intervals, stages, width)."""
        K, s, width, nu = self.mesh.intervals, self.mesh.tableau.stages, self.stage.width, self.stage.sizes[3]
        nx = self.stage.sizes[0]
        if not self.held or not nu:
            return nx + np.arange(K * s * width).reshape(K, s, width)
        own, size = width - nu, s * (width - nu) + nu
        found = np.empty((K, s, width), dtype=int)
        begin = nx + size * np.arange(K)[:, None, None]
        found[:, :, :own] = begin + own * np.arange(s)[None, :, None] + np.arange(own)
        found[:, :, own:] = begin + own * s + np.arange(nu)
        return found

    @property
    def tail(self) -> int:
        """Of the duration; free parameters follow."""
        return int(self.places.max()) + 1

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.tail + 1 + len(self.stage.free)

    def node(self, k: int) -> np.ndarray:
        """Places of all unknowns (width + 1 + free,) of the point that ends interval k - 1; -1 for what the start has not."""
        extra = np.arange(self.tail, self.size)
        if k == 0:
            nx = self.stage.sizes[0]
            return np.concatenate([np.arange(nx), np.full(self.stage.width - nx, -1), extra])
        return np.append(self.places[k - 1, -1], extra)


def transcribe(asked: Asked, mesh: Mesh, guess: Guess, units: np.ndarray) -> Transcribed:
    """The program on a mesh, beginning at a guess. `units` (width,): what is much for each unknown of a point."""
    stage = asked.stage
    layout, rows = Layout(stage, mesh, asked.held), _Rows()
    w = _values(layout, guess, mesh)
    size = np.ones(layout.size)
    size[layout.places] = units
    size[: stage.sizes[0]] = units[: stage.sizes[0]]
    size[layout.tail] = guess.duration
    size[layout.tail + 1 :] = np.where(guess.free == 0, 1.0, np.abs(guess.free))
    bounds = _bounds(asked, layout, w)
    terms: list[Term] = [_dynamics(asked, layout, rows, w, units, bounds)]
    terms += _conditions(asked, layout, rows, w)
    terms += _ends(asked, layout)
    cost = np.zeros(layout.size)
    cost[layout.tail] = asked.per_second
    i, j, value = (np.array(part) for part in zip(*rows.linear, strict=True))
    plain = Program(
        [_scaled(term, size) for term in terms],
        (i.astype(int), j.astype(int), value * size[j.astype(int)]),
        cost * size,
        np.array([rows.lower, rows.upper]),
        bounds / size,
        w / size,
    )
    return Transcribed(asked, mesh, plain, size, layout.places, rows.labels)


def _scaled(term: Term, size: np.ndarray) -> Term:
    return Term(term.function, term.places, size[term.places], term.data, term.rows, term.weights)


def _values(layout: Layout, guess: Guess, mesh: Mesh) -> np.ndarray:
    w = np.zeros(layout.size)
    w[layout.places] = guess.at(mesh.points.ravel()).reshape(layout.places.shape)
    w[: layout.stage.sizes[0]] = guess.at(np.zeros(1))[0, : layout.stage.sizes[0]]
    w[layout.tail] = guess.duration
    w[layout.tail + 1 :] = guess.free
    return w


def _bounds(asked: Asked, layout: Layout, w: np.ndarray) -> np.ndarray:
    bounds = np.repeat([[-np.inf], [np.inf]], layout.size, axis=1)
    bounds[:, layout.tail] = asked.duration
    bounds[:, layout.tail + 1 :] = asked.geometry.T
    numbers = {asked.stage.unknowns[k].element_hash(): k for k in range(asked.stage.width)}
    for limits in asked.path:
        for r in range(limits.value.numel()):
            k = numbers.get(limits.value[r].element_hash())
            if k is not None:
                at = layout.places[:, :, k].ravel()
                at = np.append(at, k) if k < asked.stage.sizes[0] else at
                bounds[0, at] = np.maximum(bounds[0, at], limits.lower[r])
                bounds[1, at] = np.minimum(bounds[1, at], limits.upper[r])
    if asked.start is not None:
        fixed = np.flatnonzero(np.isfinite(asked.start))
        bounds[:, fixed] = asked.start[fixed]
    return bounds


def _dynamics(asked: Asked, layout: Layout, rows: _Rows, w: np.ndarray, units: np.ndarray, bounds: np.ndarray) -> Term:
    stage, mesh = asked.stage, layout.mesh
    nx, nv, loops, _ = stage.sizes
    K, s = mesh.intervals, mesh.tableau.stages
    labels = stage.functions.state_names
    path = [(limits, r) for limits in asked.path for r in range(limits.value.numel()) if not _is_unknown(stage, limits.value[r])]
    length = stage.data[1]
    values = ca.vertcat(
        length * stage.duration * stage.put(stage.rates),
        stage.put(stage.balance),
        stage.put(stage.invariants[0]),
        *(stage.put(limits.value[r]) for limits, r in path),
        length * stage.duration * stage.put(asked.integrals),
        length * stage.put(asked.averages),
    )
    held = stage.invariants[0].numel()
    number = np.full((values.numel(), K * s), NOWHERE)
    weights = np.ones((values.numel(), K * s))
    extra = np.arange(layout.tail, layout.size)
    for k in range(K):
        middle, half = w[np.append(layout.places[k, s // 2], extra)], float(mesh.points[k, s // 2])
        kept, used = independent_states(stage, middle, half, units)
        loop_rows = stage.ruling(middle, half, units)
        idle = [nx + nv + r for r in range(loops) if r not in loop_rows]
        bounds[:, layout.places[k][:, idle]] = 0.0  # multipliers that rigid bodies leave open
        begin = layout.node(k)[:nx]
        for j in range(s):
            column, at = k * s + j, float(mesh.points[k, j])
            for i in kept:
                row = rows.add(0.0, 0.0, f"the motion of {labels[i]}", at)
                rows.linear += [(row, int(begin[i]), mesh.slopes[j, 0])]
                rows.linear += [(row, int(layout.places[k, m, i]), mesh.slopes[j, m + 1]) for m in range(s)]
                number[i, column], weights[i, column] = row, -1.0
            for i in (*range(nv), *(nv + r for r in loop_rows)):
                number[nx + i, column] = rows.add(0.0, 0.0, stage.equation_names[i], at)
            for r in used:
                number[nx + nv + loops + r, column] = rows.add(0.0, 0.0, "closed loops", at)
            for r, (limits, e) in enumerate(path):
                number[nx + nv + loops + held + r, column] = rows.add(limits.lower[e], limits.upper[e], limits.name, at)
            number[-2:, column], weights[-2:, column] = COST, mesh.tableau.b[j]
    function = folded_function("point", [stage.unknowns, stage.data], [ca.densify(values)])
    places = np.vstack([layout.places.reshape(-1, stage.width).T, *(np.full(K * s, e) for e in extra)])
    data = np.vstack([mesh.points.ravel(), np.repeat(mesh.lengths, s)])
    return Term(function, places, np.ones(places.shape), data, number, weights)


def _is_unknown(stage: Stage, value: ca.SX) -> bool:
    return value.is_symbolic() and any(value.element_hash() == stage.unknowns[k].element_hash() for k in range(stage.width))


def _at(layout: Layout, k: int, value: ca.SX, number: list[int], weights: float = 1.0) -> Term:
    """A column of values at the node k, of the unknowns that stand in it."""
    stage = layout.stage
    used = stage.used([value])
    function = folded_function("end", [stage.unknowns[used], stage.data], [ca.densify(value)])
    places = layout.node(k)[used][:, None]
    data = np.array([[layout.mesh.nodes[k]], [0.0]])
    return Term(function, places, np.ones(places.shape), data, np.array(number)[:, None], np.full((len(number), 1), weights))


def _ends(asked: Asked, layout: Layout) -> list[Term]:
    found: list[Term] = []
    for k, value in ((0, asked.starts), (layout.mesh.intervals, asked.ends)):
        column = asked.stage.put(value)
        if not column.is_constant():
            found.append(_at(layout, k, column, [COST]))
    return found


def _conditions(asked: Asked, layout: Layout, rows: _Rows, w: np.ndarray) -> list[Term]:
    """What holds at the start, at places of the path and at the end, without what follows from invariants."""
    stage, mesh = asked.stage, layout.mesh
    nx = stage.sizes[0]
    terms: list[Term] = []
    extra = np.arange(layout.tail, layout.size)
    fixed = np.zeros(nx, dtype=bool) if asked.start is None else np.isfinite(asked.start)
    first = np.concatenate([w[:nx], np.zeros(stage.width - nx), w[extra]])
    if not fixed.all() and stage.invariants[0].numel():
        used = independent_rows(stage.slopes_of(stage.closing, first, 0.0)[:, ~fixed])
        if used:
            number = [rows.add(0.0, 0.0, "closed loops", 0.0) for _ in used]
            terms.append(_at(layout, 0, stage.put(stage.invariants[0][list(used)]), number))
    for at, limits in asked.here:
        k = int(np.argmin(np.abs(mesh.nodes - at)))
        z = np.where(layout.node(k) >= 0, w[layout.node(k)], 0.0)
        value = stage.put(limits.value)
        needed = _not_following(stage, value, z, at, fixed if k == 0 else np.zeros(nx, dtype=bool), limits)
        if needed:
            number = [rows.add(limits.lower[r], limits.upper[r], limits.name, at) for r in needed]
            terms.append(_at(layout, k, value[needed], number))
    if asked.periodic is not None:
        turned = [int(i) for i in np.flatnonzero(np.nan_to_num(asked.periodic))]
        kept, _ = independent_states(stage, first, 0.0, np.ones(stage.width), turned)
        end = layout.node(mesh.intervals)
        for i in kept:
            if np.isfinite(asked.periodic[i]):
                row = rows.add(asked.periodic[i], asked.periodic[i], f"as at the start: {stage.functions.state_names[i]}", 1.0)
                rows.linear += [(row, int(end[i]), 1.0), (row, i, -1.0)]
    return terms


def _not_following(stage: Stage, value: ca.SX, z: np.ndarray, at: float, fixed: np.ndarray, limits: Limits) -> list[int]:
    """Rows of a condition that invariants and rows before them do not imply; bounds that leave room are all kept."""
    slope = ca.Function("slope", [stage.unknowns, stage.data], [ca.densify(ca.jacobian(value, stage.unknowns))])
    own = np.array(slope(z, [at, 0.0])).reshape(value.numel(), -1)
    of_states = stage.slopes_of(stage.closing, z, at)
    above = np.pad(of_states, ((0, 0), (0, own.shape[1] - of_states.shape[1])))
    free = np.append(~fixed, np.ones(own.shape[1] - fixed.size, dtype=bool))
    basis = list(above[:, free])
    needed: list[int] = []
    for r, row in enumerate(own[:, free]):
        if limits.lower[r] < limits.upper[r] or _adds(basis, row):
            needed.append(r)
            basis.append(row)
    return needed


def _adds(basis: list[np.ndarray], row: np.ndarray) -> bool:
    length = np.linalg.norm(row)
    if length == 0 or not basis:
        return bool(length > 0)
    known = np.array([b / np.linalg.norm(b) for b in basis if np.linalg.norm(b) > 0]).T
    if not known.size:
        return True
    rest = row / length - known @ np.linalg.lstsq(known, row / length, rcond=1e-9)[0]
    return bool(np.linalg.norm(rest) > 1e-6)
