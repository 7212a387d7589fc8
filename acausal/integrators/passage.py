"""States next to singular positions of loops, where branches of the motion cross: a branch is found from points to either side.

The runtime does the same in every step (acausal/runtime/passage.h, whose numbers these are).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.collocation.problem import Problem
from acausal.numerics.staged import plain

_CROSSING = 5e-5
_AHEAD = 0.016
_NODES = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
_WEIGHTS = np.array([-1 / 70, 4 / 35, -2 / 5, 4 / 5, 4 / 5, -2 / 5, 4 / 35, -1 / 70])
"""Of a polynomial's values at the nodes, for its value at 0."""
_SLOPES = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""The same for its derivative there."""
_CORRECTIONS = 4
_SEARCH = 30


@dataclass(frozen=True)
class Passage:
    """Rates and states of a problem near singular positions."""

    problem: Problem

    def clearances(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n,) at states X (n, nx)."""
        native = self.problem.native
        if native is not None:
            return native.clearances(t, X, self.problem.parameters)
        assert self.problem.clearance is not None
        return np.array(self.problem.clearance(t[None, :], X.T, self._p(t.size)))[0]

    def crossing(self, t: float, x: np.ndarray, h: float) -> float | None:
        """How far [s] to go ahead and back from a state, in a step of size h, to have clearance; None where that leads nowhere."""
        ahead = self._ahead(t, x)

        def aside(tau: float) -> float:
            """Distance there on average; distances grow in proportion to |tau|."""
            both = np.array([[-tau], [tau]]) * ahead
            return float(np.mean(np.sqrt(np.maximum(self.clearances(t + both[:, 0], x + both[:, 1:]), 0.0))))

        tau, distance = h, np.inf
        for factor, wrong in ((0.25, lambda d: d > 2 * _AHEAD), (4.0, lambda d: d < 0.5 * _AHEAD)):
            for _ in range(_SEARCH):
                if not wrong(distance):
                    break
                tau *= factor
                distance = aside(tau)
        for _ in range(2):
            if not 0 < distance < np.inf:
                return None
            tau *= _AHEAD / distance
            distance = aside(tau)
        return tau if 0.5 * _AHEAD < distance < 2 * _AHEAD else None

    def points(self, t: float, x: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray]:
        """Times and states to either side, with closed loops."""
        moved = tau * _NODES[:, None] * self._ahead(t, x)
        times, X = t + moved[:, 0], x + moved[:, 1:]
        for _ in range(_CORRECTIONS):
            X = self.projected(times, X)
        return times, X

    def between(self, t: float, x: np.ndarray, h: float) -> np.ndarray | None:
        """The state between the points to either side of one at a singular position, on a branch; None where none are found."""
        tau = self.crossing(t, x, h)
        return None if tau is None else self.middle(self.points(t, x, tau)[1], tau)[0]

    def middle(self, values: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray]:
        """Of values (8, n) at the points: what lies between them, and its rate."""
        return _WEIGHTS @ values, _SLOPES @ values / tau

    def rates(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n, nx)."""
        return np.array(plain(self.problem.rhs)(t[None, :], X.T, self.problem.inputs(t), self._p(t.size))).T

    def projected(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n, nx), once."""
        assert self.problem.project is not None
        return np.array(self.problem.project(t[None, :], X.T, self.problem.inputs(t), self._p(t.size))).T

    def is_crossing(self, t: float, x: np.ndarray) -> bool:
        """Whether a state is next to a singular position, where closing loops only adds rounding errors."""
        return bool(self.are_crossing(np.array([t]), x[None, :])[0])

    def are_crossing(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """The same (n,) of states X (n, nx)."""
        return self.clearances(t, X) < _CROSSING

    def _ahead(self, t: float, x: np.ndarray) -> np.ndarray:
        """Rates of t and x (1 + nx,), those of velocities left out."""
        rate = self.rates(np.array([t]), x[None, :])[0]
        rate[self.problem.positions :] = 0.0
        return np.concatenate([[1.0], rate])

    def _p(self, n: int) -> np.ndarray:
        return np.repeat(self.problem.parameters[:, None], n, axis=1)


def passage_of(problem: Problem) -> Passage | None:
    """None where no branches of the motion cross."""
    return None if problem.clearance is None or problem.project is None else Passage(problem)
