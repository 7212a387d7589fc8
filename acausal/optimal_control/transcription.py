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

from acausal.numerics.folding import folded_function
from acausal.optimal_control.asked import FREE, LINEAR, Asked, Total
from acausal.optimal_control.conditions import conditions
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.layout import Layout, Rows, column_at
from acausal.optimal_control.mesh import Mesh, hull
from acausal.optimal_control.separable import COST, NOWHERE, Program, Term
from acausal.optimal_control.smooth import Smooth
from acausal.optimal_control.stage import Stage, independent_states

_ANGLES = ("rad", "")
"""Units of inputs of which only sine and cosine may count."""


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

    @property
    def angles(self) -> list[np.ndarray]:
        """For each input that is an angle, the numbers (points,) of its unknowns."""
        stage = self.asked.stage
        first = stage.width - stage.sizes[3]
        return [self.places[:, :, first + k].ravel() for k, entry in enumerate(stage.mode.inputs) if entry.unit in _ANGLES]

    def settled(self, w: np.ndarray) -> Mesh:
        """With loose nodes where they were found."""
        nodes = self.layout.nodes
        return replace(self.mesh, nodes=(w * self.units)[nodes], loose=()) if nodes.size else self.mesh

    def slopes_by_nodes(self, w: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """(intervals + 1,): by how much the least cost changes with each node, where it moves alone; `factors` (rows,): multipliers of the rows."""
        term, c = self.program.terms[0], self.mesh.tableau.c
        by = np.append(factors, [0.0, 1.0])[term.rows] * term.weights  # NOWHERE, COST
        slopes = np.array(term.smooth.pull(w[term.places] * term.units, term.data, by))
        found = slopes[-3:-1] if self.layout.nodes.size else slopes[-2:]
        if not self.layout.nodes.size:  # by when it is, and by the length of its interval
            part = np.tile(c, self.mesh.intervals)
            found = np.array([(1 - part) * found[0] - found[1], part * found[0] + found[1]])
        first, last = found.reshape(2, self.mesh.intervals, c.size).sum(axis=2)
        return np.append(first, 0.0) + np.append(0.0, last)


def transcribe(asked: Asked, mesh: Mesh, guess: Guess, units: np.ndarray) -> Transcribed:
    """The program on a mesh, beginning at a guess. `units` (width,): what is much for each unknown of a point."""
    stage = asked.stage
    layout, rows = Layout(stage, mesh, asked.held), Rows()
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
    if asked.controls == LINEAR:
        _lines(asked, layout, rows)
    path = _path(asked, layout, rows)
    terms: list[Term] = [_dynamics(asked, layout, rows, w, units, bounds, sums, path), *_beginnings(layout, path)]
    terms += conditions(asked, layout, rows, w, size)
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
        stages=(layout.places[:, -1, : stage.sizes[0]], layout.tail),
    )
    return Transcribed(asked, mesh, plain, size, layout.places, rows.labels)


def _scaled(term: Term, size: np.ndarray) -> Term:
    return replace(term, units=size[term.places])


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


def _lines(asked: Asked, layout: Layout, rows: Rows) -> None:
    """Inputs go straight from the end of each interval to the end of the next one; the first one's line begins where its first and last points lead, within bounds."""
    stage, c = asked.stage, layout.mesh.tableau.c
    lead = c[0] / (1 - c[0])
    for k in range(stage.width - stage.sizes[3], stage.width):
        own = layout.places[:, :, k]
        begin = [(int(own[0, 0]), 1 + lead), (int(own[0, -1]), -lead)]
        for limits, r in [(one, r) for entry, one, r in asked.entries if entry == k]:
            row = rows.add(limits.lower[r], limits.upper[r], limits.name, 0.0)
            rows.linear += [(row, place, weight) for place, weight in begin]
        for i, points in enumerate(own):
            for j in range(1 if i == 0 else 0, c.size - 1):
                row = rows.add(0.0, 0.0, "straight lines of inputs", float(layout.mesh.points[i, j]))
                rows.linear += [(row, int(points[j]), -1.0), (row, int(points[-1]), float(c[j]))]
                rows.linear += [(row, place, float((1 - c[j]) * weight)) for place, weight in begin]
            begin = [(int(points[-1]), 1.0)]


def _sums(asked: Asked, layout: Layout, rows: Rows) -> list[tuple[Total, int]]:
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


def _path(asked: Asked, layout: Layout, rows: Rows) -> list[_Kept]:
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
    rows: Rows,
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
    point = _point(asked, [total for total, _ in sums], path, loose=bool(mesh.loose))
    held, values = stage.invariants[0].numel(), point.function.size1_out(0)
    number = np.full((values, K * s), NOWHERE)
    weights = np.ones((values, K * s))
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
    data = np.vstack([mesh.points.ravel(), np.repeat(mesh.lengths, s)])
    places = np.vstack([layout.places.reshape(-1, stage.width).T, *(np.full(K * s, e) for e in layout.extra)])
    if mesh.loose:
        data = np.tile(mesh.tableau.c, K)[None, :]
        places = np.vstack([places, np.repeat([layout.nodes[:-1], layout.nodes[1:]], s, axis=1)])
    return Term(point.function, places, np.ones(places.shape), data, number, weights, point)


def _point(asked: Asked, sums: Sequence[Total], path: Sequence[_Kept], *, loose: bool) -> Smooth:
    """All values of a point, by its unknowns and its `data`; where nodes are `loose` by those of its interval, too, and by its part of this. Made once for all meshes."""
    key = (loose, *(len(kept.weights) for kept in path))
    if key not in asked.points:
        stage = asked.stage
        length = stage.data[1]
        values = ca.vertcat(
            length * stage.duration * stage.put(stage.collocated),
            stage.put(stage.balance),
            stage.put(stage.invariants[0]),
            *(ca.repmat(kept.value, len(kept.weights)) for kept in path),
            *(length * stage.put(stage.duration * total.integrals + total.averages) for total in sums),
        )
        unknowns, given = stage.unknowns, stage.data
        if loose:
            ends, part = ca.SX.sym("ends", 2), ca.SX.sym("part")
            when = ca.vertcat(ends[0] + part * (ends[1] - ends[0]), ends[1] - ends[0])
            values, unknowns, given = ca.substitute(values, given, when), ca.vertcat(unknowns, ends), part
        asked.points[key] = Smooth(folded_function("point", [unknowns, given], [ca.densify(values)]))
    return asked.points[key]


def _between(asked: Asked, layout: Layout, rows: Rows, bounds: np.ndarray) -> None:
    """Unknowns keep their bounds between the points, too: otherwise nodes that are loose would go where they leave them unseen."""
    stage, mesh = asked.stage, layout.mesh
    nx, first, c = stage.sizes[0], stage.width - stage.sizes[3], mesh.tableau.c
    of_states, of_others = hull(np.append(0.0, c))[1:-1], hull(c)
    said = {k: limits.entry(r) for k, limits, r in asked.entries if k >= 0 and not (asked.controls != FREE and k >= first)}
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


def _ends(sums: list[tuple[Total, int]], layout: Layout) -> list[Term]:
    found: list[Term] = []
    for total, row in sums:
        for k, value in ((0, total.starts), (layout.mesh.intervals, total.ends)):
            column = layout.stage.put(value)
            if not column.is_zero():
                found.append(column_at(layout, k, column, [row]))
    return found
