"""The motion of a reduced system by reactions, while these are inputs still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.language.equation import input_rate
from acausal.language.expression import Input, Mode, Reaction, declared
from acausal.numerics.switching import JUMPS, switches


@dataclass(frozen=True)
class Motion:
    """States x with rates x_dot by reactions, which are inputs still, at time t; the first nq are positions. `values`: of t, x, u and p at some places."""

    t: ca.SX
    x: ca.SX
    u: ca.SX
    p: ca.SX
    x_dot: ca.SX
    nq: int
    values: tuple[tuple[Any, ...], ...]

    def without(self, reactions: Sequence[ca.SX]) -> Motion:
        """Where these are zero."""
        return (
            replace(self, x_dot=ca.substitute(self.x_dot, ca.vertcat(*reactions), ca.SX.zeros(len(reactions))))
            if reactions
            else self
        )

    def at_places(self, value: ca.SX) -> list[np.ndarray]:
        """Where it is finite."""
        known = {s.element_hash() for s in ca.symvar(ca.vertcat(self.t, self.x, self.u, self.p))}
        rest = ca.vertcat(ca.SX(0, 1), *(s for s in ca.symvar(value) if s.element_hash() not in known))  # rates of inputs
        value = ca.substitute(value, rest, ca.SX.zeros(rest.numel())) if rest.numel() else value
        function = ca.Function("places", [self.t, self.x, self.u, self.p], [ca.densify(value)])
        found = [np.array(function(*place)) for place in self.values]
        return [one for one in found if np.isfinite(one).all()]

    def may_jump(self, value: ca.SX) -> bool:
        """While parameters stay as they are."""
        moving = ca.vertcat(self.t, self.x, self.u)
        return any(ca.depends_on(node, moving) for node in switches(value, JUMPS))

    def closed(self, gaps: ca.SX, J: ca.SX, pushes: ca.SX) -> ca.SX:
        """What states (nx, 1) change by where reactions with x' = J r push these gaps to zero by pushes[:, 0], and their rates by pushes[:, 1]."""
        places, along = positions_in(gaps, J, self.x, self.nq), ca.jacobian(self.x_dot, self.x) @ J
        moved = ca.SX.zeros(self.x.numel())
        if places:
            moved[places] = (along @ pushes[:, 0])[places]
        return moved + J @ pushes[:, 1]

    def rate(self, value: ca.SX) -> ca.SX:
        """Time derivative; of inputs by their rates."""
        own = (ca.jtimes(value, entry.sx, input_rate(entry).sx) for entry in inputs_in(value))
        return sum(own, ca.jtimes(value, self.t, ca.SX(1)) + ca.jtimes(value, self.x, self.x_dot))


def inputs_in(value: ca.SX) -> list[Input]:
    """What is given from outside, whose rates are then given too."""
    found = dict.fromkeys(declared(symbol) for symbol in ca.symvar(value))
    return [entry for entry in found if isinstance(entry, Input) and not isinstance(entry, Mode | Reaction)]


def positions_in(gaps: ca.SX, J: ca.SX, x: ca.SX, nq: int) -> list[int]:
    """Which states are positions that gaps may be closed by: coordinates, and scalar states in the gaps; their rates do not know the reactions."""
    in_gaps = set(ca.jacobian(gaps, x).sparsity().get_col()) if gaps.numel() else set[int]()
    return [i for i in range(x.numel()) if (i < nq or i in in_gaps) and J[i, :].is_zero()]
