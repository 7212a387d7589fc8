"""Trajectories: what a simulation found, read by variable or by any expression of variables."""

from __future__ import annotations

import copy
import functools
import html
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from acausal.arguments import listed
from acausal.charts.chart import Chart
from acausal.collocation.inputs import Inputs
from acausal.collocation.modes import WithModes
from acausal.collocation.problem import Interpolant, Problem, Solution, Statistics, Status, together
from acausal.errors import OptionError
from acausal.integrators.passage import passage_of
from acausal.language.component import Component, System
from acausal.language.expression import Expression, Reaction
from acausal.language.when import when
from acausal.numerics.staged import plain
from acausal.outputs.expression_names import expression_name, expression_unit
from acausal.outputs.functions import Functions, Reading
from acausal.outputs.outputs import Outputs
from acausal.runtime.kernels import How
from acausal.runtime.series import Series
from acausal.simulate.beside import Beside
from acausal.simulate.events import Event
from acausal.simulate.piece import Piece
from acausal.simulate.transitions import ModesOfPart, Transitions, modes_of_part, strips_of, transitions_of
from acausal.start.initial import InitialState

_MOST_SIDES = 10_000
"""Transitions that are drawn as jumps."""
_TURNED, _MOST_LOOKS = 1.0, 64
"""What velocities together make in a step for which it is looked at within, so that no full turn is lost; how often at most."""

SLACK = 1e-12
"""Part of the longest time by which times may be outside of a motion, as what is computed by logarithms is."""
_DOUBTFUL, _NOTHING = 1e-6, 1e-12
"""Relative gaps of energy that may be those of what rests; energies that are rounding, beside the terms that they are the sums of."""


@dataclass(frozen=True)
class Steps:
    """Times `t` (n,) [s] and states `x` (nx, n) at the start and at ends of steps."""

    t: np.ndarray
    x: np.ndarray


def moving_energy(kinetic: float, start: float, swing: float, brought: float = 0.0) -> float:
    """The energy that moves [J]: the largest `kinetic` one, as far as that of the `start`, the `swing` of potential energy and what was `brought` in, if anything, account for
    it, and no less than the swing. What nothing accounts for is a gap in the balance, and no size.
    """
    return max(min(kinetic, start + swing + max(0.0, brought)), swing)


