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

from acausal.explain.integrability.brackets import Rank, involutive_closure
from acausal.explain.integrability.pfaffian import PfaffianSystem, common, null_space, row_space
from acausal.loops.redundancy import independent_rows


@dataclass(frozen=True)
class Growth:
    """What a set of velocity constraints allows and hides, found at some points of the manifold of configurations.

    `manifold`: its dimension. `growth`: dimensions of the admissible velocities and of their brackets of length 1, 2, ... `points`, and
    at each `forbidden`: orthonormal rows (r, n), what no admissible velocity has a part in. `linear` (k, n): what is forbidden everywhere alike, so
    that it can be integrated at once, gradients of holonomic constraints left out. `independent`: rows that are neither redundant nor rates of
    holonomic constraints. `clear`: all ranks were far from the border between rounding errors and numbers. `complete`: no expression
    became too large; otherwise `growth` ends too early.
    """

    manifold: int
    growth: tuple[int, ...]
    independent: tuple[int, ...]
    points: tuple[np.ndarray, ...]
    forbidden: tuple[np.ndarray, ...]
    linear: np.ndarray
    clear: bool
    complete: bool

    @property
    def hidden(self) -> int:
        """Number of independent functions of position that the velocity constraints keep constant; of those known, where not complete."""
        return self.manifold - self.growth[-1] if self.complete else self.linear.shape[0]

    @property
    def integrable(self) -> bool:
        """Whether the velocity constraints are rates of positions, all of them."""
        return len(self.growth) == 1


def growth(system: PfaffianSystem) -> Growth:
    """Frobenius' test with exact derivatives at random points, ranks by singular values.

    Three points; more than there are coordinates where something may be hidden. One bracket needs derivatives of the forms only, at a cost like
    that of their Jacobian; further ones are made only where some but not all combinations of the constraints pass it, and until all that is left is
    known to be constant. Raises `AssemblyError` where no points are found.
    """
    rank = Rank()
    look = _Look.at(system, system.points(), rank)
    if look.first < len(look.independent):
        look = _Look.at(system, system.points(system.y.numel() + 3), rank)
    manifold = system.y.numel() - look.gradients[0].shape[0]
    linear = look.linear() if look.first < len(look.independent) else np.zeros((0, system.y.numel()))
    velocities = manifold - len(look.independent)
    dimensions = (velocities, velocities + look.first) if look.first else (velocities,)
    complete = True
    if look.first and dimensions[-1] < manifold - linear.shape[0]:
        closure = involutive_closure(system, look.points, manifold - linear.shape[0], rank)
        dimensions, complete = max(closure.dimensions, dimensions), closure.complete
    return Growth(manifold, dimensions, look.independent, look.points, look.forbidden, linear, rank.clear, complete)


@dataclass(frozen=True)
class _Look:
    """What the constraints are at some points: orthonormal rows of the holonomic gradients and of all, and how many directions one bracket adds."""

    points: tuple[np.ndarray, ...]
    gradients: tuple[np.ndarray, ...]
    forbidden: tuple[np.ndarray, ...]
    independent: tuple[int, ...]
    first: int

    @classmethod
    def at(cls, system: PfaffianSystem, points: Sequence[np.ndarray], rank: Rank) -> _Look:
        numbers = system.numbers()
        values = [numbers(point) for point in points]
        spaces = [(row_space(dc), row_space(np.vstack([dc, W]))) for dc, W, _ in values]
        # a point with fewer independent rows than others is a singular one
        ranks = [(a.shape[0], b.shape[0]) for a, b in spaces]
        usual = [k for k, r in enumerate(ranks) if r == max(ranks)]
        independent = independent_rows([values[k][1] @ null_space(values[k][0]) for k in usual]).kept
        first = max(_first_bracket(*values[k], independent, rank) for k in usual)
        return cls(
            tuple(points[k] for k in usual), tuple(spaces[k][0] for k in usual), tuple(spaces[k][1] for k in usual), independent, first
        )  # fmt: skip

    def linear(self) -> np.ndarray:
        """What is forbidden at all points alike, less what is the gradient of holonomic constraints: orthonormal rows."""
        everywhere, known = common(self.forbidden), common(self.gradients)
        _, sizes, directions = np.linalg.svd(everywhere - (everywhere @ known.T) @ known, full_matrices=False)
        return directions[sizes > 0.5]  # sines of angles between two spaces of which one holds the other: 0 or 1


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
