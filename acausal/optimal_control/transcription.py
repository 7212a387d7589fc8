"""From a problem in the user's words to a nonlinear program: direct collocation in residual form.

At each point of the mesh stand states, accelerations, multipliers and inputs. Only independent coordinates and velocities are collocated, chosen for each
interval by the conditioning of its loops; all others follow from the invariants, which hold at each point: loops cannot drift open, and nothing is
asked twice.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.errors import OptionError
from acausal.numerics.folding import folded_function
from acausal.optimal_control.guess import Guess, closed
from acausal.optimal_control.mesh import Mesh, hull
from acausal.optimal_control.separable import COST, NOWHERE, Program, Term
from acausal.optimal_control.stage import Stage, independent_rows, independent_states


@dataclass(frozen=True, eq=False)
class Limits:
    """`value` (n, 1) of a stage's unknowns, between `lower` and `upper` (n,); `name`: what it is, in words."""

    value: ca.SX
    lower: np.ndarray
    upper: np.ndarray
    name: str

    def entry(self, r: int) -> str:
        """What one of the entries is, in words."""
        return self.name if self.value.numel() == 1 else f"{self.name}[{r}]"

    def range(self, r: int) -> str:
        """Where one of the entries is to be, in words."""
        lower, upper = self.lower[r], self.upper[r]
        if lower == upper:
            return f"{lower:g}"
        if np.isfinite([lower, upper]).all():
            return f"between {lower:g} and {upper:g}"
        return f"at least {lower:g}" if np.isfinite(lower) else f"at most {upper:g}"

    def outside(self, found: float, r: int, size: float = 0.0) -> bool:
        """Whether an entry with this value is clearly not where it is to be; `size`: what is much for it, beside these numbers."""
        lower, upper = self.lower[r], self.upper[r]
        room = ROOM * max(size, *(abs(v) for v in (found, lower, upper) if np.isfinite(v)))
        return not lower - room <= found <= upper + room

    def excess(self, values: np.ndarray) -> np.ndarray:
        """By how much values (entries, n) are outside, not negative."""
        return np.maximum(0.0, np.maximum(self.lower[:, None] - values, values - self.upper[:, None]))

    def sizes(self, values: np.ndarray) -> np.ndarray:
        """(entries,): what is much for each, by values (entries, n) and finite bounds that are not zero."""
        bounds = np.abs(np.vstack([self.lower, self.upper]))
        found = np.maximum(np.max(np.abs(values), axis=1), np.max(np.where(np.isfinite(bounds), bounds, 0.0), axis=0))
        return np.where(found > 0, found, 1.0)


@dataclass(frozen=True, eq=False)
class Total:
    """A sum of integrals, averages and values at the `starts` and `ends` (1, 1), with `per_second` times the duration."""

    integrals: ca.SX
    averages: ca.SX
    starts: ca.SX
    ends: ca.SX
    per_second: float


_CLEAR, _SAME = 1e-3, 1e-7
"""Of the largest slope of a vector's entries: what clearly changes, and what does not at all."""
ROOM = 1e-6
"""Of what a bound and a value are: how far apart they are before they contradict each other."""
GIVEN = "start values"
"""The name of what is given at the start and holds with what is free there."""


