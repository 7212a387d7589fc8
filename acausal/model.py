"""The model: one object that answers everything about a scene, and `build`, which makes it."""

from __future__ import annotations

import copy
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.arguments import ascending, finite, listed
from acausal.collocation.problem import Accuracy
from acausal.dynamics.system import mechanical_system
from acausal.errors import LockedError, ModelError
from acausal.language.component import System
from acausal.language.expression import Expression, Input, Parameter, Variable, time
from acausal.language.flatten import flatten
from acausal.outputs.functions import Functions, operations
from acausal.parts.part_check import check_parts
from acausal.reduce.reduce import ReducedSystem, reduce_system
from acausal.simulate.events import when
from acausal.start.anew import Decided
from acausal.start.decided import check_decided
from acausal.start.initial import InitialState
from acausal.start.situation import InputValues, ParameterValues, Situation, StartValues, situation
from acausal.topology.build_mechanism import build_mechanism
from acausal.topology.fields import with_field_forces
from acausal.wording import counted

if TYPE_CHECKING:
    from acausal.analysis.actuation import Unknown
    from acausal.analysis.conditions import Steady
    from acausal.analysis.equilibrium import Equilibrium
    from acausal.analysis.inverse_dynamics import InverseDynamics
    from acausal.analysis.linearize import Linearization
    from acausal.analysis.prescribed import Given
    from acausal.explain.constraint_table import ConstraintTable
    from acausal.explain.decision_table import DecisionTable
    from acausal.minimal.model import MinimalModel
    from acausal.simulate.sensitivity import Sensitivities, TrajectoryFunction, Wanted
    from acausal.simulate.simulation import Progress
    from acausal.simulate.trajectory import Trajectory
    from acausal.start.branches import Branches


