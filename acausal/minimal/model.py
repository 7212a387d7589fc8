"""The equations of motion in the least number of states: an ordinary differential equation without invariants."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import casadi as ca
import numpy as np

from acausal.abstract_model import AbstractModel
from acausal.arguments import listed, whole_number
from acausal.charts.chart import Chart, Choice, choose_chart
from acausal.charts.chart_space import chart_space
from acausal.charts.equations import ChartEquations
from acausal.charts.manifold import Manifold, manifold
from acausal.errors import OptionError
from acausal.language.expression import Expression, Variable
from acausal.numerics.folding import folded_function
from acausal.numerics.one_thread import on_one_thread
from acausal.outputs.functions import Functions
from acausal.reduce.reduce import ReducedSystem
from acausal.start.anew import AbstractDecided
from acausal.start.assembly_function import start_units
from acausal.start.decided import check_decided
from acausal.start.initial import InitialState
from acausal.start.situation import InputValues, ParameterValues, Situation, StartValues, situation
from acausal.start.start_values import Start, near
from acausal.start.states import consistent_states, finite_states, start_values
from acausal.wording import counted

if TYPE_CHECKING:
    from acausal.simulate.simulation import Options
    from acausal.simulate.trajectory import Trajectory

T = TypeVar("T")
_FEWEST_STEPS = 4
"""With fewer, a path may be lost unseen."""
_MOST_STEPS = 200
_EXAMPLE = "prefer=[scene.crank.q]"


@dataclass(frozen=True, repr=False, eq=False)
class Atlas:
    """All charts of a model. `steps`: how many Newton steps lead from the reference of a chart to a state; `units`: what is much for each
    state (nx,)."""

    functions: Functions
    steps: int
    units: np.ndarray

    def __reduce__(self) -> tuple[Any, ...]:
        return Atlas, (self.functions, self.steps, self.units)

    @functools.cached_property
    def manifold(self) -> Manifold:
        """What the states obey."""
        return manifold(self.functions, self.units)

    def equations(self, choice: Choice) -> ChartEquations:
        """Equations for a choice of independent entries; made once."""
        found = self._known.get(choice)
        if found is None:
            found = self._known[choice] = ChartEquations(self.manifold, choice, self.steps)
        return found

    @functools.cached_property
    def _known(self) -> dict[Choice, ChartEquations]:
        return {}


@dataclass(frozen=True, repr=False, eq=False)
class OnCharts(AbstractDecided):
    """Functions of a chart for all values of parameters at which the scene is decided as it is for the chart."""

    atlas: Atlas
    chart: Chart

    @property
    def system(self) -> ReducedSystem:
        """That of all charts."""
        return self.atlas.functions.outputs.system

    @property
    def functions(self) -> Functions:
        """Of the coordinates of the chart."""
        return self._functions

    @functools.cached_property
    def _functions(self) -> Functions:
        return Functions(self.whole.outputs, chart_space(self.atlas.equations(self.chart.choice), self.chart))

    @property
    def whole(self) -> Functions:
        """Those of all charts."""
        return self.atlas.functions

    def at(self, p: np.ndarray) -> OnCharts:
        """Itself. Raises `ParameterError` where other things would have to be decided."""
        self.whole.decisions.check(p)
        return self

    def with_loops_at(self, p: np.ndarray) -> OnCharts:
        """Itself; errors as for `at`."""
        return self.at(p)

    def answer(self, p: np.ndarray, ask: Callable[[AbstractDecided], T]) -> T:
        """What `ask` says; errors as for `at`."""
        return ask(self.at(p))


@dataclass(frozen=True, repr=False)
class MinimalModel(AbstractModel):
    """y' = f(t, y, u, p) of least dimension, around the reference state of `chart`.

    y = (independent positions, independent velocities and scalar states), named in `state_names`. Unit quaternions are replaced by three
    modified Rodrigues parameters (`rodrigues`) of the rotation since the reference; velocities stay angular velocities. What depends on
    y is found by Newton steps from the reference in straight-line code; where they do not converge, or the chart has ended, every
    function gives NaN. All functions are CasADi `SX` functions with exact derivatives. `initial`: how start values were met; `prefer`:
    places in (c, w) asked for.

    It answers what a model answers, with y for x; where times, start values and parameters are left out they are those of the chart.
    `simulate` goes on in another chart wherever one comes to its end; its motion has all coordinates of the tree as states.
    """

    atlas: Atlas
    chart: Chart
    initial: InitialState
    prefer: tuple[int, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return MinimalModel, (self.atlas, self.chart, self.initial, self.prefer)

    @property
    def functions(self) -> Functions:
        """Named CasADi functions of y in place of x: dynamics, energies, outputs; there are no invariants."""
        return self._decided.functions

    @property
    def _decided(self) -> OnCharts:
        return self._on_charts

    @functools.cached_property
    def _on_charts(self) -> OnCharts:
        return OnCharts(self.atlas, self.chart)

    @property
    def start(self) -> np.ndarray:
        """y (ny,) at the reference state of the chart."""
        return np.array(self.restrict(self.chart.x)).ravel()

    @functools.cached_property
    def explicit_dynamics(self) -> ca.Function:
        """(t, y, u, p) -> y'."""
        rate = self.functions.explicit_dynamics(*self._symbols)
        return folded_function("explicit_dynamics", list(self._symbols), [rate], ["t", "y", "u", "p"], ["y_dot"])

    @functools.cached_property
    def expand(self) -> ca.Function:
        """(t, y, u, p) -> x, all coordinates and velocities of the tree, `atlas.functions.state_names`."""
        t, y, u, p = self._symbols
        x = self._equations.expand(t, y, p, self.chart.reference)
        return folded_function("expand", [t, y, u, p], [x], ["t", "y", "u", "p"], ["x"])

    @functools.cached_property
    def restrict(self) -> ca.Function:
        """x -> y."""
        x = self._x
        return folded_function("restrict", [x], [self._equations.restrict(x, self.chart.reference)], ["x"], ["y"])

    @functools.cached_property
    def residual(self) -> ca.Function:
        """(t, y, u, p) -> root of the sum of squares of all invariants at `expand`: rounding errors, or NaN off the chart."""
        t, y, u, p = self._symbols
        invariants = self.atlas.functions.invariants
        x = self._equations.expand(t, y, p, self.chart.reference)
        total = ca.SX(0) if invariants is None else ca.sumsqr(invariants(t, x, u, p))
        return folded_function("residual", [t, y, u, p], [ca.densify(ca.sqrt(total))], ["t", "y", "u", "p"], ["residual"])

    @functools.cached_property
    def conditioning(self) -> ca.Function:
        """(t, x, u, p) -> number in (0, 1], zero where the chart ends; for quaternions 1 at the reference, 0.5 after half a turn."""
        t, _, u, p = self._symbols
        x = self._x
        least = ca.mmin(self._equations.conditions(t, x, p, self.chart.reference))
        return folded_function("conditioning", [t, x, u, p], [ca.densify(least)], ["t", "x", "u", "p"], ["conditioning"])

    def change(self, other: MinimalModel) -> ca.Function:
        """(t, y, u, p) -> y of the same state in another chart of the same model. Raises `OptionError` for another model."""
        if not isinstance(other, MinimalModel):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            raise OptionError(f"minimal.change: {other!r} is not a minimal model. Make one by rechart(...) of this one.")
        if other.atlas.functions is not self.atlas.functions:
            raise OptionError("minimal.change: the other chart belongs to another model. Make it by rechart(...) of this one.")
        arguments = self._symbols
        return folded_function(
            "change", list(arguments), [other.restrict(self.expand(*arguments))], ["t", "y", "u", "p"], ["y_other"]
        )

    def rechart(
        self, x: Sequence[float] | np.ndarray, *, t: float | None = None, parameters: ParameterValues | None = None
    ) -> MinimalModel:
        """The chart that is best at another state x (nx,), all coordinates of the tree, at time `t` [s], by default that of this chart.

        Raises `StartValueError` where x does not meet the invariants or is singular.
        """
        functions = self.atlas.functions
        at = situation(functions.outputs, None, self.chart.t if t is None else t, None, parameters, clock="time t")
        functions.decisions.check(at.p)
        return self.at(at.t0, x, self.chart.p if parameters is None else at.p)

    def at(self, t: float, x: Sequence[float] | np.ndarray, p: np.ndarray) -> MinimalModel:
        """The chart that is best at consistent states x (nx,) of the model. Raises `StartValueError` where they are singular."""
        return replace(self, chart=_chart(self.atlas, t, x, p, self.prefer))

    def _situation(
        self,
        start: StartValues | None,
        t0: float | None,
        inputs: InputValues | None,
        parameters: ParameterValues | None,
        clock: str = "start t0",
    ) -> Situation:
        chart, whole = self.chart, self.atlas.functions
        at = situation(whole.outputs, start, chart.t if t0 is None else t0, inputs, parameters, clock=clock)
        if parameters is None:
            at = replace(at, p=chart.p)
        if start is not None:
            return at
        return replace(at, start=self._here)

    @functools.cached_property
    def _here(self) -> Start:
        """Of the reference: what is independent as it is, the rest as near to it as other times, parameters and inputs allow."""
        whole, chart = self.atlas.functions, self.chart
        number = {whole.outputs.system.x[i].element_hash(): i for i in range(chart.x.size)}
        free = set() if self.atlas.functions.outputs.system.scalar.of_inputs else set(self._equations.independent)

        def stands(key: Expression) -> bool:
            value = whole.outputs.resolve(key)
            return all(number[value[i].element_hash()] in free for i in range(value.numel()))

        return {key: value if stands(key) else near(value) for key, value in start_values(whole, chart.x).items()}

    def stands_at(self, at: Situation) -> bool:
        """Whether a situation is that of the chart's reference."""
        return (
            at.start is self._here
            and not self.atlas.functions.outputs.system.scalar.of_inputs
            and at.t0 == self.chart.t
            and np.array_equal(at.p, self.chart.p)
        )

    def _motion(self, here: AbstractDecided, at: Situation, end: float, options: Options) -> Trajectory:
        from acausal.minimal.through_charts import through_charts

        return through_charts(self, end, at, options)

    @functools.cached_property
    def _equations(self) -> ChartEquations:
        return self.atlas.equations(self.chart.choice)

    @property
    def _x(self) -> ca.SX:
        return self.atlas.functions.outputs.system.x

    @functools.cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        s = self.atlas.functions.outputs.system
        return s.t, ca.SX.sym("y", len(self.state_names)), s.u, s.p

    def __repr__(self) -> str:
        return f"<MinimalModel {self}>"

    def __str__(self) -> str:
        flat = self.atlas.functions.outputs.system.flat
        return f"{flat.name}: {counted(len(self.state_names), 'state')}; {self.chart}"


