"""Constraints of all loops together, which of their rows are independent, and what freedom is left."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.errors import AssemblyError
from acausal.mechanics.pose import Pose
from acausal.mechanics.system import MechanicalSystem
from acausal.reduction.assembly import assemble
from acausal.reduction.loops import LoopRows, loop_rows
from acausal.reduction.mobility import locked, shaky
from acausal.reduction.redundancy import RankReport, independent_rows
from acausal.reduction.singular import has_singular_position
from acausal.reduction.walk import Walk

_SAMPLES = 8
_ROUNDING = 1e-12  # of the largest row: what is less than that at every sample is a sum that cancels


@dataclass(frozen=True, repr=False)
class Constraints:
    """Independent rows of all cut joints, and the freedom that they leave.

    `position` (np, 1) and `velocity` (m, 1) residuals of the kept rows; `jacobian` A (m, nv) of `velocity` in v; `bias` (m, 1) so
    that A v' + bias = 0. `damped`: rows depend on one another in a way that only holds when assembled. The kept
    ones alone may then be met on other branches too, so all rows are used, with a rank-tolerant solve.
    `singular`: fewer rows are independent at some positions than elsewhere. `samples`: some assembled configurations (nq,).
    `joint_invariants`: of the tree's joints (quaternion norms, gaps). `kept` and `redundant` are names.
    """

    loops: tuple[LoopRows, ...]
    position: ca.SX
    velocity: ca.SX
    jacobian: ca.SX
    bias: ca.SX
    joint_invariants: ca.SX
    kept: tuple[str, ...]
    kept_index: tuple[int, ...]
    redundant: tuple[str, ...]
    vanishing: tuple[str, ...]
    rank: RankReport
    damped: bool
    singular: bool
    samples: tuple[np.ndarray, ...]

    @property
    def q_start(self) -> np.ndarray:
        """An assembled configuration (nq,), where searches begin."""
        return self.samples[0]


def joint_invariants(system: MechanicalSystem) -> ca.SX:
    """Invariants of the joints in the tree, (n, 1)."""
    tree = system.tree
    rows = [j.edge.joint.invariants(tree.q[j.q], tree.t) for j in tree.joints]
    return ca.vertcat(*rows) if rows else ca.SX(0, 1)


def analyse_constraints(system: MechanicalSystem, parameters: ca.SX, values: np.ndarray) -> Constraints:
    """Close the loops numerically, find the redundant rows, keep the others.

    Raises `AssemblyError` when a loop cannot close, `LockedError` when no freedom is left.
    """
    tree = system.tree
    loops = tuple(loop_rows(edge, system.placement) for edge in system.mechanism.cuts)
    invariants = joint_invariants(system)
    position = ca.vertcat(*(rows.position for rows in loops)) if loops else ca.SX(0, 1)
    velocity = ca.vertcat(*(rows.velocity for rows in loops)) if loops else ca.SX(0, 1)
    names = tuple(name for rows in loops for name in rows.names)
    is_position = [k < rows.position.numel() for rows in loops for k in range(rows.velocity.numel())]
    closing = ca.Function("closing", [tree.q, tree.t, parameters], [ca.vertcat(invariants, position)])
    start = close_loops(system, loops, closing, sketch_configuration(system), values)
    if not loops:
        none = ca.SX(0, 1)
        return Constraints(
            (), none, none, ca.SX(0, tree.v.numel()), none, invariants, (), (), (), (), RankReport((), 0, 0), False, False, (start,)
        )  # fmt: skip
    jacobian = ca.jacobian(velocity, tree.v)
    walk = Walk(system.tree, parameters, values, ca.vertcat(invariants, position), jacobian)
    samples: list[np.ndarray] = []
    rank = RankReport((), 0, 0)
    # a look nearby is enough where all rows are independent; where some are redundant, look along the whole motion
    for reach in (1, _SAMPLES):
        samples = walk.samples(start, reach)
        rank = independent_rows([walk.at(q)[2] for q in samples])
        if rank.rank == len(names):
            break
    kept = rank.kept
    if not ca.depends_on(ca.vertcat(position, velocity), tree.t):
        if rank.rank >= tree.v.numel():
            raise locked(loops, tree.v.numel(), walk.at(start)[2])
        if len(samples) == 1:
            raise shaky(loops, tree.v.numel(), rank.rank)
    singular = rank.rank > 0 and (rank.singular_at_start or has_singular_position(walk, samples, rank.rank))
    if singular:  # what is usual away from singular positions is seen from afar
        samples = walk.samples(start, _SAMPLES)
    damped = 0 < len(kept) < len(names)  # where nothing but rounding errors is left, there is nothing to solve
    sizes = np.max([np.linalg.norm(walk.at(q)[2], axis=1) for q in samples], axis=0)
    chosen = [i for i in range(len(names)) if sizes[i] > _ROUNDING * np.max(sizes)] if damped else list(kept)
    velocity_kept = velocity[chosen]
    position_index = np.cumsum(is_position) - 1
    position_kept = position[[int(position_index[i]) for i in chosen if is_position[i]]]
    return Constraints(
        loops, position_kept, velocity_kept, ca.densify(ca.jacobian(velocity_kept, tree.v)), system.kinematics.rate(velocity_kept),
        invariants, tuple(names[i] for i in kept), tuple(chosen), tuple(names[i] for i in range(len(names)) if i not in kept),
        tuple(name for rows in loops for name in rows.dropped), rank, damped, singular, tuple(samples),
    )  # fmt: skip


def sketch_configuration(system: MechanicalSystem) -> np.ndarray:
    """First guess for q: from the rough poses of bodies where both ends of a joint have one, else the joint's own start."""
    guess: list[float] = []
    groups = system.mechanism.groups
    for item in system.tree.joints:
        edge = item.edge
        a, b = groups[edge.a].sketch, groups[edge.b].sketch
        if edge.a == 0 or edge.b == 0:
            a = Pose.identity() if edge.a == 0 else a
            b = Pose.identity() if edge.b == 0 else b
        entries = edge.joint.start_q()
        if a is not None and b is not None:
            mounting = Pose(edge.joint.mounting(), np.zeros(3))
            X = (a @ edge.pose_a @ mounting).inverse() @ (b @ edge.pose_b @ mounting)
            found = edge.joint.coordinates(X)
            if found is not None and ca.densify(found).is_constant():
                entries = tuple(float(f) for f in np.array(ca.DM(ca.evalf(found))).ravel())
        guess += entries
    return np.array(guess)


