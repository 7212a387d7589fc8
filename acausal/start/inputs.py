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
from acausal.language.pieces import PiecewisePolynomial, WithKnots
from acausal.outputs.clocks import clocks
from acausal.outputs.functions import Functions

INPUTS = "{scene.torque: lambda t: np.sin(t)}"
InputValue = float | Callable[[float], float] | Expression | tuple[Any, ...]
"""What an input is given as; see `input_signal`."""


def input_signal(functions: Functions, inputs: Mapping[Input, InputValue]) -> Inputs:
    """Inputs as functions of time, and the rates of inputs that the model needs.

    A number; an expression of `ac.time`; `ac.samples` or a spline of scipy; a function, which is asked for one time at a time, and whose jumps are known
    when `ac.with_knots` says where. The rates of the first three follow; that of a function that takes `ac.time` is its derivative; otherwise
    a tuple is needed: the value and as many rates as parts ask for. Raises `ParameterError` where there is none.
    """
    known, led = functions.outputs.system.flat.inputs, functions.outputs.system.led
    owned = [_own(entry) for entry in known]
    most: dict[Input, int] = {}
    for own, order in owned:
        most[own] = max(order, most.get(own, 0))
    return Inputs(
        tuple(
            _of_order(order, own, most[own], inputs[own], functions.outputs.name(entry), own in led)
            if own in inputs
            else _default(own, order)
            for entry, (own, order) in zip(known, owned, strict=True)
        )
    )


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
    return np.unique(np.concatenate(found)) if len(found) > 1 else found[0]


def check_smooth(functions: Functions, inputs: Callable[[np.ndarray], np.ndarray], t0: float, t1: float) -> None:
    """Raises `ParameterError` where samples that prescribe a place or an angle jump or bend between t0 and t1: nothing with inertia follows that."""
    known = functions.outputs.system.flat.inputs
    if not isinstance(inputs, Inputs):
        return
    twice = [entry.of.of for entry in known if isinstance(entry, InputRate) and isinstance(entry.of, InputRate)]
    for entry, course in zip(known, inputs.courses, strict=True):
        if entry not in twice or not isinstance(course, PiecewisePolynomial):
            continue
        for found, what in ((course, "jump"), (course.derivative(), "bend")):
            at = found.jump(t0, t1)
            if at is not None:
                raise ParameterError(
                    f"The input {functions.outputs.name(entry)} prescribes {_PRESCRIBED[2]}, and its samples {what} at t = {at:.6g} s ({origin()}): nothing with "
                    'inertia can follow. Give a smooth course, ac.samples(times, values, "cubic") or a CubicSpline of scipy over the whole time, or put a '
                    "spring between."
                )


def _of_order(order: int, own: Input, wanted: int, value: InputValue, name: str, led: bool) -> Course:
    """The course of an input, or of a rate of one, of which so many are wanted; `led`: nonlinear equations follow it."""
    if isinstance(value, tuple) and len(value) == wanted + 1 > 1:
        return _course(value[order], name)
    if order == 0:
        return _course(value, name, wanted)
    why = "stands in nonlinear equations, whose solution follows it" if led else f"prescribes {_PRESCRIBED[wanted]}"
    return _rate(value, name, order, f"the function of time of {own.name} ({origin()})", wanted, why)


def _default(own: Input, order: int) -> float:
    return 0.0 if order else own.default


def _own(entry: Input) -> tuple[Input, int]:
    """The user's input, and which rate of it this is."""
    if not isinstance(entry, InputRate):
        return entry, 0
    own, order = _own(entry.of)
    return own, order + 1


def _course(value: Any, name: str, rates: int = 0) -> Course:
    """The value of an input, of which so many rates follow."""
    if isinstance(value, Expression | ca.SX):
        return _formula(sx(value), name)
    if is_spline(value):
        pieces = pieces_of(value)
        if len(pieces) == 1:
            return pieces[0]
    elif callable(value):
        return _Watched(value, name)
    if not np.isscalar(value):
        given = f" With rates, which are needed here: ({', '.join(['function', *_RATES[:rates]])})." if rates else ""
        raise ParameterError(
            f"The input {name} is given as {shown(value)} ({origin()}). Give a number, samples: ac.samples(times, values), an expression of "
            f"ac.time, or a function of time that gives numbers: lambda t: np.sin(t).{given}"
        )
    return number(value, name)


_RATES = ("function of its rate", "function of its second rate")
_PRESCRIBED = ("", "a speed", "a place or an angle")


def _rate(value: Any, name: str, order: int, what: str, wanted: int, why: str) -> Course:
    """The rate of this order, of so many that are wanted, of an input that is given as `value`, called `what`; `why` it is needed."""
    if is_spline(value):
        (pieces,) = pieces_of(value)
        for _ in range(order):
            pieces = pieces.derivative()
        return pieces
    if callable(value) and not isinstance(value, Expression):
        try:
            value = value(time)
        except (AcausalError, TypeError, ValueError, NotImplementedError, RuntimeError) as error:
            raise ParameterError(
                f"The rate {name} is needed, since its input {why}, and {what} cannot be differentiated: "
                f"{str(error).rstrip('.')}. Write it with functions of numpy or CasADi, or give its rates with it: "
                f"(function, {', '.join(_RATES[:wanted])})."
            ) from error
    if isinstance(value, Expression | ca.SX):
        found = sx(value)
        for _ in range(order):
            found = ca.jtimes(found, time.sx, ca.SX(1))
        return _formula(found, name)
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