@on_one_thread
def minimal_model(functions: Functions, at: Situation, prefer: Sequence[Variable], steps: int) -> MinimalModel:
    """Independent coordinates around a start. Raises `StartValueError`, `UnknownVariableError`, `OptionError`."""
    steps = whole_number(steps, "minimal: steps", _FEWEST_STEPS, _MOST_STEPS)
    initial = at.initial(functions)
    check_decided(functions.outputs.system, at.t0, initial.x, at.p)
    atlas = Atlas(functions, steps, np.concatenate(start_units(initial)))
    places = tuple(k for variable in listed(prefer, "minimal: `prefer`", _EXAMPLE) for k in _places(atlas, variable))
    return MinimalModel(atlas, _chart(atlas, at.t0, initial.x, at.p, places), initial, places)


def _chart(atlas: Atlas, t: float, x: Any, p: np.ndarray, prefer: tuple[int, ...]) -> Chart:
    system = atlas.functions.outputs.system
    state = (
        finite_states(atlas.functions.state_names, x)
        if system.scalar.of_inputs
        else consistent_states(atlas.functions, x, t, system.u_defaults, p)
    )
    check_decided(system, t, state, p)
    for begin in atlas.manifold.coordinates.units:
        state[begin : begin + 4] /= np.linalg.norm(state[begin : begin + 4])
    return choose_chart(atlas.manifold, t, state, p, prefer)


def _places(atlas: Atlas, variable: Any) -> list[int]:
    """Places in (c, w) of a variable that is a state. Raises `OptionError`, `UnknownVariableError`."""
    functions, c = atlas.functions, atlas.manifold.coordinates
    s = functions.outputs.system
    if not isinstance(variable, Variable):
        raise OptionError(f"minimal: {variable!r} in `prefer` is not a variable of the scene; use e.g. {_EXAMPLE}.")
    value = functions.outputs.resolve(variable)
    states = {s.x[i].element_hash(): i for i in range(s.x.numel())}
    entries = [states.get(value[i].element_hash()) for i in range(value.numel())]
    if None in entries:
        raise OptionError(
            f"minimal: {functions.outputs.name(variable)} is not a state, so it cannot be independent. The states are "
            f"{', '.join(functions.state_names)}; a joint that closes a loop has none."
        )
    found: list[int] = []
    for i in entries:
        assert i is not None
        found += c.entries(i) if i < s.nq else [c.count + i - s.nq]
    return sorted(set(found))
