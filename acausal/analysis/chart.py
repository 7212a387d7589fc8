"""Independent coordinates around a consistent state, where loops are closed and quaternions have unit length."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.analysis.point import Differentiable, OperatingPoint
from acausal.codegen.lower import Functions
from acausal.errors import OptionError
from acausal.mechanics.tree import JointSymbols
from acausal.reduction.independent import independent_entries
from acausal.reduction.reduce import ReducedSystem


@dataclass(frozen=True)
class Tangent:
    """Small changes at a point: dx = `expand` dy (nx, k), dy = `pick` dx (k, nx), and the rate of `pick` along the motion."""

    expand: np.ndarray
    pick: np.ndarray
    pick_rate: np.ndarray


@dataclass(frozen=True)
class Chart:
    """Changes dy (k,) of independent entries of the state, named `names`.

    In place of a unit quaternion stands the small rotation vector of frame_b, in frame_b, away from the point or the motion
    looked at: q = q0 * (1, rotation / 2). It has no singular attitude. `free`: which entries are independent, among all states with
    each quaternion (at the places `quaternions` of x) replaced by three entries.
    """

    system: ReducedSystem
    invariants: Differentiable
    quaternions: tuple[int, ...]
    free: tuple[int, ...]
    names: tuple[str, ...]

    def tangent(self, at: OperatingPoint, x_dot: np.ndarray) -> Tangent:
        """For a motion through the point with the rates `x_dot` (nx,)."""
        turn, back = _turns(self.quaternions, at.x)
        back_rate = _turns(self.quaternions, x_dot)[1] - _turns(self.quaternions, 0 * at.x)[1]
        G = self.invariants.along(at, turn)
        free = list(self.free)
        dependent = [i for i in range(turn.shape[1]) if i not in set(free)]
        change = np.zeros((turn.shape[1], len(free)))
        change[free, range(len(free))] = 1.0
        if dependent:
            change[dependent] = -np.linalg.lstsq(G[:, dependent], G[:, free], rcond=None)[0]
        return Tangent(turn @ change, back[free], back_rate[free])


def chart_at(functions: Functions, at: OperatingPoint) -> Chart:
    """The independent entries that move the others least violently at a point: first positions, then their rates and scalar states.

    Raises `OptionError` where a loop is in a singular position.
    """
    s = functions.outputs.system
    _check_regular(functions, at)
    quaternions = tuple(i for joint in s.tree_joints for i in _quaternions(joint, s.mechanics.tree.t))
    names = _names(functions, quaternions)
    invariants = Differentiable(s, ca.vertcat(s.position_invariants, s.velocity_invariants))
    G = invariants.along(at, _turns(quaternions, at.x)[0])
    rows, nq = s.position_invariants.numel(), s.nq - len(quaternions)
    positions = independent_entries(G[:rows, :nq]).free
    rates = independent_entries(G[rows:, nq:], preferred=_matching(s, quaternions, positions)).free
    free = (*positions, *(nq + i for i in rates))
    return Chart(s, invariants, quaternions, free, tuple(names[i] for i in free))


def _check_regular(functions: Functions, at: OperatingPoint) -> None:
    """At a singular position of a loop there is no tangent space of the right dimension."""
    s = functions.outputs.system
    needed = s.constraints.rank.rank
    if not needed:
        return
    A = np.array(functions.constraint_jacobian(at.t, at.x, at.u, at.p))
    values = np.linalg.svd(A, compute_uv=False)
    if int(np.sum(values > 1e-7 * values[0])) < needed:
        joints = ", ".join(f"'{rows.edge.name}'" for rows in s.constraints.loops)
        raise OptionError(
            f"The loop closed by {joints} is in a singular position at x = {np.round(at.x, 6)}: its constraints depend on one another there, "
            "and branches of the motion cross. Choose a point beside it."
        )


def _quaternions(joint: JointSymbols, t: ca.SX) -> list[int]:
    """Places in x of the joint's unit quaternions: four entries whose squares add to a constant of the motion."""
    own = joint.edge.joint
    q = ca.SX.sym("q", joint.q.stop - joint.q.start)
    rows = own.invariants(q, t)
    J = ca.jacobian(rows, q)
    found: list[int] = []
    for i in range(rows.numel()):
        columns = sorted(set(J[i, :].sparsity().get_triplet()[1]))
        if len(columns) != 4 or columns[3] - columns[0] != 3:
            continue
        gap = ca.densify(J[i, columns].T - q[columns])
        trial = np.random.default_rng(i).normal(size=q.numel())
        if not ca.symvar(ca.substitute(gap, q, ca.SX(ca.DM(trial)))) and np.allclose(
            np.array(ca.Function("gap", [q], [gap])(trial)), 0.0, atol=1e-14
        ):
            found.append(joint.q.start + columns[0])
    return found


def _turns(quaternions: tuple[int, ...], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """dx = turn dz (n, nz) and dz = back dx (nz, n), z with a rotation vector in frame_b in place of each quaternion."""
    n = x.size
    turn, back = np.zeros((n, n - len(quaternions))), np.zeros((n - len(quaternions), n))
    i = k = 0
    while i < n:
        if i in quaternions:
            a, b, c, d = x[i : i + 4]
            L = np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]])
            turn[i : i + 4, k : k + 3], back[k : k + 3, i : i + 4] = 0.5 * L, 2.0 * L.T
            i, k = i + 4, k + 3
        else:
            turn[i, k] = back[k, i] = 1.0
            i, k = i + 1, k + 1
    return turn, back


def _names(functions: Functions, quaternions: tuple[int, ...]) -> list[str]:
    s = functions.outputs.system
    names = list(functions.state_names)
    for joint in s.tree_joints:
        for i in quaternions:
            if joint.q.start <= i < joint.q.stop:
                names[i : i + 4] = ["", *(f"{joint.edge.name}.rotation[{k}]" for k in range(3))]
    return [name for name in names if name]


def _matching(s: ReducedSystem, quaternions: tuple[int, ...], positions: tuple[int, ...]) -> list[int]:
    """The velocities that belong to independent positions, where joints have as many of one as of the other."""
    wanted: list[int] = []
    place = 0
    for joint in s.tree_joints:
        size = joint.q.stop - joint.q.start - sum(joint.q.start <= i < joint.q.stop for i in quaternions)
        if size == joint.v.stop - joint.v.start:
            wanted += [joint.v.start + i - place for i in positions if place <= i < place + size]
        place += size
    return wanted
