"""Simulation: from start values to a trajectory."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.arguments import ascending, dictionary, finite, listed, truth, whole_number
from acausal.collocation.problem import Guards, Problem, Progress, Solution, StatusKind, Tolerances
from acausal.errors import OptionError, SimulationError, SingularWarning, UnknownVariableError
from acausal.integrators.integrate import integrate
from acausal.language.expression import Input, Parameter, number
from acausal.outputs.clocks import apart
from acausal.outputs.functions import Functions
from acausal.outputs.given_motion import check_given_motions
from acausal.runtime.kernels import How
from acausal.simulate.branches import check_branch
from acausal.simulate.events import when
from acausal.simulate.inputs import INPUTS, InputValue, input_signal, knots, unknown_symbol
from acausal.simulate.progress import Line, shown_progress
from acausal.simulate.sensitivity import Sensitivities, Wanted, sensitivities
from acausal.simulate.trajectory import Trajectory
from acausal.simulate.trouble import (
    failure,
    raise_if_interrupted,
    warn_if_not_followed,
    warn_if_outside,
    warn_if_pulled,
    warn_if_singular,
)
from acausal.simulate.watch import warn_if_inaccurate
from acausal.start.decided import check_decided
from acausal.start.initial import Start, initial_state
from acausal.start.start_values import start_mapping
from acausal.wording import callers_level


@dataclass(frozen=True)
class Options:
    """How to integrate; see `Model.simulate`."""

    rtol: float
    atol: float | None
    method: str
    samples: int
    compiled: bool
    max_steps: int
    raise_on_failure: bool
    order: int | None = None
    step: float | None = None
    max_step: float | None = None
    progress: bool | Progress = False
    events: Sequence[when] = ()

    def checked(self) -> Options:
        """The same with plain numbers. Raises `OptionError` for what makes no sense."""
        rtol = finite(self.rtol, "simulate: rtol")
        atol = 0.0 if self.atol is None else finite(self.atol, "simulate: atol")
        step = None if self.step is None else finite(self.step, "simulate: the step [s]")
        max_step = None if self.max_step is None else finite(self.max_step, "simulate: max_step [s]")
        events = tuple(listed(self.events, "simulate: `events`", 'events=[ac.when(scene.hinge.q, "rising")]'))
        for event in events:
            if not isinstance(event, when):
                raise OptionError(f'simulate: {event!r} in `events` is no event. Use ac.when(expression, "rising").')
        if not callable(self.progress):
            truth(self.progress, "simulate: progress")
        return replace(
            self,
            rtol=rtol,
            atol=atol,
            step=step,
            max_step=max_step,
            order=None if self.order is None else whole_number(self.order, "simulate: the order", 1),
            samples=whole_number(self.samples, "simulate: samples", 2),
            max_steps=whole_number(self.max_steps, "simulate: max_steps", 1),
            raise_on_failure=truth(self.raise_on_failure, "simulate: raise_on_failure"),
            compiled=truth(self.compiled, "simulate: compiled"),
            events=events,
        )


def simulate(
    functions: Functions,
    t0: float,
    t1: float,
    start: Start | None,
    inputs: Mapping[Input, InputValue] | None,
    parameters: Mapping[Parameter, float] | None,
    options: Options,
) -> Trajectory:
    """A motion from t0 to t1 [s]. Raises `StartValueError`, `UnknownVariableError`, and `SimulationError` with the partial motion."""
    called = time.perf_counter()
    t0, t1 = finite(t0, "simulate: the start t0 [s]"), finite(t1, "simulate: the end [s]")
    options = options.checked()
    problem = _problem(functions, {} if inputs is None else inputs, {} if parameters is None else parameters, options.compiled)
    p, space = problem.parameters, functions.space
    jumps = check_given_motions(functions.given_motions, t0, t1, p)
    whole = initial_state(functions.outputs, start_mapping(start), t0, p, problem.inputs(np.array([t0]))[:, 0])
    check_decided(functions.outputs.system, t0, whole.x, p)
    initial = replace(whole, x=space.restricted(whole.x), p=space.extended(t0, whole.x, p))
    problem = replace(problem, parameters=initial.p)
    check_branch(functions, problem, t0, t1, initial.x)
    problem = replace(problem, breaks=_breaks(functions, problem, t0, t1))
    if options.events:
        problem = replace(problem, guards=_guards(functions, options.events))
    solution = _integrated(problem, initial.x, t0, t1, options, called)
    times = np.linspace(t0, solution.t[-1], options.samples)
    run = Trajectory(functions, problem, solution, initial, times, tuple(options.events))
    lost = [jumps, warn_if_singular(functions, run), warn_if_outside(functions, run)]
    warn_if_pulled(functions, run)
    warn_if_not_followed(functions, run)
    if solution.status.kind is StatusKind.SUCCESS and options.step is None and not any(lost):
        warn_if_inaccurate(functions, run, options.rtol, options.atol or 0.0)
    if solution.status.kind is not StatusKind.SUCCESS and options.raise_on_failure:
        raise_if_interrupted(run.status, run)
        raise SimulationError(failure(functions, run.status, t1, run), run)
    return run


def _integrated(problem: Problem, x0: np.ndarray, t0: float, t1: float, options: Options, called: float) -> Solution:
    """The solution, with the time that kernels took since the call (`time.perf_counter`) in its statistics."""
    native = problem.native
    progress = shown_progress(options.progress, lambda: native is not None and native.busy)
    try:
        solution = integrate(
            problem,
            x0,
            t0,
            t1,
            options.rtol,
            options.atol or 0.0,
            method=options.method,
            order=options.order,
            step=options.step,
            max_steps=options.max_steps,
            max_step=options.max_step,
            progress=progress,
        )
    finally:
        if isinstance(progress, Line):
            progress.close()
    if native is None:
        return solution
    return replace(solution, statistics=replace(solution.statistics, compiling=native.compiling(called, time.perf_counter())))


def sensitivity_run(
    functions: Functions,
    times: Sequence[float] | np.ndarray,
    wrt: Sequence[Wanted],
    start: Start,
    inputs: Mapping[Input, InputValue],
    parameters: Mapping[Parameter, float],
    tolerances: Tolerances,
    compiled: bool,
) -> Sensitivities:
    """Derivatives of a motion. Raises `SimulationError` when it fails, and the errors of `simulate`."""
    wrt = listed(wrt, "sensitivities: `wrt`", "wrt=[scene.stiffness, scene.hinge.q]")
    start, inputs = start_mapping(start), dictionary(inputs, "inputs", INPUTS)
    tolerances = replace(
        tolerances,
        rtol=finite(tolerances.rtol, "sensitivities: rtol"),
        atol=finite(tolerances.atol, "sensitivities: atol"),
        max_steps=whole_number(tolerances.max_steps, "sensitivities: max_steps", 1),
    )
    if not (0 < tolerances.rtol < 1 and tolerances.atol >= 0):
        raise OptionError(f"sensitivities: need 0 < rtol < 1 and atol >= 0, not rtol={tolerances.rtol}, atol={tolerances.atol}.")
    for entry in wrt:
        if isinstance(entry, Input) and not np.isscalar(inputs.get(entry, 0.0)):
            raise OptionError(f"sensitivities: the input {functions.outputs.name(entry)} is a function of time, not a number.")
    times = ascending(times, "sensitivities: `times`")
    problem = _problem(functions, inputs, parameters, compiled)
    problem = replace(problem, breaks=_breaks(functions, problem, float(times[0]), float(times[-1])))
    found = sensitivities(functions, problem, times, wrt, start, tolerances)
    status = found.found.status
    raise_if_interrupted(status, None)
    if status.kind is not StatusKind.SUCCESS:
        raise SimulationError(failure(functions, status, float(found.t[-1]), None), None)
    if found.found.passages:
        warnings.warn(
            "sensitivities: the motion passes singular positions of loops. The motion is right there, but derivatives of its rates are huge next "
            "to them and lose digits, now and then all but two. Compare with another rtol, or with differences of motions.",
            SingularWarning, stacklevel=callers_level(),
        )  # fmt: skip
    return found


def _problem(
    functions: Functions, inputs: Mapping[Input, InputValue], parameters: Mapping[Parameter, float], compiled: bool
) -> Problem:
    signal = input_signal(functions, inputs)
    native = functions.native(How.AUTO if compiled else How.CASADI)
    p = parameter_values(functions, parameters)
    return Problem(
        functions.explicit_dynamics, functions.invariants, functions.projection, signal, p, signal.constant, native,
        clearance=functions.clearance, positions=functions.space.nq,
    )  # fmt: skip


def _breaks(functions: Functions, problem: Problem, t0: float, t1: float) -> np.ndarray:
    """(n, 2) times before and after which the rates are smooth: switches in time, knots of inputs."""
    found = knots(problem.inputs, t0, t1)
    if functions.clocks is not None and t1 > t0:
        found = np.concatenate([found, functions.clocks.times(t0, t1, problem.parameters)])
    return apart(found, t0, t1)


def _guards(functions: Functions, events: Sequence[when]) -> Guards:
    key = tuple(event.expression for event in events)
    function = functions.guard_functions.get(key)
    if function is None:
        for event in events:
            if functions.outputs.resolve(event.expression).numel() != 1:
                raise OptionError(f"when: {event.expression!r} is not a scalar; give one event for each entry.")
        if len(functions.guard_functions) >= 64:
            functions.guard_functions.clear()
        function = functions.guard_functions[key] = functions.output(
            ca.vertcat(*map(functions.outputs.resolve, key)), name="guards"
        )
    return Guards(function, tuple(event.sign for event in events), tuple(event.stop for event in events))


def parameter_values(functions: Functions, parameters: Mapping[Parameter, float]) -> np.ndarray:
    """All parameters (np,), with the given ones replaced, for which the model was made. Raises `UnknownVariableError`, `ParameterError`."""
    values = given_values(functions, parameters)
    if parameters:
        functions.decisions.check(values)
    return values


def given_values(functions: Functions, parameters: Mapping[Parameter, float]) -> np.ndarray:
    """All parameters (np,), with the given ones replaced, as parts allow them. Raises `UnknownVariableError`, `ParameterError`."""
    known = functions.outputs.system.flat.parameters
    values = functions.outputs.system.p_values.copy()
    for parameter, value in dictionary(parameters, "parameters", "{scene.mass: 2.0}").items():
        if parameter not in known:
            raise UnknownVariableError(unknown_symbol(parameter, "parameter", [functions.outputs.name(k) for k in known]))
        values[known.index(parameter)] = number(value, functions.outputs.name(parameter))
    if parameters:
        functions.outputs.system.flat.conditions.check(values[: len(known)])
    return values
