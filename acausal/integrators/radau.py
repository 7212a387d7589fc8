"""Radau IIA collocation: the method for stiff scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acausal.collocation.problem import Accuracy, Newton, Problem, Progress, Solution
from acausal.collocation.tableau import radau_iia
from acausal.errors import OptionError
from acausal.integrators.base import AbstractIntegrator, native
from acausal.runtime.native import Choice

ADAPTIVE = tuple(radau_iia(s) for s in (3, 5, 7))
"""Orders 5, 9 and 13, between which the driver changes."""


@dataclass(frozen=True)
class Radau(AbstractIntegrator):
    """Radau IIA collocation of an odd order: stiffly accurate, L-stable, simplified Newton; adaptive, or with a fixed step [s].

    `order`: None chooses 5, 9 or 13 by the tolerance. Hairer and Wanner II, sections IV.5 and IV.8.
    Raises `OptionError` for an even order or one above 25.
    """

    name: ClassVar[str] = "radau"
    order: int | None = None
    step: float | None = None

    def __post_init__(self) -> None:
        if self.order is not None and (not 1 <= self.order <= 25 or self.order % 2 == 0):
            raise OptionError(f"simulate: radau has odd orders from 1 to 25, not {self.order}.")

    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None = None
    ) -> Solution:
        """See `AbstractIntegrator`."""
        rtol, accuracy = accuracy.rtol, accuracy.with_step(self.step)
        return native(problem).integrate(problem, x0, t0, t1, accuracy, self.choice(rtol), progress)

    def choice(self, rtol: float) -> Choice:
        """Tableaus for the C runtime: orders 5, 9 and 13 unless one is asked for."""
        if self.order is not None or self.step is not None:
            return Choice((radau_iia(((self.order or _order(rtol)) + 1) // 2),), Newton.ALWAYS)
        return Choice(ADAPTIVE, Newton.ALWAYS, adapt_order=True)


def _order(rtol: float) -> int:
    return 5 if rtol > 1e-6 else 9 if rtol > 1e-10 else 13
