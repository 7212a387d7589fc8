"""The coordinates of a chart as states, of which everything is a function as it is of all states."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from acausal.charts.chart import Chart
from acausal.charts.equations import ChartEquations
from acausal.reduce.elimination import Elimination
from acausal.reduce.state_space import Coordinates, StateSpace


def chart_space(equations: ChartEquations, chart: Chart) -> StateSpace:
    """Around the reference of a chart; NaN where it has ended."""
    s, choice = equations.manifold.functions.outputs.system, chart.choice
    y = ca.SX.sym("y", len(chart.independent))
    everything = equations.expand(s.t, y, s.p, chart.reference)

    def expand(t: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        columns = [np.repeat(v[:, None], t.size, axis=1) for v in (p, chart.reference)]
        return np.array(equations.expand(t[None, :], y, *columns)).reshape(-1, t.size)

    coordinates = Coordinates(
        chart.independent,
        equations.places,
        equations.restrict(s.x, chart.reference),
        expand,
        len(choice.positions),
        sum(i < s.tree_velocities for i in choice.rates),
        (chart_space, (equations, chart)),
    )
    elimination = replace(Elimination.none(), symbols=(s.x,), values=(everything,))
    return StateSpace(s, elimination, y, s.p, (), coordinates)
