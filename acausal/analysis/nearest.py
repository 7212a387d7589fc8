"""The nearest root: solve equations from a guess, moving as little as possible, also where rows depend on one another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acausal.numerics.assembly import freedom

_SMALL = 1e-11
_DONE = 1e-16
_ZERO = 1e3
_AROUND = 0.1
_SAMPLES = 5
_RANK = 1e-8
_PULL = 1e-6
_SETTLED = 1e-10
_ITERATIONS = 100


@dataclass(frozen=True)
class Rows:
    """Equations: z (n,) -> `residual` (m,), z -> `jacobian` (m, n), and (z, sizes of z) -> `rounding` (m,), that of the residuals."""

    residual: Callable[[np.ndarray], np.ndarray]
    jacobian: Callable[[np.ndarray], np.ndarray]
    rounding: Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Root:
    """`z` (n,), the residuals there (m,), the same as parts of what the sizes of the unknowns make of them, whether they are zero to
    rounding, and `free` (n, k): directions in which they stay so.
    """

    z: np.ndarray
    residual: np.ndarray
    parts: np.ndarray
    converged: bool
    free: np.ndarray


@dataclass(frozen=True)
class NearestRoot:
    """Equations `hard` (z) = 0, and among the roots the one with the least `soft` (z), then with the least change of z.

    `scale` (n,): sizes of the unknowns, which make changes comparable; `limit` (n,): the largest change in one iteration, of
    what `grows` (n,) so many times more as it is above its size.
    """

    hard: Rows
    soft: Rows | None
    scale: np.ndarray
    limit: np.ndarray
    grows: np.ndarray

    def floor(self, z: np.ndarray) -> Floor:
        """Of the rows around z (n,)."""
        return Floor(_ZERO * self.hard.rounding(z, self.scale), self._usual(z))

    def __call__(self, guess: np.ndarray, floor: Floor | None = None) -> Root:
        """From `guess` (n,); `floor` where it is known from nearby."""
        floor = floor or self.floor(guess)
        best = self._root(guess, floor)
        if not best.converged:
            return best
        cost = self._cost(best.z, guess)
        for _ in range(_ITERATIONS):
            step = self._towards_wishes(best, guess)
            settled = _norm(step / self.scale) <= _SETTLED * (1.0 + _norm(best.z / self.scale))
            for factor in 0.5 ** np.arange(12):
                trial = self._root(best.z + self._limited(best.z, factor * step), floor)
                value = self._cost(trial.z, guess)
                if trial.converged and value <= cost * (1 + 1e-12):
                    break
            else:
                break
            best, cost = trial, value
            if settled:
                break
        zero = _ZERO * self.hard.rounding(best.z, self.scale)
        return replace(best, converged=bool(np.all(np.abs(best.residual) <= zero)))

    def _root(self, guess: np.ndarray, floor: Floor) -> Root:
        """Levenberg and Marquardt's method, with a damping that vanishes with the residual: it converges quadratically, also to roots
        that are not isolated (Yamashita and Fukushima, Computing Supplement 15, 2001).
        """
        at = self._place(guess, self.hard.residual(guess), floor)
        damping = 1.0
        for _ in range(_ITERATIONS):
            if not _DONE < at.size < np.inf:
                break
            moved, damping = self._decrease(at, damping)
            if moved is None:
                break
            before, at = at.size, moved
            if at.size <= _SMALL and at.size > 0.3 * before:
                break
        return self._result(at)

    def _decrease(self, at: _Place, damping: float) -> tuple[_Place | None, float]:
        """The next place with smaller residuals, and the damping for the step after it; None where there is no such place."""
        U, s, Vt = np.linalg.svd(at.weight[:, None] * at.J * self.scale, full_matrices=False)
        along = U.T @ (at.weight * at.r)
        for _ in range(10 if at.size > _SMALL else 1):
            mu = damping * min(at.size, 1e-2) * (s[0] if s.size else 1.0)
            step = self._limited(at.z, -self.scale * (Vt.T @ (s / np.where(s > 0, s**2 + mu**2, 1.0) * along)))
            for factor in 0.3 ** np.arange(4):
                r = self.hard.residual(at.z + factor * step)
                if _norm(at.weight * r) < at.size * (1 - 1e-4 * factor):
                    return self._place(at.z + factor * step, r, at.floor), max(1e-3, damping / 10)
                if at.size <= _SMALL:
                    break
            damping *= 10.0
        return None, damping

    def _result(self, at: _Place) -> Root:
        if not at.size < np.inf:
            return Root(at.z, at.r, at.r, False, np.zeros((at.z.size, 0)))
        # small parts say nothing where nothing but rounding changes a row
        slope = np.max(np.abs(at.J * self.scale), axis=1, initial=0.0)
        limit = np.where(slope > at.floor.rounding, _SMALL / at.weight, at.floor.rounding)
        converged = bool(np.all(np.abs(at.r) <= limit))
        free = self.scale[:, None] * freedom(at.weight[:, None] * at.J * self.scale, _RANK)
        return Root(at.z, at.r, at.weight * at.r, converged, free)

    def _towards_wishes(self, root: Root, guess: np.ndarray) -> np.ndarray:
        """Gauss-Newton step along the free directions: to the wishes, and where they leave a choice back to the guess."""
        Z, back = root.free, root.free.T @ ((guess - root.z) / self.scale**2)
        if self.soft is None:
            return Z @ back
        share = self._wish_weight(self.soft, guess)
        w, Jw = share * self.soft.residual(root.z), share[:, None] * self.soft.jacobian(root.z)
        rest = freedom(Jw @ Z, _RANK)
        return Z @ (rest @ (rest.T @ back) - np.linalg.pinv(Jw @ Z, rcond=_RANK) @ w)

    def _cost(self, z: np.ndarray, guess: np.ndarray) -> float:
        pull = _PULL**2 * float(np.sum(((z - guess) / self.scale) ** 2))
        if self.soft is None:
            return pull
        return pull + float(np.sum((self._wish_weight(self.soft, guess) * self.soft.residual(z)) ** 2))

    def _wish_weight(self, soft: Rows, guess: np.ndarray) -> np.ndarray:
        """Wishes of any unit become comparable by what the sizes of the unknowns make of them where the search begins."""
        return _inverse(np.max(np.abs(soft.jacobian(guess) * self.scale), axis=1, initial=0.0))

    def _place(self, z: np.ndarray, r: np.ndarray, floor: Floor) -> _Place:
        """Each row as a part of what the sizes of the unknowns make of it, here or around the guess; rounding errors stay small."""
        J = self.hard.jacobian(z)
        if not np.isfinite(J).all():
            return _Place(z, r, np.zeros_like(J), np.ones(r.size), np.inf, floor)
        slope = np.max(np.abs(J * self.scale), axis=1, initial=0.0)
        slope = np.fmax(np.fmax(slope, floor.usual), floor.rounding)
        weight = _inverse(np.where(slope > 0, slope, np.abs(r)))
        return _Place(z, r, J, weight, _norm(weight * r), floor)

    def _usual(self, z: np.ndarray) -> np.ndarray:
        """What the sizes of the unknowns make of each row (m,), by differences: derivatives may vanish where the search begins."""
        shake, r = np.random.default_rng(0), self.hard.residual(z)
        around = [self.hard.residual(z + _AROUND * self.scale * shake.uniform(-1.0, 1.0, z.size)) for _ in range(_SAMPLES)]
        change = np.abs(np.column_stack([beside - r for beside in around])) / _AROUND
        return np.median(np.where(np.isfinite(change), change, 0.0), axis=1)

    def _limited(self, z: np.ndarray, step: np.ndarray) -> np.ndarray:
        limit = self.limit * np.where(self.grows, np.maximum(1.0, np.abs(z) / self.scale), 1.0)
        largest = float(np.max(np.abs(step) / limit, initial=0.0))
        return step / largest if largest > 1.0 else step


@dataclass(frozen=True)
class Floor:
    """For each row (m,): the `rounding` in it, and what changes of the unknowns by their sizes usually make of it."""

    rounding: np.ndarray
    usual: np.ndarray


@dataclass(frozen=True)
class _Place:
    """Unknowns z, residuals r, Jacobian J, weights of rows, the weighted size of the residuals, and what is rounding in them."""

    z: np.ndarray
    r: np.ndarray
    J: np.ndarray
    weight: np.ndarray
    size: float
    floor: Floor


def largest_gaps(names: Sequence[str], residual: np.ndarray, parts: np.ndarray) -> str:
    """At most four rows in words, those with the largest `parts` (n,) first; what is not finite counts as larger than any number."""
    size = np.nan_to_num(np.abs(parts), nan=np.inf)
    worst = [i for i in np.argsort(-size, kind="stable") if size[i] > 1e-3 * min(np.max(size), 1e300)][:4]
    return ", ".join(f"{names[i]} (off by {residual[i]:.3g})" for i in worst)


def _inverse(size: np.ndarray) -> np.ndarray:
    """1 / size, 1 where it is zero."""
    return 1.0 / np.where(size > 0, size, 1.0)


def _norm(values: np.ndarray) -> float:
    size = float(np.linalg.norm(values))
    return size if np.isfinite(size) else np.inf
