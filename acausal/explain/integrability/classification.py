"""Which velocity constraints are holonomic, alone and together, and what they hide: all of a system at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.explain.integrability.closed_forms import closed_forms
from acausal.explain.integrability.derived import DerivedSystem, derived_system
from acausal.explain.integrability.frobenius import Growth, growth, integrable_alone
from acausal.explain.integrability.integral import Integral, linear_integral, linear_integrals, straightened
from acausal.explain.integrability.pfaffian import PfaffianSystem


@dataclass(frozen=True)
class Block:
    """Velocity constraints `names` that share coordinates.

    `alone`: whether each by itself is the rate of a function of position. `manifold`: dimension of the configurations (with the time, where it
    enters). `growth`: dimensions of the admissible velocities and their brackets. `hidden`: independent functions of position that stay
    constant; `integrals`: those found in closed form. `method`: "exact" (proven with rational functions), "numerical" (exact derivatives at
    random points, ranks by singular values), or "undecided" (a rank was not clear, or brackets became too large: more may be hidden).
    """

    names: tuple[str, ...]
    alone: tuple[bool, ...]
    manifold: int
    growth: tuple[int, ...]
    hidden: int
    integrals: tuple[Integral, ...]
    method: str

    @property
    def holonomic(self) -> bool:
        """Whether all constraints together are integrable."""
        return len(self.growth) == 1

    def __str__(self) -> str:
        kind = "holonomic" if self.holonomic else "nonholonomic"
        found = "; ".join(str(i) for i in self.integrals)
        missing = self.hidden - len(self.integrals)
        unknown = (
            f"; {missing} more without a closed form"
            if missing and found
            else f"{missing} without a closed form"
            if missing
            else ""
        )
        return f"{', '.join(self.names)}: {kind}, growth {self.growth} in {self.manifold}, {self.hidden} hidden integrals ({self.method}){': ' if self.hidden else ''}{found}{unknown}"


@dataclass(frozen=True, repr=False)
class Integrability:
    """`blocks` of velocity constraints that have nothing to do with one another; `vanishing` ones ask nothing."""

    blocks: tuple[Block, ...]
    vanishing: tuple[str, ...]

    @property
    def integrals(self) -> tuple[Integral, ...]:
        """All that were found in closed form."""
        return tuple(i for block in self.blocks for i in block.integrals)

    @property
    def hidden(self) -> int:
        """Number of independent functions of position that stay constant."""
        return sum(block.hidden for block in self.blocks)

    def __str__(self) -> str:
        return "\n".join(str(block) for block in self.blocks) or "no velocity constraints"


def integrability(system: PfaffianSystem, exact: bool = True) -> Integrability:
    """Classifies all velocity constraints. `exact` off: no sympy, so no proofs, and no integrals but linear ones.

    Cost: milliseconds a block by numbers; up to about a second where sympy looks on. Equal blocks are looked at once.
    Raises `AssemblyError` where no configurations are found.
    """
    known: dict[str, tuple[Growth, tuple[bool, ...], DerivedSystem | None]] = {}
    blocks: list[Block] = []
    seen: set[int] = set()
    for rows, part in system.blocks():
        seen |= set(rows)
        key = _key(part)
        if key not in known:
            found = growth(part)
            derived = derived_system(straightened(part, found)) if exact else None
            known[key] = (found, derived.alone if derived else integrable_alone(part, found.points), derived)
        blocks.append(_block(part, *known[key], system))
    return Integrability(tuple(blocks), tuple(name for i, name in enumerate(system.names) if i not in seen))


def _key(system: PfaffianSystem) -> str:
    """The same for systems that differ in names only."""
    return ca.Function("system", [system.y], [system.holonomic, system.forms]).serialize() + repr(system.start.tolist())


def _block(
    part: PfaffianSystem, growth: Growth, alone: tuple[bool, ...], derived: DerivedSystem | None, whole: PfaffianSystem
) -> Block:
    found = linear_integrals(part, growth)
    if derived is not None and len(found) < derived.hidden:
        found += closed_forms(part, derived, growth, found)
    hidden = growth.hidden if growth.complete or derived is None else derived.hidden
    agree = derived is None or derived.hidden == growth.hidden or not growth.complete
    sure = agree and growth.clear and (growth.complete or derived is not None)
    method = "undecided" if not sure else "numerical" if derived is None else "exact"
    found = tuple(_seen_from(integral, part, whole) for integral in found)
    return Block(part.names, alone, growth.manifold, growth.growth, hidden, found, method)


def _seen_from(integral: Integral, part: PfaffianSystem, whole: PfaffianSystem) -> Integral:
    """With coefficients of all coordinates, these measured as they were."""
    if integral.coefficients is None:
        return replace(integral, expression=part.seen_plain(integral.expression))
    plain = linear_integral(part, integral.coefficients / np.array(part.sizes or 1.0), integral.names)
    assert plain.coefficients is not None
    coefficients = np.zeros(whole.y.numel())
    coefficients[[whole.coordinate_names.index(name) for name in part.coordinate_names]] = plain.coefficients
    return replace(plain, coefficients=coefficients)
