"""How often each equation must be differentiated: Pantelides' algorithm.

C. C. Pantelides, The consistent initialization of differential-algebraic systems, SIAM J. Sci. Stat. Comput. 9 (1988). Counts of
derivatives are kept instead of new equations, as in Pryce's offsets c and d (BIT 41, 2001): equation i differentiated c[i] times
determines unknown j differentiated d[j] times where order(i, j) + c[i] = d[j].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from acausal.scalar.matching import augment


@dataclass(frozen=True)
class Offsets:
    """`equations`[i]: how often equation i is differentiated. `unknowns`[j]: the highest derivative of unknown j that is needed."""

    equations: tuple[int, ...]
    unknowns: tuple[int, ...]


def differentiation_counts(orders: Sequence[Mapping[int, int]], highest: Sequence[int]) -> Offsets:
    """Offsets of a structurally regular system.

    `orders`[i]: unknown -> highest derivative of it in equation i. `highest`[j]: derivative of unknown j that must at least be
    found. Ends only where equations and unknowns can be matched; see `match`.
    """
    c = [0] * len(orders)
    d = list(highest)
    for row in orders:
        for j, order in row.items():
            d[j] = max(d[j], order)
    owner = [-1] * len(d)
    incidence = _Highest(orders, c, d)
    for i in range(len(orders)):
        while True:
            reached = augment(i, incidence, owner)
            if reached is None:
                break
            equations, unknowns = reached
            for k in equations:
                c[k] += 1
            for j in unknowns:
                d[j] += 1
    return Offsets(tuple(c), tuple(d))


class _Highest(Sequence[list[int]]):
    """For each equation the unknowns whose highest derivative is in it, at present."""

    def __init__(self, orders: Sequence[Mapping[int, int]], c: list[int], d: list[int]) -> None:
        self.orders, self.c, self.d = orders, c, d

    def __len__(self) -> int:
        return len(self.orders)

    def __getitem__(self, i: int) -> list[int]:  # pyright: ignore[reportIncompatibleMethodOverride]  # no slices
        return [j for j, order in self.orders[i].items() if order + self.c[i] == self.d[j]]
