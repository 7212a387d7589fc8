"""Inputs of a run: numbers and functions of time; and the rates that follow from them where parts need them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import dictionary, shown
from acausal.errors import AcausalError, ParameterError, UnknownVariableError
from acausal.language.component import Component
from acausal.language.expression import Expression, Input, InputRate, Parameter, number, sx, time
from acausal.language.origin import origin
from acausal.outputs.functions import Functions

INPUTS = "{scene.torque: lambda t: np.sin(t)}"
Course = float | Callable[[float], float] | Expression
InputValue = Course | tuple[Course, Course]
"""What an input is given as. Where its rate is needed, also an expression of `ac.time`, or a pair: value and rate."""


def input_signal(functions: Functions, inputs: Mapping[Input, InputValue]) -> Callable[[np.ndarray], np.ndarray]:
    """times (n,) -> inputs (nu, n), and the rates of inputs that the model needs. A callable is asked for one time at a time.

    The rate of a number is 0. That of an expression of `ac.time`, or of a function that takes one, is its derivative; otherwise it is the second
    entry of a pair. Raises `ParameterError` where there is none.
    """
    known = functions.outputs.system.flat.inputs
    given = dictionary(inputs, "inputs", INPUTS)
    for entry in given:
        if entry not in known or isinstance(entry, InputRate):
            names = [functions.outputs.name(k) for k in known if not isinstance(k, InputRate)]
            raise UnknownVariableError(unknown_symbol(entry, "input", names))
    rated = {entry.of for entry in known if isinstance(entry, InputRate)}
    courses: list[float | Callable[[float], float]] = []
    for entry in known:
        name = functions.outputs.name(entry)
        if isinstance(entry, InputRate):
            courses.append(_rate(given.get(entry.of, entry.of.default), name, functions.outputs.name(entry.of)))
        else:
            courses.append(_course(given.get(entry, entry.default), name, entry in rated))

    return _Signal(tuple(courses))


def _course(value: Any, name: str, rated: bool) -> float | Callable[[float], float]:
    """The value of an input."""
    if isinstance(value, tuple) and rated and len(value) == 2:  # pyright: ignore[reportUnknownArgumentType]
        value = value[0]
    if isinstance(value, Expression | ca.SX) and rated:
        return _evaluated(value, name)
    if callable(value):
        return _Watched(value, name)
    if not np.isscalar(value):
        raise ParameterError(
            f"The input {name} is given as {shown(value)} ({origin()}). Give a number, or a function of time that gives numbers: "
            "lambda t: np.sin(t), or lambda t: np.interp(t, times, samples)."
        )
    return number(value, name)


def _rate(value: Any, name: str, of: str) -> float | Callable[[float], float]:
    """The rate of an input that is given as `value`."""
    if isinstance(value, tuple):
        return _course(value[1], name, False)
    if callable(value) and not isinstance(value, Expression):
        try:
            value = value(time)
        except (AcausalError, TypeError, ValueError, NotImplementedError, RuntimeError) as error:
            raise ParameterError(
                f"The rate of the input {of} is needed, since it prescribes a speed, and its function of time ({origin()}) cannot be differentiated: "
                f"{str(error).rstrip('.')}. Write it with functions of numpy or CasADi, or give a pair: (function, function of its rate)."
            ) from error
    if isinstance(value, Expression | ca.SX):
        return _evaluated(ca.jtimes(sx(value), time.sx, ca.SX(1)), name)
    return 0.0


def _evaluated(value: Expression | ca.SX, name: str) -> Callable[[float], float]:
    """An expression of `ac.time` as a function of numbers. Raises `ParameterError` for anything else in it."""
    expression = sx(value)
    if expression.numel() != 1 or any(s.element_hash() != time.sx.element_hash() for s in ca.symvar(expression)):
        raise ParameterError(
            f"The input {name} is given as {shown(value)} ({origin()}). Give a scalar in which only ac.time stands."
        )
    function = ca.Function("course", [time.sx], [ca.densify(expression)])
    return _Evaluated(function)


@dataclass(frozen=True)
class _Signal:
    """times (n,) -> inputs (nu, n), each a number or a function of time."""

    given: tuple[float | Callable[[float], float], ...]

    def __call__(self, times: np.ndarray) -> np.ndarray:
        result = np.empty((len(self.given), times.size))
        for i, value in enumerate(self.given):
            result[i] = [value(float(t)) for t in times] if callable(value) else value
        return result


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


@dataclass(frozen=True)
class _Evaluated:
    """A CasADi function of time for numbers."""

    function: ca.Function

    def __call__(self, t: float) -> float:
        return float(self.function(t))


def unknown_symbol(symbol: Any, kind: str, known: list[str]) -> str:
    """Words for a `kind` of symbol that the scene has not."""
    article = "an" if kind == "input" else "a"
    held = vars(symbol).values() if isinstance(symbol, Component) else ()
    own = [value.name for value in held if isinstance(value, Input if kind == "input" else Parameter)]
    hint = (
        f" Name the {kind} itself: {', '.join(f'scene.{name}' for name in own or known[:1])}."
        if own or (known and isinstance(symbol, str))
        else ""
    )
    return f"{symbol!r} is not {article} {kind} of this scene. It has: {', '.join(known) or 'none'}.{hint}"
