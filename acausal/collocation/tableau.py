"""Collocation tableaus: Gauss-Legendre and Radau IIA, any number of stages, to rounding.

Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I (section II.7) and II (IV.5).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre


@dataclass(frozen=True, eq=False)
class Tableau:
    """Nodes c (s,), weights b (s,), matrix A (s, s) on [0, 1], order, and the matrix L (s, s) from values at the nodes to
    coefficients in Legendre polynomials on [0, 1].
    """

    name: str
    order: int
    c: np.ndarray
    b: np.ndarray
    A: np.ndarray
    to_legendre: np.ndarray

    @property
    def stages(self) -> int:
        """Number of stages."""
        return self.c.size

    @functools.cached_property
    def mu(self) -> np.ndarray:
        """A[i, j] / b[j], (s, s). For Gauss mu + mu' = 1 to the last bit, which keeps a rounded method symplectic.

        Antonana, Makazaga, Murua: Reducing and monitoring round-off error propagation for symplectic implicit Runge-Kutta schemes (2017).
        """
        mu = self.A / self.b
        if self.name != "gauss":
            return mu
        upper = np.triu(np.round(mu * 2.0**51) / 2.0**51, 1)
        return upper + np.tril(1 - upper.T, -1) + 0.5 * np.eye(self.stages)


@functools.cache
def eigenvectors(tableau: Tableau) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues (m,) of A, one of each conjugate pair, and V (s, m), W (m, s) with A = Re(V diag W); all complex."""
    eigen = np.linalg.eig(tableau.A)
    values, vectors = np.asarray(eigen.eigenvalues, dtype=complex), np.asarray(eigen.eigenvectors, dtype=complex)
    inverse = np.linalg.inv(vectors)
    keep = np.imag(values) >= -1e-12
    double = np.where(np.abs(np.imag(values[keep])) > 1e-12, 2.0, 1.0)
    return values[keep], vectors[:, keep] * double, inverse[keep]


@functools.cache
def gauss_legendre(stages: int) -> Tableau:
    """Gauss-Legendre collocation, order 2 s, symplectic."""
    nodes, _ = legendre.leggauss(stages)
    return _collocation("gauss", 2 * stages, _polished(nodes, _legendre_series(stages)))


def refining(gauss: Tableau) -> Tableau:
    """The Gauss method on whose nodes dense output inside of steps becomes as accurate as their ends."""
    return gauss_legendre(max(gauss.stages + 1, round(1.75 * gauss.stages)))


@functools.cache
def radau_iia(stages: int) -> Tableau:
    """Radau IIA collocation, order 2 s - 1, stiffly accurate; the last node is 1."""
    series = _legendre_series(stages) - np.append(_legendre_series(stages - 1), 0.0)  # P_s - P_(s-1) vanishes at 1
    nodes = np.sort(np.real(legendre.legroots(series)))
    nodes = _polished(nodes, series)
    nodes[-1] = 1.0
    return _collocation("radau", 2 * stages - 1, nodes)


def _legendre_series(degree: int) -> np.ndarray:
    return np.append(np.zeros(degree), 1.0)


def _polished(nodes: np.ndarray, series: np.ndarray) -> np.ndarray:
    slope = legendre.legder(series)
    for _ in range(3):
        nodes = nodes - legendre.legval(nodes, series) / legendre.legval(nodes, slope)
    return nodes


def _collocation(name: str, order: int, nodes: np.ndarray) -> Tableau:
    """From nodes in [-1, 1]: A V = Q with V and Q the values and integrals of Legendre polynomials at the nodes."""
    s = nodes.size
    V = legendre.legvander(nodes, s - 1)
    Q = integrated_legendre((nodes + 1) / 2, s)
    to_legendre = np.linalg.inv(V)
    A = np.linalg.solve(V.T, Q.T).T
    b = np.linalg.solve(V.T, integrated_legendre(np.array([1.0]), s)[0])
    return Tableau(name, order, (nodes + 1) / 2, b, A, to_legendre)


def integrated_legendre(theta: np.ndarray, count: int) -> np.ndarray:
    """(n, count): integrals from 0 to theta of the Legendre polynomials of [0, 1], degree 0 .. count - 1."""
    P = legendre.legvander(2 * theta - 1, count)
    Q = np.empty((theta.size, count))
    Q[:, 0] = theta
    for k in range(1, count):
        Q[:, k] = (P[:, k + 1] - P[:, k - 1]) / (2 * (2 * k + 1))
    return Q
