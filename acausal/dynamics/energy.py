"""Energies of a tree, in symbols."""

from __future__ import annotations

import casadi as ca

from acausal.dynamics.kinematics import Kinematics
from acausal.parts.modal_inertia import ModalInertia
from acausal.parts.pose import symbolic


def kinetic_energy(kinematics: Kinematics) -> ca.SX:
    """Sum of m v.v/2 + v.(w x m c) + w.I w/2 over the links, and what deformation adds [J]."""
    energy = ca.SX(0)
    for i, link in enumerate(kinematics.tree.links):
        if link.inertia.is_zero:
            continue
        w, v = kinematics.angular_velocity(i), kinematics.linear_velocity(i)
        moment = symbolic(link.inertia.moment)
        second = symbolic(link.inertia.second_moment)
        energy += 0.5 * ca.SX(link.inertia.mass) * ca.dot(v, v) + ca.dot(v, ca.cross(w, moment)) + 0.5 * ca.dot(w, second @ w)
    for modal in _elastic(kinematics):
        angular, linear = modal.momentum()
        energy += ca.dot(kinematics.angular_velocity(modal.seat), angular) + ca.dot(modal.v, modal.modal_mass() @ modal.v) / 2
        energy += ca.dot(kinematics.linear_velocity(modal.seat), linear)
    return energy


def gravity_potential(kinematics: Kinematics) -> ca.SX:
    """Minus the work of uniform gravity [J]; zero at the world's origin."""
    energy = ca.SX(0)
    for i, link in enumerate(kinematics.tree.links):
        X = kinematics.relative_pose(-1, i)
        first_moment = ca.SX(link.inertia.mass) * symbolic(X.position) + symbolic(X.rotation) @ symbolic(link.inertia.moment)
        energy -= ca.dot(kinematics.tree.gravity, first_moment)
    return energy


def _elastic(kinematics: Kinematics) -> list[ModalInertia]:
    """Elastic bodies; as if frozen they are among the links' inertias."""
    return [link.modal for link in kinematics.tree.links if link.modal is not None]
