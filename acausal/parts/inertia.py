"""Inertia of a rigid part: mass, first moment and second moment about the origin of a frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.numerics.thresholds import EDGE
from acausal.parts.pose import Matrix, Pose, product, symbolic, total

_ROUND = 1e-9
"""Part of the inertia within which a body counts as round."""


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], first moment m c (3,) [kg m] and second moment (3, 3) [kg m^2] about and in one frame.

    `near`: a point (3,) of the frame and the moments about it, where they are known better than from the origin: of a body far from the origin of its
    frame the second moment about this is all distance, and taking the distance away again leaves rounding.
    """

    mass: float | ca.SX
    moment: Matrix
    second_moment: Matrix
    near: tuple[np.ndarray, Matrix, Matrix] | None = field(default=None, repr=False, compare=False)

    @property
    def is_point(self) -> bool:
        """Whether all of it is in one point, by numbers."""
        m, h, second = self.mass, self.moment, self.second_moment
        if not (isinstance(m, float) and isinstance(h, np.ndarray) and isinstance(second, np.ndarray) and m > 0):
            return False
        left = m * second - (h @ h * np.eye(3) - np.outer(h, h))
        return bool(np.max(np.abs(left)) <= EDGE * float(h @ h))

    @classmethod
    def zero(cls) -> Inertia:
        """Of nothing."""
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))

    @classmethod
    def about_centre(cls, mass: float | ca.SX, centre: Matrix, central: Matrix) -> Inertia:
        """From the centre of mass (3,) [m] and the inertia about it (3, 3) [kg m^2]: Steiner's theorem."""
        if isinstance(centre, np.ndarray):
            return cls._about(mass, centre, np.zeros(3), central)
        moment = scaled(mass, centre)
        return cls(mass, moment, total(central, -product(skew(moment), skew(centre))))

    @classmethod
    def _about(cls, mass: float | ca.SX, point: np.ndarray, moment: Matrix, second: Matrix) -> Inertia:
        """From moments about a point (3,), in the same axes."""
        return cls(mass, *_shifted(mass, moment, second, point), (point, moment, second))

    @property
    def is_zero(self) -> bool:
        """Whether mass and second moment are zero by structure."""
        return is_zero(self.mass) and is_zero(self.second_moment)

    @property
    def is_physical(self) -> bool:
        """Of numbers: whether some distribution of mass has it. Its moments of first and second order, with the mass, are then no squares below zero."""
        mass, moment, second = float(self.mass), np.ravel(np.asarray(self.moment)), np.asarray(self.second_moment)
        if np.max(np.abs(second - second.T)) > EDGE * np.max(np.abs(second)):
            return False
        spread = 0.5 * np.trace(second) * np.eye(3) - second
        length = np.sqrt(np.trace(spread) / mass) if mass > 0 and np.trace(spread) > 0 else 1.0
        whole = np.block([[spread / length**2, moment[:, None] / length], [moment[None, :] / length, np.array([[mass]])]])
        return bool(np.linalg.eigvalsh(whole)[0] >= -EDGE * np.max(np.abs(whole)))

    def __add__(self, other: Inertia) -> Inertia:
        if self.is_zero or other.is_zero:
            return other if self.is_zero else self
        point, moment, second = self._known
        there, first, turning = other._known
        first, turning = _shifted(other.mass, first, turning, there - point)
        return Inertia._about(self.mass + other.mass, point, total(moment, first), total(second, turning))

    def shared(self, parts: int) -> Inertia:
        """One of `parts` equal shares, all of them in the same place."""
        share, (point, moment, second) = 1.0 / parts, self._known
        return Inertia._about(share * self.mass, point, scaled(share, moment), scaled(share, second))

    def seen_from(self, X_AB: Pose) -> Inertia:
        """The inertia about and in A of what is given about and in B."""
        R, p = X_AB.rotation, X_AB.position
        if not (isinstance(R, np.ndarray) and isinstance(p, np.ndarray)):
            moments = product(R, self.moment), product(product(R, self.second_moment), R.T)
            return Inertia(self.mass, *_shifted(self.mass, *moments, p))
        point, moment, second = self._known
        return Inertia._about(self.mass, R @ point + p, product(R, moment), product(product(R, second), R.T))

    @property
    def central(self) -> Matrix:
        """Second moment (3, 3) about the centre of mass. Not of what has none."""
        _, moment, second = self._known
        return second if is_zero(moment) else total(second, product(skew(moment), skew(scaled(1 / self.mass, moment))))

    @property
    def _known(self) -> tuple[np.ndarray, Matrix, Matrix]:
        return self.near or (np.zeros(3), self.moment, self.second_moment)


def _shifted(mass: float | ca.SX, moment: Matrix, second: Matrix, p: Matrix) -> tuple[Matrix, Matrix]:
    """Moments about the origin, from those about a point p (3,)."""
    shift = product(skew(p), skew(moment))
    second = total(second, -total(shift, total(shift.T, product(skew(scaled(mass, p)), skew(p)))))
    return total(moment, scaled(mass, p)), second


def skew(vector: Matrix) -> Matrix:
    """The matrix [v]x with [v]x u = v x u."""
    if isinstance(vector, ca.SX):
        return ca.skew(vector)
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def scaled(factor: float | ca.SX, matrix: Matrix) -> Matrix:
    """factor * matrix, numeric if both are."""
    if isinstance(factor, ca.SX) or isinstance(matrix, ca.SX):
        return ca.SX(factor) * symbolic(matrix)
    return factor * matrix


def is_zero(value: float | Matrix) -> bool:
    """Whether every entry is the number zero."""
    return value.is_zero() if isinstance(value, ca.SX) else bool(np.all(value == 0))


def is_round(inertia: Inertia, axis: np.ndarray | None = None) -> bool:
    """Whether a body made of numbers has its centre of mass at the origin, and the second moment of a body of revolution about the unit
    vector `axis` (3,), or, without one, of a ball.
    """
    second, moment = inertia.second_moment, inertia.moment
    if (
        not (isinstance(second, np.ndarray) and isinstance(moment, np.ndarray) and isinstance(inertia.mass, float))
        or not inertia.mass
    ):
        return False
    size = float(np.trace(second))
    along = np.zeros((3, 3)) if axis is None else np.outer(axis, axis)
    own = size / 3 if axis is None else float(axis @ second @ axis)
    across = own if axis is None else (size - own) / 2
    gap = np.abs(second - own * along - across * (np.eye(3) - along)).max()
    return bool(moment @ moment <= _ROUND**2 * inertia.mass * size and gap <= _ROUND * size)
