"""Reduction: a scene becomes x' = f(t, x, u, p) with the least states, its invariants, and a way to express anything else."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.forward_dynamics import forward_dynamics
from acausal.dynamics.system import MechanicalSystem
from acausal.dynamics.tree import JointSymbols
from acausal.errors import LockedError
from acausal.language.expression import Symbol, stacked, time
from acausal.language.flatten import FlatSystem
from acausal.loops.constraints import Constraints, analyse_constraints
from acausal.loops.loop_forces import loop_forces, on_branch, projection
from acausal.reduce.signals import with_signals
from acausal.scalar.coupling import ScalarPart, add_scalar_domains
from acausal.wording import compact, counted, grouped


@dataclass(frozen=True, repr=False)
class ReducedSystem:
    """States x = (q, v, scalar states), their rates, constraint multipliers and invariants, all as `SX` in t, x, u and p.

    `projection`: one Newton step towards the invariants, in the mass metric.
    """

    flat: FlatSystem
    mechanics: MechanicalSystem
    constraints: Constraints
    t: ca.SX
    x: ca.SX
    u: ca.SX
    p: ca.SX
    p_values: np.ndarray
    u_defaults: np.ndarray
    x_dot: ca.SX
    v_dot: ca.SX
    multipliers: ca.SX
    tau: ca.SX
    position_invariants: ca.SX
    velocity_invariants: ca.SX
    projection: ca.SX | None
    delassus: ca.SX
    """A M^-1 A' of the kept rows: loses rank where a loop is singular."""
    scalar: ScalarPart

    def __str__(self) -> str:
        c = self.constraints
        rows = [
            f"{self.flat.name}: {self.x.numel()} states, {c.jacobian.shape[0]} constraints, {self.degrees_of_freedom} degrees of freedom"
        ]
        edges = [item.edge for item in self.tree_joints]
        rows += grouped([(e.name, f"q {e.joint.q.size}, v {e.joint.v.size}") for e in edges])
        rows += grouped([(self.flat.names.get(s, s.name), f"scalar state [{s.unit}]") for s in self.scalar_states])
        rows += [f"  kept: {compact(c.kept) or 'none'}; redundant: {compact((*c.redundant, *c.vanishing)) or 'none'}"]
        return "\n".join(rows)

    @property
    def scalar_states(self) -> tuple[Symbol, ...]:
        """The states of scalar domains; they come last in x."""
        return self.scalar.states

    @property
    def solved(self) -> dict[Symbol, ca.SX]:
        """Variables of scalar domains, by t, x, u and p."""
        return self.scalar.solved

    @property
    def nq(self) -> int:
        """Number of configuration variables; they come first in x."""
        return self.mechanics.tree.q.numel()

    @property
    def tree_joints(self) -> tuple[JointSymbols, ...]:
        """The joints whose coordinates are states."""
        return self.mechanics.tree.joints

    @property
    def tree_velocities(self) -> int:
        """Number of velocity variables, before loops are closed."""
        return self.mechanics.tree.v.numel()

    @property
    def q_start(self) -> np.ndarray:
        """An assembled configuration (nq,), where the search for initial values begins."""
        return self.constraints.q_start

    @property
    def rate_start(self) -> np.ndarray:
        """Where the search for velocities (zeros) and scalar states (their `start`) begins."""
        return np.concatenate([np.zeros(self.tree_velocities), self.scalar.start])

    @property
    def closing(self) -> ca.SX:
        """All position constraints and joint invariants, redundant ones too, for assembly."""
        loops = [rows.position for rows in self.constraints.loops]
        return ca.vertcat(self.constraints.joint_invariants, *loops, self.scalar.position)

    @property
    def velocity_closing(self) -> ca.SX:
        """All velocity constraints, redundant ones too, and those of scalar states."""
        return ca.vertcat(ca.SX(0, 1), *(rows.velocity for rows in self.constraints.loops), self.scalar.velocity)

    @property
    def degrees_of_freedom(self) -> int:
        """Independent velocities."""
        return self.mechanics.tree.v.numel() - self.constraints.rank.rank - self.scalar.rows


