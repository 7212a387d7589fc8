"""Through singular positions of loops, where branches of the motion cross and the rates cannot be computed.

Along a branch, positions, velocities and rates are smooth: near a singular position they are continued from points to either side, which
are found by going ahead and back along the motion and closing the loops there.

Around it, rounding errors of the loops throw the rates about, by eps / x^3 at a distance x, but only in directions in which constraint
forces act, and which projection takes away again after the step. So the iteration and the error of a step are judged by what is left of
the rates when it is taken away from them: their part along the branch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.collocation.problem import Problem
from acausal.collocation.tableau import Tableau
from acausal.integrators.convergence import Convergence

_NEARBY = 0.1
_CROSSING = 5e-5
_AHEAD = 0.016
_NODES = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
_WEIGHTS = np.array([-1 / 70, 4 / 35, -2 / 5, 4 / 5, 4 / 5, -2 / 5, 4 / 35, -1 / 70])
"""Of a polynomial's values at the nodes, for its value at 0."""
_CORRECTIONS = 4
_SETTLING = 10
_SEARCH = 30
_BESIDE = 0.01
"""Clearance that steps end with if they can."""
_CLEARER = 4
"""Times as clear as a stage and as the next to singular positions, the end of a step by which the stage is settled."""
_ROUNDING = 100
"""Times as large, what is left of rounding errors across the branch."""


@dataclass(frozen=True)
class Passage:
    """Rates and states of a problem near singular positions."""

    problem: Problem

    def clearances(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n,) at states X (n, nx)."""
        assert self.problem.clearance is not None
        return np.array(self.problem.clearance(t[None, :], X.T, self._p(t.size))).ravel()

    def zone(self, t: np.ndarray, X: np.ndarray, h: float, judge: Convergence | None) -> Zone | None:
        """The neighbourhood of a singular position that some of the states X (n, nx) at times t (n,) are in; `judge` learns of it."""
        clear = self.clearances(t, X)
        if not np.any(clear < _NEARBY):
            return None
        if judge is not None and judge.count == 0:
            judge.floor *= _ROUNDING
        ahead = tuple(self.crossing(t[k], X[k], h) if clear[k] < _CROSSING else None for k in range(t.size))
        return Zone(self, clear, ahead)

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
            tau *= _AHEAD / distance if distance > 0 else np.inf
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
        return None if tau is None else _WEIGHTS @ self.points(t, x, tau)[1]

    def rates(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n, nx)."""
        return np.array(self.problem.rhs(t[None, :], X.T, self.problem.inputs(t), self._p(t.size))).T

    def projected(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n, nx), once."""
        assert self.problem.project is not None
        return np.array(self.problem.project(t[None, :], X.T, self._p(t.size))).T

    def along(self, t: np.ndarray, X: np.ndarray, K: np.ndarray) -> np.ndarray:
        """What of the rates K (n, nx) of velocities lies along the branch; those of positions, which are velocities, are left out."""
        n = self.problem.positions
        found = self.projected(t, np.hstack([X[:, :n], K[:, n:]]))
        found[:, :n] = 0.0
        return found

    def closed(self, t: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n, nx), with closed loops."""
        for _ in range(2):
            X = self.projected(t, X)
        return X

    def moving(self, t: np.ndarray, X: np.ndarray, weights: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The part of velocities v along the branch, continued from states X with these weights."""
        return (weights @ self.projected(t, np.hstack([X[:, : self.problem.positions], np.tile(v, (weights.size, 1))])))[
            -v.size :
        ]

    def is_crossing(self, t: float, x: np.ndarray) -> bool:
        """Whether a state is next to a singular position, where closing loops only adds rounding errors."""
        return bool(self.clearances(np.array([t]), x[None, :])[0] < _CROSSING)

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


@dataclass(frozen=True)
class Zone:
    """Stages near a singular position and their clearances (s,); `ahead`: of those next to it, how far to go to either side [s]."""

    passage: Passage
    clear: np.ndarray
    ahead: Sequence[float | None]

    def correct(self, t: np.ndarray, X: np.ndarray, K: np.ndarray) -> np.ndarray:
        """Corrects the rates K (n, nx) next to the position; the part of all of them along the branch (n, nx)."""
        passage = self.passage
        found = passage.along(t, X, K)
        for k, tau in enumerate(self.ahead):
            if tau is None:
                continue
            times, points = passage.points(t[k], X[k], tau)
            rates = passage.rates(times, points)
            K[k, passage.problem.positions :] = (_WEIGHTS @ rates)[passage.problem.positions :]
            found[k] = _WEIGHTS @ passage.along(times, points, np.tile(K[k], (times.size, 1)))
        return found

    def along(self, t: np.ndarray, X: np.ndarray, K: np.ndarray) -> np.ndarray:
        """The part of the rates along the branch (n, nx)."""
        return self.passage.along(t, X, K)

    def is_awkward(self, t: float, h: float, x: np.ndarray, end: np.ndarray) -> bool:
        """Whether a step leads from elsewhere to beside a singular position, where its `end` is known to eps / x^2 only, or closely past two
        of them: `settle` finds what rounding has done at one.
        """
        passes, beside = 0, False
        for clear in self.clear:
            passes += bool(clear < _BESIDE) and not beside
            beside = bool(clear < (_NEARBY if beside else _BESIDE))
        if passes > 1:
            return True
        first, last = self.passage.clearances(np.array([t, t + h]), np.array([x, end]))
        return bool(last < _BESIDE and not first < _BESIDE)

    def settle(self, t: float, h: float, x: np.ndarray, K: np.ndarray, tableau: Tableau) -> None:
        """Takes what rounding errors have done to the rates K (s, nx) of the stage nearest to the position out of them, such that the end of
        the step moves along the branch. The stages in between need not: they are less accurate.
        """
        n, passage, k = self.passage.problem.positions, self.passage, int(np.argmin(self.clear))
        end = np.array([t + h])
        there = passage.closed(end, (x + h * tableau.b @ K)[None, :])
        if not self.clear[k] < _NEARBY or passage.clearances(end, there)[0] < _CLEARER * max(self.clear[k], _CROSSING):
            return
        tau, here = self.ahead[k], np.array([t + h * tableau.c[k]])
        state = (x + h * tableau.A[k] @ K)[None, :]
        weights, points = np.ones(1), state
        if tau is None:
            points = passage.closed(here, state)
        else:
            weights, (here, points) = _WEIGHTS, passage.points(here[0], state[0], tau)
        least = np.inf
        for _ in range(_SETTLING):
            there[0, n:] = x[n:] + h * tableau.b @ K[:, n:]
            across = (there - passage.projected(end, there))[0, n:] / (h * tableau.b[k])
            much = np.max(np.abs(K[:, n:]), axis=0)
            size = float(np.max(np.abs(across) / np.where(much > 0, much, 1.0)))
            if not size < 0.7 * least:
                return
            least = size
            change, none = (passage.moving(here, points, weights, part) for part in (across, 0.0 * across))
            K[k, n:] -= across - change + none
