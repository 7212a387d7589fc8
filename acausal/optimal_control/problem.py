"""Optimal control of a model: what is given, what is bounded, what is minimised, in the variables of the scene."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, cast

import casadi as ca
import numpy as np

from acausal.arguments import dictionary, finite, whole_number
from acausal.errors import OptionError, UnknownVariableError
from acausal.language.expression import Expression, InputRate, Parameter
from acausal.numerics.folding import folded_function
from acausal.optimal_control.asked import GIVEN, Asked, Limits, Total
from acausal.optimal_control.checks import check_given, check_problem
from acausal.optimal_control.conditions import beside
from acausal.optimal_control.controller import Controller
from acausal.optimal_control.guess import HELD, Guess, closed, path_guess, run_guess
from acausal.optimal_control.language import Cost, free
from acausal.optimal_control.mesh import Mesh, Mesher
from acausal.optimal_control.mode import phase_mode
from acausal.optimal_control.natural import natural_length
from acausal.optimal_control.optimum import Optimum
from acausal.optimal_control.solving import best_of
from acausal.optimal_control.stage import Stage
from acausal.optimal_control.swings import other_guesses
from acausal.optimal_control.whole import Part
from acausal.outputs.expression_names import expression_name
from acausal.outputs.functions import Functions
from acausal.outputs.state_units import state_units
from acausal.start.assembly_function import start_units
from acausal.start.initial import InitialState, exactly, near
from acausal.start.states import start_values

if TYPE_CHECKING:
    from acausal.simulate.trajectory import Trajectory


_ASIDE = (0.0, 0.1, 0.5)
"""By how much of what is much for each state a search for what is wanted begins beside."""


_STILL = 1e-8
"""Of where the scene is farthest off zero, in units of each position: nothing moves by less, beside rounding."""


Goal = Callable[[Stage, np.ndarray], dict[Expression, Any]]
"""A stage, and states (nx,) where it begins -> values of expressions where it ends."""


class Simulated(Protocol):
    """What is asked of a model."""

    @property
    def functions(self) -> Functions:
        """CasADi functions of the model."""
        ...

    @property
    def initial_state(self) -> Callable[..., InitialState]:
        """Consistent states, from start values."""
        ...

    @property
    def simulate(self) -> Callable[..., Trajectory]:
        """The motion until a time, from start values."""
        ...


class OptimalControl:
    """The best motion of a model, and the inputs that make it.

    `time`: its length [s], a number or `ac.free(least, most)`. All inputs of the model are found; those not to be found are given as numbers in
    `inputs`. `parameters`: other values than at build. `t0` [s]: where the model's time begins. `modes`: what parts that open, stick and slide do
    all the time, {part: "closed"} ("open" where nothing is said, "sticks", "slides", "slides +", "slides -"); see `ac.phases`.

        ocp = ac.OptimalControl(model, time=2.0)
        ocp.start({s.rail.q: 0, s.hinge.q: 0})
        ocp.end({s.rail.q: 1, s.hinge.q: np.pi, s.rail.v: 0, s.hinge.v: 0})
        ocp.bound(s.force, -20, 20)
        ocp.minimise(ac.integral(s.force**2))
        best = ocp.solve()

    Direct collocation (Radau) in residual form; loops are closed at every point. Every solution is replayed by `simulate` (see `Optimum`).
    """

    def __init__(
        self,
        model: Simulated,
        time: float | free,
        *,
        modes: Mapping[Any, str] | None = None,
        inputs: Any = None,
        parameters: Any = None,
        t0: float = 0.0,
    ) -> None:
        if not isinstance(getattr(model, "functions", None), Functions):
            raise OptionError(f"OptimalControl: {model!r} is no model. Build it: ac.OptimalControl(ac.build(scene), ...).")
        self.model, self._functions = model, model.functions
        self._mode = phase_mode(self._functions, dictionary(modes or {}, "modes", "{scene.foot: 'sticks'}"))
        rates = [entry.of for entry in self._mode.inputs if isinstance(entry, InputRate) and not isinstance(entry.of, InputRate)]
        led = [entry for entry in rates if entry in self._functions.outputs.system.led]
        if led:
            raise OptionError(
                f"OptimalControl: the input {self.name(led[0])} stands in nonlinear equations, whose solution jumps with it, which is not found here. Let its rate be the input, and itself a "
                "state: signals.Integrator behind an ac.Input."
            )
        if rates:
            raise OptionError(
                f"OptimalControl: the input {self.name(rates[0])} prescribes a place, an angle or a speed, and by its rates moves the scene, too, which are not found here. Let an acceleration be the "
                "input (AccelerationSource, AngularAccelerationSource) and bound the place, or prescribe it by an expression of ac.time."
            )
        self._t0 = finite(t0, "OptimalControl: t0 [s]")
        self._time = _duration(time)
        self._parameters: dict[Parameter, float] = dict(self.symbols(parameters or {}, "parameters"))
        self._inputs: dict[Any, float] = dict(self.symbols(inputs or {}, "inputs"))
        self._start: dict[Expression, Any] | None = None
        self._opened: dict[Expression, free] = {}
        self._limited: list[tuple[Expression, Any, Any]] = []
        self._here: list[tuple[float, dict[Expression, Any]]] = []
        self._totals: list[tuple[Cost, float, float, str]] = []
        self._geometry: dict[Parameter, free] = {}
        self._turns: dict[Expression, float] | None = None
        self._drifting: tuple[Expression, ...] = ()
        self._cost = Cost()
        self._guess: Optimum | Trajectory | None = None

    @property
    def duration(self) -> Cost:
        """The length of the motion [s], as a cost."""
        return Cost(duration=1.0)

    def start(self, values: Any) -> None:
        """Start values of variables, as for `simulate`: what is not given is chosen there, velocities zero where they can be. A value
        `ac.free(lower, upper)` is found with the motion. Without any call everything about the start is free.
        """
        given = self.symbols(values, "start")
        self._opened = {k: v.checked(self.name(k)) for k, v in given.items() if isinstance(v, free)}
        self._start = {k: v for k, v in given.items() if not isinstance(v, free)}

    def end(self, values: Any) -> None:
        """Values of variables and expressions at the end; a pair (lower, upper) leaves room."""
        self.at(1.0, values)

    def at(self, part: float, values: Any) -> None:
        """Values of variables and expressions when this part of the duration (0 ... 1) has passed; pairs (lower, upper) leave room."""
        where = finite(part, "at: the part of the duration")
        if not 0 <= where <= 1:
            raise OptionError(f"at({part:g}, ...): give a part of the duration between 0 and 1.")
        self._here.append((where, dict(self.symbols(values, "at" if where < 1 else "end"))))

    def bound(self, expression: Expression | str | Cost, lower: Any = -np.inf, upper: Any = np.inf) -> None:
        """Limits that an expression keeps at all points of the mesh: numbers, or one for each entry; None: no limit. Reactions, contact forces, powers, distances.
        Of an `ac.integral`, an `ac.average` or a sum of such: two numbers for the whole motion.
        """
        if isinstance(expression, Cost):
            name = self._total_name(expression)
            low, high = (float(v[0]) for v in _ordered((lower, upper), name, 1))
            self._totals.append((expression, low, high, name))
            return
        (wanted,) = self.symbols({expression: 0.0}, "bound")
        _ordered((lower, upper), self.name(wanted), None)
        self._limited.append((wanted, lower, upper))

    def periodic(self, turns: Any = None, drift: Sequence[Expression | str] = ()) -> None:
        """The motion ends as it began, each of `turns` {variable: number} full turns on; states in `drift` may end anywhere."""
        self._turns = {k: 2 * np.pi * finite(v, "periodic: turns") for k, v in self.symbols(turns or {}, "periodic").items()}
        units = state_units(self._functions)
        for k in np.flatnonzero(self.by_state(self._turns)):
            if units[k] not in ("rad", ""):
                raise OptionError(
                    f"periodic: {self._functions.state_names[k]} [{units[k]}] makes no turns; only angles do. What goes on from turn to turn is said by drift=[...]."
                )
        self._drifting = tuple(self.symbols(dict.fromkeys(drift, 0.0), "periodic: drift"))

    def optimise(self, parameter: Parameter | str, lower: float, upper: float, guess: float | None = None) -> None:
        """A parameter of the scene (a mass, a length, a stiffness) that is found with the motion, between bounds."""
        (wanted,) = self.symbols({parameter: 0.0}, "optimise")
        if not isinstance(wanted, Parameter):
            raise OptionError(
                f"optimise: {self.name(wanted)} is no parameter. Make it one: scene.length = ac.Parameter(0.4, 'm')."
            )
        system = self._functions.outputs.system
        built = self._parameters.get(wanted, float(system.p_values[system.flat.parameters.index(wanted)]))
        inside = built if guess is None and lower <= built <= upper else guess
        self._geometry[wanted] = free(lower, upper, inside).checked(self.name(wanted))

    def minimise(self, cost: Cost) -> None:
        """What is to be least: a sum of `ac.integral`, `ac.average`, `ac.at_start`, `ac.at_end` and `duration`."""
        if not isinstance(cost, Cost):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            name = self.name(cost)
            raise OptionError(
                f"minimise: {name} says not when it counts. Write ac.integral({name}), ac.at_end({name}), or ocp.duration."
            )
        self._cost = cost

    def guess(self, motion: Optimum | Trajectory) -> None:
        """Where the search begins: a motion of the same model, found or simulated. Otherwise a smooth path from the start through what is asked
        for, driven as inverse dynamics says.
        """
        same = motion.model is self.model if isinstance(motion, Optimum) else self._is_of_model(motion)
        if not same:
            raise OptionError(f"guess: {motion!r} is no motion of this model. Give a run of its own `simulate`, or an optimum.")
        self._guess = motion

    def _is_of_model(self, motion: Any) -> bool:
        return getattr(getattr(motion, "functions", None), "outputs", None) is self._functions.outputs

    def solve(
        self,
        intervals: int = 20,
        *,
        order: int = 5,
        controls: str = "free",
        solver: str = "ipopt",
        tolerance: float = 1e-6,
        refinements: int = 4,
        guesses: int = 4,
        options: Mapping[str, Any] | None = None,
    ) -> Optimum:
        """The best motion near the guess, or near the best of several.

        `intervals`: of the first mesh; intervals whose replay is off by more than `tolerance`, relative to what each state varies by, are divided up to
        `refinements` times, and not where that would cost much more than ten seconds for each of them. `order`: odd, of Radau collocation. `controls`: "free" (a polynomial in each interval), "constant" in each, or "linear" in each and continuous. `solver`: "ipopt"; "fatrop"
        eliminates one interval after the other, "piqp" solves quadratic programs one after the other with exact curvatures; where these lead to no least cost, or nothing is in stages, ipopt searches. `options`: of CasADi's `ipopt`. `guesses`: so many other paths are tried at first, and the best is kept, where `guess` was not said, motions are not linear, and that is cheap.
        Raises `OptimalControlError` with the last iterate where none is found.
        """
        part = self.part(Mesher(intervals, order, controls, solver))
        others = other_guesses([part], whole_number(guesses, "solve: guesses", 0))
        return best_of([part], [], solver, dict(options or {}), tolerance, refinements, others).phases[0]

    def part(self, mesher: Mesher, begin: Mapping[Expression, Any] | None = None, goal: Goal | None = None) -> Part:
        """As it is given to the solver. `begin`: start values near which the guess begins, where there are none of its own; `goal`: what it comes near to at its end, by where it begins."""
        mesh = mesher.mesh([at for at, _ in self._here])
        asked, stops, units = self._asked(mesher.controls, begin, goal)
        bent = functools.partial(self._path, asked.stage, stops, mesh, units)
        first = self._told(asked.stage, mesh) or bent(0.0, None)
        measured = self._measured(asked, units, first)
        check_problem(asked, first, self.name)
        if self._mode.gaps.numel() + self._mode.speeds.numel():
            check_given(asked, self._given_at_start(asked.stage), measured[: asked.stage.sizes[0]], first)
        return Part(self.model, asked, mesh, first, measured, self._given, bent if self._guess is None else None)

    def controller(
        self,
        rate: float,
        intervals: int = 20,
        *,
        order: int = 5,
        controls: str = "constant",
        solver: str = "ipopt",
        options: Mapping[str, Any] | None = None,
    ) -> Controller:
        """States x -> inputs u, from this problem from x on in each call, warm started; `rate` [s]: the time between two calls, for which the inputs are to be held.

        `solver`: "ipopt" solves it each time, where Newton's steps from the plan before do not (with `options` always); "piqp" (or another solver of quadratic programs in CasADi) makes one step from the plan before, in a fraction of that time, for a
        convex cost and a fixed duration, and falls back to ipopt where such a step fails.
        """
        every = finite(rate, "controller: the rate [s]")
        if not every > 0:
            raise OptionError(f"controller: the rate must be positive, not {every:g} s.")
        if self._start is None or self._opened:
            open_ones = ", ".join(self.name(key) for key in self._opened) or "everything"
            raise OptionError(
                f"controller: {open_ones} is free at the start, where the state takes its place. Say the start without ac.free: ocp.start({{scene.hinge.q: 0.3}})."
            )
        best = self.solve(intervals, order=order, controls=controls, refinements=0)
        return Controller(best, every, solver, dict(options or {}))

    @property
    def found(self) -> tuple[Parameter, ...]:
        """Parameters that are found with the motion."""
        return tuple(self._geometry)

    @property
    def given(self) -> tuple[Parameter, ...]:
        """Parameters that were given other values than at build."""
        return tuple(self._parameters)

    @property
    def _given(self) -> dict[str, Any]:
        """Arguments of `simulate`."""
        return {"parameters": self._parameters, "t0": self._t0}

    def _asked(
        self, controls: str, near_start: Mapping[Expression, Any] | None, goal: Goal | None
    ) -> tuple[Asked, list[tuple[float, np.ndarray]], np.ndarray]:
        """The problem in unknowns of a stage; stops of a path as a guess; what is much for each unknown."""
        f, model = self._functions, self.model
        if f.space.elimination.constants.numel():
            raise OptionError(
                "Optimal control of scenes with integrated velocity constraints (a wheel rolling along a line whose place is open) is not supported."
            )
        usual = {} if self._start is not None else near_start or {}
        opened = {k: near(np.full(f.outputs.resolve(k).numel(), v.guess)) for k, v in self._opened.items()}
        starts = {**usual, **(self._start or {}), **opened}
        begin = model.initial_state(starts, inputs=self._inputs, **self._given)
        stage = Stage(self._mode, self._t0, begin.p[: f.outputs.system.p_values.size], tuple(self._geometry))
        here = [(at, self._limits(stage, key, value)) for at, values in self._here for key, value in values.items()]
        # what loops close with other lengths follows from what is given
        following = self._opened or (self._geometry and f.invariants is not None)
        if self._start is not None and following:
            here.insert(0, (0.0, self._open_start(stage, begin.x)))
        path = [self._limits(stage, key, (lower, upper)) for key, lower, upper in self._limited]
        path += [self._limits(stage, key, value) for key, value in self._inputs.items()]
        path += [Limits(value, np.zeros(value.numel()), np.full(value.numel(), np.inf), name) for value, name in stage.bounds]
        totals = [(_total(stage, total, "bound"), low, high, name) for total, low, high, name in self._totals]
        units = self._units(stage, begin)
        asked = Asked(
            stage, path, here, None if self._start is None or following else self._begun(stage, begin.x, units), self._more_at_the_end(),
            _total(stage, self._cost, "minimise"), totals, controls, np.array([self._time.lower, self._time.upper]),
            np.array([[v.lower, v.upper] for v in self._geometry.values()]).reshape(-1, 2),
        )  # fmt: skip
        stops = self._stops(stage, begin, units, goal, rests=asked.linear)
        return asked, stops, self._units(stage, begin, np.ptp([x for _, x in stops], axis=0))

    def _stops(
        self, stage: Stage, begin: InitialState, units: np.ndarray, goal: Goal | None, *, rests: bool
    ) -> list[tuple[float, np.ndarray]]:
        """Parts of the duration, and states (nx,) nearest to those before that are as asked for then. What moves goes on, unless it `rests`, as where all is linear and any guess
        does.
        """
        stops = [(0.0, self._closed(stage, 0.0, begin.x, units, [*(self._start or {}), *self._opened]))]
        told = {} if goal is None else goal(stage, stops[0][1])
        for at in sorted({at for at, _ in self._here} | ({1.0} if told else set())):
            values = told if at == 1.0 else {}
            values |= {key: value for where, own in self._here if where == at for key, value in own.items()}
            wanted = {
                key: np.mean(np.asarray([_numbers(v) for v in _pair(value)], dtype=float), axis=0)
                for key, value in values.items()
                if _finite(value)
            }
            if at > 0:
                before, found = stops[-1], self._stop(stage, begin, stops[-1][1], wanted)
                on = self._gone_on(stage, before, (at, found), rests=rests)
                found = self._stop(stage, begin, before[1] + on, wanted) if on.any() else found
                stops.append((at, self._closed(stage, at, found, units, [*wanted])))
        more = self._more_at_the_end()
        if more is not None:
            ends, stops = [x for at, x in stops if at == 1.0], [stop for stop in stops if stop[0] < 1.0]
            drifted = ends[0] if ends else stops[-1][1] + self._gone_on(stage, stops[-1], (1.0, begin.x), rests=rests)
            stops.append((1.0, np.where(np.isnan(more), drifted, begin.x + more)))
        if stops[-1][0] < 1.0:
            stops.append((1.0, stops[-1][1] + self._gone_on(stage, stops[-1], (1.0, stops[-1][1]), rests=rests)))
        return stops

    def _gone_on(
        self, stage: Stage, before: tuple[float, np.ndarray], after: tuple[float, np.ndarray], *, rests: bool
    ) -> np.ndarray:
        """(nx,): by how much positions on which nothing depends go on from one part of the duration and states (nx,) to others, with the mean of the speeds at both."""
        time, nq = float(self._time.guess or 1.0), stage.functions.space.nq
        found = np.zeros(before[1].size)
        if stage.indifferent.any() and not rests:
            more = np.append(time, self._free_guess)
            mean = sum(stage.drift(x, at, more) for at, x in (before, after)) / 2
            found[:nq] = np.where(stage.indifferent, mean * time * (after[0] - before[0]), 0.0)
        return found

    def _stop(
        self,
        stage: Stage,
        begin: InitialState,
        before: np.ndarray,
        wanted: Mapping[Expression, Any],
    ) -> np.ndarray:
        """States (nx,) near those `before` that are as wanted; from beside these where they are stationary for what is wanted, as a pendulum that hangs."""
        f, told = self._functions, self._near_states(stage, wanted)
        rest = np.concatenate(
            [
                np.zeros(stage.width - before.size),
                [self._time.guess or 1.0],
                [float(v.guess or 0.0) for v in self._geometry.values()],
            ]
        )
        value = stage.slopes(ca.vertcat(ca.SX(0, 1), *(stage.opened(key) for key in told)))
        asked = np.concatenate([np.zeros(0), *(np.ravel(one.value) for one in told.values())])

        def missed(x: np.ndarray) -> float:
            return float(np.linalg.norm(np.array(value(np.concatenate([x, rest]), [1.0, 0.0])[0]).ravel() - asked))

        units, found = self._units(stage, begin)[: before.size], list[np.ndarray]()
        for aside in _ASIDE:
            moved = before + aside * units * np.random.default_rng(0).uniform(-1, 1, before.size)
            near_by = start_values(f, f.space.expanded(self._t0, moved, begin.p))
            kept = {key: near(one, 1e-3) for key, one in near_by.items() if key not in wanted}
            found.append(self.model.initial_state({**kept, **told}, inputs=self._inputs, **self._given).x)
            if missed(found[-1]) <= 1e-3 * missed(before):
                return found[-1]
        return min(found, key=missed)

    def _closed(self, stage: Stage, at: float, x: np.ndarray, units: np.ndarray, said: Sequence[Expression]) -> np.ndarray:
        """States (nx,) of a stop with what is closed or sticks in this mode closed: what is `said` of that part of the duration stays, as far as it can, and all else follows."""
        if not self._mode.gaps.numel():
            return x
        easy = np.where(_having_to_do_with(stage, said), HELD, 1.0) * units[: x.size]
        return closed(stage, x[None, :], np.array([at]), float(self._time.guess or 1.0), self._free_guess, easy)[0]

    def _begun(self, stage: Stage, x: np.ndarray, units: np.ndarray) -> np.ndarray:
        """States (nx,) at the start with what is closed or sticks closed: what was not said follows from that, as the height of who stands."""
        said = list(self._start or {})
        held = _having_to_do_with(stage, said)
        return self._closed(stage, 0.0, np.where(held, x, self._closed(stage, 0.0, x, units, said)), units, said)

    def _more_at_the_end(self) -> np.ndarray | None:
        """By what states (nx,) are more than at the start where the motion is periodic, NaN what drifts."""
        if self._turns is None:
            return None
        drifting = np.isnan(self.by_state(dict.fromkeys(self._drifting, np.nan)))
        return np.where(drifting, np.nan, self.by_state(self._turns))

    def _open_start(self, stage: Stage, first: np.ndarray) -> Limits:
        """What is given; what is free, between its bounds; then all states as they are at the guess, as far as they do not follow from these."""
        limits = self._given_at_start(stage)
        limits += [self._limits(stage, k, (v.lower, v.upper)) for k, v in self._opened.items()]
        said = tuple(one.entry(r) for one in limits for r in range(one.value.numel()))
        limits.append(Limits(self._functions.space.x, first, first, GIVEN))
        value, lower, upper = zip(*((one.value, one.lower, one.upper) for one in limits), strict=True)
        return Limits(ca.vertcat(*value), np.concatenate(lower), np.concatenate(upper), GIVEN, said)

    def _given_at_start(self, stage: Stage) -> list[Limits]:
        given = {k: v.value if isinstance(v, exactly) else v for k, v in (self._start or {}).items() if not isinstance(v, near)}
        return [self._limits(stage, k, np.asarray(_numbers(v), dtype=float)) for k, v in given.items()]

    def _told(self, stage: Stage, mesh: Mesh) -> Guess | None:
        """The motion that was given as a guess."""
        if self._guess is None or isinstance(self._guess, Optimum):
            return None if self._guess is None else self._guess.motion
        return run_guess(stage, self._guess, self._free_guess, np.append(0.0, mesh.points.ravel()))

    @property
    def _free_guess(self) -> np.ndarray:
        """Of free parameters."""
        return np.array([v.guess for v in self._geometry.values()], dtype=float)

    def _path(
        self,
        stage: Stage,
        stops: list[tuple[float, np.ndarray]],
        mesh: Mesh,
        units: np.ndarray,
        bend: np.ndarray | float,
        duration: float | None = None,
        around: int = -1,
    ) -> Guess:
        """A smooth path, with its positions off by `bend` (times, nq), in this time [s] or as long as is guessed; `around`: the quaternion that turns the long way."""
        return path_guess(
            stage,
            stops,
            np.append(0.0, mesh.points.ravel()),
            duration or float(self._time.guess or 1.0),
            self._free_guess,
            units,
            turned=self.by_state(self._turns or {}) != 0,
            sought=self._sought(stage, stops[0][1], units),
            bend=bend,
            around=around,
        )

    def _sought(self, stage: Stage, x: np.ndarray, units: np.ndarray) -> np.ndarray:
        """(nx,): which positions are told on the way or at the end."""
        nx, nq = x.size, stage.functions.space.nq
        told = ca.vertcat(ca.SX(0, 1), *(stage.opened(key) for at, values in self._here if at > 0 for key in values))
        rest = np.concatenate(
            [np.zeros(stage.width - nx), [self._time.guess or 1.0], [float(v.guess or 0.0) for v in self._geometry.values()]]
        )
        much = np.append(units[:nx], np.ones(rest.size))
        z = beside(stage, np.append(x, rest), much, 1.0)
        slope, closing = stage.slopes(told)(z, [1.0, 0.0])[1], stage.slopes_of(stage.closing, z, 1.0) * units[:nx]
        found = np.array(slope).reshape(-1, nx) * units[:nx]
        left = np.abs(found - (np.linalg.pinv(closing, 1e-9) @ closing @ found.T).T)
        of_places = left[np.max(left[:, nq:], axis=1, initial=0.0) <= 1e-9 * np.max(left[:, :nq], axis=1, initial=0.0)]
        return np.max(of_places, axis=0, initial=0.0) > 1e-6 * np.max(of_places, initial=0.0)

    def _units(self, stage: Stage, begin: InitialState, ways: np.ndarray | None = None) -> np.ndarray:
        """(width,), by how far states (nx,) go from stop to stop, as far as that is known: lengths and angles as the search for a start measures them, the others by the duration; inputs by their bounds, 0 where they have none."""
        space, system, time = stage.functions.space, stage.functions.outputs.system, float(self._time.guess or 1.0)
        positions, rates = start_units(begin)
        states = np.concatenate([positions[: system.nq], rates / time])[list(space.places)]
        nq, nv = space.nq, space.velocities
        nx, _, loops, inputs = stage.sizes
        drive = np.zeros(inputs)
        for expression, lower, upper in self._limited:
            for k, entry in enumerate(self._mode.inputs):
                if expression is entry:
                    drive[k] = max((abs(float(v)) for v in (lower, upper) if np.isfinite(v)), default=0.0)
        if not begin.account.problem.coordinates.size:
            z = np.concatenate([begin.x, np.zeros(stage.width - nx), [time], self._free_guess])
            lengths = np.array([unit.split("/")[0] == "m" for unit in state_units(stage.functions)])
            states[lengths] *= natural_length(
                stage, z, states, np.append(np.zeros(loops), drive), np.zeros(nx) if ways is None else ways
            )
        return np.concatenate([states, states[nq : nq + nv] / time, np.zeros(loops), drive])

    def _measured(self, asked: Asked, units: np.ndarray, first: Guess) -> np.ndarray:
        """(width,): these units, all lengths times one factor and all angles times another, by how far and how fast the guess moves, or by what inputs within their bounds move where
        it rests; multipliers, and inputs that are
        not bounded, by what they are in it, and by what inertia resists.
        """
        stage, found = asked.stage, units.copy()
        nx, nv, _, inputs = stage.sizes
        nq, last = stage.functions.space.nq, stage.width - inputs
        kinds = np.array([unit.split("/")[0] for unit in state_units(stage.functions)])
        far = np.ptp(first.values[:, :nx], axis=0)
        far[nq:] = np.max(np.abs(first.values[:, nq:nx]), axis=0, initial=0.0)
        moves = far / units[:nx]
        moves[moves <= _STILL * np.max(np.abs(first.values[:, :nq]) / units[:nq], initial=0.0)] = 0.0
        more = np.append(first.duration, first.free)
        slope = np.abs(stage.slopes_of(stage.driving, np.append(first.values[0], more), 0.0))
        reach = _reach(asked, slope, units)
        for kind in ("m", "rad"):
            own = np.flatnonzero((kinds == kind) & (np.arange(nx) < nq + nv))
            factor = np.max(moves[own], initial=0.0) or np.max(reach[own], initial=0.0)
            found[own] *= factor if factor > 0 else 1.0
        found[nx : nx + nv] *= found[nq : nq + nv] / units[nq : nq + nv]
        found[nq + nv : nx] = _scalars(asked, first)
        inertia = np.max(slope[:, :nv] * found[nx : nx + nv], axis=1, initial=0.0)
        moving = inertia > 0
        acting = np.max(slope[moving, nv:] / inertia[moving, None], axis=0, initial=0.0)
        acting[last - nx - nv :] = np.maximum(acting[last - nx - nv :], _acting_on_scalars(asked, first, found))
        size, bounded = np.max(np.abs(first.values), axis=0), {k for k, *_ in asked.entries}
        for k in [k for k in range(nx + nv, stage.width) if k < last or k not in bounded or not found[k] > 0]:
            push = 1 / acting[k - nx - nv] if acting[k - nx - nv] > 0 else 0.0
            found[k] = max(push, size[k]) or 1.0
        return found

    def _limits(self, stage: Stage, key: Expression, value: Any) -> Limits:
        column = stage.opened(key)
        lower, upper = _ordered(_pair(value), self.name(key), column.numel())
        return Limits(column, lower, upper, self.name(key))

    def by_state(self, values: Mapping[Expression, float]) -> np.ndarray:
        """(nx,): what is said of states, 0 of others."""
        space, outputs = self._functions.space, self._functions.outputs
        found = np.zeros(space.x.numel())
        numbers = {space.x[k].element_hash(): k for k in range(space.x.numel())}
        for key, value in values.items():
            column = ca.vec(outputs.opened(key))
            for e in range(column.numel()):
                k = numbers.get(column[e].element_hash()) if column[e].is_symbolic() else None
                if k is None:
                    raise OptionError(
                        f"periodic: {self.name(key)} is no state of the model. It has: {', '.join(self._functions.state_names[:12])}."
                    )
                found[k] = value
        return found

    def _near_states(self, stage: Stage, values: Mapping[Expression, Any]) -> dict[Expression, Any]:
        """Of these values those that a start can be given, as near as can be."""
        space, t = self._functions.space, self._functions.outputs.system.t
        states, fixed = ({s.element_hash() for s in ca.symvar(part)} for part in (space.x, ca.vertcat(space.p, t)))
        found: dict[Expression, Any] = {}
        for key, value in values.items():
            column = stage.opened(key)
            inside = {s.element_hash() for s in ca.symvar(column)}
            if inside & states and inside <= states | fixed:
                found[key] = near(np.broadcast_to(np.ravel(value, order="F"), (column.numel(),)), 1e3)
        return found

    def symbols(self, values: Any, what: str) -> dict[Any, Any]:
        given = dictionary(values, what, "{scene.hinge.q: 0.3}")
        found = self._functions.outputs.system.flat.symbols(given)
        for key in found:
            if not isinstance(key, Expression):
                raise UnknownVariableError(f"{what}: {key!r} is no variable or expression of the scene.")
        return dict(found)

    def name(self, key: Any) -> str:
        """In words: an expression by the names of what stands in it."""
        return expression_name(self._functions.outputs, key) if isinstance(key, Expression) else repr(key)

    def _total_name(self, cost: Cost) -> str:
        """In words."""
        kinds = (
            ("the integral of {}", cost.integrals),
            ("the average of {}", cost.averages),
            ("{} at the start", cost.starts),
            ("{} at the end", cost.ends),
        )
        said = [words.format(self.name(one)) for words, own in kinds for one in own]
        return " plus ".join([*said, *(["the duration"] if cost.duration else [])])


def _having_to_do_with(stage: Stage, said: Sequence[Expression]) -> np.ndarray:
    """(nx,): which states stand in what is said."""
    told = stage.put(ca.vertcat(ca.SX(0, 1), *(stage.opened(key) for key in said)))
    return np.array(ca.which_depends(told, stage.unknowns[: stage.sizes[0]], 1, False), dtype=bool)


def _total(stage: Stage, cost: Cost, what: str) -> Total:
    """In unknowns of a stage."""

    def added(kind: str) -> ca.SX:
        found = sum((stage.opened(one) for one in getattr(cost, kind)), ca.SX(0))
        if found.numel() != 1:
            raise OptionError(
                f"{what}: among {kind} is one of {found.numel()} entries. Give a number: its square, its norm, or one entry."
            )
        return found

    return Total(added("integrals"), added("averages"), added("starts"), added("ends"), cost.duration)


def _reach(asked: Asked, slope: np.ndarray, units: np.ndarray) -> np.ndarray:
    """(nx,): how fast inputs that are bounded make velocities from rest, alone, in units of each, and of angles no more than one: they count by their sines; 0 where nothing is
    known. `slope` (rows, width - nx): of the equations of motion.
    """
    stage = asked.stage
    nx, nv, _, inputs = stage.sizes
    nq, found = stage.functions.space.nq, np.zeros(nx)
    bounded = sorted(
        {
            k
            for k, limits, r in asked.entries
            if k >= stage.width - inputs and np.isfinite([limits.lower[r], limits.upper[r]]).all()
        }
    )
    inertia = np.diag(slope[:nv, :nv]) * units[nx : nx + nv]
    push = np.max(slope[:nv, [k - nx for k in bounded]] * units[bounded], axis=1, initial=0.0)
    found[nq : nq + nv] = np.where(inertia > 0, push / np.where(inertia > 0, inertia, 1.0), 0.0)
    turning = np.array([unit.startswith("rad") for unit in state_units(stage.functions)])
    return np.where(turning, np.minimum(found, 1.0), found)


def _scalars(asked: Asked, first: Guess) -> np.ndarray:
    """What is much for each state (n,) that neither is a place nor a speed: what it is at most in the guess and within its bounds, and what its rate there makes of it
    in that time; 1 where all that vanishes.
    """
    stage = asked.stage
    nx, begin = stage.sizes[0], stage.functions.space.nq + stage.sizes[1]
    rates = ca.Function("rates", [stage.unknowns, stage.data], [stage.put(stage.rates[begin:, :])])
    more = np.tile(np.append(first.duration, first.free), (first.times.size, 1))
    changes = first.duration * np.array(rates(np.hstack([first.values, more]).T, np.vstack([first.times, 0.0 * first.times])))
    both = np.hstack([first.values[:, begin:nx].T, changes])
    size = np.max(np.where(np.isfinite(both), np.abs(both), 0.0), axis=1, initial=0.0)
    for k, limits, r in asked.entries:
        if begin <= k < nx:
            said = [abs(v) for v in (limits.lower[r], limits.upper[r]) if np.isfinite(v)]
            size[k - begin] = max(size[k - begin], *said, 0.0)
    return np.where(size > 0, size, 1.0)


def _acting_on_scalars(asked: Asked, first: Guess, units: np.ndarray) -> np.ndarray:
    """(inputs,): by how much one of each changes rates of states that neither are places nor speeds, at most, relative to what is much for these: what they vary by in that time, and
    what states of these `units` make of them. Nothing is said of angles, which count by their sines.
    """
    stage = asked.stage
    nx, begin, inputs = stage.sizes[0], stage.functions.space.nq + stage.sizes[1], stage.sizes[3]
    slopes = ca.jacobian(stage.put(stage.rates[begin:, :]), stage.unknowns)
    function = folded_function("slopes", [stage.unknowns, stage.data], [ca.densify(slopes)])
    more = np.append(first.duration, first.free)
    size = np.zeros((nx - begin, stage.width))
    for z, at in zip(first.values, first.times, strict=True):
        there = np.abs(np.array(function(np.append(z, more), [at, 0.0]))[:, : stage.width])
        size = np.maximum(size, np.where(np.isfinite(there), there, 0.0))
    much = np.maximum(units[begin:nx] / first.duration, np.max(size[:, :nx] * units[:nx], axis=1, initial=0.0))
    found = np.max(size[:, stage.width - inputs :] / much[:, None], axis=0, initial=0.0)
    return np.where([entry.unit == "rad" for entry in stage.mode.inputs], 0.0, found)


def _duration(time: Any) -> free:
    if isinstance(time, free):
        found = time.checked("The time [s]")
        if not found.lower > 0 or not np.isfinite(found.upper):
            raise OptionError(
                f"OptimalControl: the time is free between {time.lower:g} and {time.upper:g} s. Give finite, positive bounds."
            )
        return found
    length = finite(time, "OptimalControl: the time [s]")
    if length <= 0:
        raise OptionError(f"OptimalControl: the time must be positive, not {length:g} s.")
    return free(length, length, length)


def _ordered(pair: tuple[Any, Any], name: str, entries: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper limits of `entries` numbers. Raises `OptionError` where nothing lies between them."""
    try:
        lower, upper = (_limit(v, none) for v, none in zip(pair, (-np.inf, np.inf), strict=True))
        lower, upper = (
            np.broadcast_arrays(lower, upper) if entries is None else (np.broadcast_to(v, (entries,)) for v in (lower, upper))
        )
    except (TypeError, ValueError, OverflowError):
        said = pair[0] if pair[0] is pair[1] else pair
        raise OptionError(
            f"{name}: {said!r} does not fit{'' if entries is None else f' its {entries} entries'}. Give numbers."
        ) from None
    if np.isnan(lower).any() or np.isnan(upper).any() or (lower == np.inf).any() or (upper == -np.inf).any():
        raise OptionError(f"{name} is to be between {pair[0]} and {pair[1]}: give numbers in order.")
    if np.any(lower > upper):
        raise OptionError(f"{name} is to stay above {pair[0]} and below {pair[1]}, which cross.")
    return lower, upper


def _limit(value: Any, none: float) -> np.ndarray:
    """A limit's numbers (n,); `none` where it is None."""
    if value is None:
        value = none
    elif isinstance(value, list | tuple):
        value = [none if v is None else v for v in cast(Iterable[Any], value)]
    return np.asarray(_numbers(value), dtype=float).ravel(order="F")


def _pair(value: Any) -> tuple[Any, Any]:
    return value if isinstance(value, tuple) and len(value) == 2 else (value, value)  # pyright: ignore


def _numbers(value: Any) -> Any:
    """What `ac.rotations` makes of numbers, as an array."""
    inside = value.sx if isinstance(value, Expression) else value
    constant = isinstance(inside, ca.SX) and not ca.symvar(inside)
    return np.array(ca.evalf(inside)) if constant else value


def _finite(value: Any) -> bool:
    return all(np.all(np.isfinite(np.asarray(_numbers(v), dtype=float))) for v in _pair(value))
