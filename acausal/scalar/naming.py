"""One symbol for each level of a chain: that of the member which a user would call the state.

Preference: a start value was given; the variable or its integral is differentiated by the user, so it is a state of some
component; it was declared rather than made by `der`; as a state it is a part's own and not a connector's; of the same sign as the chain's root; first in order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from acausal.scalar.chains import Chains, Level, Member
from acausal.scalar.equations import Unknown, symbols_in


@dataclass(frozen=True)
class Name:
    """`unknown.symbol` = factor * (this level of the chain) + offset."""

    unknown: Unknown
    factor: float
    offset: float


class Names:
    """The symbol of each level; a level without member gets a new symbol when asked for."""

    def __init__(self, chains: Chains) -> None:
        self.chains = chains
        best: dict[Level, tuple[tuple[float, ...], Name]] = {}
        differentiated = {(m.base, m.order - 1) for m in chains.members.values() if m.order > 0}
        for index, member in enumerate(chains.members.values()):
            relation = chains.level(member.base, member.order)
            level = (relation.root, relation.order)
            own = member.base not in chains.outer
            rank = (own, *_rank(member, (member.base, member.order) in differentiated, relation.factor, index))
            if level[0] not in chains.constants and (level not in best or rank < best[level][0]):
                best[level] = rank, Name(member.unknown, relation.factor, relation.offset)
        self._names = {level: name for level, (_, name) in best.items()}
        self.ranks = {level: rank for level, (rank, _) in best.items()}
        """How much the name of a level is preferred as a state: small is preferred."""
        self.levels = {name.unknown.symbol.element_hash(): level for level, name in self._names.items()}
        """Hash of a symbol in use -> the level that it names."""

    def __getitem__(self, level: Level) -> Name:
        if level not in self._names:
            below = self[level[0], level[1] - 1]
            self._names[level] = Name(self.chains.next_symbol(below.unknown), below.factor, 0.0)
            self.levels[self._names[level].unknown.symbol.element_hash()] = level
        return self._names[level]

    def value(self, base: int, order: int) -> ca.SX:
        """The `order`-th derivative of an unknown in terms of the symbol of its level."""
        relation = self.chains.level(base, order)
        number = self.chains.value((relation.root, relation.order))
        if number is not None:
            return ca.SX(relation.factor * number + relation.offset)
        name = self[relation.root, relation.order]
        factor = relation.factor / name.factor
        return scaled(name.unknown.symbol, factor, relation.offset - factor * name.offset)

    def symbol(self, level: Level) -> ca.SX:
        """The symbol of a level."""
        return self[level].unknown.symbol

    def bare(self, level: Level) -> ca.SX:
        """The level itself (the derivative of the root) in terms of its symbol."""
        name = self[level]
        return scaled(name.unknown.symbol, 1 / name.factor, -name.offset / name.factor)

    def rate(self, level: Level) -> ca.SX:
        """Time derivative of the symbol of a level in terms of the symbol of the next one."""
        name = self[level]
        above = self[level[0], level[1] + 1]
        factor = name.factor / above.factor
        return scaled(above.unknown.symbol, factor, -factor * above.offset)

    def rename(self, residuals: Mapping[int, ca.SX]) -> dict[int, ca.SX]:
        """Expressions in the user's symbols, in terms of the symbols of levels instead; zeros and ones fold."""
        symbols = symbols_in(residuals.values())
        changed: list[tuple[ca.SX, ca.SX]] = []
        for key, symbol in symbols.items():
            member = self.chains.members.get(key)
            if member is not None:
                value = self.value(member.base, member.order)
                if not value.is_symbolic() or value.element_hash() != key:
                    changed.append((symbol, value))
        if not changed:
            return dict(residuals)
        new = ca.substitute(list(residuals.values()), [s for s, _ in changed], [value for _, value in changed])
        return dict(zip(residuals, new, strict=True))


def scaled(symbol: ca.SX, factor: float, offset: float) -> ca.SX:
    """factor * symbol + offset, with ones and zeros folded."""
    value = symbol if factor == 1 else -symbol if factor == -1 else factor * symbol
    return value if offset == 0 else value + offset


def _rank(member: Member, differentiated: bool, factor: float, index: int) -> tuple[float, ...]:
    """Small is preferred."""
    made, state = member.unknown.name.startswith("der("), differentiated or member.order > 0
    return (member.unknown.start is None, not state, made, state and member.unknown.shared, factor < 0, index)
