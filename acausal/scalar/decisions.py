"""What the reduction decided at the build's values of parameters, and whether it holds at others.

Pivots of linear blocks were chosen once; at other values one may vanish, or the equations may no longer determine their unknowns. Nothing
of this is predicted: at the values of a call the formulas are put into the equations that they solve.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.vanishing import equilibrated, equilibrated_rank, equilibration
from acausal.scalar.solution import LinearBlock
from acausal.wording import compact

_SOLVED = 1e-9
"""What formulas may leave of an equation, of the sum of its terms."""
_BACKWARD = 1e-12
"""What they may leave of any equation where all units are gone, of what is much: an unknown that is zero has no terms of any size."""
_SINGULAR = 1e-9
_POINTS = 2
_LARGEST = 500
"""Unknowns of a block whose rank is taken."""


@dataclass(frozen=True)
class LinearDecisions:
    """Linear blocks with coefficients of parameters p (np, 1); other symbols are sampled."""

    blocks: tuple[LinearBlock, ...]
    p: ca.SX

    @property
    def zero(self) -> float:
        """A block whose `margins` are below this has no inverse."""
        return _SINGULAR

    def margins(self, values: np.ndarray) -> list[float]:
        """Of each block: the smallest singular value of its matrix beside the largest, rows and columns brought to one size."""
        if not self.blocks:
            return []
        spectra = [[np.linalg.svd(equilibrated(m), compute_uv=False) for m in matrices] for matrices in self._at(values)[0]]
        return [min(float(s[-1] / s[0]) for s in found) for found in spectra]

    @functools.cached_property
    def _function(self) -> ca.Function:
        outputs = [ca.densify(part) for b in self.blocks for part in (b.matrix, b.right, b.found)]
        known = {self.p[i].element_hash() for i in range(self.p.numel())}
        free = [s for s in ca.symvar(ca.veccat(*outputs)) if s.element_hash() not in known]
        return ca.Function("blocks", [self.p, ca.vertcat(ca.SX(0, 1), *free)], outputs)

    def complaint(self, values: np.ndarray) -> str:
        """Which equations are not solved at these values (np,), in words; empty where all are."""
        if not self.blocks:
            return ""
        for block, matrices, gaps in zip(self.blocks, *self._at(values), strict=True):
            if not all(np.isfinite(gap).all() and (gap <= _SOLVED).all() for gap in gaps):
                return self._words(block, matrices)
            if any(0 < m.shape[0] <= _LARGEST and equilibrated_rank(m) < m.shape[0] for m in matrices):
                return self._words(block, matrices)
        return ""

    def _words(self, block: LinearBlock, matrices: Sequence[np.ndarray]) -> str:
        of = compact((str(source) for source in block.sources), 4)
        unknowns = compact((str(unknown) for unknown in block.unknowns), 4)
        singular = not any(np.isfinite(m).all() and equilibrated_rank(m) == m.shape[0] for m in matrices)
        if singular:
            return f"the equations {of} depend on one another and do not determine {unknowns}"
        return f"the equations {of} cannot be solved for {unknowns} in the way that was chosen at the build"

    def _at(self, values: np.ndarray) -> tuple[list[list[np.ndarray]], list[list[np.ndarray]]]:
        """Of each block: its matrices, and what is left of its equations beside their terms, at some points."""
        rng, free = np.random.default_rng(5), self._function.size1_in(1)
        found = [[np.array(part) for part in self._function.call([values, rng.uniform(0.5, 1.5, free)])] for _ in range(_POINTS)]
        matrices = [[point[3 * k] for point in found] for k in range(len(self.blocks))]
        return matrices, [[_left(*point[3 * k : 3 * k + 3]) for point in found] for k in range(len(self.blocks))]


def _left(matrix: np.ndarray, right: np.ndarray, solution: np.ndarray) -> np.ndarray:
    """Of each row, 0 where nothing but rounding is."""
    with np.errstate(all="ignore"):
        terms, left = np.abs(matrix) @ np.abs(solution) + np.abs(right), np.abs(matrix @ solution - right)
        rows, columns = equilibration(matrix)
        much = np.max(np.abs(solution[:, 0]) * columns) + np.max(np.abs(right[:, 0]) / rows)
        rounding = left[:, 0] / rows <= _BACKWARD * much
        return np.where(rounding[:, None], 0.0, left / np.where(terms > 0, terms, 1.0))


def linear_decisions(blocks: Sequence[LinearBlock], p: ca.SX) -> LinearDecisions:
    """Of the blocks in whose matrix there are parameters."""
    known = {p[i].element_hash() for i in range(p.numel())}
    own = [b for b in blocks if any(s.element_hash() in known for s in ca.symvar(b.matrix))]
    return LinearDecisions(tuple(own), p)
