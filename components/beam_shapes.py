"""Shape functions of straight uniform beams over s = x / length, and their integrals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.parts.modal_inertia import ShapeIntegrals, without_rounding

BENDING_MOST = 12
AXIAL_MOST = 6
_POINTS = 80


@dataclass(frozen=True)
class BeamShapes:
    """Bending along y, then along z, then axial; see `components.flexible_beam.FlexibleBeam`."""

    along_y: int
    along_z: int
    axial: int
    modes: str
    """Of bending: "pinned", "cantilever" or "craig-bampton"."""

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
        s, weights = _quadrature()
        along_y, along_z, axial = (np.zeros((self.count, self.count)) for _ in range(3))
        start = 0
        for matrix, rates in (
            (along_y, self._bending(s, self.along_y)[2]),
            (along_z, self._bending(s, self.along_z)[2]),
            (axial, _axial_slopes(s, self.axial)),
        ):
            end = start + rates.shape[1]
            matrix[start:end, start:end] = without_rounding(rates.T @ (weights[:, None] * rates))
            start = end
        return along_y, along_z, axial

    def _bending(self, s: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shapes, slopes and curvatures (len(s), n)."""
        if self.modes == "pinned":
            return _pinned(s, n)
        if self.modes == "cantilever":
            tip = 2.0 * (-1.0) ** np.arange(n)
            shapes, slopes, curvatures = _clamped(s, n, 1)
            return shapes / tip, slopes / tip, curvatures / tip
        static = (
            np.column_stack([s * s * (3 - 2 * s), s * s * (s - 1)]),
            np.column_stack([6 * s * (1 - s), s * (3 * s - 2)]),
            np.column_stack([6 - 12 * s, 6 * s - 2]),
        )
        inner = _clamped(s, max(n - 2, 0), -1)
        first, second, third = (np.hstack([a[:, :n], b]) for a, b in zip(static, inner, strict=True))
        return first, second, third


def _quadrature() -> tuple[np.ndarray, np.ndarray]:
    """Places in [0, 1] and weights; exact to rounding for products of all shapes."""
    x, w = np.polynomial.legendre.leggauss(_POINTS)
    return 0.5 * (1 + x), 0.5 * w


def _pinned(s: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sin(k pi s), its slopes and curvatures; exactly zero at the ends."""
    k = np.pi * np.arange(1, n + 1)
    angles = np.outer(s, k)
    shapes = np.where(((s == 0) | (s == 1))[:, None], 0.0, np.sin(angles))
    return shapes, k * np.cos(angles), -k * k * shapes


def _clamped(s: np.ndarray, n: int, end: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Modes cosh - cos - c (sinh - sin) of b s, their slopes and curvatures, (len(s), n) each, without cancellation for large b.

    Clamped at 0; `end` 1: free at 1, -1: clamped there too, where shapes and slopes are exactly zero. b solves cos b cosh b = -end.
    """
    k = np.arange(n)
    b = np.pi * (k + 0.5) + (np.where(k == 0, 0.3, 0.0) if end > 0 else np.pi)
    for _ in range(20):  # Newton's method on cos b + end / cosh b
        b = b - (np.cos(b) + end / np.cosh(b)) / (-np.sin(b) - end * np.tanh(b) / np.cosh(b))
    size = np.sinh(b) + end * np.sin(b)
    c = (np.cosh(b) + end * np.cos(b)) / size
    rest = (end * (np.sin(b) - np.cos(b)) - np.exp(-b)) / size  # 1 - c
    x = np.outer(s, b)
    growing, falling = 0.5 * rest * np.exp(x), 0.5 * (1 + c) * np.exp(-x)
    shapes = growing + falling - np.cos(x) + c * np.sin(x)
    slopes = b * (growing - falling + np.sin(x) + c * np.cos(x))
    held = ((s == 0) | (s == 1))[:, None] & (end < 0)
    return np.where(held, 0.0, shapes), np.where(held, 0.0, slopes), b * b * (growing + falling + np.cos(x) - c * np.sin(x))


def _axial(s: np.ndarray, n: int) -> np.ndarray:
    """Lagrange's polynomials (len(s), n) that are 1 at k / n and 0 at the other nodes and at 0."""
    nodes = np.arange(n + 1) / max(n, 1)
    columns = [np.prod([(s - nodes[j]) / (nodes[k] - nodes[j]) for j in range(n + 1) if j != k], axis=0) for k in range(1, n + 1)]
    return np.column_stack(columns) if columns else np.zeros((s.size, 0))


def _axial_slopes(s: np.ndarray, n: int) -> np.ndarray:
    """Their derivatives (len(s), n)."""
    nodes = np.arange(n + 1) / max(n, 1)
    columns = [np.polynomial.Polynomial.fit(nodes, np.eye(n + 1)[k], n).deriv()(s) for k in range(1, n + 1)]
    return np.column_stack(columns) if columns else np.zeros((s.size, 0))
