"""Nonlinear programs made of few functions at many places, with their exact derivatives.

Each function is differentiated once, as a small `SX` function; its values and derivatives at all places are added up by constant sparse matrices.
Wright and Nocedal: Numerical Optimization (2006), section 7.4 (partially separable functions).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.optimal_control.lanes import plainly
from acausal.optimal_control.smooth import Smooth

IPOPT, FATROP = "ipopt", "fatrop"
COST, NOWHERE = -1, -2
"""The row of what is minimised, and that of values which are not used."""
_FLAT = 1e-9
"""Of the slope of the cost one unit beside the guess: what it is at the guess by rounding alone."""
_SOFT = 1e-6
"""In units of the program: a curvature that is none yet, and by how much a row gives way that holds."""


@dataclass(frozen=True, eq=False)
class Term:
    """A function (z (n,), c (k,)) -> values (m,) at many places: z are the entries `places` (n, count) of the unknowns times `units` (n, count), c
    the columns of `data` (k, count); the values times `weights` (m, count) are added to the `rows` (m, count), those of `COST` to the cost.
    """

    function: ca.Function
    places: np.ndarray
    units: np.ndarray
    data: np.ndarray
    rows: np.ndarray
    weights: np.ndarray
    shared: Smooth | None = None
    """The function, where other terms use its derivatives, too."""

    @functools.cached_property
    def smooth(self) -> Smooth:
        """The function with its derivatives."""
        return self.shared or Smooth(self.function)

    def picked(self, own: np.ndarray) -> Term:
        """With some of the values alone."""
        few = self.smooth.picked(own)
        return replace(self, function=few.function, rows=self.rows[own], weights=self.weights[own], shared=few)

    @property
    def count(self) -> int:
        """Number of places."""
        return self.places.shape[1]

    def at(self, w: ca.MX) -> tuple[ca.MX, ca.DM]:
        """The arguments (z, c) at all places, a row for each."""
        return ca.reshape(w[self.places.ravel().tolist()], *self.places.shape[::-1]) * ca.DM(self.units.T), ca.DM(self.data.T)

    @functools.cached_property
    def _at_places(self) -> dict[str, ca.Function]:
        """Those functions that were asked for at all places."""
        return {}

    def everywhere(self, function: ca.Function, *arguments: ca.MX | ca.DM) -> ca.MX:
        """Its values at all places: of the first value at all of them, then of the second."""
        name = function.name()
        if name not in self._at_places:
            self._at_places[name] = self.smooth.mapped(function, self.count)
        return ca.vec(self._at_places[name](*arguments))


Stages = tuple[np.ndarray, int]
"""Unknowns that are states where intervals end (intervals, nx), and the first one of those that count all the time; from 0 on are states at the start, then all of each interval."""


@dataclass(frozen=True, eq=False)
class Program:
    """Minimise `cost` . w + terms subject to lower <= `linear` w + terms <= upper, least <= w <= most.

    `linear`: (rows, columns, values) of entries. `guess`: (n,). `limits`: (2, rows). `bounds`: (2, n).
    """

    terms: Sequence[Term]
    linear: tuple[np.ndarray, np.ndarray, np.ndarray]
    cost: np.ndarray
    limits: np.ndarray
    bounds: np.ndarray
    guess: np.ndarray
    unit: float = 1.0
    """Of the cost."""
    sizes: np.ndarray | float = 1.0
    """By which the rows were multiplied to be in balance (rows,)."""
    stages: Stages | None = None
    """Where it is that of one phase."""

    @staticmethod
    def joined(programs: Sequence[Program]) -> Program:
        """Side by side: unknowns and rows one after the other, costs added."""
        column = np.cumsum([0, *(one.size for one in programs)]).tolist()
        row = np.cumsum([0, *(one.rows for one in programs)]).tolist()
        terms = [
            replace(term, places=term.places + j, rows=np.where(term.rows >= 0, term.rows + i, term.rows))
            for one, i, j in zip(programs, row, column, strict=False)
            for term in one.terms
        ]
        linear = [(one.linear[0] + i, one.linear[1] + j, one.linear[2]) for one, i, j in zip(programs, row, column, strict=False)]
        a, b, values = (np.concatenate(part) for part in zip(*linear, strict=True))
        return Program(
            terms, (a, b, values), np.concatenate([one.cost for one in programs]), np.hstack([one.limits for one in programs]),
            np.hstack([one.bounds for one in programs]), np.concatenate([one.guess for one in programs]),
            stages=programs[0].stages if len(programs) == 1 else None,
        )  # fmt: skip

    def extended(self, guess: np.ndarray, bounds: np.ndarray, term: Term, limits: np.ndarray) -> Program:
        """With more unknowns, and a term with rows of its own."""
        return replace(
            self, terms=[*self.terms, term], cost=np.append(self.cost, np.zeros(guess.size)), limits=np.hstack([self.limits, limits]),
            bounds=np.hstack([self.bounds, bounds]), guess=np.append(self.guess, guess), stages=None,
        )  # fmt: skip

    def tied(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> Program:
        """With more linear rows that are zero: `rows` (n,) of entries are counted from 0."""
        a, b, known = self.linear
        count = int(rows.max()) + 1 if rows.size else 0
        linear = np.append(a, rows + self.rows), np.append(b, columns), np.append(known, values)
        return replace(self, linear=linear, limits=np.hstack([self.limits, np.zeros((2, count))]))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.guess.size

    @property
    def rows(self) -> int:
        """Number of constraints."""
        return self.limits.shape[1]

    def solver(self, plugin: str, options: dict[str, Any]) -> ca.Function:
        """`casadi.nlpsol` with these derivatives."""
        w = ca.MX.sym("w", self.size)
        cost, rows = self.of_cost()._values(w)[0], self._values(w)[1]
        derivatives = self.derivatives if plugin == IPOPT else {"cache": self._cached} if plugin == FATROP else self._of_steps
        solver = ca.nlpsol("program", plugin, {"x": w, "f": cost, "g": rows}, {**derivatives, **options})
        solver.of = self  # type: ignore[attr-defined]  # what functions call lives as long as it does
        return solver

    @functools.cached_property
    def derivatives(self) -> dict[str, ca.Function]:
        """Of cost and constraints, and of the Lagrangian, as ipopt takes them."""
        return {"grad_f": self._gradient, "jac_g": self._jacobian, "hess_lag": self._hessian}

    @functools.cached_property
    def _of_steps(self) -> dict[str, ca.Function]:
        """The same, as steps of quadratic programs take them."""
        w, p, of_cost, of_rows = ca.MX.sym("w", self.size), ca.MX.sym("p", 0), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.rows)
        first = [*self._gradient(w, p), *self._jacobian(w, p)]
        curvature = ca.triu2symm(self._hessian(w, p, of_cost, of_rows))
        return {
            "jac_fg": ca.Function("jac_fg", [w, p], first, ["x", "p"], ["f", "jac_f_x", "g", "jac_g_x"]),
            "hess_lag": ca.Function("hess_lag", [w, p, of_cost, of_rows], [curvature]),
        }

    @property
    def _cached(self) -> dict[str, ca.Function]:
        """The same, by names under which CasADi's fatrop looks for them."""
        w, p, of_cost, of_rows = ca.MX.sym("w", self.size), ca.MX.sym("p", 0), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.rows)
        slope, (rows, J) = self._gradient(w, p)[1], self._jacobian(w, p)
        second = [of_cost * slope + J.T @ of_rows, ca.triu2symm(self._hessian(w, p, of_cost, of_rows))]
        made = (
            ca.Function("nlp_grad_f", [w, p], [slope], ["x", "p"], ["grad_f_x"]),
            ca.Function("nlp_jac_g", [w, p], [rows, J], ["x", "p"], ["g", "jac_g_x"]),
            ca.Function(
                "nlp_hess_l", [w, p, of_cost, of_rows], second, ["x", "p", "lam_f", "lam_g"], ["grad_gamma_x", "hess_gamma_x_x"]
            ),
        )
        return {one.name(): one for one in made}

    def bent_downwards(self, w: np.ndarray, factors: np.ndarray, loose: np.ndarray) -> bool:
        """Whether the Lagrangian with these multipliers of the rows is less, to second order, beside w, where the unknowns and then the rows that are `loose` (n + rows,) may
        move: by the inertia of its matrix (Nocedal and Wright, theorem 16.3).
        """
        H, J = ca.triu2symm(self._hessian(w, [], 1.0, factors)), self._jacobian(w, [])[1]
        held, apart = (ca.diag(ca.DM(np.where(free, _SOFT, 1 / _SOFT))) for free in (loose[: self.size], ~loose[self.size :]))
        pivots = ca.ldl(ca.sparsify(ca.blockcat([[H + held, J.T], [J, -apart]])))[0]
        return bool(np.sum(np.array(pivots) < 0) > self.rows)

    @functools.cached_property
    def _cost_alone(self) -> Program:
        """It lives as long as its lanes are called."""
        return self.of_cost()

    def of_cost(self) -> Program:
        """The cost alone, without constraints."""
        none = np.zeros(0, dtype=int)
        terms = [
            replace(few, rows=np.where(few.rows == COST, COST, NOWHERE))
            for term in self.terms
            if (own := np.flatnonzero((term.rows == COST).any(axis=1))).size
            for few in [term.picked(own)]
        ]
        return replace(self, terms=terms, linear=(none, none, np.zeros(0)), limits=np.zeros((2, 0)))

    def balanced(self) -> Program:
        """With rows, and the cost, in units in which the largest of their slopes at the guess is 1; where that of the cost vanishes there but for rounding, at one unit beside it."""
        slopes = np.abs(np.array(self._jacobian(self.guess, ca.DM(0, 1))[1].nonzeros()))
        row = np.array(self._jacobian.sparsity_out(1).row(), dtype=int)
        largest = np.zeros(self.rows)
        np.maximum.at(largest, row, np.where(np.isfinite(slopes), slopes, 0.0))
        size = 1 / np.where(largest > 0, largest, 1.0)
        steepest, beside = (self._steepest(self.guess + d) for d in (0.0, np.random.default_rng(0).uniform(-1, 1, self.size)))
        steepest = steepest if steepest > _FLAT * beside else beside
        of_cost = 1 / steepest if steepest > 0 else 1.0
        all_sizes = np.concatenate([size, [1.0, of_cost]])  # NOWHERE, COST
        terms = [replace(term, weights=term.weights * all_sizes[term.rows]) for term in self.terms]
        i, j, values = self.linear
        return replace(
            self,
            terms=terms,
            linear=(i, j, values * size[i]),
            cost=self.cost * of_cost,
            limits=self.limits * size,
            unit=self.unit / of_cost,
            sizes=size,
        )

    def _steepest(self, w: np.ndarray) -> float:
        """The largest slope of the cost."""
        slope = np.abs(np.array(self._gradient(w, ca.DM(0, 1))[1])).ravel()
        return float(np.max(slope[np.isfinite(slope)], initial=0.0))

    @functools.cached_property
    def values(self) -> ca.Function:
        """(w) -> cost, constraints."""
        w = ca.MX.sym("w", self.size)
        return ca.Function("values", [w], list(self._values(w)))

    def _values(self, w: ca.MX) -> tuple[ca.MX, ca.MX]:
        total = self._linear @ w
        for term in self.terms:
            if term.count:
                total += self._adding(term) @ ca.vec(
                    plainly(term.function, term.count)(*term.at(w))
                )  # CasADi differentiates it, too
        return ca.dot(ca.DM(self.cost), w) + total[self.rows], total[: self.rows]

    def _adding(self, term: Term) -> ca.DM:
        """(rows + 1, values of the term): what adds these up, the cost last."""
        rows = _column(np.where(term.rows == COST, self.rows, term.rows))
        used = np.flatnonzero(rows >= 0)
        return _sparse(rows[used], used, _column(term.weights)[used], self.rows + 1, rows.size)

    @property
    def _linear(self) -> ca.MX:
        """With an empty row for the cost."""
        found = _Collected(self.rows + 1, self.size)
        found.add(*self.linear, None)
        return found.matrix()

    @functools.cached_property
    def _gradient(self) -> ca.Function:
        w, p = ca.MX.sym("w", self.size), ca.MX.sym("p", 0)
        own, gradient = self._cost_alone, ca.MX(ca.DM(self.cost))
        for entries, (rows, places, weights) in own._slopes(w):
            paid = np.flatnonzero(rows == COST)
            gradient += _sparse(places[paid], paid, weights[paid], self.size, rows.size) @ entries
        return ca.Function("grad_f", [w, p], [own._values(w)[0], gradient], ["x", "p"], ["f", "grad_f_x"])

    @functools.cached_property
    def _jacobian(self) -> ca.Function:
        w, p = ca.MX.sym("w", self.size), ca.MX.sym("p", 0)
        found = _Collected(self.rows, self.size)
        found.add(*self.linear, None)
        for entries, (rows, places, weights) in self._slopes(w):
            kept = rows >= 0
            found.add(rows[kept], places[kept], weights[kept], (entries, np.flatnonzero(kept), rows.size))
        return ca.Function("jac_g", [w, p], [self._values(w)[1], found.matrix()], ["x", "p"], ["g", "jac_g_x"])

    def _slopes(self, w: ca.MX) -> list[tuple[ca.MX, tuple[np.ndarray, np.ndarray, np.ndarray]]]:
        """Of each term the entries of all Jacobians, and the row, the unknown and the weight of each."""
        found: list[tuple[ca.MX, tuple[np.ndarray, np.ndarray, np.ndarray]]] = []
        for term in self.terms:
            i, j = term.smooth.slope_entries
            if term.count and i.size:
                entries = term.everywhere(term.smooth.slopes, *term.at(w))
                where = term.rows[i], term.places[j], term.weights[i] * term.units[j]
                found.append((entries, (_column(where[0]), _column(where[1]), _column(where[2]))))
        return found

    @functools.cached_property
    def _hessian(self) -> ca.Function:
        w, p = ca.MX.sym("w", self.size), ca.MX.sym("p", 0)
        of_cost, of_rows = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.rows)
        factors = ca.vertcat(of_rows, of_cost)
        found = _Collected(self.size, self.size)
        for term in self.terms:
            i, j = term.smooth.curvature_entries
            if not (term.count and i.size):
                continue
            own = self._adding(term).T @ factors
            entries = term.everywhere(term.smooth.curvature, *term.at(w), ca.reshape(own, *term.rows.shape[::-1]))
            a, b = _column(term.places[i]), _column(term.places[j])
            twice = np.where((a == b) & np.repeat(i != j, term.count), 2.0, 1.0)  # two arguments that are one unknown
            found.add(
                np.minimum(a, b),
                np.maximum(a, b),
                twice * _column(term.units[i] * term.units[j]),
                (entries, np.arange(a.size), a.size),
            )
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("hess_lag", [w, p, of_cost, of_rows], [found.matrix()], names, ["triu_hess_gamma_x_x"])


