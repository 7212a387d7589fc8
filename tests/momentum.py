"""Momenta of a tree, in symbols: sums over its links that no recursion of the package makes."""

from __future__ import annotations

import casadi as ca

from acausal.dynamics.kinematics import Kinematics
from acausal.parts.modal_inertia import ModalInertia
from acausal.parts.pose import symbolic


def linear_momentum(kinematics: Kinematics) -> ca.SX:
    """In the world frame [kg m/s], (3, 1)."""
    total = ca.SX.zeros(3)
    for i, link in enumerate(kinematics.tree.links):
        if not link.inertia.is_zero:
            total += symbolic(kinematics.pose(i).rotation) @ _momentum(kinematics, i)
    for modal in _elastic(kinematics):
        total += symbolic(kinematics.pose(modal.seat).rotation) @ modal.momentum()[1]
    return total


def angular_momentum(kinematics: Kinematics) -> ca.SX:
    """About the world's origin, in the world frame [kg m^2/s], (3, 1)."""
    total = ca.SX.zeros(3)
    for i, link in enumerate(kinematics.tree.links):
        if link.inertia.is_zero:
            continue
        X = kinematics.pose(i)
        w, v = kinematics.angular_velocity(i), kinematics.linear_velocity(i)
        own = symbolic(link.inertia.second_moment) @ w + ca.cross(symbolic(link.inertia.moment), v)
        R = symbolic(X.rotation)
        total += R @ own + ca.cross(symbolic(X.position), R @ _momentum(kinematics, i))
    for modal in _elastic(kinematics):
        X, (angular, linear) = kinematics.pose(modal.seat), modal.momentum()
        R = symbolic(X.rotation)
        total += R @ angular + ca.cross(symbolic(X.position), R @ linear)
    return total


def _elastic(kinematics: Kinematics) -> list[ModalInertia]:
    """Elastic bodies; as if frozen they are among the links' inertias."""
    return [link.modal for link in kinematics.tree.links if link.modal is not None]


def _momentum(kinematics: Kinematics, link: int) -> ca.SX:
    inertia = kinematics.tree.links[link].inertia
    w, v = kinematics.angular_velocity(link), kinematics.linear_velocity(link)
    return ca.SX(inertia.mass) * v + ca.cross(w, symbolic(inertia.moment))
