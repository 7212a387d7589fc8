"""Prescribed motions: values of expressions as functions of time, with as many derivatives as are needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import casadi as ca
import numpy as np

from acausal.errors import OptionError, ParameterError
from acausal.language.expression import Expression, Parameter, Scalar, Time, leaves, of_time, sx
from acausal.numerics.bound import Columns
from acausal.outputs.expression_names import labels
from acausal.outputs.functions import Functions

Given = Scalar | Callable[[Any], Any]
_DEGREE = 5


@dataclass(frozen=True, repr=False)
class Course:
    """One scalar that follows `course(t, k)`, its k-th derivative. `value`: the expression that does, `name`: of it."""

    name: str
    value: ca.SX
    course: Callable[[float, int], float]

    def __call__(self, t: float, order: int) -> float:
        """The derivative of this order at `t` [s]."""
        return self.course(t, order)


def courses(functions: Functions, motions: Mapping[Expression, Given], times: np.ndarray, p: np.ndarray) -> tuple[Course, ...]:
    """One for each entry of each expression. Numbers, expressions in `ac.time` and parameters, functions of time, or samples at `times`,
    (n,) or (n, size), through which a spline of degree 5 goes.

    Raises `OptionError`.
    """
    if not isinstance(motions, Mapping) or not motions:  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass lists
        raise OptionError(
            "inverse_dynamics: give motions={variable: motion}, e.g. motions={scene.hinge.q: 0.5 * np.sin(ac.time)}."
        )
    found: list[Course] = []
    for key, given in motions.items():
        if not isinstance(key, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass names
            raise OptionError(f"inverse_dynamics: the key {key!r} of `motions` is not a variable; use e.g. scene.hinge.q.")
        value, names = ca.vec(functions.outputs.resolve(key)), labels(functions.outputs, key)
        made = _sampled(given, times, names) if _is_samples(given, times, len(names)) else _symbolic(functions, given, p, names)
        found += [Course(name, value[k], made[k]) for k, name in enumerate(names)]
    return tuple(found)


def _is_samples(given: Given, times: np.ndarray, size: int) -> bool:
    """Numbers, one for each time; a short list may also be the constant value of a vector."""
    if isinstance(given, Expression | ca.SX) or callable(given) or leaves(given):
        return False
    shape = np.shape(cast(Any, given))
    return bool(shape) and (shape[0] == times.size or len(shape) == 2) and shape != (size,)


def _sampled(given: Given, times: np.ndarray, names: tuple[str, ...]) -> list[Callable[[float, int], float]]:
    from scipy.interpolate import make_interp_spline

    try:
        values = np.asarray(cast(Any, given), dtype=float).reshape(times.size, -1)
    except (TypeError, ValueError, OverflowError):
        values = np.zeros((0, 0))
    if values.shape != (times.size, len(names)) or not np.isfinite(values).all():
        raise OptionError(
            f"inverse_dynamics: the motion of {', '.join(names)} has shape {np.shape(cast(Any, given))}; it needs {len(names)} finite numbers "
            f"for each of the {times.size} times."
        )
    if times.size <= _DEGREE:
        raise OptionError(
            f"inverse_dynamics: {times.size} samples of {', '.join(names)} are too few for accelerations; give at least 6."
        )
    splines = [make_interp_spline(times, column, k=_DEGREE) for column in values.T]
    return [lambda t, k, spline=spline: float(spline(t, nu=k)) for spline in splines]


def _symbolic(functions: Functions, given: Given, p: np.ndarray, names: tuple[str, ...]) -> list[Callable[[float, int], float]]:
    s = functions.outputs.system
    what = ", ".join(names)
    if given is None or isinstance(given, str | bool):
        raise OptionError(
            f"inverse_dynamics: the motion of {what} is {given!r}. Give a number, an expression in ac.time, or samples."
        )
    try:
        value = of_time(given)
        column = ca.vec(sx(value))
    except (TypeError, ValueError, NotImplementedError, ParameterError) as error:
        raise OptionError(
            f"inverse_dynamics: the motion of {what} cannot be differentiated ({str(error).splitlines()[0]}). Use ac.time with numpy's functions, or give samples."
        ) from error
    known = {e.element_hash() for e in ca.symvar(ca.vertcat(s.t, s.p))}
    if any(not isinstance(leaf, Time | Parameter) for leaf in leaves(value)) or any(
        e.element_hash() not in known for e in ca.symvar(column)
    ):
        raise OptionError(f"inverse_dynamics: the motion of {what} must depend on ac.time and parameters only.")
    if column.numel() != len(names):
        raise OptionError(f"inverse_dynamics: the motion of {what} has {column.numel()} entries, not {len(names)}.")
    derivatives: list[Columns] = []

    def at(t: float, order: int, k: int) -> float:
        while len(derivatives) <= order:
            change = column
            for _ in range(len(derivatives)):
                change = ca.jtimes(change, s.t, ca.SX(1))
            derivatives.append(Columns(ca.Function("course", [s.t, s.p], [change])))
        return float(derivatives[order](t, p)[k])

    return [lambda t, order, k=k: at(t, order, k) for k in range(len(names))]
