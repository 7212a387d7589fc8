"""Tearing: a few unknowns of a nonlinear block, from which the others follow one by one.

Greedy, as in F. E. Cellier & E. Kofman, Continuous System Simulation (2006), 7.4: equations with one unknown left that they hold
with a constant number are used to solve for it; when there is none, the unknown in most equations is torn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Torn:
    """Unknowns that are torn, (equation, unknown) in the order in which they are solved, and the equations that are left over."""

    torn: tuple[int, ...]
    steps: tuple[tuple[int, int], ...]
    residuals: tuple[int, ...]


def tear(incidence: Sequence[set[int]], solvable: Sequence[set[int]]) -> Torn:
    """`incidence`: unknowns of each equation; `solvable`: those that it can be solved for."""
    left = [set(row) for row in incidence]
    users: dict[int, set[int]] = {}
    for e, row in enumerate(incidence):
        for u in row:
            users.setdefault(u, set()).add(e)
    open_equations = set(range(len(incidence)))
    torn: list[int] = []
    steps: list[tuple[int, int]] = []
    unknowns = set(users)

    def known(unknown: int) -> list[int]:
        unknowns.discard(unknown)
        for e in users[unknown]:
            left[e].discard(unknown)
        return [e for e in users[unknown] if e in open_equations and len(left[e]) == 1]

    ready = [e for e in sorted(open_equations) if len(left[e]) == 1]
    while unknowns:
        while ready:
            e = ready.pop(0)
            if e not in open_equations or len(left[e]) != 1 or not left[e] <= solvable[e]:
                continue
            (unknown,) = left[e]
            open_equations.discard(e)
            steps.append((e, unknown))
            ready += known(unknown)
        if not unknowns:
            break
        # first those that no equation can be solved for, then those in most equations
        choice = max(
            sorted(unknowns),
            key=lambda u: (
                sum(u in left[e] and u not in solvable[e] for e in users[u] & open_equations),
                len(users[u] & open_equations),
            ),
        )
        torn.append(choice)
        ready = sorted(known(choice))
    return Torn(tuple(torn), tuple(steps), tuple(sorted(open_equations)))
