"""Equations between positions that follow from others: two equal gears between the same shafts, the planets of one train.

They say nothing of the motion, and leave open how the parts share their efforts: if sum w_k g_k = 0 for whatever positions, efforts w_k dg_k/dx on
the flanges x balance one another. Of all efforts with the same motion the smallest are taken (least squares), as for reactions of loops: the
efforts have no share in that direction, which is the equation that takes the redundant one's place.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.errors import LockedError
from acausal.graphs import Graph
from acausal.numerics.vanishing import vanish
from acausal.scalar.dependent import Elimination, Row
from acausal.scalar.equations import EquationSet, ScalarEquation

_PLACES = 3
_KNOWN = 1e-11
"""How well the weights are known in sums of equations that vanish."""


@dataclass(frozen=True)
class Needed:
    """A system without redundant equations between positions, and these."""

    system: EquationSet
    redundant: tuple[ScalarEquation, ...] = ()


def needed(system: EquationSet, flows: Mapping[int, ca.SX], positions: set[int]) -> Needed:
    """`flows`: hash of a flange's position -> the effort there. `positions`: hashes of all unknowns that are positions, of flanges and others.

    Only equations between positions, at the present values of parameters, and of the time are looked at: those that are linear, and the others by themselves.
    """
    rows = _Rows(system, positions)
    parts = sorted(k for k, e in rows.equations.items() if not e.label.startswith("connection"))
    if len(parts) < 2:
        return Needed(system)
    found: list[tuple[dict[int, float], ca.SX]] = []
    for candidates, residuals in (rows.linear, rows.bent):
        elimination = Elimination(candidates)
        for weights in [elimination.weights(k) for k in elimination.run()]:
            shares = rows.shares({k: weights[k] for k in parts if k in weights}, flows)
            if not shares.is_zero() and rows.vanish(weights, residuals):
                found.append((weights, shares))
    equations, redundant = list(system.equations), list[ScalarEquation]()
    for k, (_, shares) in zip(_dropped([weights for weights, _ in found], parts), found, strict=True):
        redundant.append(equations[k])
        equations[k] = replace(equations[k], residual=shares)
    return Needed(replace(system, equations=tuple(equations)), tuple(redundant))


def without_efforts(system: EquationSet, places: Collection[int], flows: Mapping[int, ca.SX]) -> EquationSet:
    """With the equations at these places replaced: instead of holding positions x by g(x) = 0 they transmit nothing, sum dg/dx times the efforts is 0.

    Raises `LockedError` for one that has no efforts.
    """
    equations = list(system.equations)
    for k in places:
        residual = equations[k].residual
        own = [s for s in ca.symvar(residual) if s.element_hash() in flows]
        share = sum((ca.jacobian(residual, s) * flows[s.element_hash()] for s in own), ca.SX(0))
        if share.is_zero():
            raise LockedError(
                f"Equation {equations[k]} holds joints that loops hold already. Remove it, or put a spring between."
            )
        equations[k] = replace(equations[k], residual=share)
    return replace(system, equations=tuple(equations))


def _dropped(sums: Sequence[Mapping[int, float]], parts: Sequence[int]) -> list[int]:
    """An equation of a part for each sum: together they can be left out. The last ones where there is a choice."""
    W = np.array([[weights.get(k, 0.0) for k in parts] for weights in sums]).reshape(len(sums), len(parts))
    chosen: list[int] = []
    for i in range(len(sums)):
        sizes = np.abs(W[i])
        j = int(np.flatnonzero(sizes >= 0.5 * np.max(sizes))[-1])
        chosen.append(parts[j])
        W[i + 1 :] -= np.outer(W[i + 1 :, j] / W[i, j], W[i])
    return chosen


class _Rows:
    """The candidates: numbers of equations, and their coefficients at the present values."""

    def __init__(self, system: EquationSet, positions: set[int]) -> None:
        unknowns = {u.symbol.element_hash() for u in (*system.unknowns, *system.outer)}
        unknowns |= {rate.element_hash() for rate, _ in system.derivatives}
        rated = {s.element_hash() for s, _ in system.known_rates}
        self._positions = positions
        self.equations: dict[int, ScalarEquation] = {}
        self.symbols: dict[int, list[ca.SX]] = {}
        for k, equation in enumerate(system.equations):
            found = ca.symvar(equation.residual)
            own = [s for s in found if s.element_hash() in unknowns]
            others = [s for s in found if s.element_hash() not in unknowns]
            if own and all(s.element_hash() in positions for s in own) and all(s.element_hash() in rated for s in others):
                self.equations[k], self.symbols[k] = equation, own
        self._values = {s.element_hash(): value for s, value in system.values}
        self._coefficients = {k: row for k in self.equations if (row := self._linear(k)) is not None}

    @property
    def linear(self) -> tuple[dict[int, Row], dict[int, ca.SX]]:
        """Coefficients and residuals of those that are linear."""
        return {k: dict(row) for k, row in self._coefficients.items()}, {
            k: self.equations[k].residual for k in self._coefficients
        }

    @property
    def bent(self) -> tuple[dict[int, Row], dict[int, ca.SX]]:
        """Slopes at some places, and residuals, of the others, with one position for all that are always the same."""
        numbers = [k for k in self.equations if k not in self._coefficients]
        if len(numbers) < 2:
            return {}, {}
        old, new = self._same()
        residuals = {k: ca.substitute([self.equations[k].residual], old, new)[0] for k in numbers}
        symbols = ca.symvar(ca.vertcat(*residuals.values()))
        rng = np.random.default_rng(5)
        places = [np.array([self._values.get(s.element_hash(), rng.uniform(0.5, 1.5)) for s in symbols]) for _ in range(_PLACES)]
        unknowns = [s for s in symbols if s.element_hash() in self._positions]
        slopes = ca.Function(
            "slopes", [ca.vertcat(*symbols)], [ca.densify(ca.jacobian(ca.vertcat(*residuals.values()), ca.vertcat(*unknowns)))]
        )
        found = np.stack([np.array(slopes(place)) for place in places], axis=-1)
        rows = {
            k: {(s.element_hash(), p): float(a) for s, at in zip(unknowns, of, strict=True) for p, a in enumerate(at) if a != 0.0}
            for k, of in zip(numbers, found, strict=True)
            if np.isfinite(of).all()
        }
        return rows, residuals

    def _same(self) -> tuple[list[ca.SX], list[ca.SX]]:
        """Positions that equations set equal, and the ones that stand for them."""
        symbols = {s.element_hash(): s for own in self.symbols.values() for s in own}
        equal = list[tuple[int, int]]()
        for k in self._coefficients:
            if len(self.symbols[k]) == 2:
                a, b = self.symbols[k]
                if ca.substitute(self.equations[k].residual, a, b).is_zero():
                    equal.append((a.element_hash(), b.element_hash()))
        pairs = [(symbols[other], symbols[part[0]]) for part in Graph(list(symbols), equal).parts() for other in part[1:]]
        return [old for old, _ in pairs], [new for _, new in pairs]

    def _linear(self, k: int) -> Row | None:
        """Coefficients of a row by symbol; None where it is not linear."""
        residual, own = self.equations[k].residual, self.symbols[k]
        slope = ca.densify(ca.jacobian(residual, ca.vertcat(*own)))
        free = ca.symvar(slope)
        if any(s.element_hash() not in self._values for s in free):
            return None
        if not slope.is_constant():
            at = ca.Function("slope", [ca.vertcat(ca.SX(0, 1), *free)], [slope])
            slope = at([self._values[s.element_hash()] for s in free])
        values = np.array(ca.DM(slope))
        if not np.isfinite(values).all():
            return None
        return {(s.element_hash(), 0): float(a) for s, a in zip(own, values.ravel(), strict=True) if a != 0.0}

    def vanish(self, weights: Mapping[int, float], residuals: Mapping[int, ca.SX]) -> bool:
        """Whether the sum of equations with these weights is zero whatever the positions are."""
        total = sum((w * residuals[j] for j, w in weights.items()), ca.SX(0))
        symbols = [s for s in ca.symvar(total) if s.element_hash() in self._values]
        values = np.array([self._values[s.element_hash()] for s in symbols])
        return vanish(total, ca.vertcat(ca.SX(0, 1), *symbols), values, known=_KNOWN)

    def shares(self, weights: Mapping[int, float], flows: Mapping[int, ca.SX]) -> ca.SX:
        """Sum over the flanges of the efforts times what balances among them."""
        total = ca.SX(0)
        for j, weight in weights.items():
            known = self._coefficients.get(j)
            for s in self.symbols[j]:
                key = s.element_hash()
                if key in flows:
                    slope = ca.jacobian(self.equations[j].residual, s) if known is None else ca.SX(known.get((key, 0), 0.0))
                    total += weight * slope * flows[key]
        return total
