"""Gauss-Legendre collocation: the method for everything that is not stiff."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from acausal.collocation.problem import Newton, Problem, Progress, Solution, Tolerances
from acausal.collocation.tableau import gauss_legendre
from acausal.errors import OptionError
from acausal.integrators.base import AbstractIntegrator
from acausal.integrators.driver import Scheme, Step, drive
from acausal.integrators.stages import StageSolver
from acausal.runtime.compiled import Choice, Pace


@dataclass(frozen=True)
class Gauss(AbstractIntegrator):
    """Gauss-Legendre collocation of an even order, adaptive, or with a fixed step [s], where it is symplectic.

    Fixed-point iteration from an extrapolated start, simplified Newton where that would hold the step size down. Quadratic
    invariants such as unit quaternions are kept to rounding. `order`: None chooses 8, 12 or 16 by tolerance and lanes.
    Hairer, Lubich, Wanner: Geometric Numerical Integration, sections II.1 and VIII.6. Raises `OptionError` for an odd order or one above 32.
    """

    name: ClassVar[str] = "gauss"
    order: int | None = None
    step: float | None = None

    def __post_init__(self) -> None:
        if self.order is not None and (not 2 <= self.order <= 32 or self.order % 2):
            raise OptionError(f"simulate: gauss has even orders from 2 to 32, not {self.order}.")

    def integrate(
        self, problem: Problem, x0: np.ndarray, t0: float, t1: float, tolerances: Tolerances, progress: Progress | None = None
    ) -> Solution:
        """See `AbstractIntegrator`."""
        order, tolerances = self.order or default_order(tolerances.rtol, problem), tolerances.with_step(self.step)
        if problem.compiled is not None:
            choice = Choice((gauss_legendre(order // 2),), Newton.WHERE_SLOW)
            return problem.compiled.integrate(problem, x0, t0, t1, tolerances, choice, progress, newton_where_slow)[0]
        scheme = gauss_scheme(order, Newton.WHERE_SLOW)
        return drive(problem, scheme, x0, t0, t1, tolerances, progress, slow=newton_where_slow)[0]


def default_order(rtol: float, problem: Problem) -> int:
    """Order at which a tolerance is cheapest: stages that fit into the lanes cost no more than one."""
    lanes = 1 if problem.compiled is None else problem.compiled.lanes
    if lanes >= 4:
        return 16 if rtol < (2e-4 if lanes >= 8 else 1e-5) else 8
    return 8 if rtol >= 1e-4 else 12 if rtol >= 1e-7 else 16


def newton_where_slow(pace: Pace) -> str:
    """Newton costs a Jacobian and linear algebra: worth it where it makes steps several times larger."""
    return "newton" if pace.slowness > 5 and not pace.newton else "go on"


def gauss_scheme(order: int, newton: Newton) -> Scheme:
    """Gauss collocation for the driver."""
    return Scheme(gauss_legendre(order // 2), gauss_error, order, newton, superconvergent=True)


def gauss_error(solver: StageSolver, step: Step) -> float:
    """Error of a Gauss step in units of its scale, from how fast the Legendre coefficients of the rates decay.

    They decay geometrically, a_k ~ a_0 r^k; the last one known gives r, and quadrature on s nodes misses a_2s. Rounding of the rates
    makes (2 k + 1) times as much of a_k at most.
    """
    s, h = solver.tableau.stages, step.h
    forgiven = (2.0 * np.arange(s)[:, None] + 1.0) * step.noise
    sizes = (np.maximum(np.abs(step.a) - forgiven, 0.0) * (h / step.scale)).max(axis=1)
    largest = float(sizes.max())
    if largest == 0.0:
        return 0.0
    if s == 1:
        change = (step.K - solver.rate(step.t, step.x)) * (h / step.scale)
        return largest * min(1.0, float(np.abs(change).max()) / largest) ** 2
    tail = float(sizes[-1])
    if s > 2:
        tail = max(tail, largest * (float(sizes[-2]) / largest) ** ((s - 1) / (s - 2)))
    return largest * (tail / largest) ** (2 * s / (s - 1))
