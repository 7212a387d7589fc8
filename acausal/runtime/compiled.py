"""A problem compiled for the C runtime, and its integration."""

from __future__ import annotations

import ctypes
import functools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.collocation.problem import (
    Crossing,
    Directions,
    Guards,
    Newton,
    Problem,
    Progress,
    Solution,
    Statistics,
    Status,
    StatusKind,
    Tolerances,
)
from acausal.collocation.tableau import Tableau, gauss_legendre
from acausal.emit.compiler import compiler
from acausal.numerics.bound import copied_states
from acausal.numerics.rounding import rounding_of, rounding_of_rates
from acausal.runtime.binding import (
    Code,
    GuardRoundingFunction,
    InputFunction,
    Integrator,
    Method,
    MethodTable,
    RoundingFunction,
    method_table,
)
from acausal.runtime.kernels import Kernel, Wanted, compiled_kernels, runtime

_SLICE = 0.05
_GO_ON = (Code.PAUSED, Code.NEEDS_JACOBIAN, Code.SLOW)
_STATUS = {
    Code.REACHED_END: (StatusKind.SUCCESS, ""),
    Code.STEP_UNDERFLOW: (StatusKind.STEP_UNDERFLOW, "The step size fell to rounding: the motion may be singular here."),
    Code.NON_FINITE: (StatusKind.NON_FINITE, "A rate became infinite or not a number."),
    Code.NOT_CONVERGED: (StatusKind.NOT_CONVERGED, "The stage equations did not converge; use a smaller step."),
    Code.TOO_MANY_STEPS: (StatusKind.MAX_STEPS, "{0} steps were not enough."),
}


@dataclass(frozen=True)
class Choice:
    """Which methods run: tableaus (the first one starts), where Newton replaces fixed-point
    iteration, and whether the order adapts along the list."""

    tableaus: tuple[Tableau, ...]
    newton: Newton
    start: int = 0
    adapt_order: bool = False


@dataclass(frozen=True)
class Pace:
    """What an integration is like: state x and sizes of the states (nx,) at t [s], step size h [s], the size that accuracy allows over h
    (`slowness`), contraction of the iteration, and whether it is Newton's."""

    t: float
    x: np.ndarray
    size: np.ndarray
    h: float
    slowness: float
    contraction: float
    newton: bool


Slow = Callable[[Pace], str]
"""-> "go on", "newton" or "leave", asked where the iteration and not accuracy sets the step size, and now and then while Newton iterates."""


@dataclass(frozen=True)
class Outcome:
    """Where an integration stands: `stopped` by a guard, `left` because it is stiff."""

    status: Status
    stopped: bool = False
    left: bool = False


