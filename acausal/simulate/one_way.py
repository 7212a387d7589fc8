"""What goes one way only, looked at when a run has ended: inside of steps it must hold what it holds, and pass nothing back; and what holds the same as others does must be closed.

Instants at which valves change are decided by what is driven next; where nothing but rounding tells that, they may be taken for what they are not.
"""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from acausal.dynamics.mode_rows import ModeRow
from acausal.errors import AccuracyWarning
from acausal.numerics.rounding import Rounding
from acausal.outputs.functions import Functions
from acausal.simulate.looks import spread
from acausal.simulate.trajectory import Trajectory
from acausal.wording import callers_level

_LOOKS = 1024
"""Steps at most inside of which is looked."""
_HELD, _BACK = 1e-6, 1e-3
"""Of the power that the scene moves, what nothing loses; of the largest ones of the run, what may pass where an end has been overlooked."""
_NOISE = 1e3
"""Times what rounding makes of it, what is none."""
_APART = 1e8
"""Roundings of a gap that is not closed: what a creep by roundings of forces does not come to."""


def warn_if_passed_back(functions: Functions, run: Trajectory) -> bool:
    """Say so when what goes one way only holds something that is not held, or passes the other way; whether it does."""
    modes = functions.outputs.system.modes
    rows = [] if modes is None else [(k, row) for k, row in enumerate(modes.rows) if row.one_way]
    if not rows or (seen := _looked_at(run, [k for k, _ in rows])) is None:
        return False
    inside, closed = seen
    opens, turned = np.array([_is_fired(row, inside) for _, row in rows]), np.array([[row.turned] for _, row in rows])
    free = (opens | turned) & ~closed
    moved, passed = np.split(inside[ca.vertcat(*(row.moved for _, row in rows), *(row.reaction.sx for _, row in rows))].T, 2)
    least, most, through = _HELD * _power(inside), np.max(np.abs(moved)), np.max(np.abs(passed))
    left = (closed & (np.abs(moved * passed) > least)) | (free & (-moved > _BACK * most) & (-moved * through > least))
    back = closed & (opens | ~turned) & (-passed > _BACK * through) & (-passed * most > least)
    for found, value, of in ((left, moved, "moved"), (back, passed, "reaction")):
        for place in np.argwhere(found):
            row, t = rows[place[0]][1], float(inside.t[place[1]])
            known = row.moved if of == "moved" else row.reaction.sx
            if np.abs(value[*place]) > _NOISE * _rounding(functions, run, known, t):
                _warn(row, t, float(moved[*place]), float(passed[*place]), bool(closed[*place]))
                return True
    return False


def warn_if_led_away(functions: Functions, run: Trajectory) -> bool:
    """Say so when what is closed, beside others that hold the same, is not where time leads it: forces that share what cannot be do not tell that one of them gives way; whether it does."""
    modes = functions.outputs.system.modes
    if modes is None or not functions.led_gaps or (seen := _looked_at(run, functions.led_gaps)) is None:
        return False
    inside, closed = seen
    rows = [modes.rows[k] for k in functions.led_gaps]
    for row, gaps in zip(rows, np.where(closed, inside[ca.vertcat(*(row.moved for row in rows))].T, 0.0), strict=True):
        worst = int(np.argmax(np.abs(gaps)))
        t = float(inside.t[worst])
        if gaps[worst] and abs(gaps[worst]) > _APART * _rounding(functions, run, row.moved, t):
            warnings.warn(
                f"At t = {t:.6g} s {row.part.where} is taken for closed, and its gap is {gaps[worst]:.3g}: what it holds is held by others, too, and all of them cannot be closed. "
                f"Which of them opens is not seen where it begins as slowly as that: let one of them have a little slack or play before. The motion around is not reliable.",
                AccuracyWarning, stacklevel=callers_level(),
            )  # fmt: skip
            return True
    return False


def _looked_at(run: Trajectory, rows: list[int]) -> tuple[Trajectory, np.ndarray] | None:
    """The motion inside of its steps, and which of some rows are closed there (rows, n); None where there is no step, or no mode."""
    met, steps = run.solution.modes, np.flatnonzero(np.diff(run.steps.t) > 0)
    if met is None or not steps.size:
        return None
    steps = steps[spread(steps.size, _LOOKS)]
    return run.at((run.steps.t[steps] + run.steps.t[steps + 1]) / 2), met.at_ends(run.steps.t.size)[rows][:, steps] == 1


def _power(inside: Trajectory) -> float:
    """[W] that passes through parts, or is stored."""
    flows = np.abs(inside[inside.outputs.power_flows]).reshape(inside.t.size, -1).sum(axis=1)
    stored = np.nan_to_num(np.max(np.abs(inside.energy)))
    return float(np.nan_to_num(np.max(flows)) + stored / (inside.t[-1] - inside.t[0] or np.inf))


def _is_fired(row: ModeRow, inside: Trajectory) -> np.ndarray:
    """Where its gate, if it has one, is open (n,)."""
    return np.broadcast_to(True if row.gate is None else inside[row.gate].ravel() > 0, inside.t.shape)


def _rounding(functions: Functions, run: Trajectory, of: ca.SX, t: float) -> float:
    """What rounding makes of a value at an instant."""
    at, met = run.at([t]), np.max(np.abs(run.steps.x), axis=1)
    terms = Rounding(functions.output(of, name="value"))
    return float(terms(t, at.x[:, 0], at.u[:, 0], run.problem.parameters, spread=np.finfo(float).eps * met)[0])


def _warn(row: ModeRow, t: float, moved: float, passed: float, closed: bool) -> None:
    if row.turned:
        moved, passed, closed = passed, moved, not closed
    doing = (
        f"is taken for closed, and has {moved:.3g} and passes {passed:.3g}"
        if closed
        else f"is taken for open, and has {moved:.3g}"
    )
    warnings.warn(
        f"At t = {t:.6g} s {row.part.where} {doing}: that is against its law, which lets one of both be above zero and none be below. What drives it "
        f"where it changes may be nothing but rounding there. {row.part.component.if_undecided} The motion around is not reliable.",
        AccuracyWarning, stacklevel=callers_level(),
    )  # fmt: skip
