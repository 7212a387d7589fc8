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
from acausal.numerics.vanishing import vanish
from acausal.scalar.dependent import Elimination
from acausal.scalar.equations import EquationSet, ScalarEquation

_KNOWN = 1e-11
"""How well the weights are known in sums of equations that vanish."""


@dataclass(frozen=True)
class Needed:
    """A system without redundant equations between positions, and these."""

    system: EquationSet
    redundant: tuple[ScalarEquation, ...] = ()


def needed(system: EquationSet, flows: Mapping[int, ca.SX], positions: set[int]) -> Needed:
    """`flows`: hash of a flange's position -> the effort there. `positions`: hashes of all unknowns that are positions, of flanges and others.

    Only equations that are linear in positions at the present values of parameters, and in nothing else but the time, are looked at.
    """
    rows = _Rows(system, positions)
    if sum(not e.label.startswith("connection") for e in rows.equations.values()) < 2:
        return Needed(system)
    elimination = Elimination({k: dict(row) for k, row in rows.coefficients.items()})
    sums = [elimination.weights(k) for k in elimination.run()]
    parts = sorted(k for k, e in rows.equations.items() if not e.label.startswith("connection"))
    found: list[tuple[dict[int, float], ca.SX]] = []
    for weights in sums:
        shares = _shares(rows, {k: weights[k] for k in parts if k in weights}, flows)
        if not shares.is_zero() and rows.vanish(weights):
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
        self.equations: dict[int, ScalarEquation] = {}
        self.symbols: dict[int, list[ca.SX]] = {}
        for k, equation in enumerate(system.equations):
            found = ca.symvar(equation.residual)
            own = [s for s in found if s.element_hash() in unknowns]
            others = [s for s in found if s.element_hash() not in unknowns]
            if own and all(s.element_hash() in positions for s in own) and all(s.element_hash() in rated for s in others):
                self.equations[k], self.symbols[k] = equation, own
        self._values = {s.element_hash(): value for s, value in system.values}
        self.coefficients: dict[int, dict[tuple[int, int], float]] = {}
        for k in list(self.equations):
            row = self._linear(k)
            if row is None:
                del self.equations[k]
            else:
                self.coefficients[k] = row

    def _linear(self, k: int) -> dict[tuple[int, int], float] | None:
        """Coefficients of a row by symbol; None where it is not linear."""
        residual, own = self.equations[k].residual, self.symbols[k]
        slope = ca.densify(ca.jacobian(residual, ca.vertcat(*own)))
        free = ca.symvar(slope)
        if any(s.element_hash() not in self._values for s in free):
            return None
        values = np.array(
            ca.Function("slope", [ca.vertcat(ca.SX(0, 1), *free)], [slope])([self._values[s.element_hash()] for s in free])
        )
        if not np.isfinite(values).all():
            return None
        return {(s.element_hash(), 0): float(a) for s, a in zip(own, values.ravel(), strict=True) if a != 0.0}

    def vanish(self, weights: Mapping[int, float]) -> bool:
        """Whether the sum of equations with these weights is zero whatever the positions are."""
        total = sum((w * self.equations[j].residual for j, w in weights.items()), ca.SX(0))
        symbols = [s for s in ca.symvar(total) if s.element_hash() in self._values]
        values = np.array([self._values[s.element_hash()] for s in symbols])
        return vanish(total, ca.vertcat(ca.SX(0, 1), *symbols), values, known=_KNOWN)


def _shares(rows: _Rows, weights: Mapping[int, float], flows: Mapping[int, ca.SX]) -> ca.SX:
    """Sum over the flanges of the efforts times what balances among them."""
    total = ca.SX(0)
    for j, weight in weights.items():
        for (key, _), coefficient in rows.coefficients[j].items():
            if key in flows:
                total += weight * coefficient * flows[key]
    return total