def reduce_system(mechanics: MechanicalSystem, extra: ca.SX | None = None, at: np.ndarray | None = None) -> ReducedSystem:
    """Accelerations, multipliers, scalar states and invariants of a scene. `extra`: more joint forces (nv, 1), by q, t and inputs.
    `at`: values of the parameters for which loops are examined, those of the scene unless given.

    Errors of `analyse_constraints` and `add_scalar_domains`, `MasslessError`.
    """
    flat, tree = mechanics.flat, mechanics.tree
    p = stacked([parameter.sx for parameter in flat.parameters])
    u = stacked([entry.sx for entry in flat.inputs])
    values = np.array([parameter.value for parameter in flat.parameters])
    examined = values if at is None else at
    constraints = analyse_constraints(mechanics, p, examined)
    tau = ca.SX.sym("tau", tree.v.numel())
    forces = loop_forces(mechanics, constraints, p, examined)
    v_dot, multipliers = forces.closed(
        forward_dynamics(
            mechanics.kinematics, tau if extra is None else tau + extra, list(mechanics.wrenches), inertias=forces.inertias
        )
    )
    scalar = add_scalar_domains(mechanics, tau, v_dot)
    if mechanics.readings.borrowed:
        mechanics, v_dot, multipliers, scalar = with_signals(mechanics, v_dot, multipliers, scalar)
    _check_free(mechanics, constraints, scalar)
    v_dot, multipliers = _put(tau, scalar.tau, v_dot), _put(tau, scalar.tau, multipliers)
    states = stacked([s.sx for s in scalar.states])
    x, second = ca.vertcat(tree.q, tree.v, states), ca.vertcat(v_dot, scalar.rates)
    if constraints.singular:
        second = on_branch(second, forces, [time.sx, tree.q, tree.v, states, u, p])
    return ReducedSystem(
        dataclasses.replace(flat, names={**flat.names, **scalar.names}), mechanics, constraints, time.sx, x, u, p, values,
        np.array([entry.default for entry in flat.inputs]), ca.vertcat(tree.rates, second), v_dot, multipliers, scalar.tau if extra is None else scalar.tau + extra,
        ca.vertcat(constraints.joint_invariants, constraints.position, scalar.position),
        ca.vertcat(constraints.velocity, scalar.velocity), _corrected(projection(forces, states), x, scalar), forces.delassus, scalar,
    )  # fmt: skip


def _check_free(mechanics: MechanicalSystem, constraints: Constraints, scalar: ScalarPart) -> None:
    """Gears between joints may leave nothing free; a source may take the last freedom, since it moves."""
    free = mechanics.tree.v.numel() - constraints.rank.rank - scalar.rows
    rows = ca.vertcat(scalar.velocity, constraints.velocity)
    at_rest = ca.substitute(rows, mechanics.tree.v, ca.SX.zeros(mechanics.tree.v.numel()))
    moved = ca.depends_on(ca.vertcat(scalar.position, rows), mechanics.tree.t) or not at_rest.is_zero()
    if scalar.rows and (free < 0 or (free == 0 and not moved)):
        raise LockedError(
            f"Joints cannot move: against their {counted(mechanics.tree.v.numel(), 'freedom')} stand {constraints.rank.rank} constraints of loops "
            f"and {scalar.rows} of gears and sources, from {', '.join(list(dict.fromkeys(scalar.holding))[:4])}. Remove a source or a gear, or put "
            "a spring between."
        )


def _corrected(projected: ca.SX | None, x: ca.SX, scalar: ScalarPart) -> ca.SX | None:
    """The projection onto loops and joints' invariants, and onto those of scalar domains."""
    if scalar.correction is None:
        return projected
    return (x if projected is None else projected) + ca.vertcat(*scalar.correction)


def _put(symbol: ca.SX, value: ca.SX, expression: ca.SX) -> ca.SX:
    return ca.substitute(expression, symbol, value) if symbol.numel() else expression
