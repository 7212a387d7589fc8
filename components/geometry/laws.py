"""What users give as functions: places by parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Parameter, Time, declared_in, time
from acausal.language.lookup import at_symbols
from acausal.language.origin import origin


def place(what: str, law: Callable[..., Any], arguments: str, *symbols: ca.SX, rows: int = 3) -> ca.SX:
    """What the law of a curve or surface gives for symbols, a column of `rows`. Raises `ParameterError` naming `what` and the user's line."""
    found = at_symbols(law, what, arguments, *symbols)
    if found.shape != (rows, 1):
        wanted = {1: "one number", 2: "two numbers: (r, z)", 3: "three numbers: (x, y, z)"}[rows]
        raise ParameterError(f"{what}: the function gives the shape {found.shape} ({origin()}). Return {wanted}.")
    return found


def moving(what: str, law: ca.SX, arguments: str, *symbols: ca.SX) -> ca.SX:
    """The law of a curve or surface, whose place changes with each of its coordinates. Raises `ParameterError` where it stays."""
    for name, symbol in zip(arguments.split(", "), symbols, strict=True):
        if not ca.depends_on(law, symbol):
            raise ParameterError(
                f"{what} gives the same place for all {name} ({origin()}): nothing moves along it. Use {name} in what it returns."
            )
    return law


def changing(places: ca.SX) -> tuple[Expression, ...]:
    """Places that functions of time and parameters change, as what a guide gives as its motion; empty where nothing does, or something else than these."""
    found = declared_in(places)
    known = all(isinstance(leaf, Time | Parameter) for leaf in found)
    return (Expression(places, found),) if time in found and known else ()


def at_time(t: ca.SX, *places: ca.SX) -> list[ca.SX]:
    """What stands for `ac.time` put in."""
    return ca.substitute(list(places), [time.sx], [t])
