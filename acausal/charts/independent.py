"""Independent coordinates: which entries of a constrained column may move freely, and how the others follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from acausal.numerics.thresholds import DEPENDENT


@dataclass(frozen=True)
class Independent:
    """A split of n entries by a constraint Jacobian G (m, n): G dy = 0.

    `free` and `dependent`: indices in ascending order, together 0 ... n-1. `tangent` (n, k): dy for unit changes of the free entries.
    """

    free: tuple[int, ...]
    dependent: tuple[int, ...]
    tangent: np.ndarray


def independent_entries(jacobian: np.ndarray, *preferred: Sequence[int]) -> Independent:
    """The dependent entries are those whose columns are most independent (QR with column pivoting, first among the entries that are not
    `preferred`, then among those that are, the last ones last); all others are free. Dependent rows of `jacobian` do no harm. Cost: O(m^2 n).
    """
    import scipy.linalg

    m, n = jacobian.shape
    zero = DEPENDENT * float(np.linalg.norm(jacobian))
    rank = int(np.linalg.matrix_rank(jacobian, tol=zero)) if m and n else 0
    if rank == 0:
        return Independent(tuple(range(n)), (), np.eye(n))
    level = {i: k for k, own in enumerate(preferred, 1) for i in own}
    groups = [[i for i in range(n) if level.get(i, 0) == k] for k in range(len(preferred) + 1)]
    dependent: list[int] = []
    rest = jacobian.copy()
    for group in groups:
        if not group or len(dependent) == rank:
            continue
        R, order = cast(tuple[np.ndarray, np.ndarray], scipy.linalg.qr(rest[:, group], mode="r", pivoting=True))
        size = np.abs(np.diag(R))
        count = min(int(np.sum(size > zero)), rank - len(dependent))
        chosen = [group[i] for i in order[:count]]
        dependent += chosen
        basis = np.linalg.qr(jacobian[:, dependent])[0]
        rest = jacobian - basis @ (basis.T @ jacobian)
    dependent.sort()
    free = [i for i in range(n) if i not in set(dependent)]
    tangent = np.zeros((n, len(free)))
    tangent[free, range(len(free))] = 1.0
    tangent[dependent, :] = -np.linalg.lstsq(jacobian[:, dependent], jacobian[:, free], rcond=None)[0]
    return Independent(tuple(free), tuple(dependent), tangent)
