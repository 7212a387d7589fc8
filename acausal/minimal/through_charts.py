"""Motions in independent coordinates, from chart to chart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from acausal.charts.singular_state import singular_loops
from acausal.collocation.problem import Guards, Problem, Solution, Status, StatusKind
from acausal.errors import OptionError, SimulationError, StartValueError
from acausal.integrators.integrate import integrate
from acausal.minimal.model import MinimalModel
from acausal.minimal.motion import MinimalMotion
from acausal.outputs.clocks import apart
from acausal.outputs.functions import Functions
from acausal.runtime.kernels import How
from acausal.simulate.simulation import Options
from acausal.simulate.trajectory import Trajectory
from acausal.simulate.trouble import raise_if_interrupted
from acausal.start.initial import InitialState
from acausal.start.inputs import knots
from acausal.start.situation import Situation

_WORSE = 0.3
"""A chart is left when its conditioning has fallen to this part of that at the reference,"""
_TURNED = 0.45
"""or a quaternion has turned by about 190 degrees,"""
_STRAIN = 0.35**4
"""or a Newton step on the way from the reference leaves about a third of the residual."""

_NEARLY = 1e-2
"""Singular value of constraints below which a failure is put down to them."""

_FINEST = 1e-14
_MOST_FAILURES = 4
"""One after the other, until a motion is given up."""

_CHART_MAY_BE_TO_BLAME = (StatusKind.NON_FINITE, StatusKind.STEP_UNDERFLOW, StatusKind.NOT_CONVERGED)


@dataclass(frozen=True)
class _Piece:
    """A solution in one chart: in y, and how to see it in x."""

    minimal: MinimalModel
    solution: Solution

    @property
    def failed(self) -> bool:
        """Whether neither the end nor a guard ended it."""
        return self.solution.status.kind is not StatusKind.SUCCESS

    def states(self, times: np.ndarray, y: np.ndarray) -> np.ndarray:
        """x (nx, n)."""
        minimal, n = self.minimal, times.size
        columns = [np.repeat(v[:, None], n, axis=1) for v in (minimal.chart.p, minimal.chart.reference)]
        x = minimal.atlas.equations(minimal.chart.choice).expand(times[None, :], y, *columns)
        return np.array(x).reshape(-1, n)


def through_charts(minimal: MinimalModel, end: float, at: Situation, elsewhere: bool, options: Options) -> MinimalMotion:
    """The motion from chart to chart, from the first one's state or `elsewhere`. Raises `StartValueError`, `OptionError`, `SimulationError` with what was computed."""
    functions, chart = minimal.atlas.functions, minimal.chart
    if not minimal.state_names:
        raise OptionError(
            "minimal.simulate: every motion is prescribed, so there are no states to integrate. Ask minimal.expand(t, [], u, p), or use "
            "model.simulate."
        )
    signal = at.signal(functions)
    initial = replace(minimal.initial, x=chart.x)
    if elsewhere:
        initial = at.initial(functions)
        minimal = minimal.rechart(initial.x)
    problem = Problem(
        functions.explicit_dynamics, functions.invariants, functions.projection, signal, chart.p,
        signal.constant, breaks=apart(knots(signal, chart.t, end), chart.t, end),
    )  # fmt: skip
    pieces: list[_Piece] = []
    after: MinimalModel | str = minimal
    steps = failures = 0
    while not isinstance(after, str):
        piece = _run(after, problem, end, options, steps)
        pieces.append(piece)
        steps += piece.solution.statistics.steps
        failures = failures + 1 if piece.failed else 0
        after = _next(piece, failures < _MOST_FAILURES)
    return _finished(functions, problem, pieces, initial, end, after, options)


def _next(piece: _Piece, hopeful: bool) -> MinimalModel | str:
    """The chart in which a motion goes on, or why there is none; empty where it reached its end. `hopeful`: after a failure, too."""
    solution, minimal = piece.solution, piece.minimal
    here, x = float(solution.t[-1]), piece.states(solution.t[-1:], solution.x[:, -1:])[:, 0]
    singular = singular_loops(minimal.atlas.functions, here, x, minimal.chart.p, _NEARLY) if piece.failed else ""
    if singular or not solution.stopped or (piece.failed and not hopeful):
        return f"{solution.status.message} {singular}".strip()
    if here <= minimal.chart.t:
        return f"No chart leads beyond t = {here:g} s; the last one is: {minimal.chart}."
    try:
        return minimal.rechart(x, t=here)
    except StartValueError as error:
        return str(error)


