"""Dense output of collocation steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.collocation.problem import Problem
from acausal.collocation.tableau import gauss_legendre, integrated_legendre, legendre_values
from acausal.integrators.rates import Rates


@dataclass(frozen=True)
class CollocationPolynomial:
    """Between step points t (n + 1,): x(t_k + theta h_k) = x_k + h_k Q(theta) a_k with Legendre coefficients a (n, m, nx) of the rates."""

    t: np.ndarray
    x: np.ndarray
    coefficients: np.ndarray

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """States (nx, m) at times (m,) between the first and the last step point."""
        if self.coefficients.shape[0] == 0:
            return np.repeat(self.x[:1].T, times.size, axis=1)
        step = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, self.coefficients.shape[0] - 1)
        h = self.t[step + 1] - self.t[step]
        Q = integrated_legendre((times - self.t[step]) / h, self.coefficients.shape[1])
        return (self.x[step] + h[:, None] * np.einsum("nj,njk->nk", Q, self.coefficients[step])).T


def refined(problem: Problem, t: np.ndarray, x: np.ndarray, coefficients: np.ndarray) -> CollocationPolynomial:
    """A polynomial of higher degree through the same step points.

    A Gauss step of s stages is accurate to order 2 s at its end but only s + 1 inside. Fixed-point iteration on 1.75 s nodes,
    started from the collocation polynomial and done for all steps at once, brings the inside up to the end's accuracy.
    """
    n, s, nx = coefficients.shape
    if n == 0:
        return CollocationPolynomial(t, x, coefficients)
    m = max(s + 1, round(1.75 * s))
    fine = gauss_legendre(m)
    h = np.diff(t)
    K = np.einsum("ij,njk->nik", legendre_values(fine.c, s), coefficients)
    rates = Rates(problem, n * m)
    rates.at((t[:-1, None] + h[:, None] * fine.c).ravel())
    previous, best = np.full(nx, np.inf), K
    size = np.maximum(np.abs(x).max(axis=0), np.finfo(float).tiny)
    for _ in range(30):
        X = x[:-1, None, :] + h[:, None, None] * np.einsum("ij,njk->nik", fine.A, K)
        rates.X[:] = X.reshape(n * m, nx)
        new = rates.evaluate().reshape(n, m, nx).copy()
        change = np.max(np.abs((new - K) * h[:, None, None]), axis=(0, 1)) / size
        # states that are nothing but rounding keep changing
        if not (change < 2).all() or not (change < 0.9 * previous).any():
            break
        best = K = new
        previous = change
        if (change < 1e-15).all():
            break
    return CollocationPolynomial(t, x, np.einsum("ij,njk->nik", fine.to_legendre, best))
