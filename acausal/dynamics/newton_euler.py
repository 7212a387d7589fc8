"""Recursive Newton-Euler: forces from accelerations, O(n); the residual form of the dynamics, and joint reactions.

Luh, Walker and Paul (1980); Featherstone (2008), section 5.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from acausal.dynamics import formulas
from acausal.dynamics.kinematics import Kinematics
from acausal.parts.inertia import skew
from acausal.parts.pose import symbolic

Wrench = tuple[ca.SX, ca.SX]


@dataclass(frozen=True)
class NewtonEuler:
    """Joint forces tau (nv, 1) that the motion needs, and for each link its acceleration and the wrench across its joint.

    `accelerations`: (w', a) of each link's frame in the frame, gravity subtracted. `transmitted`: torque and force that the
    link gets from its parent, in and about the link's frame.
    """

    tau: ca.SX
    accelerations: tuple[Wrench, ...]
    transmitted: tuple[Wrench, ...]


def newton_euler(kinematics: Kinematics, v_dot: ca.SX, wrenches: list[Wrench]) -> NewtonEuler:
    """tau from q, v, v' (nv, 1) and external wrenches on each link (torque, force) in and about its frame."""
    tree = kinematics.tree
    accelerations: list[Wrench] = []
    needed: list[Wrench] = []
    for i, link in enumerate(tree.links):
        w_dot, a = accelerations[link.parent] if link.parent >= 0 else (ca.SX.zeros(3), -tree.gravity)
        for pose in (link.offset, link.motion.pose):
            w_dot, a = formulas.move_acceleration(symbolic(pose.rotation), symbolic(pose.position), w_dot, a)
        change = kinematics.bias(i) + link.motion.subspace @ v_dot[link.v] if link.motion.nv else kinematics.bias(i)
        w_dot, a = w_dot + change[:3], a + change[3:]
        accelerations.append((w_dot, a))
        if link.inertia.is_zero:
            torque, force = ca.SX.zeros(3), ca.SX.zeros(3)
        else:
            second, moment = symbolic(link.inertia.second_moment), symbolic(link.inertia.moment)
            torque, force = formulas.bias_wrench(ca.densify(second), moment, kinematics.angular_velocity(i))
            H = symbolic(skew(link.inertia.moment))
            torque = torque + second @ w_dot + H @ a
            force = force + H.T @ w_dot + ca.SX(link.inertia.mass) * a
        needed.append((torque - wrenches[i][0], force - wrenches[i][1]))
    tau = ca.SX.zeros(tree.v.numel())
    for link in tree.links:
        if link.modal is not None:
            seat, C, own = link.modal.seat, link.modal.frame_coupling(), v_dot[link.v]
            torque, force, modal = link.modal.bias(kinematics.angular_velocity(seat))
            both = C @ own + ca.vertcat(torque, force)
            needed[seat] = (needed[seat][0] + both[:3], needed[seat][1] + both[3:])
            tau[link.v] = C.T @ ca.vertcat(*accelerations[seat]) + link.modal.modal_mass() @ own + modal
    for i in reversed(range(len(tree.links))):
        link = tree.links[i]
        torque, force = needed[i]
        if link.motion.nv:
            tau[link.v] += link.motion.subspace.T @ ca.vertcat(torque, force)
        if link.parent >= 0:
            for pose in (link.motion.pose, link.offset):
                torque, force = formulas.move_wrench(symbolic(pose.rotation), symbolic(pose.position), torque, force)
            needed[link.parent] = (needed[link.parent][0] + torque, needed[link.parent][1] + force)
    return NewtonEuler(tau, tuple(accelerations), tuple(needed))
