"""Where parts have a meaning, and where it ends: a curve's end, a wheel that has fallen through its plane, a cusp."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.language.expression import Expression
from acausal.outputs.outputs import Outputs
from acausal.parts.bounded import AbstractBounded
from acausal.parts.joint import AbstractJoint
from acausal.wording import entry_names

_SHOWN = 3
"""Coordinates of a joint that are told in words; more say nothing to a reader."""
NO_VALUE = "What it is given by, or its slope, is infinite or not a number there, as a root of what is zero or negative. Say where it ends, or begin where it has a value."
"""Said where borders have no value."""


@dataclass(frozen=True)
class Border:
    """Of a part, `who` with its line: `values` (n, 1) by t, x, u and p are positive inside. `whys`: what is said where each is zero. `coordinates` of the part, called `names`.

    `sized`: whether values are of size 1 well inside; else they have any unit.
    """

    who: str
    whys: tuple[str, ...]
    values: ca.SX
    coordinates: ca.SX
    names: tuple[str, ...]
    sized: bool = True

    def told(self, values: np.ndarray) -> str:
        """What is said where it has these `values`: of the least, or that the function it is given by has none there."""
        return self.whys[int(np.argmin(values))] if np.isfinite(values).all() else NO_VALUE

    @property
    def rows(self) -> tuple[str, ...]:
        """What each of the values is called."""
        name, n = f"border of {self.who.partition(' (')[0].strip(chr(39))}", self.values.numel()
        return (name,) if n == 1 else tuple(f"{name}[{k}]" for k in range(n))


def borders(outputs: Outputs) -> tuple[Border, ...]:
    """Of joints of the tree, then of parts that are bounded."""
    found: list[Border] = []
    for item in outputs.system.tree_joints:
        joint = item.edge.joint
        who, q = f"'{item.edge.name}' ({joint.created_at})", joint.q.sx
        domain, regular = joint.domain(q), joint.regular(q)
        singular = (joint.if_singular,) * regular.numel()
        for values, whys, sized in ((domain, joint.why_outside(domain.numel()), True), (regular, singular, False)):
            if values.numel():
                names, shown = _shown(outputs, joint)
                found.append(Border(who, whys, outputs.resolve(values), outputs.resolve(shown), names, sized))
    for part in outputs.system.flat.parts:
        bounded = part.component
        if isinstance(bounded, AbstractBounded):
            who, values = f"'{part.path}' ({bounded.created_at})", outputs.resolve(bounded.inside())
            found.append(Border(who, (bounded.if_outside,) * values.numel(), values, ca.SX(0, 1), ()))
    return tuple(border for border in found if border.values.numel())


def _shown(outputs: Outputs, joint: AbstractJoint) -> tuple[tuple[str, ...], Expression]:
    """What is told of where a joint is, and its names: its coordinates, or where its frame_b is."""
    shown = joint.q if joint.q.size <= _SHOWN else joint.frame_b.position
    name = outputs.name(shown)
    return entry_names(name, shown.sx.numel()), shown
