"""Forces without a value: a spring whose ends lie on one another, a body in the centre that attracts it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.outputs.functions import Functions
from acausal.parts.force import AbstractForce, Action
from acausal.wording import compact


def without_value(functions: Functions, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
    """A sentence on the parts whose forces are infinite or no numbers at a state; empty if all are numbers."""
    mechanics = functions.outputs.system.mechanics
    if not mechanics.forces:
        return ""
    each = [_total(own) for own in mechanics.actions]
    told = functions.output(ca.vertcat(*map(functions.outputs.resolve, each)), name="forces")
    values = np.array(told(t, x, np.append(u, np.zeros(told.size1_in(2) - u.size)), p)).ravel()
    lost = [part for part, value in zip(mechanics.mechanism.forces, values, strict=True) if not np.isfinite(value)]
    if not lost:
        return ""
    named = compact((f"'{part.path}' ({part.component.created_at})" for part in lost), 4)
    why = dict.fromkeys(part.component.if_infinite for part in lost if isinstance(part.component, AbstractForce))
    return f"The force of {named} is infinite or not a number there. {' '.join(why)}"


def _total(actions: tuple[Action, ...]) -> ca.SX:
    """Magnitudes of all that a part does: no number where one entry is none."""
    total = ca.SX(0)
    for action in actions:
        total += ca.sum1(ca.fabs(ca.vertcat(action.force, action.torque)))
    return total
