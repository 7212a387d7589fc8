"""Forward dynamics by articulated bodies, O(n): accelerations from forces.

Featherstone, Rigid Body Dynamics Algorithms (2008), table 7.1, with accelerations of frame origins; the factored
articulated inertias can be used again for many right-hand sides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from acausal.errors import MasslessError
from acausal.mechanics import kernels
from acausal.mechanics.inertia import skew
from acausal.mechanics.kinematics import Kinematics
from acausal.mechanics.pose import Matrix, symbolic
from acausal.mechanics.tree import Link, Tree

Wrench = tuple[ca.SX, ca.SX]
"""Torque and force, (3, 1) each."""


@dataclass(frozen=True)
class ArticulatedInertias:
    """U (6, n), inverse D (n, n) and articulated blocks (I, H, M) behind each link's joint."""

    U: tuple[ca.SX, ...]
    D_inverse: tuple[ca.SX, ...]
    blocks: tuple[tuple[ca.SX, ca.SX, ca.SX], ...]


def zero_wrenches(tree: Tree) -> list[Wrench]:
    """No torque and no force for each link."""
    return [(ca.SX.zeros(3), ca.SX.zeros(3)) for _ in tree.links]


def forward_dynamics(
    kinematics: Kinematics,
    tau: ca.SX,
    wrenches: list[Wrench],
    *,
    at_rest: bool = False,
    gravity: bool = True,
    rotors: Mapping[int, float] | None = None,
) -> ca.SX:
    """v' (nv, 1) from joint forces tau (nv, 1) and external wrenches on each link, in and about its frame.

    `at_rest`: leave out all terms in the velocities. `gravity`: whether uniform gravity acts. With both off it is
    M^-1 tau, for constraint forces. `rotors`: inertias that resist the motions of links, by their indices (see
    `virtual_inertia`). Raises `MasslessError` where a motion meets no inertia by structure.
    """
    tree, rotors = kinematics.tree, rotors or {}
    links = [replace(k, motion=replace(k.motion, axes=None)) if i in rotors else k for i, k in enumerate(tree.links)]
    n = len(links)
    blocks: list[tuple[ca.SX, ca.SX, ca.SX]] = [_blocks(link) for link in links]
    bias: list[Wrench] = []
    for i, link in enumerate(links):
        torque, force = (
            (ca.SX.zeros(3), ca.SX.zeros(3))
            if at_rest or link.inertia.is_zero
            else kernels.bias_wrench(blocks[i][0], _moment(link), kinematics.angular_velocity(i))
        )
        bias.append((torque - wrenches[i][0], force - wrenches[i][1]))
    U: list[ca.SX] = [ca.SX()] * n
    D_inverse: list[ca.SX] = [ca.SX()] * n
    u: list[ca.SX] = [ca.SX()] * n
    zero = ca.SX.zeros(6)
    for i in reversed(range(n)):
        link = links[i]
        gamma = zero if at_rest else kinematics.bias(i)
        own_tau = link.motion.sign * tau[link.v] if link.motion.axes is not None else tau[link.v]
        I3, H, M, felt, U[i], D_inverse[i], u[i] = _eliminate(link, blocks[i], bias[i], gamma, own_tau, rotors.get(i, 0.0))
        if link.parent >= 0:
            blocks[link.parent], bias[link.parent] = _add_to_parent(
                link, (I3, H, M), (felt[:3], felt[3:]), blocks[link.parent], bias[link.parent]
            )
    a_world = -tree.gravity if gravity else ca.SX.zeros(3)
    return _accelerations(kinematics, links, U, D_inverse, u, a_world, at_rest)


def _accelerations(
    kinematics: Kinematics,
    links: Sequence[Link],
    U: list[ca.SX],
    D_inverse: list[ca.SX],
    u: list[ca.SX],
    a_world: ca.SX,
    at_rest: bool,
) -> ca.SX:
    result = ca.SX.zeros(kinematics.tree.v.numel())
    accelerations: list[Wrench] = []
    for i, link in enumerate(links):
        w_dot, a = accelerations[link.parent] if link.parent >= 0 else (ca.SX.zeros(3), a_world)
        w_dot, a = kernels.move_acceleration(symbolic(link.offset.rotation), symbolic(link.offset.position), w_dot, a)
        w_dot, a = kernels.move_acceleration(symbolic(link.motion.pose.rotation), symbolic(link.motion.pose.position), w_dot, a)
        total = ca.vertcat(w_dot, a) if at_rest else ca.vertcat(w_dot, a) + kinematics.bias(i)
        if link.motion.nv:
            (v_dot,) = kernels.joint_acceleration(link.motion.nv)(U[i], D_inverse[i], u[i], total)
            if link.motion.axes is not None:
                for k, axis in enumerate(link.motion.axes):
                    total[axis] += v_dot[k]
                v_dot = link.motion.sign * v_dot
            else:
                total = total + link.motion.subspace @ v_dot
            result[link.v] = v_dot
        accelerations.append((total[:3], total[3:]))
    return result


