"""Searches for best motions on one mesh after another, counted together."""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acausal.optimal_control.asked import CONSTANT
from acausal.optimal_control.failing import interrupted
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.link import Link
from acausal.optimal_control.mesh import Mesh
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.search import CONVERGED, INTERRUPTED, NEARLY, Outcome, search
from acausal.optimal_control.separable import IPOPT
from acausal.optimal_control.sharper import Sharper
from acausal.optimal_control.whole import Part, Whole, whole

COARSE = 1e-3
"""How far off intervals are that tell more of the mesh than of the motion: what is found on the next one is not near."""
_FEIGNED = 5e-3
"""Of what is integrated on the whole: by how much an interval is off that is not what it seems."""
_HOPELESS = 300
"""Iterations, after which another guess is given up."""
_BRIEFLY = {"ipopt.max_iter": _HOPELESS}
_ROUGHLY = {**_BRIEFLY, "ipopt.acceptable_iter": 3}
"""How a search goes that found nothing before: so many iterates one after the other that are nearly as good are enough."""
_LOST = ("Error_In_Step_Computation", "Restoration_Failed", "Search_Direction_Becomes_Too_Small")
"""What the solver says where it lost its way among numbers."""
_LATER = (4.0, np.inf)
"""Times the guess: how long motions are at first, where in that time none was found; as long as they may be."""
_STEADILY, _ANEW = {"ipopt.mu_strategy": "monotone"}, 2
"""How a search goes on from where it lost its way, and how often."""
_ALONG = {"ipopt.mu_strategy": "monotone", "ipopt.warm_start_init_point": "yes"}
"""How a search goes on along singular arcs: slowly, since what it has not told apart yet stays smooth."""
_BESIDE, _LOWER = 1e-2, 1e-6
"""Of the unknowns, how far beside a guess that is found stationary it begins anew; of the cost, what is lower then."""
_BENT = 1e-4
"""In units of the program: what is added to the curvature of a cost, and is more than rounding."""
_MORE = 0.02
"""Of the cost: by how much it is more on another mesh, where that tells more of the search than of the mesh."""
MOST_PIECES = 4
"""Into which an interval is divided at once."""


@dataclass(frozen=True, eq=False)
class Found:
    """The best motions of all phases, their `cost` together, and how they were found."""

    phases: tuple[Optimum, ...]
    cost: float
    iterations: int
    seconds: float


@dataclass(frozen=True, eq=False)
class Attempt:
    """What a search found for a `problem` of these `parts`, on meshes that were `refined` so many times: `unknowns` (n,), the `cost`, and motions of the `phases`; `status`: what
    the solver says; `work`: iterations times rows.
    """

    parts: Sequence[Part]
    problem: Whole
    refined: int
    unknowns: np.ndarray
    cost: float
    phases: tuple[Optimum, ...]
    status: str
    success: bool
    work: int

    @functools.cached_property
    def off(self) -> float:
        """The largest defect; infinite where there is no solution."""
        return max(one.defect for one in self.phases) if self.success else float("inf")

    @functools.cached_property
    def feigned(self) -> bool:
        """Whether what is minimised or bounded is less by the points of the mesh than between them: where the search went on from there, it would go on to lie."""
        return self.success and any(_feigned(one) for one in self.phases)

    @property
    def best(self) -> Optimum | tuple[Optimum, ...]:
        """As users are given it."""
        return self.phases[0] if len(self.phases) == 1 else self.phases


