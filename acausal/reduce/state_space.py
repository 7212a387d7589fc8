"""The states that a simulation carries: those of the reduced system less what follows from them in closed form."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.numerics.vanishing import Vanishing, vanishing
from acausal.reduce.elimination import Elimination, eliminate
from acausal.reduce.reduce import ReducedSystem
from acausal.wording import compact


@dataclass(frozen=True)
class Coordinates:
    """States that are coordinates of a chart: their `names`, the states of the system that they stand for (`places`; of a quaternion the first
    one), themselves by the system's states (`column`), how many of them are `positions`, and how
    many after these `velocities` of the tree. `expand`: times (n,), coordinates (ny, n) and parameters -> the system's states (nx, n). `made_by`,
    from what: for copies.
    """

    names: tuple[str, ...]
    places: tuple[int, ...]
    column: ca.SX
    expand: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    positions: int
    velocities: int
    made_by: tuple[Callable[..., StateSpace], tuple[Any, ...]]


@dataclass(frozen=True, repr=False)
class StateSpace:
    """`x` (nx, 1), from which `elimination` gives the system's states; `p`: parameters, then constants of integration.

    Three kinds: all states of the system (`whole_state_space`); those that do not follow from others in closed form (`state_space`); `coordinates`
    of a chart, which obey no constraints. `places`: of x among the system's states, where it is a part of them.
    """

    system: ReducedSystem
    elimination: Elimination
    x: ca.SX
    p: ca.SX
    places: tuple[int, ...]
    coordinates: Coordinates | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        if self.coordinates is not None:
            return self.coordinates.made_by
        return (state_space if self.elimination.symbols else whole_state_space), (self.system,)

    def names(self, all_names: Sequence[str]) -> tuple[str, ...]:
        """Of x, from those of the system's states."""
        return tuple(all_names[i] for i in self.places) if self.coordinates is None else self.coordinates.names

    @property
    def arguments(self) -> list[ca.SX]:
        """t, x, u, p."""
        return [self.system.t, self.x, self.system.u, self.p]

    def put(self, expression: ca.SX) -> ca.SX:
        """An expression of the system's states in x and p."""
        return self.elimination.put(expression)

    def kept(self, column: ca.SX) -> ca.SX:
        """Rates or changes of x by those of all states, in x and p."""
        if self.coordinates is not None:
            return self.put(ca.jtimes(self.coordinates.column, self.system.x, column))
        return self.put(column[list(self.places)]) if self.elimination.symbols else column

    def constraints(self, rows: ca.SX) -> ca.SX:
        """Residuals (n, 1) in t, the system's states and p that the elimination has not made zero."""
        left = self.left(rows)
        return (
            rows
            if len(left) == rows.numel() and not self.elimination.symbols
            else self.put(rows)[left, :]
            if left
            else ca.SX(0, 1)
        )

    def left(self, rows: ca.SX) -> list[int]:
        """Which residuals of the system these are."""
        if self.coordinates is not None:
            return []
        if not self.elimination.symbols:
            return list(range(rows.numel()))
        return [int(i) for i in np.flatnonzero(self._open(rows, self.system.p_values))]

    @functools.cached_property
    def identities(self) -> ca.SX:
        """Residuals (n, 1) in t, the system's states and p that are zero whatever x is: invariants that the elimination has made so, and what follows from others."""
        s = self.system
        rows = ca.vertcat(ca.SX(0, 1), *(h.residual for h in s.scalar.redundant))
        if self.elimination.symbols and self.coordinates is None:
            rows = ca.vertcat(s.position_invariants, s.velocity_invariants, rows)
        return rows[[int(i) for i in np.flatnonzero(~self._open(rows, s.p_values))], :]

    def complaint(self, values: np.ndarray) -> str:
        """What was decided at the build and does not hold at these values of parameters (np,), in words; empty where all holds."""
        s = self.system
        changed = np.flatnonzero(values != s.p_values).tolist()
        if s.scalar.looped and ca.depends_on(s.closing, s.p[changed]):
            return f"it is open whether loops still hold what these say: {compact(dict.fromkeys(h.name for h in s.scalar.looped), 4)}"
        if not ca.depends_on(self.put(self.identities), s.p[changed]) or not self._open(self.identities, values).any():
            return ""
        held = dict.fromkeys(h.name for h in (*s.scalar.held, *s.scalar.redundant))
        return (
            "constraints that follow from others at the build's values do not follow any more, or a coordinate can no longer be found from others: "
            f"{compact(held, 4)}"
        )

    def _open(self, rows: ca.SX, values: np.ndarray) -> np.ndarray:
        """Which rows (n,) do not vanish for all states x, at these values of parameters (np,)."""
        answers = vanishing(self.put(rows), self.system.p, values)
        return np.array([answer is not Vanishing.YES for answer in answers], dtype=bool)

    @functools.cached_property
    def nq(self) -> int:
        """Number of configuration variables in x; they come first."""
        return sum(i < self.system.nq for i in self.places) if self.coordinates is None else self.coordinates.positions

    @property
    def velocities(self) -> int:
        """Number of the tree's velocities in x; they come next."""
        if self.coordinates is not None:
            return self.coordinates.velocities
        return self.system.tree_velocities - len(self.elimination.rates)

    @property
    def p_values(self) -> np.ndarray:
        """Parameters as built, and the constants of the assembled sketch."""
        s = self.system
        return self.extended(0.0, np.concatenate([s.q_start, s.rate_start]), s.p_values)

    def restricted(self, x: np.ndarray) -> np.ndarray:
        """(nx,) or (nx, n) of states of the system."""
        if self.coordinates is not None:
            return np.array(self.restriction(x)).reshape(-1, *x.shape[1:])
        return x[list(self.places)] if self.elimination.symbols else x

    @functools.cached_property
    def restriction(self) -> ca.Function:
        """The system's states -> x."""
        x = self.system.x
        column = x[list(self.places)] if self.coordinates is None else self.coordinates.column
        return ca.Function("restriction", [x], [ca.densify(column)])

    def restricted_change(self, x: np.ndarray, dx: np.ndarray) -> np.ndarray:
        """(nx, n) for changes dx (nx, n) of the system's states at x (nx,)."""
        return self.restricted(dx) if self.coordinates is None else np.array(self.restriction.jacobian()(x, 0)) @ dx

    def extended(self, t: float, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Parameters with the constants of integration of a motion that passes the system's states x at time t."""
        if not self.elimination.constants.numel():
            return p
        return np.concatenate([p, np.array(self._constants(t, x, p)).ravel()])

    def extended_change(self, t: float, x: np.ndarray, p: np.ndarray, dx: np.ndarray, dp: np.ndarray) -> np.ndarray:
        """Their changes (np + constants, n) for changes dx (nx, n) and dp (np, n)."""
        by_x, by_p = (np.array(part) for part in self._slopes(t, x, p))
        return np.vstack([dp, by_x @ dx + by_p @ dp])

    def expanded(self, t: float | np.ndarray, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """The system's states (n,) or (n, m), for x (nx,) or (nx, m) at time t or times (m,), and p with its constants."""
        if not self.elimination.symbols:
            return x
        times = np.atleast_1d(t)
        columns, parameters = x.reshape(-1, times.size), np.repeat(p[:, None], times.size, axis=1)
        if self.coordinates is not None:
            found = self.coordinates.expand(times, columns, p)
        else:
            found = np.array(self._everything(times[None, :], columns, parameters))
        return found.reshape(-1, *x.shape[1:])

    @functools.cached_property
    def _constants(self) -> ca.Function:
        s = self.system
        return ca.Function("constants", [s.t, s.x, s.p], [ca.densify(self.elimination.sources)])

    @functools.cached_property
    def _slopes(self) -> ca.Function:
        s, c = self.system, self.elimination.sources
        return ca.Function("slopes", [s.t, s.x, s.p], [ca.densify(ca.jacobian(c, s.x)), ca.densify(ca.jacobian(c, s.p))])

    @functools.cached_property
    def _everything(self) -> ca.Function:
        return ca.Function("everything", [self.system.t, self.x, self.p], [ca.densify(self.put(self.system.x))])


def whole_state_space(system: ReducedSystem) -> StateSpace:
    """With all states of the system."""
    return StateSpace(system, Elimination.none(), system.x, system.p, tuple(range(system.x.numel())))


def state_space(system: ReducedSystem) -> StateSpace:
    """With the states that do not follow from others; with all, if none would be left."""
    moving = ca.vertcat(system.x, system.u)
    found = eliminate(
        system.mechanics.tree,
        system.position_invariants,
        system.velocity_invariants,
        moving,
        system.p,
        system.p_values,
        system.scalar.position,
    )
    nq = system.nq
    gone = {*found.places, *(nq + j for j in found.rates)}
    places = tuple(i for i in range(system.x.numel()) if i not in gone)
    if not gone or not places:
        return whole_state_space(system)
    return StateSpace(system, found, system.x[list(places)], ca.vertcat(system.p, found.constants), places)
