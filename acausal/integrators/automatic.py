"""Gauss, and Radau IIA where the scene turns out to be stiff."""

from __future__ import annotations

import functools
import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acausal.collocation.problem import Accuracy, Newton, Problem, Progress, Solution
from acausal.collocation.tableau import gauss_legendre
from acausal.errors import NoCompilerWarning, NoRuntimeError
from acausal.integrators.base import AbstractIntegrator, native
from acausal.integrators.builtin import Cvodes
from acausal.integrators.gauss import Gauss
from acausal.integrators.radau import ADAPTIVE
from acausal.runtime.native import Choice
from acausal.wording import callers_level


@functools.cache
def warn_no_compiler(reason: str) -> None:
    """Say, once in a process for each reason, what is missing."""
    warnings.warn(f"{reason} CVODES of CasADi integrates instead.", NoCompilerWarning, stacklevel=callers_level())


@dataclass(frozen=True)
class Automatic(AbstractIntegrator):
    """Gauss; Radau IIA for as long as fast decay, not accuracy, would hold the step size down (`acausal/runtime/stiffness.h`).

    A fast oscillation without damping stays with Gauss, which keeps its energy: Radau would damp it. `order` is Gauss's.
    With a fixed `step` [s] it is Gauss.
    """

    name: ClassVar[str] = "auto"
    order: int = Gauss.order
    step: float | None = None

    def __post_init__(self) -> None:
        Gauss(self.order, self.step)  # raises for an order that Gauss does not have

    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, accuracy: Accuracy, progress: Progress | None = None
    ) -> Solution:
        """See `AbstractIntegrator`. The statistics name the methods that ran."""
        accuracy = accuracy.with_step(self.step)
        try:
            compiled = native(problem)
        except NoRuntimeError as error:
            warn_no_compiler(str(error))
            return Cvodes().integrate(problem, x0, t0, t1, accuracy, progress)
        return compiled.integrate(problem, x0, t0, t1, accuracy, gauss_or_radau(self.order), progress)


def gauss_or_radau(order: int = Gauss.order) -> Choice:
    """Gauss of an order, and Radaus for where the motion is stiff."""
    return Choice((gauss_legendre(order // 2), *ADAPTIVE), Newton.WHERE_SLOW, adapt_order=True)
