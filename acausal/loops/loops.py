"""Loops: what the cut joints ask of the tree's coordinates and velocities, row by row."""

from __future__ import annotations

import functools
from collections.abc import Set
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.dynamics.kinematics import Place
from acausal.dynamics.placement import TreePlacement
from acausal.errors import ModelError
from acausal.numerics.sizes import Drawn
from acausal.numerics.thresholds import ROUNDING
from acausal.parts.constraint import AbstractConstraint
from acausal.parts.pose import Pose, cleaned, product, symbolic, symbols
from acausal.topology.mechanism import Edge


@dataclass(frozen=True)
class Row:
    """One row of a cut joint: `name` says what it forbids; `rolls`: it forbids to slip, in velocities only."""

    name: str
    rolls: bool = False


@dataclass(frozen=True)
class LoopRows:
    """Rows of one cut joint that do not vanish by structure.

    `position` (n, 1): residuals in q and t. `wrench_basis` (6, n + m): unit constraint wrenches on frame_b, in
    frame_b turned by the joint's mounting, torque first. `velocity` (n + m, 1): their rates, then the rolling rows; linear in v. `sign`: positive on the
    branch that is meant. `rows`: what each is. `dropped_rows`: those that vanish by structure, with their `dropped_basis` (6, k).
    `far`: sum of the constant distances [m] along the loop: what was drawn far from an origin is known only to 1e-16 of this.
    """

    edge: Edge[AbstractConstraint]
    pose: Pose
    position: ca.SX
    velocity: ca.SX
    wrench_basis: ca.SX
    sign: ca.SX | None
    rows: tuple[Row, ...]
    dropped_rows: tuple[Row, ...]
    dropped_basis: ca.SX
    far: float = 0.0

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Of `rows`."""
        return tuple(row.name for row in self.rows)

    @functools.cached_property
    def dropped(self) -> tuple[str, ...]:
        """Names of `dropped_rows`."""
        return tuple(row.name for row in self.dropped_rows)

    def without(self, names: Set[str]) -> LoopRows:
        """The same without these rows, which turned out to hold only rounding errors."""
        gone = [k for k, name in enumerate(self.names) if name in names]
        if not gone:
            return self
        left = [k for k in range(len(self.names)) if k not in gone]
        order = sorted([(row, self.dropped_basis[:, k]) for k, row in enumerate(self.dropped_rows)]
                       + [(self.rows[k], self.wrench_basis[:, k]) for k in gone], key=lambda pair: pair[0].name)  # fmt: skip
        return replace(
            self,
            position=self.position[[k for k in left if k < self.position.numel()], :],
            velocity=self.velocity[left, :],
            wrench_basis=self.wrench_basis[:, left],
            rows=tuple(self.rows[k] for k in left),
            dropped_rows=tuple(row for row, _ in order),
            dropped_basis=ca.densify(ca.horzcat(ca.SX(6, 0), *(basis for _, basis in order))),
        )

    @property
    def drawn(self) -> Drawn:
        """How well the rows of `velocity` are known. Those on which a force acts forbid shifts, in lengths, and the others turns."""
        shifts = np.array([not self.wrench_basis[3:, k].is_zero() for k in range(len(self.names))], dtype=bool)
        return Drawn(np.full(len(self.names), self.far), shifts, ~shifts)


def slip_name(path: str, i: int) -> str:
    """Name of the constraint that a rolling contact does not slip in its `i`-th direction."""
    return f"{path}.rolling[{i}]"


def loop_rows(edge: Edge[AbstractConstraint], placement: TreePlacement) -> LoopRows:
    """The rows of a cut joint. Cost: linear in the length of the loop."""
    joint, t = edge.joint, placement.t
    X = relative_pose(edge, placement)
    R, p = symbolic(X.rotation), symbolic(X.position)
    w, v = relative_twist(edge, placement, X)
    closure = joint.closure(X, t)
    if closure is None:
        raise ModelError(
            f"Joint '{edge.name}' closes a loop, but {type(joint).__name__} does not say what it asks of a relative pose. "
            "Give it a method closure(X_ab, t)."
        )
    turn, shift = ca.SX.sym("turn", 3), ca.SX.sym("shift", 3)
    moved = joint.closure(Pose(R @ (ca.SX.eye(3) + ca.skew(turn)), p + R @ shift), t)
    assert moved is not None
    at_rest = ca.SX.zeros(6)
    basis = ca.substitute(ca.jacobian(moved, ca.vertcat(turn, shift)), ca.vertcat(turn, shift), at_rest)
    explicit = _explicit_rate(joint, X, t)
    rows, kinds, dropped, dropped_basis = [], [], [], [ca.SX(6, 0)]
    far = _far(edge, placement)
    twist = ca.vertcat(w, v)
    for i in range(closure.numel()):
        kind, residual = Row(f"{edge.name}[{i}]"), closure[i]
        if residual.is_constant() and abs(float(residual)) <= ROUNDING * (1.0 if basis[i, 3:].is_zero() else far):
            dropped.append(kind)
            dropped_basis.append(basis[i, :].T)
            continue
        if residual.is_constant() and (_is_point(edge.a, placement) or _is_point(edge.b, placement)):
            raise ModelError(
                f"Joint '{edge.name}' ({joint.created_at}) asks how its ends are turned against one another: row {i} of {type(joint).__name__}.closure(X_ab, t) follows X_ab.rotation, "
                "and one of its ends is a point, which has a position and no orientation. Read X_ab.position, or connect it to a body."
            )
        rows.append((residual, basis[i, :] @ twist + explicit[i], basis[i, :].T))
        kinds.append(kind)
    w_s, v_s = ca.SX.sym("w", 3), ca.SX.sym("v", 3)
    rolling = joint.closure_rates(X, w_s, v_s, t)
    rolling_basis = ca.jacobian(rolling, ca.vertcat(w_s, v_s))
    rolling_value = ca.substitute(rolling, ca.vertcat(w_s, v_s), twist)
    for i in range(rolling.numel()):
        if rolling_value[i].is_zero():  # nothing moves there
            dropped.append(Row(slip_name(edge.name, i), rolls=True))
            dropped_basis.append(rolling_basis[i, :].T)
    rolls = [i for i in range(rolling.numel()) if not rolling_value[i].is_zero()]
    rolling_value, rolling_basis = rolling_value[rolls, :], rolling_basis[rolls, :]
    position = ca.vertcat(*(row[0] for row in rows)) if rows else ca.SX(0, 1)
    velocity = ca.vertcat(*(row[1] for row in rows), rolling_value)
    wrench_basis = ca.horzcat(*(row[2] for row in rows), rolling_basis.T)
    kinds += [Row(slip_name(edge.name, i), rolls=True) for i in rolls]
    return LoopRows(
        edge, X, position, ca.densify(velocity), ca.densify(wrench_basis), joint.closure_sign(X), tuple(kinds), tuple(dropped),
        ca.densify(ca.horzcat(*dropped_basis)), far,
    )  # fmt: skip


def _far(edge: Edge[AbstractConstraint], placement: TreePlacement) -> float:
    """Sum of the constant distances [m] along the loop that a joint closes: of all places of joints from the origins of what they hold together."""
    tree = placement.kinematics.tree
    ways: list[set[int]] = []
    for link, _ in placement.ends(edge):
        way: set[int] = set()
        while link >= 0:
            way.add(link)
            link = tree.links[link].parent
        ways.append(way)
    between = ways[0] ^ ways[1]
    edges = [edge, *(joint.edge for joint in tree.joints if joint.link in between)]
    places = [pose.position for own in edges for pose in (own.pose_a, own.pose_b)]
    return float(sum(np.linalg.norm(place) for place in places if isinstance(place, np.ndarray)))


def _explicit_rate(joint: AbstractConstraint, X: Pose, t: ca.SX) -> ca.SX:
    """Rate of the closure at a pose held fixed, for joints whose closure depends on time."""
    R, p = ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)
    closure = joint.closure(Pose(R, p), t)
    assert closure is not None
    rate = ca.jtimes(closure, t, ca.SX(1))
    return ca.densify(ca.substitute(ca.substitute(rate, R, symbolic(X.rotation)), p, symbolic(X.position)))


def mounted_places(edge: Edge[AbstractConstraint], placement: TreePlacement) -> tuple[Place, Place]:
    """Places of frame_a and frame_b turned by the joint's mounting; constants without rounding errors, so that they fold.

    A point has no orientation: its frame is taken along that of the other end.
    """
    mounting = Pose(edge.joint.mounting(), np.zeros(3))
    (link_a, pose_a), (link_b, pose_b) = placement.ends(edge)
    a, b = (link_a, cleaned(pose_a @ mounting)), (link_b, cleaned(pose_b @ mounting))
    if _is_point(edge.b, placement):
        return a, _along(b, a, placement)
    return (_along(a, b, placement), b) if _is_point(edge.a, placement) else (a, b)


def _is_point(group: int, placement: TreePlacement) -> bool:
    return placement.kinematics.tree.mechanism.groups[group].kind == "point"


def _along(place: Place, other: Place, placement: TreePlacement) -> Place:
    """A place turned to the axes of another one."""
    (link, pose), (other_link, other_pose) = place, other
    between = placement.kinematics.relative_pose(link, other_link)
    return link, Pose(product(between.rotation, other_pose.rotation), pose.position)


def relative_pose(edge: Edge[AbstractConstraint], placement: TreePlacement) -> Pose:
    """X_ab of the mounted places, in symbols also where nothing in it moves: so it is given to methods of parts."""
    X = placement.between(*mounted_places(edge, placement))
    return symbols(Pose(np.eye(3), X.position) if _is_point(edge.a, placement) or _is_point(edge.b, placement) else X)


def relative_twist(edge: Edge[AbstractConstraint], placement: TreePlacement, X: Pose) -> tuple[ca.SX, ca.SX]:
    """Angular velocity and velocity of mounted place b against a, in b, for their relative pose X."""
    R, p = symbolic(X.rotation), symbolic(X.position)
    places = mounted_places(edge, placement)
    # against the last link that both hang on: how that moves is nothing to the loop
    common = placement.kinematics.common(*(link for link, _ in places))
    (w_a, v_a), (w_b, v_b) = (placement.twist(place, common) for place in places)
    if _is_point(edge.b, placement):
        return ca.SX.zeros(3), v_b - v_a - ca.cross(w_a, p)
    if _is_point(edge.a, placement):
        return ca.SX.zeros(3), v_b - v_a - ca.cross(w_b, p)
    return w_b - R.T @ w_a, v_b - R.T @ (v_a + ca.cross(w_a, p))
