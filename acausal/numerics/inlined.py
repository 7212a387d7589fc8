"""Formulas on blocks of `SX` as CasADi functions that are built once and inlined wherever they are used.

Calling an `SX` function with `SX` arguments runs its instruction list on symbols: constants fold, zeros vanish, and it
is several times quicker than the same formula on blocks.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import casadi as ca

Formula = Callable[..., tuple[ca.SX, ...]]


def inlined(*shapes: tuple[int, int]) -> Callable[[Callable[..., Sequence[ca.SX]]], Formula]:
    """Decorate a function of `SX` blocks of these shapes, so that it is traced once and then inlined."""

    def decorate(formula: Callable[..., Sequence[ca.SX]]) -> Formula:
        @functools.cache
        def traced() -> ca.Function:
            arguments = [ca.SX.sym(f"a{i}", *shape) for i, shape in enumerate(shapes)]
            return ca.Function(formula.__name__.strip("_"), arguments, [ca.densify(result) for result in formula(*arguments)])

        @functools.wraps(formula)
        def call(*arguments: ca.SX) -> tuple[ca.SX, ...]:
            return tuple(traced().call(list(arguments)))

        return call

    return decorate
