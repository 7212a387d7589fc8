"""Implicit functions in straight-line code: the solution z of g(z, k) = 0 that goes on from a known one.

Equations that are linear in z are solved at once. Otherwise k moves in equal steps along the straight line from the known point, with one
Newton step each, and `POLISH` more follow at the end. A Newton step that leaves more than half of the residual says that the path may have
been lost to another solution (restricted monotonicity; Deuflhard: Newton Methods for Nonlinear Problems, sections 3.1 and 5.1).
Where all converge, so do the derivatives of the straight-line code: the error of the first derivative is that of z times the one before,
so both vanish together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from acausal.dynamics.formulas import solve_positive
from acausal.numerics.elimination import solved_by_qr

POLISH = 5
_CONVERGED = 1e-8
_CLOSED = 1e-8
_LOST = 0.5**4
_ROUNDING = 1e-10

Residual = Callable[[ca.SX, ca.SX], ca.SX]
"""(z, k) -> g"""


@dataclass(frozen=True)
class Known:
    """A solution `z` (n, 1) at `k`, from which others are followed."""

    z: ca.SX
    k: ca.SX


@dataclass(frozen=True)
class Followed:
    """`z` (n, 1), NaN where the path was lost. `strain`: what Newton steps along the path left of the residual, as a sum of fourth
    powers of ratios; zero where nothing is iterated, and 1/16 where the reach ends.
    """

    z: ca.SX
    strain: ca.SX


def follow(residual: Residual, known: Known, k: ca.SX, steps: int) -> Followed:
    """The solution at `k`. There may be more rows in g than entries in z, dependent on one another where g = 0."""
    n = known.z.numel()
    if n == 0:
        return Followed(ca.SX(0, 1), ca.SX(0))
    z_s, k_s = ca.SX.sym("z", n), ca.SX.sym("k", k.numel())
    g = residual(z_s, k_s)
    J = ca.jacobian(g, z_s)
    newton = ca.Function("newton", [z_s, k_s], [solve_rows(J, -g), ca.densify(g)])
    if not ca.depends_on(J, z_s):
        zero = ca.SX.zeros(n)
        return Followed(zero + newton(zero, k)[0], ca.SX(0))
    rows = ca.Function("rows", [z_s, k_s], [ca.densify(g)])
    z, strain, dz = known.z, ca.SX(0), ca.SX(0)
    for i in range(1, steps + 1):
        there = k if i == steps else known.k + (i / steps) * (k - known.k)
        dz, before = newton(z, there)
        z = z + dz
        strain += (ca.sumsqr(rows(z, there)) / (ca.sumsqr(before) + _ROUNDING**2)) ** 2
    gap = ca.SX(0)
    for _ in range(POLISH):
        dz, gap = newton(z, k)
        z = z + dz
    good = ca.logic_and(strain <= _LOST, ca.sumsqr(dz) <= _CONVERGED**2 * (1 + ca.sumsqr(z)))
    if g.numel() > n:  # the least sum of squares need not be zero
        good = ca.logic_and(good, ca.sumsqr(gap) <= _CLOSED**2)
    return Followed(z + ca.if_else(good, 0, float("nan")), strain)


def solve_rows(J: ca.SX, right: ca.SX) -> ca.SX:
    """Z with J Z = right for J (m, n) of rank n; least squares where m > n, which is exact where rows only repeat one another."""
    m, n = J.shape
    if m == n:
        return solved_by_qr(J, right)
    return solve_positive(ca.densify(J.T @ J), ca.densify(J.T @ right))
