"""Of several guesses the one that leads to the best motion.

The least cost near one guess can be twice that near another, and a coarse mesh lies about both: so what is found from each is looked up by simulation, and is made finer
while it lies, the cheapest first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from acausal.optimal_control.asked import FREE
from acausal.optimal_control.attempts import COARSE, Attempt, Searches, finer
from acausal.optimal_control.failing import bottomless, unmet
from acausal.optimal_control.swings import Other
from acausal.optimal_control.whole import Part

_CHEAP = 400_000
"""Iterations times rows: what all guesses beside the first may cost before no other is tried; a few seconds."""
_SAME, _OFTEN = 1e-4, 3
"""Of the cost: what comes out as near as this is the same motion; so many times, and it is taken for the only one."""
_POSSIBLE = 1e-6
"""Of the largest of the unknowns: by how much a motion is off that is one."""
_FINER = 2
"""How often what a coarse mesh says is looked up on a finer one."""


def best_beginning(
    searches: Searches,
    parts: Sequence[Part],
    others: Sequence[Sequence[Other]],
    tolerance: float,
    refinements: int,
) -> Attempt:
    """The best attempt of those from the guesses of the parts, and from `others`: from the first row of these, and from a next one
    where nothing was found so far. Inputs that are to be held are free at first: a search for them alone creeps.
    """
    finer_by = min(refinements, _FINER)
    if any(part.asked.controls != FREE and part.bent is not None and not part.asked.linear for part in parts):
        loose = [replace(part, asked=replace(part.asked, controls=FREE)) for part in parts]
        free = _begun(searches, loose, others, tolerance, finer_by)
        held = searches.shaped(free, [part.asked.controls for part in parts]) if free.success else free
        if held.success or bottomless(held.problem, held.cost):
            return held
    return _begun(searches, parts, others, tolerance, finer_by)


def _begun(
    searches: Searches,
    parts: Sequence[Part],
    others: Sequence[Sequence[Other]],
    tolerance: float,
    refinements: int,
) -> Attempt:
    """Where the mesh lies, others are tried on one of half its intervals' lengths, or half of these."""
    first = _true(searches, searches.on(parts))
    if not first.success and bottomless(first.problem, first.cost):
        return first
    first = base = searches.timely(first)
    if not others and not first.feigned:
        return searches.anew(first)
    tried, work = [first], 0
    while others and others[0] and base.off > COARSE and base.refined < refinements:
        meshes = [one.mesh.refined(np.full(one.mesh.intervals, 2)) for one in base.parts]
        twice = [replace(part, mesh=mesh) for part, mesh in zip(parts, meshes, strict=True)]
        base = searches.on(twice, base.refined + 1, briefly=True)
        tried.append(base)
    for number, row in enumerate(others):
        if number and any(one.success for one in tried):
            break
        for guess in row:
            if work >= _CHEAP or _agree(tried):
                break
            tried.append(searches.elsewhere(base, guess([one.motion for one in base.phases])))
            work += tried[-1].work
            if not tried[-1].success and _fell(tried[-1]):
                return tried[-1]
    return _best([one for one in tried if one.success], searches, tolerance, refinements) or searches.anew(first)


def _true(searches: Searches, attempt: Attempt) -> Attempt:
    """Another one in its place that is not feigned, if there is one."""
    if not attempt.feigned or all(part.asked.controls != FREE for part in attempt.parts):
        return attempt
    other = searches.through_held(attempt)
    return other if other.success and other.off < attempt.off else attempt


def _fell(attempt: Attempt) -> bool:
    """Whether its motions are possible, and there is no least cost: what was found elsewhere is none then, though slopes may vanish there, as at rest."""
    return bottomless(attempt.problem, attempt.cost) and unmet(attempt.problem, attempt.unknowns) <= _POSSIBLE


def _agree(tried: Sequence[Attempt]) -> bool:
    costs = sorted(one.cost for one in tried if one.success)
    return any(abs(b - a) <= _SAME * abs(a) for a, b in zip(costs, costs[_OFTEN - 1 :], strict=False))


def _best(found: list[Attempt], searches: Searches, tolerance: float, most: int) -> Attempt | None:
    """Of these the one of least cost of which simulation says nothing else."""
    lying = list[Attempt]()
    while found:
        least = min(found, key=lambda one: one.cost)
        if least.off <= COARSE:
            return least
        found.remove(least)
        if least.refined < most:
            again = searches.again(least, finer(least.phases, tolerance), briefly=True)
            found += [again] if again.success else []
        else:
            lying.append(least)
    return min(lying, key=lambda one: one.off, default=None)