def close_loops(
    system: MechanicalSystem, loops: tuple[LoopRows, ...], closing: ca.Function, guess: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """A configuration near `guess` with all loops closed on the branch meant. Raises `AssemblyError` with the smallest gap."""
    tree = system.tree
    jacobian = closing.jacobian()

    def residual(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c = np.array(closing(q, 0.0, values)).ravel()
        J = np.array(ca.DM(jacobian(q, 0.0, values, c)[0]))
        return c, J

    domain = ca.Function("domain", [tree.q], [ca.vertcat(ca.SX(0, 1), *(j.edge.joint.domain(tree.q[j.q]) for j in tree.joints))])
    rng = np.random.default_rng(0)
    smallest, where = np.inf, guess
    for attempt in range(12):
        first = guess if attempt == 0 else guess + rng.normal(scale=0.1 * 1.35**attempt, size=guess.size)
        found = assemble(residual, first)
        right_branch = all(_positive(rows, tree.q, tree.t, found.y) for rows in loops)
        right_branch = right_branch and bool(np.all(np.array(domain(found.y)) > 0))
        if found.converged and right_branch:
            return found.y
        if found.gap < smallest and right_branch:
            smallest, where = found.gap, found.y
    worst = _worst_loop(closing, loops, where, values)
    raise AssemblyError(
        f"The loop closed by joint '{worst.edge.name}' ({worst.edge.joint.created_at}) cannot close: the smallest gap reached is {smallest:.3g} (m, or sine of an angle). "
        "Check lengths, axes and offsets along the loop, or begin nearer to an assembled position: give joints a start or bodies a rough position."
    )


def _positive(rows: LoopRows, q: ca.SX, t: ca.SX, value: np.ndarray) -> bool:
    if rows.sign is None:
        return True
    free = {s.element_hash() for s in ca.symvar(rows.sign)}
    if not free <= {q[i].element_hash() for i in range(q.numel())} | {t.element_hash()}:
        return True
    return float(ca.Function("sign", [q, t], [rows.sign])(value, 0.0)) > 0


def _worst_loop(closing: ca.Function, loops: tuple[LoopRows, ...], q: np.ndarray, values: np.ndarray) -> LoopRows:
    """The loop with the largest residual."""
    residual = np.abs(np.array(closing(q, 0.0, values)).ravel())
    first = residual.size - sum(rows.position.numel() for rows in loops)
    sizes: list[float] = []
    for rows in loops:
        sizes.append(float(np.max(residual[first : first + rows.position.numel()], initial=0.0)))
        first += rows.position.numel()
    return loops[int(np.argmax(sizes))]