@dataclass(frozen=True, repr=False)
class Model:
    """A reduced scene with its CasADi functions. Made by `build`; never changes."""

    system: ReducedSystem

    @property
    def functions(self) -> Functions:
        """Named CasADi functions: dynamics, energies, constraints, outputs."""
        return self._decided.functions

    @functools.cached_property
    def _decided(self) -> Decided:
        return Decided(self.system)

    def _situation(
        self,
        start: StartValues | None,
        t0: float,
        inputs: InputValues | None,
        parameters: ParameterValues | None,
        clock: str = "start t0",
    ) -> Situation:
        return situation(self.functions.outputs, start, t0, inputs, parameters, clock=clock)

    def _named(self, wanted: Any) -> Any:
        return self.system.flat.symbols(wanted)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states x, e.g. `hinge.q`, `hinge.v`."""
        return self.functions.state_names

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs u, in order."""
        return self.functions.input_names

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters p, in order; constants of integrated velocity constraints last (`initial_state` gives their values)."""
        return self.functions.parameter_names

    @property
    def degrees_of_freedom(self) -> int:
        """Independent velocities of the mechanism; states of scalar domains not counted."""
        return self.system.degrees_of_freedom

    @property
    def operations(self) -> int:
        """Arithmetic operations of the explicit dynamics x' = f(t, x, u, p)."""
        return operations(self.functions.explicit_dynamics)

    def initial_state(
        self,
        start: StartValues | None = None,
        *,
        t0: float = 0.0,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
    ) -> InitialState:
        """Consistent states x, and the p that belongs to them, from start values; see `simulate` for the arguments and errors."""
        at = self._situation(start, t0, inputs, parameters)
        here = self._decided.with_loops_at(at.p).functions  # with the states of `functions`, which others use
        found = at.initial(here)
        return replace(found, x=here.space.restricted(found.x), p=here.space.extended(at.t0, found.x, found.p))

    def branches(
        self,
        start: StartValues | None = None,
        *,
        by: Expression | Sequence[Expression] = (),
        t0: float = 0.0,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        searches: int = 300,
        seed: int = 0,
    ) -> Branches:
        """All ways found to assemble the scene under the same start values, e.g. elbow up and elbow down, nearest to the sketch first.

        Closed from up to `searches` beginnings: joints anywhere, and known branches with some joints turned round. Two are the same
        when their coordinates are, up to full turns; with `by`, when these expressions of positions are. Where freedom is left, the
        point nearest to the sketch is taken. There is no proof that all are found; printing says how often each was. Errors as for
        `initial_state`, `OptionError`.
        """
        from acausal.start.branch_search import branches

        at = self._situation(start, t0, inputs, parameters)
        return branches(self._decided.at(at.p).functions, at, self._named(by), searches, seed)

    def assembly_function(
        self,
        outputs: Expression | ca.SX | None,
        wrt: Expression | Sequence[Expression],
        start: StartValues | None = None,
        *,
        t0: float = 0.0,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        steps: int = 8,
        name: str = "assembly",
    ) -> ca.Function:
        """`outputs` (the states x where None) at the consistent start, as a CasADi function of the values of `wrt` (n,).

        `wrt`: parameters, inputs, and variables that have a value in `start`. For geometry in `ca.nlpsol` and `ca.Opti`: derivatives
        are exact in any order, redundant constraints allowed. The branch is that of `initial_state` with these arguments, followed
        to the values asked for in steps as short as it takes, the first a part in `steps` of the way (1: all at once); what start values
        leave free changes as little as it can from there. NaN where something cannot close there or on the way, where a hinge's axes
        would point against one another, or where no step is short enough for angles to change by less than 1 rad. Outputs that forces
        enter are by the equations for these arguments (see `decisions`). Errors as for `initial_state`, `OptionError`.
        """
        from acausal.start.assembly_function import assembly_function

        at = self._situation(start, t0, inputs, parameters)
        by = self._named([wrt] if isinstance(wrt, Expression | str) else wrt)
        if outputs is None:
            return assembly_function(self._decided.with_loops_at(at.p).functions, at, None, by, steps, name)
        return self._decided.answer(
            at.p, lambda here: assembly_function(here.functions, at, self._named(outputs), by, steps, name)
        )

    def simulate(
        self,
        end: float,
        start: StartValues | None = None,
        *,
        rtol: float = 1e-8,
        atol: float | None = None,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        t0: float = 0.0,
        method: str = "auto",
        order: int | None = None,
        step: float | None = None,
        max_step: float | None = None,
        samples: int = 501,
        progress: bool | Progress = True,
        max_steps: int = 1_000_000,
        raise_on_failure: bool = True,
        compiled: bool = True,
        events: Sequence[when] = (),
    ) -> Trajectory:
        """The motion from `t0` to `end` [s].

        `start`: values of any variables or expressions, exactly or `ac.near(...)`. `rtol`, `atol`: local error
        tolerances: each state is judged by rtol times the largest magnitude that it has met, or that the step moves it by, whatever its
        unit; `atol` [SI] is added where it is given. `inputs`: numbers, expressions of `ac.time`,
        `ac.samples(...)` and splines of scipy, whose jumps and bends end steps, or functions of time, whose jumps `ac.with_knots` tells. `parameters`: other values than at build.
        `method`: "auto", "gauss", "radau", or CasADi's "rosenbrock", "cvodes", "idas"; `order` and fixed `step` [s] where the
        method has them; no step is longer than `max_step` [s]. `samples`: number of equally spaced times in the result; interpolate with `run.at`.
        `events`: zeros of expressions, `ac.when(...)`, found in `run.events`.
        A run that has ended is looked at: where its constraints or its energy balance are off by far more than the tolerance explains, an
        `AccuracyWarning` says by how much, since when and why. Energy is left out where parts of one's own do not say what they store and
        lose, and all of it with a fixed `step`.
        Raises `StartValueError`, `UnknownVariableError`, `ParameterError`, and `SimulationError` (with what was computed) unless
        `raise_on_failure` is off. `compiled`: kernels are interpreted, and compiled in the background where that pays, to the same
        bits; off, CasADi's virtual machine evaluates them (slower, and an independent check). Ctrl-C raises `KeyboardInterrupt`, whose `run` is what was computed.
        """
        from acausal.simulate.simulation import Options, simulate

        accuracy = Accuracy.asked(rtol, atol, step, max_steps, max_step)
        end = finite(end, "simulate: the end [s]")
        options = Options.asked(
            accuracy, method, samples, compiled, raise_on_failure, order=order, progress=progress, events=events
        )
        at = self._situation(start, t0, inputs, parameters)
        return self._decided.answer(at.p, lambda here: simulate(here.functions, at, end, options))

    def sensitivities(
        self,
        times: Sequence[float],
        wrt: Sequence[Wanted],
        start: StartValues | None = None,
        *,
        rtol: float = 1e-8,
        atol: float | None = None,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        max_steps: int = 1_000_000,
        compiled: bool = True,
    ) -> Sensitivities:
        """Derivatives of the motion at `times` [s], the first of which is the start, with respect to `wrt`.

        `wrt`: parameters, inputs (as constants), and variables that have an exact value in `start`. Other arguments and errors as for
        `simulate`. Forward sensitivities of the numerical motion itself, carried along with it: exact to the tolerance.
        """
        t, accuracy = ascending(times, "sensitivities: `times`"), Accuracy.asked(rtol, atol, None, max_steps)
        by = listed(self._named(wrt), "sensitivities: `wrt`", "wrt=[scene.stiffness, scene.hinge.q]")
        return self._sensitivities(self._situation(start, float(t[0]), inputs, parameters), t, by, accuracy, compiled)

    def _sensitivities(
        self, at: Situation, times: np.ndarray, wrt: Sequence[Wanted], accuracy: Accuracy, compiled: bool
    ) -> Sensitivities:
        from acausal.simulate.simulation import sensitivity_run

        return self._decided.answer(at.p, lambda here: sensitivity_run(here.functions, at, times, wrt, accuracy, compiled))

    def trajectory_function(
        self,
        times: Sequence[float],
        outputs: Expression,
        wrt: Sequence[Wanted],
        start: StartValues | None = None,
        *,
        rtol: float = 1e-8,
        atol: float | None = None,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        name: str = "trajectory",
        compiled: bool = True,
    ) -> TrajectoryFunction:
        """`outputs` at `times` [s] as a CasADi function of the values of `wrt` (n,): (n,) -> (size of outputs, times).

        It has exact first derivatives (see `sensitivities`) in both directions, for `ca.nlpsol` and `ca.Opti`; give the optimiser
        `hessian_approximation="limited-memory"`. Keep a reference to it as long as it is used.
        """
        from acausal.simulate.sensitivity import Motion, TrajectoryFunction

        by = tuple(listed(self._named(wrt), "trajectory_function: `wrt`", "wrt=[scene.stiffness, scene.hinge.q]"))
        t, accuracy = ascending(times, "trajectory_function: `times`"), Accuracy.asked(rtol, atol)
        run = functools.partial(self._sensitivities, times=t, wrt=by, accuracy=accuracy, compiled=compiled)
        at = self._situation(start, float(t[0]), inputs, parameters)
        return TrajectoryFunction(name, Motion(self.functions, run, at, t, outputs, by))

    def linearize(
        self,
        start: StartValues | Sequence[float] | np.ndarray | None = None,
        *,
        states: Sequence[Expression] | None = None,
        outputs: Sequence[Expression] = (),
        t: float = 0.0,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
    ) -> Linearization:
        """The linear system A, B, C, D of small deviations, with eigenvalues, frequencies, modes and stability.

        `start`: of the point, found as by `simulate`, or all states (nx,). The linear system has independent states only; the small turn
        of a quaternion is `...rotation`. `states`: other ones, expressions with one entry for each freedom, or fewer where the rest is
        ignorable (a wheel's place and heading). `outputs`: expressions; the states by default. Derivatives are exact.
        Raises `OptionError` (states that are dependent or too few, singular loops), `StartValueError`, `UnknownVariableError`.
        """
        from acausal.analysis.linearize import linearize
        from acausal.analysis.point import operating_point

        given = None if start is None or isinstance(start, Mapping) else self._whole_states(t, start, parameters)
        at = self._situation(start if isinstance(start, Mapping) else None, t, inputs, parameters, "time t")

        def answer(here: Decided) -> Linearization:
            point = operating_point(here.whole, at, given)
            check_decided(here.system, point.t, point.x, point.p)
            return linearize(here.whole, point, self._named(states), self._named(outputs))

        return self._decided.answer(at.p, answer)

    def _whole_states(
        self, t: float, x: Sequence[float] | np.ndarray, parameters: ParameterValues | None
    ) -> Sequence[float] | np.ndarray:
        """All coordinates and velocities of the tree for states x, constants of integration as in the sketch; x of another size as it is."""
        if not self.functions.space.elimination.symbols or len(x) != len(self.state_names):
            return x
        p = self.initial_state(parameters=parameters, t0=t).p
        return self.functions.space.expanded(t, np.array(x, dtype=float), p).tolist()

    def minimal(
        self,
        start: StartValues | None = None,
        *,
        prefer: Sequence[Variable] = (),
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        t0: float = 0.0,
        steps: int = 8,
    ) -> MinimalModel:
        """The equations of motion in independent coordinates around a start state: the fewest states, no invariants.

        `prefer`: variables that are to be independent where that is well conditioned; never needed. `steps`: at least 4, Newton steps from
        the start to a state of a loop: each reaches about 0.4 rad of its motion farther. Others as for `simulate`. Raises `StartValueError`
        at singular positions, `OptionError` for a preference that is no state.
        """
        from acausal.minimal.model import minimal_model

        at = self._situation(start, t0, inputs, parameters)
        return self._decided.answer(at.p, lambda here: minimal_model(here.whole, at, self._named(prefer), steps))

    def equilibrium(
        self,
        start: StartValues | None = None,
        *,
        free: Sequence[Input | Parameter] = (),
        steady: Steady = (),
        t: float = 0.0,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
    ) -> Equilibrium:
        """The equilibrium nearest to `start`, or the steady motion, with the values of `free` inputs and parameters that it needs.

        `start`: where to look. `ac.exactly(...)` is held; anything else is met as well as an equilibrium allows, and with enough free
        inputs exactly (a robot's trim). `steady`: instead of everything at rest, these expressions stay as they are, or change at the
        rates of a dictionary, {scene.precession.q: 2.0}; a rate of None is found, and constant. Which of several equilibria is found
        depends on the start only; stability is in the result.
        Raises `EquilibriumError` where there is none, `StartValueError`, `OptionError`, `UnknownVariableError`.
        """
        from acausal.analysis.equilibrium import equilibrium

        at = self._situation(start, t, inputs, parameters, "time t")
        asked = self._named(free), self._named(steady)

        def answer(here: Decided) -> Equilibrium:
            found = equilibrium(here.whole, at, *asked)
            there = here.at(found.point.p)  # of those that were free
            if there is not here:
                found = equilibrium(there.whole, replace(at, p=found.point.p), *asked)
                there.functions.decisions.check(found.point.p)
            check_decided(there.system, found.point.t, found.x, found.point.p)
            return found

        return self._decided.answer(at.p, answer)

    def inverse_dynamics(
        self,
        times: Sequence[float],
        motions: Mapping[Expression, Given],
        unknowns: Sequence[Unknown],
        start: StartValues | None = None,
        *,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
    ) -> InverseDynamics:
        """The forces that make variables move as prescribed, at `times` [s], and the whole motion with them.

        `motions`: {variable or expression: expression in `ac.time`, function of time, number, or samples at `times`}. `unknowns`: inputs,
        joints (the forces along their velocities), or expressions of positions (forces that work on their rates). More forces than motions:
        the least, by the sum of squares. What motions leave open moves by its own dynamics from `start`, which also selects the
        branch of loops.
        Raises `MotionError` where the mechanism cannot follow or the forces do not suffice, `OptionError`, `UnknownVariableError`.
        """
        from acausal.analysis.inverse_dynamics import inverse_dynamics, times_of

        t = times_of(times)
        at = self._situation(start, float(t[0]), inputs, parameters)
        return self._decided.answer(at.p, lambda here: inverse_dynamics(here.whole, at, t, self._named(motions), unknowns))

    def inverse_dynamics_function(self, variables: Sequence[Expression], unknowns: Sequence[Unknown]) -> ca.Function:
        """CasADi function (t, x, a, u, p) -> force: the forces (n,) of `unknowns` that give `variables` the accelerations a (m,), m <= n.

        a: of a position its second, of a velocity its first derivative (in general the first one on which the forces act). x must be
        consistent; NaN where t, x and p would need other equations (see `decisions`). The least forces where there is a choice. Raises `OptionError`, `MotionError`.
        """
        from acausal.analysis.inverse_dynamics import inverse_dynamics_function

        return inverse_dynamics_function(self._decided.whole, self._named(variables), unknowns)

    def step(self, method: str = "gauss", order: int = 4, h: float | None = None) -> ca.Function:
        """One implicit step as a differentiable CasADi `Function` (t, x, u, p, h) -> (x_next, residual).

        `method`: "gauss" (even order) or "radau" (odd order). With a fixed `h` [s] the function has no argument h. Loops are closed again
        after the step, in positions and velocities, as `simulate` does.
        `residual`: what is left of the stage equations, to be checked; infinite also where p or t are such that the model would need other
        equations (see `decisions`). Raises `OptionError` for an order that does not exist.
        """
        from acausal.integrators.step import step_of

        return step_of(self.functions, method, order, h)

    def graph(self) -> Any:
        """The mechanism as a networkx multigraph: nodes are rigid groups, edges joints, cut joints and forces."""
        return self.system.mechanics.mechanism.graph

    def draw_graph(self, path: str | Path | None = None) -> Any:
        """A picture of `graph()`; returns the matplotlib figure, and writes it to `path` if given."""
        from acausal.visual.graph import draw_graph

        return draw_graph(self.graph(), path)

    def report(self) -> str:
        """In words: freedoms by component, states, operations, what was merged, cut and dropped, and why."""
        from acausal.explain.report import report

        return report(str(self), self.functions)

    def constraints(self) -> ConstraintTable:
        """Every constraint: what it forbids, holonomic or not, kept or dropped; and what velocity constraints keep constant."""
        from acausal.explain.constraint_table import constraint_table

        return constraint_table(self.system)

    @functools.cached_property
    def decisions(self) -> DecisionTable:
        """What was decided by numbers, at which values and by which margin: rows of loops that follow from others, singular positions, branches,
        coordinates in closed form, coefficients that were divided by. Every call looks at its own parameters, start and time again; it is
        refused, or answered by a model decided anew, where one does not hold.
        """
        from acausal.explain.decision_table import decision_table

        return decision_table(self.functions)

    def equations(self) -> Any:
        """The equations of motion as sympy equations, for small scenes; see `acausal.export.sympy_equations`."""
        from acausal.export.sympy_equations import equations

        return equations(self.functions)

    def export_c(self, folder: str | Path) -> Path:
        """Write C source, header and a build line for the model's functions; returns the folder."""
        from acausal.export.c_source import export_c

        return export_c(self.functions, folder)

    def export_simulator(
        self,
        folder: str | Path,
        start: StartValues | None = None,
        parameters: ParameterValues | None = None,
        *,
        name: str = "simulator",
        outputs: Mapping[str, Expression] | None = None,
        events: Sequence[when] = (),
    ) -> Path:
        """Write instances of the model's motion in C, and a program around them, that need nothing else; returns the folder.

        They start from `start`. `name`: what all their names begin with; `outputs`: expressions that they compute, by names; `events`: zeros that
        they look for. See `acausal.export.simulator`.
        """
        from acausal.export.simulator import export_simulator

        at = self._situation(start, 0.0, None, parameters)
        here = self._decided.at(at.p)
        initial = Model(here.system).initial_state(start, parameters=parameters)
        return export_simulator(here.functions, folder, initial, name=name, outputs=outputs, events=events)

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (self.system,)

    def __deepcopy__(self, memo: dict[int, Any]) -> Model:
        """Itself, since it never changes; that of the copied scene where the scene is copied along with it, and before it."""
        system = copy.deepcopy(self.system, memo)
        return self if system is self.system else Model(system)

    def __repr__(self) -> str:
        return f"<Model {self}>"

    def __str__(self) -> str:
        s = self.system
        m = s.constraints.jacobian.shape[0]
        constraints = counted(m, "constraint") if m else "no constraints"
        dropped = len(s.constraints.redundant) + len(s.constraints.vanishing)
        if s.constraints.damped:  # these are used, too: alone, the others allow more branches
            constraints += f", {len(s.constraints.redundant)} of them redundant when assembled"
            dropped = len(s.constraints.vanishing)
        constraints += f" ({counted(dropped, 'redundant row')} dropped)" if dropped else ""
        return (
            f"{s.flat.name}: {counted(self.degrees_of_freedom, 'degree')} of freedom, {counted(len(self.state_names), 'state')}, {constraints}, "
            f"{self.operations} operations, {counted(s.u.numel(), 'input')}, {counted(s.p.numel(), 'parameter')}"
        )


def build(scene: System) -> Model:
    """From a scene to its model: flatten, topology, mechanics, reduce. Errors from the tree in `acausal.errors`."""
    if not isinstance(scene, System):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
        what = (
            f"the class {scene.__name__}, not one of it: write build({scene.__name__}())"
            if isinstance(scene, type)
            else repr(scene)
        )
        raise ModelError(
            f"build() takes a System of parts, e.g. scene = ac.System(); scene.world = World(); it was given {what}."
        )
    flat = flatten(scene)
    if not flat.parts:
        raise ModelError(
            f"The scene '{flat.name}' has no parts. Assign some: scene.world = World(), scene.rod = RigidBody.rod(...)."
        )
    flat = with_field_forces(flat)
    check_parts(flat)
    model = Model(reduce_system(mechanical_system(build_mechanism(flat), time.sx)))
    if model.system.x.numel() == 0 and not model.system.moves_as_given:
        scalar = "Without inertia and mass everything is where its springs balance: add an Inertia, a SlidingMass, or a motion that is given."
        hint = scalar if model.system.solved else "Add a joint or a free body."
        raise LockedError(f"Nothing in the scene '{flat.name}' can move: {', '.join(p.path for p in flat.parts[:8])}. {hint}")
    return model
