"""Unknowns with their derivatives, merged into classes: one unknown is a derivative of another, times a number, plus a number.

b = factor * (d/dt)^shift a + offset. A union-find with path compression (Tarjan 1975) over such relations; shift, factor and
offset compose along the path. A class is a *chain* root, root', root'', ...; each *level* of it can be named by any member.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from acausal.scalar.equations import EquationSet, Unknown

Level = tuple[int, int]
"""(root of a chain, order of the derivative)"""


@dataclass(frozen=True)
class Relation:
    """value = factor * (d/dt)^order root + offset."""

    root: int
    order: int
    factor: float
    offset: float


@dataclass(frozen=True)
class Member:
    """A symbol that the user declared, or the derivative of one: the `order`-th derivative of unknown `base`."""

    unknown: Unknown
    base: int
    order: int


class Chains:
    """The classes while they are merged. Unknown number i is `bases[i]`; symbols are known by their element hash."""

    def __init__(self, system: EquationSet) -> None:
        self.members: dict[int, Member] = {}
        self.bases: list[Unknown] = []
        self.constants: dict[int, float] = {}
        """Root -> its value, where it is a number."""
        self.outer: set[int] = set()
        """Roots that belong to an outer block: never eliminated."""
        self._system = system
        self._parents: list[Relation] = []
        self._collect(system)

    def _collect(self, system: EquationSet) -> None:
        declared = {unknown.symbol.element_hash(): unknown for unknown in (*system.outer, *system.unknowns)}
        integral = {rate.element_hash(): value for rate, value in system.derivatives}
        rates = {rate.element_hash(): rate for rate, _ in system.derivatives}
        known = {symbol.element_hash() for symbol in system.known}
        for key, symbol in [(key, unknown.symbol) for key, unknown in declared.items()] + list(rates.items()):
            path: list[tuple[int, ca.SX]] = []
            while key not in self.members:
                path.append((key, symbol))
                if key not in integral or integral[key].element_hash() in known:
                    break
                symbol = integral[key]
                key = symbol.element_hash()
            for key, symbol in reversed(path):
                below = (
                    self.members[integral[key].element_hash()]
                    if key in integral and integral[key].element_hash() in self.members
                    else None
                )
                self._add(key, symbol, declared.get(key), below)
        self.outer = {self.members[unknown.symbol.element_hash()].base for unknown in system.outer}

    def _add(self, key: int, symbol: ca.SX, unknown: Unknown | None, below: Member | None) -> None:
        if below is None:
            base, order = len(self.bases), 0
            unknown = unknown or Unknown(symbol, str(symbol))
            self.bases.append(unknown)
            self._parents.append(Relation(base, 0, 1.0, 0.0))
        else:
            base, order = below.base, below.order + 1
            unknown = unknown or derivative_of(below.unknown, symbol)
        self.members[key] = Member(unknown, base, order)

    def find(self, base: int) -> Relation:
        """How an unknown follows from the root of its chain."""
        path: list[int] = []
        while self._parents[base].root != base:
            path.append(base)
            base = self._parents[base].root
        relation = Relation(base, 0, 1.0, 0.0)
        for member in reversed(path):
            relation = _composed(self._parents[member], relation)
            self._parents[member] = relation
        return relation

    def level(self, base: int, order: int) -> Relation:
        """How the `order`-th derivative of an unknown follows from the root of its chain."""
        relation = self.find(base)
        return Relation(relation.root, relation.order + order, relation.factor, relation.offset if order == 0 else 0.0)

    def merge(self, eliminated: int, into: Level, factor: float, offset: float) -> None:
        """Makes root `eliminated` = factor * into + offset; both are roots of different chains."""
        self._parents[eliminated] = Relation(into[0], into[1], factor, offset)

    def orders(self) -> dict[int, int]:
        """Highest order of a member, for the root of each chain that is not a number."""
        found: dict[int, int] = {}
        for member in self.members.values():
            relation = self.level(member.base, member.order)
            if relation.root not in self.constants:
                found[relation.root] = max(found.get(relation.root, 0), relation.order)
        return found

    def of_root(self, root: int) -> list[Unknown]:
        """The declared unknowns of a chain, lowest derivatives and those of the outer block first."""
        found: list[tuple[int, bool, int, Unknown]] = []
        for index, member in enumerate(self.members.values()):
            relation = self.find(member.base)
            if relation.root == root:
                found.append((relation.order + member.order, member.base not in self.outer, index, member.unknown))
        return [unknown for *_, unknown in sorted(found, key=lambda entry: entry[:3])]

    def above(self, level: Level) -> list[Unknown]:
        """The declared unknowns that are derivatives of a level; first those with names of their own."""
        found: list[Unknown] = []
        for member in self.members.values():
            relation = self.level(member.base, member.order)
            if relation.root == level[0] and relation.order > level[1]:
                found.append(member.unknown)
        return sorted(found, key=lambda unknown: unknown.name.startswith("der("))

    def next_symbol(self, unknown: Unknown) -> Unknown:
        """The derivative of an unknown that has none yet."""
        make = self._system.rate_symbol
        return derivative_of(unknown, None if make is None else make(unknown.symbol))

    def value(self, level: Level) -> float | None:
        """The number that a level of a chain is, if it is one."""
        constant = self.constants.get(level[0])
        return constant if constant is None or level[1] == 0 else 0.0


def _composed(outer: Relation, inner: Relation) -> Relation:
    """`outer` in terms of the root of `inner`."""
    offset = outer.offset + (outer.factor * inner.offset if outer.order == 0 else 0.0)
    return Relation(inner.root, outer.order + inner.order, outer.factor * inner.factor, offset)


def derivative_of(unknown: Unknown, symbol: ca.SX | None = None) -> Unknown:
    """The time derivative of an unknown as an unknown of its own; makes the symbol if there is none."""
    name = f"der({unknown.name})"
    unit = f"{unknown.unit}/s" if unknown.unit else ""
    return Unknown(ca.SX.sym(name) if symbol is None else symbol, name, unit, unknown.origin, None, unknown.hint, unknown.shared)
