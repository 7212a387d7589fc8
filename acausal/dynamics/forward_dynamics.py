"""Forward dynamics by articulated bodies, O(n): accelerations from forces.

Featherstone, Rigid Body Dynamics Algorithms (2008), table 7.1, with accelerations of frame origins; the factored
articulated inertias can be used again for many right-hand sides.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.dynamics import formulas
from acausal.dynamics.kinematics import Kinematics
from acausal.dynamics.tree import Link, Tree
from acausal.errors import MasslessError
from acausal.parts.inertia import is_zero, skew
from acausal.parts.pose import Matrix, symbolic

Wrench = tuple[ca.SX, ca.SX]
"""Torque and force, (3, 1) each."""
Blocks = tuple[ca.SX, ca.SX, ca.SX]
"""I, H, M (3, 3) of a spatial inertia [[I, H], [H', M]]."""


@dataclass(frozen=True)
class ArticulatedInertias:
    """The links, and for each U (6, n), 1/D (n, n) and the blocks (I, H, M) of the inertia felt on the near side of its joint."""

    links: tuple[Link, ...]
    U: tuple[ca.SX, ...]
    D_inverse: tuple[ca.SX, ...]
    felt: tuple[Blocks, ...]
    owners: dict[int, int]
    """The link that each entry of v moves."""

    @functools.cached_property
    def branches(self) -> tuple[tuple[int, ...], ...]:
        """For each link, the links of its branch from the ground, parents first."""
        roots: list[int] = []
        members: dict[int, list[int]] = {}
        for i, link in enumerate(self.links):
            roots.append(i if link.parent < 0 else roots[link.parent])
            members.setdefault(roots[i], []).append(i)
        whole = {root: tuple(own) for root, own in members.items()}
        return tuple(whole[root] for root in roots)


def zero_wrenches(tree: Tree) -> list[Wrench]:
    """No torque and no force for each link."""
    return [(ca.SX.zeros(3), ca.SX.zeros(3)) for _ in tree.links]


def articulated_inertias(tree: Tree, rotors: Mapping[int, float] | Mapping[int, ca.SX] | None = None) -> ArticulatedInertias:
    """Factors of the mass matrix, for any right-hand sides.

    `rotors`: inertias that resist the motions of links, by their indices (see `virtual_inertia`). Raises `MasslessError` where a
    motion meets no inertia by structure.
    """
    rotors = rotors or {}
    links = [replace(k, motion=replace(k.motion, axes=None)) if i in rotors else k for i, k in enumerate(tree.links)]
    n = len(links)
    blocks = [_blocks(link) for link in links]
    U, D_inverse = [ca.SX(6, 0)] * n, [ca.SX(0, 0)] * n
    for i in reversed(range(n)):
        link, motion = links[i], links[i].motion
        if motion.nv:
            if i not in rotors and link.modal is None:
                _check_inertia(link, blocks[i])
            *felt, U[i], D_inverse[i] = (
                formulas.eliminate(motion.nv)(*blocks[i], motion.subspace, *own_inertia(link, rotors.get(i, 0.0)))
                if motion.axes is None
                else formulas.eliminate_axes(motion.axes)(*blocks[i])
            )
            blocks[i] = (felt[0], felt[1], felt[2])
        if link.parent >= 0:
            moved = _carried(link, blocks[i])
            a, b, c = blocks[link.parent]
            blocks[link.parent] = (a + moved[0], b + moved[1], c + moved[2])
    return ArticulatedInertias(tuple(links), tuple(U), tuple(D_inverse), tuple(blocks), tree.owners)


def forward_dynamics(
    kinematics: Kinematics, tau: ca.SX, wrenches: list[Wrench], inertias: ArticulatedInertias | None = None
) -> ca.SX:
    """v' (nv, 1) from joint forces tau (nv, 1), gravity, and external wrenches on each link, in and about its frame.

    `inertias`: if known already. Raises `MasslessError` where a motion meets no inertia by structure.
    """
    tree = kinematics.tree
    found = inertias or articulated_inertias(tree)
    bias: list[Wrench] = []
    for i, link in enumerate(found.links):
        torque, force = ca.SX.zeros(3), ca.SX.zeros(3)
        if not link.inertia.is_zero:
            second = ca.densify(symbolic(link.inertia.second_moment))
            torque, force = formulas.bias_wrench(second, symbolic(link.inertia.moment), kinematics.angular_velocity(i))
        bias.append((torque - wrenches[i][0], force - wrenches[i][1]))
    tau = _add_modal_bias(kinematics, bias, tau)
    u: list[ca.SX] = [ca.SX(0, 1)] * len(found.links)
    for i in reversed(range(len(found.links))):
        felt, u[i] = _passed(found, i, bias[i], kinematics.bias(i), tau)
        _add_to_parent(found.links[i], felt, bias)
    result = ca.SX.zeros(tree.v.numel())
    accelerations: list[Wrench] = []
    for i, link in enumerate(found.links):
        before = accelerations[link.parent] if link.parent >= 0 else (ca.SX.zeros(3), -tree.gravity)
        accelerations.append(_accelerated(found, i, u[i], before, kinematics.bias(i), result))
    return result


def mass_solve(inertias: ArticulatedInertias, tau: ca.SX) -> ca.SX:
    """M^-1 tau (nv, 1), sparse. Cost: the links that tau moves."""
    links = inertias.links
    nothing, zero = (ca.SX.zeros(3), ca.SX.zeros(3)), ca.SX.zeros(6)
    pushed = {inertias.owners[k] for k in tau.sparsity().row()}
    moved = sorted({i for link in pushed for i in inertias.branches[link]})
    bias: dict[int, Wrench] = {}
    u: dict[int, ca.SX] = {}
    for i in reversed(moved):
        if i in bias or i in pushed:
            felt, u[i] = _passed(inertias, i, bias.get(i, nothing), zero, tau)
            if links[i].parent >= 0:
                bias.setdefault(links[i].parent, nothing)
                _add_to_parent(links[i], felt, bias)
    result = ca.SX(tau.shape[0], 1)
    accelerations: dict[int, Wrench] = {}
    for i in moved:
        link = links[i]
        if i in u or link.parent in accelerations:
            before = accelerations.get(link.parent, nothing)
            accelerations[i] = _accelerated(inertias, i, u.get(i, ca.SX.zeros(link.motion.nv)), before, zero, result)
    return ca.sparsify(result)


def _passed(inertias: ArticulatedInertias, i: int, bias: Wrench, gamma: ca.SX, tau: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Bias (6, 1) as felt on the near side of a link's joint, and u (n, 1)."""
    link, felt = inertias.links[i], inertias.felt[i]
    motion, own = link.motion, ca.densify(tau[link.v])
    if motion.nv == 0:
        full = ca.blockcat([[felt[0], felt[1]], [felt[1].T, felt[2]]])
        return ca.vertcat(*bias) + full @ gamma, ca.SX(0, 1)
    if motion.axes is not None:
        passed = formulas.pass_axes(motion.axes)(*felt, inertias.U[i], inertias.D_inverse[i], *bias, gamma, motion.sign * own)
    else:
        passed = formulas.pass_motion(motion.nv)(*felt, inertias.U[i], inertias.D_inverse[i], *bias, gamma, motion.subspace, own)
    return passed[0], passed[1]


def _accelerated(inertias: ArticulatedInertias, i: int, u: ca.SX, before: Wrench, gamma: ca.SX, result: ca.SX) -> Wrench:
    """Acceleration of a link from that of its parent; its own v' is put into `result`."""
    link = inertias.links[i]
    w_dot, a = before
    for pose in (link.offset, link.motion.pose):
        w_dot, a = formulas.move_acceleration(symbolic(pose.rotation), symbolic(pose.position), w_dot, a)
    total = ca.vertcat(w_dot, a) + gamma
    if link.motion.nv:
        (v_dot,) = formulas.joint_acceleration(link.motion.nv)(inertias.U[i], inertias.D_inverse[i], u, total)
        if link.motion.axes is not None:
            for k, axis in enumerate(link.motion.axes):
                total[axis] += v_dot[k]
            v_dot = link.motion.sign * v_dot
        else:
            total = total + link.motion.subspace @ v_dot
        result[link.v] = v_dot
    return total[:3], total[3:]


def own_inertia(link: Link, rotor: float | ca.SX) -> tuple[ca.SX, ca.SX]:
    """(6, n) and (n, n): what the motion of a link meets besides the inertia behind it."""
    n = link.motion.nv
    if link.modal is None:
        return ca.SX.zeros(6, n), rotor * ca.SX.eye(n)
    return link.modal.coupling(link.motion)


def _add_modal_bias(kinematics: Kinematics, bias: list[Wrench], tau: ca.SX) -> ca.SX:
    """Elastic bodies' wrenches are added to those of links; tau (nv, 1) less their forces on amplitudes is returned."""
    for i, link in enumerate(kinematics.tree.links):
        if link.modal is None:
            continue
        seat = link.modal.seat
        torque, force, modal = link.modal.bias(kinematics.angular_velocity(seat))
        bias[seat] = (bias[seat][0] + torque, bias[seat][1] + force)
        if link.modal.near:  # the seat does not have the acceleration that the joint adds
            modal = modal - link.modal.coupling(link.motion)[0].T @ kinematics.bias(i)
        tau = ca.vertcat(tau[: link.v.start], tau[link.v] - modal, tau[link.v.stop :])
    return tau


def _blocks(link: Link) -> Blocks:
    return (
        ca.densify(symbolic(link.inertia.second_moment)),
        ca.densify(symbolic(skew(link.inertia.moment))),
        ca.densify(ca.SX(link.inertia.mass) * ca.SX.eye(3)),
    )


def _check_inertia(link: Link, blocks: Blocks) -> None:
    """A direction of motion without inertia by structure cannot have an acceleration."""
    if link.motion.axes is None:
        if all(block.is_zero() for block in blocks):
            raise massless(link)
        return
    for axis in link.motion.axes:
        block, k = (blocks[0], axis) if axis < 3 else (blocks[2], axis - 3)
        if block[k, k].is_zero():
            raise massless(link)


def massless(link: Link) -> MasslessError:
    """Nothing with inertia resists its motion."""
    if not is_zero(link.inertia.mass) and not link.motion.subspace[:3, :].is_zero():
        if link.inertia.is_point:
            return MasslessError(
                f"No moment of inertia resists a turn of {link.where}: all its mass is in one point, and a point has no orientation. The acceleration of "
                "this turn is undefined. Use a RigidBody in place of the particle; or let it be held by what does not turn: CartesianTranslation, "
                "PointOnCurve(...), PointOnSurface(...); or connect points alone, such as by Rod(length)."
            )
        return MasslessError(
            f"No moment of inertia resists a turn of {link.where}, whose mass lies all on the axis of this turn: a thin "
            "rod about itself, or a point. The acceleration of this turn is undefined. Give the rod a thickness, RigidBody.rod(mass, tip, radius=...), "
            "or take the turn away: Universal in place of Spherical, or Rod(length) with particles."
        )
    return MasslessError(
        f"Nothing with inertia resists the motion of {link.where}. Its acceleration is undefined. Connect a body with "
        "mass (and, where it turns, with a moment of inertia about the axis) behind the joint, or remove the joint. For a massless "
        "link between two ball joints, whose spin nothing resists, use Rod(length)."
    )


def _add_to_parent(link: Link, felt: ca.SX, bias: list[Wrench] | dict[int, Wrench]) -> None:
    """What a link's parent feels of it is added to the parent's bias."""
    if link.parent < 0:
        return
    torque, force = felt[:3], felt[3:]
    for pose in (link.motion.pose, link.offset):
        torque, force = formulas.move_wrench(symbolic(pose.rotation), symbolic(pose.position), torque, force)
    bias[link.parent] = (bias[link.parent][0] + torque, bias[link.parent][1] + force)


def _carried(link: Link, blocks: Blocks) -> Blocks:
    """An inertia in a link's frame, on the near side of its joint, in the parent's frame."""
    for pose in (link.motion.pose, link.offset):
        R, p = symbolic(pose.rotation), symbolic(pose.position)
        if not _is_identity(pose.rotation):
            blocks = _rotated(R, blocks)
        if not p.is_zero():
            moved = formulas.shift_inertia(p, *blocks)
            blocks = (moved[0], moved[1], moved[2])
    return blocks


def _is_identity(rotation: Matrix) -> bool:
    return isinstance(rotation, np.ndarray) and np.array_equal(rotation, np.eye(3))


def _rotated(R: ca.SX, blocks: Blocks) -> Blocks:
    """Blocks turned by R; a block that is a multiple of the identity is not touched."""
    I3, H, M = blocks
    return (
        I3 if _isotropic(I3) else formulas.rotate_symmetric(R, I3)[0],
        H if H.is_zero() else formulas.rotate_block(R, H)[0],
        M if _isotropic(M) else formulas.rotate_symmetric(R, M)[0],
    )


def _isotropic(block: ca.SX) -> bool:
    if not (block[0, 1].is_zero() and block[0, 2].is_zero() and block[1, 2].is_zero()):
        return False
    return ca.is_equal(block[0, 0], block[1, 1], 4) and ca.is_equal(block[1, 1], block[2, 2], 4)
