"""Equations with numeric coefficients, as dictionaries over chain levels."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from acausal.scalar.chains import Level


@dataclass
class Affine:
    """sum of coefficients times chain levels + constant + rest = 0; `size` is the largest number that went into the constant.

    `rest` is an expression of known symbols, such as the voltage of a source over time.
    """

    coefficients: dict[Level, float]
    constant: float
    size: float
    rest: ca.SX = field(default_factory=lambda: ca.SX(0))
    combined: bool = False
    """Whether a coefficient is the sum of several. Elimination by such equations, one after another, would be shooting."""

    def add(self, level: Level, coefficient: float) -> None:
        """Adds a term; one that cancels to rounding goes."""
        old = self.coefficients.get(level, 0.0)
        total = old + coefficient
        if abs(total) <= 1e-13 * max(abs(coefficient), abs(old)):
            self.coefficients.pop(level, None)
        else:
            self.combined = self.combined or old != 0.0
            self.coefficients[level] = total

    def add_number(self, number: float) -> None:
        """Adds to the constant."""
        self.constant += number
        self.size = max(self.size, abs(number))

    def add_multiple(self, other: Affine, weight: float) -> None:
        """Adds another equation `weight` times."""
        for level, coefficient in other.coefficients.items():
            self.add(level, weight * coefficient)
        self.constant += weight * other.constant
        self.size = max(self.size, abs(weight) * other.size)
        if other.open:
            self.rest = self.rest + weight * other.rest

    @property
    def open(self) -> bool:
        """Whether `rest` says something."""
        return not self.rest.is_zero()

    @property
    def consistent(self) -> bool:
        """Whether what is left without unknowns is zero to rounding."""
        return abs(self.constant) <= 1e-12 * self.size and not self.open

    @property
    def remainder(self) -> ca.SX:
        """What is left without unknowns."""
        return self.rest + self.constant
