"""The spanning tree as a list of links with symbolic motions: what every recursion runs over."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.dynamics.spin import balanced, one_turn, without_turn
from acausal.language.expression import Expression, stacked
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.inertia import Inertia
from acausal.parts.joint import AbstractJoint
from acausal.parts.modal_inertia import ModalInertia
from acausal.parts.motion import Motion, reversed_motion
from acausal.parts.pose import Matrix, Pose, cleaned, cleaned_vector, product, rotation_about_z, snapped, symbolic
from acausal.parts.turning import all_turning
from acausal.topology.mechanism import Edge, Mechanism, TreeEdge
from acausal.wording import shortened


@dataclass(frozen=True)
class Link:
    """One moving frame. `offset`: X from the parent link's frame (or the world's) to the base of `motion`.

    `v` are the columns of the velocity vector that move it. A joint of several steps gives several links, all but the
    last without inertia.
    """

    name: str
    parent: int
    offset: Pose
    motion: Motion
    v: slice
    inertia: Inertia
    modal: ModalInertia | None = None
    """Of an elastic body whose amplitudes are the motion."""
    where: str = ""
    """The joint's path and line, and what hangs on it, for messages."""


@dataclass(frozen=True)
class JointSymbols:
    """Symbols of one joint of the tree and their places in q and v."""

    edge: Edge[AbstractJoint]
    q: slice
    v: slice
    link: int
    """Index of its last link."""
    reversed: bool


@dataclass(frozen=True, repr=False)
class Tree:
    """Links, parents first; q' = `rates`; where each group's frame sits: (link, pose in the link's frame), -1 for the ground."""

    mechanism: Mechanism
    q: ca.SX
    v: ca.SX
    t: ca.SX
    rates: ca.SX
    links: tuple[Link, ...]
    places: tuple[tuple[int, Pose], ...]
    joints: tuple[JointSymbols, ...]
    gravity: ca.SX
    """In the frame of link -1."""
    world: np.ndarray
    """Rotation (3, 3) of the frame of link -1, which rests at the world's origin, in the world frame."""

    @functools.cached_property
    def turning(self) -> tuple[np.ndarray, np.ndarray]:
        """Which entries of q (nq,) are angles and quaternions, and which of v (nv,) are rates of these."""
        turns, rates = all_turning(joint.edge.joint for joint in self.joints), np.zeros(self.v.numel(), dtype=bool)
        if turns.any():
            N = ca.jacobian(self.rates[[int(i) for i in np.flatnonzero(turns)]], self.v)
            rates[[int(j) for j in N.sparsity().get_triplet()[1]]] = True
        return turns, rates

    @functools.cached_property
    def owners(self) -> dict[int, int]:
        """The link that each entry of v moves."""
        return {k: i for i, link in enumerate(self.links) for k in range(link.v.start, link.v.stop)}

    def __str__(self) -> str:
        return _table(self)


def _table(tree: Tree) -> str:
    rows = [f"{tree.mechanism.flat.name}: {len(tree.links)} links, {tree.q.numel()} coordinates, {tree.v.numel()} velocities"]
    rows += shortened(
        [
            f"  link {i:<3} on {link.parent:<3} {link.name:<24} {link.motion.nv} freedoms{', elastic' if link.modal else ', no mass' if link.inertia.is_zero else ''}"
            for i, link in enumerate(tree.links)
        ]
    )
    return "\n".join(rows)