@dataclass(frozen=True, eq=False)
class Asked:
    """A problem, by unknowns of a `stage`. `path`: at every point; `here`: at parts of the duration; `start` (nx,): all states, NaN what is open;
    `cost`: what is minimised; `totals`: what else stays between two numbers, with names. `periodic`: by what the states
    (nx,) are more at the end than at the start, NaN what is open. `held`: inputs are constant in each interval. `duration` and `geometry`:
    (2,) and (free parameters, 2) bounds.
    """

    stage: Stage
    path: Sequence[Limits]
    here: Sequence[tuple[float, Limits]]
    start: np.ndarray | None
    periodic: np.ndarray | None
    cost: Total
    totals: Sequence[tuple[Total, float, float, str]]
    held: bool
    duration: np.ndarray
    geometry: np.ndarray

    @functools.cached_property
    def linear(self) -> bool:
        """Whether all but the cost, and but for a free time, is linear in the unknowns of a point."""
        stage = self.stage
        said = [*self.path, *(limits for _, limits in self.here)]
        rows = ca.veccat(stage.rates, stage.balance, stage.invariants[0], *(limits.value for limits in said))
        unknowns = ca.vertcat(stage.unknowns[: stage.width], stage.geometry)
        return not any(ca.which_depends(stage.put(rows), unknowns, 2, True))

    @property
    def entries(self) -> list[tuple[int, Limits, int]]:
        """Of what has limits all the time each entry: these, its number there, and before them the number of the unknown that it is; -1 where it is none."""
        known = {self.stage.unknowns[k].element_hash(): k for k in range(self.stage.width)}
        entries = [(one, r) for one in self.path for r in range(one.value.numel())]
        return [(known.get(one.value[r].element_hash(), -1) if one.value[r].is_symbolic() else -1, one, r) for one, r in entries]


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
        mesh, count = self.settled(w), len(stage.free)
        times = np.append(0.0, mesh.points.ravel())
        values = np.vstack([first, values.reshape(-1, stage.width)])
        return Guess(times, values, float(full[self.layout.tail]), full[self.layout.tail + 1 :][:count], mesh, nx)

    def unknowns(self, guess: Guess) -> np.ndarray:
        """Those of the program for a motion."""
        return _values(self.layout, guess, self.mesh) / self.units

    def settled(self, w: np.ndarray) -> Mesh:
        """With loose nodes where they were found."""
        nodes = self.layout.nodes
        return replace(self.mesh, nodes=(w * self.units)[nodes], loose=()) if nodes.size else self.mesh

    def slopes_by_nodes(self, w: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """(intervals + 1,): by how much the least cost changes with each node, where it moves alone; `factors` (rows,): multipliers of the rows."""
        term, c = self.program.terms[0], self.mesh.tableau.c
        by = np.append(factors, [0.0, 1.0])[term.rows] * term.weights  # NOWHERE, COST
        z, data = ca.SX.sym("z", term.places.shape[0]), ca.SX.sym("data", term.data.shape[0])
        given = ca.SX.sym("by", by.shape[0])
        slopes = ca.gradient(ca.dot(given, term.function(z, data)), ca.vertcat(z, data))
        own = slopes[-3:-1] if self.layout.nodes.size else slopes[-2:]
        found = np.array(ca.Function("by_nodes", [z, data, given], [own])(w[term.places] * term.units, term.data, by))
        if not self.layout.nodes.size:  # by when it is, and by the length of its interval
            part = np.tile(c, self.mesh.intervals)
            found = np.array([(1 - part) * found[0] - found[1], part * found[0] + found[1]])
        first, last = found.reshape(2, self.mesh.intervals, c.size).sum(axis=2)
        return np.append(first, 0.0) + np.append(0.0, last)


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
    """Where unknowns stand: states at the start, then all of each point, then the duration, free parameters, and nodes where some are loose."""

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
    def extra(self) -> np.ndarray:
        """Of the duration and of free parameters."""
        return self.tail + np.arange(1 + len(self.stage.free))

    @property
    def nodes(self) -> np.ndarray:
        """Of all nodes, where some are loose; otherwise none."""
        return self.extra[-1] + 1 + np.arange(self.mesh.nodes.size if self.mesh.loose else 0)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.extra[-1]) + 1 + self.nodes.size

    def node(self, k: int) -> np.ndarray:
        """Places of all unknowns (width + 1 + free,) of the point that ends interval k - 1; -1 for what the start has not."""
        if k == 0:
            nx = self.stage.sizes[0]
            return np.concatenate([np.arange(nx), np.full(self.stage.width - nx, -1), self.extra])
        return np.append(self.places[k - 1, -1], self.extra)


def transcribe(asked: Asked, mesh: Mesh, guess: Guess, units: np.ndarray) -> Transcribed:
    """The program on a mesh, beginning at a guess. `units` (width,): what is much for each unknown of a point."""
    stage = asked.stage
    layout, rows = Layout(stage, mesh, asked.held), _Rows()
    w = _values(layout, guess, mesh)
    size = np.ones(layout.size)
    size[layout.places] = units
    size[: stage.sizes[0]] = units[: stage.sizes[0]]
    size[layout.tail] = guess.duration
    size[layout.extra[1:]] = np.where(guess.free == 0, 1.0, np.abs(guess.free))
    bounds = _bounds(asked, layout, w)
    sums = _sums(asked, layout, rows)
    if mesh.inside:
        _between(asked, layout, rows, bounds)
    path = _path(asked, layout, rows)
    terms: list[Term] = [_dynamics(asked, layout, rows, w, units, bounds, sums, path), *_beginnings(layout, path)]
    terms += _conditions(asked, layout, rows, w, size)
    terms += _ends(sums, layout)
    cost = np.zeros(layout.size)
    cost[layout.tail] = asked.cost.per_second
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
    values = guess.at(mesh.points.ravel()).reshape(layout.places.shape)
    if layout.held:
        first = layout.stage.width - layout.stage.sizes[3]
        values[:, :, first:] = np.einsum("j,kju->ku", mesh.tableau.b, values[:, :, first:])[:, None]
    w[layout.places] = values
    w[: layout.stage.sizes[0]] = guess.at(np.zeros(1))[0, : layout.stage.sizes[0]]
    w[layout.tail] = guess.duration
    w[layout.extra[1:]] = guess.free
    w[layout.nodes] = mesh.nodes[: layout.nodes.size]
    return w


