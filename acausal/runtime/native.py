"""A problem as kernels for the C runtime, and its integration."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import signal
import threading
import time
import weakref
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.collocation.inputs import Inputs
from acausal.collocation.modes import ModesMet
from acausal.collocation.problem import (
    Accuracy,
    Crossing,
    Directions,
    Guards,
    Kept,
    Newton,
    Problem,
    Progress,
    Solution,
    Statistics,
    Status,
    StatusKind,
    Through,
)
from acausal.collocation.tableau import Tableau, refining
from acausal.emit.compiler import compiler
from acausal.errors import ExportError, SimulationError
from acausal.runtime.binding import (
    KERNELS,
    Clock,
    Code,
    InputFunction,
    Integrator,
    JacobianPattern,
    LackingFunction,
    Method,
    MethodTable,
    Table,
    method_table,
)
from acausal.runtime.integrand import Integrand
from acausal.runtime.kernels import How, Interpreted, Kernel, Kernels, Wanted, interpreted, paired
from acausal.runtime.lasting import LastingModes
from acausal.runtime.load import Runtime, runtime

_Double, _Long = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_long)
_SLICE = 0.05
_LACKING = (
    "disturbed_rhs", "disturbed_guard", "disturbed_projection", "exact_rhs", "exact_projection",
    "rhs_program", "rows_program", "projection_program", "jvp_program",
)  # fmt: skip
_PROGRAMS = 5
"""See `lacking` in runtime.h."""
_INSTANT = 16 * float(np.finfo(float).eps)
"""Of a time: steps that are no longer are jumps."""
_MANY = 16
"""Programs of modes, for so many values of parameters, are kept."""
_NEAR = 0.05
"""Clearance from singular positions below which states are corrected in twice as many digits: `EXACT` of passage.h."""
BUDGET = 64 * 2**20
"""Bytes of a run's polynomials, and of ends of steps, that are kept whether they are read or not."""
_SLIDES = "The motion slides along a switch of the rates, {0}: from both sides it is led back there, so that no side lasts."
_GO_ON = (Code.PAUSED, Code.NEEDS_JACOBIAN)
_STATUS = {
    Code.REACHED_END: (StatusKind.SUCCESS, ""),
    Code.STEP_UNDERFLOW: (StatusKind.STEP_UNDERFLOW, "The step size fell to rounding: the motion may be singular here."),
    Code.BRANCHES_TOUCH: (
        StatusKind.BRANCHES_TOUCH,
        "The motion comes to a singular position of loops where its branches touch, rather than cross: next to it the forces in the loops are known to no "
        "digits, and nothing tells how it goes on. Turn the axis of a joint a little, or leave out what holds nothing that others do not hold.",
    ),
    Code.NON_FINITE: (StatusKind.NON_FINITE, "A rate became infinite or not a number."),
    Code.NOT_CONVERGED: (
        StatusKind.NOT_CONVERGED,
        "The stage equations did not converge; use a smaller step.",
    ),
    Code.TOO_MANY_STEPS: (StatusKind.MAX_STEPS, "{0} steps were not enough."),
    Code.INPUT_FAILED: (StatusKind.NON_FINITE, "What decides how the motion goes on could not be computed here."),
}

_OF_MODES = {
    Code.OVERLAPS: (
        StatusKind.OVERLAPS,
        "The gap of {0} is negative at the start, or after a jump. Move what it keeps apart, or turn its normal round.",
    ),
    Code.NO_MODE: (
        StatusKind.NO_MODE,
        "Whether {0} and what touches with it hold, slide or open: nothing obeys the laws of all of them. With friction that is large, or acts on a slender body, "
        "there may be no such motion (Painleve's paradox): lower its coefficient, or let bodies yield there. Nor is there any where what moves as prescribed presses on what cannot yield.",
    ),
    Code.CHATTERS: (
        StatusKind.CHATTERS,
        "{0} changes its mode again and again in one instant: no mode lasts. Other laws at it, or a start that differs a little, may.",
    ),
    Code.NO_DERIVATIVES: (
        StatusKind.NO_DERIVATIVES,
        "{0} {1}",
    ),
    Code.TIED: (
        StatusKind.TIED,
        "{0} and {1} strike in the same instant and move one another, and one after the other they leave with other speeds than the other way round. Let them strike at different "
        "times, or all at once: ac.Poisson(e) or ac.Newton(e) without in_sequence.",
    ),
    Code.FALLS: (
        StatusKind.FALLS,
        "{0} is on the wrong side of what it should stay off: its gap has become negative, and nothing has struck. A gap must not jump: let what it is measured from move without "
        "jumps, in comparisons and tables too, and ask for smaller steps (max_step) where it is narrow.",
    ),
    Code.GAINS: (
        StatusKind.GAINS,
        "An impact of {0} gains energy: by Newton's law, or with slips that friction brings back, that can be where friction and the normal impulse move one another. "
        "Give ac.Energetic(e), or ac.Poisson(e).",
    ),
}