def build_tree(mechanism: Mechanism, t: ca.SX) -> Tree:
    """Links of a mechanism with symbols for q and v; frames are turned so that constants become zeros and ones."""
    symbols: list[JointSymbols] = []
    links: list[Link] = []
    motions_of = [item.edge.joint.motions(item.edge.joint.q.sx, item.edge.joint.v.sx, t) for item in mechanism.tree]
    world = _ground_rotation(mechanism, motions_of)
    places: dict[int, tuple[int, Pose]] = {0: (-1, Pose(world.T, np.zeros(3)))}
    q_parts: list[ca.SX] = []
    v_parts: list[ca.SX] = []
    rates: list[ca.SX] = []
    nq = nv = 0
    for item, motions in zip(mechanism.tree, motions_of, strict=True):
        joint = item.edge.joint
        q, v = joint.q.sx, joint.v.sx
        near, far, backwards = item.edge.seen_from(item.parent)
        where = _where(mechanism, item)
        if backwards:
            motions = tuple(reversed_motion(motion) for motion in reversed(motions))
        parent, place = places[item.parent]
        base = place @ near
        for motion in motions:
            mounting = Pose(motion.mounting, np.zeros(3))
            columns = _columns(v, motion.v, nv)
            offset, motion = one_turn(base @ mounting, motion)
            links.append(Link(item.edge.name, parent, cleaned(offset), motion, columns, Inertia.zero(), where=where))
            parent, base = len(links) - 1, Pose(motion.spin, np.zeros(3)) @ mounting.inverse()
        if isinstance(joint, AbstractElasticBody):
            _put_body(links, joint, backwards)
        group_pose = base @ far.inverse()
        places[item.child] = (parent, cleaned(group_pose))
        inertia = _clean_inertia(balanced(mechanism.groups[item.child].inertia.seen_from(group_pose), q))
        links[parent] = replace(links[parent], inertia=inertia)
        symbols.append(JointSymbols(item.edge, slice(nq, nq + joint.q.size), slice(nv, nv + joint.v.size), parent, backwards))
        q_parts.append(q)
        v_parts.append(v)
        rates.append(joint.rates(q, v, t))
        nq, nv = nq + joint.q.size, nv + joint.v.size
    gravity = np.zeros(3) if mechanism.gravity is None else mechanism.gravity
    gravity = product(world.T, gravity.sx if isinstance(gravity, Expression) else gravity)
    tree = Tree(
        mechanism,
        stacked(q_parts),
        stacked(v_parts),
        t,
        stacked(rates),
        tuple(links),
        tuple(places[i] for i in range(len(mechanism.groups))),
        tuple(symbols),
        symbolic(cleaned_vector(gravity)),
        world,
    )
    return _still(_aligned(tree))


def _put_body(links: list[Link], joint: AbstractElasticBody, backwards: bool) -> None:
    """Inertia of an elastic body on the two links of its joint, which were appended last: its frame is that of the first."""
    seat = len(links) - 2
    moved = seat if backwards else seat + 1
    modal = ModalInertia(joint.body(), joint.q.sx, joint.v.sx, seat, near=not backwards)
    links[moved] = replace(links[moved], modal=modal)
    links[seat] = replace(links[seat], inertia=modal.frozen())


def _where(mechanism: Mechanism, item: TreeEdge) -> str:
    group = mechanism.groups[item.child]
    line = "" if item.edge.implicit or not item.edge.joint.created_at else f" ({item.edge.joint.created_at})"
    return f"joint '{item.edge.name}'{line}; behind it is {', '.join(part.path for part in group.parts) or 'no body'}"


def _ground_rotation(mechanism: Mechanism, motions_of: Sequence[Sequence[Motion]]) -> np.ndarray:
    """Turns the ground's frame to the first joint on it whose axes are askew; the identity when all are aligned."""
    for item, motions in zip(mechanism.tree, motions_of, strict=True):
        if item.parent != 0:
            continue
        near, _, backwards = item.edge.seen_from(0)
        rotation = product(near.rotation, motions[-1 if backwards else 0].mounting)
        if isinstance(rotation, np.ndarray) and np.count_nonzero(snapped(rotation)) > 3:
            return rotation
    return np.eye(3)


def _still(tree: Tree) -> Tree:
    """Axes of a link that do not turn, where a balanced body that nothing hangs on turns about its axis in them."""
    links, places = list(tree.links), list(tree.places)
    parents = {link.parent for link in links}
    for i, link in enumerate(links):
        if link.inertia.is_zero or i in parents:
            continue
        found = without_turn(link.motion, link.inertia)
        if found is not None:
            motion, inertia, turn = found
            links[i] = replace(link, inertia=inertia, motion=motion)
            places = [(k, turn @ pose) if k == i else (k, pose) for k, pose in places]
    return replace(tree, links=tuple(links), places=tuple(places))


