"""Motions in independent coordinates, from chart to chart.

Next to singular positions of loops no coordinates are independent on all branches that cross there, and rates are known from points to either side
only: motions of loops that come by one are followed in all coordinates of the tree, as `Model.simulate` does.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from acausal.charts.singular_state import singular_loops
from acausal.collocation.problem import Guards, Problem, Status, StatusKind
from acausal.errors import OptionError, StartValueError
from acausal.minimal.model import MinimalModel
from acausal.outputs.functions import Functions
from acausal.runtime.kernels import How
from acausal.simulate.piece import Piece
from acausal.simulate.simulation import Options, concluded, guards_of, integrated, simulate
from acausal.simulate.trajectory import Trajectory
from acausal.simulate.trouble import ended_inside
from acausal.start.inputs import knots
from acausal.start.situation import Situation

_WORSE = 0.3
"""A chart is left when its conditioning has fallen to this part of that at the reference,"""
_TURNED = 0.45
"""or a quaternion has turned by about 190 degrees,"""
_STRAIN = 0.35**4
"""or a Newton step on the way from the reference leaves about a third of the residual."""

_BESIDE, _PARTS = 0.05, 4
"""Clearance, and singular value of constraints, below which a singular position is near; places of a step at which is looked for it."""

_NEARLY = 1e-2
"""Singular value of constraints below which a failure is put down to them."""

_SHOWN = 0.2
"""Seconds between two reports of progress."""
_FINEST = 1e-14
_MOST_FAILURES = 4
"""One after the other, until a motion is given up."""

_CHART_MAY_BE_TO_BLAME = (StatusKind.NON_FINITE, StatusKind.STEP_UNDERFLOW, StatusKind.NOT_CONVERGED)


def through_charts(minimal: MinimalModel, end: float, at: Situation, options: Options) -> Trajectory:
    """The motion from chart to chart. Raises `StartValueError`, `OptionError`, `SimulationError` with what was computed."""
    whole, called = minimal.atlas.functions, time.perf_counter()
    if not minimal.state_names:
        raise OptionError(
            "minimal.simulate: every motion is prescribed, so there are no states to integrate. Ask minimal.expand(t, [], u, p), or use "
            "model.simulate."
        )
    if any(event.set is not None for event in options.events):
        raise OptionError("minimal.simulate: events that set something go with model.simulate only.")
    if _may_come_beside(whole):
        return simulate(whole, at, end, options)
    signal, here = at.signal(whole), minimal.stands_at(at)
    initial = replace(minimal.initial, x=minimal.chart.x) if here else at.initial(whole)
    problem = Problem(
        whole.explicit_dynamics, whole.invariants, whole.projection, signal, at.p, signal.constant, knots=knots(signal, at.t0, end),
        guards=guards_of(whole, options.events), read=options.times(at.t0, end),
    )  # fmt: skip
    pieces: list[Piece] = []
    after = minimal if here else minimal.at(at.t0, initial.x, at.p)
    left, failures, shown = options.accuracy.max_steps, 0, called
    found: MinimalModel | str = after
    kind = StatusKind.NOT_CONVERGED
    try:
        while not isinstance(found, str):
            piece, leads_on = _run(found, problem, end, _told_of_all(options, at.t0, found.chart.t, end), left, called)
            if _comes_beside(whole, piece):
                return simulate(whole, at, end, options)
            pieces.append(piece)
            left -= piece.solution.statistics.steps
            failed = piece.solution.status.kind is not StatusKind.SUCCESS
            failures = failures + 1 if failed else 0
            found = _next(found, piece, leads_on and failures < _MOST_FAILURES)
            if callable(options.progress) and time.perf_counter() - shown > _SHOWN and found:
                shown = time.perf_counter()
                options.progress((float(piece.solution.t[-1]) - at.t0) / (end - at.t0))
    except KeyboardInterrupt:
        if not pieces:
            raise
        found, kind = "Interrupted.", StatusKind.INTERRUPTED  # between two charts; within one its run says so
    if found:
        status = pieces[-1].solution.status
        kind = kind if status.kind is StatusKind.SUCCESS else status.kind
        status = Status(kind, float(pieces[-1].solution.t[-1]), str(found))
        pieces[-1] = replace(pieces[-1], solution=replace(pieces[-1].solution, status=status))
    last = pieces[-1]
    if last.solution.crossings:
        expanded = replace(last.solution, x=last.ends(whole))
        ended = ended_inside(whole, problem, expanded, len(options.events))
        if ended is not expanded:
            pieces[-1] = replace(last, solution=replace(ended, x=last.solution.x))
    reached = float(pieces[-1].solution.t[-1])
    times = problem.read if reached == end else options.times_until(at.t0, reached)
    return concluded(Trajectory(whole, problem, tuple(pieces), initial, times, options.events), end, options)


def _may_come_beside(whole: Functions) -> bool:
    """Whether loops go through singular positions, or closely past them, as far as is known before a motion."""
    constraints = whole.outputs.system.constraints
    return constraints.singular or any(part.least < _BESIDE for part in constraints.examined)


def _comes_beside(whole: Functions, piece: Piece) -> bool:
    """Whether a motion has come next to a singular position."""
    if whole.clearance is None:
        return False
    begin, h = piece.solution.t[:-1], np.diff(piece.solution.t)
    times = (begin[:, None] + h[:, None] * np.arange(1, _PARTS + 1) / _PARTS).ravel()
    p = np.repeat(piece.problem.parameters[:, None], times.size, axis=1)
    clear = np.array(whole.clearance(times[None, :], piece.between(times, whole), p))
    return bool((clear[0] < _BESIDE).any())


def _told_of_all(options: Options, t0: float, here: float, end: float) -> Options:
    """Progress from here on, as a part of the whole motion."""
    told = options.progress
    return (
        replace(options, progress=lambda part: told((here + part * (end - here) - t0) / (end - t0)))
        if callable(told)
        else options
    )


def _next(minimal: MinimalModel, piece: Piece, leads_on: bool) -> MinimalModel | str:
    """The chart in which a motion goes on, or why there is none; empty where it ended as it should. `leads_on`: where another chart may help."""
    solution, whole = piece.solution, minimal.atlas.functions
    here, x, p = float(solution.t[-1]), piece.ends(whole)[:, -1], minimal.chart.p
    failed = solution.status.kind is not StatusKind.SUCCESS
    singular = singular_loops(whole, here, x, p, _NEARLY) if failed else ""
    if singular or not leads_on:
        return f"{solution.status.message} {singular}".strip()
    if here <= minimal.chart.t:
        return f"No chart leads beyond t = {here:g} s; the last one is: {minimal.chart}."
    try:
        return minimal.at(here, x, p)
    except StartValueError as error:
        return str(error)


def _run(minimal: MinimalModel, problem: Problem, end: float, options: Options, left: int, called: float) -> tuple[Piece, bool]:
    """As far as a chart leads, and whether another one may lead on. `left`: steps that may still be made."""
    chart, equations = minimal.chart, minimal.atlas.equations(minimal.chart.choice)
    now = np.array(equations.conditions(chart.t, chart.x, chart.p, chart.reference)).ravel()
    limits = np.concatenate([_WORSE * now[:2], np.full(now.size - 2, _TURNED), [_STRAIN]])
    n = limits.size
    own = Problem(
        equations.dynamics, None, None, problem.inputs, np.concatenate([chart.p, chart.reference, limits]), problem.constant_inputs,
        equations.native(How.AUTO if options.compiled else How.CASADI), _guards(minimal, problem.guards, n), read=problem.read, knots=problem.knots,
    )  # fmt: skip
    share = float(np.min(now[:2]))  # what depends on y changes up to 1 / share times as fast, and has the same tolerance
    wanted = options.accuracy
    rtol, atol = (max(share * part, min(part, _FINEST)) for part in (wanted.rtol, wanted.atol))
    finer = replace(options, accuracy=replace(wanted, rtol=rtol, atol=atol, max_steps=left))
    solution = integrated(own, minimal.start, chart.t, end, finer, called)
    chart_ended = solution.stopped and solution.crossings[-1].guard < n
    crossings = tuple(replace(c, guard=c.guard - n) for c in solution.crossings if c.guard >= n)
    seen = replace(own, parameters=chart.p)
    return _to_last_step(
        Piece(minimal.functions, seen, replace(solution, crossings=crossings), chart), minimal.atlas.functions, chart_ended
    )


def _guards(minimal: MinimalModel, wanted: Guards | None, n: int) -> Guards:
    """Where a chart ends, then what is `wanted` of the model's states."""
    equations = minimal.atlas.equations(minimal.chart.choice)
    if wanted is None:
        return Guards(equations.guards, (-1,) * n, (True,) * n)
    return Guards(equations.with_guards(wanted.function), (-1,) * n + wanted.directions, (True,) * n + wanted.stops)


def _to_last_step(piece: Piece, whole: Functions, chart_ended: bool) -> tuple[Piece, bool]:
    """A motion that a chart's end stopped, or that failed where the chart may be to blame, up to the end of a step on the chart, and whether
    another chart may lead on: ends of steps are more accurate than the crossing of a guard between them.
    """
    solution = piece.solution
    n = solution.t.size
    if chart_ended:
        n = min(n, max(2, n - 1))
    elif solution.status.kind in _CHART_MAY_BE_TO_BLAME:
        known = np.isfinite(piece.ends(whole)).all(axis=0)
        n = n if known.all() else max(1, int(np.argmin(known)))
    else:
        return piece, False
    last = float(solution.t[n - 1])
    crossings = tuple(c for c in solution.crossings if c.time <= last)
    status = replace(solution.status, time=last, worst=None)
    cut = replace(solution, t=solution.t[:n], x=solution.x[:, :n], status=status, crossings=crossings)
    return replace(piece, solution=cut), n > 1