def _blocks(link: Link) -> tuple[ca.SX, ca.SX, ca.SX]:
    return (
        ca.densify(symbolic(link.inertia.second_moment)),
        ca.densify(symbolic(skew(link.inertia.moment))),
        ca.densify(ca.SX(link.inertia.mass) * ca.SX.eye(3)),
    )


def _moment(link: Link) -> ca.SX:
    return symbolic(link.inertia.moment)


def _eliminate(
    link: Link, blocks: tuple[ca.SX, ca.SX, ca.SX], bias: Wrench, gamma: ca.SX, tau: ca.SX, rotor: float
) -> tuple[ca.SX, ...]:
    motion = link.motion
    if motion.nv == 0:
        full = ca.blockcat([[blocks[0], blocks[1]], [blocks[1].T, blocks[2]]])
        return *blocks, ca.vertcat(*bias) + full @ gamma, ca.SX(6, 0), ca.SX(0, 0), ca.SX(0, 1)
    if not rotor:
        _check_inertia(link, blocks)
    if motion.axes is not None:
        return kernels.eliminate_axes(motion.axes)(*blocks, *bias, gamma, tau)
    return kernels.eliminate(motion.nv)(*blocks, *bias, gamma, motion.subspace, tau, ca.SX(rotor))


def _check_inertia(link: Link, blocks: tuple[ca.SX, ca.SX, ca.SX]) -> None:
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
    return MasslessError(
        f"Nothing with inertia resists the motion of {link.where}. Its acceleration is undefined. Connect a body with "
        "mass (and, where it turns, with a moment of inertia about the axis) behind the joint, or remove the joint. For a massless "
        "link between two ball joints, whose spin nothing resists, use Rod(length)."
    )


def _add_to_parent(
    link: Link, blocks: tuple[ca.SX, ca.SX, ca.SX], felt: Wrench, parent_blocks: tuple[ca.SX, ca.SX, ca.SX], parent_bias: Wrench
) -> tuple[tuple[ca.SX, ca.SX, ca.SX], Wrench]:
    for pose in (link.motion.pose, link.offset):
        R, p = symbolic(pose.rotation), symbolic(pose.position)
        if not _is_identity(pose.rotation):
            blocks = _rotated(R, blocks)
        if not p.is_zero():
            moved = kernels.shift_inertia(p, *blocks)
            blocks = (moved[0], moved[1], moved[2])
        torque, force = kernels.move_wrench(R, p, *felt)
        felt = (torque, force)
    added = (parent_blocks[0] + blocks[0], parent_blocks[1] + blocks[1], parent_blocks[2] + blocks[2])
    return added, (parent_bias[0] + felt[0], parent_bias[1] + felt[1])


def _is_identity(rotation: Matrix) -> bool:
    return isinstance(rotation, np.ndarray) and np.array_equal(rotation, np.eye(3))


def _rotated(R: ca.SX, blocks: tuple[ca.SX, ca.SX, ca.SX]) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Blocks turned by R; a block that is a multiple of the identity is not touched."""
    I3, H, M = blocks
    return (
        I3 if _isotropic(I3) else kernels.rotate_symmetric(R, I3)[0],
        H if H.is_zero() else kernels.rotate_block(R, H)[0],
        M if _isotropic(M) else kernels.rotate_symmetric(R, M)[0],
    )


def _isotropic(block: ca.SX) -> bool:
    if not (block[0, 1].is_zero() and block[0, 2].is_zero() and block[1, 2].is_zero()):
        return False
    return ca.is_equal(block[0, 0], block[1, 1], 4) and ca.is_equal(block[1, 1], block[2, 2], 4)
