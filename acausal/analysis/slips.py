"""Friction that a prescribed motion makes slip: it acts against the slip, whichever way that goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acausal.analysis.mode_at import with_masks
from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.analysis.resting import touching
from acausal.errors import MotionError
from acausal.outputs.functions import Functions
from acausal.simulate.transitions import laws_of

_LATER = (0.0, 1e-3, 1e-2, 0.1, 1.0)
"""Of the first stretch of time: where it is looked at which way something begins to slip that stands at first."""
_OPEN = 1e-9
"""Of a slip's change with all states: what may be left of it along directions that are not prescribed."""

Follow = Callable[[OperatingPoint], tuple[np.ndarray, np.ndarray]]
"""The states (nx,) near a point that are as prescribed at its time, and the directions (nx, n) that these leave open."""


class Slips:
    """Which frictions of a scene slip as prescribed, and which way each goes, or went where it stands. `sizes` (nx,) of states."""

    def __init__(self, functions: Functions, sizes: np.ndarray) -> None:
        system = functions.outputs.system
        assert system.modes is not None
        self._laws = tuple(law for law in laws_of(functions.outputs) if not law.row.one_sided and law.row.size < 3)
        self._masks, self._sizes = len(system.modes.masks), sizes
        self._rate = Differentiable(system, system.modes.rate)
        self._first: dict[int, np.ndarray] = {}
        self._ways: dict[int, np.ndarray] = {}

    def look(self, at: OperatingPoint, until: float, follow: Follow) -> None:
        """Find those that slip as prescribed at a point, or begin to do so before `until`."""
        masks = at.u[at.u.size - self._masks :].copy()
        for law in self._laws:
            masks[law.masks] = 0
        here = with_masks(at, masks)
        for part in _LATER if until > at.t else _LATER[:1]:
            now = at.t + part * (until - at.t)
            try:
                x, free = follow(replace(here, t=now))
            except MotionError:  # that is told where it is asked for
                break
            here = replace(here, t=now, x=x)
            slip, rest = self._rate.value(here), touching(self._rate, here, self._sizes)
            left = np.abs(self._rate.along(here, free)).sum(axis=1)
            whole = np.abs(self._rate.along(here, np.diag(self._sizes))).sum(axis=1)
            for k, law in enumerate(self._laws):
                rows = law.reactions
                told, moves = np.all(left[rows] <= _OPEN * whole[rows]), np.any(np.abs(slip[rows]) > rest[rows])
                if k not in self._first and told and moves:
                    self._first[k] = slip[rows] / np.linalg.norm(slip[rows])
            if len(self._first) == len(self._laws):
                break
        self.begin_again()

    def begin_again(self) -> None:
        """As at first."""
        self._ways = dict(self._first)

    def put(self, at: OperatingPoint) -> OperatingPoint:
        """The same point with masks by which they act against their slip there; where it stands, against the way that it went."""
        if not self._ways:
            return at
        masks = at.u[at.u.size - self._masks :].copy()
        slip, rest = self._rate.value(at), touching(self._rate, at, self._sizes)
        for k, way in self._ways.items():
            law = self._laws[k]
            own, rows = masks[law.masks], law.reactions
            if law.needs and not masks[list(law.needs)].any():
                continue
            moves = bool(np.any(np.abs(slip[rows]) > rest[rows]))
            if moves:
                self._ways[k] = way = slip[rows] / np.linalg.norm(slip[rows])
            own[:] = 0
            if way.size == 1:
                own[1] = np.sign(way[0])
            elif moves:
                own[1] = 1
            else:
                own[2], own[3], own[4:6] = 1, 1, way
        return with_masks(at, masks)
