"""Coordinates that follow from others in closed form: they are no states.

Position constraints that are linear in coordinates with q' = v, with coefficients of numbers and parameters: gears between joints, racks, sources of
angle and position. Velocity constraints with such coefficients (a disk that rolls upright along a line) are integrated; the
constant of integration is found from the start values. Gauss and Jordan's elimination, largest coefficient first. Then what scalar equations say of such a
coordinate by any function of the others: a cam's follower.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.dynamics.tree import Tree
from acausal.numerics.sizes import Drawn, unknown_sizes
from acausal.numerics.thresholds import DEPENDENT


@dataclass(frozen=True)
class Elimination:
    """`symbols` of coordinates and velocities that follow from others, with their `values` in t, the other ones, p and `constants`.

    `places` and `rates`: of the coordinates among q and of the velocities among v. `constants` (n, 1), of integration, with
    their `sources` (n, 1): the expressions in t, q and p that stay constant.
    """

    symbols: tuple[ca.SX, ...]
    values: tuple[ca.SX, ...]
    places: tuple[int, ...]
    rates: tuple[int, ...]
    constants: ca.SX
    sources: ca.SX
    pivots: tuple[float, ...] = ()
    """What was divided by for each coordinate, as part of the largest coefficient of its relation."""
    zero: float = DEPENDENT
    """Below this they count as zero."""

    @classmethod
    def none(cls) -> Elimination:
        """Of nothing."""
        return cls((), (), (), (), ca.SX(0, 1), ca.SX(0, 1))

    def put(self, expression: ca.SX) -> ca.SX:
        """The expression without what is eliminated."""
        if not self.symbols:
            return expression
        return ca.substitute(expression, ca.vertcat(*self.symbols), ca.vertcat(*self.values))


@dataclass(frozen=True)
class _Relation:
    """coefficients (1, n) of the plain coordinates, plus `rest` in t, p and constants, is zero; `pivot`: the coordinate that follows."""

    coefficients: ca.SX
    rest: ca.SX
    pivot: int = -1
    size: float = 0.0
    """Of the pivot, as part of the largest coefficient of the row as it was given."""

    def solved(self, y: ca.SX, rest: ca.SX) -> ca.SX:
        """The pivot's entry of y (n, 1), with `rest` for the part that is not in y."""
        others = ca.SX(self.coefficients)
        others[self.pivot] = 0
        return -(ca.sparsify(others) @ y + rest) / self.coefficients[self.pivot]

    def without(self, other: _Relation) -> _Relation:
        """With the pivot of `other` eliminated."""
        factor = self.coefficients[other.pivot] / other.coefficients[other.pivot]
        if factor.is_zero():
            return self
        coefficients = self.coefficients - factor * other.coefficients
        coefficients[other.pivot] = 0
        return replace(self, coefficients=ca.sparsify(coefficients), rest=self.rest - factor * other.rest)


def eliminate(
    tree: Tree, position: ca.SX, velocity: ca.SX, moving: ca.SX, parameters: ca.SX, values: np.ndarray, explicit: ca.SX
) -> Elimination:
    """From constraints `position` (n, 1) and `velocity` (m, 1) in t, x, p, of which some may follow from the former.

    `moving`: everything but the parameters that changes during a motion, without the time: states and inputs. `explicit`: rows of `position` that may give a coordinate by any
    function of others.
    """
    plain = _plain(tree)
    if not plain or not (position.numel() or velocity.numel()):
        return Elimination.none()
    found = _linear_ones(tree, plain, position, velocity, moving, parameters, values)
    q = tree.q[[k for k, _ in plain], :]
    for row in ca.vertsplit(explicit) if explicit.numel() else ():
        if not _linear(row, q, moving, tree.t):
            found = _with_explicit(found, tree, plain, row, moving)
    return found


def _linear_ones(
    tree: Tree,
    plain: list[tuple[int, int]],
    position: ca.SX,
    velocity: ca.SX,
    moving: ca.SX,
    parameters: ca.SX,
    values: np.ndarray,
) -> Elimination:
    q, v = tree.q[[k for k, _ in plain], :], tree.v[[j for _, j in plain], :]
    of_positions, of_rates = _linear(position, q, moving, tree.t), _linear(velocity, v, moving, tree.t)
    turns = tree.turning[0][[k for k, _ in plain]]
    numbers = _Numbers(parameters, values, np.ones(len(plain)), turns).measured([*of_positions, *of_rates])
    known: list[_Relation] = []
    for row in of_positions:
        known = _joined(known, row, numbers)
    constants: list[ca.SX] = []
    sources: list[ca.SX] = []
    for row in of_rates:
        if ca.depends_on(row.rest, tree.t):
            continue  # not integrated
        constant = ca.SX.sym(f"constant[{len(constants)}]")
        kept = row.coefficients @ q + row.rest * tree.t
        grown = _joined(known, replace(row, rest=row.rest * tree.t - constant), numbers)
        if len(grown) > len(known):
            known = grown
            constants.append(constant)
            sources.append(kept)
    positions = [row.solved(q, row.rest) for row in known]
    rates = [row.solved(v, ca.jtimes(row.rest, tree.t, ca.SX(1))) for row in known]
    places = [plain[r.pivot] for r in known]
    return Elimination(
        (*(tree.q[k] for k, _ in places), *(tree.v[j] for _, j in places)), (*positions, *rates),
        tuple(k for k, _ in places), tuple(j for _, j in places),
        ca.vertcat(ca.SX(0, 1), *constants), ca.vertcat(ca.SX(0, 1), *sources), tuple(r.size for r in known),
    )  # fmt: skip


