"""Shape functions of straight uniform beams over s = x / length, and their integrals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.mechanics.modal_inertia import ShapeIntegrals

BENDING_MOST = 12
AXIAL_MOST = 6
_POINTS = 80


@dataclass(frozen=True)
class BeamShapes:
    """Bending along y, then along z, then axial; see `components.flexible.FlexibleBeam`."""

    along_y: int
    along_z: int
    axial: int
    clamped: bool

    @property
    def count(self) -> int:
        """Number of shapes."""
        return self.along_y + self.along_z + self.axial

    def at(self, s: np.ndarray) -> np.ndarray:
        """Displacements (len(s), 3, count) for unit amplitudes."""
        result = np.zeros((s.size, 3, self.count))
        for row, start, values in (
            (1, 0, self._bending(s, self.along_y)[0]),
            (2, self.along_y, self._bending(s, self.along_z)[0]),
            (0, self.along_y + self.along_z, _axial(s, self.axial)),
        ):
            result[:, row, start : start + values.shape[1]] = values
        return result

    def tip_turns(self) -> np.ndarray:
        """Angles (3, count) of the last section for unit amplitudes and length: slope of y about z, that of z about -y."""
        result = np.zeros((3, self.count))
        end = np.ones(1)
        result[2, : self.along_y] = self._bending(end, self.along_y)[1]
        result[1, self.along_y : self.along_y + self.along_z] = -self._bending(end, self.along_z)[1]
        return result

    def integrals(self) -> ShapeIntegrals:
        """By Gauss's quadrature, to rounding."""
        s, weights = _quadrature()
        return ShapeIntegrals.of_masses(weights, np.outer(s, [1.0, 0.0, 0.0]), self.at(s))

    def stiffness(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(count, count) each: integrals of products of curvatures along y and along z, and of axial strains."""
        along_y, along_z, axial = (np.zeros((self.count, self.count)) for _ in range(3))
        for matrix, start, n in ((along_y, 0, self.along_y), (along_z, self.along_y, self.along_z)):
            levels = _roots(n) ** 4 / 4 if self.clamped else (np.pi * np.arange(1, n + 1)) ** 4 / 2
            matrix[start : start + n, start : start + n] = np.diag(levels)
        if self.axial:
            _, weights = _quadrature()
            slopes = _axial_slopes(self.axial)
            first = self.along_y + self.along_z
            axial[first:, first:] = slopes.T @ (weights[:, None] * slopes)
        return along_y, along_z, axial

    def _bending(self, s: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Shapes and slopes (len(s), n)."""
        if self.clamped:
            return _cantilever(s, n)
        k = np.arange(1, n + 1)
        angles = np.pi * np.outer(s, k)
        at_end = (s == 0) | (s == 1)
        return np.where(at_end[:, None], 0.0, np.sin(angles)), np.pi * k * np.cos(angles)


def _quadrature() -> tuple[np.ndarray, np.ndarray]:
    """Places in [0, 1] and weights; exact to rounding for products of all shapes."""
    x, w = np.polynomial.legendre.leggauss(_POINTS)
    return 0.5 * (1 + x), 0.5 * w


def _roots(n: int) -> np.ndarray:
    """b > 0 with cos b cosh b = -1 (n,), by Newton's method on cos b + 1 / cosh b."""
    b = np.pi * (np.arange(n) + 0.5) + np.where(np.arange(n) == 0, 0.3, 0.0)
    for _ in range(20):
        b = b - (np.cos(b) + 1 / np.cosh(b)) / (-np.sin(b) - np.tanh(b) / np.cosh(b))
    return b


def _cantilever(s: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Modes cosh - cos - c (sinh - sin) of b s, 1 at the tip, and their slopes, (len(s), n) each, without cancellation for large b."""
    b = _roots(n)
    size = np.sinh(b) + np.sin(b)
    c = (np.cosh(b) + np.cos(b)) / size
    rest = (np.sin(b) - np.cos(b) - np.exp(-b)) / size  # 1 - c
    x = np.outer(s, b)
    growing, falling = 0.5 * rest * np.exp(x), 0.5 * (1 + c) * np.exp(-x)
    tip = 2.0 * (-1.0) ** np.arange(n)
    shapes = growing + falling - np.cos(x) + c * np.sin(x)
    return shapes / tip, b * (growing - falling + np.sin(x) + c * np.cos(x)) / tip


def _axial(s: np.ndarray, n: int) -> np.ndarray:
    """Lagrange's polynomials (len(s), n) that are 1 at k / n and 0 at the other nodes and at 0."""
    nodes = np.arange(n + 1) / max(n, 1)
    columns = [np.prod([(s - nodes[j]) / (nodes[k] - nodes[j]) for j in range(n + 1) if j != k], axis=0) for k in range(1, n + 1)]
    return np.column_stack(columns) if columns else np.zeros((s.size, 0))


def _axial_slopes(n: int) -> np.ndarray:
    """Their derivatives at the places of the quadrature."""
    s, _ = _quadrature()
    fit = np.polynomial.Polynomial.fit
    nodes = np.arange(n + 1) / n
    return np.column_stack([fit(nodes, np.eye(n + 1)[k], n).deriv()(s) for k in range(1, n + 1)])
