"""Whether something vanishes, decided by numbers without unit: values against the terms they are made of, rows and columns brought to one size."""

from __future__ import annotations

import numpy as np

_RANK = 1e-9
_SWEEPS = 3


def equilibrated(A: np.ndarray) -> np.ndarray:
    """A with rows and columns divided by their largest entries until all are about 1: units are gone (Ruiz 2001). Zero rows stay."""
    A = np.array(A, dtype=float)
    if not A.size:
        return A
    for _ in range(_SWEEPS):
        rows, columns = np.sqrt(np.abs(A).max(axis=1)), np.sqrt(np.abs(A).max(axis=0))
        A = A / np.where(rows > 0, rows, 1.0)[:, None] / np.where(columns > 0, columns, 1.0)
    return A


def equilibrated_rank(A: np.ndarray) -> int:
    """Rank of a matrix of numbers whose rows and columns may have any units."""
    s = np.linalg.svd(equilibrated(A), compute_uv=False) if A.size else np.zeros(0)
    return int(np.sum(s > _RANK * s[0])) if s.size and s[0] > 0 else 0
