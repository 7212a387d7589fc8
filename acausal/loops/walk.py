"""A walk over assembled configurations, along the freedom that the loops leave."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.loops.loop_groups import LoopGroup
from acausal.numerics.kernel import Kernel

_CLOSED = 1e-8
_CLOSE_ENOUGH = 1e-11
_RANK = 1e-7
_STRIDES = (0.35, 0.1, 0.03)
_DIRECTIONS = 4
_MOVED = 0.1


class Walk:
    """Assembled configurations of a group of loops one after the other, for parameters of these `values`, at t = 0.

    A: the rows of the loops in the velocities.
    """

    def __init__(self, group: LoopGroup, t: ca.SX, parameters: ca.SX, values: np.ndarray) -> None:
        A, closing = ca.jacobian(group.velocity, group.v), group.closing
        parts = [closing, ca.jacobian(closing, group.q), A, ca.jacobian(group.rates, group.v)]
        self._shapes = [part.shape for part in parts]
        self._q = np.empty(group.q.numel())
        column = ca.densify(ca.vertcat(*(ca.vec(part) for part in parts)))
        self._kernel = Kernel(
            ca.Function("walk", [group.q, t, parameters], [column]),
            (self._q, np.zeros(1), np.array(values, dtype=float)),
            np.empty(column.numel()),
        )

    def at(self, q: np.ndarray) -> list[np.ndarray]:
        """Closing residuals (n, 1), their Jacobian in q, A, and N with q' = N v."""
        self._q[:] = q
        ends = np.cumsum([m * n for m, n in self._shapes])
        return [
            part.reshape(shape, order="F")
            for part, shape in zip(np.split(self._kernel().copy(), ends[:-1]), self._shapes, strict=True)
        ]

    def closed(self, q: np.ndarray, tolerance: float = _CLOSED, rank: int | None = None) -> np.ndarray | None:
        """A configuration next to q with closed loops, by Newton's method with each Jacobian used twice; None if that fails.

        `rank` of the Jacobian where loops are closed, if known: beside it, rows that are redundant there look independent, with
        singular values of the size of the gap, and steps along them go far astray.
        """
        for _ in range(5):
            c, J = self.at(q)[:2]
            if not np.all(np.isfinite(J)):
                return None
            U, s, Vt = np.linalg.svd(J, full_matrices=False)
            kept = int(np.sum(s > 1e-9 * np.max(s, initial=0.0))) if rank is None else rank
            inverse = (Vt[:kept].T / s[:kept]) @ U[:, :kept].T
            q = q - inverse @ c[:, 0]
            q = q - inverse @ self.at(q)[0][:, 0]
            if np.max(np.abs(self.at(q)[0]), initial=0.0) < tolerance:  # none where only velocities are constrained
                return q
        return None

    def samples(self, start: np.ndarray, count: int) -> list[np.ndarray]:
        """The assembled `start`, then up to `count` further configurations to either side, as far apart as the freedom allows; only the
        start where its parts have no room to move though the constraints' rank would allow it.
        """
        rng = np.random.default_rng(1)
        found = [start]
        ahead = rng.normal(size=self._shapes[2][1])
        for sense in (1.0, -1.0):
            here, along = start, sense * ahead
            for _ in range(count):
                step = self._step(here, along, rng)
                if step is None:
                    break
                here, along = step
                found.append(here)
        return found

    def _step(self, here: np.ndarray, ahead: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray] | None:
        """The next configuration and the direction that led there, first tried along `ahead`; None where nothing moves."""
        _, J, A, N = self.at(here)
        _, s, Vt = np.linalg.svd(A)
        free = Vt[_rank(s) :].T
        if free.shape[1] == 0:
            return None
        rank = _rank(np.linalg.svd(J, compute_uv=False))
        for stride in _STRIDES:
            for attempt in range(_DIRECTIONS):
                along = free @ (free.T @ (ahead if attempt == 0 else rng.normal(size=free.shape[0])))
                if not np.max(np.abs(along)) > 1e-6:
                    continue
                along = along / np.max(np.abs(along))
                ahead_of = here + N @ (stride * along)
                found = self.closed(ahead_of, _CLOSE_ENOUGH, rank)
                found = self.closed(ahead_of, _CLOSE_ENOUGH) if found is None else found  # from a singular position to others
                if found is not None and np.max(np.abs(found - here)) > _MOVED * stride * np.max(np.abs(N @ along)):
                    return found, along
        return None


def _rank(singular_values: np.ndarray) -> int:
    return int(np.sum(singular_values > _RANK * np.max(singular_values, initial=1.0)))
