"""The velocity constraints of a scene as one-forms in the coordinates of its tree.

A rolling contact in the tree has no rows: its velocities are admissible ones already. Here they are given back, since a constraint that is not
written down can still be integrable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from acausal.dynamics.system import MechanicalSystem
from acausal.dynamics.tree import JointSymbols, Tree
from acausal.explain.integrability.brackets import admissible_fields
from acausal.explain.integrability.pfaffian import PfaffianSystem
from acausal.loops.loops import LoopRows, slip_name
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic, vee
from acausal.wording import entry_names

if TYPE_CHECKING:
    from acausal.reduce.reduce import ReducedSystem
    from acausal.scalar.coupling import Held


@dataclass(frozen=True)
class VelocityRow:
    """forms (1, nq) q' + drift (1, 1) = 0, in q, t and parameters. `name`: path and number of the constraint."""

    name: str
    form: ca.SX
    drift: ca.SX


def contact_rows(mechanics: MechanicalSystem, loops: Sequence[LoopRows]) -> tuple[VelocityRow, ...]:
    """What joints of the tree and of the loops ask of velocities beyond the rates of positions; none where nothing rolls."""
    tree = mechanics.tree
    q_dot, t_dot = ca.SX.sym("q_dot", tree.q.numel()), ca.SX.sym("t_dot")
    found: list[VelocityRow] = []
    for item in tree.joints:
        rows = _slip_in_tree(item, tree.q[item.q], q_dot[item.q], tree.t, t_dot)
        found += _linear(item.edge.name, rows, q_dot, t_dot)
    for loop in loops:
        if any(row.rolls for row in loop.rows):
            rows = _slip(loop.edge.joint, loop.pose, tree.q, q_dot, tree.t, t_dot)
            found += _linear(loop.edge.name, rows, q_dot, t_dot)
    return tuple(found)


def _slip(joint: AbstractConstraint, X: Pose, q: ca.SX, q_dot: ca.SX, t: ca.SX, t_dot: ca.SX) -> ca.SX:
    """Residuals of `closure_rates` at the pose X(q, t), seen from the joint's mounting, for any rates of q and t."""
    R, p = symbolic(X.rotation), symbolic(X.position)
    y, y_dot = ca.vertcat(q, t), ca.vertcat(q_dot, t_dot)
    R_dot = ca.reshape(ca.jtimes(ca.vec(R), y, y_dot), 3, 3)
    twist = vee(R.T @ R_dot), R.T @ ca.jtimes(p, y, y_dot)
    return joint.closure_rates(Pose(R, p), *twist, t)


def _slip_in_tree(item: JointSymbols, q: ca.SX, q_dot: ca.SX, t: ca.SX, t_dot: ca.SX) -> ca.SX:
    joint = item.edge.joint
    missing = q.numel() - joint.invariants(q, t).numel() - joint.v.size
    if missing <= 0 or joint.followed(q).numel():  # what inputs prescribe is no law of rates
        return ca.SX(0, 1)
    mounting = Pose(joint.mounting(), np.zeros(3))
    rows = _slip(joint, mounting.inverse() @ joint.pose(q, t) @ mounting, q, q_dot, t, t_dot)
    if rows.numel() >= missing:
        return rows
    # a joint that says what its velocities do, not what they must not do: the covectors that its N sends to zero
    v, free = joint.v.sx, ca.SX.zeros(joint.v.size)
    rates = joint.rates(q, v, t)
    N, drift = ca.densify(ca.jacobian(rates, v)), ca.substitute(rates, v, free)
    names = tuple(f"q[{i}]" for i in range(q.numel()))
    start = np.array(joint.start_q()) + np.random.default_rng(0).uniform(0.2, 0.5, q.numel())
    fixed = ca.substitute(N, t, ca.SX(0))
    covectors = admissible_fields(PfaffianSystem(q, ca.SX(0, 1), fixed.T, names, names[: joint.v.size], start), start)
    return covectors.T @ (q_dot - drift * t_dot)


def _linear(path: str, rows: ca.SX, q_dot: ca.SX, t_dot: ca.SX) -> list[VelocityRow]:
    """Rows that are linear in the rates, where time goes by at rate 1."""
    nothing = ca.vertcat(q_dot, t_dot), ca.SX.zeros(q_dot.numel() + 1)
    form = ca.substitute(ca.jacobian(rows, q_dot), *nothing)
    drift = ca.substitute(ca.jacobian(rows, t_dot) + rows, *nothing)
    return [VelocityRow(slip_name(path, i), ca.densify(form[i, :]), ca.densify(drift[i])) for i in range(rows.numel())]