def _clean_inertia(inertia: Inertia) -> Inertia:
    second = inertia.second_moment
    if not isinstance(second, np.ndarray):
        return inertia
    size = float(np.max(np.abs(second), initial=0.0))
    second = np.where(np.abs(second) < 1e-15 * size, 0.0, 0.5 * (second + second.T))
    return Inertia(inertia.mass, cleaned_vector(inertia.moment), second)


def _columns(v: ca.SX, own: ca.SX, first: int) -> slice:
    """Where a step's velocities stand among all; a joint's steps each take a run of its v."""
    if own.numel() == 0:
        return slice(first, first)
    hashes = [v[i].element_hash() for i in range(v.numel())]
    start = first + hashes.index(own[0].element_hash())
    return slice(start, start + own.numel())


def _aligned(tree: Tree) -> Tree:
    """Turn the frames behind hinges about their axes so that what lies between two hinges is one turn about x.

    A constant rotation between hinges is R_z(a) R_x(b) R_z(c) (Denavit and Hartenberg): a turns the nearer link's frame, c
    is added to the farther joint's angle. Only rotations that are neither sparse nor symbolic are treated.
    """
    links = list(tree.links)
    places = list(tree.places)
    turned: set[int] = set()
    for i, link in enumerate(links):
        rotation = link.offset.rotation
        if not isinstance(rotation, np.ndarray) or link.motion.angle is None or np.count_nonzero(rotation) <= 5:
            continue
        a, b, c = _zxz(rotation)
        parent = link.parent
        if parent >= 0 and links[parent].motion.angle is not None and parent not in turned:
            _turn_link(links, places, parent, a)
            turned.add(parent)
            rest = _about_x(b)
        elif parent < 0:
            rest = np.asarray(_about_z(a)) @ _about_x(b)
        else:
            rest = np.asarray(links[i].offset.rotation) @ _about_z(-c)
        current = links[i]
        angle = current.motion.angle
        assert angle is not None
        offset = Pose(snapped(rest), current.offset.position)
        motion = replace(current.motion, angle=angle + c, pose=Pose(rotation_about_z(angle + c), np.zeros(3)))
        links[i] = replace(current, offset=offset, motion=motion)
    return replace(tree, links=tuple(links), places=tuple(places))


def _turn_link(links: list[Link], places: list[tuple[int, Pose]], index: int, a: float) -> None:
    """Turn one link's frame by `a` about its hinge axis; everything fixed in it is seen from the turned frame."""
    back = Pose(_about_z(-a), np.zeros(3))
    link = links[index]
    angle = link.motion.angle
    assert angle is not None
    motion = replace(link.motion, angle=angle + a, pose=Pose(rotation_about_z(angle + a), np.zeros(3)))
    links[index] = replace(link, motion=motion, inertia=_clean_inertia(link.inertia.seen_from(back)))
    for k, other in enumerate(links):
        if other.parent == index:
            links[k] = replace(other, offset=cleaned(back @ other.offset))
    for g, (place, pose) in enumerate(places):
        if place == index:
            places[g] = (index, cleaned(back @ pose))


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _zxz(R: np.ndarray) -> tuple[float, float, float]:
    """Angles with R = R_z(a) R_x(b) R_z(c)."""
    b = float(np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2]))
    if np.hypot(R[0, 2], R[1, 2]) < 1e-14:
        return 0.0, b, float(np.arctan2(R[1, 0], R[0, 0]) if R[2, 2] > 0 else np.arctan2(-R[1, 0], R[0, 0]))
    return float(np.arctan2(R[0, 2], -R[1, 2])), b, float(np.arctan2(R[2, 0], R[2, 1]))


def place_of(tree: Tree, group: int, pose: Pose) -> tuple[int, Pose]:
    """Link and pose in its frame of something placed in a group's frame."""
    link, place = tree.places[group]
    return link, place @ pose


def entries(matrix: Matrix) -> ca.SX:
    """As dense `SX`."""
    return ca.densify(symbolic(matrix))