_OBSTACLES = (
    "comes to rest here by impacts without end, with friction, and derivatives through these are not known. Ask for times before, or let it not bounce at all (restitution 0).",
    "strikes by another law than Poisson's, and derivatives through that are not known. Ask for times before, or give its restitution as a number.",
    "brings slips back when it strikes (restitution of Coulomb), and derivatives through that are not known. Ask for times before, or leave that restitution out.",
    "strikes with the friction of a patch, and derivatives through that are not known. Ask for times before, or give friction without a patch.",
    "meets what jumps here, in a comparison or a table, and derivatives through that are not known. Ask for times before, or let it change without jumps.",
)
"""What derivatives do not go through: `enum Obstacle` of runtime.h."""

_OF_SETS = {
    Code.SETS_NO_NUMBER: "{0} sets {1} to what is no number there. Look at its formula: a division by zero, a root of what is negative.",
    Code.SETS_TWICE: "{0} sets {1}, and another event sets it to something else in the same instant. Say in one of them which counts.",
    Code.SETS_BOUND: (
        "{0} sets {1}, which constraints do not let be so: what loops, gears or unit quaternions tie together must be set together, to values that agree. "
        "Set the velocities of all that moves along with it, or one that nothing ties."
    ),
}


_APART = "{0} is to hold what does not meet there: by {1}. Close it where its frames meet, give rtol such as they meet to, or hold them as they stand, by a Gripper."


@dataclass(frozen=True)
class Choice:
    """Which methods run: tableaus, where Newton replaces fixed-point iteration, and whether Radau's order adapts along the list.
    `WHERE_SLOW` begins with Gauss; Radaus after it in the list are for where the motion is stiff."""

    tableaus: tuple[Tableau, ...]
    newton: Newton
    adapt_order: bool = False


@dataclass(frozen=True)
class Outcome:
    """Where an integration stands: `stopped` by a guard."""

    status: Status
    stopped: bool = False


class ProgramsOfModes:
    """What integrations have made for modes that lasted (thin.h), by the bytes of their parameters, for the next ones with the same."""

    def __init__(self, forget: Callable[[int], None]) -> None:
        self._forget = forget
        self._kept: list[tuple[bytes, int]] = []

    def taken(self, parameters: bytes) -> int | None:
        """An address; it belongs to nobody else from now on."""
        for entry in reversed(self._kept):
            if entry[0] == parameters:
                with contextlib.suppress(ValueError):  # another thread was faster
                    self._kept.remove(entry)
                    return entry[1]
        return None

    def keep(self, parameters: bytes, programs: int) -> None:
        """For others."""
        self._kept.append((parameters, programs))
        while len(self._kept) > _MANY:
            self._forget(self._kept.pop(0)[1])

    def __del__(self) -> None:
        for _, programs in self._kept:
            self._forget(programs)


