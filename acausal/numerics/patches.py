"""Dry friction of a round patch that slides and spins at once (P. Contensou, in Kreiselprobleme, Springer 1963).

Each of its points rubs against its own slip. With the slip v of the centre and the speed w = radius * spin of the edge, what is lost is limit * phi(v, w), the mean of
the points' speeds, weighted by their pressure; forces are limit * d phi / d (v, w). All of it depends on v / w only, and is even in both. K and E of C. Farkas,
G. Bartels, T. Unger, D. E. Wolf, Phys. Rev. Lett. 90 (2003), for the uniform disk, and here by B = (E - (1 - k^2) K) / k^2 and D = (K - E) / k^2, of which no
digits are lost for small k; by arithmetic and geometric means (L. V. King, 1924). patch.h has the same in C.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.language.mode_laws import Pressure

_MEANS = 9
_LEAST = 1e-30
"""Part of the larger slip by which the two differ at least: leaves a derivative where they are equal."""
_SERIES, _TERMS = 0.3, 24
"""Up to which square of the ratio, and with how many terms, there is a series for what spins little under Hertz's pressure."""
_NEAR = {
    Pressure.UNIFORM: (3.99, -12.26, 27.38, -28.34, 10.75),
    Pressure.HERTZ: (4.97, -18.10, 47.28, -54.05, 21.92),
    Pressure.RING: (1.988, -2.471, 0.991),
}
"""Of spin over slip, in units of torque over force, by the torque's part of the sum of squares: fitted, to a hundredth or two."""


def spinning(pressure: Pressure) -> float:
    """The torque where it only spins, by limit and radius."""
    return {Pressure.UNIFORM: 2 / 3, Pressure.HERTZ: 3 * np.pi / 16, Pressure.RING: 1.0}[pressure]


def against(pressure: Pressure, slip: ca.SX, least: Any = 0) -> ca.SX:
    """(3, 1): d phi / d slip, of the centre's slip (2) and the edge's speed. `least`: added to squares of slips."""
    by_slip, by_spin = _forces(pressure, slip[0] ** 2 + slip[1] ** 2, slip[2] ** 2, least)
    return ca.vertcat(by_slip * slip[:2], by_spin * slip[2])


def size(pressure: Pressure, force: ca.SX, least: Any) -> ca.SX:
    """By which factor a force (3, 1) is larger than what the patch resists with along it: the largest of force . slip / phi(slip); `least` is added to its square.

    By Newton's iteration from where it is nearly; the largest value is known to twice as many digits as where it is.
    """
    P, T = ca.sqrt(force[0] ** 2 + force[1] ** 2 + least), force[2]
    angle = ca.SX.sym("angle")
    by_slip, by_spin = _forces(pressure, ca.cos(angle) ** 2, ca.sin(angle) ** 2, 0)
    F, M = by_slip * ca.cos(angle), by_spin * ca.sin(angle)
    bend = ca.cos(angle) * ca.jacobian(M, angle) - ca.sin(angle) * ca.jacobian(F, angle)
    normal = ca.Function("normal", [angle], [F, M, bend])
    at = ca.atan2(T * _polynomial(_NEAR[pressure], T**2 / (P**2 + T**2)), P)
    for _ in range(3 if pressure is Pressure.RING else 2):  # its bend is infinite where slips are equal
        F, M, bend = normal(at)
        at += (F * T - M * P) / (bend * (P * ca.cos(at) + T * ca.sin(at)))
    F, M, _ = normal(at)
    return (P * ca.cos(at) + T * ca.sin(at)) / (F * ca.cos(at) + M * ca.sin(at))


def _forces(pressure: Pressure, v2: ca.SX, w2: ca.SX, least: Any) -> tuple[ca.SX, ca.SX]:
    """Forces by v and by w, each over its own, by the squares of both."""
    apart = v2 - w2
    difference = ca.sqrt(apart**2 + (_LEAST * (v2 + w2 + least)) ** 2)
    slides = 0.5 + 0.5 * apart / difference  # 1 where it slides faster than its edge turns, else 0
    large = 0.5 * (v2 + w2 + difference) + least
    k2, rest = (w2 * slides + v2 * (1 - slides)) / large, difference / large
    if pressure is Pressure.HERTZ:
        sliding, spinning_ = _hertz_sliding(k2), (3 * np.pi / 32 * (4 - k2), 3 * np.pi / 128 * (8 - 8 * k2 + 3 * k2**2))
    else:
        B, D, C = _elliptic(k2, rest)
        E = B + rest * D
        if pressure is Pressure.RING:
            sliding, spinning_ = (2 / np.pi * E, 2 / np.pi * B), (2 / np.pi * B, 2 / np.pi * E)
        else:
            first = 4 / (3 * np.pi) * (2 * B + rest * D)
            sliding = (first, 4 / (9 * np.pi) * (3 * B + C - D))
            spinning_ = (first, 4 / (9 * np.pi) * (B * (3 - k2) + rest * D * (3 - 2 * k2)))
    size = ca.sqrt(large)
    by_slip, by_spin = ((a * slides + b * (1 - slides)) / size for a, b in zip(sliding, spinning_, strict=True))
    return by_slip, by_spin


def _elliptic(k2: ca.SX, rest: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """B, D and (D - B) / k^2; `rest`: 1 - k^2."""
    a, b = ca.SX(1), ca.sqrt(rest)
    part, total, factor = ca.SX(1), ca.SX(0), 1.0
    for n in range(_MEANS):
        a, b = 0.5 * (a + b), ca.sqrt(a * b)
        part = (part * k2 if n else part) ** 2 / (16 * a**2)
        factor *= 2
        total += factor * part
    K = np.pi / (2 * a)
    B = 0.5 * K * (1 - k2 * total)
    return B, B + K * k2 * total, K * total


def _hertz_sliding(k2: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Where it slides faster than its edge turns."""
    j = np.arange(_TERMS + 1)
    binomial = np.cumprod(np.concatenate([[1.0], (2 * j[1:] - 1) / (2 * j[1:])]))
    slide = (
        -(binomial**2) / (2 * j - 1) * np.cumprod(np.concatenate([[1.0], j[1:] / (j[1:] + 1.5)]))
    )  # 2 / pi of E of rings, over all radii
    spin = -2 * j[1:] / (2 * j[1:] - 1) * slide[1:]
    low = _polynomial(slide[:-1], k2), _polynomial(spin, k2)
    above = ca.sqrt((k2 - _SERIES) ** 2 + _LEAST)
    m = 0.5 * (k2 + _SERIES + above)
    k, c = ca.sqrt(m), ca.sqrt(ca.sqrt((1 - m) ** 2 + _LEAST))
    angle, part = ca.atan2(k, c), 0.5 + 0.5 * (k2 - _SERIES) / above
    force = 3 / 16 * ((4 * m - 1) * angle + k * c * (1 + 2 * m)) / (m * k)
    lost = 3 / 64 * ((8 * m**2 + 8 * m - 1) * angle + k * c * (1 + 14 * m)) / (m * k)
    by_slip, by_spin = (part * b + (1 - part) * a for a, b in zip(low, (force, (lost - force) / m), strict=True))
    return by_slip, by_spin


def _polynomial(coefficients: Sequence[float] | np.ndarray, x: ca.SX) -> ca.SX:
    found = ca.SX(0)
    for coefficient in coefficients[::-1]:
        found = found * x + float(coefficient)
    return found
