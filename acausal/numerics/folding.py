"""CasADi functions with common subexpressions eliminated.

CasADi 3.8.2 mixes up symbols that share a name where something folds in that elimination: with x1 and x2 the same expression, and b, c, e three
symbols named p, (x1 / x2) b + e becomes c + e. Names in a scene repeat (q, v, parameter), so symbols of their own stand in for them.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca


def folded_function(
    name: str,
    arguments: Sequence[ca.SX],
    results: Sequence[ca.SX],
    names_in: Sequence[str] | None = None,
    names_out: Sequence[str] | None = None,
) -> ca.Function:
    """`ca.Function` of columns of symbols, without common subexpressions. Raises CasADi's errors for free symbols."""
    plain = ca.Function(name, list(arguments), list(results))
    own = [ca.SX.sym(f"argument{k}", argument.sparsity()) for k, argument in enumerate(arguments)]
    takes, gives = list(names_in or plain.name_in()), list(names_out or plain.name_out())
    return ca.Function(name, own, plain.call(own), takes, gives, {"cse": True})


def folded(expression: ca.SX) -> ca.SX:
    """The expression without common subexpressions."""
    symbols = ca.vertcat(ca.SX(0, 1), *ca.symvar(expression))
    own = ca.SX.sym("symbol", symbols.numel())
    return ca.substitute(ca.cse(ca.substitute(expression, symbols, own)), own, symbols)
