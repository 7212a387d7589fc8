"""Derivatives of what start values leave open. Which of many states a search takes is its own rule (the nearest to the sketch, over all joints): so
along what is open, and only there, the search itself is differentiated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_STRIDE = 0.05
"""The first step of differences, as a part of what is much for what moves most."""
_HALVES = 14
_FINE = 1e-10
"""An estimated error, as a part of the derivative, below which shorter steps only bring rounding: a scene's sizes may be far larger than how far a search bends."""
_ENOUGH = 1e-3
"""An estimated error, as a part of the derivative, from which on differences tell nothing: branches change next to there, say."""


def by_search(
    found: Callable[[np.ndarray], np.ndarray | None], data: np.ndarray, change: np.ndarray, least: np.ndarray, sizes: np.ndarray
) -> np.ndarray | None:
    """dx (nx,) of the start that is `found` when the data change by `change`; None where differences tell nothing.

    `least` (nx,): about what moves; `sizes` (nx,): what is much. By differences to both sides with smaller and smaller steps, extrapolated
    (Ridders, Advances in Engineering Software 4, 1982).
    """
    pace = float(np.max(np.abs(least) / sizes, initial=0.0))
    if not 0 < pace < np.inf:
        return None
    best, error, rows = None, np.inf, list[np.ndarray]()
    for k in range(_HALVES):
        h = _STRIDE / pace / 2**k
        ahead, behind = (found(data + side * h * change) for side in (1.0, -1.0))
        if ahead is None or behind is None:
            rows = []
            continue
        row = [(ahead - behind) / (2 * h)]
        for j, former in enumerate(rows):
            row.append(row[j] + (row[j] - former) / (4 ** (j + 1) - 1))
            off = max(_apart(row[-1], row[j], sizes), _apart(row[-1], former, sizes))
            if off <= error:
                best, error = row[-1], off
        rows = row
        if error <= _FINE * pace:
            break
    return best if error <= _ENOUGH * pace else None


def _apart(one: np.ndarray, other: np.ndarray, sizes: np.ndarray) -> float:
    return float(np.max(np.abs(one - other) / sizes, initial=0.0))