def scalar_rows(system: ReducedSystem) -> tuple[VelocityRow, ...]:
    """What gears, sources and equations of one's own ask of the joints' velocities only: not rates of what they ask of positions.

    Equations that are not linear in velocities have no one-forms, and are left out.
    """
    tree = system.mechanics.tree
    q_dot, t_dot = ca.SX.sym("q_dot", tree.q.numel()), ca.SX.sym("t_dot")
    found: list[VelocityRow] = []
    for held in rates_only(system):
        if held.of_joints and not held.of_inputs and is_linear(held.residual, tree.v):
            v = ca.vertcat(*(_velocity(item, tree.q[item.q], q_dot[item.q], tree.t, t_dot) for item in tree.joints))
            (row,) = _linear(held.name, ca.substitute(held.residual, tree.v, v), q_dot, t_dot)
            found.append(VelocityRow(held.name, row.form, row.drift))
    return tuple(found)


def rates_only(system: ReducedSystem) -> tuple[Held, ...]:
    """Scalar equations between velocities of joints, perhaps with scalar states, that are not rates of equations between positions."""
    tree, held = system.mechanics.tree, system.scalar.held
    positions = {h.number for h in held if h.depth > 1}
    return tuple(h for h in held if h.number not in positions and ca.depends_on(h.residual, tree.v))


def is_linear(row: ca.SX, v: ca.SX) -> bool:
    """Whether a row is linear in v (n, 1)."""
    return not ca.depends_on(ca.jacobian(row, v), v)


def _velocity(item: JointSymbols, q: ca.SX, q_dot: ca.SX, t: ca.SX, t_dot: ca.SX) -> ca.SX:
    """v of a joint that moves with these rates of q; least squares where q has more entries."""
    joint = item.edge.joint
    rates = joint.rates(q, joint.v.sx, t)
    if rates.numel() == joint.v.size and ca.is_equal(rates, joint.v.sx, 2):
        return q_dot
    N = ca.densify(ca.jacobian(rates, joint.v.sx))
    drift = ca.substitute(rates, joint.v.sx, ca.SX.zeros(joint.v.size))
    return ca.solve(N.T @ N, N.T @ (q_dot - drift * t_dot)) if joint.v.size else ca.SX(0, 1)


def velocity_system(system: ReducedSystem, values: np.ndarray | None = None) -> PfaffianSystem:
    """All velocity constraints of a scene on the manifold of its holonomic ones, for these `values` of parameters (the present ones).

    The time is a coordinate where anything depends on it.
    """
    rows = (*contact_rows(system.mechanics, system.constraints.loops), *scalar_rows(system))
    position = [loop.position for loop in system.constraints.loops]
    coupled = [h.residual for h in system.scalar.held if h.depth > 1 and h.of_joints and not h.of_inputs]
    holonomic = ca.vertcat(system.constraints.joint_invariants, *position, *coupled)
    values = system.p_values if values is None else values
    return scene_forms(system.mechanics, rows, holonomic, system.p, values, system.constraints.q_start)


def scene_forms(
    mechanics: MechanicalSystem, rows: Sequence[VelocityRow], holonomic: ca.SX, p: ca.SX, values: np.ndarray, start: np.ndarray
) -> PfaffianSystem:
    """These rows on the manifold holonomic(q, t) = 0 (c, 1), with `values` for the parameters p. `start` (nq,): where to look for configurations.

    With `contact_rows` and the loops' position rows it is known before forces are: cheap enough to ask while a scene is built.
    """
    tree = mechanics.tree
    forms = ca.vertcat(ca.SX(0, tree.q.numel()), *(row.form for row in rows))
    drifts = ca.vertcat(ca.SX(0, 1), *(row.drift for row in rows))
    holonomic = ca.densify(holonomic)
    if p.numel():
        holonomic, forms, drifts = ca.substitute([holonomic, forms, drifts], [p], [ca.SX(ca.DM(values))])
    names = coordinate_names(tree)
    y, start = tree.q, np.array(start, dtype=float)
    timed = ca.sparsify(drifts).nnz() > 0 or ca.depends_on(ca.vertcat(holonomic, ca.vec(forms)), tree.t)
    if timed:
        y, forms, names, start = ca.vertcat(y, tree.t), ca.horzcat(forms, drifts), (*names, "t"), np.append(start, 0.0)
    return PfaffianSystem(y, holonomic, ca.sparsify(forms), names, tuple(row.name for row in rows), start, timed)


def coordinate_names(tree: Tree) -> tuple[str, ...]:
    """Names of the entries of q, e.g. `hinge.q`, `contact.q[3]`."""
    return tuple(name for item in tree.joints for name in entry_names(f"{item.edge.name}.q", item.edge.joint.q.size))