def _bounds(asked: Asked, layout: Layout, w: np.ndarray) -> np.ndarray:
    bounds = np.repeat([[-np.inf], [np.inf]], layout.size, axis=1)
    bounds[:, layout.tail] = asked.duration
    bounds[:, layout.extra[1:]] = asked.geometry.T
    bounds[:, layout.nodes] = layout.mesh.bounds[:, : layout.nodes.size]
    for k, limits, r in asked.entries:
        if k >= 0:
            at = layout.places[:, :, k].ravel()
            at = np.append(at, k) if k < asked.stage.sizes[0] else at
            bounds[0, at] = np.maximum(bounds[0, at], limits.lower[r])
            bounds[1, at] = np.minimum(bounds[1, at], limits.upper[r])
    if asked.start is not None:
        fixed = np.flatnonzero(np.isfinite(asked.start))
        bounds[:, fixed] = asked.start[fixed]
    return bounds


def _sums(asked: Asked, layout: Layout, rows: _Rows) -> list[tuple[Total, int]]:
    """What is summed up over the motion, each with its row: first the cost."""
    found = [(asked.cost, COST)]
    for total, lower, upper, name in asked.totals:
        row = rows.add(lower, upper, name, 1.0)
        if total.per_second:
            rows.linear.append((row, layout.tail, total.per_second))
        found.append((total, row))
    return found


@dataclass(frozen=True, eq=False)
class _Kept:
    """A `value` (1, 1) of unknowns that is kept between limits. `rows` (rows in an interval, intervals): their numbers; of each the `weights` of the values at the
    points (rows in an interval, stages), and that of the value where the interval begins (rows in an interval,); zero where it does not count.
    """

    value: ca.SX
    rows: np.ndarray
    weights: np.ndarray
    beginning: np.ndarray


def _path(asked: Asked, layout: Layout, rows: _Rows) -> list[_Kept]:
    """Expressions that have limits all the time: at each point; where bounds hold `inside` the coefficients of Bernstein of the polynomials through these values.
    What is constant in an interval has its limits once.
    """
    stage, mesh, found = asked.stage, layout.mesh, list[_Kept]()
    s, inputs = mesh.tableau.stages, set(range(stage.width - stage.sizes[3], stage.unknowns.numel()))
    for k, limits, r in asked.entries:
        if k >= 0:
            continue
        value = stage.put(limits.value[r])
        weights, beginning = np.eye(s), np.zeros(s)
        if layout.held and inputs.issuperset(stage.used([value])) and not ca.depends_on(value, stage.data):
            weights, beginning = weights[-1:], beginning[-1:]
        elif mesh.inside and _of_states(stage, value):
            hulled = hull(np.append(0.0, mesh.tableau.c))[1:]
            weights, beginning = hulled[:, 1:], hulled[:, 0]
        elif mesh.inside:
            weights = hull(mesh.tableau.c)
        number = [
            [rows.add(limits.lower[r], limits.upper[r], limits.name, float(at)) for at in points[-len(weights) :]]
            for points in mesh.points
        ]
        found.append(_Kept(value, np.array(number).T, weights, beginning))
    return found


def _of_states(stage: Stage, value: ca.SX) -> bool:
    """Whether a value is known where an interval begins."""
    known = {*range(stage.sizes[0]), *range(stage.width, stage.unknowns.numel())}
    return known.issuperset(stage.used([value]))


