"""Names of expressions: as CasADi prints them, with the full names of their variables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from acausal.language.expression import Expression, Symbol, leaves, sx
from acausal.wording import entry_names

if TYPE_CHECKING:
    from acausal.outputs.outputs import Outputs

_LONGEST = 80


def expression_name(outputs: Outputs, wanted: Expression | ca.SX) -> str:
    """Of the whole, e.g. `arm.elbow.q` or `(2*arm.elbow.q)`; cut off where it is long."""
    return outputs.name(wanted) if isinstance(wanted, Symbol) else _cut(_spelled(outputs, wanted))


def expression_unit(expression: Expression | ca.SX) -> str:
    """Of a variable, or of entries of variables with one unit; else unknown."""
    if isinstance(expression, Symbol):
        return expression.unit
    units = {leaf.unit for leaf in leaves(expression)}
    entries = ca.vec(sx(expression))
    return units.pop() if len(units) == 1 and all(entries[i].is_symbolic() for i in range(entries.numel())) else ""


def labels(outputs: Outputs, wanted: Expression | ca.SX) -> tuple[str, ...]:
    """Of every entry, column by column."""
    if isinstance(wanted, Symbol):
        return entry_names(outputs.name(wanted), *wanted.shape)
    entries = ca.vec(ca.densify(_spelled(outputs, wanted)))
    return tuple(_cut(entries[i]) for i in range(entries.numel()))


def _spelled(outputs: Outputs, wanted: Expression | ca.SX) -> ca.SX:
    if isinstance(wanted, ca.SX):
        return wanted
    result = wanted.sx
    for leaf in sorted(wanted.leaves, key=lambda leaf: leaf.name):
        names = entry_names(outputs.name(leaf), *leaf.shape)
        result = ca.substitute(result, leaf.sx, ca.reshape(ca.vertcat(*(ca.SX.sym(name) for name in names)), *leaf.shape))
    return result


def _cut(expression: ca.SX) -> str:
    text = str(expression)
    return text if len(text) < _LONGEST else text[: _LONGEST - 4] + " ..."
