"""Tables and curves that were measured, at an expression of the scene."""

from __future__ import annotations

from typing import Any

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, leaves, sx
from acausal.language.interpolant import is_spline, of_spline
from acausal.language.origin import origin


def lookup(curve: Any, at: Scalar) -> Expression:
    """The value of a `curve` at the scalar `at`, any expression: a motor's torque at its speed, a friction at a slip, a valve's flow at its lift.

    `curve`: of scipy's piecewise polynomials of one variable (CubicSpline, PchipInterpolator, Akima1DInterpolator, interp1d, make_interp_spline, ...), or
    ac.samples(points, values, kind); of n columns of data it gives (n, 1). Beyond its data as it says itself: going on, periodic, constant, or NaN.
    It is a formula: steps end where its pieces meet, and derivatives are exact. Raises `ParameterError` for what is no such curve, and no scalar.

        scene.motor = TorqueSource(ac.lookup(PchipInterpolator([0, 50, 200, 400], [10, 12, 6, 0]), scene.rotor.w))

    A table of more variables is one of CasADi's: ca.interpolant("map", "bspline", [speeds, pedals], values.ravel(order="F"))(ca.vertcat(speed, pedal)).
    """
    if not is_spline(curve):
        raise ParameterError(
            f"lookup: {curve!r} is no curve of one variable ({origin()}). Give one of scipy, CubicSpline(points, values), or ac.samples(points, values)."
        )
    x = sx(at)
    if not x.is_scalar():
        raise ParameterError(f"lookup: a curve has one variable, and was given {x.shape} ({origin()}). Give a scalar.")
    found = of_spline(curve, ca.densify(x))
    return Expression(ca.vertcat(*found) if isinstance(found, list) else found, leaves(at))
