"""Gauss-Legendre collocation: the method for everything that is not stiff."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acausal.collocation.problem import Accuracy, Newton, Problem, Progress, Solution
from acausal.collocation.tableau import gauss_legendre
from acausal.errors import OptionError
from acausal.integrators.base import AbstractIntegrator, native
from acausal.runtime.native import Choice


@dataclass(frozen=True)
class Gauss(AbstractIntegrator):
    """Gauss-Legendre collocation of an even order, adaptive, or with a fixed step [s], where it is symplectic.

    Fixed-point iteration from an extrapolated start, simplified Newton where that would hold the step size down. Quadratic
    invariants such as unit quaternions are kept to rounding. Eight stages, of order 16, fill the widest vectors of processors: they are taken at any tolerance, unless another order is asked for.
    Hairer, Lubich, Wanner: Geometric Numerical Integration, sections II.1 and VIII.6. Raises `OptionError` for an odd order or one above 32.
    """

    name: ClassVar[str] = "gauss"
    order: int = 16
    step: float | None = None

    def __post_init__(self) -> None:
        if not 2 <= self.order <= 32 or self.order % 2:
            raise OptionError(f"simulate: gauss has even orders from 2 to 32, not {self.order}.")

    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None = None
    ) -> Solution:
        """See `AbstractIntegrator`."""
        compiled, accuracy = native(problem), accuracy.with_step(self.step)
        choice = Choice((gauss_legendre(self.order // 2),), Newton.WHERE_SLOW)
        return compiled.integrate(problem, x0, t0, t1, accuracy, choice, progress)
