"""The whole reduction: equations become states with their rates, invariants, nonlinear blocks, and values of everything else.

Aliases and hidden constraints; structural check (Dulmage-Mendelsohn); Pantelides; dummy derivatives; block lower triangular form;
blocks solved in that order. Near-linear in the number of equations but for the size of single blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from acausal.errors import ModelError, UnderdeterminedError
from acausal.numerics.elimination import solved_by_qr
from acausal.scalar.alias import Simplified, eliminate_aliases
from acausal.scalar.chains import Level
from acausal.scalar.diagnosis import check_regular, no_jerk, no_rate, singular
from acausal.scalar.differentiation import Differentiation
from acausal.scalar.equations import EquationSet, ScalarEquation, Unknown, check
from acausal.scalar.hidden import hidden_sums
from acausal.scalar.index_reduction import Offsets, differentiation_counts
from acausal.scalar.matching import blocks, match, underdetermined
from acausal.scalar.naming import Names
from acausal.scalar.solution import AlgebraicBlock, LinearBlock, Solution
from acausal.scalar.state_choice import choose_dummies


@dataclass(frozen=True)
class Invariant:
    """A constraint that its differentiated form keeps: `residual` = 0 in `states` (symbols), the outer block's coordinates and known symbols.

    `depth`: how many differentiations below the form that determines accelerations: 1 a constraint of velocities, 2 of positions. `push`:
    the symbol of what that form is to be, zero in a motion.
    """

    residual: ca.SX
    states: tuple[ca.SX, ...]
    source: ScalarEquation
    depth: int
    push: ca.SX


@dataclass(frozen=True)
class ReducedEquations:
    """`states` with their `rates`, then the unknowns of nonlinear blocks; `values` of every declared symbol, by element hash.

    All in the symbols of states, known symbols, the outer block's coordinates and highest derivatives, and the invariants' pushes.
    `tops`: the highest derivative that each state has in the equations, which lies `depths` above it.
    """

    states: tuple[Unknown, ...]
    rates: tuple[ca.SX, ...]
    tops: tuple[ca.SX, ...]
    depths: tuple[int, ...]
    algebraic: tuple[AlgebraicBlock, ...]
    invariants: tuple[Invariant, ...]
    values: dict[int, ca.SX]
    steps: tuple[tuple[str, ...], ...]
    """Names of the unknowns of each block, in the order of solution."""
    blocks: tuple[LinearBlock, ...] = ()

    def __str__(self) -> str:
        lines = [
            f"{len(self.states)} states, {sum(len(b.unknowns) for b in self.algebraic)} of nonlinear blocks, {len(self.invariants)} invariants"
        ]
        lines += [f"  {state.name}' = {rate}" for state, rate in zip(self.states, self.rates, strict=True)]
        lines += [f"  {', '.join(u.name for u in b.unknowns)} from 0 = {b.residual}" for b in self.algebraic]
        lines += [f"  kept: 0 = {invariant.residual}" for invariant in self.invariants]
        lines += [f"  block: {', '.join(step)}" for step in self.steps]
        return "\n".join(lines)


def reduce_equations(system: EquationSet) -> ReducedEquations:
    """States, rates, invariants and values. Raises `UnderdeterminedError`, `OverdeterminedError`, `ModelError` with names and lines."""
    check(system)
    return _Reduction(system).run()


@dataclass(frozen=True)
class _Row:
    """One equation at one order of differentiation."""

    residual: ca.SX
    source: ScalarEquation
    levels: tuple[Level, ...]


def _pushed(row: _Row, push: ca.SX | None) -> _Row:
    """The row with its push on the right-hand side."""
    return row if push is None else _Row(row.residual - push, row.source, row.levels)


class _Reduction:
    def __init__(self, system: EquationSet) -> None:
        self.system = system
        self.simplified: Simplified = eliminate_aliases(system)
        self.chains = self.simplified.chains
        self.names = Names(self.chains)
        self.rate = Differentiation(system, self.names)

    def run(self) -> ReducedEquations:
        return self._reduced(self._rows())

    def _reduced(self, rows: list[_Row]) -> ReducedEquations:
        highest = self.chains.orders()
        roots = sorted(highest)
        place = {root: j for j, root in enumerate(roots)}
        orders: list[dict[int, int]] = []
        for row in rows:
            found: dict[int, int] = {}
            for root, order in row.levels:
                found[place[root]] = max(found.get(place[root], 0), order)
            orders.append(found)
        sources = [row.source for row in rows]
        check_regular(self.system, self.chains, sources, [list(o) for o in orders], roots, self.simplified.dropped)
        offsets = differentiation_counts(orders, [highest[root] for root in roots])
        self._check_outer(offsets, rows)
        stages = [self._stages(row, offsets.equations[i]) for i, row in enumerate(rows)]
        chosen = self._dummies(stages, orders, offsets, roots)
        try:
            return self._solved(stages, chosen, offsets, roots)
        except UnderdeterminedError as error:
            shown = self._shown(rows, offsets, roots)
            if shown is None:
                raise
            try:
                return self._reduced(shown)
            except ModelError:
                raise error from None

    def _shown(self, rows: Sequence[_Row], offsets: Offsets, roots: Sequence[int]) -> list[_Row] | None:
        """The rows with sums in the place of some, in which the highest derivatives cancel; None where there are no such sums."""
        place = {root: j for j, root in enumerate(roots)}
        matrix = ca.SX(len(rows), len(roots))
        for i, row in enumerate(rows):
            for root, order in row.levels:
                if order + offsets.equations[i] == offsets.unknowns[place[root]]:
                    level = self.names[root, order]
                    matrix[i, place[root]] = level.factor * ca.jacobian(row.residual, level.unknown.symbol)
        constants = {s.element_hash() for s, rate in self.system.known_rates if rate.is_zero()}
        sums = hidden_sums(matrix, offsets.equations, Solution(self.system, lambda s, e: False).sample, constants)
        found = list(rows)
        for k, weights in sums:
            least = offsets.equations[k]
            total = ca.SX(0)
            for i, weight in weights.items():
                total += weight * self._stages(rows[i], offsets.equations[i] - least)[-1].residual
            gone = [
                level
                for level in self._row(total, rows[k].source).levels
                if level[1] + least == offsets.unknowns[place[level[0]]]
            ]
            symbols = [self.names.symbol(level) for level in gone]
            left = ca.substitute([total], symbols, [ca.SX(0)] * len(symbols))[0] if symbols else total
            found[k] = self._row(left, rows[k].source)
        return found if sums else None

    def _rows(self) -> list[_Row]:
        """What is left after elimination, in the symbols of levels."""
        residuals: dict[int, ca.SX] = dict(self.simplified.general)
        for k, equation in self.simplified.affine.items():
            total = equation.remainder
            for level, coefficient in equation.coefficients.items():
                total = total + coefficient * self.names.bare(level)
            residuals[k] = total
        return [self._row(residuals[k], self.system.equations[k]) for k in sorted(residuals)]

    def _row(self, residual: ca.SX, source: ScalarEquation) -> _Row:
        keys = [s.element_hash() for s in ca.symvar(residual)]
        return _Row(residual, source, tuple(self.names.levels[key] for key in keys if key in self.names.levels))

    def _stages(self, row: _Row, count: int) -> list[_Row]:
        """The equation and its derivatives."""
        stages = [row]
        for _ in range(count):
            stages.append(self._row(self.rate.of(stages[-1].residual, row.source), row.source))
        return stages

    def _check_outer(self, offsets: Offsets, rows: Sequence[_Row]) -> None:
        """The outer block's equations hold coefficients without rates: they cannot be differentiated."""
        place = {id(e): k for k, e in enumerate(self.system.of_outer)}
        for row, c in zip(rows, offsets.equations, strict=True):
            if c and id(row.source) in place:
                outer = self.system.outer[place[id(row.source)]]
                root = self.chains.members[outer.symbol.element_hash()].base
                top = max(k for r, k in row.levels if r == root)
                raise no_jerk(self.names[root, top].unknown, self.chains.above((root, top)))

    def _dummies(
        self, stages: Sequence[Sequence[_Row]], orders: Sequence[dict[int, int]], offsets: Offsets, roots: Sequence[int]
    ) -> dict[int, int]:
        entries: dict[int, dict[int, float | None]] = {}
        constants = {s.element_hash(): s for s, rate in self.system.known_rates if rate.is_zero()}
        numbers = {s.element_hash(): value for s, value in self.system.values}
        for i, c in enumerate(offsets.equations):
            if not c:
                continue
            row: dict[int, float | None] = {}
            for j, order in orders[i].items():
                if order + c == offsets.unknowns[j]:
                    # as the highest derivative enters, so does the highest in the equation itself
                    symbol = self.names.symbol((roots[j], order))
                    factor = self.names[roots[j], order].factor
                    slope = ca.jacobian(stages[i][0].residual, symbol)
                    free = ca.symvar(slope)
                    fixed = all(s.element_hash() in constants for s in free)
                    row[j] = None
                    if fixed:
                        values = [ca.DM(numbers.get(s.element_hash(), 1.0)) for s in free]
                        row[j] = float(ca.Function("slope", free, [ca.densify(slope)]).call(values)[0]) * factor
            entries[i] = row
        outer = {j for j, root in enumerate(roots) if root in self.chains.outer}

        def preference(j: int) -> tuple[float, ...]:
            order = offsets.unknowns[j]
            ranks = [self.names.ranks[roots[j], k] for k in range(order) if (roots[j], k) in self.names.ranks]
            return min(ranks, default=(9.0,))

        return choose_dummies(entries, offsets.equations, outer, preference)

    def _solved(
        self, stages: Sequence[Sequence[_Row]], chosen: dict[int, int], offsets: Offsets, roots: Sequence[int]
    ) -> ReducedEquations:
        taken = {j: offsets.equations[i] for i, j in chosen.items()}
        # root -> lowest derivative that is not a state
        first = {root: offsets.unknowns[j] - taken.get(j, 0) for j, root in enumerate(roots)}
        unknown = [(root, k) for j, root in enumerate(roots) for k in range(first[root], offsets.unknowns[j] + 1)]
        index = {level: u for u, level in enumerate(unknown)}
        pushes = {i: ca.SX.sym("push") for i, own in enumerate(stages) if i not in chosen and len(own) > 1}
        rows = [row for i, own in enumerate(stages) for row in (own if i in chosen else [_pushed(own[-1], pushes.get(i))])]
        kept = [(row, len(stages[i]) - 1 - k, push) for i, push in pushes.items() for k, row in enumerate(stages[i][:-1])]
        incidence = [[index[level] for level in row.levels if level in index] for row in rows]
        owner = match(incidence, len(unknown))
        bad = underdetermined(incidence, owner)
        if bad is not None or len(rows) != len(unknown):
            users = [rows[e].source for e in bad.equations] if bad else [row.source for row in rows]
            raise singular(self.system, users, (self.names[unknown[u]].unknown for u in (bad.unknowns if bad else ())))
        tops = {self.names.symbol(level).element_hash() for level in unknown if level[0] in self.chains.outer}
        of_outer = {id(e) for e in self.system.of_outer}
        solution = Solution(self.system, lambda s, e: s.element_hash() in tops and id(e) in of_outer)
        held = {equation: u for u, equation in enumerate(owner)}
        steps: list[tuple[str, ...]] = []
        for block in blocks(incidence, owner):
            own = [self.names[unknown[held[e]]].unknown for e in block]
            solution.solve([rows[e].residual for e in block], [rows[e].source for e in block], own)
            steps.append(tuple(u.name for u in own))
        states = [(root, k) for root in roots if root not in self.chains.outer for k in range(first[root])]
        rates = solution.resolved([self.names.rate(level) for level in states])
        top = {root: offsets.unknowns[j] for j, root in enumerate(roots)}
        tops = solution.resolved([self.names[level].factor * self.names.bare((level[0], top[level[0]])) for level in states])
        return ReducedEquations(
            tuple(self.names[level].unknown for level in states), tuple(rates), tuple(tops), tuple(top[root] - k for root, k in states),
            tuple(solution.algebraic), tuple(self._invariant(*found, solution) for found in kept), self._values(solution), tuple(steps), tuple(solution.blocks),
        )  # fmt: skip

    def _invariant(self, row: _Row, depth: int, push: ca.SX, solution: Solution) -> Invariant:
        residual = solution.resolved([row.residual])[0]
        self._check_timed(residual, row.source)
        found = [(s, self.names.levels.get(s.element_hash())) for s in ca.symvar(residual)]
        inner = tuple(s for s, level in found if level is not None and level[0] not in self.chains.outer)
        return Invariant(residual, inner, row.source, depth, push)

    def _check_timed(self, residual: ca.SX, source: ScalarEquation) -> None:
        """An invariant holds at all times, so everything in it has a rate."""
        rates = {s.element_hash() for s, _ in self.system.known_rates}
        for symbol in ca.symvar(residual):
            if symbol.element_hash() not in rates and symbol.element_hash() not in self.names.levels:
                raise no_rate(self.system, symbol, source)

    def _values(self, solution: Solution) -> dict[int, ca.SX]:
        keys = list(self.chains.members)
        members = [self.chains.members[key] for key in keys]
        found = solution.resolved([self.names.value(m.base, m.order) for m in members])
        return dict(zip(keys, found, strict=True))


def algebraic_rates(block: AlgebraicBlock, symbols: Sequence[ca.SX], rates: Sequence[ca.SX]) -> ca.SX:
    """z' = -g_z^-1 (g_t + g_x x') for the unknowns z of 0 = g(t, x, z), from symbols (t, x) and their rates."""
    if not block.unknowns:
        raise ModelError("A block without unknowns has no rates.")
    z = ca.vertcat(*(u.symbol for u in block.unknowns))
    change = ca.jtimes(block.residual, ca.vertcat(*symbols), ca.vertcat(*rates))
    slope = ca.jacobian(block.residual, z)
    return -change / slope if z.numel() == 1 else -solved_by_qr(ca.densify(slope), change)
