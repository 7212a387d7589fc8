"""The equations of motion in the least number of states: an ordinary differential equation without invariants."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.arguments import finite, listed, whole_number
from acausal.charts.chart import Chart, Choice, choose_chart
from acausal.charts.chart_space import chart_space
from acausal.charts.equations import ChartEquations
from acausal.charts.manifold import Manifold, manifold
from acausal.collocation.problem import Accuracy
from acausal.errors import OptionError
from acausal.integrators.step import step_of
from acausal.language.expression import Expression, Variable
from acausal.minimal.motion import MinimalMotion
from acausal.numerics.folding import folded_function
from acausal.outputs.functions import Functions
from acausal.start.assembly_function import start_units
from acausal.start.decided import check_decided
from acausal.start.initial import InitialState
from acausal.start.situation import InputValues, ParameterValues, Situation, StartValues, situation
from acausal.start.states import consistent_states

if TYPE_CHECKING:
    from acausal.analysis.actuation import Unknown
    from acausal.analysis.inverse_dynamics import InverseDynamics
    from acausal.analysis.linearize import Linearization
    from acausal.analysis.prescribed import Given

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


@dataclass(frozen=True, repr=False)
class MinimalModel:
    """y' = f(t, y, u, p) of least dimension, around the reference state of `chart`.

    y = (independent positions, independent velocities and scalar states), named in `state_names`. Unit quaternions are replaced by three
    modified Rodrigues parameters (`rodrigues`) of the rotation since the reference; velocities stay angular velocities. What depends on
    y is found by Newton steps from the reference in straight-line code; where they do not converge, or the chart has ended, every
    function gives NaN. All functions are CasADi `SX` functions with exact derivatives. `initial`: how start values were met; `prefer`:
    places in (c, w) asked for.
    """

    atlas: Atlas
    chart: Chart
    initial: InitialState
    prefer: tuple[int, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return MinimalModel, (self.atlas, self.chart, self.initial, self.prefer)

    @functools.cached_property
    def functions(self) -> Functions:
        """Named CasADi functions of y in place of x: dynamics, energies, outputs; there are no invariants."""
        return Functions(self.atlas.functions.outputs, chart_space(self._equations, self.chart))

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of y, in order."""
        return self.chart.independent

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs u, in order."""
        return self.functions.input_names

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters p, in order."""
        return self.functions.parameter_names

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
        """(t, y, u, p) -> x, the states of the model."""
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
        total = ca.SX(0) if invariants is None else ca.sumsqr(invariants(t, x, p))
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
        """The chart that is best at another state x (nx,) of the model, at time `t` [s], by default that of this chart.

        Raises `StartValueError` where x does not meet the invariants or is singular.
        """
        functions = self.atlas.functions
        at = situation(functions.outputs, None, self.chart.t if t is None else t, None, parameters, clock="time t")
        functions.decisions.check(at.p)
        return replace(self, chart=_chart(self.atlas, at.t0, x, self.chart.p if parameters is None else at.p, self.prefer))

    def step(self, method: str = "gauss", order: int = 4, h: float | None = None) -> ca.Function:
        """One implicit step, (t, y, u, p, h) -> (y_next, residual), as that of `Model.step`; there is nothing to be closed again."""
        return step_of(self.functions, method, order, h)

    def linearize(self, *, outputs: Sequence[Expression | str] = (), inputs: InputValues | None = None) -> Linearization:
        """The linear system in y at the chart's reference; see `Model.linearize`."""
        from acausal.analysis.linearize import linearize_in
        from acausal.analysis.point import operating_point

        whole = self.atlas.functions
        point = operating_point(whole, self._situation(None, inputs), self.chart.x)
        column = self._equations.restrict(whole.outputs.system.x, self.chart.reference)
        return linearize_in(whole, point, column, self.state_names, whole.outputs.system.flat.symbols(outputs))

    def inverse_dynamics(
        self,
        times: Sequence[float],
        motions: Mapping[Expression, Given],
        unknowns: Sequence[Unknown],
        inputs: InputValues | None = None,
    ) -> InverseDynamics:
        """The forces that make variables move as prescribed, from the branch of loops of the chart on; see `Model.inverse_dynamics`."""
        from acausal.analysis.inverse_dynamics import inverse_dynamics, times_of
        from acausal.analysis.point import start_values

        whole, t = self.atlas.functions, times_of(times)
        at = replace(self._situation(start_values(whole, self.chart.x), inputs), t0=float(t[0]))
        return inverse_dynamics(whole, at, t, whole.outputs.system.flat.symbols(motions), unknowns)

    def inverse_dynamics_function(self, variables: Sequence[Expression], unknowns: Sequence[Unknown]) -> ca.Function:
        """(t, y, a, u, p) -> force; see `Model.inverse_dynamics_function`."""
        from acausal.analysis.inverse_dynamics import inverse_dynamics_function

        whole, (t, y, u, p) = self.atlas.functions, self._symbols
        found = inverse_dynamics_function(whole, whole.outputs.system.flat.symbols(variables), unknowns)
        a = ca.SX.sym("a", found.size1_in(2))
        arguments = [t, y, a, u, p]
        return folded_function(
            "inverse_dynamics", arguments, [found(t, self.expand(t, y, u, p), a, u, p)], ["t", "y", "a", "u", "p"], ["force"]
        )

    def export_c(self, folder: str | Path) -> Path:
        """Write C source, header and a build line for the functions of y; returns the folder."""
        from acausal.export.c_source import export_c

        return export_c(self.functions, folder)

    def _situation(self, start: StartValues | None, inputs: InputValues | None) -> Situation:
        return replace(situation(self.atlas.functions.outputs, start, self.chart.t, inputs), p=self.chart.p)

    def simulate(
        self,
        end: float,
        start: StartValues | None = None,
        *,
        rtol: float = 1e-8,
        atol: float | None = None,
        inputs: InputValues | None = None,
        samples: int = 501,
        method: str = "auto",
        compiled: bool = True,
        max_steps: int = 1_000_000,
        raise_on_failure: bool = True,
    ) -> MinimalMotion:
        """The motion to `end` [s] by integration of y, with another chart wherever one comes to its end.

        It begins at the reference of this chart, or at `start` values, at the chart's time and with its parameters. Other arguments and
        errors as for `Model.simulate`; `SimulationError` also where the motion becomes singular.
        """
        from acausal.minimal.through_charts import through_charts
        from acausal.simulate.simulation import Options

        options = Options.asked(Accuracy.asked(rtol, atol, None, max_steps), method, samples, compiled, raise_on_failure)
        at = self._situation(start, inputs)
        return through_charts(self, finite(end, "simulate: the end [s]"), at, start is not None, options)

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
        return f"{flat.name}: {len(self.state_names)} states; {self.chart}"


def minimal_model(functions: Functions, at: Situation, prefer: Sequence[Variable], steps: int) -> MinimalModel:
    """Independent coordinates around a start. Raises `StartValueError`, `UnknownVariableError`, `OptionError`."""
    steps = whole_number(steps, "minimal: steps", _FEWEST_STEPS, _MOST_STEPS)
    initial = at.initial(functions)
    check_decided(functions.outputs.system, at.t0, initial.x, at.p)
    atlas = Atlas(functions, steps, np.concatenate(start_units(initial)))
    places = tuple(k for variable in listed(prefer, "minimal: `prefer`", _EXAMPLE) for k in _places(atlas, variable))
    return MinimalModel(atlas, _chart(atlas, at.t0, initial.x, at.p, places), initial, places)


def _chart(atlas: Atlas, t: float, x: Any, p: np.ndarray, prefer: tuple[int, ...]) -> Chart:
    state = consistent_states(atlas.functions, x, t, p)
    check_decided(atlas.functions.outputs.system, t, state, p)
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