class CompiledProblem:
    """rhs, invariants and projection of a problem as kernels. Integrations with it may run side by side in threads."""

    def __init__(
        self, rhs: ca.Function, invariants: ca.Function | None, project: ca.Function | None, clearance: ca.Function | None,
        positions: int, command: tuple[str, ...],
    ) -> None:  # fmt: skip
        self.rhs = rhs
        self._project = project
        self.command = command
        wanted = [Wanted("rhs", rhs, (3,))]
        if invariants is not None and project is not None:
            wanted.append(Wanted("projection", projection_with_invariants(invariants, project), (2,)))
        if clearance is not None:
            wanted.append(Wanted("clearance", clearance, (2,)))
        with ThreadPoolExecutor(1) as pool:
            library = pool.submit(runtime, command)
            found = compiled_kernels(wanted, command)
            self.library = library.result()
        assert found is not None
        self._library, self.kernels = found
        self.lanes: int = self.library.lanes()
        self.nx, self.nu, self.np = (rhs.size1_in(i) for i in (1, 2, 3))
        self.positions, self.crosses = positions, clearance is not None
        self.ng = 0 if invariants is None or project is None else invariants.size1_out(0)
        pairs = copied_states(rhs)
        self._copies = [(ctypes.c_long * max(1, len(pairs)))(*(pair[k] for pair in pairs)) for k in (0, 1)]
        self.copies = len(pairs)

    @functools.cached_property
    def jvp(self) -> tuple[ctypes.CDLL, list[Kernel]]:
        """(t, x, u, p, dx) -> df/dx dx."""
        found = compiled_kernels([Wanted("jvp", directional_derivative(self.rhs, (1,)), (3,))], self.command)
        assert found is not None
        return found

    @functools.cached_property
    def variation(self) -> tuple[ctypes.CDLL, list[Kernel]]:
        """(t, x, u, p, dx, du, dp) -> change of x', and (t, x, p, dx, dp) -> change of x after projection."""
        wanted = [Wanted("variation", directional_derivative(self.rhs, (1, 2, 3)), (3,))]
        if self.ng and self._project is not None:
            wanted.append(Wanted("projected", directional_derivative(self._project, (1, 2)), (2,)))
        found = compiled_kernels(wanted, self.command)
        assert found is not None
        return found

    @functools.cache  # noqa: B019  # as long as the problem lives
    def template(self, choice: Choice) -> tuple[Integrator, tuple[MethodTable, ...]]:
        """An integration with everything set that does not change from run to run."""
        table = method_table(choice.tableaus)
        core = Integrator(
            nx=self.nx, nu=self.nu, np=self.np, ng=self.ng, methods=len(choice.tableaus), method=choice.start,
            newton=choice.newton.value, adapt_order=choice.adapt_order, copies=self.copies, positions=self.positions, rhs=self.kernels[0],
            method_list=table.array, copy_to=self._copies[0], copy_from=self._copies[1], slice=_SLICE,
        )  # fmt: skip
        if self.ng:
            core.projection = self.kernels[1]
        if self.crosses:
            core.clearance = self.kernels[2]
        if choice.tableaus[0].name == "gauss":
            s = choice.tableaus[0].stages
            fine = method_table((gauss_legendre(max(s + 1, round(1.75 * s))),))
            core.fine = ctypes.cast(fine.array, ctypes.POINTER(Method))
            return core, (table, fine)
        return core, (table,)

    @functools.lru_cache(maxsize=64)  # noqa: B019  # as long as the problem lives
    def guard(self, function: ca.Function) -> tuple[ctypes.CDLL, list[Kernel]]:
        """Guards (t, x, u, p) -> values as a kernel."""
        found = compiled_kernels([Wanted("guard", function, (3,))], self.command)
        assert found is not None
        return found

    def projected(self, t: np.ndarray, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """States (nx, n) at times (n,), brought onto the invariants where that is possible."""
        if not self.ng or not t.size:
            return x
        rows = np.ascontiguousarray(x.T)
        times, parameters = np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(p, dtype=float)
        kernel = ctypes.byref(self.kernels[1])
        self.library.project_states(kernel, self.nx, self.np, _address(parameters), times.size, _address(times), _address(rows))
        return rows.T

    def integrate(
        self,
        problem: Problem,
        x0: np.ndarray,
        t0: float,
        t1: float,
        tolerances: Tolerances,
        choice: Choice,
        progress: Progress | None = None,
        slow: Slow | None = None,
    ) -> tuple[Solution, bool]:
        """The solution, and whether `slow` ended it early by "leave"."""
        if not np.isfinite(x0).all():
            worst = int(np.flatnonzero(~np.isfinite(x0))[0])
            status = Status(StatusKind.NON_FINITE, t0, "The start values are not finite.", worst)
            empty = Statistics(choice.tableaus[0].name, choice.tableaus[0].order, 0, 0, 0, 0, 0.0)
            return Solution(
                np.array([t0]), x0[:, None], lambda times: np.repeat(x0[:, None], times.size, axis=1), empty, status
            ), False
        run = Run(self, problem, x0, t0, t1, tolerances, choice)
        outcome = run.advance(t1, progress, slow)
        return run.solution(outcome.status, outcome.stopped), outcome.left


class Run:
    """One integration and the memory that belongs to it; t1 may be set later by `advance`."""

    def __init__(
        self,
        compiled: CompiledProblem,
        problem: Problem,
        x0: np.ndarray,
        t0: float,
        t1: float,
        tolerances: Tolerances,
        choice: Choice,
        directions: Directions | None = None,
    ) -> None:
        self.started = time.perf_counter()
        self.compiled, self.choice = compiled, choice
        self.error: BaseException | None = None
        template, self._table = compiled.template(choice)
        core = self.core = Integrator.from_buffer_copy(template)
        self.x = np.array(x0, dtype=float)
        self._p = np.ascontiguousarray(problem.parameters, dtype=float)
        self._u = np.zeros(max(1, compiled.nu))
        self._inputs = problem.inputs
        self._rhs = problem.rhs
        self._rounding_callback = RoundingFunction(self._round)
        core.rounding = self._rounding_callback
        core.x, core.parameters, core.u = _address(self.x), _address(self._p), _address(self._u)
        core.t, core.end, core.rtol, core.atol = t0, t1, tolerances.rtol, tolerances.atol
        core.step, core.max_steps = tolerances.step or 0.0, tolerances.max_steps
        if compiled.nu:
            if problem.constant_inputs is not None:
                self._u[:] = problem.constant_inputs
            else:
                self._callback = InputFunction(self._input)
                core.input = self._callback
        if problem.guards is not None:
            self._watch(problem.guards)
        if directions is not None:
            self._follow(directions)
        if not compiled.library.begin(ctypes.byref(core)):
            raise MemoryError("integration: not enough memory.")
        if problem.met is not None:
            size = np.ctypeslib.as_array(core.size, self.x.shape)
            np.maximum(size, problem.met, out=size)

    def __del__(self) -> None:
        if hasattr(self, "core"):
            self.compiled.library.finish(ctypes.byref(self.core))

    def _follow(self, directions: Directions) -> None:
        core = self.core
        self.S = np.ascontiguousarray(directions.dx.T, dtype=float)
        self._du, self._dp = (np.ascontiguousarray(d.T, dtype=float) for d in (directions.du, directions.dp))
        core.directions = self.S.shape[0]
        core.S, core.du, core.dp = _address(self.S), _address(self._du), _address(self._dp)
        kernels = self.compiled.variation[1]
        core.variation = kernels[0]
        if self.compiled.ng:
            core.projected = kernels[1]

    def _watch(self, guards: Guards) -> None:
        n, core = len(guards.directions), self.core
        self._guards = (ctypes.c_long * n)(*guards.directions), (ctypes.c_long * n)(*guards.stops)
        core.guards, core.guard = n, self.compiled.guard(guards.function)[1][0]
        core.guard_direction, core.guard_stops = self._guards
        self._guard_function = guards.function
        self._guard_callback = GuardRoundingFunction(self._round_guards)
        core.guard_rounding = self._guard_callback

    def _input(self, t: float, u: Any) -> int:
        try:
            values = self._inputs(np.array([t]))[:, 0]
        except BaseException as error:  # it must not cross the C code; raised again after it
            self.error = error
            return 0
        for i, value in enumerate(values):
            u[i] = value
        return 1

    def _round(self, t: float, x: Any, h: float, rates: Any) -> int:
        try:
            here = np.ctypeslib.as_array(x, (self.compiled.nx,))
            found = rounding_of_rates(self._rhs, t, here, self._inputs(np.array([t]))[:, 0], self._p, h)
        except BaseException as error:  # it must not cross the C code; raised again after it
            self.error = error
            return 0
        np.ctypeslib.as_array(rates, (self.compiled.nx,))[:] = found
        return 1

    def _round_guards(self, t: float, x: Any, values: Any) -> int:
        try:
            here, size = (np.ctypeslib.as_array(a, (self.compiled.nx,)) for a in (x, self.core.size))
            u = self._inputs(np.array([t]))[:, 0]
            found = rounding_of(self._guard_function, t, here, u, self._p, np.spacing(size))
        except BaseException as error:  # it must not cross the C code; raised again after it
            self.error = error
            return 0
        np.ctypeslib.as_array(values, (found.size,))[:] = found
        return 1

    def advance(self, end: float, progress: Progress | None = None, slow: Slow | None = None) -> Outcome:
        """Run until `end`, or what stops it before."""
        core, advance, reference = self.core, self.compiled.library.advance, ctypes.byref(self.core)
        core.end = end
        t0, shown, newton = core.t, self.started, False
        try:
            while (code := advance(reference)) in _GO_ON:
                if code == Code.NEEDS_JACOBIAN:
                    core.jvp = self.compiled.jvp[1][0]
                elif code == Code.SLOW and slow is not None:
                    size = np.ctypeslib.as_array(core.size, self.x.shape).copy()
                    answer = slow(Pace(core.t, self.x.copy(), size, core.h, core.slowness, core.contraction, newton))
                    if answer == "leave":
                        return Outcome(Status(StatusKind.SUCCESS, core.t), left=True)
                    if answer == "newton":
                        core.jvp, newton = self.compiled.jvp[1][0], True
                        self.compiled.library.use_newton(reference)
                elif progress is not None and time.perf_counter() - shown > 0.2:
                    shown = time.perf_counter()
                    progress((core.t - t0) / (end - t0))
        except KeyboardInterrupt:
            return Outcome(Status(StatusKind.INTERRUPTED, core.t, "Interrupted."))
        return self._outcome(Code(code))

    def _outcome(self, code: Code) -> Outcome:
        core = self.core
        if code == Code.INPUT_FAILED and self.error is not None:
            if isinstance(self.error, KeyboardInterrupt):
                return Outcome(Status(StatusKind.INTERRUPTED, core.t, "Interrupted."))
            raise self.error
        if code == Code.OUT_OF_MEMORY:
            raise MemoryError(f"integration: not enough memory at t = {core.t:g} s after {core.steps} steps.")
        if code == Code.EVENT:
            return Outcome(Status(StatusKind.SUCCESS, core.t), stopped=True)
        kind, message = _STATUS[code]
        failed = kind is not StatusKind.SUCCESS and kind is not StatusKind.MAX_STEPS and core.worst >= 0
        return Outcome(Status(kind, core.t, message.format(core.max_steps), core.worst if failed else None))

    def solution(self, status: Status, stopped: bool = False) -> Solution:
        """What has been computed so far."""
        core, nx = self.core, self.compiled.nx
        n = core.steps + 1
        if nx == 0:
            t, x = np.array([core.t, core.end] if core.end > core.t else [core.t]), np.zeros((0, 2 if core.end > core.t else 1))
        else:
            t = np.ctypeslib.as_array(core.times, (n,)).copy()
            x = np.ctypeslib.as_array(core.states, (n, nx)).T.copy()
        tableau = self.choice.tableaus[core.method]
        newton = " with Newton" if core.newton_steps and self.choice.newton is Newton.WHERE_SLOW else ""
        statistics = Statistics(
            tableau.name + newton, tableau.order, core.steps, core.rejected, core.evaluations, core.iterations,
            time.perf_counter() - self.started, core.factorisations,
        )  # fmt: skip
        events = (core.event_times, core.event_guards, core.event_directions)
        found = [np.ctypeslib.as_array(e, (core.events,)).tolist() for e in events] if core.events else [[], [], []]
        crossings = tuple(Crossing(*event) for event in zip(*found, strict=True))
        return Solution(t, x, self.dense, statistics, status, crossings, stopped, located=True)

    def dense(self, times: np.ndarray) -> np.ndarray:
        """States (nx, n) at times (n,) between the first and the last step."""
        nx = self.compiled.nx
        order = np.argsort(times, kind="stable")
        wanted = np.ascontiguousarray(times[order], dtype=float)
        found = np.empty((wanted.size, nx))
        if nx:
            code = self.compiled.library.dense(ctypes.byref(self.core), wanted.size, _address(wanted), _address(found))
            if code == Code.INPUT_FAILED and self.error is not None:
                raise self.error
        result = np.empty((nx, wanted.size))
        result[:, order] = found.T
        return result


def _address(array: np.ndarray) -> int:
    return array.ctypes.data


def directional_derivative(function: ca.Function, arguments: tuple[int, ...]) -> ca.Function:
    """(all arguments, directions of those named) -> derivative of the first result in these directions, exact."""
    symbols = [ca.SX.sym(f"a{i}", function.size1_in(i)) for i in range(function.n_in())]
    directions = [ca.SX.sym(f"d{i}", function.size1_in(i)) for i in arguments]
    at = ca.vertcat(*(symbols[i] for i in arguments))
    product = ca.jtimes(ca.densify(function.call(symbols)[0]), at, ca.vertcat(*directions))
    return ca.Function("product", [*symbols, *directions], [ca.densify(product)], {"cse": True})


def projection_with_invariants(invariants: ca.Function, project: ca.Function) -> ca.Function:
    """(t, x, p) -> x nearer to the invariants, and the invariants at the given x."""
    symbols = [ca.SX.sym(n, invariants.size1_in(i)) for i, n in enumerate("txp")]
    results = [ca.densify(f.call(symbols)[0]) for f in (project, invariants)]
    return ca.Function("projection", symbols, results, {"cse": True})


def compile_problem(
    rhs: ca.Function,
    invariants: ca.Function | None = None,
    project: ca.Function | None = None,
    clearance: ca.Function | None = None,
    positions: int = 0,
) -> CompiledProblem | None:
    """Kernels for `Problem`s with these functions; None without a C compiler.

    Raises `ExportError` where a function has no C, or the compiler fails.
    """
    command = compiler()
    if command is None:
        return None
    return CompiledProblem(rhs, invariants, project, clearance, positions, command)
