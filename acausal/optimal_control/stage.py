"""One point of a motion with everything that belongs to it: states, accelerations, multipliers of loops, inputs, all as unknowns.

The equations of motion stand in residual form, since recursive Newton-Euler with the accelerations as unknowns has a fraction of the operations of the
explicit dynamics, above all in second derivatives.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.language.expression import Expression, Parameter
from acausal.numerics.folding import folded_function
from acausal.outputs.functions import Functions


@dataclass(frozen=True, eq=False)
class Stage:
    """`functions` of a model whose time runs from `t0` [s]; `p` (np,): values of parameters; `free`: those that are found with the motion."""

    functions: Functions
    t0: float
    p: np.ndarray
    free: tuple[Parameter, ...]

    @functools.cached_property
    def sizes(self) -> tuple[int, int, int, int]:
        """Of states, accelerations, multipliers and inputs."""
        space, system = self.functions.space, self.functions.outputs.system
        return space.x.numel(), space.velocities, system.constraints.jacobian.shape[0], system.u.numel()

    @property
    def width(self) -> int:
        """Number of unknowns at a point."""
        return sum(self.sizes)

    @functools.cached_property
    def unknowns(self) -> ca.SX:
        """States, accelerations, multipliers, inputs, then the duration of the motion [s] and free parameters."""
        _, velocities, loops, _ = self.sizes
        space, system = self.functions.space, self.functions.outputs.system
        self_made = ca.SX.sym("acceleration", velocities), ca.SX.sym("multipliers", loops)
        geometry = ca.SX.sym("free", len(self.free))
        return ca.vertcat(space.x, *self_made, system.u, ca.SX.sym("duration"), geometry)

    @functools.cached_property
    def data(self) -> ca.SX:
        """When: as a part of the duration; and the length of the interval, likewise."""
        return ca.SX.sym("when", 2)

    @functools.cached_property
    def _parts(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
        ends = np.cumsum([*self.sizes, 1, len(self.free)]).tolist()
        w = self.unknowns
        x, a, loops, u, duration, geometry = (w[b:e, :] for b, e in zip([0, *ends[:-1]], ends, strict=True))
        return x, a, loops, u, duration, geometry

    @property
    def duration(self) -> ca.SX:
        """Of the whole motion [s]."""
        return self._parts[4]

    def put(self, expression: ca.SX) -> ca.SX:
        """An expression in t, x, u, p as one of `unknowns` and `data`."""
        space, system = self.functions.space, self.functions.outputs.system
        p = ca.SX(self.p)
        known = list(system.flat.parameters)
        for k, parameter in enumerate(self.free):
            p[known.index(parameter)] = self._parts[5][k]
        found = ca.substitute([expression], [system.t, space.p], [self.t0 + self.data[0] * self.duration, p])
        return found[0]

    @functools.cached_property
    def rates(self) -> ca.SX:
        """x' (nx, 1): of positions by velocities, of velocities the unknown accelerations, of other states as they are."""
        space = self.functions.space
        given = space.put(space.kept(self.functions.outputs.system.x_dot))
        first, last = space.nq, space.nq + space.velocities
        return ca.vertcat(given[:first, :], self._parts[1], given[last:, :])

    @functools.cached_property
    def balance(self) -> ca.SX:
        """What is off of the equations of motion: of forces, then of accelerations of loops."""
        space = self.functions.space
        x, _, loops, u, _, _ = self._parts
        t = self.functions.outputs.system.t
        residual = self.functions.residual_dynamics(t, x, self.rates, loops, u, space.p)
        first, last, end = space.nq, space.nq + space.velocities, space.x.numel()
        return ca.vertcat(residual[first:last, :], residual[end:, :])

    @functools.cached_property
    def invariants(self) -> tuple[ca.SX, int]:
        """What is off of loops and of lengths of quaternions, and how many of these rows are of positions; the first ones."""
        f = self.functions
        if f.invariants is None:
            return ca.SX(0, 1), 0
        rows = f.invariants(f.outputs.system.t, f.space.x, f.space.p)
        return rows, f.constraint_position.numel_out(0)

    @functools.cached_property
    def closing(self) -> ca.Function:
        """(unknowns, data) -> invariants, and their slopes by the states (rows, nx)."""
        return self._with_slopes(self.invariants[0], 0, self.sizes[0])

    @functools.cached_property
    def moving(self) -> ca.Function:
        """(unknowns, data) -> rates of positions, and their slopes by the velocities (nq, velocities)."""
        nq, nv = self.functions.space.nq, self.sizes[1]
        return self._with_slopes(self.rates[:nq, :], nq, nq + nv)

    @functools.cached_property
    def driving(self) -> ca.Function:
        """(unknowns, data) -> `balance`, and its slopes by accelerations, multipliers and inputs."""
        return self._with_slopes(self.balance, self.sizes[0], self.width)

    def _with_slopes(self, column: ca.SX, first: int, last: int) -> ca.Function:
        inside = self.put(column)
        slopes = ca.densify(ca.jacobian(inside, self.unknowns)[:, first:last])
        return folded_function("with_slopes", [self.unknowns, self.data], [inside, slopes])

    def opened(self, wanted: Expression | float) -> ca.SX:
        """A user's expression (n, 1) in t, x, u, p and the other unknowns: reactions by accelerations and multipliers, not by solving for them."""
        if not isinstance(wanted, Expression):
            return ca.SX(float(wanted))
        f, s = self.functions, self.functions.outputs.system
        given, _ = f.outputs.given_by_dynamics
        found = ca.vec(ca.densify(f.outputs.opened(wanted)))
        if ca.depends_on(found, given):
            everything = f.space.put(s.x)
            full = ca.jacobian(everything, f.space.x) @ self.rates + ca.jtimes(everything, s.t, ca.SX(1))
            found = ca.substitute(found, given, ca.vertcat(full, self._parts[2]))
        return f.space.put(found)

    def used(self, expressions: Sequence[ca.SX]) -> list[int]:
        """Numbers of the `unknowns` that stand in expressions that have been `put`."""
        inside = {s.element_hash() for e in expressions for s in ca.symvar(e)}
        return [k for k in range(self.unknowns.numel()) if self.unknowns[k].element_hash() in inside]
