"""Inputs of a run: numbers, expressions of time, samples and functions of time; and the rates that follow from them where parts need them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.collocation.inputs import Course, Formula, Inputs
from acausal.errors import AcausalError, ParameterError
from acausal.language.expression import Expression, Input, InputRate, number, sx, time
from acausal.language.interpolant import is_spline, pieces_of
from acausal.language.origin import origin
from acausal.language.pieces import WithKnots
from acausal.outputs.clocks import clocks
from acausal.outputs.functions import Functions

INPUTS = "{scene.torque: lambda t: np.sin(t)}"
InputValue = float | Callable[[float], float] | Expression | tuple[Any, Any]
"""What an input is given as; see `input_signal`."""


def input_signal(functions: Functions, inputs: Mapping[Input, InputValue]) -> Inputs:
    """Inputs as functions of time, and the rates of inputs that the model needs.

    A number; an expression of `ac.time`; `ac.samples` or a spline of scipy; a function, which is asked for one time at a time, and whose jumps are known
    when `ac.with_knots` says where. The rates of the first three follow; that of a function that takes `ac.time` is its derivative; otherwise
    a pair is needed: value and rate. Raises `ParameterError` where there is none.
    """
    known = functions.outputs.system.flat.inputs
    rated = {entry.of for entry in known if isinstance(entry, InputRate)}
    courses: list[Course] = []
    for entry in known:
        name = functions.outputs.name(entry)
        if isinstance(entry, InputRate):
            courses.append(_rate(inputs.get(entry.of, entry.of.default), name, functions.outputs.name(entry.of)))
        else:
            courses.append(_course(inputs.get(entry, entry.default), name, entry in rated))

    return Inputs(tuple(courses))


def knots(inputs: Callable[[np.ndarray], np.ndarray], t0: float, t1: float) -> np.ndarray:
    """Times [s] from t0 to t1 at which inputs jump or bend, as far as that is known, but for those that the runtime finds: of tables, and of formulas that
    do so regularly."""
    found = [np.zeros(0)]
    for course in inputs.courses if isinstance(inputs, Inputs) else ():
        if isinstance(course, Formula):
            switching = clocks(course.function)
            found.append(np.zeros(0) if switching is None else switching.times(t0, t1))
        elif isinstance(course, _Watched) and isinstance(course.function, WithKnots):
            found.append(course.function.knots(t0, t1))
    return np.unique(np.concatenate(found))


def _course(value: Any, name: str, rated: bool) -> Course:
    """The value of an input."""
    if isinstance(value, tuple) and rated and len(value) == 2:  # pyright: ignore[reportUnknownArgumentType]
        value = value[0]
    if isinstance(value, Expression | ca.SX):
        return _formula(sx(value), name)
    if is_spline(value):
        pieces = pieces_of(value)
        if len(pieces) == 1:
            return pieces[0]
    elif callable(value):
        return _Watched(value, name)
    if not np.isscalar(value):
        raise ParameterError(
            f"The input {name} is given as {shown(value)} ({origin()}). Give a number, samples: ac.samples(times, values), an expression of "
            "ac.time, or a function of time that gives numbers: lambda t: np.sin(t)."
        )
    return number(value, name)


def _rate(value: Any, name: str, of: str) -> Course:
    """The rate of an input that is given as `value`."""
    if isinstance(value, tuple):
        return _course(value[1], name, False)
    if is_spline(value):
        (pieces,) = pieces_of(value)
        return pieces.derivative()
    if callable(value) and not isinstance(value, Expression):
        try:
            value = value(time)
        except (AcausalError, TypeError, ValueError, NotImplementedError, RuntimeError) as error:
            raise ParameterError(
                f"The rate of the input {of} is needed, since it prescribes a speed, and its function of time ({origin()}) cannot be differentiated: "
                f"{str(error).rstrip('.')}. Write it with functions of numpy or CasADi, or give a pair: (function, function of its rate)."
            ) from error
    if isinstance(value, Expression | ca.SX):
        return _formula(ca.jtimes(sx(value), time.sx, ca.SX(1)), name)
    return 0.0


def _formula(value: ca.SX, name: str) -> Course:
    """An expression of `ac.time` as a function of numbers. Raises `ParameterError` for anything else in it."""
    if value.numel() != 1 or any(s.element_hash() != time.sx.element_hash() for s in ca.symvar(value)):
        raise ParameterError(
            f"The input {name} is given as {shown(value)} ({origin()}). Give a scalar in which only ac.time stands."
        )
    if value.is_constant():
        return number(float(value), name)
    t = ca.SX.sym("t")
    function = ca.Function("course", [t], [ca.densify(ca.substitute(value, time.sx, t))])
    switching = clocks(function)
    return Formula(function, () if switching is None else switching.lines)


@dataclass(frozen=True)
class _Watched:
    """The function, whose errors and results that are no numbers raise `ParameterError` with the input's name."""

    function: Callable[[float], Any]
    name: str

    def __call__(self, t: float) -> float:
        try:
            found = float(self.function(t))
        except (TypeError, ValueError) as error:
            raise ParameterError(
                f"The input {self.name} fails as a function of time at t = {t:.6g} s: {type(error).__name__}: {str(error).rstrip('.')}. It is "
                "called with one number, the time [s], and must return one number."
            ) from error
        except Exception as error:  # the user's own, in the user's own function
            error.add_note(f"In the function of time of the input {self.name}, called with t = {t:.6g} s.")
            raise
        return found
