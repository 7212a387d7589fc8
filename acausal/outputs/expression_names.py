"""Names of expressions: as CasADi prints them, with the full names of their variables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from acausal.language.component import Component
from acausal.language.connector import Point, Quantity
from acausal.language.expression import Derivative, Expression, Symbol, leaves, sx
from acausal.numerics.thresholds import EDGE
from acausal.parts.contact import AbstractTouch
from acausal.parts.force import AbstractLineForce
from acausal.wording import entry_names

if TYPE_CHECKING:
    from acausal.outputs.outputs import Outputs

_LONGEST = 80


def expression_name(outputs: Outputs, wanted: Expression | ca.SX) -> str:
    """Of the whole, e.g. `arm.elbow.q`, `azimuth(bob.point)`, `floor.push.normal_force` or `(2*arm.elbow.q)`; cut off where it is long."""
    if isinstance(wanted, Symbol):
        return outputs.name(wanted)
    if isinstance(wanted, Expression) and wanted.called:
        return wanted.called.format(f"({','.join(_made_of(outputs, wanted))})")
    return _of_part(outputs, wanted) or _cut(_spelled(outputs, wanted))


def _made_of(outputs: Outputs, wanted: Expression) -> list[str]:
    """Names of the connectors and variables that it is read of."""
    names = {leaf: outputs.name(leaf) for leaf in wanted.leaves if not isinstance(leaf, Derivative)}
    return sorted({name.rpartition(".")[0] if isinstance(leaf, Quantity) else name for leaf, name in names.items()})


_OF_TOUCH = ("gap", "normal_force", "slip", "force", "friction_force", "point_b", "point_a", "normal", "pivoting")
"""What is read of contacts, by formulas."""
_OF_LINE = ("distance", "pull")
"""The same of springs and dampers between points."""


def _readings(part: Component) -> tuple[tuple[str, ...], tuple[Point, ...]]:
    """What is read of a part by formulas, and its ends; none of others than contacts and line forces."""
    if isinstance(part, AbstractTouch):
        return _OF_TOUCH, part.ends()
    return (_OF_LINE, (part.point_a, part.point_b)) if isinstance(part, AbstractLineForce) else ((), ())


def _of_part(outputs: Outputs, wanted: Expression | ca.SX) -> str:
    """What of a contact or a line force this is, whole or an entry; empty where it is nothing of that kind. Formulas are the same where random numbers give the same."""
    if not isinstance(wanted, Expression):
        return ""
    ends = {leaf.connector for leaf in wanted.leaves if isinstance(leaf, Quantity)}
    for part in outputs.system.flat.parts:
        readings, own = _readings(part.component)
        if ends.isdisjoint(own):
            continue
        for name in readings:
            found: Expression = getattr(part.component, name)
            if wanted.leaves != found.leaves:
                continue
            if wanted.shape == found.shape and _same(wanted.sx, found.sx):
                return f"{part.path}.{name}"
            for k in range(found.sx.numel() if wanted.sx.numel() == 1 < found.sx.numel() else 0):
                if _same(wanted.sx, found.sx[k]):
                    return f"{part.path}.{name}[{k}]"
    return ""


def _same(a: ca.SX, b: ca.SX) -> bool:
    symbols = ca.symvar(ca.veccat(a, b))
    both = ca.Function("both", symbols, [ca.densify(a), ca.densify(b)])
    values = np.random.default_rng(0).uniform(0.5, 1.5, (2, len(symbols)))
    return all(np.allclose(*(np.array(side) for side in both(*row)), rtol=EDGE, atol=0.0) for row in values)


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
    if isinstance(wanted, Expression) and wanted.called:
        return entry_names(expression_name(outputs, wanted), *wanted.shape)
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
