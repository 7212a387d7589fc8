"""A run that failed, until where it still obeys what it keeps: steps that end in a singular position may hold anything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from acausal.collocation.modes import ModesMet
from acausal.collocation.problem import Accuracy, Kept, Solution, StatusKind
from acausal.numerics.rounding import Rounding
from acausal.outputs.functions import Functions
from acausal.simulate.looks import at_steps, beside_others, inputs_at_steps
from acausal.simulate.trajectory import Trajectory

_EPS = float(np.finfo(float).eps)
_LEAST, _LOOSE = 1e-8, 10.0
"""Of the terms of an invariant, what it may be off by whatever is asked for; times the tolerance, and times what it is off by at the start."""
_PLAIN = 1e-4
"""What is plain: rows that depend on one another are assembled to rounding after each step, but where the motion is on no branch of them."""
_APART = (
    "The motion is on no branch of its loops any more: branches touch at a singular position nearby, and nothing tells on which of them it goes on. Start elsewhere, "
    "turn the axis of a joint a little, or leave out what holds nothing that others do not hold."
)
_EARLY = 4
"""The terms of invariants are known from the start, and from where this part of the steps is over: velocities may begin at rest."""


def sound(functions: Functions, run: Trajectory, accuracy: Accuracy) -> Solution:
    """The solution of a run of one piece, without steps from the first one on that leaves its invariants by more than the tolerance allows.

    One that came to its end has failed where rows that depend on one another, only where they are assembled, are plainly not assembled.
    """
    solution = run.solution
    ended = solution.status.kind is StatusKind.SUCCESS
    damped = functions.outputs.system.constraints.damped and accuracy.step is None
    if solution.status.kind is StatusKind.INTERRUPTED or (ended and not damped) or solution.t.size < 2:
        return solution
    with np.errstate(all="ignore"):
        values = at_steps(functions, run, functions.watched)
        terms = _Terms(functions, run)
        kept = values[: 2 + functions.kept_invariants] if ended else values
        least = max(_LOOSE * accuracy.rtol, _LEAST)
        left = not ended or _leaves(kept, terms, max(least, _PLAIN)) < solution.t.size
        lost = _leaves(kept, terms, least) if left else solution.t.size
    if not 0 < lost < solution.t.size:
        return solution
    status = replace(solution.status, kind=StatusKind.BRANCHES_TOUCH, message=_APART) if ended else solution.status
    return _until(replace(solution, status=status), lost)


class _Terms:
    """Sizes of what energies and invariants are the sums of, at the ends of steps."""

    def __init__(self, functions: Functions, run: Trajectory) -> None:
        self._functions, self._run, self._rounding = functions, run, Rounding(functions.watched)

    def at(self, k: int) -> np.ndarray:
        """(rows,) at the end of step k, by states as large as they were until there, or as they are much beside others."""
        run = self._run
        met, drawn = beside_others(self._functions, run, np.max(np.abs(run.steps.x[:, : k + 1]), axis=1))
        u = inputs_at_steps(run, np.array([k]))[:, 0]
        return (
            self._rounding(float(run.steps.t[k]), run.steps.x[:, k], u, run.problem.parameters, spread=_EPS * met) / _EPS + drawn
        )


def _leaves(values: np.ndarray, terms: _Terms, least: float) -> int:
    """The first step end at which what is kept is not, by this part of its terms; their number if there is none. `values`: energies and invariants (rows, n)."""
    gaps, n, first = np.abs(values[2:]), values.shape[1], terms.at(0)[: values.shape[0]]
    lost = int(np.argmax(np.append(~np.isfinite(values).all(axis=0), True)))
    start = np.where(first[2:] > 0, gaps[:, 0] / first[2:], 0.0)
    allowed = least + _LOOSE * start
    usual = np.fmax(first, terms.at(n // _EARLY)[: values.shape[0]])[2:]
    for k in np.flatnonzero((gaps > (allowed * usual)[:, None]).any(axis=0)):
        if k >= lost:
            break
        here = terms.at(int(k))[2 : values.shape[0]]
        if ((gaps[:, k] > allowed * here) & (here > 0)).any():
            lost = int(k)
            break
    return lost


def _until(solution: Solution, count: int) -> Solution:
    """With so many step ends only."""
    end, left = float(solution.t[count - 1]), solution.t.size - count
    kept, modes, status = solution.kept, solution.modes, solution.status
    words = f"{status.message} {'The last step' if left == 1 else f'The last {left} steps'} left what the motion is to keep and {'is' if left == 1 else 'are'} left out."
    return replace(
        solution,
        t=solution.t[:count],
        x=solution.x[:, :count],
        status=replace(status, time=end, message=words),
        crossings=tuple(crossing for crossing in solution.crossings if crossing.time <= end),
        stopped=False,
        kept=None if kept is None else Kept(kept.steps[: count - 1], kept.known[: count - 1]),
        modes=None if modes is None else _modes_until(modes, count - 1),
    )


def _modes_until(met: ModesMet, last: int) -> ModesMet:
    """Changes of mode before the step end `last`, and those there that do not jump."""
    some = (met.steps < last) | ((met.steps == last) & ~met.jumped)
    some[0] = True
    by_change = (part[some] for part in (met.steps, met.rows, met.impulses, met.heat, met.jumped))
    return ModesMet(met.begins[some], met.masks[:, some], *by_change)
