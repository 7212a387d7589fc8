"""Balanced bodies that spin: where an angle turns nothing but the body itself, no equation needs to know of it.

Equations of a body of revolution may be written in axes that share its axle but not its spin: its inertia is constant in them. Velocities
and accelerations are those of the body as ever, only resolved in other axes, so that no recursion notices.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from acausal.numerics.vanishing import vanish
from acausal.parts.inertia import Inertia
from acausal.parts.motion import Motion
from acausal.parts.pose import Matrix, Pose, rotation_about_z, snapped, symbolic


def balanced(inertia: Inertia, q: ca.SX) -> Inertia:
    """The same, without the coordinates q (n, 1) where it only seems to depend on them."""
    entries = _entries(inertia)
    if not (q.numel() and ca.depends_on(entries, q)):
        return inertia
    at_zero = ca.substitute(entries, q, ca.SX.zeros(q.numel()))
    if not vanish(entries - at_zero):
        return inertia
    moment = _numeric(at_zero[:3])
    moment = moment.ravel() if isinstance(moment, np.ndarray) else moment
    return Inertia(inertia.mass, moment, _numeric(ca.reshape(at_zero[3:], 3, 3)))


def without_turn(motion: Motion, inertia: Inertia) -> tuple[Motion, Inertia, Pose] | None:
    """A hinge, and the inertia behind it, in axes that do not turn with the hinge, and the turn (pose of the hinge's axes in these);
    None where the inertia is not balanced about the hinge's axis, or there is no hinge.
    """
    if motion.axes != (2,) or motion.angle is None:
        return None
    turn = Pose(rotation_about_z(motion.angle), np.zeros(3))
    angles = ca.vertcat(*ca.symvar(motion.angle))
    still = balanced(inertia.seen_from(turn), angles)
    if ca.depends_on(_entries(still), angles):
        return None
    return replace(motion, pose=Pose.identity(), angle=None), still, turn


def one_turn(offset: Pose, motion: Motion) -> tuple[Pose, Motion]:
    """A hinge about the axle of a wheel that spins in the `offset` before it: one turn by the sum of both angles."""
    rotation = offset.rotation
    if motion.angle is None or isinstance(rotation, np.ndarray):
        return offset, motion
    for symbol in ca.symvar(rotation):
        rest = ca.substitute(rotation, symbol, 0)
        for angle in (symbol, -symbol):
            if vanish(ca.vec(rotation - rest @ rotation_about_z(angle))):
                whole = motion.angle + angle
                turn = replace(motion, angle=whole, pose=Pose(rotation_about_z(whole), np.zeros(3)))
                fixed = _numeric(rest)
                return Pose(snapped(fixed) if isinstance(fixed, np.ndarray) else fixed, offset.position), turn
    return offset, motion


def _entries(inertia: Inertia) -> ca.SX:
    return ca.densify(ca.vertcat(symbolic(inertia.moment), ca.vec(symbolic(inertia.second_moment))))


def _numeric(matrix: ca.SX) -> Matrix:
    return np.array(ca.DM(ca.evalf(matrix))) if matrix.is_constant() else matrix
