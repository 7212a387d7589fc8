"""Programs of one phase or several, solved, replayed, and solved again on finer meshes."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acausal.arguments import finite, whole_number
from acausal.errors import AccuracyWarning, OptimalControlError, OptionError
from acausal.optimal_control.guess import Guess
from acausal.optimal_control.link import Link, linked
from acausal.optimal_control.mesh import Mesh
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.promises import broken_promises, no_number
from acausal.optimal_control.separable import Program
from acausal.optimal_control.transcription import Asked, Transcribed, transcribe

_SOLVER_TOLERANCE = 1e-9
"""Of the program in units of its own."""
_INTERRUPTED = "NonIpopt_Exception_Thrown"
"""What ipopt says of Ctrl-C: none of our functions raises anything else."""
_NEAR = 300
"""Iterations for what is near: who needs more was not."""
_COARSE = 1e-3
"""How far off intervals are that tell more of the mesh than of the motion."""
_BOTTOMLESS = 1e8
"""Units of the cost, in which its slope is 1 at the guess: farther down there is no least value."""
_TELLING = 0.02
"""Of the largest gain by moving a node: what others gain that are moved, too."""
_MOST_PIECES = 4
"""Into which an interval is divided at once."""


REASONS = {
    "Infeasible_Problem_Detected": "no motion meets all that is asked for near where the search ended",
    "Maximum_Iterations_Exceeded": "the search took too many iterations",
    "Restoration_Failed": "the search could not come nearer to what is asked for",
    "Diverging_Iterates": "the cost has no least value, or bounds are missing",
    "Invalid_Number_Detected": "something has no finite value or slope where the search was",
    "Error_In_Step_Computation": "something has no slope where the search was",
}
"""What the solver says, in words."""


@dataclass(frozen=True, eq=False)
class Part:
    """A phase as it is `asked` of a `model`, on a mesh, with a guess. `units` (width,): what is much for each unknown of a point; `given`: arguments of
    `simulate`.
    """

    model: Any
    asked: Asked
    mesh: Mesh
    guess: Guess
    units: np.ndarray
    given: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Whole:
    """The `program` of all phases `parts`, whose unknowns begin at `begins` and constraints at `rows`; those of links come last. `labels`: of each row what it is, in which
    phase and when: a part of its duration.
    """

    parts: tuple[Transcribed, ...]
    program: Program
    begins: tuple[int, ...]
    rows: tuple[int, ...]
    labels: list[tuple[str, int, float]]

    def factors(self, multipliers: np.ndarray, k: int) -> np.ndarray:
        """Of the constraints of a phase."""
        own = multipliers * self.program.sizes * self.program.unit
        return own[self.rows[k] : self.rows[k + 1]]

    def unknowns(self, w: np.ndarray, k: int) -> np.ndarray:
        """Of a phase."""
        return w[self.begins[k] : self.begins[k] + self.parts[k].program.size]

    def gap(self, gaps: np.ndarray, k: int) -> float:
        """Of a phase, of those of the unknowns and then of the constraints."""
        rows = gaps[self.program.size :]
        return float(np.sum(self.unknowns(gaps, k)) + np.sum(rows[self.rows[k] : self.rows[k + 1]]))

    def own_cost(self, w: np.ndarray, k: int) -> float:
        """What a phase adds to the cost."""
        return float(self.parts[k].program.values(self.unknowns(w, k))[0])


@dataclass(frozen=True, eq=False)
class Found:
    """The best motions of all phases, their `cost` together, and how they were found."""

    phases: tuple[Optimum, ...]
    cost: float
    iterations: int
    seconds: float


def whole(parts: Sequence[Part], links: Sequence[Link]) -> Whole:
    """The program of phases and links, rows and cost in balance."""
    made = tuple(transcribe(part.asked, part.mesh, part.guess, part.units) for part in parts)
    begins = tuple(np.cumsum([0, *(one.program.size for one in made)]).tolist())
    rows = np.cumsum([0, *(one.program.rows for one in made)]).tolist()
    program = Program.joined([one.program for one in made])
    labels = [(name, k, at) for k, one in enumerate(made) for name, at in one.labels]
    for link in links:
        program, added = linked(program, link, made, begins)
        labels += [(name, link.after, 0.0) for name in added]
    assert len(labels) == program.rows >= rows[-1]
    return Whole(made, program.balanced(), begins[:-1], tuple(rows), labels)


def best_of(
    parts: Sequence[Part], links: Sequence[Link], plugin: str, options: dict[str, Any], tolerance: float, refinements: int
) -> Found:
    """Solved on a mesh, and again where intervals are off by more than the tolerance. Raises `OptimalControlError`."""
    if not finite(tolerance, "solve: the tolerance") > 0:
        raise OptionError(f"solve: the tolerance must be positive, not {tolerance:g}.")
    whole_number(refinements, "solve: refinements", 0)
    iterations, seconds, before = 0, 0.0, None
    for attempt in range(refinements + 1):
        problem = whole(parts, links)
        begun = time.perf_counter()
        w, cost, factors, gaps, stats = search(problem.program, plugin, options, warm=attempt > 0)
        iterations += int(stats["iter_count"])
        if attempt > 0 and not stats["success"] and stats["return_status"] != _INTERRUPTED:  # not so near: as from afar
            w, cost, factors, gaps, stats = search(problem.program, plugin, options, warm=False)
            iterations += int(stats["iter_count"])
        seconds += time.perf_counter() - begun
        own = [problem.own_cost(w, k) for k in range(len(parts))] if len(parts) > 1 else [cost]
        phases = tuple(
            Optimum(
                part.model,
                one,
                problem.unknowns(w, k),
                own[k],
                iterations,
                seconds,
                part.given,
                problem.factors(factors, k),
                problem.gap(gaps, k),
            )
            for k, (part, one) in enumerate(zip(parts, problem.parts, strict=True))
        )
        if stats["return_status"] == _INTERRUPTED:
            raise _interrupt(phases, iterations)
        found = Found(phases, cost, iterations, seconds)
        off = max(one.defect for one in phases) if stats["success"] else np.inf
        if before is not None and (off > _COARSE or (attempt == refinements and off > tolerance)):
            return replace(before, iterations=iterations, seconds=seconds)  # on a mesh that says itself how good it is
        if not stats["success"]:
            raise OptimalControlError(
                _failure(problem, w, cost, str(stats["return_status"])), phases[0] if len(phases) == 1 else phases
            )
        broken = [words for k, one in enumerate(problem.parts) for words in broken_promises(one, problem.unknowns(w, k))]
        if broken:
            raise OptimalControlError(
                f"A motion was found, but what is asked for contradicts itself: {'; '.join(broken[:4])}. Leave something of it out, or begin elsewhere with ocp.guess(run).",
                phases[0] if len(phases) == 1 else phases,
            )
        meshes = [_finer(one, tolerance) for one in phases] if off > tolerance else _loosened(phases, tolerance)
        before = found if off <= tolerance else before
        if attempt == refinements or meshes is None:
            if off > max(tolerance, _COARSE) and refinements > 0:
                warnings.warn(
                    f"The mesh is too coarse for this motion still: intervals are off by {off:.1e} when they are simulated, where {tolerance:.0e} was asked for. "
                    "Begin with more intervals, or allow more refinements; look at best.defects.",
                    AccuracyWarning,
                    stacklevel=3,
                )
            return found
        parts = [replace(part, mesh=mesh, guess=one.motion) for part, mesh, one in zip(parts, meshes, phases, strict=True)]
    raise AssertionError


def _interrupt(phases: tuple[Optimum, ...], iterations: int) -> KeyboardInterrupt:
    interrupt = KeyboardInterrupt(
        f"Interrupted after {iterations} iterations; the last iterate is in this exception's `best`, and can be where the search goes on: ocp.guess(best)."
    )
    interrupt.best = phases[0] if len(phases) == 1 else phases  # type: ignore[attr-defined]  # the one thing that is added to it
    return interrupt


def _finer(best: Optimum, tolerance: float) -> Mesh:
    wanting = np.ceil((best.defects / (0.5 * tolerance)) ** (1 / best.mesh.tableau.order))
    pieces = np.clip(np.nan_to_num(wanting, nan=2.0, posinf=2.0), 1, _MOST_PIECES).astype(int)
    return best.mesh.refined(pieces)


def _loosened(phases: Sequence[Optimum], tolerance: float) -> list[Mesh] | None:
    """Meshes whose nodes are loose where the cost would gain by that, as beside a switch, and on which bounds hold between the points; None where it is as good as
    asked for.
    """
    unseen = max(one.violation for one in phases)
    gains = [one.gains * one.switching for one in phases]
    good = sum(float(np.sum(own)) for own in gains) <= tolerance * abs(sum(one.cost for one in phases))
    if good and unseen <= tolerance:
        return None
    least = np.inf if good else _TELLING * max(np.max(own) for own in gains)
    return [_looser(one, tolerance, own > least) for one, own in zip(phases, gains, strict=True)]


def _looser(best: Optimum, tolerance: float, more: np.ndarray) -> Mesh:
    """With loose nodes where they were and some more (intervals + 1,), finer where bounds are left between points that should hold there."""
    before = best.transcribed.mesh.loose
    loose = sorted({*before, *np.flatnonzero(more).tolist()})
    if not best.mesh.inside:
        return replace(best.mesh, loose=tuple(loose), inside=True)
    wanting = np.ceil((best.excesses / (0.5 * tolerance)) ** (1 / (best.mesh.tableau.stages + 1)))
    pieces = np.clip(wanting, 1, _MOST_PIECES).astype(int)
    return replace(best.mesh.refined(pieces), loose=tuple(np.append(0, np.cumsum(pieces))[loose].tolist()))


def search(
    program: Program, plugin: str, options: dict[str, Any], *, warm: bool
) -> tuple[np.ndarray, float, np.ndarray, np.ndarray, dict[str, Any]]:
    """Unknowns, cost, multipliers of the constraints, what the cost would be less by if each unknown and then each constraint came to the bound that it is
    pressed against, and what the solver says of its search.
    """
    try:
        solver = program.solver(plugin, {**ipopt_options(warm=warm), **options, "error_on_fail": False})
    except RuntimeError as refused:
        raise OptionError(f"solve: {plugin} does not take these options: {options}. {str(refused).splitlines()[-1]}") from None
    (least, most), (lower, upper) = program.bounds, program.limits
    found = solver(x0=np.clip(program.guess, least, most), lbx=least, ubx=most, lbg=lower, ubg=upper)
    w, g, of_bounds, of_rows = (np.array(found[name]).ravel() for name in ("x", "g", "lam_x", "lam_g"))
    pressed = np.append(of_bounds, of_rows)
    bound = np.where(pressed > 0, np.append(most, upper), np.append(least, lower))
    gaps = np.abs(np.where(np.isfinite(bound), pressed, 0.0) * np.where(np.isfinite(bound), bound - np.append(w, g), 0.0))
    return w, float(found["f"]) * program.unit, of_rows, gaps * program.unit, solver.stats()


def ipopt_options(*, warm: bool, known: bool = False) -> dict[str, Any]:
    """Quiet, in the units of the program; `warm`: where a solution is near; `known`: its multipliers, too."""
    options = {
        "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": _SOLVER_TOLERANCE, "ipopt.nlp_scaling_method": "none",
        "ipopt.max_iter": 1000, "ipopt.bound_relax_factor": 0.0, "ipopt.mu_strategy": "adaptive",
        "ipopt.mumps_pivot_order": 0,  # minimum degree: bands as narrow as these need no graph to be cut
    }  # fmt: skip
    if warm:
        options |= {
            "ipopt.max_iter": _NEAR,
            "ipopt.mu_init": 1e-4,
            "ipopt.mu_strategy": "monotone",
            "ipopt.warm_start_init_point": "yes",
        }
    if known:
        pushes = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
        options |= {"ipopt.mu_init": 1e-8, **{f"ipopt.warm_start_{one}": 1e-9 for one in pushes}}
        options |= {"ipopt.fast_step_computation": "yes", "ipopt.min_refinement_steps": 0}
    return options


def _failure(problem: Whole, w: np.ndarray, cost: float, status: str) -> str:
    """Which constraints are violated most, by part and time; what has no value."""
    program = problem.program
    g = np.array(program.values(w)[1]).ravel()
    off = np.maximum(program.limits[0] - g, g - program.limits[1])
    worst: dict[tuple[str, int], tuple[float, float, float]] = {}
    for r in np.argsort(-off)[:200]:
        if off[r] > 1e-6:
            name, phase, at = problem.labels[r]
            size, first, last = worst.get((name, phase), (off[r], at, at))
            worst[name, phase] = max(size, off[r]), min(first, at), max(last, at)
    if cost < -_BOTTOMLESS * problem.program.unit:
        status = "Diverging_Iterates"
    words = [f"No optimum was found: {REASONS.get(status, status)}; the cost came to {cost:.4g}."]
    blank = [
        name
        for k, one in enumerate(problem.parts)
        for v in (w, problem.program.guess)
        for name in no_number(one, problem.unknowns(v, k))
    ]
    if blank:
        words.append(
            f"No finite value or slope have: {', '.join(dict.fromkeys(blank[:4]))}. A root, a norm or a quotient may be of zero there."
        )
    if worst:
        listed = [_where(problem, w, name, phase, entry) for (name, phase), entry in list(worst.items())[:4]]
        words.append("What could not be met: " + "; ".join(listed) + ".")
    words.append(
        "The last iterate is in the error's `best`. Relax a bound, give more time, or begin elsewhere with ocp.guess(run)."
    )
    return " ".join(words)


def _where(problem: Whole, w: np.ndarray, name: str, phase: int, entry: tuple[float, float, float]) -> str:
    size, first, last = entry
    part = problem.parts[phase]
    duration, t0 = part.motion(problem.unknowns(w, phase)).duration, part.asked.stage.t0
    a, b = t0 + first * duration, t0 + last * duration
    when = f"at {a:.3g} s" if first == last else f"between {a:.3g} and {b:.3g} s"
    of = f" of phase {phase + 1}" if len(problem.parts) > 1 else ""
    return f"{name} (off by {size:.1e} of its size {when}{of})"