class NativeProblem:
    """An integrand's functions as kernels. Integrations with it may run side by side in threads."""

    def __init__(self, integrand: Integrand, how: How, runtime: Runtime) -> None:
        self.integrand, self.how, self.runtime, self.library = integrand, how, runtime, runtime.library
        self.lanes = runtime.lanes
        self._made: weakref.WeakSet[Kernels] = weakref.WeakSet()
        self.programs = ProgramsOfModes(self.library.forget_programs)
        self.lasting = LastingModes(runtime, compiler() if how in (How.AUTO, How.COMPILED) else None)
        self.kernels = self._kernels(*integrand.wanted)
        self.nx, self.nu, self.held = (integrand.numbers[name] for name in ("nx", "nu", "held"))
        self._arrays = {
            name: np.ascontiguousarray(values, dtype=np.int_)
            for name, values in (*zip(("copy_to", "copy_from"), integrand.copies, strict=True), *integrand.lists.items())
        }
        if integrand.row_switch.size:
            self._arrays["row_switch"] = np.ascontiguousarray(integrand.row_switch, dtype=np.int_)
            self._arrays |= {
                f"row_{n}": np.ascontiguousarray(a, dtype=float)
                for n, a in zip(("factor", "plus"), integrand.row_steps, strict=True)
            }

    def _kernels(self, *wanted: Wanted) -> Kernels:
        found = Kernels(wanted, self.runtime, self.how)
        self._made.add(found)
        return found

    def compiling(self, first: float, last: float) -> float:
        """Seconds of a stretch of time (`time.perf_counter`) in which kernels were made, or a compiler worked on them in the background."""
        return sum(k.made_between(first, last) + k.compiled_between(first, last) for k in self._made) + self.lasting.between(
            first, last
        )

    @property
    def busy(self) -> bool:
        """Whether a compiler works in the background."""
        return self.lasting.busy or any(kernels.busy for kernels in self._made)

    @functools.lru_cache(maxsize=64)  # noqa: B019  # as long as the problem lives
    def paired(self, wanted: Wanted) -> Interpreted:
        """A function as a program on pairs of values."""
        return paired(wanted.function, wanted.name, self.lanes, parameters=wanted.parameters)

    @functools.lru_cache(maxsize=64)  # noqa: B019  # as long as the problem lives
    def interpreted(self, wanted: Wanted) -> Interpreted:
        """A function as a program."""
        return interpreted(wanted.function, wanted.name, self.lanes, parameters=wanted.parameters)

    @functools.cached_property
    def jvp(self) -> Kernels:
        """See `Integrand`."""
        return self._kernels(self.integrand.jvp)

    @functools.cached_property
    def variation(self) -> Kernels:
        """See `Integrand`."""
        return self._kernels(*self.integrand.variation)

    @functools.lru_cache(maxsize=64)  # noqa: B019  # as long as the problem lives
    def formula(self, function: ca.Function) -> Kernels:
        """Inputs (t) -> values as a kernel."""
        return self._kernels(Wanted("formula", function))

    @functools.lru_cache(maxsize=64)  # noqa: B019  # as long as the problem lives
    def guard(self, function: ca.Function) -> Kernels:
        """Guards (t, x, u, p) -> values as a kernel."""
        return self._kernels(self.integrand.guard(function))

    @functools.cache  # noqa: B019  # as long as the problem lives
    def template(self, choice: Choice) -> tuple[Integrator, tuple[MethodTable, ...]]:
        """An integration with everything set that does not change from run to run."""
        table = method_table(choice.tableaus)
        core = Integrator(
            **self.integrand.numbers, methods=len(choice.tableaus), newton=choice.newton.value,
            adapt_order=choice.adapt_order, method_list=table.array, slice=_SLICE, pattern=JacobianPattern.of(self.integrand.pattern),
        )  # fmt: skip
        for name, array in self._arrays.items():
            setattr(core, name, array.ctypes.data_as(_Long if array.dtype == np.int_ else _Double))
        if self.integrand.usual is not None:
            core.usual = _address(self.integrand.usual)
        if choice.tableaus[0].name == "gauss":
            fine = method_table((refining(choice.tableaus[0]),))
            core.fine = ctypes.cast(fine.array, ctypes.POINTER(Method))
            return core, (table, fine)
        return core, (table,)

    def projected(self, t: np.ndarray, x: np.ndarray, u: np.ndarray | None, p: np.ndarray) -> np.ndarray:
        """States (nx, n) at times (n,), brought onto the invariants where that is possible, with inputs (nu, n), or None where none matters."""
        if not self.integrand.projects or not t.size:
            return x
        rows = np.array(x.T, order="C")
        times, parameters = np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(p, dtype=float)
        exact = None if self.integrand.masks else self.integrand.exact_projection
        if exact is None or self.integrand.numbers["through"] == Through.ALWAYS.value:
            self._project(self.kernels.current[1], times, rows, u, parameters)
            return rows.T
        near = self._near(times, rows, parameters)
        for some, kernel in ((~near, self.kernels.current[1]), (near, self.paired(exact).kernel if near.any() else None)):
            if kernel is not None and some.any():
                there = rows[some]
                self._project(kernel, times[some], there, None if u is None else u[:, some], parameters)
                rows[some] = there
        return rows.T

    def _project(self, kernel: Kernel, times: np.ndarray, rows: np.ndarray, u: np.ndarray | None, p: np.ndarray) -> None:
        """States `rows` (n, nx) brought onto the invariants where they are."""
        nu = self.nu - self.integrand.sides
        given = np.zeros((times.size, nu)) if u is None else np.ascontiguousarray(u.T)
        self.library.project_states(
            ctypes.byref(kernel), self.nx, nu, self.integrand.numbers["np"], _address(p), times.size, _address(times), _address(given),
            _address(rows),
        )  # fmt: skip

    def _near(self, times: np.ndarray, rows: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(n,): which states (n, nx) are so near to singular positions that corrections take twice as many digits; all where that is not known."""
        return np.ones(times.size, dtype=bool) if self.integrand.clearance is None else ~(self.clearances(times, rows, p) > _NEAR)

    def clearances(self, times: np.ndarray, rows: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(n,) at states (n, nx), of problems that have one."""
        clearance = self.integrand.clearance
        assert clearance is not None
        found, t, x = np.empty((clearance.numel_out(0), times.size)), np.ascontiguousarray(times), np.ascontiguousarray(rows.T)
        at = [part.ctypes.data for part in (p, t, x, found)]
        kernel = self.kernels.current[[wanted.name for wanted in self.integrand.wanted].index("clearance")]
        if self.library.columns(ctypes.byref(kernel), self.nx, 0, p.size, at[0], times.size, at[1], at[2], None, at[3]):
            raise MemoryError(f"clearance at {times.size} points: not enough memory.")
        return found[0]

    def integrate(
        self,
        problem: Problem,
        x0: np.ndarray,
        t0: float,
        t1: float,
        accuracy: Accuracy,
        choice: Choice,
        progress: Progress | None = None,
    ) -> Solution:
        """The solution, or what there is of it."""
        if not np.isfinite(x0).all():
            worst = int(np.flatnonzero(~np.isfinite(x0))[0])
            status = Status(StatusKind.NON_FINITE, t0, "The start values are not finite.", worst)
            empty = Statistics(choice.tableaus[0].name, choice.tableaus[0].order, 0, 0, 0, 0, 0.0)
            return Solution(np.array([t0]), x0[:, None], lambda times: np.repeat(x0[:, None], times.size, axis=1), empty, status)
        run = Run(self, problem, x0, t0, t1, accuracy, choice)
        outcome = run.advance(t1, progress)
        return run.solution(outcome.status, outcome.stopped)


def _weakly(method: Callable[..., int]) -> Callable[..., int]:
    """What the C code may call of an object that holds this in turn: both are freed as soon as nobody holds the object."""
    held = weakref.WeakMethod(method)

    def call(*given: Any) -> int:
        alive = held()
        return 0 if alive is None else alive(*given)

    return call


class Run:
    """One integration and the memory that belongs to it; t1 may be set later by `advance`."""

    def __init__(
        self,
        native: NativeProblem,
        problem: Problem,
        x0: np.ndarray,
        t0: float,
        t1: float,
        accuracy: Accuracy,
        choice: Choice,
        directions: Directions | None = None,
        asked: np.ndarray | None = None,
    ) -> None:
        self.started = time.perf_counter()
        self.native, self.choice = native, choice
        self.error: BaseException | None = None
        template, self._table = native.template(choice)
        core = self.core = Integrator.from_buffer_copy(template)
        self._finish = functools.partial(native.library.finish, ctypes.byref(core))  # modules may be gone by then
        self.x = np.array(x0, dtype=float)
        self._p = np.ascontiguousarray(problem.parameters, dtype=float)
        self._u = np.zeros(max(1, native.nu))
        self._inputs = problem.inputs
        self._begun = problem, self.x.copy(), t0, t1, accuracy
        self._read = np.ascontiguousarray(problem.read, dtype=float)
        core.budget, core.read, core.read_count = BUDGET, _address(self._read), self._read.size
        self._lacking_callback = LackingFunction(_weakly(self._lacking))
        core.lacking = self._lacking_callback
        core.x, core.parameters, core.u = _address(self.x), _address(self._p), _address(self._u)
        core.t, core.end, core.rtol, core.atol = t0, t1, accuracy.rtol, accuracy.atol
        core.step, core.max_steps, core.max_step = accuracy.step or 0.0, accuracy.max_steps, accuracy.max_step or 0.0
        self._in_use: list[tuple[Kernels, int, tuple[str, ...]]] = []
        self.kinds = native.kernels.kind
        own = native.nu - native.held
        if own:
            if problem.constant_inputs is not None:
                self._u[:own] = problem.constant_inputs[:own]
            else:
                self._give(problem.inputs if isinstance(problem.inputs, Inputs) else None)
        self._use(native.kernels, *(wanted.name for wanted in native.integrand.wanted))
        self._knots = np.ascontiguousarray(problem.knots, dtype=float)
        core.knots, core.knot_count = _address(self._knots), self._knots.size
        if problem.discretes is not None:
            self._discretes = np.ascontiguousarray(problem.discretes, dtype=float)
            core.discrete_start = _address(self._discretes)
        if problem.guards is not None:
            self._watch(problem.guards)
        if directions is not None:
            self._follow(directions, np.zeros(0) if asked is None else asked)
        with self._programs_of_modes():
            begun = native.library.begin(ctypes.byref(core))
        if not begun:
            raise MemoryError("integration: not enough memory.")
        if problem.met is not None:
            size = np.ctypeslib.as_array(core.size, self.x.shape)
            np.maximum(size, problem.met, out=size)

    def __del__(self) -> None:
        if hasattr(self, "_finish"):
            self._finish()

    @contextlib.contextmanager
    def _programs_of_modes(self) -> Generator[None]:
        """They are lent to the integration while it works."""
        core, kept, parameters = self.core, self.native.programs, self._p.tobytes()
        if self.native.integrand.masks:
            core.programs = kept.taken(parameters)
            if core.programs:
                self.native.lasting.look(core.programs)
        try:
            yield
        finally:
            if core.programs:
                kept.keep(parameters, core.programs)
                core.programs = None

    def _give(self, inputs: Inputs | None) -> None:
        """Tables and formulas to the runtime; the rest is asked for by a callback, all where nothing is known of them."""
        core = self.core
        if inputs is not None:
            self._u[: inputs.numbers.size] = inputs.numbers
            self._tables = [(np.ascontiguousarray(c.begins), np.ascontiguousarray(c.coefficients)) for _, c in inputs.tables]
            self._table_list = (Table * len(self._tables))(*(
                Table(i, *c.coefficients.shape, c.first, c.period, *(ctypes.cast(_address(a), _Double) for a in arrays))
                for (i, c), arrays in zip(inputs.tables, self._tables, strict=True)
            ))  # fmt: skip
            core.tables, core.table_list = len(self._tables), self._table_list
            clocks = inputs.clocks
            self._clocks = (Clock * len(clocks))(*(Clock(*clock) for clock in clocks))
            core.clocks, core.clock_list = len(clocks), self._clocks
            if inputs.formulas:
                self._formula_input = (ctypes.c_long * len(inputs.formulas))(*(i for i, _ in inputs.formulas))
                core.formulas, core.formula_input = len(inputs.formulas), self._formula_input
                self._use(self.native.formula(inputs.formula), "formula")
        self._functions = None if inputs is None else inputs.functions
        if self._functions is None or self._functions:
            self._callback = InputFunction(_weakly(self._input))
            core.input = self._callback

    def _follow(self, directions: Directions, asked: np.ndarray) -> None:
        """Directions along the motion, and what is asked for at ascending times: `asked_x` (m, nx), `asked_S` (m, n, nx), `asked_discrete` (m, n, discretes)."""
        core = self.core
        self.S = np.array(directions.dx.T, dtype=float, order="C")
        du = np.vstack([directions.du[: self.native.nu - self.native.held], np.zeros((self.native.held, self.S.shape[0]))])
        self._du, self._dp = (np.ascontiguousarray(d.T, dtype=float) for d in (du, directions.dp))
        core.directions = self.S.shape[0]
        core.S, core.du, core.dp = _address(self.S), _address(self._du), _address(self._dp)
        self.discrete_S = np.zeros((self.S.shape[0], self.native.integrand.numbers["discretes"]))
        core.discrete_S = _address(self.discrete_S)
        self._asked = np.ascontiguousarray(asked, dtype=float)
        shapes = (self.x.shape, self.S.shape, self.discrete_S.shape)
        self.asked_x, self.asked_S, self.asked_discrete = (np.full((asked.size, *shape), np.nan) for shape in shapes)
        core.asked, core.asked_t = asked.size, _address(self._asked)
        core.asked_x, core.asked_S, core.asked_discrete = (
            _address(self.asked_x),
            _address(self.asked_S),
            _address(self.asked_discrete),
        )
        self._use(self.native.variation, *(wanted.name for wanted in self.native.integrand.variation))

    def _watch(self, guards: Guards) -> None:
        n, core = len(guards.directions), self.core
        self._guards = (ctypes.c_long * n)(*guards.directions), (ctypes.c_long * n)(*guards.stops)
        core.guards = n
        self._use(self.native.guard(guards.function), "guard")
        core.guard_direction, core.guard_stops = self._guards
        self._guard_function = guards.function

    def _use(self, kernels: Kernels, *names: str) -> None:
        if any(kernels is known for known, _, _ in self._in_use):
            return
        for name, kernel in zip(names, kernels.current, strict=True):
            setattr(self.core, name, kernel)
        self._in_use.append((kernels, kernels.version, names))

    def _spent(self, seconds: float) -> None:
        """Better kernels take the place of those in use, once these have cost what better ones would."""
        for k, (kernels, version, names) in enumerate(self._in_use):
            kernels.spent(seconds)
            if kernels.version != version:
                for name, kernel in zip(names, kernels.current, strict=True):
                    if not self.native.library.exchange(ctypes.byref(self.core), KERNELS.index(name), ctypes.byref(kernel)):
                        raise MemoryError("integration: not enough memory.")
                self._in_use[k] = kernels, kernels.version, names
                if kernels is self.native.kernels:
                    self.kinds += f", {kernels.kind} from t = {self.core.t:.6g} s"

    def _input(self, _: int | None, t: float, u: Any) -> int:
        try:
            if self._functions is None:
                own = self.native.nu - self.native.held
                for i, value in enumerate(self._inputs(np.array([t]))[:own, 0].tolist()):  # a pointer takes no slices
                    u[i] = value
            else:
                for i, function in self._functions:
                    u[i] = function(t)
        except BaseException as error:  # it must not cross the C code; raised again after it
            self.error = error
            return 0
        return 1

    def _lacking(self, which: int) -> int:
        """A program that is made when it is first needed: of the rates (0), guards (1) or projection (2) to show what rounding does, of exact rates (3) or
        projection (4); of rates (5), rows (6), projection (7), Jacobian (8) where these are compiled."""
        integrand = self.native.integrand
        try:
            if which < _PROGRAMS:
                wanted = (
                    integrand.wanted[0] if which == 0 else integrand.guard(self._guard_function) if which == 1 else integrand.correction if which == 2
                    else integrand.exact_rates if which == 3 else integrand.exact_projection
                )  # fmt: skip
                assert wanted is not None
                made = self.native.paired(wanted)
            else:
                known = {w.name: w for w in (*integrand.wanted, integrand.jvp)}
                made = self.native.interpreted(known[("rhs", "rows", "projection", "jvp")[which - _PROGRAMS]])
            setattr(self.core, _LACKING[which], made.kernel)
        except ExportError:  # then it is not known
            return 0
        return 1

    def advance(self, end: float, progress: Progress | None = None) -> Outcome:
        """Run until `end`, or what stops it before."""
        core, advance, reference = self.core, self.native.library.advance, ctypes.byref(self.core)
        core.end = end
        t0, shown = core.t, self.started
        worked = time.thread_time()
        try:
            with interrupts_noted() as interrupts, self._programs_of_modes():
                code = advance(reference)
            while code in _GO_ON:
                seen, before, worked = time.perf_counter(), worked, time.thread_time()
                self._spent(worked - before)
                self._raise_from_kernels()
                if interrupts:
                    raise KeyboardInterrupt
                if code == Code.NEEDS_JACOBIAN:
                    self._use(self.native.jvp, "jvp")
                elif progress is not None and seen - shown > 0.2:
                    shown = seen
                    progress((core.t - t0) / (end - t0))
                with interrupts_noted() as interrupts, self._programs_of_modes():
                    code = advance(reference)
            self._spent(time.thread_time() - worked)
            self._raise_from_kernels()
            if interrupts:
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            return Outcome(Status(StatusKind.INTERRUPTED, core.t, "Interrupted."))
        return self._outcome(Code(code))

    def _raise_from_kernels(self) -> None:
        """Raise what stopped CasADi in the middle of an evaluation, such as Ctrl-C."""
        for kernels, _, _ in self._in_use:
            if kernels.stopped:
                raise kernels.stopped.pop()

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
        if code == Code.SLIDES and self.native.integrand.switching is not None:
            return Outcome(Status(StatusKind.SLIDES, core.t, _SLIDES.format(self.native.integrand.switching.words[core.worst])))
        modes = self.native.integrand.modes
        if code in _OF_MODES and modes is not None:
            kind, message = _OF_MODES[code]
            other = (
                modes.all_words[core.other]
                if code == Code.TIED
                else _OBSTACLES[core.other]
                if code == Code.NO_DERIVATIVES
                else ""
            )
            return Outcome(Status(kind, core.t, message.format(modes.all_words[core.worst], other)))
        if code in _OF_SETS and modes is not None and modes.set is not None:
            words = modes.set.words[core.worst], modes.set.target_words[core.other]
            return Outcome(Status(StatusKind.CANNOT_SET, core.t, _OF_SETS[code].format(*words)))
        if code == Code.BEGINS_NO_NUMBER and modes is not None and modes.set is not None:
            return Outcome(Status(StatusKind.CANNOT_SET, core.t, modes.set.no_beginning(core.other)))
        if code == Code.SETS_APART and modes is not None and modes.set is not None:
            who, _, unit = modes.set.locks[core.worst].partition("|")
            return Outcome(Status(StatusKind.CANNOT_SET, core.t, _APART.format(who, f"{core.apart:.4g}{unit}")))
        kind, message = _STATUS[code]
        failed = kind is not StatusKind.SUCCESS and kind is not StatusKind.MAX_STEPS and core.worst >= 0
        return Outcome(Status(kind, core.t, message.format(core.max_steps), core.worst if failed else None))

    def solution(self, status: Status, stopped: bool = False) -> Solution:
        """What has been computed so far."""
        core, nx = self.core, self.native.nx
        if nx == 0 and core.steps == core.first:
            t, x = np.array([core.t, core.end] if core.end > core.t else [core.t]), np.zeros((0, 2 if core.end > core.t else 1))
        else:
            t, x = self._times().copy(), self._states().T.copy()
        tableau = self.choice.tableaus[core.method]
        now = time.perf_counter()
        waited, worked = (
            sum(spent(kernels, self.started, now) for kernels, _, _ in self._in_use)
            for spent in (Kernels.made_between, Kernels.compiled_between)
        )
        worked += self.native.lasting.between(self.started, now)
        modes = self.modes()
        jumps = 0 if modes is None else np.unique(modes.steps[modes.jumped]).size
        statistics = Statistics(
            self._ran(), tableau.order, core.steps - jumps, core.rejected, core.evaluations, core.iterations,
            now - self.started - waited, core.factorisations, self.kinds, waited + worked, core.work,
        )  # fmt: skip
        events = (core.event_times, core.event_guards, core.event_directions)
        found = [np.ctypeslib.as_array(e, (core.events,)).tolist() for e in events] if core.events else [[], [], []]
        crossings = tuple(Crossing(*event) for event in zip(*found, strict=True))
        return Solution(t, x, self.dense, statistics, status, crossings, stopped, True, self._kept(), modes, self.coarse)

    def modes(self) -> ModesMet | None:
        """Masks of all steps, and where they changed."""
        core, integrand = self.core, self.native.integrand
        modes = integrand.modes
        if modes is None:
            return None
        t, rows, count = self._times(), modes.reactions, core.transitions
        if not count:  # it did not begin
            return ModesMet.none(float(t[0]), integrand.masks, rows)
        steps, which = (np.ctypeslib.as_array(part, (count,)).copy() for part in (core.transition_steps, core.transition_rows))
        impulses, masks = (
            np.ctypeslib.as_array(part, (count, n)).copy()
            for part, n in ((core.impulses, 2 * rows), (core.transition_masks, integrand.masks))
        )
        after = np.minimum(steps + 1, t.size - 1)
        jumped = (after > steps) & (t[after] - t[steps] <= _INSTANT * np.maximum(np.abs(t[steps]), abs(t[0])))
        return ModesMet(t[steps], masks.T, steps, which, impulses[:, :rows], impulses[:, rows:], jumped)

    @property
    def _ends(self) -> int:
        """Ends of steps that are kept, the start among them."""
        return self.core.steps - self.core.first + 1

    def _times(self) -> np.ndarray:
        return _view(self.core.times, self._ends)

    def _states(self) -> np.ndarray:
        return _view(self.core.states, self._ends * self.native.nx).reshape(self._ends, self.native.nx)

    def _kept(self) -> Kept | None:
        """What of the steps; None where all of all."""
        n = self._ends - 1
        if not n:
            return None
        offset, stages = (_view(part, n, np.int_) for part in (self.core.offset, self.core.stage_count))
        return None if (offset >= 0).all() else Kept(np.where(stages < 0, -stages, 1), offset >= 0)

    def _ran(self) -> str:
        """The methods that made the steps."""
        core, tableaus = self.core, self.choice.tableaus
        if self.choice.newton is not Newton.WHERE_SLOW:
            return tableaus[0].name
        gauss = "gauss with Newton" if core.newton_steps > core.radau_steps else "gauss"
        if not core.radau_steps:
            return gauss
        if core.radau_steps == core.steps:
            return "radau"
        return f"{gauss}, then radau" if core.method else f"{gauss} and radau in turns"

    def dense(self, times: np.ndarray) -> np.ndarray:
        """States (nx, n) at times (n,) between the first and the last step. Raises `SimulationError` where the run has to be repeated, and is another
        one then."""
        nx = self.native.nx
        order = np.argsort(times, kind="stable")
        wanted = np.ascontiguousarray(times[order], dtype=float)
        found = np.empty((wanted.size, nx))
        if nx and not self._dense(wanted, found):
            self._repeat(wanted, found)
        result = np.empty((nx, wanted.size))
        result[:, order] = found.T
        return result

    def coarse(self, times: np.ndarray) -> np.ndarray:
        """The same by the steps' own polynomials, of lower order inside of steps; by one thread only, as long as nobody else has the run."""
        fine = (
            ctypes.pointer(self.core.fine.contents) if self.core.fine else None
        )  # another pointer: the field's own changes with it
        self.core.fine = None
        try:
            return self.dense(times)
        finally:
            self.core.fine = fine

    def _dense(self, wanted: np.ndarray, found: np.ndarray) -> bool:
        """States into `found` (n, nx) at ascending times; whether all the steps are kept in which they lie."""
        with self._programs_of_modes():
            code = self.native.library.dense(ctypes.byref(self.core), wanted.size, _address(wanted), _address(found))
        if code == Code.INPUT_FAILED and self.error is not None:
            raise self.error
        return code != Code.NOT_KEPT

    def _repeat(self, wanted: np.ndarray, found: np.ndarray) -> None:
        """The same as `_dense`, by running again, and keeping the steps that are asked for: as many at a time as there is room for."""
        problem, x0, t0, t1, accuracy = self._begun
        t, kept = self._times(), self._kept()
        steps = np.ones(t.size - 1, dtype=int) if kept is None else kept.steps
        row = np.clip(np.searchsorted(t, wanted, side="right") - 1, 0, t.size - 2)
        size = 8 * (max(tableau.stages for tableau in self.choice.tableaus) + 1) * self.native.nx
        others = np.diff(row, prepend=-1) > 0
        number = np.cumsum(others | (steps[row] > 1)) - 1  # of steps that are asked for, at most
        parts = np.flatnonzero(np.diff(number // max(1, BUDGET // size), prepend=-1))
        for first, last in zip(parts, [*parts[1:], wanted.size], strict=True):
            here, end = np.ascontiguousarray(wanted[first:last]), int(row[last - 1]) + 1
            end += end + 1 < t.size and t[end + 1] == t[end]  # a jump that follows belongs to the step
            accuracy = replace(accuracy, max_steps=int(steps[:end].sum()))
            run = Run(self.native, replace(problem, read=here), x0, t0, t1, accuracy, self.choice)
            run.core.budget = 1
            status = run.advance(t1).status
            if status.kind is StatusKind.INTERRUPTED:
                raise KeyboardInterrupt
            if not (run._is_at(self, end) and run._dense(here, found[first:last])):
                raise SimulationError(
                    f"The motion is read at t = {here[0]:.6g} s, in a step that was not kept: the run is longer than memory is kept for, so it was "
                    f"repeated, and is another one now by t = {t[end]:.6g} s. Functions of time that are inputs must give the same "
                    "number whenever they are asked; or ask for `samples` that are as close as you need them.", None,
                )  # fmt: skip

    def _is_at(self, other: Run, row: int) -> bool:
        """Whether this run stands where another one stood."""
        mine, its = self._states(), other._states()
        return bool(self._times()[-1] == other._times()[row]) and np.array_equal(mine[-1], its[row])


@contextlib.contextmanager
def interrupts_noted() -> Generator[list[int], None, None]:
    """Ctrl-C within is noted in the list and raised by nobody: raised at the door of a function that C calls, it would be lost."""
    noted: list[int] = []
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield noted
        return
    signal.signal(signal.SIGINT, lambda number, _: noted.append(number))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _view(pointer: Any, count: int, kind: Any = float) -> np.ndarray:
    """So many numbers of eight bytes (count,) in the runtime's memory."""
    return np.frombuffer(memoryview((ctypes.c_char * (8 * count)).from_address(ctypes.addressof(pointer.contents))), kind)


def _address(array: np.ndarray) -> int:
    return array.ctypes.data


def native_problem(integrand: Integrand, how: How = How.AUTO) -> NativeProblem | None:
    """Kernels for `Problem`s with these functions; None where the runtime cannot be had.

    Raises `ExportError` where a function has no C, or the compiler fails.
    """
    library = runtime()
    if library is not None and library.library.integrator_size() != ctypes.sizeof(Integrator):
        raise ExportError("The integrators in C are of another version than this process: were sources changed? Start it again.")
    return None if library is None else NativeProblem(integrand, how, library)


class SharedProblems:
    """Kernels of one problem, made when first asked for. Those that CasADi evaluates belong to one integration at a time, and are not kept."""

    def __init__(self) -> None:
        self._kept: dict[How, NativeProblem | None] = {}

    def of(self, how: How, make: Callable[[], NativeProblem | None]) -> NativeProblem | None:
        """The kept ones, or what `make` gives."""
        if how is How.CASADI:
            return make()
        if how not in self._kept:
            self._kept[how] = make()
        return self._kept[how]
