"""Checks of what users give: lists of expressions, start values, times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca

from acausal.errors import OptionError, ParameterError, StartValueError
from acausal.language.component import Component
from acausal.language.expression import Expression
from acausal.language.expression import number as checked_number
from acausal.reduction.initial import Start


def listed(value: Any, what: str, example: str) -> list[Any]:
    """The entries of a list. Raises `OptionError`, which names `what` and gives an `example`, for a single thing."""
    if isinstance(value, Expression | ca.SX | Component | str) or not isinstance(value, Iterable):
        raise OptionError(f"{what} must be a list, e.g. {example}; not {value!r}.")
    return list(value)


def expressions(value: Any, what: str, example: str) -> list[Expression]:
    """A list of variables, expressions or CasADi `SX`. Raises `OptionError` for anything else."""
    for entry in (entries := listed(value, what, example)):
        if not isinstance(entry, Expression | ca.SX):
            raise OptionError(f"{entry!r} in {what} is not a variable or an expression; use e.g. {example}.")
    return entries


def start_mapping(value: Any) -> Start:
    """Start values. Raises `StartValueError` for what is no dictionary."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise StartValueError(f"start is {value!r}. Give a dictionary of variables and values, start={{scene.hinge.q: 0.3}}.")
    return value


def finite(value: Any, what: str) -> float:
    """A finite float. Raises `OptionError`."""
    try:
        return checked_number(value, what)
    except ParameterError as error:
        raise OptionError(f"{what} must be a finite number, not {value!r}.") from error
