"""What is asked of a model in whatever states it is: all that do not follow from others, or coordinates of a chart."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.arguments import ascending, expressions, finite, truth
from acausal.collocation.problem import Accuracy
from acausal.language.expression import Expression, Input, Parameter
from acausal.language.when import when
from acausal.outputs.functions import Functions, operations
from acausal.start.anew import AbstractDecided
from acausal.start.decided import check_decided
from acausal.start.initial import InitialState
from acausal.start.situation import InputValues, ParameterValues, Situation, StartValues
from acausal.start.states import finite_states

if TYPE_CHECKING:
    from acausal.analysis.actuation import Unknown
    from acausal.analysis.conditions import Steady
    from acausal.analysis.equilibrium import Equilibrium
    from acausal.analysis.inverse_dynamics import InverseDynamics
    from acausal.analysis.linearize import Linearization
    from acausal.analysis.prescribed import Given
    from acausal.export.simulator import Beginning
    from acausal.simulate.sensitivity import Sensitivities, TrajectoryFunction, Wanted
    from acausal.simulate.simulation import Options, Progress
    from acausal.simulate.trajectory import Trajectory


class AbstractModel(ABC):
    """Equations of motion x' = f(t, x, u, p), and the questions that they answer in any states x, which are named in `state_names`.

    Where a time, start values or parameters are left out, they are those of the model itself.
    """

    @property
    @abstractmethod
    def functions(self) -> Functions:
        """Named CasADi functions of the states: dynamics, energies, constraints, outputs."""

    @property
    @abstractmethod
    def _decided(self) -> AbstractDecided:
        """The same for parameters, times and places at which other things may have to be decided."""

    @abstractmethod
    def _situation(
        self,
        start: StartValues | None,
        t0: float | None,
        inputs: InputValues | None,
        parameters: ParameterValues | None,
        clock: str = "start t0",
    ) -> Situation:
        """What a question is about. Raises `StartValueError`, `OptionError`, `UnknownVariableError`, `ParameterError`."""

    @abstractmethod
    def _motion(self, here: AbstractDecided, at: Situation, end: float, options: Options) -> Trajectory:
        """The motion that `simulate` asks for."""

    def _named(self, wanted: Any) -> Any:
        return self._decided.system.flat.symbols(wanted)

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
        return self._decided.system.degrees_of_freedom

    @property
    def operations(self) -> int:
        """Arithmetic operations of the explicit dynamics x' = f(t, x, u, p)."""
        return operations(self.functions.staged_dynamics)

    def initial_state(
        self,
        start: StartValues | None = None,
        *,
        t0: float | None = None,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
    ) -> InitialState:
        """Consistent states x, and the p that belongs to them, from start values; see `simulate` for the arguments and errors."""
        at = self._situation(start, t0, inputs, parameters)
        return self._initial(self._decided.with_loops_at(at.p), at)  # with the states of `functions`, which others use

    def _initial(self, here: AbstractDecided, at: Situation) -> InitialState:
        found, space = at.initial(here.functions), here.functions.space
        return replace(found, x=space.restricted(found.x), p=space.extended(at.t0, found.x, found.p))

    def simulate(
        self,
        end: float,
        start: StartValues | None = None,
        *,
        rtol: float = 1e-8,
        atol: float | None = None,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
        t0: float | None = None,
        method: str = "auto",
        order: int | None = None,
        step: float | None = None,
        max_step: float | None = None,
        samples: int | Sequence[float] | np.ndarray = 501,
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
        method has them; no step is longer than `max_step` [s]. `samples`: number of equally spaced times in the result, or these times [s];
        read others with `run.at`. Of long runs only steps with samples or events stay in memory; others are made again where they are read.
        `events`: zeros of expressions, `ac.when(...)`, found in `run.events`.
        A run that has ended is looked at: where its constraints or its energy balance are off by far more than the tolerance explains, an
        `AccuracyWarning` says by how much, since when and why. Energy is left out where parts of one's own do not say what they store and
        lose, and all of it with a fixed `step`.
        Raises `StartValueError`, `UnknownVariableError`, `ParameterError`, and `SimulationError` (with what was computed) unless
        `raise_on_failure` is off. `compiled`: kernels are interpreted, and compiled in the background where that pays, to the same
        bits; off, CasADi's virtual machine evaluates them (slower, and an independent check). Ctrl-C raises `KeyboardInterrupt`, whose `run` is what was computed.
        """
        from acausal.simulate.simulation import Options

        accuracy = Accuracy.asked(rtol, atol, step, max_steps, max_step)
        end = finite(end, "simulate: the end [s]")
        options = Options.asked(
            accuracy, method, samples, compiled, raise_on_failure, order=order, progress=progress, events=events
        )
        at = self._situation(start, t0, inputs, parameters)
        return self._decided.answer(at.p, lambda here: self._motion(here, at, end, options))

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
        t, accuracy = ascending(times, "sensitivities: `times`", 1), Accuracy.asked(rtol, atol, None, max_steps)
        by = expressions(self._named(wrt), "sensitivities: `wrt`", "wrt=[scene.stiffness, scene.hinge.q]")
        return self._sensitivities(
            self._situation(start, float(t[0]), inputs, parameters), t, by, accuracy, truth(compiled, "sensitivities: compiled")
        )

    def _sensitivities(
        self, at: Situation, times: np.ndarray, wrt: Sequence[Wanted], accuracy: Accuracy, compiled: bool
    ) -> Sensitivities:
        from acausal.simulate.sensitivity_run import sensitivity_run

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
        `hessian_approximation="limited-memory"`. NaN where values are not finite, a start cannot be assembled or a motion fails; its `failure` says why.
        Keep a reference to it as long as it is used.
        """
        from acausal.simulate.sensitivity import Motion, TrajectoryFunction

        by = tuple(expressions(self._named(wrt), "trajectory_function: `wrt`", "wrt=[scene.stiffness, scene.hinge.q]"))
        t, accuracy = ascending(times, "trajectory_function: `times`"), Accuracy.asked(rtol, atol)
        run = functools.partial(
            self._sensitivities, times=t, wrt=by, accuracy=accuracy, compiled=truth(compiled, "trajectory_function: compiled")
        )
        at = self._situation(start, float(t[0]), inputs, parameters)
        return TrajectoryFunction(name, Motion(self.functions, run, at, t, outputs, by))

    def linearize(
        self,
        start: StartValues | Sequence[float] | np.ndarray | None = None,
        *,
        states: Sequence[Expression] | None = None,
        outputs: Sequence[Expression] = (),
        t: float | None = None,
        inputs: InputValues | None = None,
        parameters: ParameterValues | None = None,
    ) -> Linearization:
        """The linear system A, B, C, D of small deviations, with eigenvalues, frequencies, modes and stability.

        `start`: of the point, found as by `simulate`, or all states (nx,) in the order of `state_names`. The linear system has independent states only; the
        small turn of a quaternion is `...rotation`. Parts that open, stick or slide stay in the mode that the point is in, which is printed. `states`: other ones, expressions with one entry for each freedom, or fewer where the rest is
        ignorable (a wheel's place and heading). `outputs`: expressions; the states by default. Derivatives are exact.
        Raises `OptionError` (states that are dependent or too few, singular loops), `StartValueError`, `UnknownVariableError`.
        """
        from acausal.analysis.linearize import linearize
        from acausal.analysis.mode_at import in_its_mode
        from acausal.analysis.point import operating_point

        given = None if start is None or isinstance(start, Mapping) else finite_states(self.state_names, start)
        at = self._situation(start if isinstance(start, Mapping) else None, t, inputs, parameters, "time t")

        def answer(here: AbstractDecided) -> Linearization:
            x = None if given is None else here.functions.space.expanded(at.t0, given, self._with_constants(here, at))
            point = in_its_mode(here.whole, operating_point(here.whole, at, x), "linearize")
            check_decided(here.system, point.t, point.x, point.p)
            return linearize(here.functions, here.whole, point, self._named(states), self._named(outputs))

        return self._decided.answer(at.p, answer)

    def _with_constants(self, here: AbstractDecided, at: Situation) -> np.ndarray:
        """All parameters, constants of integration as in the sketch."""
        space = here.functions.space
        return (
            at.p if space.p.numel() == at.p.size else space.extended(at.t0, replace(at, start={}).initial(here.functions).x, at.p)
        )

    def equilibrium(
        self,
        start: StartValues | None = None,
        *,
        free: Sequence[Input | Parameter] = (),
        steady: Steady = (),
        t: float | None = None,
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

        def answer(here: AbstractDecided) -> Equilibrium:
            found = equilibrium(here.functions, here.whole, at, *asked)
            there = here.at(found.point.p)  # of those that were free
            if there is not here:
                found = equilibrium(there.functions, there.whole, replace(at, p=found.point.p), *asked)
                there.functions.decisions.check(found.point.p)
            check_decided(there.system, found.point.t, found.point.x, found.point.p)
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
        branch of loops. Contacts that are closed at the start, and friction that sticks, do so all along: `demands` of the result tell what that asks of them.
        Friction that the motions make slip acts against its slip, whichever way that goes; while it stands, against the way that it went.
        Raises `MotionError` where the mechanism cannot follow or the forces do not suffice, `OptionError`, `UnknownVariableError`.
        """
        from acausal.analysis.inverse_dynamics import inverse_dynamics, times_of

        t = times_of(times)
        at = self._situation(start, float(t[0]), inputs, parameters)
        return self._decided.answer(
            at.p, lambda here: inverse_dynamics(here.functions, here.whole, at, t, self._named(motions), unknowns)
        )

    def inverse_dynamics_function(self, variables: Sequence[Expression], unknowns: Sequence[Unknown]) -> ca.Function:
        """CasADi function (t, x, a, u, p) -> force: the forces (n,) of `unknowns` that give `variables` the accelerations a (m,), m <= n.

        a: of a position its second, of a velocity its first derivative (in general the first one on which the forces act). x must be
        consistent; NaN where t, x and p would need other equations (see `decisions`). The least forces where there is a choice. Raises `OptionError`, `MotionError`.
        """
        from acausal.analysis.inverse_dynamics import inverse_dynamics_function

        return inverse_dynamics_function(self.functions, self._decided.whole, self._named(variables), unknowns)

    def step(self, method: str = "gauss", order: int = 4, h: float | None = None) -> ca.Function:
        """One implicit step as a differentiable CasADi `Function` (t, x, u, p, h) -> (x_next, residual).

        `method`: "gauss" (even order) or "radau" (odd order). With a fixed `h` [s] the function has no argument h. Loops are closed again
        after the step, in positions and velocities, as `simulate` does.
        `residual`: what is left of the stage equations, to be checked; infinite also where p or t are such that the model would need other
        equations (see `decisions`). Raises `OptionError` for an order that does not exist.
        """
        from acausal.integrators.step import step_of

        return step_of(self.functions, method, order, h)

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
        inputs: InputValues | None = None,
    ) -> Path:
        """Write instances of the model's motion in C, and a program around them, that need nothing else; returns the folder.

        They start from `start`. `name`: what all their names begin with; `outputs`: expressions that they compute, by names; `events`: zeros that
        they look for; `inputs`: numbers, `ac.samples`, splines and expressions of `ac.time`. See `acausal.export.simulator`.
        """
        from acausal.export.simulator import export_simulator

        return export_simulator(folder, self._beginning(start, parameters, inputs), name=name, outputs=outputs, events=events)

    def export_fmu(
        self,
        path: str | Path,
        start: StartValues | None = None,
        parameters: ParameterValues | None = None,
        *,
        outputs: Mapping[str, Expression] | None = None,
        events: Sequence[when] = (),
        inputs: InputValues | None = None,
    ) -> Path:
        """Write the model's motion as a unit for co-simulation (FMI 2.0), a file such as "arm.fmu" that other programs take; returns the file.

        Parameters and start values (`start.hinge.q`) can be set there, inputs from one communication point to the next; `outputs`: expressions by names, else the
        states. The rest is as for `export_simulator`. Needs a C compiler. See `acausal.export.fmu`.
        """
        from acausal.export.fmu import export_fmu

        return export_fmu(path, self._beginning(start, parameters, inputs), outputs=outputs, events=events)

    def _beginning(self, start: StartValues | None, parameters: ParameterValues | None, inputs: InputValues | None) -> Beginning:
        """What a motion that leaves the package begins with."""
        from acausal.export.simulator import Beginning

        at = self._situation(start, None, inputs, parameters)
        here = self._decided.at(at.p)
        return Beginning(here.functions, self._initial(here, at), at.signal(here.functions), at.discretes(here.functions))
