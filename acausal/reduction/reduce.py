"""Reduction: a scene becomes x' = f(t, x, u, p) with the least states, its invariants, and a way to express anything else."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from acausal.language.expression import Symbol, Variable, time
from acausal.language.flatten import FlatSystem
from acausal.mechanics.forward_dynamics import forward_dynamics
from acausal.mechanics.system import MechanicalSystem
from acausal.mechanics.tree import JointSymbols
from acausal.reduction.constraints import Constraints, analyse_constraints
from acausal.reduction.loop_forces import loop_forces, on_branch, projection
from acausal.reduction.loops import mounted_places
from acausal.reduction.scalar_domains import Driven, ScalarReduction, has_scalar_parts, reduce_scalar


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
    scalar_states: tuple[Symbol, ...] = ()
    solved: dict[Symbol, ca.SX] = field(default_factory=dict)
    """Variables of scalar domains, by t, x, u and p."""

    def __str__(self) -> str:
        c = self.constraints
        rows = [
            f"{self.flat.name}: {self.x.numel()} states, {c.jacobian.shape[0]} constraints, {self.degrees_of_freedom} degrees of freedom"
        ]
        rows += [f"  {item.edge.name:<24} q {item.edge.joint.q.size}, v {item.edge.joint.v.size}" for item in self.tree_joints]
        rows += [f"  {self.flat.names.get(s, s.name):<24} scalar state [{s.unit}]" for s in self.scalar_states]
        rows += [f"  kept: {', '.join(c.kept) or 'none'}; redundant: {', '.join((*c.redundant, *c.vanishing)) or 'none'}"]
        return "\n".join(rows)

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
        starts = [0.0 if s.start is None else float(np.asarray(s.start)) for s in self.scalar_states if isinstance(s, Variable)]
        return np.concatenate([np.zeros(self.tree_velocities), starts])

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


def reduce_system(mechanics: MechanicalSystem) -> ReducedSystem:
    """Accelerations, multipliers, scalar states and invariants of a scene.

    Errors of `analyse_constraints` and `reduce_scalar`, `MasslessError`.
    """
    flat, tree = mechanics.flat, mechanics.tree
    p = _column([parameter.sx for parameter in flat.parameters])
    u = _column([entry.sx for entry in flat.inputs])
    values = np.array([parameter.value for parameter in flat.parameters])
    constraints = analyse_constraints(mechanics, p, values)
    tau = ca.SX.sym("tau", tree.v.numel())
    free = forward_dynamics(mechanics.kinematics, tau, list(mechanics.wrenches))
    forces = loop_forces(mechanics, constraints, p, values)
    multipliers = forces.multipliers(free)
    v_dot = free + forces.flexibility @ multipliers
    scalar, tau_value = _with_scalar(mechanics, tau, v_dot)
    acceleration_values = [(d.acceleration, _second_rate(d, mechanics, v_dot)) for d in scalar.driven]
    v_dot, multipliers = _put(tau, tau_value, v_dot), _put(tau, tau_value, multipliers)
    rates, solved = list(scalar.reduction.rates), dict(scalar.reduction.solved)
    for symbol, value in acceleration_values:
        actual = _put(tau, tau_value, value)
        rates = [ca.substitute(r, symbol, actual) for r in rates]
        solved = {k: ca.substitute(s, symbol, actual) for k, s in solved.items()}
    states = _column([s.sx for s in scalar.reduction.states])
    x, second = ca.vertcat(tree.q, tree.v, states), ca.vertcat(v_dot, *rates)
    if constraints.singular:
        second = on_branch(second, forces, [time.sx, tree.q, tree.v, states, u, p])
    return ReducedSystem(
        flat, mechanics, constraints, time.sx, x, u, p, values,
        np.array([entry.default for entry in flat.inputs]), ca.vertcat(tree.rates, second), v_dot, multipliers, tau_value,
        ca.vertcat(constraints.joint_invariants, constraints.position), constraints.velocity,
        projection(forces, states), forces.delassus, scalar.reduction.states, solved,
    )  # fmt: skip


def _put(symbol: ca.SX, value: ca.SX, expression: ca.SX) -> ca.SX:
    return ca.substitute(expression, symbol, value) if symbol.numel() else expression


@dataclass(frozen=True)
class _Scalar:
    driven: tuple[Driven, ...]
    reduction: ScalarReduction


def _with_scalar(mechanics: MechanicalSystem, tau: ca.SX, v_dot: ca.SX) -> tuple[_Scalar, ca.SX]:
    """Reduce the scalar domains; and the joint forces tau that they give.

    Where an effort depends on the joint's own acceleration (a rotor geared to a joint), it is affine in it, and the accelerations
    are affine in tau: both together are one small linear system.
    """
    flat, nv = mechanics.flat, tau.numel()
    if not has_scalar_parts(flat):
        return _Scalar((), ScalarReduction((), (), {}, ())), ca.SX.zeros(nv)
    driven, directions = _driven(mechanics)
    reduction = reduce_scalar(flat, driven)
    if not driven:
        return _Scalar((), reduction), ca.SX.zeros(nv)
    efforts = ca.vertcat(*reduction.efforts)
    symbols = ca.vertcat(*(d.acceleration for d in driven))
    J = ca.vertcat(*directions)
    slope = ca.jacobian(efforts, symbols)
    if slope.nnz() == 0:
        return _Scalar(driven, reduction), ca.densify(J.T @ efforts)
    # efforts = e0 + E a, a = a0 + B J' efforts: solve for the efforts
    second = ca.vertcat(*(_second_rate(d, mechanics, v_dot) for d in driven))
    e0 = ca.substitute(efforts, symbols, ca.SX.zeros(symbols.numel()))
    a0 = ca.substitute(second, tau, ca.SX.zeros(nv))
    B = ca.jacobian(second, tau) @ J.T
    matrix = ca.SX.eye(len(driven)) - slope @ B
    found = ca.solve(ca.densify(matrix), e0 + slope @ a0) if len(driven) > 1 else (e0 + slope @ a0) / matrix
    return _Scalar(driven, reduction), ca.densify(J.T @ found)


def _second_rate(driven: Driven, mechanics: MechanicalSystem, v_dot: ca.SX) -> ca.SX:
    return mechanics.kinematics.rate(driven.velocity) + ca.jtimes(driven.velocity, mechanics.tree.v, v_dot)


def _driven(mechanics: MechanicalSystem) -> tuple[tuple[Driven, ...], list[ca.SX]]:
    """Connected flanges of joints, and for each the row (1, nv) that turns velocities into its rate."""
    connected = {c for group in mechanics.flat.connection_sets if len(group) > 1 for c in group}
    found: list[Driven] = []
    rows: list[ca.SX] = []
    tree = mechanics.tree
    edges = [(item.edge, tree.q[item.q], tree.v[item.v]) for item in tree.joints] + [
        (cut, None, None) for cut in mechanics.mechanism.cuts
    ]
    for edge, q, v in edges:
        flange = getattr(edge.joint, "flange", None)
        if flange is None or flange not in connected:
            continue
        if q is None or v is None:
            a, b = mounted_places(edge.joint, mechanics.placement)
            q = edge.joint.coordinates(mechanics.placement.between(a, b))
            assert q is not None
            v = mechanics.kinematics.rate(q)
        found.append(Driven(flange, q, v, ca.SX.sym(f"der({edge.name}.v)"), edge.name))
        rows.append(ca.jacobian(v, tree.v))
    return tuple(found), rows


def _column(parts: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*parts) if parts else ca.SX(0, 1)
