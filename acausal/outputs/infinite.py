"""What has no value: a spring whose ends lie on one another, a body in the centre that attracts it, a source that divides by zero."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

import casadi as ca
import numpy as np

from acausal.language.expression import Expression, Symbol
from acausal.language.flatten import Part
from acausal.outputs.functions import Functions
from acausal.parts.force import AbstractForce, Action
from acausal.parts.pose import Pose
from acausal.parts.span import AbstractSpan
from acausal.wording import compact


def without_value(functions: Functions, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """A sentence on the parts whose forces, or else energies, or else what they are given is infinite or no number at a state; empty if all are numbers."""
    words = forces_without_value(functions, t, x, u, p) or _lines_without_direction(functions, t, x, u, p)
    if words:
        return words
    given = [
        (part, one, sorted(one.leaves, key=lambda leaf: leaf.name))
        for part in functions.outputs.system.flat.parts
        for one in vars(part.component).values()
        if isinstance(one, Expression) and not isinstance(one, Symbol) and one.leaves
    ]
    values = _values(functions, [one for _, own, made_of in given for one in (own, *made_of)], (t, x, u, p))
    lost = [
        part
        for (part, _, _), (own, *made_of) in zip(given, _split(values, given), strict=True)
        if not np.isfinite(own).all() and all(np.isfinite(one).all() for one in made_of)  # others take over what has none
    ]
    return f"What {_named(lost)} {'is' if len(lost) == 1 else 'are'} given is infinite or not a number there." if lost else ""


def forces_without_value(functions: Functions, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """The same of forces and their energies alone. In the centre of a field where all is held the forces may be nothing by symmetry, and the energy tells."""
    mechanics = functions.outputs.system.mechanics
    parts = mechanics.mechanism.forces
    if not parts:
        return ""
    columns = (ca.vertcat(*map(_total, mechanics.actions)), ca.vertcat(*mechanics.stored_energies()))
    for what, values in zip(("force", "energy"), np.split(_values(functions, columns, (t, x, u, p)), 2), strict=True):
        lost = [part for part, value in zip(parts, values, strict=True) if not np.isfinite(value)]
        if lost:
            why = dict.fromkeys(part.component.if_infinite for part in lost if isinstance(part.component, AbstractForce))
            return f"The {what} of {_named(lost)} is infinite or not a number there. {' '.join(why)}"
    return ""


def _lines_without_direction(functions: Functions, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """The same of ropes, cables and other spans between two points, whose ends lie on one another."""
    flat = functions.outputs.system.flat
    spans = [part for part in flat.parts if isinstance(part.component, AbstractSpan) and part.component.between_points]
    columns = [one.frame_b.position - one.frame_a.position for part in spans if isinstance(one := part.component, AbstractSpan)]
    offsets = _values(functions, columns, (t, x, u, p)).reshape(-1, 3)
    lost: list[Part] = []
    for part, offset in zip(spans, offsets, strict=True):
        assert isinstance(part.component, AbstractSpan)
        wrench = part.component.wrench_on_b(Pose(ca.SX.eye(3), ca.SX(ca.DM(offset))))
        if not ca.symvar(wrench) and not np.isfinite(np.array(ca.evalf(wrench))).all():
            lost.append(part)
    return (
        f"The ends of {_named(lost)} lie on one another, and a line has no direction there: begin with them apart."
        if lost
        else ""
    )


def _values(
    functions: Functions, columns: Sequence[Expression | ca.SX], at: tuple[float, np.ndarray, np.ndarray, np.ndarray]
) -> np.ndarray:
    """Entries of expressions, one after the other."""
    if not columns:
        return np.zeros(0)
    column = functions.space.put(ca.veccat(*map(functions.outputs.resolve, columns)))
    told = ca.Function("told", functions.space.arguments, [ca.densify(column)])  # asked once: not folded
    t, x, u, p = at
    return np.array(told(t, x, np.append(u, np.zeros(told.size1_in(2) - u.size)), p)).ravel()


def _split(values: np.ndarray, given: Sequence[tuple[Part, Expression, Sequence[Symbol]]]) -> Iterator[list[np.ndarray]]:
    """Values of each expression and of what it is made of."""
    entries = iter(values)
    for _, own, made_of in given:
        yield [np.array(list(itertools.islice(entries, one.sx.numel()))) for one in (own, *made_of)]


def _named(parts: Iterable[Part]) -> str:
    return compact((f"'{part.path}' ({part.component.created_at})" for part in parts), 4)


def _total(actions: tuple[Action, ...]) -> ca.SX:
    """Magnitudes of all that a part does: no number where one entry is none."""
    total = ca.SX(0)
    for action in actions:
        total += ca.sum1(ca.fabs(ca.vertcat(action.force, action.torque)))
    return total
