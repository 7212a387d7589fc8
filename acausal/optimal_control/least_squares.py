"""The values with which a model is nearest to its data, by their slopes; noise that nobody said is found with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_UNSEEN = 1e-6
"""Singular values of the data's slopes, each of length one, below which these depend on one another, beside the tolerance of the motion."""
_APART = 1e-4
"""The same of rows that count alike, which are known as well as others."""
_UNFELT = 1e-12
"""Of what others do to the data: less is rounding."""
_SETTLED = 1e-12
"""Of what chi squared is for each measured value that is left: what a step would gain, where no step is worth a motion; a millionth of standard errors."""
_VAIN = 1e-6
"""The same, where a step that should gain it gained nothing: what rounding leaves is no more than a thousandth of standard errors."""
_STANDS = 1e-12
"""Of the values, in standard errors: steps that are shorter are none."""
_MOTIONS = 200
"""That are made in one search, at most."""
_ROUNDS, _KNOWN = 30, 1e-4
"""How often noise is looked up anew; by how much of it, at most, where it is known."""
LEFT = 0.5
"""Values that must be left of data for their noise to be known, beside those that unknowns use up."""

Seen = tuple[np.ndarray, np.ndarray]
"""Model less data (m,), and its derivatives by the unknowns (m, n)."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of data (m,): `said`, and those that nobody said, in `groups` (m,) that have one in common; -1: said. `least` (groups,): what is none."""

    said: np.ndarray
    groups: np.ndarray
    least: np.ndarray

    def of(self, found: np.ndarray) -> np.ndarray:
        """(m,), by those of the groups."""
        return np.where(self.groups < 0, self.said, np.append(found, 1.0)[self.groups])

    def left(self, rows: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each group its sum of squares and how many values are left for it, by model less data (m,) and shares (m,) of each that unknowns use up."""
        known, count = self.groups >= 0, self.least.size
        sums = np.bincount(self.groups[known], rows[known] ** 2, count)
        return sums, np.bincount(self.groups[known], 1.0 - used[known], count)


class Fit:
    """What is `seen` for values of the unknowns, from the `first` ones on; None: there is no such motion."""

    def __init__(self, seen: Callable[[np.ndarray], Seen | None], first: np.ndarray, noise: Noise) -> None:
        self._seen, self.noise, self.first = seen, noise, first
        self.evaluations = 0
        self.values, self.seen = first, self._looked_up(first)

    def _looked_up(self, values: np.ndarray) -> Seen:
        found = self._tried(values)
        assert found is not None
        return found

    def _tried(self, values: np.ndarray) -> Seen | None:
        self.evaluations += 1
        return self._seen(values)

    def solved(self) -> np.ndarray:
        """Noise of the groups (groups,) at the least squares, where `values` are then. By restricted maximum likelihood: squares that are left of each group over
        the values that are left of it; in one group of all data it changes nothing.
        """
        noise, rows = self.noise, self.seen[0]
        sums, _ = noise.left(rows, np.zeros(rows.size))
        found = np.maximum(np.sqrt(sums / np.bincount(noise.groups[noise.groups >= 0], minlength=sums.size)), noise.least)
        alone = noise.least.size == 1 and bool(np.all(noise.groups == 0))
        for _ in range(_ROUNDS):
            ends = self._search(noise.of(found))
            sums, left = noise.left(self.seen[0], self.used(found))
            before, found = found, np.maximum(np.sqrt(sums / np.maximum(left, LEFT)), noise.least)
            if alone or not ends or np.all(np.abs(found - before) <= _KNOWN * found):
                break
        return found

    def used(self, noise: np.ndarray) -> np.ndarray:
        """(m,): which share of each value unknowns use up, for noise of the groups: the diagonal of the projection onto what they can do."""
        slopes = self.seen[1] / self.noise.of(noise)[:, None]
        return np.sum(_ways(slopes)[0] ** 2, axis=1)

    def _search(self, noise: np.ndarray) -> bool:
        """Gauss and Newton's steps within a radius where they are to be trusted (More, The Levenberg-Marquardt algorithm, 1978), in standard errors of each unknown alone. Whether that ends."""
        (rows, slopes), size = self._scaled(self.seen, noise), np.zeros(self.values.size)
        radius = np.inf
        for _ in range(_MOTIONS):
            size = np.maximum(size, np.linalg.norm(slopes, axis=0))
            U, s, V = _ways(slopes, size)
            pull = U.T @ rows
            each = rows @ rows / max(1, rows.size - s.size)
            if not pull @ pull > _SETTLED * each:
                return True
            if radius == np.inf and np.any(self.values * size):
                radius = float(np.linalg.norm(self.values * size))
            damping = _damping(s, pull, radius)
            step = -V @ (s * pull / (s * s + damping))
            foretold = float(pull @ pull - np.sum((damping / (s * s + damping) * pull) ** 2))
            length = float(np.linalg.norm(step))
            there = self.values + step / np.where(size > 0, size, 1.0)
            if length <= _STANDS * np.linalg.norm(self.values * size) or np.array_equal(there, self.values):
                return True
            seen = self._tried(there)
            new = None if seen is None else self._scaled(seen, noise)
            gained = -np.inf if new is None else float(rows @ rows - new[0] @ new[0])
            if not gained > 0 and foretold <= _VAIN * max(each, 1.0):
                return True
            if not gained > 0.25 * foretold:
                radius = 0.25 * length
            elif gained > 0.75 * foretold and length > 0.95 * radius:
                radius *= 2
            if seen is not None and new is not None and gained > 0:
                self.values, self.seen, (rows, slopes) = there, seen, new
        return False

    @staticmethod
    def _scaled(seen: Seen, noise: np.ndarray) -> Seen:
        return seen[0] / noise, seen[1] / noise[:, None]

    def covariance(self, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, n), infinite for what no data see, and unseen changes of the unknowns (k, n), each of length 1 relative to the values."""
        values, slopes = self.values, self.seen[1] / self.noise.of(noise)[:, None]
        size, felt = self._sizes(slopes)
        _, s, V = np.linalg.svd(np.linalg.qr(np.where(felt, slopes * size, 0.0), mode="r"))
        s = np.append(s, np.zeros(values.size - s.size))
        seen = (s > _UNSEEN) | (felt.all() and _are_apart(slopes * size))
        weights = np.where(seen, 1.0 / np.where(seen, s, 1.0) ** 2, 0.0)
        covariance = (V.T * weights) @ V * size * size[:, None]
        touched = np.any(np.abs(V[~seen]) > 1e-3, axis=0)
        covariance[touched, touched] = np.inf
        unseen = V[~seen] * size / np.fmax(np.abs(values), size)
        return covariance, unseen / np.linalg.norm(unseen, axis=1, keepdims=True)

    def _sizes(self, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much each unknown changes all data together by one standard deviation (n,), also one that is zero; and which do so at all, beside what
        others do: the sizes of the rest are their values."""
        effect, own = np.linalg.norm(slopes, axis=0), np.fmax(np.abs(self.values), np.abs(self.first))
        felt = (effect > 0) & ((own == 0) | (effect * own > _UNFELT * np.max(effect * own, initial=0.0)))
        return np.where(felt, 1.0 / np.where(felt, effect, 1.0), np.where(own > 0, own, 1.0)), felt


def _ways(slopes: np.ndarray, size: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """U (m, k), s (k,), V (n, k): what data see, of slopes (m, n) by unknowns in these sizes (n,); of slopes of length one where nothing is said."""
    much = np.linalg.norm(slopes, axis=0) if size is None else size
    scaled = slopes / np.where(much > 0, much, 1.0)
    U, s, V = np.linalg.svd(scaled, full_matrices=False)
    seen = (s > _UNSEEN * np.max(np.linalg.norm(scaled, axis=0))) | _are_apart(scaled)
    return U[:, seen], s[seen], V[seen].T


def _are_apart(slopes: np.ndarray) -> bool:
    """Whether no column of (m, n) depends on others by what each row says alone: of a motion that magnifies errors the last rows are so large that the first ones, which tell more, are
    nothing beside them.
    """
    length = np.linalg.norm(slopes, axis=1, keepdims=True)
    rows = slopes / np.where(length > 0, length, 1.0)
    size = np.linalg.norm(rows, axis=0)
    if not (size > 0).all():
        return False
    s = np.linalg.svd(rows / size, compute_uv=False)
    return s.size == slopes.shape[1] and bool(s[-1] > _APART)


def _damping(s: np.ndarray, pull: np.ndarray, radius: float) -> float:
    """With which a step is as long as the radius; 0 where it is shorter without any."""

    def length(damping: float) -> float:
        return float(np.linalg.norm(s * pull / (s * s + damping)))

    if length(0.0) <= radius:
        return 0.0
    low, high = 0.0, float(np.linalg.norm(s * pull)) / radius
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if length(middle) > radius else (low, middle)
        if high - low <= 1e-3 * high:
            break
    return high
