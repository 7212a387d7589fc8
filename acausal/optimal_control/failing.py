"""What is said where no best motion was found: which constraints could not be met, by part and time, and what has no value."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.optimal_control.asked import AS_AT_START, ROOM
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.promises import broken_promises, far_away, held, kinks, no_number, pressed
from acausal.optimal_control.whole import Whole

_BOTTOMLESS = 1e8
"""Units of the cost, in which its slope is 1 at the guess: farther down there is no least value."""
_MISSED = 1e-6
"""Of its size: by how much a row is off that is not met."""
_PRESSING = 1e-3
"""Of what a row that is not met presses: what holds for less is not in its way."""

REASONS = {
    "Infeasible_Problem_Detected": "no motion meets all that is asked for near where the search ended",
    "Maximum_Iterations_Exceeded": "the search took too many iterations",
    "Restoration_Failed": "the search could not come nearer to what is asked for",
    "Diverging_Iterates": "the cost has no least value, or bounds are missing",
    "Invalid_Number_Detected": "something has no finite value or slope where the search was",
    "Search_Direction_Becomes_Too_Small": "the search came to where no step changes anything, and what is asked for does not hold yet",
    "Error_In_Step_Computation": "the search lost its way, where steps could not be told from rounding",
}
"""What the solver says, in words."""


def failure(problem: Whole, w: np.ndarray, cost: float, status: str) -> str:
    """Which constraints are violated most, by part and time; what has no value."""
    program = problem.program
    g = np.array(program.values(w)[1]).ravel()
    off = np.maximum(program.limits[0] - g, g - program.limits[1])
    worst: dict[tuple[str, int], tuple[float, float, float]] = {}
    for r in np.argsort(-off)[:200]:
        if off[r] > _MISSED:
            name, phase, at = problem.labels[r]
            size, first, last = worst.get((name, phase), (off[r], at, at))
            worst[name, phase] = max(size, off[r]), min(first, at), max(last, at)
    if bottomless(problem, cost):
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
    elif kinked := [name for one in problem.parts for name in kinks(one.asked)]:
        words.append(
            f"Kinks, where it has no slope, has: {', '.join(dict.fromkeys(kinked[:4]))}. For the absolute value of an input u, act by a - b with two inputs of at least 0, and charge a + b; or make it smooth: np.sqrt(u**2 + small**2)."
        )
    runaway = [name for k, one in enumerate(problem.parts) for name in far_away(one, problem.unknowns(w, k))]
    if runaway:
        words.append(f"What nothing bounds, and ran away: {'; '.join(runaway[:3])}. Bound it: ocp.bound(..., lower, upper).")
    if not (runaway and status == "Diverging_Iterates"):
        broken = [name for k, one in enumerate(problem.parts) for name in broken_promises(one, problem.unknowns(w, k))]
        said = {limits.name for one in problem.parts for _, limits in one.asked.here} if broken else set[str]()
        rows = [_where(problem, w, name, k, entry) for (name, k), entry in worst.items() if name not in said]
        if worst:
            words.append("What could not be met: " + "; ".join([*broken, *rows][:4]) + ".")
        asked = [f"{name} {at}" for name, at in _in_the_way(problem, w, off) if name not in said and (name, 0) not in worst]
        if worst and asked:
            words.append(f"In its way stands what is asked for: {', '.join(asked[:4])}.")
        limits = [
            f"{name} {_when(problem, w, k, *times)}"
            for k, one in enumerate(problem.parts)
            for name, times in pressed(one, problem.unknowns(w, k)).items()
        ]
        if worst and limits:
            words.append(f"At its limits came: {', '.join(limits[:6])}.")
        still = [name for one in problem.parts for name in held(one)]
        if worst and still:
            words.append(f"Held all the time is: {', '.join(still[:4])}.")
    words.append(
        "The last iterate is in the error's `best`. Relax a bound, give more time, or begin elsewhere with ocp.guess(run)."
    )
    return " ".join(words)


def bottomless(problem: Whole, cost: float) -> bool:
    """Whether a cost is so low that there is no least one."""
    return cost < -_BOTTOMLESS * problem.program.unit


def unmet(problem: Whole, w: np.ndarray) -> float:
    """By how much rows are off, at most, relative to the largest of the unknowns."""
    program = problem.program
    g = np.array(program.values(w)[1]).ravel()
    off = np.maximum(program.limits[0] - g, g - program.limits[1])
    return float(np.max(off, initial=0.0)) / max(1.0, float(np.max(np.abs(w), initial=0.0)))


def _in_the_way(problem: Whole, w: np.ndarray, off: np.ndarray) -> list[tuple[str, str]]:
    """What is asked for at some time, and when, that which presses most first: where nothing comes nearer, slopes of what is off are in balance with those of what
    holds.
    """
    import scipy.sparse
    import scipy.sparse.linalg

    program = problem.program
    rows, J = program.derivatives["jac_g"](w, ca.DM(0, 1))
    (lower, upper), (least, most), g = program.limits, program.bounds, np.array(rows).ravel()
    slopes = scipy.sparse.csr_matrix(J.sparse())
    if not (np.isfinite(slopes.data).all() and np.isfinite(g).all()):
        return []
    missed = off > _MISSED
    holding = np.flatnonzero(~missed & ((g <= lower + ROOM) | (g >= upper - ROOM)))
    inside = np.flatnonzero((w > least + ROOM) & (w < most - ROOM))
    pushed = slopes[missed].T @ np.where(g < lower, -1.0, 1.0)[missed]
    factors = scipy.sparse.linalg.lsqr(slopes[holding][:, inside].T, -pushed[inside], atol=1e-9, btol=1e-9)[0]
    pressing = np.zeros(program.rows)
    pressing[missed], pressing[holding] = 1.0, np.abs(factors)
    said = [{own.name for _, own in one.asked.here} | {name for *_, name in one.asked.totals} for one in problem.parts]
    found: dict[tuple[str, str], None] = {}
    for r in np.argsort(-pressing, kind="stable"):
        name, phase, at = problem.labels[r]
        if pressing[r] > _PRESSING and (name in said[phase] or name.startswith(AS_AT_START)):
            found[name, _when(problem, w, phase, at, at)] = None
    return list(found)


def _where(problem: Whole, w: np.ndarray, name: str, phase: int, entry: tuple[float, float, float]) -> str:
    size, first, last = entry
    of = f" of phase {phase + 1}" if len(problem.parts) > 1 else ""
    return f"{name} (off by {size:.1e} of its size {_when(problem, w, phase, first, last)}{of})"


def _when(problem: Whole, w: np.ndarray, phase: int, first: float, last: float) -> str:
    """Parts of the duration in seconds, in words."""
    part = problem.parts[phase]
    duration, t0 = part.motion(problem.unknowns(w, phase)).duration, part.asked.stage.t0
    a, b = t0 + first * duration, t0 + last * duration
    return f"at {a:.3g} s" if first == last else f"between {a:.3g} and {b:.3g} s"


def interrupted(phases: tuple[Optimum, ...], iterations: int) -> KeyboardInterrupt:
    """With the last iterate in it."""
    interrupt = KeyboardInterrupt(
        f"Interrupted after {iterations} iterations; the last iterate is in this exception's `best`, and can be where the search goes on: ocp.guess(best)."
    )
    interrupt.best = phases[0] if len(phases) == 1 else phases  # type: ignore[attr-defined]  # the one thing that is added to it
    return interrupt
