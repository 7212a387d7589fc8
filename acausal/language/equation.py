"""Equations that a component writes: `equal(a, b)`, with time derivatives `der(a)`."""

from __future__ import annotations

import operator
from dataclasses import dataclass

import casadi as ca

from acausal.errors import ExpressionError
from acausal.language.expression import (
    Derivative,
    Expression,
    Input,
    InputRate,
    Parameter,
    Scalar,
    Symbol,
    Time,
    binary,
    formula,
    leaves,
    sx,
)
from acausal.language.origin import origin

_DERIVATIVE = "_derivative"


@dataclass(frozen=True)
class Equation:
    """`residual` = 0, a column of one or more rows, and where it was written."""

    residual: Expression
    origin: str

    def __repr__(self) -> str:
        return f"0 = {self.residual!r}"


def equal(left: Scalar, right: Scalar) -> Equation:
    """The equation left = right."""
    a, b = sx(left), sx(right)
    if a.shape != b.shape and 1 not in (a.numel(), b.numel()):
        raise ExpressionError(f"equal(...): the left side has shape {a.shape} and the right side {b.shape} ({origin()}).")
    return Equation(Expression(formula(binary(operator.sub, a, b), "equal(...)"), leaves(left, right)), origin())


def der(value: Expression | ca.SX) -> Expression:
    """Time derivative. Of a variable: a new symbol; of an expression: by the chain rule; of constants and parameters: 0."""
    if isinstance(value, Symbol):
        return _symbol_rate(value)
    if isinstance(value, ca.SX):
        value = Expression(value, leaves(value))
    if not isinstance(value, Expression):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
        hint = f" Declare it with brackets: name = ac.{value.__name__}(...)." if isinstance(value, type) else ""
        raise ExpressionError(f"der(...) takes a variable or an expression of variables, not {value!r} ({origin()}).{hint}")
    moving = [leaf for leaf in value.leaves if not isinstance(leaf, Parameter)]
    rates = [_symbol_rate(leaf) for leaf in moving]
    rate = ca.SX(*value.shape)
    for leaf, leaf_rate in zip(moving, rates, strict=True):
        rate += ca.jtimes(value.sx, leaf.sx, leaf_rate.sx)
    called = f"der({value.called})" if value.called else ""
    return Expression(rate, value.leaves.union(*(r.leaves for r in rates)), called)


def input_rate(symbol: Input) -> InputRate:
    """The one symbol for the rate of an input."""
    found = symbol.__dict__.get(_DERIVATIVE)
    if found is None:
        found = symbol.__dict__[_DERIVATIVE] = InputRate(symbol)
    return found


def input_rates(symbol: Input) -> tuple[InputRate, InputRate]:
    """The symbols for the first and second rate of an input."""
    first = input_rate(symbol)
    return first, input_rate(first)


def _symbol_rate(symbol: Symbol) -> Expression:
    if isinstance(symbol, Time):
        return Expression(ca.SX(1), frozenset())
    if isinstance(symbol, Parameter):
        return Expression(ca.SX(0), frozenset())
    if isinstance(symbol, Input):
        raise ExpressionError(f"der({symbol.name}): an input has no known rate ({origin()}). Declare a second input for it.")
    found = symbol.__dict__.get(_DERIVATIVE)
    if found is None:
        found = symbol.__dict__[_DERIVATIVE] = Derivative(symbol)
    return found
