"""Motions in phases: contact and flight, throw and catch, stance and swing, of one scene or of several."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.arguments import dictionary, whole_number
from acausal.errors import OptionError
from acausal.language.expression import Expression
from acausal.language.pieces import PiecewisePolynomial
from acausal.optimal_control.link import Link
from acausal.optimal_control.mesh import Mesher
from acausal.optimal_control.mode import PhaseMode, replace_words
from acausal.optimal_control.optimum import Optimum, left
from acausal.optimal_control.problem import Goal, OptimalControl
from acausal.optimal_control.solving import best_of
from acausal.optimal_control.stage import Stage
from acausal.optimal_control.swings import other_guesses
from acausal.optimal_control.whole import Part
from acausal.start.initial import near
from acausal.start.states import start_values

if TYPE_CHECKING:
    from acausal.simulate.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class _Said:
    """A link as users say it."""

    values: Mapping[Any, Any] | None
    drift: tuple[Any, ...]
    impact: Mapping[Any, str] | None


class Phases:
    """Problems of optimal control one after the other, in this order; made by `ac.phases`. Their costs are added.

    Each phase has its own time, bounds, and cost, and begins where the one before ends. A parameter that several phases `optimise` has one value in all of them. With phases of one model all states go on; where something closes
    that was open it strikes, and impulses of all that holds then change the velocities. All else is said by `link`.

        stance = ac.OptimalControl(model, ac.free(0.1, 1), modes={s.foot: "closed"})
        flight = ac.OptimalControl(model, ac.free(0.1, 1))
        hop = ac.phases(stance, flight)
        hop.link(flight, stance)  # and again
        best = hop.solve()
    """

    def __init__(self, *problems: OptimalControl) -> None:
        if not problems or not all(isinstance(one, OptimalControl) for one in problems):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise OptionError(f"phases: give problems, ac.phases(ac.OptimalControl(...), ...), not {problems!r}.")
        if len({id(one) for one in problems}) < len(problems):
            raise OptionError("phases: a problem is given twice. Make one for each phase: they may have the same model.")
        self._problems = problems
        self._links: dict[tuple[int, int], _Said] = {(k, k + 1): _Said(None, (), None) for k in range(len(problems) - 1)}

    def link(
        self,
        before: OptimalControl,
        after: OptimalControl,
        values: Mapping[Any, Any] | None = None,
        *,
        impact: Mapping[Any, str] | None = None,
        drift: Sequence[Expression | str] = (),
    ) -> None:
        """Where `before` ends `after` begins: the next one, or the first one after the last, where the motion repeats itself.

        `values`: {expression of the scene after: expression of the scene before, or a number}: what is reset, what legs swap, what another scene begins with;
        nothing else goes on then. `drift`: states that may be anything after. `impact`: what holds when something strikes, {part: "closed", "sticks", "slides",
        "bounces"}; all others are let go. Without it what closes strikes, and what holds after it holds.
        """
        number = [next((k for k, one in enumerate(self._problems) if one is given), -1) for given in (before, after)]
        last = len(self._problems) - 1
        if -1 in number or not (number[1] == number[0] + 1 or number == [last, 0]):
            raise OptionError("link: give two phases that follow each other, or the last one and the first one.")
        said = None if values is None else dictionary(values, "link", "{flight.ball.position: hold.hand.position}")
        of = None if impact is None else dictionary(impact, "link: impact", "{scene.foot: 'sticks'}")
        self._links[number[0], number[1]] = _Said(said, tuple(drift), of)

    def solve(
        self,
        intervals: int | Sequence[int] = 20,
        *,
        order: int = 5,
        controls: str = "free",
        solver: str = "ipopt",
        tolerance: float = 1e-6,
        refinements: int = 4,
        guesses: int = 4,
        options: Mapping[str, Any] | None = None,
    ) -> PhasesOptimum:
        """The best motion near the guess: arguments as of `OptimalControl.solve`; `intervals`: of each phase, or one number for each."""
        count = list(intervals) if isinstance(intervals, Sequence) else [intervals] * len(self._problems)
        if len(count) != len(self._problems):
            raise OptionError(f"solve: {len(count)} numbers of intervals for {len(self._problems)} phases.")
        self._check_parameters()
        parts: list[Part] = []
        links: list[Link] = []
        for k, problem in enumerate(self._problems):
            begin = self._begin(parts[-1], k) if k else None
            parts.append(problem.part(Mesher(count[k], order, controls, solver), begin, self._goal(parts, k)))
        for (i, j), said in self._links.items():
            links.append(self._link(i, j, said, parts))
        others = other_guesses(parts, whole_number(guesses, "solve: guesses", 0))
        found = best_of(parts, links, solver, dict(options or {}), tolerance, refinements, others)
        return PhasesOptimum(found.phases, found.cost, found.iterations, found.seconds)

    def _check_parameters(self) -> None:
        """Raises `OptionError` where a parameter is found in one phase, and nothing is said of it in another one of the same model."""
        for k, one in enumerate(self._problems):
            for j, other in enumerate(self._problems):
                silent = (
                    [p for p in one.found if p not in other.found and p not in other.given] if other.model is one.model else []
                )
                if silent:
                    name = one.name(silent[0])
                    raise OptionError(
                        f"phases: {name} is found in phase {k + 1}, and phase {j + 1} of the same model says nothing of it. Let it be found there, too, then it has one value: optimise({name}, ...); "
                        f"or say what it is there: OptimalControl(..., parameters={{{name}: ...}})."
                    )

    def _begin(self, before: Part, k: int) -> dict[Expression, Any]:
        """Start values near which a phase begins: what the guess of the one before ends with."""
        said, mine = self._links[k - 1, k], self._problems[k]
        if said.values is None and self._problems[k - 1].model is not mine.model:
            raise OptionError(
                "phases: two phases of different models follow each other. Say what the second begins with: "
                "throw.link(hold, flight, {flight_scene.ball.position: hold_scene.hand.position, ...})."
            )
        stage, z = before.asked.stage, np.concatenate([before.guess.values[-1], [before.guess.duration], before.guess.free])
        if said.values is None:
            f = stage.functions
            x = z[: stage.sizes[0]]
            whole = f.space.expanded(stage.t0, x, f.space.extended(stage.t0, x, stage.p))
            return {key: near(value) for key, value in start_values(f, whole).items()}
        found: dict[Expression, Any] = {}
        for key, value in mine.symbols(said.values, "link").items():
            number = ca.Function("value", [stage.unknowns, stage.data], [stage.put(stage.opened(value))])
            found[key] = near(np.array(number(z, [1.0, 0.0])).ravel())
        return found

    def _goal(self, parts: Sequence[Part], k: int) -> Goal | None:
        """Places to which the last phase leads, where the first one goes on from there: those at which that begins, or what is reset to these."""
        said, mine, first = self._links.get((k, 0)), self._problems[k], self._problems[0]
        if said is None or k < len(self._problems) - 1:
            return None
        known = (
            None
            if said.values is None
            else [(key, _known(mine, value)) for key, value in first.symbols(said.values, "link").items()]
        )
        drift = mine.by_state(dict.fromkeys(mine.symbols(dict.fromkeys(said.drift, 0.0), "link: drift"), 1.0))

        def goal(stage: Stage, x: np.ndarray) -> dict[Expression, Any]:
            begun, x = (parts[0].asked.stage, parts[0].guess.values[0, : parts[0].asked.stage.sizes[0]]) if k else (stage, x)
            f, nq = begun.functions, begun.functions.space.nq
            if known is None:
                kept = np.where(drift != 0, np.nan, x)
                whole = f.space.expanded(begun.t0, kept, f.space.extended(begun.t0, kept, begun.p))
                told = start_values(f, np.where(np.arange(whole.size) < f.outputs.system.nq, whole, np.nan))
                return {key: value for key, value in told.items() if np.isfinite(value).all()}
            z = np.concatenate([x, np.zeros(begun.unknowns.numel() - x.size)])
            found: dict[Expression, Any] = {}
            for key, value in known:
                column = begun.put(begun.opened(key))
                if isinstance(value, Expression) and not ca.depends_on(column, begun.unknowns[nq:]):
                    found[value] = np.array(ca.Function("value", [begun.unknowns, begun.data], [column])(z, [0.0, 0.0])).ravel()
            return found

        return goal

    def _link(self, i: int, j: int, said: _Said, parts: Sequence[Part]) -> Link:
        before, after = self._problems[i], self._problems[j]
        a, b = parts[i].asked.stage, parts[j].asked.stage
        same = before.model is after.model
        values = None
        if said.values is not None:
            named = after.symbols(said.values, "link").items()
            values = [(b.opened(key), a.opened(_known(before, value)), f"{after.name(key)} goes on") for key, value in named]
            for (mine, its, name), (_, value) in zip(values, named, strict=True):
                if mine.numel() != its.numel():
                    raise OptionError(f"link: {name} from {value!r}, which has {its.numel()} entries, not {mine.numel()}.")
        drift = [
            int(n)
            for n in np.flatnonzero(
                before.by_state(dict.fromkeys(before.symbols(dict.fromkeys(said.drift, 0.0), "link: drift"), 1.0))
            )
        ]
        return Link(i, j, values, drift, self._impact(a, b, said, same=same))

    def _impact(self, a: Stage, b: Stage, said: _Said, *, same: bool) -> PhaseMode | None:
        """What holds when something strikes; None where nothing does."""
        if said.impact is not None:
            return replace_words(a.mode, said.impact, "An impact")
        if not same or said.values is not None:
            return None
        closing = (
            new == "closed" and old != "closed" and not law.row.one_way
            for law, old, new in zip(a.mode.laws, a.mode.words, b.mode.words, strict=True)
        )
        return PhaseMode(a.mode.functions, a.mode.free, a.mode.laws, b.mode.words) if any(closing) else None


def _known(problem: OptimalControl, value: Any) -> Any:
    return value if not isinstance(value, Expression | str) else next(iter(problem.symbols({value: 0.0}, "link")))


@dataclass(frozen=True, eq=False, repr=False)
class PhasesOptimum:
    """The best motions of all `phases`, each an `Optimum`; their `cost` together, and how they were found.

    `run`: where all phases have one model with the same parameters, the motion that `simulate` makes of the inputs from the first start to the last end, deciding by itself what opens,
    sticks and strikes; `replay_error`: by how much it is off at the nodes, relative to what each state varies by. Other phases are replayed one by one.
    """

    phases: tuple[Optimum, ...]
    cost: float
    iterations: int
    seconds: float

    def __getitem__(self, k: int) -> Optimum:
        """One phase."""
        return self.phases[k]

    @property
    def duration(self) -> float:
        """Of all phases together [s]."""
        return sum(one.duration for one in self.phases)

    @property
    def defect(self) -> float:
        """The largest of all phases."""
        return max(one.defect for one in self.phases)

    @property
    def cost_error(self) -> float:
        """About how far the cost is from the least one, see `Optimum.cost_error`: of all phases together, since what one loses another may gain."""
        sharper = self.phases[0].sharper
        assert sharper is not None
        off = left(self.cost, sum(sharper.costs), self.phases[0].mesh.tableau.stages)
        return off + sharper.off + sum(one.unsettled for one in self.phases)

    @functools.cached_property
    def _begins(self) -> np.ndarray:
        """When each phase begins in the whole run [s], and the last one ends."""
        return float(self.phases[0].t[0]) + np.cumsum([0.0, *(one.duration for one in self.phases)])

    @property
    def _one_model(self) -> bool:
        first = self.phases[0]
        return all(one.model is first.model and one.parameters == first.parameters for one in self.phases)

    @functools.cached_property
    def run(self) -> Trajectory:
        """Raises `OptionError` where phases have different models, or other parameters: each has its own `run`."""
        if not self._one_model:
            raise OptionError(
                "run: the phases have different models or parameters. Look at best.phases[0].run, best.phases[1].run, ..."
            )
        first, offset = self.phases[0], [one.t[0] for one in self.phases]
        inputs: dict[Any, Any] = {}
        for entry in first.inputs:
            own = [one.inputs[entry] for one in self.phases]
            begins = [p.begins + start - at for p, start, at in zip(own, self._begins, offset, strict=False)]
            inputs[entry] = PiecewisePolynomial(np.concatenate(begins), np.vstack([p.coefficients for p in own]))
        return first.replayed(float(self._begins[-1]), inputs)

    @functools.cached_property
    def replay_error(self) -> float:
        """Infinite where the run ends early."""
        if not self._one_model:
            return max(one.replay_error for one in self.phases)
        end = self.run.t[-1]
        if end < self._begins[-1] * (1 - 1e-9):
            return float("inf")
        worst = 0.0
        for k, one in enumerate(self.phases):
            times = np.clip(one.t - one.t[0] + self._begins[k], self.run.t[0], end)
            off = np.abs(self.run.at(times).x - one.x) / one.spread[:, None]
            moving = slice(one.transcribed.asked.stage.functions.space.nq, None)
            off[moving, [0, -1]] = 0.0  # just there velocities jump
            worst = max(worst, float(np.max(off)))
        return worst

    def __repr__(self) -> str:
        return f"<PhasesOptimum: cost {self.cost:.10g} in {self.duration:g} s, {len(self.phases)} phases>"

    def __str__(self) -> str:
        lines = [
            f"phase {k + 1}: {one.duration:g} s, cost {one.cost:.8g}, each interval replayed to {one.defect:.1e}"
            for k, one in enumerate(self.phases)
        ]
        return "\n".join(
            [
                f"cost {self.cost:.10g} (to {self.cost_error:.0e}) in {self.duration:g} s: {self.iterations} iterations, {self.seconds:.2f} s; replayed to {self.replay_error:.1e}",
                *lines,
            ]
        )


def phases(*problems: OptimalControl) -> Phases:
    """Problems of optimal control one after the other."""
    return Phases(*problems)