def _column(table: np.ndarray) -> np.ndarray:
    return table.ravel()


def _sparse(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, n: int, m: int) -> ca.DM:
    return ca.DM.triplet(rows.tolist(), columns.tolist(), ca.DM(values), n, m)


class _Collected:
    """A sparse matrix (n, m) whose entries are sums of constants and of given numbers."""

    def __init__(self, n: int, m: int) -> None:
        self._shape = n, m
        self._parts: list[tuple[np.ndarray, np.ndarray, tuple[ca.MX, np.ndarray, int] | None]] = []

    def add(self, rows: np.ndarray, columns: np.ndarray, values: np.ndarray, of: tuple[ca.MX, np.ndarray, int] | None) -> None:
        """`values` at these places, each times the number at a place of a column: (column, places, its size)."""
        self._parts.append((columns * self._shape[0] + rows, values, of))

    def matrix(self) -> ca.MX:
        """The sum."""
        n, m = self._shape
        keys = np.unique(np.concatenate([np.zeros(0, dtype=int), *(key for key, _, _ in self._parts)]))
        entries = ca.MX(ca.DM.zeros(keys.size))
        for key, values, of in self._parts:
            where = np.searchsorted(keys, key)
            if of is None:
                entries += ca.DM(np.bincount(where, values, keys.size))
            else:
                entries += _sparse(where, of[1], values, keys.size, of[2]) @ of[0]
        sparsity = ca.Sparsity.triplet(n, m, (keys % n).tolist(), (keys // n).tolist())
        return ca.sparsity_cast(entries, sparsity) if keys.size else ca.MX(n, m)
