"""What a scene's states must obey: rows in configurations alone, and rows that also take velocities and scalar states."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.charts.coordinates import ChartCoordinates
from acausal.charts.singular_state import scaled_rows
from acausal.numerics.folding import folded_function
from acausal.outputs.functions import Functions
from acausal.reduce.unit_quaternions import unit_quaternions


@dataclass(frozen=True)
class Slopes:
    """Derivatives at one state: of the rows of positions in c, `position` (m1, nc), and of the others in w = (v, scalar states),
    `rate` (m2, nw)."""

    position: np.ndarray
    rate: np.ndarray


@dataclass(frozen=True, repr=False)
class Manifold:
    """The invariants of a model, sorted for charts: `position` (t, q, p) -> (m1, 1), `rate` (t, q, w, p) -> (m2, 1), redundant ones too.

    Lengths of unit quaternions are left out: `coordinates` keep them by themselves. `twins`: pairs of an entry of c and an entry of w that
    is its rate.
    """

    functions: Functions
    coordinates: ChartCoordinates
    position: ca.Function
    rate: ca.Function
    twins: tuple[tuple[int, int], ...]

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Of c and w."""
        states = self.functions.state_names
        return self.coordinates.names(states) + states[self.coordinates.size :]

    @functools.cached_property
    def _slopes(self) -> ca.Function:
        s = self.functions.outputs.system
        q, w = s.x[: s.nq], s.x[s.nq :]
        c = ca.SX.sym("c", self.coordinates.count)
        position = ca.jacobian(self.position(s.t, self.coordinates.configuration(c, q), s.p), c)
        position = ca.substitute(position, c, self.coordinates.coordinates(q, q))
        return folded_function(
            "slopes", [s.t, s.x, s.p], [ca.densify(position), ca.densify(ca.jacobian(self.rate(s.t, q, w, s.p), w))]
        )

    @functools.cached_property
    def _samples(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """`_slopes` at some assembled configurations."""
        s = self.functions.outputs.system
        found = [self._slopes(0.0, np.concatenate([q, s.rate_start]), s.p_values) for q in s.closed_positions]
        return [np.array(position) for position, _ in found], [np.array(rate) for _, rate in found]

    def slopes(self, t: float, x: np.ndarray, p: np.ndarray) -> Slopes:
        """At a state x (nx,), each row divided by its usual length."""
        position, rate = (np.array(J) for J in self._slopes(t, x, p))
        return Slopes(scaled_rows(position, self._samples[0]), scaled_rows(rate, self._samples[1]))


def manifold(functions: Functions) -> Manifold:
    """The invariants of a model, sorted."""
    s = functions.outputs.system
    nv = s.tree_velocities
    q, w = s.x[: s.nq], s.x[s.nq :]
    units = unit_quaternions(s.position_invariants, q)
    rows = ca.vertcat(
        *(s.position_invariants[k] for k in range(s.position_invariants.numel()) if k not in units),
        s.velocity_invariants,
        ca.SX(0, 1),
    )
    own = {w[i].element_hash() for i in range(w.numel())}
    moving = [any(symbol.element_hash() in own for symbol in ca.symvar(rows[k])) for k in range(rows.numel())]
    position = _rows(rows, [k for k, m in enumerate(moving) if not m])
    rate = _rows(rows, [k for k, m in enumerate(moving) if m])
    coordinates = ChartCoordinates(s.nq, tuple(sorted(units.values())))
    rates, place = s.mechanics.tree.rates, {w[i].element_hash(): i for i in range(nv)}
    twins: list[tuple[int, int]] = []
    for i in range(rates.numel()):
        if rates[i].is_symbolic() and rates[i].element_hash() in place:
            twins.append((coordinates.entries(i)[0], place[rates[i].element_hash()]))
    return Manifold(
        functions, coordinates, ca.Function("position", [s.t, q, s.p], [position]), ca.Function("rate", [s.t, q, w, s.p], [rate]), tuple(twins)
    )  # fmt: skip


def _rows(rows: ca.SX, chosen: list[int]) -> ca.SX:
    return ca.densify(rows[chosen]) if chosen else ca.SX(0, 1)
