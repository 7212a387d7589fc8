"""Frobenius' test: which velocity constraints are rates of positions, alone and together.

Constraints w_a(y) y' = 0 are integrable together when every dw_a vanishes on the velocities that they admit. Of those that are not, the
derived system I' = {w in I: dw = 0 on the admissible velocities} is looked at in turn, or, the same from the other side, brackets are added
to the admissible velocities until these close; what is then still forbidden is holonomic (Bryant et al., Exterior Differential
Systems, 1991, II.4; O'Reilly, Intermediate Dynamics for Engineers, 8.5 and 11.7).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.reduction.integrability.brackets import Rank, involutive_closure
from acausal.reduction.integrability.pfaffian import PfaffianSystem, null_space, row_space
from acausal.reduction.redundancy import independent_rows


@dataclass(frozen=True)
class Growth:
    """What a set of velocity constraints allows and hides, found at some points of the manifold of configurations.

    `manifold`: its dimension. `growth`: dimensions of the admissible velocities and of their brackets of length 1, 2, ... `points`, and
    at each `forbidden`: orthonormal rows (r, n), gradients of all functions that stay constant: the holonomic constraints and the hidden ones.
    `independent`: rows that are neither redundant nor rates of holonomic constraints. `clear`: all ranks were far from the border between
    rounding errors and numbers, and no expression became too large.
    """

    manifold: int
    growth: tuple[int, ...]
    independent: tuple[int, ...]
    points: tuple[np.ndarray, ...]
    forbidden: tuple[np.ndarray, ...]
    clear: bool

    @property
    def hidden(self) -> int:
        """Number of independent functions of position that the velocity constraints keep constant."""
        return self.manifold - self.growth[-1]

    @property
    def integrable(self) -> bool:
        """Whether the velocity constraints are rates of positions, all of them."""
        return self.growth[0] == self.growth[-1]


def growth(system: PfaffianSystem) -> Growth:
    """Frobenius' test with exact derivatives at random points, ranks by singular values.

    Three points; more than there are coordinates where something is hidden, so that what is forbidden at all of them is so everywhere.
    """
    found = growth_at(system, system.points())
    return growth_at(system, system.points(system.y.numel() + 3)) if found.hidden else found


def growth_at(system: PfaffianSystem, points: Sequence[np.ndarray]) -> Growth:
    """The test at these points (n,).

    One step needs derivatives of the forms only, at a cost like that of their Jacobian; further brackets are made only where some but not
    all combinations of the constraints pass it.
    """
    numbers = system.numbers()
    values = [numbers(point) for point in points]
    n = system.y.numel()
    tangents = [null_space(dc) for dc, _, _ in values]
    manifold = min(T.shape[1] for T in tangents)
    along = [W @ T for T, (_, W, _) in zip(tangents, values, strict=True) if T.shape[1] == manifold]
    independent = independent_rows(along).kept
    velocities = manifold - len(independent)
    rank = Rank()
    first = max(_first_bracket(dc, W, dW, independent, rank) for dc, W, dW in values)
    dimensions = (velocities, velocities + first) if first else (velocities,)
    complete = True
    if 0 < first < len(independent):
        closure = involutive_closure(system, points, manifold, rank)
        dimensions, complete = closure.dimensions, closure.complete
        forbidden = tuple(null_space(space.T).T for space in closure.spaces)
    elif first:
        forbidden = tuple(row_space(dc) for dc, _, _ in values)
    else:
        forbidden = tuple(row_space(np.vstack([dc, W])) for dc, W, _ in values)
    if n == 0:
        forbidden = tuple(np.zeros((0, 0)) for _ in points)
    return Growth(manifold, dimensions, tuple(independent), tuple(points), forbidden, rank.clear and complete)


def _first_bracket(dc: np.ndarray, W: np.ndarray, dW: np.ndarray, rows: Sequence[int], rank: Rank) -> int:
    """Rank of dw_a over all pairs of admissible velocities: independent directions that brackets of these gain."""
    Z = null_space(np.vstack([dc, W]))
    upper = np.triu_indices(Z.shape[1], 1)
    pairs = [(Z.T @ dW[a] @ Z)[upper] for a in rows]
    if not pairs or not upper[0].size:
        return 0
    sizes = np.array([max(float(np.linalg.norm(dW[a])), 1e-6 * float(np.linalg.norm(W[a]))) for a in rows])
    taken = rank.new_directions(np.zeros((len(rows), 0)), np.array(pairs) / sizes[:, None], np.ones(upper[0].size))[1]
    return len(taken)


def integrable_alone(system: PfaffianSystem, points: Sequence[np.ndarray]) -> tuple[bool, ...]:
    """Of each row by itself, on the manifold of the holonomic constraints: w ^ dw = 0."""
    numbers = system.numbers()
    values = [numbers(point) for point in points]
    return tuple(
        all(_first_bracket(dc, W[[a]], dW[[a]], (0,), Rank()) == 0 for dc, W, dW in values) for a in range(len(system.names))
    )
