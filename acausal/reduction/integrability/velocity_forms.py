"""The velocity constraints of a scene as one-forms in the coordinates of its tree.

A rolling contact in the tree has no rows: its velocities are admissible ones already. Here they are given back, since a constraint that is not
written down can still be integrable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.mechanics.constraint import AbstractConstraint
from acausal.mechanics.pose import Pose, symbolic, vee
from acausal.mechanics.system import MechanicalSystem
from acausal.mechanics.tree import JointSymbols
from acausal.reduction.integrability.brackets import admissible_fields
from acausal.reduction.integrability.pfaffian import PfaffianSystem
from acausal.reduction.loops import LoopRows
from acausal.reduction.reduce import ReducedSystem


@dataclass(frozen=True)
class VelocityRow:
    """forms (1, nq) q' + drift (1, 1) = 0, in q, t, inputs and parameters. `name`: path and number of the constraint."""

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
        if any(".rolling[" in name for name in loop.names):
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
    if missing <= 0:
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
    return [VelocityRow(f"{path}.rolling[{i}]", ca.densify(form[i, :]), ca.densify(drift[i])) for i in range(rows.numel())]


def scalar_rows(system: ReducedSystem) -> tuple[VelocityRow, ...]:
    """What gears, sources and equations of one's own ask of the joints' velocities only: not rates of what they ask of positions.

    Rows that hold rates of scalar states, and those that are not linear in velocities, are left out.
    """
    tree, scalar = system.mechanics.tree, system.scalar
    if not scalar.velocity.numel():
        return ()
    q_dot, t_dot = ca.SX.sym("q_dot", tree.q.numel()), ca.SX.sym("t_dot")
    states = ca.vertcat(ca.SX(0, 1), *(s.sx for s in scalar.states))
    v = ca.vertcat(ca.SX(0, 1), *(_velocity(item, tree.q[item.q], q_dot[item.q], tree.t, t_dot) for item in tree.joints))
    slopes = ca.jacobian(scalar.position, tree.q) @ tree.rates + ca.jtimes(scalar.position, tree.t, ca.SX(1))
    names, found = list(scalar.holding), list[VelocityRow]()
    for k in range(scalar.velocity.numel()):
        row = scalar.velocity[k]
        if states.numel() and ca.depends_on(row, states):
            continue
        name = names.pop(0) if names else f"scalar equation {k + 1}"
        if any(_same(row, slopes[i], tree.q, tree.v, tree.t) for i in range(slopes.numel())):
            continue
        if ca.depends_on(ca.jacobian(row, tree.v), tree.v):
            continue
        found += [
            VelocityRow(name, r.form, r.drift) for r in _linear(name, ca.substitute(row, tree.v, v), q_dot, t_dot)
        ]
    return tuple(found)


def _velocity(item: JointSymbols, q: ca.SX, q_dot: ca.SX, t: ca.SX, t_dot: ca.SX) -> ca.SX:
    """v of a joint that moves with these rates of q; least squares where q has more entries."""
    joint = item.edge.joint
    rates = joint.rates(q, joint.v.sx, t)
    if rates.numel() == joint.v.size and ca.is_equal(rates, joint.v.sx, 2):
        return q_dot
    N = ca.densify(ca.jacobian(rates, joint.v.sx))
    drift = ca.substitute(rates, joint.v.sx, ca.SX.zeros(joint.v.size))
    return ca.solve(N.T @ N, N.T @ (q_dot - drift * t_dot)) if joint.v.size else ca.SX(0, 1)


def _same(a: ca.SX, b: ca.SX, *symbols: ca.SX) -> bool:
    """Whether two expressions are equal up to a factor, at random values of their symbols."""
    known = ca.vertcat(*symbols)
    free = ca.vertcat(*ca.symvar(ca.vertcat(a, b, known)))
    function = ca.Function("both", [free], [a, b])
    rng = np.random.default_rng(0)
    values = np.array([[float(f) for f in function(rng.uniform(0.5, 1.5, free.numel()))] for _ in range(3)])
    cross = values[0, 0] * values[:, 1] - values[0, 1] * values[:, 0]
    return bool(np.max(np.abs(cross)) < 1e-9 * (1e-300 + np.max(np.abs(values)) ** 2))


def velocity_system(system: ReducedSystem) -> PfaffianSystem:
    """All velocity constraints of a scene on the manifold of its holonomic ones, with the present values of parameters.

    Inputs are put in as some polynomials of time. The time is a coordinate where anything depends on it.
    """
    tree = system.mechanics.tree
    rows = [*contact_rows(system.mechanics, system.constraints.loops), *scalar_rows(system)]
    position = [loop.position for loop in system.constraints.loops]
    holonomic = ca.densify(ca.vertcat(system.constraints.joint_invariants, *position, system.scalar.position))
    forms = ca.vertcat(ca.SX(0, tree.q.numel()), *(row.form for row in rows))
    drifts = ca.vertcat(ca.SX(0, 1), *(row.drift for row in rows))
    holonomic, forms, drifts = _with_numbers(system, [holonomic, forms, drifts])
    names = coordinate_names(system)
    timed = not drifts.is_zero() or ca.depends_on(ca.vertcat(holonomic, ca.vec(forms)), tree.t)
    y, start = tree.q, np.array(system.q_start, dtype=float)
    if timed:
        y, forms, names, start = ca.vertcat(y, tree.t), ca.horzcat(forms, drifts), (*names, "t"), np.append(start, 0.0)
    return PfaffianSystem(y, holonomic, ca.sparsify(forms), names, tuple(row.name for row in rows), start, timed)


def coordinate_names(system: ReducedSystem) -> tuple[str, ...]:
    """Names of the entries of q, e.g. `hinge.q`, `contact.q[3]`."""
    found: list[str] = []
    for item in system.tree_joints:
        size, path = item.edge.joint.q.size, item.edge.name
        found += [f"{path}.q"] if size == 1 else [f"{path}.q[{i}]" for i in range(size)]
    return tuple(found)


def _with_numbers(system: ReducedSystem, expressions: list[ca.SX]) -> list[ca.SX]:
    """Values for parameters; for inputs polynomials of time, which no identity can hide behind."""
    t, rng = system.t, np.random.default_rng(0)
    inputs = [sum((float(c) * t**k for k, c in enumerate(rng.uniform(0.5, 1.5, 4))), ca.SX(0)) for _ in range(system.u.numel())]
    pairs = [(system.p, ca.SX(ca.DM(system.p_values))), (system.u, ca.vertcat(ca.SX(0, 1), *inputs))]
    pairs = [(symbols, values) for symbols, values in pairs if symbols.numel()]
    return ca.substitute(expressions, [s for s, _ in pairs], [values for _, values in pairs]) if pairs else expressions
