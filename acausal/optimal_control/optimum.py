"""The solution of a problem of optimal control, proven by replay."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.collocation.modes import WithModes
from acausal.collocation.problem import Accuracy, Solution, StatusKind
from acausal.integrators.integrate import integrate
from acausal.language.expression import Expression, Input, Parameter
from acausal.language.pieces import PiecewisePolynomial
from acausal.optimal_control.asked import Limits, Total
from acausal.optimal_control.guess import Guess, closed, points_of
from acausal.optimal_control.mesh import Mesh, through
from acausal.optimal_control.sharper import Sharper
from acausal.optimal_control.transcription import Transcribed
from acausal.start.initial import near
from acausal.start.states import start_values

if TYPE_CHECKING:
    from acausal.simulate.trajectory import Trajectory

_REPLAYED = 1e-10
_AT_BOUND = 1e-5
"""Of its size: how near to its bound something is that is at it."""
_LEFT, _CLEAR = 1.25, 1e-3
"""Times what more points change in a cost: they leave some of it in their turn. Of the cost: what they change more than that, they leave in the ratio of their numbers, as where
an input cannot jump within an interval."""
_LITTLE = 1e-3
"""Of the unit of the cost: what integrals are measured by that are less."""
_GOOD_PART = 0.2
"""Of all intervals: so many are more than switches fall into."""
_TOUCHING = 1e-8
"""In units of the program: by how much what touches is below."""
_TOLD = 1e-6
"""Of what is bounded: by how much bounds are left, where that is told."""
_DIGITS = 1e-8
"""Of what a state is: it does not vary by less, beside rounding."""


def left(cost: float, sharper: float, stages: int) -> float:
    """About how far a cost is from the least one on its nodes: by that with one point more in each interval than these `stages`."""
    change = abs(cost - sharper)
    return (_LEFT if change <= _CLEAR * abs(cost) else stages + 1) * change


def _strikes_at(solution: Solution, since: float) -> int | None:
    """Number of the time at which something strikes first after a time; None where nothing does."""
    modes = solution.modes
    strikes = modes.steps[modes.jumped & (modes.begins > since)] if modes is not None else ()
    return int(min(strikes)) if len(strikes) else None


@dataclass(frozen=True, eq=False, repr=False)
class Optimum:
    """The best motion found: its `cost`, and how it was found (`iterations` and `seconds` of the solver on all meshes).

    `run` is the motion that `simulate` makes of the inputs found, from the start on: independent of the collocation. `replay_error`: by how much it is
    off at the nodes, relative to what each state varies by; `defect`: the same for runs that begin anew at each node; `growth`: how
    much the motion magnifies a small error on its way. A good solution of an unstable motion has a small defect, a large growth and a replay error of
    about their product.

    Between the points of the mesh: `true_cost` and `violation`, of what `simulate` makes of each interval; `cost_error`: about how far the cost is from
    the least one. `factors` (rows,): multipliers of the constraints; `gap`: about how far the solver, whose tolerance is finite, left the cost
    from the least one.
    """

    model: Any
    transcribed: Transcribed
    unknowns: np.ndarray
    cost: float
    iterations: int
    seconds: float
    given: Mapping[str, Any]
    factors: np.ndarray
    gap: float
    sharper: Sharper | None
    phase: int

    @functools.cached_property
    def mesh(self) -> Mesh:
        """Where the unknowns stand."""
        return self.transcribed.settled(self.unknowns)

    def again(self, unknowns: np.ndarray, cost: float, iterations: int, factors: np.ndarray) -> Optimum:
        """Another solution of the same program."""
        return replace(self, unknowns=unknowns, cost=cost, iterations=iterations, factors=factors, gap=float("nan"), sharper=None)

    @functools.cached_property
    def motion(self) -> Guess:
        """All unknowns at the points of the mesh; loops, which an interior point leaves open by its last digits, closed to rounding."""
        found, stage = self.transcribed.motion(self.unknowns), self.transcribed.asked.stage
        nx = stage.sizes[0]
        x = closed(stage, found.values[:, :nx], found.times, found.duration, found.free, self.transcribed.units[:nx], fresh=False)
        return replace(found, values=np.column_stack([x, found.values[:, nx:]]))

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return self.motion.duration

    @property
    def t(self) -> np.ndarray:
        """Times of the nodes (intervals + 1,) [s]."""
        return self.transcribed.asked.stage.t0 + self.mesh.nodes * self.duration

    @functools.cached_property
    def x(self) -> np.ndarray:
        """States at the nodes (nx, intervals + 1)."""
        stage = self.transcribed.asked.stage
        return self.motion.values[:: self.mesh.tableau.stages, : stage.sizes[0]].T

    @functools.cached_property
    def parameters(self) -> dict[Parameter, float]:
        """Values of the parameters that were found, and of those that were given."""
        found = dict(zip(self.transcribed.asked.stage.free, self.motion.free.tolist(), strict=True))
        return {**self.given["parameters"], **found}

    @functools.cached_property
    def inputs(self) -> dict[Input, PiecewisePolynomial]:
        """What was found, for `simulate`: a polynomial in each interval."""
        stage, mesh = self.transcribed.asked.stage, self.mesh
        s, nu = mesh.tableau.stages, stage.sizes[3]
        u = self.motion.values[1:, stage.width - nu :].reshape(mesh.intervals, s, nu)
        lengths = mesh.lengths * self.duration
        found: dict[Input, PiecewisePolynomial] = {}
        for k, entry in enumerate(stage.mode.inputs):
            pieces = through(mesh.tableau.c, u[:, :, k].T).T / lengths[:, None] ** np.arange(s - 1, -1, -1)
            found[entry] = PiecewisePolynomial(self.t[:-1], pieces)
        return found

    def __getitem__(self, wanted: Expression | str) -> np.ndarray:
        """Values of a variable or expression along the replayed motion, see `Trajectory`."""
        return self.run[wanted]

    @functools.cached_property
    def run(self) -> Trajectory:
        """The motion from the start by the inputs found; it may end early where it is unstable."""
        return self.replayed(float(self.t[-1]), self.inputs)

    def replayed(self, end: float, inputs: Mapping[Input, PiecewisePolynomial]) -> Trajectory:
        """The motion from the start by these inputs."""
        stage = self.transcribed.asked.stage
        space, t0 = stage.functions.space, float(self.t[0])
        # closed to rounding: what is open by an interior point's last digits would have to strike first
        units = self.transcribed.units[: self.x.shape[0]]
        first = closed(stage, self._nodes[:, :1].T, np.zeros(1), self.duration, self.motion.free, units)[0]
        whole = space.expanded(t0, first, space.extended(t0, first, self._p(stage.functions)))
        start = {key: near(value) for key, value in start_values(stage.functions, whole).items()}
        return self.model.simulate(
            end, start, t0=t0, inputs=inputs, parameters=self.parameters, rtol=_REPLAYED, progress=False, raise_on_failure=False
        )  # fmt: skip

    @functools.cached_property
    def replay_error(self) -> float:
        """Largest difference of `run` at the nodes, relative to what each state varies by; infinite where it ends early."""
        last = self.run.t[-1]
        if last < self.t[-1] * (1 - 1e-9):
            return float("inf")
        return float(np.max(np.abs(self.run.at(np.clip(self.t, self.run.t[0], last)).x - self.x) / self.spread[:, None]))

    @functools.cached_property
    def defects(self) -> np.ndarray:
        """Of each interval (intervals,), integrated from the node where it begins: of its states, and of what it adds to integrals that are minimised or bounded."""
        found = np.zeros(self.mesh.intervals)
        for k, x in enumerate(self._simulated):
            found[k] = np.max(np.abs(x[:, -1] - self.x[:, k + 1]) / self.spread)
        found[-1] = max(found[-1], self._sooner)
        return np.maximum(found, self.lapses)

    @functools.cached_property
    def lapses(self) -> np.ndarray:
        """Of each interval (intervals,), by how much integrals of the mesh are off, relative to what they are on the whole: where an input has a peak at a point alone, they say
        what is not so.
        """
        found, asked = np.zeros(self.mesh.intervals), self.transcribed.asked
        least = _LITTLE * self.transcribed.program.unit
        for total, little in ((asked.cost, least), *((total, 0.0) for total, *_ in asked.totals)):
            integrand = self._integrand(total)
            if integrand.is_zero():
                continue
            true, said = self._by_intervals(integrand), self._by_points(integrand)
            size = max(float(np.sum(np.abs(said))), little)
            off = np.abs(true - said) / size if size > 0 else np.where(true == said, 0.0, np.inf)
            found = np.maximum(found, np.nan_to_num(off, nan=np.inf))
        return found

    def _integrand(self, total: Total) -> ca.SX:
        return total.integrals + total.averages / self.transcribed.asked.stage.duration

    def _by_points(self, integrand: ca.SX) -> np.ndarray:
        """What each interval (intervals,) adds to an integral, by the points of the mesh."""
        inside = replace(self.motion, times=self.motion.times[1:], values=self.motion.values[1:])
        values = self._values(integrand, inside).reshape(self.mesh.intervals, -1)
        return values @ self.mesh.tableau.b * self.mesh.lengths * self.duration

    def _by_intervals(self, integrand: ca.SX) -> np.ndarray:
        """The same, by what `simulate` makes of each interval and by many more points."""
        _, b = np.polynomial.legendre.leggauss(self._places)
        return self._dense(integrand).reshape(self.mesh.intervals, -1) @ b * np.diff(self.t) / 2

    def _true(self, total: Total) -> float:
        """The value of a sum, of what `simulate` makes of each interval."""
        stage = self.transcribed.asked.stage
        summed = float(np.sum(self._by_intervals(self._integrand(total))))
        ends = [self.motion.values[0], self.motion.values[-1]]
        more = np.append(self.duration, self.motion.free)
        for z, at, value in zip(ends, (0.0, 1.0), (total.starts, total.ends), strict=True):
            there = ca.Function("value", [stage.unknowns, stage.data], [stage.put(value)])
            summed += float(there(np.append(z, more), [at, 0.0]))
        return summed + total.per_second * self.duration

    @property
    def _simulated(self) -> list[np.ndarray]:
        """States (nx, places + 1) of each interval between its points and at its end, integrated from the node where it begins."""
        return self._simulated_till_impact[0]

    @property
    def _sooner(self) -> float:
        """Of the duration: how much before the end, which is where phases meet, something strikes that is to strike there."""
        return self._simulated_till_impact[1]

    @functools.cached_property
    def _simulated_till_impact(self) -> tuple[list[np.ndarray], float]:
        """Where it strikes after the last place that is read and before the end, its state there stands for that at the end: what the plan does from then on is added."""
        found, accuracy, sooner = list[np.ndarray](), Accuracy.asked(_REPLAYED), 0.0
        inputs = self.run.problem.inputs
        given = inputs.inputs if isinstance(inputs, WithModes) else inputs  # modes are decided anew at each node
        x, last = self._nodes, self.mesh.intervals - 1
        for k, times in enumerate(self._between):
            read = np.append(times, self.t[k + 1])
            problem = replace(self.run.problem, inputs=given, read=read)
            solution = integrate(problem, x[:, k].copy(), float(self.t[k]), float(read[-1]), accuracy)
            if solution.status.kind is not StatusKind.SUCCESS:
                found.append(np.full((len(self.x), read.size), np.inf))
                continue
            strike, end = _strikes_at(solution, float(times[-1])) if k == last else None, solution.x[:, -1]
            if strike is not None:
                at = np.clip((solution.t[[strike]] - self.t[0]) / self.duration, 0.0, 1.0)
                end = solution.x[:, strike] + self.x[:, -1] - self.motion.at(at)[0, : len(self.x)]
                sooner = 1.0 - float(at[0])
            found.append(np.column_stack([solution.dense(times), end]))
        return found, sooner

    @functools.cached_property
    def _nodes(self) -> np.ndarray:
        """States at the nodes (nx, intervals + 1); what touches is not below by rounding, nor by the last digits of a solver."""
        rounding = np.finfo(float).eps * np.max(np.abs(self.x), axis=1, keepdims=True)
        x, stage, units = np.where(np.abs(self.x) > rounding, self.x, 0.0), self.transcribed.asked.stage, self.transcribed.units
        nx, more = len(x), np.append(self.duration, self.motion.free)
        for k, at in enumerate(self.mesh.nodes if stage.mode.open_gaps.numel() else ()):
            z = np.concatenate([x[:, k], np.zeros(stage.width - nx), more])
            gaps, slopes = (np.array(one) for one in stage.open_gaps(z, [at, 0.0]))
            slopes = slopes[:, :nx] * units[:nx]
            below = np.flatnonzero((gaps[:, 0] < 0) & (gaps[:, 0] > -_TOUCHING * np.linalg.norm(slopes, axis=1)))
            x[:, k] -= units[:nx] * (np.linalg.pinv(slopes[below], 1e-9) @ gaps[below, 0])
        return x

    @property
    def _between(self) -> np.ndarray:
        """Times (intervals, places) of Gauss between the nodes, more than the mesh has points."""
        c, _ = np.polynomial.legendre.leggauss(self._places)
        return self.t[:-1, None] + np.diff(self.t)[:, None] * (1 + c) / 2

    @property
    def _places(self) -> int:
        return 2 * self.mesh.tableau.stages + 1

    @functools.cached_property
    def dense(self) -> Guess:
        """All unknowns between the points of the mesh, where each interval is simulated from the node where it begins."""
        stage, x = self.transcribed.asked.stage, np.hstack([one[:, :-1] for one in self._simulated])
        t = self._between.ravel()
        u = stage.told(np.array([one(t) for one in self.inputs.values()]).reshape(-1, t.size))
        found = self.motion
        values = points_of(stage, t, x, u, self._p(stage.functions))
        return Guess((t - self.t[0]) / self.duration, values, self.duration, found.free)

    def _dense(self, column: ca.SX) -> np.ndarray:
        """Values (n, points) of a column between the points of the mesh."""
        return self._values(column, self.dense)

    def _values(self, column: ca.SX, found: Guess) -> np.ndarray:
        """Of a column (n, points)."""
        stage = self.transcribed.asked.stage
        value = ca.Function("value", [stage.unknowns, stage.data], [stage.put(column)])
        more = np.append(found.duration, found.free)
        z = np.hstack([found.values, np.tile(more, (len(found.values), 1))]).T
        return np.array(value(z, np.vstack([found.times, np.zeros(found.times.size)])))

    @functools.cached_property
    def true_cost(self) -> float:
        """The cost of what `simulate` makes of each interval, its integrals by many more points than the mesh has."""
        return self._true(self.transcribed.asked.cost)

    @functools.cached_property
    def violations(self) -> dict[str, float]:
        """By how much what is bounded leaves its bounds between the points of the mesh, in its own unit, by name; at most, and 0 where it does not."""
        found: dict[str, float] = {}
        for limits, off in self._excesses:
            found[limits.name] = max(found.get(limits.name, 0.0), float(np.max(off, initial=0.0)))
        for name, off, _ in self._beyond:
            found[name] = max(found.get(name, 0.0), off)
        return found

    @functools.cached_property
    def violation(self) -> float:
        """The largest of all, relative to what is bounded."""
        return max(float(np.max(self.excesses, initial=0.0)), *(off / size for _, off, size in self._beyond), 0.0)

    @functools.cached_property
    def _beyond(self) -> list[tuple[str, float, float]]:
        """What is bounded for the whole motion: its name, by how much its true value leaves its bounds, and what is much for it."""
        found = list[tuple[str, float, float]]()
        for total, lower, upper, name in self.transcribed.asked.totals:
            value = self._true(total)
            sizes = [abs(v) for v in (value, lower, upper) if np.isfinite(v) and v]
            found.append((name, max(lower - value, value - upper, 0.0), max(sizes, default=1.0)))
        return found

    @functools.cached_property
    def excesses(self) -> np.ndarray:
        """Of each interval (intervals,), by how much something leaves its bounds in it, relative to what it is at most."""
        found = np.zeros(self.mesh.intervals * self._places)
        for limits, _ in self._excesses:
            found = np.maximum(found, np.max(limits.share(self._dense(limits.value)), axis=0, initial=0.0))
        return np.max(found.reshape(self.mesh.intervals, -1), axis=1)

    @property
    def left_most(self) -> tuple[str, float]:
        """What leaves its bounds most between points, relative to what it is at most: its name, and by how much in its own unit."""
        found = list[tuple[float, str, float]]()
        for limits, off in self._excesses:
            relative = np.max(limits.share(self._dense(limits.value)), initial=0.0)
            found.append((float(relative), limits.name, float(np.max(off, initial=0.0))))
        return max(found)[1:]

    @functools.cached_property
    def _excesses(self) -> list[tuple[Limits, np.ndarray]]:
        return [
            (limits, limits.excess(self._dense(limits.value))) for limits in self.transcribed.asked.path if limits.value.numel()
        ]

    @functools.cached_property
    def gains(self) -> np.ndarray:
        """(intervals + 1,): about how much less the cost would be with each node elsewhere alone, to first order; 0 where it cannot move. Where the mesh
        is as good as can be they vanish: then the Hamiltonian does not jump.
        """
        slopes = self.transcribed.slopes_by_nodes(self.unknowns, self.factors)
        before, after = np.append(0.0, self.mesh.lengths), np.append(self.mesh.lengths, 0.0)
        return np.where(self.mesh.movable, np.abs(slopes) * np.where(slopes > 0, before, after) / 2, 0.0)

    @functools.cached_property
    def switching(self) -> np.ndarray:
        """(intervals + 1,): beside which nodes something comes to one of its bounds, or leaves it."""
        found = np.zeros(self.mesh.intervals + 1, dtype=bool)
        where = self._at_bounds
        both = np.concatenate([where[:, :-1], where[:, 1:]], axis=2)
        found[1:-1] = np.any(both != both[:, :, :1], axis=(0, 2))
        return found

    @functools.cached_property
    def _at_bounds(self) -> np.ndarray:
        """(entries, intervals, stages): of what has limits, at the points: 1 at the upper one, -1 at the lower one, 0 between them and where these are one."""
        inside, found = replace(self.motion, times=self.motion.times[1:], values=self.motion.values[1:]), list[np.ndarray]()
        for limits in self.transcribed.asked.path:
            if limits.value.numel():
                values = self._values(limits.value, inside)
                near = _AT_BOUND * limits.sizes(values)[:, None]
                over, under = values > limits.upper[:, None] - near, values < limits.lower[:, None] + near
                found.append(over.astype(int) - under.astype(int))
        return np.vstack([np.zeros((0, inside.times.size), dtype=int), *found]).reshape(
            -1, self.mesh.intervals, self.mesh.tableau.stages
        )

    @property
    def flat(self) -> bool:
        """Whether inputs that act in proportion alone are between their bounds for a good part of the time, along a singular arc: there the cost hardly tells them apart."""
        asked = self.transcribed.asked
        if not asked.proportional:
            return False
        bounded = np.sum(self._at_bounds != 0, axis=0)
        return bool(np.mean(np.all(bounded < asked.stage.sizes[3], axis=1)) > _GOOD_PART)

    @property
    def cost_error(self) -> float:
        """About how far the cost is from the least one: from that on the same nodes with more points between them, which is searched for when this is asked; from
        that with other nodes, the sum of `gains`; from that of the program, its `gap`; and from `true_cost`. A switch between two nodes shows here, and not in the `defect`. Infinite where
        nothing is found with more points; NaN for plans of a controller.
        """
        if self.sharper is None:
            return float("nan")
        off = left(self.cost, self.sharper.costs[self.phase], self.mesh.tableau.stages)
        return off + self.sharper.off + self.unsettled

    @property
    def unsettled(self) -> float:
        """What nodes and the solver's tolerance leave of the cost, and by how much the points of the mesh say another one than simulation."""
        lie = abs(self.true_cost - self.cost)
        return float(np.sum(self.gains)) + self.gap + (lie if np.isfinite(lie) else np.inf)

    @property
    def defect(self) -> float:
        """The largest of `defects`."""
        return float(np.max(self.defects))

    @functools.cached_property
    def growth(self) -> float:
        """By how much a small error of the states on the way is magnified until a later node, at most; relative to what each state varies by."""
        maps = [self._map(k) / self.spread[:, None] * self.spread for k in range(self.mesh.intervals)]
        largest = 1.0
        carried = np.zeros((0, *maps[0].shape))
        for one in maps:
            carried = np.concatenate([one @ carried, one[None]])
            largest = max(largest, float(np.max(np.linalg.norm(carried, 2, axis=(1, 2)))))
        return largest

    def _map(self, k: int) -> np.ndarray:
        """Derivative (nx, nx) of the states at the end of an interval by those at its beginning, by the collocation itself."""
        stage, mesh = self.transcribed.asked.stage, self.mesh
        nx, s, f = stage.sizes[0], mesh.tableau.stages, stage.functions
        h = mesh.lengths[k] * self.duration
        slopes = np.zeros((s, nx, nx))
        for j in range(s):
            z = self.motion.values[1 + k * s + j]
            u = stage.told(z[stage.width - stage.sizes[3] :])
            slopes[j] = np.array(self._slope(self.t[0] + mesh.points[k, j] * self.duration, z[:nx], u, self._p(f)))
        A = mesh.tableau.A
        block = np.eye(s * nx) - h * np.einsum("ij,jab->iajb", A, slopes).reshape(s * nx, s * nx)
        stages = np.linalg.solve(block, np.tile(np.eye(nx), (s, 1)))
        return stages[-nx:]

    @functools.cached_property
    def _slope(self) -> ca.Function:
        f = self.transcribed.asked.stage.functions.explicit_dynamics
        t, x, u, p = (f.sx_in(i) for i in range(4))
        return ca.Function("slope", [t, x, u, p], [ca.densify(ca.jacobian(f(t, x, u, p), x))], {"cse": True})

    def _p(self, f: Any) -> np.ndarray:
        p = self.transcribed.asked.stage.p.copy()
        known = list(f.outputs.system.flat.parameters)
        for parameter, value in self.parameters.items():
            p[known.index(parameter)] = value
        return p

    @functools.cached_property
    def spread(self) -> np.ndarray:
        """(nx,): what each state varies by; where it does not, what states of its kind do, in units of each. Digits of what is much for it are rounding: a scene that rests has a speed by these."""
        units = self.transcribed.units[: len(self.x)]
        much = np.maximum(np.max(np.abs(self.x), axis=1), units)
        found = np.maximum(np.ptp(self.x, axis=1), _DIGITS * much) / units
        nq = self.transcribed.asked.stage.functions.space.nq
        for block in (slice(0, nq), slice(nq, None)):
            own = found[block]
            own[own < 1e-3 * np.max(own, initial=0.0)] = np.max(own, initial=0.0)
            own[own == 0.0] = 1.0
        return found * units

    def __repr__(self) -> str:
        return f"<Optimum: cost {self.cost:.10g} in {self.duration:g} s, {self.mesh.intervals} intervals>"

    def __str__(self) -> str:
        found = "".join(
            f", {p.name} = {value:g}" for p, value in self.parameters.items() if p in self.transcribed.asked.stage.free
        )
        left = f"; bounds are left by {self.violation:.1e} between points" if self.violation > _TOLD else ""
        return (
            f"cost {self.cost:.10g} (to {self.cost_error:.0e}) in {self.duration:g} s{found}: {self.iterations} iterations, {self.seconds:.2f} s, {self.mesh.intervals} intervals; "
            f"replayed to {self.replay_error:.1e} (each interval to {self.defect:.1e}, errors grow {self.growth:.1e} times){left}"
        )
