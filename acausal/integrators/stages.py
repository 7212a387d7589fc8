"""The stage equations K = f(t + c h, x + h A K) of one collocation step: fixed-point iteration, or simplified Newton."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from acausal.collocation.problem import Problem
from acausal.collocation.tableau import Tableau, eigenvectors
from acausal.integrators.convergence import Convergence, Verdict
from acausal.integrators.rates import Jacobian, Rates
from acausal.integrators.scale import Scale
from acausal.numerics.kernel import copied_states


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
        pairs = copied_states(self.problem.rhs)
        self._copies = (_index([i for i, _ in pairs]), _index([j for _, j in pairs])) if pairs else None
        self._factored = 0.0

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

    def rate(self, t: float, x: np.ndarray) -> np.ndarray:
        """f(t, x), (nx,); used again by the next call."""
        self.single.at(t)
        self.single.X[0] = x
        self._singles += 1
        return self.single.evaluate()[0]

    def last_stage(self) -> tuple[float, np.ndarray]:
        """Time and state (nx,) of the last stage that was tried."""
        return float(self.rates.t[-1]), self.rates.X[-1].copy()

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
        while True:
            np.dot(mu, hb * K, out=X)
            np.add(X, x, out=X)
            if copies is not None:
                X[:, copies[0]] = mu.dot(hb * X[:, copies[1]])
                X[:, copies[0]] += x[copies[0]]
            run()
            if scale.widen(h, new):
                factor = self._factor(h, scale)
            np.subtract(new, K, out=difference)
            np.multiply(difference, factor, out=difference)
            K[:] = new
            self.iterations += 1
            verdict = judge.judge(float(flat.dot(flat) * self._mean) ** 0.5)
            if (
                verdict is Verdict.DONE and copies is not None
            ):  # the newest velocities, not those that the last rates were found with
                K[:, copies[0]] = x[copies[1]] + mu.dot(hb * K[:, copies[1]])
            if verdict is not Verdict.GO_ON:
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
        while True:
            np.dot(mu, hb * K, out=rates.X)
            rates.X += x
            residual = rates.evaluate() - K
            transformed = np.matmul(inverse, (vectors_inverse @ residual)[:, :, None])[:, :, 0]
            step = np.ascontiguousarray((vectors @ transformed).real)
            K = K + step
            scale.widen(h, K)
            step *= scale.unit_of_rates(h)
            self.iterations += 1
            verdict = judge.judge(float(np.vdot(step, step) * self._mean) ** 0.5)
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
