"""Simulation: from start values to a trajectory."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import ascending, truth, whole_number
from acausal.collocation.inputs import Inputs
from acausal.collocation.problem import Accuracy, Guards, Problem, Progress, Solution, StatusKind
from acausal.errors import OptionError, SimulationError
from acausal.integrators.integrate import integrate
from acausal.language.expression import Expression
from acausal.language.when import when
from acausal.numerics.one_thread import on_one_thread
from acausal.outputs.functions import Functions
from acausal.outputs.given_motion import check_given_motions
from acausal.runtime.kernels import How
from acausal.simulate.branches import check_branch
from acausal.simulate.corners import warn_if_cornered
from acausal.simulate.events import events_asked
from acausal.simulate.given_rates import warn_of_unlike_rates
from acausal.simulate.one_way import warn_if_led_away, warn_if_passed_back
from acausal.simulate.passes import warn_if_missed
from acausal.simulate.piece import Piece
from acausal.simulate.progress import Line, shown_progress
from acausal.simulate.sound import sound
from acausal.simulate.trajectory import SLACK, Trajectory
from acausal.simulate.trouble import (
    check_inside,
    ended_inside,
    failure,
    raise_if_interrupted,
    warn_if_not_followed,
    warn_if_pulled,
    warn_if_singular,
)
from acausal.simulate.unseen import warn_of_unseen_inputs
from acausal.simulate.watch import warn_if_inaccurate
from acausal.simulate.without_value import warn_of_events_without_value
from acausal.start.decided import check_circuit, check_decided
from acausal.start.initial import InitialState
from acausal.start.inputs import check_smooth, knots
from acausal.start.situation import Situation
from acausal.wording import compact

_NOTHING = np.zeros(0)


@dataclass(frozen=True)
class Options:
    """How to integrate, and what to make of it; see `Model.simulate`."""

    accuracy: Accuracy
    method: str
    samples: int | np.ndarray
    compiled: bool
    raise_on_failure: bool
    order: int | None = None
    progress: bool | Progress = False
    events: tuple[when, ...] = ()

    @staticmethod
    def asked(
        accuracy: Accuracy, method: str, samples: Any, compiled: Any, raise_on_failure: Any, *, order: Any = None, progress: bool | Progress = False,
        events: Any = (),
    ) -> Options:  # fmt: skip
        """Of what a user gives. Raises `OptionError` for what makes no sense."""
        events = events_asked(events, "simulate")
        if not callable(progress):
            truth(progress, "simulate: progress")
        return Options(
            accuracy,
            method,
            samples_asked(samples),
            truth(compiled, "simulate: compiled"),
            truth(raise_on_failure, "simulate: raise_on_failure"),
            None if order is None else whole_number(order, "simulate: the order", 1),
            progress,
            events,
        )

    def times(self, t0: float, end: float) -> np.ndarray:
        """When the motion is read. Raises `OptionError` for times that are not between the start and the end [s]."""
        if isinstance(self.samples, int):
            return np.linspace(t0, end, self.samples)
        slack = SLACK * max(abs(t0), abs(end))
        if self.samples[0] < t0 - slack or self.samples[-1] > end + slack:
            raise OptionError(
                f"simulate: `samples` are from {self.samples[0]:g} s to {self.samples[-1]:g} s, the motion from {t0:g} s to {end:g} s."
            )
        return np.clip(self.samples, t0, end)

    def times_until(self, t0: float, reached: float) -> np.ndarray:
        """The same of a motion that ended before."""
        if isinstance(self.samples, int):
            return np.linspace(t0, reached, self.samples)
        known = self.samples[self.samples <= reached]
        return known if known.size else np.array([reached])


_MOST_SAMPLES = 10**9
"""No memory holds more."""


def samples_asked(value: Any) -> int | np.ndarray:
    """How many samples, at least 2, or their times [s]. Raises `OptionError`."""
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str):
        count = whole_number(value, "simulate: samples", 2)
        return whole_number(count, "simulate: samples", 2, _MOST_SAMPLES)
    return ascending(value, "simulate: `samples`")


def simulate(functions: Functions, at: Situation, end: float, options: Options) -> Trajectory:
    """A motion from t0 to the end [s]. Raises `StartValueError`, and `SimulationError` with the partial motion."""
    functions = functions.setting(tuple(event for event in options.events if event.set is not None))
    called, t0, space = time.perf_counter(), at.t0, functions.space
    signal = at.signal(functions)
    jumps = check_given_motions(functions.given_motions, t0, end, at.p)
    check_smooth(functions, signal, t0, end)
    whole = at.initial(functions, signal(np.array([t0]))[:, 0])
    check_decided(functions.outputs.system, t0, whole.x, at.p)
    if functions.space.coordinates is None:
        check_circuit(functions.outputs.system, t0, whole.x, at.p)
    check_inside(functions, t0, space.restricted(whole.x), signal(np.array([t0]))[:, 0], at.p)
    initial = InitialState(space.restricted(whole.x), space.extended(t0, whole.x, at.p), whole.account)
    read, guards = options.times(t0, end), guards_of(functions, options.events)
    problem = problem_of(
        functions, signal, initial.p, knots(signal, t0, end), options.compiled, guards, read, at.discretes(functions)
    )
    check_branch(functions, problem, t0, end, initial.x)
    solution = ended_inside(functions, problem, integrated(problem, initial.x, t0, end, options, called), len(options.events))
    if solution.modes is None and functions.modes is not None:
        who = compact(dict.fromkeys(functions.modes.all_words), 4) or "parts that remember"
        raise OptionError(
            f"The method {solution.statistics.method} does not go with what opens, slips, strikes or is set: {who}."
        )

    def run_of(solution: Solution) -> Trajectory:
        own, reached = problem.with_modes(solution.modes), float(solution.t[-1])
        times = problem.read if reached == end else options.times_until(t0, reached)
        return Trajectory(functions, own, (Piece(functions, own, solution),), initial, times, options.events)

    run = run_of(solution)
    kept = sound(functions, run, options.accuracy)
    run = run if kept is solution else run_of(kept)
    return concluded(run, end, options, jumps)


def concluded(run: Trajectory, end: float, options: Options, jumps: bool = False) -> Trajectory:
    """The run, looked at. Raises `SimulationError` where it has not come to its end, and `KeyboardInterrupt`, both with the run."""
    look_at(run.functions, run, options.accuracy, jumps)
    if run.status.kind is not StatusKind.SUCCESS and options.raise_on_failure:
        raise_if_interrupted(run.status, run)
        raise SimulationError(failure(run.functions, run.status, end, run), run)
    return run


@on_one_thread
def look_at(functions: Functions, run: Trajectory, accuracy: Accuracy, jumps: bool = False) -> None:
    """Warn of what makes a run that has ended doubtful. `jumps`: whether that has been said of given motions."""
    lost = [jumps, warn_if_singular(functions, run), warn_if_missed(functions, run), warn_of_unseen_inputs(functions, run)]
    lost.append(warn_of_unlike_rates(functions, run))
    warn_of_events_without_value(functions, run)
    warn_if_pulled(functions, run)
    warn_if_not_followed(functions, run)
    if run.status.kind is StatusKind.SUCCESS:
        lost += [warn_if_passed_back(functions, run), warn_if_led_away(functions, run)]
    if run.status.kind is StatusKind.SUCCESS and accuracy.step is None and not any(lost):
        _ = warn_if_cornered(functions, run) or warn_if_inaccurate(functions, run, accuracy.rtol, accuracy.atol)


def integrated(problem: Problem, x0: np.ndarray, t0: float, t1: float, options: Options, called: float) -> Solution:
    """The solution, with the time that kernels took since the call (`time.perf_counter`) in its statistics."""
    native = problem.native
    progress = shown_progress(options.progress, lambda: native is not None and native.busy)
    try:
        solution = integrate(problem, x0, t0, t1, options.accuracy, method=options.method, order=options.order, progress=progress)
    finally:
        if isinstance(progress, Line):
            progress.close()
    compiling = solution.statistics.compiling if native is None else native.compiling(called, time.perf_counter())
    if compiling == solution.statistics.compiling:
        return solution
    return replace(solution, statistics=replace(solution.statistics, compiling=compiling))


def problem_of(
    functions: Functions,
    signal: Inputs,
    p: np.ndarray,
    knots: np.ndarray,
    compiled: bool,
    guards: Guards | None = None,
    read: np.ndarray = _NOTHING,
    discretes: np.ndarray | None = None,
) -> Problem:
    """What is integrated, with kernels where there are such."""
    native = functions.native(How.AUTO if compiled else How.CASADI)
    return Problem(
        functions.staged_dynamics, functions.invariants, functions.projection, signal, p, signal.constant, native, guards, None,
        functions.clearance, functions.space.nq, read, knots, functions.exact, discretes,
    )  # fmt: skip


def guards_of(functions: Functions, events: Sequence[when]) -> Guards | None:
    """What is to be watched: events, then the `borders`, which end the motion; None without any. Raises `OptionError`, `UnknownVariableError`."""
    inside = functions.inside.size1_out(0)
    if not (events or inside):
        return None
    key: tuple[Expression, ...] = tuple(functions.outputs.system.flat.symbols([event.expression for event in events]))
    function = functions.guard_functions.get(key)
    if function is None:
        for expression in key:
            if functions.outputs.resolve(expression).numel() != 1:
                raise OptionError(f"when: {expression!r} is not a scalar; give one event for each entry.")
        if len(functions.guard_functions) >= 64:
            functions.guard_functions.clear()
        function = functions.guard_functions[key] = functions.output(
            ca.vertcat(*map(functions.outputs.resolve, key), *(border.values for border in functions.borders)), name="guards"
        )
    signs, stops = tuple(event.sign for event in events), tuple(event.stop for event in events)
    return Guards(function, signs + (-1,) * inside, stops + (True,) * inside)
