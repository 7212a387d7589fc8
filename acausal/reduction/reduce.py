"""Reduction: a scene becomes x' = f(t, x, u, p) with the least states, its invariants, and a way to express anything else."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.language.expression import Symbol, time
from acausal.language.flatten import FlatSystem
from acausal.mechanics.forward_dynamics import forward_dynamics, zero_wrenches
from acausal.mechanics.kernels import solve_positive
from acausal.mechanics.system import MechanicalSystem
from acausal.mechanics.tree import JointSymbols
from acausal.reduction.constraints import Constraints, analyse_constraints


@dataclass(frozen=True)
class ReducedSystem:
    """States x = (q, v), their rates, constraint multipliers and invariants, all as `SX` in t, x, u and p.

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
    solved: dict[Symbol, ca.SX] = field(default_factory=dict)
    """Variables of scalar domains, by t, x, u and p."""

    @functools.cached_property
    def kinetic_energy(self) -> ca.SX:
        """[J]."""
        return self.mechanics.kinetic_energy()

    @functools.cached_property
    def potential_energy(self) -> ca.SX:
        """Of gravity and of all components that store energy [J]."""
        return self.mechanics.potential_energy()

    @functools.cached_property
    def power_loss(self) -> ca.SX:
        """Dissipated less supplied power [W]."""
        return self.mechanics.power_loss()

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
    def closing(self) -> ca.SX:
        """All position constraints and joint invariants, redundant ones too, for assembly."""
        return ca.vertcat(self.constraints.joint_invariants, *(rows.position for rows in self.constraints.loops))

    @property
    def velocity_closing(self) -> ca.SX:
        """All velocity constraints, redundant ones too."""
        return ca.vertcat(ca.SX(0, 1), *(rows.velocity for rows in self.constraints.loops))

    @property
    def degrees_of_freedom(self) -> int:
        """Independent velocities."""
        return self.mechanics.tree.v.numel() - self.constraints.rank.rank


def reduce_mechanics(mechanics: MechanicalSystem) -> ReducedSystem:
    """Accelerations, multipliers and invariants of a mechanical system. Errors of `analyse_constraints`, `MasslessError`."""
    flat, tree = mechanics.flat, mechanics.tree
    p = _column([parameter.sx for parameter in flat.parameters])
    u = _column([entry.sx for entry in flat.inputs])
    values = np.array([parameter.value for parameter in flat.parameters])
    constraints = analyse_constraints(mechanics, p, values)
    tau = ca.SX.zeros(tree.v.numel())
    free = forward_dynamics(mechanics.kinematics, tau, list(mechanics.wrenches))
    v_dot, multipliers, flexibility, delassus = _constrained(mechanics, constraints, free)
    x = ca.vertcat(tree.q, tree.v)
    return ReducedSystem(
        flat, mechanics, constraints, time.sx, x, u, p, values, np.array([entry.default for entry in flat.inputs]),
        ca.vertcat(tree.rates, v_dot), v_dot, multipliers, tau,
        ca.vertcat(constraints.joint_invariants, constraints.position), constraints.velocity,
        _projection(mechanics, constraints, flexibility, delassus),
    )  # fmt: skip


def _column(parts: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*parts) if parts else ca.SX(0, 1)


def _constrained(mechanics: MechanicalSystem, constraints: Constraints, free: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """v', multipliers, M^-1 A' and A M^-1 A': (A M^-1 A') lambda = -bias - A v'_free."""
    A = constraints.jacobian
    m = A.shape[0]
    if m == 0:
        return free, ca.SX(0, 1), ca.SX(free.numel(), 0), ca.SX(0, 0)
    none = zero_wrenches(mechanics.tree)
    columns = [forward_dynamics(mechanics.kinematics, A[i, :].T, none, at_rest=True, gravity=False) for i in range(m)]
    flexibility = ca.horzcat(*columns)
    delassus = ca.tril2symm(ca.tril(A @ flexibility))
    multipliers = solve_positive(delassus, -constraints.bias - A @ free)
    return free + flexibility @ multipliers, multipliers, flexibility, delassus


def _projection(mechanics: MechanicalSystem, constraints: Constraints, flexibility: ca.SX, delassus: ca.SX) -> ca.SX | None:
    """(q, v) one Newton step nearer to the invariants; None without invariants."""
    tree = mechanics.tree
    invariants = constraints.joint_invariants
    A = constraints.jacobian
    if invariants.numel() == 0 and A.shape[0] == 0:
        return None
    q, v = tree.q, tree.v
    dq = ca.SX.zeros(q.numel())
    for joint in tree.joints:
        own = joint.edge.joint.invariants(q[joint.q], tree.t)
        if own.numel():
            G = ca.jacobian(own, q[joint.q])
            dq[joint.q] -= G.T @ solve_positive(ca.densify(G @ G.T), own)
    dv = ca.SX.zeros(v.numel())
    if A.shape[0]:
        position_rows = [i for i, name in enumerate(constraints.kept) if ".rolling[" not in name]
        A_h, W_h = A[position_rows, :], flexibility[:, position_rows]
        if position_rows:
            step = -(W_h @ solve_positive(ca.densify(A_h @ W_h), constraints.position))
            N = ca.jacobian(tree.rates, v)
            dq += N @ step
        dv = -(flexibility @ solve_positive(delassus, constraints.velocity))
    return ca.vertcat(q + dq, v + dv)
