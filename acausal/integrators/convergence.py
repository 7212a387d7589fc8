"""When an iteration has converged, and when it never will."""

from __future__ import annotations

import enum
from dataclasses import dataclass

_ROUNDING = 1e4
_FROM_THE_START = 64


class Verdict(enum.Enum):
    """What to do after an iteration."""

    GO_ON = 0
    DONE = 1
    HOPELESS = 2


@dataclass
class Convergence:
    """Judges the sizes of successive changes of an iteration.

    `tolerance`: what may be left of the error; 0 asks for rounding. `floor`: the change that rounding alone can make.
    `contraction`: factor by which changes shrink from one iteration to the next, 0 as long as it is unknown.

    What is left is estimated as change * contraction / (1 - contraction), Hairer and Wanner II, (IV.8.10). Rounding is
    recognised as in Hairer, Lubich, Wanner: Geometric Numerical Integration, VIII.6: changes that shrank quickly stop shrinking. Where the
    first guess was right they never shrink, and are small.
    """

    tolerance: float
    floor: float
    limit: int
    contraction: float = 0.0

    def __post_init__(self) -> None:
        self.count = 0
        self._change = self._before = float("inf")
        self._best = 1.0

    def judge(self, change: float) -> Verdict:
        """The verdict on one more change (a size, not negative; not a number means failure)."""
        self.count += 1
        last, self._before, self._change = self._change, self._change, change
        if not change < float("inf"):
            return Verdict.HOPELESS
        if change <= self.floor:
            return Verdict.DONE
        if self.count == 1:
            return Verdict.DONE if change <= 1e-3 * self.tolerance else Verdict.GO_ON
        ratio = change / last if last > 0 else 0.0
        shrank = self._best < 0.3
        if ratio >= 0.5 and (shrank or self.count > 2) and change <= (_ROUNDING if shrank else _FROM_THE_START) * self.floor:
            return Verdict.DONE
        # a single ratio is noisy: the mean of the last two, in logarithms
        self.contraction = ratio if self.count == 2 else max(ratio, (ratio * self.contraction) ** 0.5)
        self._best = min(self._best, ratio)
        if ratio >= 1:
            return Verdict.HOPELESS if self.count > 3 else Verdict.GO_ON
        left = change * ratio / (1 - ratio)
        if left <= self.tolerance and ratio < 0.9:
            return Verdict.DONE
        goal = max(self.tolerance, self.floor)
        if self.count >= self.limit or (self.count >= 4 and left * self.contraction ** (self.limit - self.count) > goal):
            return Verdict.HOPELESS
        return Verdict.GO_ON