def _beginnings(layout: Layout, path: list[_Kept]) -> list[Term]:
    """What values where intervals begin add to rows of these."""
    stage, mesh, found = layout.stage, layout.mesh, list[Term]()
    for kept in path:
        if not kept.beginning.any():
            continue
        used = stage.used([kept.value])
        z, given, value = stage.unknowns[used], stage.data, kept.value
        places, data = (
            np.array([layout.node(k)[used] for k in range(mesh.intervals)]).reshape(mesh.intervals, -1).T,
            np.vstack([mesh.nodes[:-1], mesh.lengths]),
        )
        if mesh.loose and ca.depends_on(value, given):
            when, none = ca.SX.sym("when"), ca.SX.sym("none", 2)
            value, z, given = ca.substitute(value, given, ca.vertcat(when, 0)), ca.vertcat(z, when), none
            places = np.vstack([places, layout.nodes[:-1]])
        function = folded_function("beginning", [z, given], [ca.repmat(ca.densify(value), kept.beginning.size)])
        weights = np.tile(kept.beginning[:, None], (1, mesh.intervals))
        found.append(Term(function, places, np.ones(places.shape), data, kept.rows, weights))
    return found


def _dynamics(
    asked: Asked,
    layout: Layout,
    rows: _Rows,
    w: np.ndarray,
    units: np.ndarray,
    bounds: np.ndarray,
    sums: list[tuple[Total, int]],
    path: list[_Kept],
) -> Term:
    stage, mesh = asked.stage, layout.mesh
    nx, nv, loops = *stage.sizes[:2], stage.reacting
    K, s = mesh.intervals, mesh.tableau.stages
    labels = stage.functions.state_names
    length = stage.data[1]
    values = ca.vertcat(
        length * stage.duration * stage.put(stage.collocated),
        stage.put(stage.balance),
        stage.put(stage.invariants[0]),
        *(ca.repmat(kept.value, len(kept.weights)) for kept in path),
        *(length * stage.put(stage.duration * total.integrals + total.averages) for total, _ in sums),
    )
    held = stage.invariants[0].numel()
    number = np.full((values.numel(), K * s), NOWHERE)
    weights = np.ones((values.numel(), K * s))
    for k in range(K):
        middle, half = w[np.append(layout.places[k, s // 2], layout.extra)], float(mesh.points[k, s // 2])
        kept, used = independent_states(stage, middle, half, units, whole=True)
        loop_rows = stage.ruling(middle, half, units)
        idle = [nx + nv + r for r in range(loops) if r not in loop_rows]
        idle += [nx + nv + loops + n for n, places in enumerate(stage.quaternions) if not set(places) & set(kept)]
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
            if path:
                own = slice(nx + nv + loops + held, -len(sums))
                number[own, column] = np.concatenate([kept.rows[:, k] for kept in path])
                weights[own, column] = np.concatenate([kept.weights[:, j] for kept in path])
            number[-len(sums) :, column], weights[-len(sums) :, column] = [row for _, row in sums], mesh.tableau.b[j]
    unknowns, given, data = stage.unknowns, stage.data, np.vstack([mesh.points.ravel(), np.repeat(mesh.lengths, s)])
    places = np.vstack([layout.places.reshape(-1, stage.width).T, *(np.full(K * s, e) for e in layout.extra)])
    if mesh.loose:
        ends, part = ca.SX.sym("ends", 2), ca.SX.sym("part")
        when = ca.vertcat(ends[0] + part * (ends[1] - ends[0]), ends[1] - ends[0])
        values = ca.substitute(values, given, when)
        unknowns, given, data = ca.vertcat(unknowns, ends), part, np.tile(mesh.tableau.c, K)[None, :]
        places = np.vstack([places, np.repeat([layout.nodes[:-1], layout.nodes[1:]], s, axis=1)])
    function = folded_function("point", [unknowns, given], [ca.densify(values)])
    return Term(function, places, np.ones(places.shape), data, number, weights)


def _between(asked: Asked, layout: Layout, rows: _Rows, bounds: np.ndarray) -> None:
    """Unknowns keep their bounds between the points, too: otherwise nodes that are loose would go where they leave them unseen."""
    stage, mesh = asked.stage, layout.mesh
    nx, first, c = stage.sizes[0], stage.width - stage.sizes[3], mesh.tableau.c
    of_states, of_others = hull(np.append(0.0, c))[1:-1], hull(c)
    said = {k: limits.entry(r) for k, limits, r in asked.entries if k >= 0 and not (layout.held and k >= first)}
    for k, name in said.items():
        for i in range(mesh.intervals):
            lower, upper = bounds[:, layout.places[i, 0, k]]
            if not lower < upper:
                continue
            inside = layout.places[i, :, k] if k >= nx else layout.places[i, :-1, k]
            entries = layout.places[i, :, k] if k >= nx else np.append(layout.node(i)[k], layout.places[i, :, k])
            bounds[:, inside] = [[-np.inf], [np.inf]]
            for weights in of_others if k >= nx else of_states:
                row = rows.add(lower, upper, name, float(mesh.nodes[i]))
                rows.linear += [(row, int(e), float(weight)) for e, weight in zip(entries, weights, strict=True)]


def _is_unknown(stage: Stage, value: ca.SX) -> bool:
    return value.is_symbolic() and any(value.element_hash() == stage.unknowns[k].element_hash() for k in range(stage.width))


def _at(layout: Layout, k: int, value: ca.SX, number: list[int], weights: float = 1.0) -> Term:
    """A column of values at the node k, of the unknowns that stand in it."""
    stage = layout.stage
    used = stage.used([value])
    if np.any(layout.node(k)[used] < 0):
        raise OptionError(
            "At the start only positions, velocities and other states are known: forces, accelerations and inputs begin just after it. "
            "Bound them all the time, or ask for them a little later, ocp.at(0.01, {...})."
        )
    function = folded_function("end", [stage.unknowns[used], stage.data], [ca.densify(value)])
    places = layout.node(k)[used][:, None]
    data = np.array([[layout.mesh.nodes[k]], [0.0]])
    return Term(function, places, np.ones(places.shape), data, np.array(number)[:, None], np.full((len(number), 1), weights))


def _ends(sums: list[tuple[Total, int]], layout: Layout) -> list[Term]:
    found: list[Term] = []
    for total, row in sums:
        for k, value in ((0, total.starts), (layout.mesh.intervals, total.ends)):
            column = layout.stage.put(value)
            if not column.is_constant():
                found.append(_at(layout, k, column, [row]))
    return found


def _conditions(asked: Asked, layout: Layout, rows: _Rows, w: np.ndarray, size: np.ndarray) -> list[Term]:
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
            terms.append(_at(layout, 0, stage.put(stage.invariants[0][list(used)]), number))
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
                terms.append(_at(layout, k, stage.put(limits.value)[own], number))
    if asked.periodic is None or not np.isfinite(asked.periodic).all():
        terms += _path_at_start(asked, layout, rows, fixed)
    if asked.periodic is not None:
        turned = [int(i) for i in np.flatnonzero(np.nan_to_num(asked.periodic))]
        kept, _ = independent_states(stage, first, 0.0, np.ones(stage.width), turned)
        end = layout.node(mesh.intervals)
        for i in kept:
            if np.isfinite(asked.periodic[i]):
                row = rows.add(asked.periodic[i], asked.periodic[i], f"as at the start: {stage.functions.state_names[i]}", 1.0)
                rows.linear += [(row, int(end[i]), 1.0), (row, i, -1.0)]
    return terms


def _path_at_start(asked: Asked, layout: Layout, rows: _Rows, fixed: np.ndarray) -> list[Term]:
    """Of what is bounded all the time that which is known by states alone, where these are free: the first point of an interval comes later."""
    stage, terms = asked.stage, list[Term]()
    nx = stage.sizes[0]
    here = {k for k in range(nx) if not fixed[k]} | set(range(stage.width + 1, stage.width + 1 + len(stage.free)))
    known = {*range(nx), *here, stage.width}
    for limits in asked.path:
        value = stage.put(limits.value)
        for r in range(value.numel()):
            used = set(stage.used([value[r]]))
            if not _is_unknown(stage, limits.value[r]) and used & here and used <= known:
                number = [rows.add(limits.lower[r], limits.upper[r], limits.name, 0.0)]
                terms.append(_at(layout, 0, value[r], number))
    return terms


def beside(stage: Stage, z: np.ndarray, much: np.ndarray, at: float) -> np.ndarray:
    """A point a little away from `z` with its loops closed: at rest, stretched or straight up slopes vanish that do not elsewhere."""
    nx, moved = stage.sizes[0], z + 0.03 * much * np.random.default_rng(0).uniform(-1, 1, z.size)
    moved[nx:] = z[nx:]
    moved[:nx] = closed(stage, moved[None, :nx], np.array([at]), z[stage.width], z[stage.width + 1 :], np.ones(nx))[0]
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
                needed[c] = _given(limits, slopes[c], known)
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


def _given(limits: Limits, own: np.ndarray, known: np.ndarray) -> list[int]:
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
