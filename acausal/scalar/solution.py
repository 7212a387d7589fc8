"""Blocks solved one after another: explicit assignments, linear blocks, and nonlinear blocks whose torn unknowns become states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.scalar.diagnosis import singular
from acausal.scalar.equations import EquationSet, ScalarEquation, Unknown, symbols_in
from acausal.scalar.linear import SingularMatrixError, solve_linear
from acausal.scalar.structure import forms
from acausal.scalar.tearing import tear

_OTHERS = 2
"""Sample points with other values of the parameters."""
_DECADES = 9.0
"""How far the sizes of what is not known lie apart there."""
_DRAWN = 32
"""Points at which a block may have an inverse that it seems not to have."""


@dataclass(frozen=True)
class AlgebraicBlock:
    """0 = residual(t, states, unknowns): the unknowns (n, 1) are kept as states, the residual (n, 1) as invariant.

    `whole`: all unknowns (m, 1) of the block, of which those are the ones that the others follow from; `rows` (m, 1): its equations in all.
    """

    unknowns: tuple[Unknown, ...]
    residual: ca.SX
    sources: tuple[ScalarEquation, ...]
    whole: tuple[Unknown, ...]
    rows: ca.SX


@dataclass(frozen=True)
class LinearBlock:
    """matrix (n, n) found (n, 1) = right (n, 1), by states and known symbols; `found` is right where the pivots that were chosen do not vanish."""

    matrix: ca.SX
    right: ca.SX
    found: ca.SX
    sources: tuple[ScalarEquation, ...]
    unknowns: tuple[Unknown, ...]


@dataclass
class Solution:
    """Values of symbols as far as they are known, by states and known symbols; grows block by block."""

    system: EquationSet
    kept: Callable[[ca.SX, ScalarEquation], bool]
    """Whether an unknown of a block of its own stays as it is, because an outer block gives it."""
    values: dict[int, ca.SX] = field(default_factory=dict)
    algebraic: list[AlgebraicBlock] = field(default_factory=list)
    blocks: list[LinearBlock] = field(default_factory=list)

    def __post_init__(self) -> None:
        zero = {s.element_hash() for s, rate in self.system.known_rates if rate.is_zero()}
        self._constants = zero
        self._random = np.random.default_rng(0)
        present = np.array([value for _, value in self.system.values])
        others = np.where(present != 0, present, 1.0) * self._random.uniform(0.5, 1.5, (_OTHERS, present.size))
        points = np.vstack([present[None, :], others, self.system.limits.reshape(len(self.system.limits), present.size)])
        self._points = points.shape[0]
        self._samples = {symbol.element_hash(): points[:, k] for k, (symbol, _) in enumerate(self.system.values)}
        self._measured = {u.symbol.element_hash() for u in (*self.system.unknowns, *self.system.outer) if u.unit in ("rad", "1")}
        # others may be of any size: wherever they are all at once, nothing vanishes by accident
        self._decades = np.where(np.isin(np.arange(self._points), np.arange(1, 1 + _OTHERS)), _DECADES, 0.0)

    def resolved(self, expressions: Sequence[ca.SX]) -> list[ca.SX]:
        """Expressions with known values put in. Costs what the expressions themselves cost."""
        symbols = symbols_in(expressions)
        known = [(s, self.values[key]) for key, s in symbols.items() if key in self.values]
        return ca.substitute(list(expressions), [s for s, _ in known], [v for _, v in known]) if known else list(expressions)

    def solve(self, residuals: Sequence[ca.SX], sources: Sequence[ScalarEquation], unknowns: Sequence[Unknown]) -> None:
        """Adds the values of the unknowns of a block. Raises UnderdeterminedError where it has no inverse."""
        column = ca.vertcat(*(u.symbol for u in unknowns))
        stacked = ca.vertcat(*residuals)
        matrix = ca.sparsify(ca.jacobian(stacked, column))
        if len(unknowns) == 1 and matrix.is_one() and self.kept(unknowns[0].symbol, sources[0]):
            return
        if _depends(matrix, column):
            self._solve_nonlinear(residuals, sources, unknowns)
            return
        rest = ca.substitute([stacked], [u.symbol for u in unknowns], [ca.SX(0)] * len(unknowns))[0]
        matrix, rest = self.resolved([matrix, rest])
        if len(unknowns) == 1 and matrix.is_constant() and not matrix.is_zero():
            found = [-rest if float(matrix) == 1 else rest if float(matrix) == -1 else -rest / matrix]
        else:
            try:
                found = solve_linear(matrix, -ca.densify(rest), self.sample, self._constants, self._measured, self._drawn)
            except SingularMatrixError as error:
                raise singular(self.system, (sources[i] for i in error.rows), (unknowns[j] for j in error.columns)) from None
        if not matrix.is_constant():
            self.blocks.append(LinearBlock(matrix, -rest, ca.vertcat(*found), tuple(sources), tuple(unknowns)))
        for unknown, value in zip(unknowns, found, strict=True):
            self.values[unknown.symbol.element_hash()] = value

    def _solve_nonlinear(
        self, residuals: Sequence[ca.SX], sources: Sequence[ScalarEquation], unknowns: Sequence[Unknown]
    ) -> None:
        """Torn unknowns stay symbols."""
        symbols = [u.symbol for u in unknowns]
        known = symbols_in(residuals)
        others = [s for key, s in known.items() if key not in {u.element_hash() for u in symbols}]
        structure = forms(residuals, symbols, others)
        rows = ca.vertcat(*self.resolved(residuals))
        plan = tear([f.symbols for f in structure], [set(f.linear) for f in structure])
        for e, u in plan.steps:
            rest = ca.substitute([residuals[e]], [symbols[u]], [ca.SX(0)])
            self.values[symbols[u].element_hash()] = self.resolved(rest)[0] / -structure[e].linear[u]
        left = self.resolved([residuals[e] for e in plan.residuals])
        torn, of = tuple(unknowns[u] for u in plan.torn), tuple(sources[e] for e in plan.residuals)
        self.algebraic.append(AlgebraicBlock(torn, ca.vertcat(*left), of, tuple(unknowns), rows))

    def sample(self, expressions: list[ca.SX]) -> np.ndarray:
        """Values (n, k) at the present parameters, at other ones, and at their limits; anything else random. NaN where there is none."""
        column = ca.vertcat(ca.SX(0, 1), *expressions)
        symbols = ca.symvar(column)
        for symbol in symbols:
            key, draw = symbol.element_hash(), self._random.uniform
            if key not in self._samples:
                decades = 0.0 if key in self._measured else self._decades
                self._samples[key] = draw(0.5, 1.5, self._points) * 10.0 ** (decades * draw(-1.0, 1.0, self._points))
        point = np.array([self._samples[s.element_hash()] for s in symbols]).reshape(len(symbols), self._points)
        values = np.array(ca.Function("sample", [ca.vertcat(ca.SX(0, 1), *symbols)], [ca.densify(column)])(point))
        return np.where(np.isfinite(values), values, np.nan) if symbols else np.repeat(values, self._points, axis=1)

    def _drawn(self, expressions: list[ca.SX]) -> np.ndarray:
        """Values (n, k) at the present parameters; anything else random, of sizes that lie far apart, all of them large or small at some points."""
        column = ca.vertcat(ca.SX(0, 1), *expressions)
        symbols, rng = ca.symvar(column), np.random.default_rng(0)
        present = {symbol.element_hash(): value for symbol, value in self.system.values}
        point = np.empty((len(symbols), _DRAWN))
        for k, symbol in enumerate(symbols):
            decades = _DECADES * rng.uniform(-1, 1, _DRAWN) + np.linspace(-2, 2, _DRAWN) * _DECADES
            drawn = rng.uniform(0.5, 1.5, _DRAWN) * 10.0 ** (0 if symbol.element_hash() in self._measured else decades)
            point[k] = present.get(symbol.element_hash(), drawn)
        return np.array(ca.Function("draw", [ca.vertcat(ca.SX(0, 1), *symbols)], [ca.densify(column)]).map(_DRAWN)(point))


def _depends(matrix: ca.SX, column: ca.SX) -> bool:
    own = {s.element_hash() for s in ca.symvar(column)}
    return any(s.element_hash() in own for s in ca.symvar(matrix))