class Searches:
    """Searches by one solver with these options. `work`: iterations times rows of all of them."""

    def __init__(self, links: Sequence[Link], plugin: str, options: dict[str, Any]) -> None:
        self._links, self._plugin, self._options = links, plugin, options
        self._iterations, self._seconds, self.work = 0, 0.0, 0
        self._solvers: dict[Any, Any] = {}  # of what begins elsewhere

    def found(self, attempt: Attempt) -> Found:
        """With all iterations."""
        counted = (replace(one, iterations=self._iterations, seconds=self._seconds) for one in attempt.phases)
        return Found(tuple(counted), attempt.cost, self._iterations, self._seconds)

    def on(self, parts: Sequence[Part], refined: int = 0, *, briefly: bool = False) -> Attempt:
        """From the guesses of these parts, on their meshes, which were `refined` before; `briefly`: given up soon."""
        return self._made(parts, whole(parts, self._links), refined, _BRIEFLY if briefly else {}, warm=False)

    def elsewhere(self, attempt: Attempt, guesses: Sequence[Guess]) -> Attempt:
        """The same problem, from other guesses of its parts; given up soon."""
        begin = attempt.problem.program.guess.copy()
        for first, one, guess in zip(attempt.problem.begins, attempt.problem.parts, guesses, strict=True):
            begin[first : first + one.program.size] = one.unknowns(guess)
        parts = [replace(part, guess=guess) for part, guess in zip(attempt.parts, guesses, strict=True)]
        return self._made(parts, attempt.problem, attempt.refined, _BRIEFLY, warm=False, begin=begin)

    def timely(self, attempt: Attempt) -> Attempt:
        """The same, where it found nothing: at first in a time that is held, longer than that of the guess, and from there. A search that shortens a motion before it is one ends where
        none is so short.
        """
        program, bounds = attempt.problem.program, attempt.problem.program.bounds
        durations = [begin + one.layout.tail for begin, one in zip(attempt.problem.begins, attempt.problem.parts, strict=True)]
        open_ones = [k for k in durations if bounds[0, k] < bounds[1, k]]
        if attempt.success or not open_ones:
            return attempt
        for longer in _LATER:
            held, begin = bounds.copy(), program.guess.copy()
            begin[open_ones] = held[:, open_ones] = np.minimum(longer * program.guess[open_ones], bounds[1, open_ones])
            options = {**_BRIEFLY, **self._options}
            w, *_, stats = self._search(attempt.problem, options, warm=False, begin=begin, bounds=held, solvers=self._solvers)
            if stats["success"]:
                return self._made(attempt.parts, attempt.problem, attempt.refined, _BRIEFLY, warm=True, begin=w)
        return attempt

    def anew(self, attempt: Attempt) -> Attempt:
        """The same, where it lost its way: from where that was, with multipliers that know nothing of the way."""
        for _ in range(_ANEW):
            if attempt.success or attempt.status not in _LOST:
                break
            attempt = self._made(attempt.parts, attempt.problem, attempt.refined, _STEADILY, warm=False, begin=attempt.unknowns)
        return attempt

    def again(self, attempt: Attempt, meshes: Sequence[Mesh], *, briefly: bool = False) -> Attempt:
        """On other meshes, from what was found; if that was feigned, from where it began."""
        parts = [
            replace(part, mesh=mesh, guess=part.guess if attempt.feigned else one.motion)
            for part, mesh, one in zip(attempt.parts, meshes, attempt.phases, strict=True)
        ]
        options = {**(_BRIEFLY if briefly else {}), **(_ALONG if any(one.flat for one in attempt.phases) else {})}
        return self._made(parts, whole(parts, self._links), attempt.refined + 1, options, warm=attempt.off <= COARSE)

    def shaped(self, attempt: Attempt, controls: Sequence[str]) -> Attempt:
        """The same on the same meshes, from what was found, with inputs that are these in each phase."""
        parts = [replace(part, guess=one.motion) for part, one in zip(attempt.parts, attempt.phases, strict=True)]
        return self._shaped(parts, controls, attempt.refined, {}, warm=True)

    def through_held(self, attempt: Attempt) -> Attempt:
        """The same from where it began, with inputs that are held in each interval; and from what is found by these: between points they cannot be what they are not there."""
        held = self._shaped(attempt.parts, [CONSTANT] * len(attempt.parts), attempt.refined, _BRIEFLY, warm=False)
        if not held.success:
            return held
        parts = [replace(part, guess=one.motion) for part, one in zip(attempt.parts, held.phases, strict=True)]
        return self._made(parts, whole(parts, self._links), attempt.refined, _BRIEFLY, warm=True)

    def _shaped(
        self, parts: Sequence[Part], controls: Sequence[str], refined: int, options: dict[str, Any], *, warm: bool
    ) -> Attempt:
        parts = [replace(part, asked=replace(part.asked, controls=own)) for part, own in zip(parts, controls, strict=True)]
        return self._made(parts, whole(parts, self._links), refined, options, warm=warm)

    def _search(self, problem: Whole, options: dict[str, Any], **how: Any) -> Outcome:
        """One search, whose iterations count."""
        found = search(problem.program, self._plugin, options, **how)
        self._iterations += int(found[-1]["iter_count"])
        return found

    def _made(
        self,
        parts: Sequence[Part],
        problem: Whole,
        refined: int,
        options: dict[str, Any],
        *,
        warm: bool,
        begin: np.ndarray | None = None,
    ) -> Attempt:
        before, begun, options = self._iterations, time.perf_counter(), {**options, **self._options}
        w, cost, factors, gaps, stats = self._search(
            problem, options, warm=warm, begin=begin, solvers=None if begin is None else self._solvers
        )
        if stats["success"] and not warm and _stationary(stats):  # slopes vanish at the largest cost, too: from beside it
            beside = w + _BESIDE * np.random.default_rng(0).uniform(-1, 1, w.size)
            again = self._search(problem, {**_BRIEFLY, **options}, warm=False, begin=beside)
            if again[1] < cost - _LOWER * problem.program.unit:
                w, cost, factors, gaps, stats = again
        near_guess = warm and begin is None
        if near_guess and not stats["success"] and stats["return_status"] != INTERRUPTED:  # not so near: as from afar
            w, cost, factors, gaps, stats = self._search(problem, options, warm=False)
        elif near_guess and stats["success"] and _rose(problem, cost):  # nor this: it left what it began at
            again = self._search(problem, options, warm=False)
            if (again[-1]["success"] and again[1] < cost) or again[-1]["return_status"] == INTERRUPTED:
                w, cost, factors, gaps, stats = again
        w = problem.unwound(w)
        self._seconds += time.perf_counter() - begun
        own = [problem.own_cost(w, k) for k in range(len(parts))] if len(parts) > 1 else [cost]
        sharper = Sharper(parts, problem, w, self._near)
        phases = tuple(
            Optimum(
                part.model,
                one,
                problem.unknowns(w, k),
                own[k],
                self._iterations,
                self._seconds,
                part.given,
                problem.factors(factors, k),
                problem.gap(gaps, k),
                sharper,
                k,
            )
            for k, (part, one) in enumerate(zip(parts, problem.parts, strict=True))
        )
        if stats["return_status"] == INTERRUPTED:
            raise interrupted(phases, self._iterations)
        status, work = str(stats["return_status"]), (self._iterations - before) * problem.program.rows
        self.work += work
        return Attempt(parts, problem, refined, w, cost, phases, status, bool(stats["success"]), work)

    def _near(self, problem: Whole) -> tuple[np.ndarray, float]:
        """Unknowns of the best motions near the guesses, and about how far their cost is from the least one; infinite where there are none. Nobody counts that, and quadratic programs would leave
        what is near.
        """
        w = problem.program.guess
        for warm, how in ((True, _BRIEFLY), (False, _BRIEFLY), (True, _ROUGHLY)):
            w, _, _, gaps, stats = search(problem.program, IPOPT, {**how, **self._options}, warm=warm)
            if stats["return_status"] == INTERRUPTED:
                raise KeyboardInterrupt
            if stats["return_status"] == CONVERGED:
                return w, 0.0
            if stats["success"]:
                return w, float(np.sum(gaps)) + NEARLY * problem.program.unit
        return w, float("inf")


