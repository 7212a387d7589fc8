"""The equations of motion in independent coordinates, for one choice of them and any reference state."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.charts.chart import Choice
from acausal.charts.implicit import Followed, Known, follow, solve_rows
from acausal.charts.manifold import Manifold
from acausal.numerics.folding import folded_function
from acausal.numerics.staged import called
from acausal.numerics.switching import Switching
from acausal.runtime.integrand import Integrand
from acausal.runtime.kernels import How
from acausal.runtime.native import NativeProblem, SharedProblems, native_problem


@dataclass(frozen=True, repr=False)
class ChartEquations:
    """Functions of y = (independent positions, independent velocities and scalar states), all `SX`.

    The reference is an argument r = (t, x, p), so that charts with the same choice share compiled code; `limits` end a chart, see
    `guards`. `steps`: see `follow`.
    """

    manifold: Manifold
    choice: Choice
    steps: int

    def __reduce__(self) -> tuple[Any, ...]:
        """Without what has been made of its values so far."""
        return ChartEquations, tuple(getattr(self, entry.name) for entry in fields(self))

    @functools.cached_property
    def _symbols(self) -> _Symbols:
        s = self.manifold.functions.outputs.system
        nx, np_ = s.x.numel(), s.p.numel()
        y = ca.SX.sym("y", len(self.choice.positions) + len(self.choice.rates))
        return _Symbols(s.t, y, s.u, s.p, ca.SX.sym("r", 1 + nx + np_))

    @property
    def places(self) -> tuple[int, ...]:
        """Among the model's states, those that y stands for; of a unit quaternion the first one."""
        c, nq = self.manifold.coordinates, self.manifold.functions.outputs.system.nq
        first = [begin for begin, size in c.places for _ in range(size)]
        return (*(first[i] for i in self.choice.positions), *(nq + i for i in self.choice.rates))

    @property
    def independent(self) -> tuple[int, ...]:
        """Among the model's states, those that are independent; all of a unit quaternion, or none."""
        c, nq, chosen = self.manifold.coordinates, self.manifold.functions.outputs.system.nq, set(self.choice.positions)
        return (*(i for i in range(nq) if chosen.issuperset(c.entries(i))), *(nq + i for i in self.choice.rates))

    @functools.cached_property
    def _invariant(self) -> np.ndarray:
        """Directions (nc, n) of c along which the reference moves with the independent entries: those along which constraints never change, so
        that turns of wheels take nobody away from it; zero for other entries.
        """
        m, free = self.manifold, self.choice.positions
        rest = tuple(_others(free, m.coordinates.count))
        found = np.zeros((m.coordinates.count, len(free)))
        if rest:
            for column, i in enumerate(free):
                direction = m.invariant_direction(i, rest)
                if direction is not None:
                    found[:, column] = direction
        return found

    @functools.cached_property
    def _point(self) -> _Point:
        """Everything at y."""
        m, k, choice = self.manifold, self._symbols, self.choice
        c_map, nq = m.coordinates, m.coordinates.size
        t0, q0, w0, p0 = self._reference(k.r)
        n = len(choice.positions)
        free, rest = list(choice.positions), _others(choice.positions, c_map.count)
        size, size_w = (ca.DM(part) for part in m.row_sizes)
        unit = ca.DM(m.units_c[rest])

        def closing(z: ca.SX, known: ca.SX) -> ca.SX:
            t, y, p, q_ref = ca.vertsplit(known, [0, 1, 1 + n, 1 + n + k.p.numel(), known.numel()])
            return m.position(t, c_map.configuration(_merged(y, free, unit * z, rest), q_ref), p) / size

        c0 = c_map.coordinates(q0, q0)
        c0 = c0 + ca.mtimes(ca.SX(ca.sparsify(ca.DM(self._invariant))), k.y[:n] - c0[free, :])
        known = Known(_column(c0, rest) / unit, ca.vertcat(t0, c0[free, :], p0, q0))
        positions = follow(closing, known, ca.vertcat(k.t, k.y[:n], k.p, q0), self.steps)
        c = _merged(k.y[:n], free, unit * positions.z, rest)
        q = c_map.configuration(c, q0)
        free_w, rest_w = list(choice.rates), _others(choice.rates, w0.numel())
        unit_w = ca.DM(m.units_w[rest_w])

        def moving(z: ca.SX, known: ca.SX) -> ca.SX:
            t, q, w, p = ca.vertsplit(known, [0, 1, 1 + nq, 1 + nq + len(free_w), known.numel()])
            return m.rate(t, q, _merged(w, free_w, unit_w * z, rest_w), p) / size_w

        at = Known(_column(w0, rest_w) / unit_w, ca.vertcat(t0, q0, w0[free_w, :], p0))
        rates = follow(moving, at, ca.vertcat(k.t, q, k.y[n:], k.p), self.steps)
        w = _merged(k.y[n:], free_w, unit_w * rates.z, rest_w)
        return _Point(c, q, w, positions, rates)

    @functools.cached_property
    def expand(self) -> ca.Function:
        """(t, y, p, r) -> x; NaN where the chart has ended."""
        k, at = self._symbols, self._point
        return folded_function("expand", [k.t, k.y, k.p, k.r], [ca.densify(ca.vertcat(at.q, at.w))])

    @functools.cached_property
    def restrict(self) -> ca.Function:
        """(x, r) -> y."""
        s, k, choice = self.manifold.functions.outputs.system, self._symbols, self.choice
        c = self.manifold.coordinates.coordinates(s.x[: s.nq], self._reference(k.r)[1])
        y = ca.vertcat(c[list(choice.positions), :], s.x[s.nq :, :][list(choice.rates), :])
        return folded_function("restrict", [s.x, k.r], [ca.densify(y)])

    @functools.cached_property
    def dynamics(self) -> ca.Function:
        """(t, y, u, (p, r, limits)) -> y'."""
        k = self._symbols
        y_dot = self._along(self.manifold.functions.explicit_dynamics(k.t, self._at, k.u, k.p))
        return folded_function("explicit_dynamics", [k.t, k.y, k.u, self._values], [y_dot], ["t", "y", "u", "p"], ["y_dot"])

    @functools.cached_property
    def switching(self) -> Switching | None:
        """Of `dynamics`: the model's own switches, of (t, y, (u, sides), (p, r, limits))."""
        own = self.manifold.functions.integrand.switching
        if own is None:
            return None
        k, sides = self._symbols, ca.SX.sym("sides", len(own.looked_at))
        held = ca.vertcat(k.u, sides)
        ((x_dot,), _), ((rows,), _) = (called(f, [k.t, self._at, held, k.p]) for f in (own.rates, own.rows))
        (true,), _ = called(own.sides, [k.t, self._at, k.u, k.p])
        arguments = [k.t, k.y, held, self._values]
        return replace(
            own,
            rates=folded_function("rates", arguments, [self._along(x_dot)]),
            rows=folded_function("rows", arguments, [ca.densify(rows)]),
            sides=folded_function("sides", [k.t, k.y, k.u, self._values], [ca.densify(true)]),
            others=(),
        )

    @functools.cached_property
    def conditions(self) -> ca.Function:
        """(t, x, p, r) -> (positions, velocities, each unit quaternion): 1 where nothing depends on the independent entries, and 0 where
        the chart ends.
        """
        s, k = self.manifold.functions.outputs.system, self._symbols
        q, w = s.x[: s.nq], s.x[s.nq :]
        c = self.manifold.coordinates.coordinates(q, self._reference(k.r)[1])
        return folded_function("conditions", [s.t, s.x, s.p, k.r], [self._conditions(s.t, c, w, s.p, k.r)])

    @functools.cached_property
    def guards(self) -> ca.Function:
        """(t, y, u, (p, r, limits)) -> what falls through zero where the chart should be left: the conditions less their limits, and
        the strain that `follow` may have less what it has.
        """
        k, at = self._symbols, self._point
        conditions = self._conditions(k.t, at.c, at.w, k.p, k.r) - self._limits[:-1]
        strain = self._limits[-1] - (at.positions.strain + at.rates.strain)
        return folded_function("guards", [k.t, k.y, k.u, self._values], [ca.densify(ca.vertcat(conditions, strain))])

    def with_guards(self, function: ca.Function) -> ca.Function:
        """The `guards`, followed by a function (t, x, u, p) of the model's states, once for each."""
        if function not in self._watched:
            k = self._symbols
            rows = ca.vertcat(self.guards(k.t, k.y, k.u, self._values), function(k.t, self._at, k.u, k.p))
            self._watched[function] = folded_function("guards", [k.t, k.y, k.u, self._values], [ca.densify(rows)])
        return self._watched[function]

    @functools.cached_property
    def _watched(self) -> dict[ca.Function, ca.Function]:
        return {}

    def native(self, how: How) -> NativeProblem | None:
        """The dynamics as kernels, whose switches end steps; None without a runtime."""
        return self._native.of(how, lambda: native_problem(Integrand(self.dynamics, switching=self.switching), how))

    @functools.cached_property
    def _native(self) -> SharedProblems:
        return SharedProblems()

    @functools.cached_property
    def _limits(self) -> ca.SX:
        return ca.SX.sym("limits", 3 + len(self.manifold.coordinates.units))

    @property
    def _values(self) -> ca.SX:
        """What takes the place of parameters."""
        return ca.vertcat(self._symbols.p, self._symbols.r, self._limits)

    @property
    def _at(self) -> ca.SX:
        """x at y."""
        return ca.vertcat(self._point.q, self._point.w)

    def _along(self, x_dot: ca.SX) -> ca.SX:
        """y' of x' at y."""
        s, q = self.manifold.functions.outputs.system, ca.SX.sym("q", self.manifold.functions.outputs.system.nq)
        c = self.manifold.coordinates.coordinates(q, self._reference(self._symbols.r)[1])
        c_dot = ca.substitute(ca.jtimes(c, q, x_dot[: s.nq]), q, self._point.q) if s.nq else ca.SX(0, 1)
        return ca.densify(ca.vertcat(c_dot[list(self.choice.positions), :], x_dot[s.nq :, :][list(self.choice.rates), :]))

    def _conditions(self, t: ca.SX, c_at: ca.SX, w_at: ca.SX, p: ca.SX, r: ca.SX) -> ca.SX:
        m = self.manifold
        q0 = self._reference(r)[1]
        c, w = ca.SX.sym("c", m.coordinates.count), ca.SX.sym("w", w_at.numel())
        q = m.coordinates.configuration(c, q0)
        gain = (
            _gain(m.position(t, q, p), c, self.choice.positions, m.row_sizes[0], m.units_c),
            _gain(m.rate(t, q, w, p), w, self.choice.rates, m.row_sizes[1], m.units_w),
        )
        at = ca.Function("gain", [c, w, t, p, q0], [ca.vertcat(*gain)])(c_at, w_at, t, p, q0)
        turned = [1 / (1 + ca.sumsqr(sigma)) for sigma in m.coordinates.orientations(c_at)]
        return ca.densify(ca.vertcat(1 / ca.sqrt(1 + at), *turned))

    def _reference(self, r: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """(t, q, w, p)"""
        s = self.manifold.functions.outputs.system
        nx = s.x.numel()
        return r[0], r[1 : 1 + s.nq], r[1 + s.nq : 1 + nx], r[1 + nx :]


@dataclass(frozen=True)
class _Symbols:
    t: ca.SX
    y: ca.SX
    u: ca.SX
    p: ca.SX
    r: ca.SX


@dataclass(frozen=True)
class _Point:
    c: ca.SX
    q: ca.SX
    w: ca.SX
    positions: Followed
    rates: Followed


def _gain(rows: ca.SX, column: ca.SX, free: tuple[int, ...], sizes: np.ndarray, units: np.ndarray) -> ca.SX:
    """Sum of squares of the derivatives of dependent entries of `column`, in their units, by the free ones."""
    rest = _others(free, column.numel())
    if not rest or not free:
        return ca.SX(0)
    J = ca.jacobian(rows, column) * ca.DM(units[None, :] / sizes[:, None])
    return ca.sumsqr(solve_rows(J[:, rest], -J[:, list(free)]))


def _column(whole: ca.SX, places: Sequence[int]) -> ca.SX:
    """Entries of a column, a column also where there are none."""
    return ca.vertcat(ca.SX(0, 1), *(whole[i] for i in places))


def _others(chosen: tuple[int, ...], count: int) -> list[int]:
    own = set(chosen)
    return [i for i in range(count) if i not in own]


def _merged(a: ca.SX, places_a: list[int], b: ca.SX, places_b: list[int]) -> ca.SX:
    """A column with entries `a` and `b` at their places."""
    order = {place: part[i] for part, places in ((a, places_a), (b, places_b)) for i, place in enumerate(places)}
    return ca.vertcat(ca.SX(0, 1), *(order[i] for i in range(len(order))))
