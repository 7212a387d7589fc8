"""The stage equations K = f(t + c h, x + h A K) of one collocation step: fixed-point iteration, or simplified Newton."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from acausal.collocation.problem import Problem
from acausal.collocation.tableau import Tableau, eigenvectors
from acausal.integrators.convergence import Convergence, Verdict
from acausal.integrators.passage import Zone, passage_of
from acausal.integrators.rates import Jacobian, Rates
from acausal.integrators.scale import Scale, sampled_noise
from acausal.numerics.bound import copied_states


@dataclass
class StageSolver:
    """Solves the stage equations of one tableau. `iterations` and `factorisations` count over all steps."""

    problem: Problem
    tableau: Tableau
    iterations: int = 0
    factorisations: int = 0

    def __post_init__(self) -> None:
        s, nx = self.tableau.stages, self.problem.rhs.size1_in(1)
        self.rates = Rates(self.problem, s)
        self.single = Rates(self.problem, 1)
        self._K, self._difference = np.empty((s, nx)), np.empty((s, nx))
        self._row, self._mean = np.empty(nx), 1 / s
        pairs = self._pairs = list(copied_states(self.problem.rhs))
        self.change = 0.0
        self._copies = (_index([i for i, _ in pairs]), _index([j for _, j in pairs])) if pairs else None
        self._passage = passage_of(self.problem)
        self.along: np.ndarray | None = None
        self.zone: Zone | None = None

    @property
    def evaluations(self) -> int:
        """Evaluations of f at one point."""
        return self.iterations * self.tableau.stages + self._singles

    _singles = 0

    @functools.cached_property
    def jacobian(self) -> Jacobian:
        """df/dx, made when first needed."""
        return Jacobian(self.problem)

    @functools.cached_property
    def copies(self) -> bool:
        """Whether some states are the rates of others, so that one iteration contracts like h^2."""
        return self._copies is not None

    def rate_along(self, t: float, x: np.ndarray, h: float) -> np.ndarray:
        """f(t, x); next to a singular position its part along the branch, as that of the last step's stages."""
        rate = self.rate(t, x).copy()
        if self._passage is None or self.along is None:
            return rate
        times, states = np.array([t]), x[None, :]
        zone = self._passage.zone(times, states, h, None)
        return (
            self._passage.along(times, states, rate[None, :])[0]
            if zone is None
            else zone.correct(times, states, rate[None, :])[0]
        )

    def rate(self, t: float, x: np.ndarray) -> np.ndarray:
        """f(t, x), (nx,); used again by the next call."""
        self.single.at(t)
        self.single.X[0] = x
        self._singles += 1
        return self.single.evaluate()[0]

    def noise(self, h: float) -> np.ndarray:
        """What rounding makes of the rates (nx,) at the stages that were tried last, in a step of size h."""
        return sampled_noise(self.problem, self.rates.t, self.rates.X, h, self._pairs)

    def fixed_point(
        self, t: float, h: float, x: np.ndarray, K: np.ndarray, scale: Scale, tolerance: float
    ) -> tuple[np.ndarray, float] | None:
        """Stage rates (s, nx) from a guess K, and the contraction seen; None when it does not converge.

        `scale`: sizes of the states for norms. Converged when what is left of h K is below `tolerance` in units of scale.
        Positions whose rates are states are advanced with the newest velocities (Gauss-Seidel), which squares the contraction.
        """
        rates, mu, hb, copies = self.rates, self.tableau.mu, h * self.tableau.b[:, None], self._copies
        X, new, difference, run = rates.X, rates.K, self._difference, rates.run
        flat = difference.reshape(-1)
        rates.at(t + h * self.tableau.c)
        factor = self._factor(h, scale)
        judge = Convergence(tolerance, scale.floor(h, x, K), 50)
        self._K[:] = K
        K = self._K
        self.along, self.zone, zone, count, before = None, None, None, 0, np.inf
        while True:
            np.dot(mu, hb * K, out=X)
            np.add(X, x, out=X)
            if copies is not None:
                X[:, copies[0]] = mu.dot(hb * X[:, copies[1]])
                X[:, copies[0]] += x[copies[0]]
            run()
            if self._passage is not None and count < 2:  # the first guess may be poor
                self.zone = zone = self._passage.zone(rates.t, X, h, judge)
                count += 1
                self.along = None if zone is None else zone.along(rates.t, X, K)
            old = self.along
            if zone is not None:
                self.along = zone.correct(rates.t, X, new)
                zone.settle(t, h, x, new, self.tableau)
            if scale.widen(h, new):
                factor = self._factor(h, scale)
            np.subtract(new, K, out=difference)
            if scale.noisy:
                difference[:] = scale.heard(difference, 0.25)
            np.multiply(difference, factor, out=difference)
            K[:] = new
            self.iterations += 1
            change = whole = flat.dot(flat)
            if old is not None and self.along is not None:
                change = float(np.sum(((self.along - old) * factor) ** 2))
            self.change = float(change * self._mean) ** 0.5
            verdict = judge.judge(self.change)
            # across the branch it may converge still, and not yet to rounding errors
            still = zone is not None and verdict is Verdict.DONE and whole < 0.25 * before
            before = whole
            if verdict is Verdict.DONE and not still and copies is not None:
                # the newest velocities, not those that the last rates were found with
                K[:, copies[0]] = x[copies[1]] + mu.dot(hb * K[:, copies[1]])
            if verdict is not Verdict.GO_ON and not still:
                return (K.copy(), judge.contraction) if verdict is Verdict.DONE else None

    def newton(
        self, t: float, h: float, x: np.ndarray, K: np.ndarray, scale: Scale, tolerance: float
    ) -> tuple[np.ndarray, float] | None:
        """The same by simplified Newton in the eigenvectors of A: Hairer and Wanner II, section IV.8."""
        rates, mu, hb = self.rates, self.tableau.mu, h * self.tableau.b[:, None]
        rates.at(t + h * self.tableau.c)
        inverse = self._inverse(t, h, x, K)
        if inverse is None:
            return None
        vectors, vectors_inverse = eigenvectors(self.tableau)[1:]
        judge = Convergence(tolerance, scale.floor(h, x, K), 15)
        self.along, self.zone, zone, count = None, None, None, 0
        while True:
            np.dot(mu, hb * K, out=rates.X)
            rates.X += x
            new = rates.evaluate()
            if self._passage is not None and count < 2:
                self.zone = zone = self._passage.zone(rates.t, rates.X, h, judge)
                count += 1
            if zone is not None:
                self.along = zone.correct(rates.t, rates.X, new)
                zone.settle(t, h, x, new, self.tableau)
            residual = new - K
            transformed = np.matmul(inverse, (vectors_inverse @ residual)[:, :, None])[:, :, 0]
            step = np.ascontiguousarray((vectors @ transformed).real)
            K = K + step
            scale.widen(h, K)
            step = scale.heard(step if zone is None else zone.along(rates.t, rates.X, step), 0.25) * scale.unit_of_rates(h)
            self.iterations += 1
            self.change = float(np.vdot(step, step) * self._mean) ** 0.5
            verdict = judge.judge(self.change)
            if verdict is not Verdict.GO_ON:
                return (K, judge.contraction) if verdict is Verdict.DONE else None

    def _factor(self, h: float, scale: Scale) -> np.ndarray:
        """Sizes of changes of rates in units of the scale; copies are judged by what the velocities' change will do to them."""
        factor, copies = scale.unit_of_rates(h), self._copies
        if copies is not None:
            factor[copies[1]] = np.maximum(factor[copies[1]], h * factor[copies[0]])
            factor[copies[0]] = 0.0
        return factor

    def _inverse(self, t: float, h: float, x: np.ndarray, K: np.ndarray) -> np.ndarray | None:
        """(m, nx, nx): inverses of 1 - h lambda J for the eigenvalues lambda of A, J in the middle of the step as guessed."""
        J = self.jacobian(t, x)
        if not np.isfinite(J).all():
            return None
        self.factorisations += 1
        blocks = np.eye(x.size) - (h * eigenvectors(self.tableau)[0])[:, None, None] * J
        try:
            return np.linalg.inv(blocks)
        except np.linalg.LinAlgError:
            return None


def _index(positions: list[int]) -> slice | np.ndarray:
    """A slice where the positions are consecutive: numpy then makes no copy."""
    first = positions[0]
    if positions == list(range(first, first + len(positions))):
        return slice(first, first + len(positions))
    return np.array(positions)