def finer(phases: Sequence[Optimum], tolerance: float) -> list[Mesh]:
    """Meshes on which intervals are divided that are off by more than the tolerance; where these do not lie, bounds hold between points, too, if they did not."""
    found = [_finer(one, tolerance) for one in phases]
    unseen = max(float(np.max(one.excesses, initial=0.0)) for one in phases) > tolerance
    unseen = unseen and max(one.defect for one in phases) <= COARSE
    return [replace(mesh, inside=True) for mesh in found] if unseen else found


def _finer(best: Optimum, tolerance: float) -> Mesh:
    wanting = np.ceil((best.defects / (0.5 * tolerance)) ** (1 / best.mesh.tableau.order))
    pieces = np.clip(np.nan_to_num(wanting, nan=2.0, posinf=2.0), 2 if _feigned(best) else 1, MOST_PIECES).astype(int)
    return divided(best, pieces)


def divided(best: Optimum, pieces: np.ndarray, more: Sequence[int] = ()) -> Mesh:
    """Its mesh with so many pieces (intervals,) in place of each interval; nodes that were loose still are, and some `more` of them."""
    loose = sorted({*best.transcribed.mesh.loose, *more})
    return replace(best.mesh.refined(pieces), loose=tuple(np.append(0, np.cumsum(pieces))[loose].tolist()))


def _stationary(stats: dict[str, Any]) -> bool:
    """Whether the solver says of its search that it ended where it began, or where the cost is bent downwards."""
    bent = stats["iterations"]["regularization_size"] if "iterations" in stats else ()
    return not stats["iter_count"] or (len(bent) > 0 and bent[-1] > _BENT)


def _rose(problem: Whole, cost: float) -> bool:
    """Whether a cost is clearly more than where the search for it began, at what was found on another mesh."""
    before = float(problem.program.values(problem.program.guess)[0]) * problem.program.unit
    return cost - before > _MORE * max(abs(cost), abs(before))


def _feigned(best: Optimum) -> bool:
    return bool(np.max(best.lapses) > _FEIGNED)
