"""What a scene's states must obey: rows in configurations alone, and rows that also take velocities and scalar states."""

from __future__ import annotations

import functools
from dataclasses import dataclass, fields, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.charts.rodrigues import ChartCoordinates
from acausal.charts.singular_state import scaled_rows
from acausal.numerics.folding import folded_function
from acausal.numerics.terms import rounded
from acausal.numerics.thresholds import ROUNDING
from acausal.outputs.functions import Functions
from acausal.parts.unit_quaternions import unit_quaternions

_POINTS = 8
_SAME = 1e-11
"""Where it is looked whether a direction is invariant, and by how much the terms of a sum may differ from zero."""


@dataclass(frozen=True)
class Slopes:
    """Derivatives at one state: of the rows of positions in c, `position` (m1, nc), and of the others in w = (v, scalar states),
    `rate` (m2, nw)."""

    position: np.ndarray
    rate: np.ndarray


@dataclass(frozen=True, repr=False)
class Manifold:
    """The invariants of a model, sorted for charts: `position` (t, q, p) -> (m1, 1), `rate` (t, q, w, p) -> (m2, 1), redundant ones too.

    Lengths of unit quaternions are left out, since `coordinates` keep them by themselves, and rows that nothing changes where they are 1. `twins`: pairs
    of an entry of c and an entry of w that is its rate.
    """

    functions: Functions
    coordinates: ChartCoordinates
    position: ca.Function
    rate: ca.Function
    twins: tuple[tuple[int, int], ...]
    units: np.ndarray

    def __reduce__(self) -> tuple[Any, ...]:
        """Without what has been made of its values so far."""
        return Manifold, tuple(getattr(self, entry.name) for entry in fields(self))

    @functools.cached_property
    def units_c(self) -> np.ndarray:
        """What is much for each entry of c (nc,)."""
        return np.concatenate([np.zeros(0), *(np.full(size, self.units[k]) for k, size in self.coordinates.places)])

    @property
    def units_w(self) -> np.ndarray:
        """What is much for each entry of w (nw,)."""
        return self.units[self.coordinates.size :]

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
        return [np.array(position) * self.units_c for position, _ in found], [np.array(rate) * self.units_w for _, rate in found]

    @functools.cached_property
    def row_sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """Greatest lengths of the rows' derivatives by c and by w in their units, anywhere: what is much for each row."""
        positions, rates = zip(*self._anywhere, strict=True)
        return _greatest([J * self.units_c for J in positions]), _greatest([K * self.units_w for K in rates])

    @functools.cached_property
    def _anywhere(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """`_slopes` at configurations, times and parameters that need not be assembled."""
        s = self.functions.outputs.system
        found: list[tuple[np.ndarray, np.ndarray]] = []
        for t, q, p in self._places:
            position, rate = self._slopes(t, np.concatenate([q, s.rate_start]), p)
            found.append((np.array(position), np.array(rate)))
        return found

    @functools.cached_property
    def _places(self) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Times, configurations (nq,) that need not be assembled, and parameters (np,)."""
        s, rng = self.functions.outputs.system, np.random.default_rng(7)
        found: list[tuple[float, np.ndarray, np.ndarray]] = []
        for _ in range(_POINTS):
            q = s.q_start + self.units[: s.nq] * rng.normal(size=s.nq)
            for k in self.coordinates.units:
                q[k : k + 4] /= np.linalg.norm(q[k : k + 4])
            p = s.p_values * rng.uniform(0.8, 1.25, s.p_values.size)
            found.append((rng.normal(), q, p))
        return found

    @property
    def without_rounding(self) -> Manifold:
        """The same without rows whose slopes are rounding wherever quaternions have length 1: the height of a ball between two plates."""
        s = self.functions.outputs.system
        q, w = s.x[: s.nq], s.x[s.nq :]
        position, rate = self.position(s.t, q, s.p), self.rate(s.t, q, w, s.p)
        terms = ca.Function("terms", [s.t, q, w, s.p], [ca.densify(rounded(part)) for part in (position, rate)])
        felt = [np.zeros(position.numel(), dtype=bool), np.zeros(rate.numel(), dtype=bool)]
        for (t, at, p), slopes in zip(self._places, self._anywhere, strict=True):
            sizes = terms(t, at, self.units_w, p)
            for k, (J, units) in enumerate(zip(slopes, (self.units_c, self.units_w), strict=True)):
                felt[k] |= ~(np.linalg.norm(J * units, axis=1) <= ROUNDING * np.array(sizes[k])[:, 0])
        if all(part.all() for part in felt):
            return self
        kept = [_rows(part, np.flatnonzero(own).tolist()) for part, own in zip((position, rate), felt, strict=True)]
        return replace(
            self,
            position=ca.Function("position", [s.t, q, s.p], [kept[0]]),
            rate=ca.Function("rate", [s.t, q, w, s.p], [kept[1]]),
        )

    def invariant_direction(self, i: int, dependent: tuple[int, ...]) -> np.ndarray | None:
        """A constant direction (nc,) along which no row of positions changes, whatever c is, with 1 for entry `i` and something else than zero
        only for the `dependent` ones: a wheel's turn with that of its contact. None where there is none like that.
        """
        direction, rest = np.eye(self.coordinates.count)[i], list(dependent)
        J = self._samples[0][0]
        found = np.linalg.lstsq(J[:, rest], J[:, i], rcond=None)[0]
        direction[rest] = -found * self.units_c[rest] / self.units_c[i]
        whole = np.round(direction)
        direction = np.where(np.abs(direction - whole) < 1e-9, whole, direction)
        for J, _ in self._anywhere:
            if not (np.abs(J @ direction) <= _SAME * (np.abs(J) @ np.abs(direction))).all():
                return None
        return direction

    def slopes(self, t: float, x: np.ndarray, p: np.ndarray) -> Slopes:
        """At a state x (nx,), by c and w in their units, each row divided by its usual length."""
        position, rate = (
            np.array(J) * units for J, units in zip(self._slopes(t, x, p), (self.units_c, self.units_w), strict=True)
        )
        much = self.row_sizes
        return Slopes(scaled_rows(position, self._samples[0], much[0]), scaled_rows(rate, self._samples[1], much[1]))


def _greatest(samples: list[np.ndarray]) -> np.ndarray:
    """Greatest lengths of rows, none of which is rounding wherever it was looked."""
    return np.nanmax([np.linalg.norm(J, axis=1) for J in samples], axis=0)


def manifold(functions: Functions, units: np.ndarray) -> Manifold:
    """The invariants of a model in which no input stands, sorted; what inputs prescribe is followed by their rates. `units`: what is much for each state (nx,)."""
    s = functions.outputs.system
    nv = s.tree_velocities
    q, w = s.x[: s.nq], s.x[s.nq :]
    quaternions = unit_quaternions(s.position_invariants, q)
    positions = (s.position_invariants[k] for k in range(s.position_invariants.numel()) if k not in quaternions)
    everything = ca.vertsplit(ca.vertcat(*positions, s.velocity_invariants, ca.SX(0, 1)))
    rows = ca.vertcat(*(row for row in everything if not ca.depends_on(row, s.u)), ca.SX(0, 1))
    own = {w[i].element_hash() for i in range(w.numel())}
    moving = [any(symbol.element_hash() in own for symbol in ca.symvar(rows[k])) for k in range(rows.numel())]
    position = _rows(rows, [k for k, m in enumerate(moving) if not m])
    rate = _rows(rows, [k for k, m in enumerate(moving) if m])
    coordinates = ChartCoordinates(s.nq, tuple(sorted(quaternions.values())))
    rates, place = s.mechanics.tree.rates, {w[i].element_hash(): i for i in range(nv)}
    twins: list[tuple[int, int]] = []
    for i in range(rates.numel()):
        if rates[i].is_symbolic() and rates[i].element_hash() in place:
            twins.append((coordinates.entries(i)[0], place[rates[i].element_hash()]))
    return Manifold(
        functions, coordinates, ca.Function("position", [s.t, q, s.p], [position]), ca.Function("rate", [s.t, q, w, s.p], [rate]), tuple(twins), units
    ).without_rounding  # fmt: skip


def _rows(rows: ca.SX, chosen: list[int]) -> ca.SX:
    return ca.densify(rows[chosen]) if chosen else ca.SX(0, 1)
