"""Self-stress: sets of joint reactions that balance one another, so that the motion of rigid bodies does not determine them.

With constraint rows A (m, nv) of the cut joints, multipliers z with A' z = 0 change reactions around the loops and nothing else. There is
one such direction for each redundant row. Of all sets of reactions that give the same motion the smallest is taken: the least
sum of squares of all forces, and of all torques over a length, at the joints, about the origins of their frame_b. The length is that of the loop:
how far the joints on its links are apart, so that no unit has a share. It does not depend on where loops are cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.formulas import damped_solver, solve_positive
from acausal.dynamics.system import MechanicalSystem
from acausal.dynamics.tree import JointSymbols
from acausal.loops.constraints import Constraints
from acausal.loops.loop_groups import loop_groups
from acausal.loops.loops import mounted_places
from acausal.numerics.thresholds import RANK
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, symbolic
from acausal.topology.mechanism import Edge

_DAMPING = 1e-12
"""Of independent rows, in units of their own size: what is left out where they are not so at a position."""
_REFINEMENTS = 2


@dataclass(frozen=True, repr=False)
class LoopReactions:
    """How wrenches at joints depend on the multipliers of all rows of the cut joints, `m` in number, vanishing rows included.

    `edges`: the joints in loops, those of the tree first. `change` (6 len(edges), m): torque and force on frame_b of each, in its mounted
    axes. `jacobian` A (m, nv). The lengths of loops, which torques are divided by: `of_wrenches` (6 len(edges), 1), `of_rows` (m, 1) and
    `of_rates` (nv, 1), 1 for forces and what shifts. `independent`: rows that the others follow from.
    """

    edges: tuple[Edge[AbstractConstraint], ...]
    change: ca.SX
    jacobian: ca.SX
    of_wrenches: ca.SX
    of_rows: ca.SX
    of_rates: ca.SX
    independent: tuple[int, ...]

    @property
    def measured(self) -> tuple[ca.SX, ca.SX]:
        """`change` and `jacobian` without units."""
        W, A = self.change @ ca.diag(self.of_rows), ca.diag(self.of_rows) @ self.jacobian
        return ca.diag(1 / self.of_wrenches) @ W, A @ ca.diag(1 / self.of_rates)

    def balanced(self, multipliers: ca.SX, wrenches: ca.SX) -> ca.SX:
        """The multipliers (m, 1) with the smallest reactions and the motion of `multipliers`, for which the joints feel `wrenches`.

        Least squares in the multipliers of all rows that follow from `independent` ones, whose own take back what the others do to the motion.
        """
        W, A = self.measured
        wrenches = wrenches / self.of_wrenches
        own, rest = list(self.independent), [k for k in range(A.shape[0]) if k not in self.independent]
        S = ca.densify(A[own, :] @ A[own, :].T)
        back = damped_solver(S, _DAMPING * ca.diag(S), _REFINEMENTS)(ca.densify(A[own, :] @ A[rest, :].T))
        change = W[:, rest] - W[:, own] @ back
        least = solve_positive(ca.densify(change.T @ change), ca.densify(-(change.T @ wrenches)))
        z = ca.SX.zeros(A.shape[0])
        z[rest] = least
        z[own] = -(back @ least)
        return multipliers + self.of_rows * z


def loop_reactions(system: MechanicalSystem, constraints: Constraints) -> LoopReactions:
    """Statics of the tree under unit multipliers. Cost: links times rows."""
    tree, placement = system.tree, system.placement
    bases = [ca.horzcat(rows.wrench_basis, rows.dropped_basis) for rows in constraints.loops]
    m = sum(basis.shape[1] for basis in bases)
    applied = [ca.SX(6, m) for _ in tree.links]
    own: list[ca.SX] = []
    first = 0
    for rows, basis in zip(constraints.loops, bases, strict=True):
        columns = slice(first, first + basis.shape[1])
        at_b = ca.SX(6, m)
        at_b[:, columns] = basis
        own.append(at_b)
        for (link, pose), wrench in zip(mounted_places(rows.edge, placement), (-_moved(rows.pose, at_b), at_b), strict=True):
            if link >= 0:
                applied[link] += _moved(pose, wrench)
        first += basis.shape[1]
    transmitted = [-wrench for wrench in applied]
    for i in reversed(range(len(tree.links))):
        link = tree.links[i]
        if link.parent >= 0:
            transmitted[link.parent] += _moved(link.offset @ link.motion.pose, transmitted[i])
    edges: list[Edge[AbstractConstraint]] = []
    blocks: list[ca.SX] = []
    for item in tree.joints:
        if transmitted[item.link].nnz():
            edges.append(item.edge)
            blocks.append(wrench_on_b(system, item, transmitted[item.link]))
    edges += [rows.edge for rows in constraints.loops]
    rows_of_A = [ca.jacobian(rows.velocity, tree.v) for rows in constraints.loops]
    padded = [ca.vertcat(A, ca.SX(len(rows.dropped), A.shape[1])) for A, rows in zip(rows_of_A, constraints.loops, strict=True)]
    length = _lengths(system, constraints)
    of_rates = ca.SX.ones(tree.v.numel())
    for item in tree.joints:
        for j in range(item.v.start, item.v.stop):
            of_rates[j] = length.get(item.edge.name, 1) if tree.turning[1][j] else 1
    of_rows = [
        length[rows.edge.name] if basis[3:, k].is_zero() else ca.SX(1)
        for rows, basis in zip(constraints.loops, bases, strict=True)
        for k in range(basis.shape[1])
    ]
    of_wrenches = [ca.vertcat(*[length[edge.name]] * 3, 1, 1, 1) for edge in edges]
    return LoopReactions(
        tuple(edges), ca.vertcat(*blocks, *own), ca.vertcat(*padded), ca.vertcat(*of_wrenches), ca.vertcat(*of_rows), of_rates,
        _independent(constraints),
    )  # fmt: skip


def _independent(constraints: Constraints) -> tuple[int, ...]:
    """Places of the independent rows among all, where vanishing ones come last in each joint."""
    places: list[int] = []
    first = 0
    for rows in constraints.loops:
        places += range(first, first + len(rows.names))
        first += len(rows.names) + len(rows.dropped)
    return tuple(places[i] for i in constraints.rank.kept)


def _lengths(system: MechanicalSystem, constraints: Constraints) -> dict[str, ca.SX]:
    """For each joint in loops how far joints are apart on the links of these loops, by constants and parameters: the root of the mean square."""
    tree, placement = system.tree, system.placement
    squares: list[tuple[list[str], ca.SX]] = []
    for group in loop_groups(system, constraints.loops):
        own = [joint for joint in tree.joints if joint.v.start in group.v_places]
        places: dict[int, list[ca.SX]] = {}
        for edge in (*(joint.edge for joint in own), *(rows.edge for rows in group.loops)):
            for link, pose in placement.ends(edge):
                places.setdefault(link, []).append(symbolic(pose.position))
        spread = ca.SX(0)
        for points in places.values():
            mean = sum(points[1:], points[0]) / len(points)
            spread += sum((ca.sumsqr(point - mean) for point in points), ca.SX(0)) / len(points)
        names = [joint.edge.name for joint in own] + [rows.edge.name for rows in group.loops]
        squares.append((names, spread))
    whole = sum((square for _, square in squares), ca.SX(0))
    return {
        name: ca.sqrt(next((s for s in (square, whole) if not s.is_zero()), ca.SX(1)))
        for names, square in squares
        for name in names
    }


def wrench_on_b(system: MechanicalSystem, item: JointSymbols, transmitted: ca.SX) -> ca.SX:
    """Torque and force (6, m) on a joint's frame_b, in its mounted axes, from those on its farther link, in that link's frame."""
    b = mounted_places(item.edge, system.placement)[1]
    seen = _moved(system.placement.between(b, (item.link, Pose.identity())), transmitted)
    return -seen if item.reversed else seen


def undetermined_reactions(
    system: MechanicalSystem, constraints: Constraints, parameters: ca.SX, values: np.ndarray
) -> dict[str, tuple[bool, ...]]:
    """For each joint with a reaction that rigid bodies do not determine: which of torque x, y, z and force x, y, z on frame_b, in its
    mounted axes. Found in numbers at a few assembled configurations.
    """
    if not (constraints.redundant or constraints.vanishing):
        return {}
    found = loop_reactions(system, constraints)
    function = ca.Function("statics", [system.tree.q, system.tree.t, parameters], [ca.densify(part) for part in found.measured])
    loose = np.zeros(6 * len(found.edges), dtype=bool)
    for q in constraints.samples[:: max(1, len(constraints.samples) // 2)]:
        W, A = (np.array(part) for part in function(q, 0.0, values))
        U, s, _ = np.linalg.svd(A)
        rank = int(np.sum(s > RANK * s[0])) if s.size else 0
        loose |= np.max(np.abs(W @ U[:, rank:]), axis=1, initial=0.0) > RANK
    groups = loose.reshape(-1, 6)
    return {edge.name: tuple(bool(b) for b in row) for edge, row in zip(found.edges, groups, strict=True) if row.any()}


def _moved(pose: Pose, wrenches: ca.SX) -> ca.SX:
    """Wrenches (6, m) in B, in A and about A's origin, for the pose of B in A."""
    R, p = symbolic(pose.rotation), symbolic(pose.position)
    force = R @ wrenches[3:, :]
    return ca.sparsify(ca.vertcat(R @ wrenches[:3, :] + ca.skew(p) @ force, force))
