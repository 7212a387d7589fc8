"""Whether something vanishes, decided by numbers without unit: values against the rounding of what they are made of, rows and columns brought
to one size.
"""

from __future__ import annotations

import enum

import casadi as ca
import numpy as np

from acausal.numerics.folding import folded_function
from acausal.numerics.rounding import Rounding
from acausal.numerics.thresholds import DEPENDENT, ROUNDING

_SWEEPS = 3
_NOTHING, _SLIGHT = 1e-14, 1e-9
"""Of all others in its row and its column, an entry that is rounding; what makes a system of equations definite whose solutions differ by constants."""
_HALF = 0.637
"""From where on a power is rounded up: halves are met often."""
_POINTS, _ENOUGH, _DRAWS = 6, 3, 4
_DECADES = 6.0


class Vanishing(enum.Enum):
    """Answers to: is this zero, whatever its symbols are?"""

    YES = enum.auto()
    NO = enum.auto()
    UNKNOWN = enum.auto()
    """It had a value at too few places."""


def vanishing(
    rows: ca.SX, fixed: ca.SX | None = None, values: np.ndarray | None = None, *, known: float = ROUNDING
) -> tuple[Vanishing, ...]:
    """For each row (n, 1) whether it is zero for all values of its symbols, those that are `fixed` (k, 1) at their `values` (k,).

    Looks at places of either sign, some of about 1 and some up to a million times larger or smaller, whatever the unit, and at others
    where there is no value. Zero is what is below `known` times the sizes that are rounded on the way (see `Rounding`): so well are the numbers in the rows known.
    """
    fixed = ca.SX(0, 1) if fixed is None else fixed
    own = {fixed[i].element_hash() for i in range(fixed.numel())}
    free = [s for s in ca.symvar(rows) if s.element_hash() not in own]
    function = folded_function("rows", [fixed, ca.vertcat(ca.SX(0, 1), *free)], [ca.densify(rows)])
    rng, given = np.random.default_rng(11), np.zeros(0) if values is None else values
    zero, seen = np.ones(rows.numel(), dtype=bool), np.zeros(rows.numel(), dtype=int)
    for _ in range(_DRAWS):
        size = 10.0 ** (_DECADES * rng.uniform(-1, 1, (len(free), _POINTS)) * (np.arange(_POINTS) % 2))
        points = size * rng.uniform(0.5, 1.5, size.shape) * rng.choice([-1.0, 1.0], size.shape)
        found, rounding = Rounding(function).around((given, points), (np.abs(given),))
        clear = np.isfinite(found) & np.isfinite(rounding)
        zero &= ~np.any(clear & (np.abs(found) > known / np.finfo(float).eps * rounding), axis=1)
        seen += np.count_nonzero(clear, axis=1)
        if (~zero | (seen >= _ENOUGH)).all():
            break
    return tuple(
        Vanishing.NO if not is_zero else Vanishing.YES if often else Vanishing.UNKNOWN
        for is_zero, often in zip(zero, seen >= _ENOUGH, strict=True)
    )


def vanish(rows: ca.SX, fixed: ca.SX | None = None, values: np.ndarray | None = None, *, known: float = ROUNDING) -> bool:
    """Whether all rows are known to vanish."""
    return all(answer is Vanishing.YES for answer in vanishing(rows, fixed, values, known=known))


def equilibrated(A: np.ndarray) -> np.ndarray:
    """A with rows and columns divided so that units are gone, and the largest entries are about 1. Zero rows stay."""
    rows, columns = equilibration(A)
    return A / rows[:, None] / columns


def equilibration(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By what rows (n,) and columns (m,) of A are divided in `equilibrated`.

    First so that the entries are as near to 1 as they can be all together, which gives the same matrix whatever the units were; then so that the
    largest ones are (Curtis and Reid, Journal of the Institute of Mathematics and its Applications 10, 1972; Ruiz 2001, whose result alone is
    another for other units).
    """
    r, c = np.ones(A.shape[0]), np.ones(A.shape[1])
    if not A.size or not np.isfinite(A).all():
        return r, c
    r, c = _largest_alike(A, r, c)
    for _ in range(2):
        B = np.abs(A) / r[:, None] / c
        least = _NOTHING * np.minimum(B.max(axis=1)[:, None], B.max(axis=0))
        r, c = _middle(np.abs(A), least < B)  # rounding has no say
    return _largest_alike(A, r, c)


def _largest_alike(A: np.ndarray, r: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From divisors r (n,) and c (m,) on, so that the largest entries of rows and columns are about 1."""
    for _ in range(_SWEEPS):
        B = np.abs(A) / r[:, None] / c
        rows, columns = np.sqrt(B.max(axis=1)), np.sqrt(B.max(axis=0))
        r, c = r * np.where(rows > 0, rows, 1.0), c * np.where(columns > 0, columns, 1.0)
    return r, c


def _middle(A: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Powers of two by which the logarithms of those entries that count are nearest to 0, by least squares; 1 for rows and columns without any."""
    n, m = A.shape
    sizes = np.where(counts, np.log2(np.where(counts, A, 1.0)), 0.0)
    links = np.block([[np.zeros((n, n)), counts], [counts.T, np.zeros((m, m))]])
    degree = links.sum(axis=1)
    system = np.diag(degree + _SLIGHT) + links
    found = np.linalg.solve(system, np.concatenate([sizes.sum(axis=1), sizes.sum(axis=0)]))
    side, part = np.repeat([1.0, -1.0], [n, m]), np.arange(n + m)
    while True:  # what hangs together has the number of its first row
        least = np.minimum(part, np.where(links > 0, part, n + m).min(axis=1, initial=n + m))
        if np.array_equal(least, part):
            break
        part = least
    found -= side * np.where(
        part < n, found[np.minimum(part, n - 1)], 0.0
    )  # which is not divided: so units of powers of two change no bit
    power = np.exp2(np.floor(np.where(degree > 0, found, 0.0) + _HALF))
    return power[:n], power[n:]


def equilibrated_rank(A: np.ndarray) -> int:
    """Rank of a matrix of numbers whose rows and columns may have any units."""
    s = np.linalg.svd(equilibrated(A), compute_uv=False) if A.size else np.zeros(0)
    return int(np.sum(s > DEPENDENT * s[0])) if s.size and s[0] > 0 else 0