@dataclass(frozen=True, repr=False)
class Trajectory:
    """A motion: times `t` (n,) [s], states `x` (nx, n) of `functions`, and everything that follows from them.

    It is made of `pieces`, one after the other in time, each in states of its own. `problem`: inputs and parameters.

    `run[variable]` is the series of a variable or expression: (n,) for scalars, (n, 3) for vectors, (n, 3, 3) for rotations.
    `run.at(times)` is the same motion at other times, interpolated with the integrator's own accuracy.
    """

    functions: Functions
    problem: Problem
    pieces: tuple[Piece, ...]
    initial: InitialState
    t: np.ndarray
    watched: tuple[when, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """With states and inputs at `t` as they are: elsewhere the same bits are read, whatever would be interpolated or compiled there."""
        t, known = self.steps.t, np.concatenate([piece.solution.known for piece in self.pieces])

        def through(function: Callable[[np.ndarray], np.ndarray]) -> Interpolant:
            return Interpolant.through(function, t, known)

        def copied(problem: Problem) -> Problem:
            inputs = problem.inputs
            return replace(problem, inputs=inputs.copied(through)) if isinstance(inputs, Inputs | WithModes) else problem

        pieces = tuple(replace(piece, problem=copied(piece.problem)) for piece in self.pieces)
        return _read, (
            self.functions,
            copied(self.problem),
            pieces,
            self.initial,
            self.t,
            self.watched,
            (self.x, self.u, self._clock, self._aside),
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> Trajectory:
        """Itself, since it never changes; that of the copied scene where the scene is copied along with it, and before it."""
        if copy.deepcopy(self.functions, memo) is self.functions:
            return self
        _, parts = self.__reduce__()
        return _read(*copy.deepcopy(parts, memo))

    @property
    def solution(self) -> Solution:
        """Of the last piece, whose states are those of the motion unless it went through charts."""
        return self.pieces[-1].solution

    @functools.cached_property
    def steps(self) -> Steps:
        """The ends of steps that are kept, of all pieces."""
        if len(self.pieces) == 1 and self.pieces[0].functions is self.functions:
            return Steps(self.solution.t, self.solution.x)
        first = self.pieces[0].solution.t[:1]
        t = [first, *(piece.solution.t[1:] for piece in self.pieces)]
        x = [self.pieces[0].ends(self.functions)[:, :1], *(piece.ends(self.functions)[:, 1:] for piece in self.pieces)]
        return Steps(np.concatenate(t), np.hstack(x))

    @property
    def charts(self) -> tuple[Chart, ...]:
        """Of a minimal model, those that the motion ran through, which tell when each began."""
        return tuple(piece.chart for piece in self.pieces if piece.chart is not None)

    @property
    def trajectory(self) -> Trajectory:
        """Old name of a minimal model's motion."""
        warnings.warn(
            "motion.trajectory is the motion itself now; the old name goes with the next version.",
            DeprecationWarning,
            stacklevel=2,
        )
        return self

    @functools.cached_property
    def events(self) -> tuple[Event, ...]:
        """Zeros of the expressions given as `events`, in order of time."""
        words = {1: "rising", -1: "falling", 0: "touching"}
        events: list[Event] = []
        for piece in self.pieces:
            found = piece.solution.crossings
            x = piece.between(np.array([c.time for c in found]), self.functions) if found else np.zeros((0, 0))
            events += [Event(self.watched[c.guard], c.time, words[c.direction], x[:, k]) for k, c in enumerate(found)]
        return tuple(events)

    @functools.cached_property
    def transitions(self) -> Transitions:
        """Instants at which parts open, close, stick, slide or strike, in order of time: a table that prints itself; see `Transitions`."""
        return transitions_of(self)

    def modes(self, of: Component | Reaction | str) -> ModesOfPart:
        """What a part, or one law of it by its reaction, was doing and from when on. Raises `OptionError` for what has no laws."""
        return modes_of_part(self, of)

    def given(self, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> Trajectory:
        """Read at times (n,) in states (nx, n) and with inputs (nu, n) that are known."""
        return _read(self.functions, self.problem, self.pieces, self.initial, t, self.watched, (x, u, t, np.empty((0, 3))))

    @functools.cached_property
    def x(self) -> np.ndarray:
        """States at `t`, (nx, n): the integrator's interpolant, projected so that invariants hold between steps too."""
        return self._states[0]

    @functools.cached_property
    def _aside(self) -> np.ndarray:
        """How far [s] (n, 3) to go to either side from states next to singular positions that the motion leads straight through; no numbers elsewhere."""
        return self._states[1]

    @functools.cached_property
    def _states(self) -> tuple[np.ndarray, np.ndarray]:
        if len(self.pieces) == 1:
            return self.pieces[0].states(self.t, self.functions)
        x, aside = np.empty((len(self.functions.state_names), self.t.size)), np.empty((self.t.size, 3))
        ends = np.array([piece.solution.t[-1] for piece in self.pieces])
        owner = np.minimum(np.searchsorted(ends, self.t), len(self.pieces) - 1)
        for k in np.unique(owner):
            some = owner == k
            x[:, some], aside[some] = self.pieces[k].states(self.t[some], self.functions)
        return x, aside

    @functools.cached_property
    def _clock(self) -> np.ndarray:
        """`t`, but within rounding of a change of mode a little before or after it, as modes are there, and of the end before it where conditions go over: they are seen alike. The same where there are
        none."""
        met, t, switching = self.solution.modes, self.t, self.functions.integrand.switching
        if switching is None:
            return t
        last = self.solution.beside(self.solution.t[-1:], -_LOCATED)
        for k in np.flatnonzero(t > last):
            here, before = (
                np.array(plain(switching.sides)(at, self.x[:, k], self.u[:, k], self.problem.parameters)) for at in (t[k], last)
            )
            t = np.where((np.arange(t.size) == k) & np.any(here != before), last, t)
        changes = np.zeros(0) if met is None else met.begins[1:]
        for k in (0, -1) if changes.size else ():
            there = changes[np.clip(np.searchsorted(changes, self.t, side="right") + k, 0, changes.size - 1)]
            before, after = (self.solution.beside(there, side * _LOCATED) for side in (-1, 1))
            t = np.where((self.t >= before) & (self.t < after), np.where(self.t < there, before, after), t)
        return t

    @functools.cached_property
    def u(self) -> np.ndarray:
        """Inputs at `t`, (nu, n)."""
        return self.problem.inputs(self.t)

    @property
    def outputs(self) -> Outputs:
        """Translator of expressions."""
        return self.functions.outputs

    @property
    def status(self) -> Status:
        """How the integration ended."""
        return self.solution.status

    @property
    def statistics(self) -> Statistics:
        """Method, steps, evaluations and time of the integration."""
        return together([piece.solution.statistics for piece in self.pieces])

    def at(self, times: Sequence[float] | np.ndarray | float) -> Trajectory:
        """The motion at other times within the simulated interval [s]. Raises `OptionError` outside of it."""
        try:
            wanted = np.atleast_1d(np.asarray(times, dtype=float))
        except (TypeError, ValueError, OverflowError):
            raise OptionError(f"run.at({times!r}): give a time or a list of times [s].") from None
        first, last = self.pieces[0].solution.t[0], self.solution.t[-1]
        slack = SLACK * max(abs(first), abs(last))
        if wanted.size == 0 or np.any(wanted < first - slack) or np.any(wanted > last + slack) or not np.all(np.isfinite(wanted)):
            raise OptionError(f"run.at({times}): the motion is known from {first:g} s to {last:g} s.")
        return replace(self, t=np.clip(wanted, first, last))

    def __getitem__(self, wanted: Expression | ca.SX | str) -> np.ndarray:
        reading = self.functions.reading(self.outputs.system.flat.named(wanted) if isinstance(wanted, str) else wanted)
        values = self._values(reading)
        if reading.angle:
            values = self._unwound(reading, values)
        rows, columns = reading.shape
        if rows == columns == 1:
            return values[0]
        if columns == 1:
            return values.T
        return values.T.reshape(-1, columns, rows).transpose(0, 2, 1)

    def _values(self, reading: Reading) -> np.ndarray:
        """(rows, n)."""
        given = self._given_by_loops if reading.of_loops else self._given_by_dynamics if reading.of_dynamics else None
        values = self._evaluate(reading.series, given)
        if not reading.of_dynamics or self._beside is None:
            return values
        return self._beside.between(values, lambda run: run._values(reading), reading.of_forces)

    def _unwound(self, reading: Reading, values: np.ndarray) -> np.ndarray:
        """Angles `values` (rows, n) that are known up to full turns, with those that they have made since the start, however few times are read."""
        ends, x = self.steps.t, self.steps.x
        speed = np.sum(np.abs(x[self.problem.positions :]), axis=0)
        turned = np.diff(ends) * np.maximum(speed[:-1], speed[1:])
        looks = np.minimum(np.nan_to_num(turned / _TURNED), _MOST_LOOKS).astype(int)
        inside = np.concatenate(
            [np.zeros(0), *(np.linspace(ends[k], ends[k + 1], looks[k] + 2)[1:-1] for k in np.flatnonzero(looks))]
        )
        known = [self.given(ends, x, self.problem.inputs(ends)), *([self.at(inside)] if inside.size else [])]
        times = np.concatenate([*(other.t for other in known), self.t])
        angles = np.hstack([*(other._values(reading) for other in known), values])
        order = np.argsort(times, kind="stable")
        angles[:, order] = np.unwrap(angles[:, order], axis=1)
        return angles[:, -self.t.size :]

    def _evaluate(self, series: Series, given: np.ndarray | None = None) -> np.ndarray:
        """(rows, n): a column function at all times at once; `given` follows the inputs."""
        u = self.u if given is None else np.concatenate((self.u, given))
        native = self.problem.native
        evaluate = series.by_casadi if native is not None and native.how is How.CASADI else series
        return evaluate(self._clock, self.x, u, self.problem.parameters)

    @functools.cached_property
    def _given_by_dynamics(self) -> np.ndarray:
        return self._evaluate(self.functions.series(self.functions.given_by_dynamics))

    @functools.cached_property
    def _given_by_loops(self) -> np.ndarray:
        """With what the dynamics give before it."""
        given = self._given_by_dynamics
        return np.concatenate((given, self._evaluate(self.functions.series(self.functions.given_by_loops), given)))

    @functools.cached_property
    def _beside(self) -> Beside[Trajectory] | None:
        passage, some = passage_of(self.problem), np.flatnonzero(self._aside[:, 0] > 0)
        if passage is None or not some.size:
            return None

        def moved(tau: np.ndarray) -> Trajectory:
            times, X = passage.points(self.t[some], self.x.T[some], tau)
            return self.given(times.ravel(), X.reshape(times.size, -1).T, self.problem.inputs(times.ravel()))

        def rates(run: Trajectory) -> np.ndarray:
            return run._given_by_dynamics[: self.outputs.system.x_dot.numel()]

        far, near = self._aside[some, 0], self._aside[some, 1]
        return Beside(passage, some, moved(far), moved(near), near / far, rates)

    @functools.cached_property
    def _energies(self) -> np.ndarray:
        return self._evaluate(self.functions.series(self.functions.energies))

    @property
    def kinetic_energy(self) -> np.ndarray:
        """(n,) [J]."""
        return self._energies[0]

    @property
    def potential_energy(self) -> np.ndarray:
        """(n,) [J]."""
        return self._energies[1]

    @property
    def energy(self) -> np.ndarray:
        """Kinetic and potential energy together, (n,) [J]."""
        return self.kinetic_energy + self.potential_energy

    @functools.cached_property
    def energy_loss(self) -> np.ndarray:
        """Energy dissipated less energy supplied since the start, (n,) [J]; Gauss quadrature of the power on the interpolant, and what impacts lose."""
        return self.lost_by_power + self._lost_in_impacts

    @property
    def _lost_in_impacts(self) -> np.ndarray:
        """(n,) [J]: until these times, what happens there included."""
        met = self.transitions
        so_far = np.concatenate([[0.0], np.cumsum(met.lost_in_balance)])
        return so_far[np.searchsorted(met.times, self.t, side="right")]

    @property
    def lost_by_power(self) -> np.ndarray:
        """(n,) [J]: without what impacts lose."""
        if self.outputs.power_loss.is_zero():
            return np.zeros(self.t.size)
        ends = np.concatenate([_step_ends(piece.solution) for piece in self.pieces])
        knots = np.unique(np.concatenate([ends[ends <= self.t[-1]], self.t]))
        nodes, weights = np.polynomial.legendre.leggauss(12)
        half = np.diff(knots) / 2
        times = (knots[:-1] + half)[:, None] + half[:, None] * nodes
        loss = self.functions.series(self.functions.power_loss)
        power = replace(self, t=times.ravel())._evaluate(loss)[0].reshape(times.shape)
        total = np.concatenate([[0.0], np.cumsum((power * weights).sum(axis=1) * half)])
        return np.interp(self.t, knots, total)

    def energy_error(self) -> float:
        """Largest gap in the energy balance, relative to the largest kinetic energy or change of potential energy on the way, as far as these account for
        one another; where they are nothing but rounding, relative to the terms that the energies are the sums of. NaN where nobody knows what an input
        brings in that prescribes a place.
        """
        if not self.outputs.knows_powers:
            return float("nan")
        start = self._beginning
        lost = self.energy_loss
        balance = self.energy + lost - start.energy[0]
        steps = self.steps.t  # what moves in between counts where few samples were asked for
        between = self.at(steps[:: max(1, steps.size // 64)])
        swing = max(float(np.max(np.abs(run.potential_energy - start.potential_energy[0]))) for run in (self, between))
        moves = max(float(np.max(self.kinetic_energy)), float(np.max(between.kinetic_energy)))
        scale = moving_energy(moves, float(start.kinetic_energy[0]), swing, -float(np.min(lost)))
        total = float(np.max(np.abs(self.energy)))
        if scale < 1e-9 * total:  # all energy is held by scalar components, and stays there
            scale = total
        worst = float(np.max(np.abs(balance)))
        if worst > _DOUBTFUL * scale:
            from acausal.simulate.watch import energy_terms

            terms = energy_terms(self)
            scale = max(scale, terms if scale < _NOTHING * terms else 0.0)
        return worst / scale if scale > 0 else worst

    @property
    def _beginning(self) -> Trajectory:
        """The start, before anything strikes there."""
        t, met = self.pieces[0].solution.t[:1], self.transitions
        if len(met) and met.times[0] == t[0]:
            return self.given(t, met[0].before.x[:, None], self.problem.inputs(t))
        return self if self.t[0] == t[0] else self.at(t)

    def constraint_error(self) -> float:
        """Largest residual of any invariant (loops [m or sine of angle], their rates, quaternion norms, gaps that are closed, slips that stick); 0 without any."""
        invariants = self.functions.invariants if self.functions.modes is None else self.functions.modes.invariants
        p = np.repeat(self.problem.parameters[:, None], self.t.size, axis=1)
        held = 0.0 if invariants is None else np.array(invariants(self.t[None, :], self.x, self.u, p))
        return float(np.max(np.abs(held), initial=0.0))

    def plot(self, *expressions: Expression | str, path: str | Path | None = None) -> Any:
        """Plot series over time with matplotlib; returns the figure, and writes it to `path` if given."""
        from acausal.visual.plot import Strip, plot_series

        seen = self._with_both_sides
        series = [(self.label(e), seen[e]) for e in expressions]
        name = self.outputs.system.flat.name
        strips = [Strip(*told) for told in strips_of(self, self.t[0], self.t[-1])]
        return plot_series(seen.t, series, path=path, title=None if name == System.__name__ else name, strips=strips)

    @property
    def _with_both_sides(self) -> Trajectory:
        """With values just before and after each transition besides those at `t`."""
        met = self.transitions
        some = np.flatnonzero((met.times >= self.t[0]) & (met.times <= self.t[-1]))
        if not 0 < some.size <= _MOST_SIDES:
            return self
        sides = [met.beside(some, after) for after in range(2)]
        t = np.concatenate([met.times[some], met.times[some], self.t])
        x, u = (np.hstack([*(side[k] for side in sides), own]) for k, own in enumerate((self.x, self.u)))
        order = np.argsort(t, kind="stable")
        return self.given(t[order], x[:, order], u[:, order])

    def label(self, expression: Expression | str) -> str:
        """Name and unit for axes and tables."""
        if isinstance(expression, str):
            return self.label(self.outputs.system.flat.named(expression))
        self.outputs.resolve(expression)  # what it cannot be is said there
        name, unit = expression_name(self.outputs, expression), expression_unit(expression)
        return f"{name} [{unit}]" if unit else name

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    def __repr__(self) -> str:
        return f"<Trajectory {self}>"

    def animate(self, path: str | Path, *, speed: float | None = None) -> Path:
        """Write the motion as one self-contained HTML file; returns its path.

        `speed`: shown against real time; by default 1, slower for motions of less than two seconds, faster for those of more than a minute.
        """
        from acausal.visual.animation import write_html
        from acausal.visual.scene import animation_of

        return Path(write_html(animation_of(self, speed=speed), path))

    def picture(self, path: str | Path, *, times: Sequence[float] = ()) -> Path:
        """Write a still picture (PNG) of the mechanism at `times` [s], by default at the start; returns its path."""
        from acausal.visual.picture import write_png
        from acausal.visual.scene import animation_of

        return Path(
            write_png(
                animation_of(self),
                path,
                times=tuple(listed(times, "picture: `times`", "times=[0.0, 1.0]")) or (float(self.t[0]),),
            )
        )

    def __len__(self) -> int:
        return self.t.size

    def __str__(self) -> str:
        s = self.statistics
        compiling = f" beside {1e3 * s.compiling:.0f} ms of compiling" if s.compiling > 1e-3 else ""
        return (
            f"{self.outputs.system.flat.name}: {self.pieces[0].solution.t[0]:g} s to {self.solution.t[-1]:g} s, {self.status.kind.name}; "
            f"{s.method} order {s.order}, {s.steps} steps, {s.evaluations} evaluations, {1e3 * s.seconds:.1f} ms{compiling}"
            + "".join(f"\n  {chart}" for chart in self.charts)
        )


_LOCATED = 8
"""Times as much as is the same instant: how well it is known when a condition goes over."""


def _step_ends(solution: Solution) -> np.ndarray:
    """Times of a solution's steps; equally far apart where they are not kept."""
    if solution.kept is None:
        return solution.t
    count = solution.kept.steps
    begin, length = (np.repeat(part, count) for part in (solution.t[:-1], np.diff(solution.t) / count))
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.append(begin + within * length, solution.t[-1])


def _read(
    functions: Functions,
    problem: Problem,
    pieces: tuple[Piece, ...],
    initial: InitialState,
    t: np.ndarray,
    watched: tuple[when, ...],
    known: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> Trajectory:
    """With states, inputs, the clock, and what is beside singular positions, as they are."""
    run = Trajectory(functions, problem, pieces, initial, t, watched)
    run.__dict__.update(zip(("x", "u", "_clock", "_aside"), known, strict=True))
    return run
