"""Singular positions of loops, looked for on a walk along the freedom that the loops leave.

A position is singular where the constraints have fewer independent rows than around it: there, branches of the motion cross.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from acausal.integrators.rates import Kernel
from acausal.mechanics.tree import Tree

_STRIDE = 0.35
_LENGTH = 5.0
_MOST_STEPS = 60
_SINGULAR = 1e-5
_CLOSED = 1e-8


class Walk:
    """Assembled configurations one after the other, for parameters of these `values`, at t = 0.

    `closing`: residuals (n, 1) of loops and joints; `A`: constraint rows (m, nv) in the velocities.
    """

    def __init__(self, tree: Tree, parameters: ca.SX, values: np.ndarray, closing: ca.SX, A: ca.SX) -> None:
        parts = [closing, ca.jacobian(closing, tree.q), A, ca.jacobian(tree.rates, tree.v)]
        self._shapes = [part.shape for part in parts]
        self._q = np.empty(tree.q.numel())
        column = ca.densify(ca.vertcat(*(ca.vec(part) for part in parts)))
        self._kernel = Kernel(
            ca.Function("walk", [tree.q, tree.t, parameters], [column]),
            (self._q, np.zeros(1), np.array(values, dtype=float)),
            np.empty(column.numel()),
        )

    def at(self, q: np.ndarray) -> list[np.ndarray]:
        """Closing residuals (n, 1), their Jacobian in q, A, and N with q' = N v."""
        self._q[:] = q
        ends = np.cumsum([m * n for m, n in self._shapes])
        return [
            part.reshape(shape, order="F") for part, shape in zip(np.split(self._kernel(), ends[:-1]), self._shapes, strict=True)
        ]

    def closed(self, q: np.ndarray) -> np.ndarray | None:
        """A configuration next to q with closed loops, by Newton's method with each Jacobian used twice; None if that fails."""
        for _ in range(5):
            c, J = self.at(q)[:2]
            inverse = np.linalg.pinv(J, rcond=1e-9)
            q = q - inverse @ c[:, 0]
            q = q - inverse @ self.at(q)[0][:, 0]
            if np.max(np.abs(self.at(q)[0])) < _CLOSED:
                return q
        return None

    def steps(self, start: np.ndarray, scale: np.ndarray, rank: int, ahead: np.ndarray) -> Iterator[float]:
        """The smallest of `rank` singular values of A, its rows divided by `scale` (m,), from step to step.

        It goes on in the same direction, first `ahead` (nv,), where there are several. A step ends short of where the singular
        value, extrapolated, is zero: it shrinks by the same factor from step to step before a singular position, and levels off
        before one that is missed.
        """
        here, walked, stride, before = start, 0.0, _STRIDE, np.inf
        for _ in range(_MOST_STEPS):
            A, N = self.at(here)[2:]
            _, s, Vt = np.linalg.svd(A / scale[:, None])
            smallest, free = float(s[rank - 1]), Vt[rank:].T
            yield smallest
            along = free @ (free.T @ ahead)
            if walked > _LENGTH or not np.max(np.abs(along), initial=0.0) > 1e-6:
                return
            slope = (before - smallest) / stride if np.isfinite(before) else 0.0
            stride = min(_STRIDE, 0.6 * smallest / slope) if slope > 0 else _STRIDE
            ahead = along / np.max(np.abs(along))
            found = self.closed(here + N @ (stride * ahead))
            if found is None:
                return
            here, walked, before = found, walked + stride, smallest


def has_singular_position(walk: Walk, samples: list[np.ndarray], rank: int) -> bool:
    """Whether a walk from the first of these assembled configurations, most of a turn of a hinge to either side, meets a singular
    position.

    `rank`: independent rows of A in general. At most 120 steps with two singular value decompositions each.
    """
    scale = np.max([np.linalg.norm(walk.at(q)[2], axis=1) for q in samples], axis=0)
    scale = np.maximum(scale, 1e-6 * np.max(scale))
    ahead = np.random.default_rng(1).normal(size=walk.at(samples[0])[2].shape[1])
    return any(smallest < _SINGULAR for sense in (1.0, -1.0) for smallest in walk.steps(samples[0], scale, rank, sense * ahead))