def _with_explicit(known: Elimination, tree: Tree, plain: list[tuple[int, int]], row: ca.SX, moving: ca.SX) -> Elimination:
    """With one more coordinate, of those in which a row is linear with a constant slope, and that it gives by other positions; the last one, a length where there is one."""
    as_written, row = row, known.put(row)
    others = [s for s in ca.symvar(moving) if not ca.depends_on(tree.q, s)]
    if others and ca.depends_on(row, ca.vertcat(*others)):
        return known
    slopes, before = ca.jacobian(row, tree.q), ca.jacobian(as_written, tree.q)
    constant = [k for k in range(tree.q.numel()) if slopes[k].is_constant() and before[k].is_constant() and before[k].nnz()]
    able = [(k, j) for k, j in plain if k in constant and abs(float(slopes[k])) > DEPENDENT * abs(float(before[k]))]
    if not able:
        return known
    k, j = max(able, key=lambda pair: (not tree.turning[0][pair[0]], pair))
    value = -ca.substitute(row, tree.q[k], ca.SX(0)) / slopes[k]
    rate = known.put(ca.jtimes(value, tree.q, tree.rates) + ca.jtimes(value, tree.t, ca.SX(1)))
    mine, given = ca.vertcat(tree.q[k], tree.v[j]), ca.vertcat(value, rate)
    n, values = len(known.places), ca.substitute(list(known.values), [mine], [given]) if known.values else []
    return replace(
        known,
        symbols=(*known.symbols[:n], tree.q[k], *known.symbols[n:], tree.v[j]),
        values=(*values[:n], value, *values[n:], rate),
        places=(*known.places, k),
        rates=(*known.rates, j),
        pivots=(*known.pivots, 1.0),
    )


def _plain(tree: Tree) -> list[tuple[int, int]]:
    """Pairs of places (k in q, j in v) with q[k]' = v[j]."""
    of_v = {tree.v[j].element_hash(): j for j in range(tree.v.numel())}
    rates = ca.densify(tree.rates)
    found = [(k, of_v.get(rates[k].element_hash()) if rates[k].is_symbolic() else None) for k in range(tree.q.numel())]
    return [(k, j) for k, j in found if j is not None]


def _linear(rows: ca.SX, y: ca.SX, moving: ca.SX, t: ca.SX) -> list[_Relation]:
    """The rows that are linear in y (n, 1), with slopes of parameters, and in which nothing else that is `moving` stands but the time t."""
    slopes = ca.jacobian(rows, y)
    found: list[_Relation] = []
    for i in range(rows.numel()):
        coefficients = ca.sparsify(slopes[i, :])
        rest = ca.substitute(rows[i], y, ca.SX.zeros(y.numel()))
        changing = ca.depends_on(coefficients, ca.vertcat(moving, t)) or ca.depends_on(rest, moving)
        if coefficients.nnz() and not changing:
            found.append(_Relation(coefficients, rest))
    return found


@dataclass(frozen=True)
class _Numbers:
    """What coordinates of their `sizes` (n,) make of coefficients at the present parameters; those that are `turns` (n,) are angles."""

    parameters: ca.SX
    values: np.ndarray
    sizes: np.ndarray
    turns: np.ndarray

    def of(self, coefficients: ca.SX) -> np.ndarray:
        function = ca.Function("coefficients", [self.parameters], [ca.densify(coefficients)])
        return np.abs(np.array(function(self.values)).ravel()) * self.sizes

    def measured(self, rows: Sequence[_Relation]) -> _Numbers:
        """With angles of size 1, and lengths by the radii in the rows."""
        A = np.array([self.of(row.coefficients) for row in rows]).reshape(len(rows), self.turns.size)
        return replace(self, sizes=unknown_sizes(A, self.turns, np.zeros(len(rows)), Drawn.exact(len(rows))))


def _joined(known: Sequence[_Relation], row: _Relation, numbers: _Numbers) -> list[_Relation]:
    """The relations with one more, if it does not follow from them."""
    size = float(np.max(numbers.of(row.coefficients)))
    for other in known:
        row = row.without(other)
    left = numbers.of(row.coefficients)
    if not np.max(left, initial=0.0) > DEPENDENT * size:
        return list(known)
    fixed = np.array([row.coefficients[k].is_constant() for k in range(left.size)])
    # a coefficient that no parameter changes cannot become zero
    choice = np.where(fixed, left, 0.0) if np.any(left[fixed] > DEPENDENT * size) else left
    able = np.flatnonzero(choice >= 0.999 * np.max(choice))
    pivot = int(max(able, key=lambda k: (not numbers.turns[k], k)))  # a length is a radius times an angle
    row = replace(row, pivot=pivot, size=float(left[pivot]) / size)
    return [*(other.without(row) for other in known), row]
