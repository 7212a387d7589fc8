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
    """A (..., n, m) with rows and columns divided so that units are gone, and the largest entries are about 1. Zero rows stay."""
    rows, columns = equilibration(A)
    return A / rows[..., None] / columns[..., None, :]


def equilibration(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By what rows (..., n) and columns (..., m) of matrices A (..., n, m) are divided in `equilibrated`; 1 for those that are not finite.

    First so that the entries are as near to 1 as they can be all together, which gives the same matrix whatever the units were; then so that the
    largest ones are (Curtis and Reid, Journal of the Institute of Mathematics and its Applications 10, 1972; Ruiz 2001, whose result alone is
    another for other units).
    """
    sizes = np.where(np.isfinite(A).all(axis=(-2, -1), keepdims=True), np.abs(A), 0.0)
    r, c = np.ones(A.shape[:-1]), np.ones((*A.shape[:-2], A.shape[-1]))
    if not A.size:
        return r, c
    r, c = _largest_alike(sizes, r, c)
    for _ in range(2):
        B = sizes / r[..., None] / c[..., None, :]
        least = _NOTHING * np.minimum(B.max(axis=-1, keepdims=True), B.max(axis=-2, keepdims=True))
        r, c = _middle(sizes, least < B)  # rounding has no say
    return _largest_alike(sizes, r, c)


def _largest_alike(sizes: np.ndarray, r: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From divisors r (..., n) and c (..., m) on, so that the largest entries of rows and columns are about 1."""
    for _ in range(_SWEEPS):
        B = sizes / r[..., None] / c[..., None, :]
        rows, columns = np.sqrt(B.max(axis=-1)), np.sqrt(B.max(axis=-2))
        r, c = r * np.where(rows > 0, rows, 1.0), c * np.where(columns > 0, columns, 1.0)
    return r, c


def _middle(sizes: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Powers of two by which the logarithms of those entries that count are nearest to 0, by least squares; 1 for rows and columns without any."""
    n, m = sizes.shape[-2:]
    logs = np.where(counts, np.log2(np.where(counts, sizes, 1.0)), 0.0)
    links = np.zeros((*sizes.shape[:-2], n + m, n + m))
    links[..., :n, n:], links[..., n:, :n] = counts, np.swapaxes(counts, -2, -1)
    degree = links.sum(axis=-1)
    system = links + np.eye(n + m) * (degree + _SLIGHT)[..., None]
    total = np.concatenate([logs.sum(axis=-1), logs.sum(axis=-2)], axis=-1)
    found = np.linalg.solve(system, total[..., None])[..., 0]
    first = _first_rows(links)
    found -= np.repeat([1.0, -1.0], [n, m]) * np.where(
        first < n, np.take_along_axis(found, np.minimum(first, n - 1), axis=-1), 0.0
    )  # the first row of what hangs together is not divided: so units of powers of two change no bit
    power = np.exp2(np.floor(np.where(degree > 0, found, 0.0) + _HALF))
    return power[..., :n], power[..., n:]


def _first_rows(links: np.ndarray) -> np.ndarray:
    """For rows, and columns after them, the first of what they hang together with (..., n + m)."""
    part = np.broadcast_to(np.arange(links.shape[-1]), links.shape[:-1])
    while True:
        beside = np.where(links > 0, part[..., None, :], links.shape[-1]).min(axis=-1)
        least = np.minimum(part, beside)
        least = np.take_along_axis(least, least, axis=-1)  # what it hangs together with knows more
        if np.array_equal(least, part):
            return part
        part = least


def equilibrated_rank(A: np.ndarray) -> int:
    """Rank of a matrix of numbers whose rows and columns may have any units."""
    return int(ranks(equilibrated(A[None]))[0])


def ranks(A: np.ndarray) -> np.ndarray:
    """Ranks (k,) of matrices (k, n, m) of numbers that are equilibrated; -1 for those that are not finite."""
    finite = np.array([np.isfinite(one).all() for one in A], dtype=bool)
    if not A.size:
        return np.where(finite, 0, -1)
    s = np.linalg.svd(np.where(finite[:, None, None], A, 0.0), compute_uv=False)
    return np.where(finite, np.sum(s > DEPENDENT * s[:, :1], axis=-1), -1)
