"""Checks of what users give: lists of expressions, times, whole numbers."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import OptionError, ParameterError
from acausal.language.component import Component
from acausal.language.expression import Expression
from acausal.language.expression import number as checked_number


def listed(value: Any, what: str, example: str) -> list[Any]:
    """The entries of a list. Raises `OptionError`, which names `what` and gives an `example`, for a single thing."""
    if not isinstance(value, Expression | ca.SX | Component | str):
        with contextlib.suppress(TypeError):  # of CasADi's matrices, too
            return list(value)
    raise OptionError(f"{what} must be a list, e.g. {example}; not {value!r}.")


def expressions(value: Any, what: str, example: str) -> list[Expression]:
    """A list of variables, expressions or CasADi `SX`. Raises `OptionError` for anything else."""
    for entry in (entries := listed(value, what, example)):
        if not isinstance(entry, Expression | ca.SX):
            raise OptionError(f"{entry!r} in {what} is not a variable or an expression; use e.g. {example}.")
    return entries


def dictionary(value: Any, what: str, example: str) -> Mapping[Any, Any]:
    """Values of inputs or parameters. Raises `OptionError` for what is no dictionary."""
    if not isinstance(value, Mapping):
        raise OptionError(f"{what} is {value!r}. Give a dictionary, e.g. {what}={example}.")
    return value


def shown(value: Any, most: int = 60) -> str:
    """`value` in few characters, for messages."""
    plain = type(value).__repr__ is object.__repr__  # its address says nothing
    text = f"{type(value).__name__}(...)" if plain else " ".join(repr(value).split())
    return text if len(text) <= most else text[: most - 2] + " …"


def path_of(value: Any, what: str) -> Path:
    """A path. Raises `OptionError` for what is none."""
    if not isinstance(value, str | os.PathLike) or not str(value):
        raise OptionError(f"{what} is {shown(value)}. Give a path, e.g. 'out/{what.split()[-1]}'.")
    return Path(value)


def truth(value: Any, what: str) -> bool:
    """True or False. Raises `OptionError` for anything else, such as "no", which Python takes for true."""
    if not isinstance(value, bool | np.bool_):
        raise OptionError(f"{what} is {value!r}. Give True or False.")
    return bool(value)


def finite(value: Any, what: str) -> float:
    """A finite float. Raises `OptionError`."""
    try:
        return checked_number(value, what)
    except ParameterError as error:
        raise OptionError(f"{what} must be a finite number, not {value!r}.") from error


def function_name(value: Any, what: str) -> str:
    """A name that CasADi and C take. Raises `OptionError`."""
    if not isinstance(value, str) or not ca.Function.check_name(value):
        raise OptionError(
            f"{what} is {value!r}; give a word of letters, digits and single underscores that begins with a letter."
        )
    return value


def ascending(value: Any, what: str, least: int = 2) -> np.ndarray:
    """Times (n,) [s], so many at `least`. Raises `OptionError` for what does not rise or is not finite."""
    try:
        times = np.asarray(value, dtype=float).ravel()
    except (TypeError, ValueError, OverflowError):
        times = np.zeros(0)
    if times.size < least or not np.isfinite(times).all() or np.any(np.diff(times) <= 0):
        raise OptionError(f"{what} are {value!r}; give {'two' if least == 2 else 'one'} or more ascending times [s].")
    return times


def whole_number(value: Any, what: str, least: int, most: int | None = None) -> int:
    """An integer within bounds; no bool. Raises `OptionError`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least or (most is not None and value > most):
        bounds = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise OptionError(f"{what} is {value!r}; give a whole number {bounds}.")
    return int(value)
