"""Tables and curves that were measured, and laws that users give as functions, at expressions of the scene."""

from __future__ import annotations

import reprlib
import traceback
from collections.abc import Callable
from typing import Any

import casadi as ca

from acausal.errors import ExpressionError, ParameterError
from acausal.language.expression import Expression, Scalar, declared_in, formula, leaves, sx
from acausal.language.interpolant import is_spline, of_spline, pieces_of
from acausal.language.origin import origin
from acausal.language.scipy_tables import table_of


def lookup(curve: Any, *at: Scalar) -> Expression:
    """The value of a `curve` at the scalar `at`, any expression: a motor's torque at its speed, a friction at a slip; or of a table at several.

    `curve`: of scipy's piecewise polynomials of one variable (CubicSpline, PchipInterpolator, Akima1DInterpolator, interp1d, make_interp_spline, ...), or
    ac.samples(points, values, kind); of n columns of data it gives (n, 1). Of more variables, on a grid: RectBivariateSpline and its like,
    RegularGridInterpolator ("linear", "slinear", "cubic", "quintic"), NdBSpline, or ca.interpolant. Beyond its data as it says itself: going on, periodic,
    constant, or NaN; a RegularGridInterpolator that would raise an error there gives NaN. It is a formula: steps end where its pieces meet, and
    derivatives are exact. Raises `ParameterError` for what is no such curve, and for another number of variables.

        scene.motor = TorqueSource(ac.lookup(PchipInterpolator([0, 50, 200, 400], [10, 12, 6, 0]), scene.rotor.w))
        scene.motor = TorqueSource(ac.lookup(RectBivariateSpline(speeds, pedals, torques), scene.rotor.w, scene.pedal))
    """
    x = ca.vertcat(*(ca.vec(ca.densify(sx(value))) for value in at))
    return Expression(_looked_up(curve, x), leaves(*at))


def _looked_up(curve: Any, x: ca.SX) -> ca.SX:
    """At the variables x (n, 1)."""
    if isinstance(curve, ca.Function):
        _check_number(curve.numel_in(0), x)
        return formula(curve(x), "lookup")
    if not is_spline(curve):
        raise ParameterError(
            f"lookup: {reprlib.repr(curve)} is no curve and no table ({origin()}). Give one of scipy, CubicSpline(points, values), or ac.samples(points, values)."
        )
    table = table_of(curve)
    if table is not None:
        _check_number(table.variables, x)
        return table.at(ca.vertsplit(x))
    pieces_of(curve)
    _check_number(1, x)
    found = of_spline(curve, x)
    return ca.vertcat(*found) if isinstance(found, list) else found


def _check_number(variables: int, x: ca.SX) -> None:
    if x.numel() != variables:
        have = "one variable" if variables == 1 else f"{variables} variables"
        raise ParameterError(f"lookup: what is looked up has {have}, and was given {x.numel()} ({origin()}).")


def at_symbols(law: Callable[..., Any], what: str, arguments: str, *symbols: ca.SX) -> ca.SX:
    """What a user's law gives for symbols: a function of `arguments`, or a table of scalars. Raises `ParameterError` for anything else, and what it raises."""
    try:
        if is_spline(law) or (isinstance(law, ca.Function) and law.n_in() == 1 < len(symbols)):
            return _looked_up(law, ca.vertcat(*symbols))
        if not callable(law):
            raise ParameterError(
                f"{what} is given by {reprlib.repr(law)} ({origin()}). Give a function, lambda {arguments}: ..., or a table of scipy."
            )
        # as expressions, which numpy's functions take as CasADi's do
        return formula(sx(law(*(Expression(symbol, declared_in(symbol)) for symbol in symbols))), what)
    except ExpressionError as error:
        raise ParameterError(f"{what} cannot be used. {error}") from error
    except (TypeError, AttributeError, ValueError, ArithmeticError, NotImplementedError, RuntimeError) as error:
        of_scipy = any(
            frame.f_globals.get("__name__", "").startswith("scipy") for frame, _ in traceback.walk_tb(error.__traceback__)
        )
        hint = f" A table of scipy is given itself, or looked up by ac.lookup(table, {arguments})." if of_scipy else ""
        raise ParameterError(
            f"{what} cannot be used ({origin()}): {str(error).rstrip('.')}. It must be a function of ({arguments}) in numpy's or CasADi's functions, which "
            f"is called with symbols: lambda {arguments}: ...{hint}"
        ) from error
