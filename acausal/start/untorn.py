"""Nonlinear blocks of scalar parts as they were written, solved before the search for states.

A block is kept with few of its unknowns as states, from which the others follow one by one. That nests what is curved in it: far from the solution
exponentials of exponentials overflow, where each equation for itself is harmless.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.numerics.sizes import Drawn
from acausal.reduce.reduce import ReducedSystem
from acausal.start.block import Block
from acausal.start.block_search import solve_block
from acausal.start.unknowns import Found, Unknowns

_SAME = 1e-6
_SHORTEST = 1e-9
"""Part of the way that is too short to go on."""
_CLOSELY, _CORRECTIONS = 1e-6, 20
"""Corrections on the way, until the last one is so small a part of each unknown."""


@dataclass(frozen=True)
class UntornBlock:
    """Its `block` of all unknowns, where a search for them begins, and pairs of a place among them and in the y of velocities."""

    block: Block
    begin: np.ndarray
    torn: tuple[tuple[int, int], ...]

    def informed(self, first: np.ndarray, data: np.ndarray, given: set[int]) -> None:
        """Puts what the other unknowns `first` (n,) lead to at the places of those that are states, but for those that are `given`."""
        found = self._solved(first, data)
        if found.converged:
            for k, place in self.torn:
                if place not in given:
                    first[place] = found.y[k]

    def at(self, y: np.ndarray, data: np.ndarray) -> np.ndarray | None:
        """All unknowns at velocities y (n,) that were found; None where those that are states are others."""
        found = self._solved(y, data)
        same = all(abs(found.y[k] - y[place]) <= _SAME * abs(y[place]) for k, place in self.torn)
        return found.y if found.converged and same else None

    @np.errstate(all="ignore")
    def _solved(self, y: np.ndarray, data: np.ndarray) -> Found:
        begin = self.begin.copy()
        for k, place in self.torn:
            begin[k] = y[place]
        whole = np.concatenate([y, data])
        found = solve_block(self.block, whole, begin, begin, np.zeros(0), 0.0)
        if found.converged or (led := self._led(whole)) is None:
            return found
        return solve_block(self.block, whole, led, led, np.zeros(0), 0.0)

    def _led(self, whole: np.ndarray) -> np.ndarray | None:
        """Near the solution, by what is open at the beginning taken away in parts, doubled after each that is found: so exponentials are climbed (Ortega and Rheinboldt, Iterative
        Solution of Nonlinear Equations, 7.5); None where none is found.
        """
        rows = self.block.constraints.at(np.concatenate([whole, self.begin]))
        z, (open_, _) = self.begin, rows(self.begin)
        done, ahead = 0.0, 0.25
        while done < 1 and ahead > _SHORTEST:
            there = min(1.0, done + ahead)
            near = _corrected(rows, z, (1 - there) * open_)
            if near is not None:
                z, done, ahead = near, there, 8 * ahead
            ahead /= 4
        return z if done == 1 else None


def _corrected(
    rows: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], z: np.ndarray, still_open: np.ndarray
) -> np.ndarray | None:
    """Where rows are what is still open, by Newton's method from z; None where it does not get there soon."""
    for _ in range(_CORRECTIONS):
        left, J = rows(z)
        try:
            change: np.ndarray = np.linalg.solve(J, left - still_open)
        except np.linalg.LinAlgError:
            return None
        z = z - change
        if not np.isfinite(z).all():
            return None
        if (np.abs(change) <= _CLOSELY * np.abs(z)).all():
            return z
    return None


def untorn_blocks(unknowns: Unknowns, system: ReducedSystem) -> tuple[UntornBlock, ...]:
    """Of those whose states are all among the velocities, in the order in which one follows from the other."""
    found: list[UntornBlock] = []
    none, nothing = ca.SX(0, 1), np.zeros(0, dtype=int)
    for untorn in system.scalar.untorn:
        places = [(k, system.scalar_places[state] - system.nq) for k, state in untorn.torn]
        if any(place < 0 for _, place in places):
            continue
        own = ca.SX.sym("own", untorn.unknowns.numel())
        rows = ca.substitute(untorn.rows, untorn.unknowns, own)
        m = own.numel()
        begun = ca.SX.sym("begun", m)
        searched = Unknowns(own, ca.vertcat(unknowns.y, unknowns.data), np.zeros(m, dtype=bool), True)
        all = list(range(m))
        block = Block(
            searched, all, all, [], ca.vertcat(unknowns.y, unknowns.data, begun), rows, none, none, nothing, Drawn.exact(m)
        )
        found.append(UntornBlock(block, np.array(untorn.start), tuple(places)))
    return tuple(found)