def _run(minimal: MinimalModel, problem: Problem, end: float, options: Options, steps: int) -> _Piece:
    chart, equations = minimal.chart, minimal.atlas.equations(minimal.chart.choice)
    r = chart.reference
    now = np.array(equations.conditions(chart.t, chart.x, chart.p, r)).ravel()
    limits = np.concatenate([_WORSE * now[:2], np.full(now.size - 2, _TURNED), [_STRAIN]])
    p = np.concatenate([chart.p, r, limits])
    native = equations.native(How.AUTO if options.compiled else How.CASADI)
    guards = Guards(equations.guards, (-1,) * limits.size, (True,) * limits.size)
    own = Problem(
        equations.dynamics, None, None, problem.inputs, p, problem.constant_inputs, native, guards, breaks=problem.breaks
    )
    share = float(np.min(now[:2]))  # what depends on y changes up to 1 / share times as fast, and has the same tolerance
    wanted = options.accuracy
    rtol, atol = (max(share * part, min(part, _FINEST)) for part in (wanted.rtol, wanted.atol))
    finer = replace(wanted, rtol=rtol, atol=atol, max_steps=wanted.max_steps - steps)
    solution = integrate(own, minimal.start, chart.t, end, finer, method=options.method)
    return _to_last_step(_Piece(minimal, solution))


def _to_last_step(piece: _Piece) -> _Piece:
    """A motion that a guard stopped, or that failed where the chart may be to blame, up to the end of a step on the chart: ends of steps
    are more accurate than the crossing of a guard between them. `stopped`: if it came anywhere, so that another chart may lead on.
    """
    solution = piece.solution
    n = solution.t.size
    if solution.stopped:
        n = min(n, max(2, n - 1))
    elif solution.status.kind in _CHART_MAY_BE_TO_BLAME:
        known = np.isfinite(piece.states(solution.t, solution.x)).all(axis=0)
        n = n if known.all() else max(1, int(np.argmin(known)))
    else:
        return piece
    status = replace(solution.status, time=float(solution.t[n - 1]))
    return replace(piece, solution=replace(solution, t=solution.t[:n], x=solution.x[:, :n], status=status, stopped=n > 1))


def _finished(
    functions: Functions,
    problem: Problem,
    pieces: list[_Piece],
    initial: InitialState,
    end: float,
    trouble: str,
    options: Options,
) -> MinimalMotion:
    solution = _joined(pieces)
    if trouble:
        kind = StatusKind.NOT_CONVERGED if solution.status.kind is StatusKind.SUCCESS else solution.status.kind
        solution = replace(solution, status=Status(kind, float(solution.t[-1]), trouble))
    times = np.linspace(solution.t[0], solution.t[-1], options.samples)
    motion = MinimalMotion(Trajectory(functions, problem, solution, initial, times), tuple(p.minimal.chart for p in pieces))
    raise_if_interrupted(solution.status, motion.trajectory)
    if solution.status.kind is not StatusKind.SUCCESS and options.raise_on_failure:
        status = solution.status
        raise SimulationError(
            f"{status.message} Integration stopped at t = {status.time:.6g} s of {end:g} s ({status.kind.name.lower()}). "
            "The motion until then is in this error's `trajectory`.",
            motion.trajectory,
        )
    return motion


def _joined(pieces: list[_Piece]) -> Solution:
    """One solution in x; its dense output asks the piece that each time belongs to."""
    ends = np.array([piece.solution.t[-1] for piece in pieces])
    t = np.concatenate([pieces[0].solution.t[:1], *(piece.solution.t[1:] for piece in pieces)])
    knots = [piece.states(piece.solution.t, piece.solution.x) for piece in pieces]
    x = np.hstack([knots[0][:, :1], *(part[:, 1:] for part in knots)])

    def dense(times: np.ndarray) -> np.ndarray:
        result = np.empty((x.shape[0], times.size))
        owner = np.minimum(np.searchsorted(ends, times), len(pieces) - 1)
        for k in np.unique(owner):
            own = owner == k
            result[:, own] = pieces[k].states(times[own], pieces[k].solution.dense(times[own]))
        return result

    parts = [piece.solution.statistics for piece in pieces]
    statistics = replace(
        parts[-1],
        steps=sum(s.steps for s in parts),
        rejected=sum(s.rejected for s in parts),
        evaluations=sum(s.evaluations for s in parts),
        iterations=sum(s.iterations for s in parts),
        seconds=sum(s.seconds for s in parts),
        factorisations=sum(s.factorisations for s in parts),
    )
    last = pieces[-1].solution
    status = last.status if last.status.worst is None else replace(last.status, worst=None)
    return Solution(t, x, dense, statistics, status, (), last.stopped, True)
