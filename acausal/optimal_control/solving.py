"""Programs of one phase or several, solved, replayed, and solved again on finer meshes."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from acausal.arguments import finite, whole_number
from acausal.errors import AccuracyWarning, OptimalControlError, OptionError
from acausal.optimal_control.attempts import COARSE, MOST_PIECES, Attempt, Found, Searches, divided, finer
from acausal.optimal_control.beginning import best_beginning
from acausal.optimal_control.failing import failure
from acausal.optimal_control.link import Link, torn
from acausal.optimal_control.mesh import Mesh
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.promises import broken_promises
from acausal.optimal_control.swings import Other
from acausal.optimal_control.whole import Part

_DEAR = 750_000
"""Iterations times rows, for each refinement that is allowed: ten seconds or so."""
_TELLING = 0.02
"""Of the largest gain by moving a node: what others gain that are moved, too."""


def best_of(
    parts: Sequence[Part],
    links: Sequence[Link],
    plugin: str,
    options: dict[str, Any],
    tolerance: float,
    refinements: int,
    others: Sequence[Sequence[Other]] = (),
) -> Found:
    """Solved on a mesh, and again where intervals are off by more than the tolerance. `others`: of the one part that there is then, see `best_beginning`. Raises
    `OptimalControlError`.
    """
    if not finite(tolerance, "solve: the tolerance") > 0:
        raise OptionError(f"solve: the tolerance must be positive, not {tolerance:g}.")
    whole_number(refinements, "solve: refinements", 0)
    searches, before, last = Searches(links, plugin, options), None, None
    now = best_beginning(searches, parts, others, tolerance, refinements)
    while True:
        if before is not None and (now.off > COARSE or (now.refined == refinements and now.off > tolerance)):
            return searches.found(before)  # on a mesh that says itself how good it is
        if last is not None and not now.off < np.inf:  # what was found on a coarse mesh is better than nothing
            _warn_coarse(last, tolerance, "; on a finer one nothing was found")
            return searches.found(last)
        if not now.success:
            raise OptimalControlError(failure(now.problem, now.unknowns, now.cost, now.status), now.best)
        broken = [words for k, one in enumerate(now.problem.parts) for words in broken_promises(one, now.phases[k].unknowns)]
        apart = [words for link in links for words in torn(link, now.problem.parts, [one.unknowns for one in now.phases])]
        if apart and not all(link.strictly for link in links):
            links = [replace(link, strictly=True) for link in links]
            return best_of(parts, links, plugin, options, tolerance, refinements, others)
        broken += apart
        if broken:
            raise OptimalControlError(
                f"A motion was found, but what is asked for contradicts itself: {'; '.join(broken[:4])}. Leave something of it out, or begin elsewhere with ocp.guess(run).",
                now.best,
            )
        meshes = finer(now.phases, tolerance) if now.off > tolerance else _loosened(now.phases, tolerance)
        before = now if now.off <= tolerance else before
        if now.refined == refinements or meshes is None or _dear(searches, now, meshes, refinements):
            found = now if last is None or now.off <= max(last.off, COARSE) else last
            if found.off > max(tolerance, COARSE) and refinements > 0:
                _warn_coarse(found, tolerance)
            elif _unseen(found.phases) > COARSE and refinements > 0:
                _warn_of_bounds(found)
            return searches.found(found)
        now, last = searches.again(now, meshes), now


def _warn_coarse(attempt: Attempt, tolerance: float, more: str = "") -> None:
    warnings.warn(
        f"The mesh is too coarse for this motion still: intervals are off by {attempt.off:.1e} when they are simulated, where {tolerance:.0e} was asked for{more}. "
        "Begin with more intervals, or allow more refinements; look at best.defects.",
        AccuracyWarning,
        stacklevel=4,
    )


def _warn_of_bounds(attempt: Attempt) -> None:
    worst = max(attempt.phases, key=lambda one: float(np.max(one.excesses, initial=0.0)))
    name, off = worst.left_most
    warnings.warn(
        f"Between the points of the mesh bounds are left: {name} by {off:.3g}, by {_unseen(attempt.phases):.1e} of what it is at most. "
        "Begin with more intervals, or allow more refinements; look at best.violations.",
        AccuracyWarning,
        stacklevel=4,
    )


def _unseen(phases: Sequence[Optimum]) -> float:
    """By how much bounds are left between points, at most, relative to what is bounded."""
    return max(float(np.max(one.excesses, initial=0.0)) for one in phases)


def _dear(searches: Searches, now: Attempt, meshes: Sequence[Mesh], refinements: int) -> bool:
    """Whether what was found says itself how good it is, and to find it on these meshes, too, would cost more than what is spent on so many."""
    pieces = sum(one.intervals for one in meshes) / sum(one.mesh.intervals for one in now.phases)
    return now.off <= COARSE and searches.work + pieces * now.work > refinements * _DEAR


def _loosened(phases: Sequence[Optimum], tolerance: float) -> list[Mesh] | None:
    """Meshes whose nodes are loose where the cost would gain by that, as beside a switch, and on which bounds hold between the points; None where it is as good as
    asked for.
    """
    unseen = _unseen(phases)
    gains = [one.gains * one.switching for one in phases]
    good = sum(float(np.sum(own)) for own in gains) <= tolerance * abs(sum(one.cost for one in phases))
    if good and unseen <= tolerance:
        return None
    least = np.inf if good else _TELLING * max(np.max(own) for own in gains)
    return [_looser(one, tolerance, own > least) for one, own in zip(phases, gains, strict=True)]


def _looser(best: Optimum, tolerance: float, more: np.ndarray) -> Mesh:
    """With loose nodes where they were and some more (intervals + 1,), finer where bounds are left between points that should hold there."""
    loose = np.flatnonzero(more).tolist()
    if not best.mesh.inside:
        return replace(divided(best, np.ones(best.mesh.intervals, dtype=int), loose), inside=True)
    wanting = np.ceil((best.excesses / (0.5 * tolerance)) ** (1 / (best.mesh.tableau.stages + 1)))
    pieces = np.clip(wanting, 1, MOST_PIECES).astype(int)
    return divided(best, pieces, loose)
