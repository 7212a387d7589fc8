"""Elastic mounts between two frames."""

from __future__ import annotations

import functools
from typing import final

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ExpressionError, ParameterError
from acausal.language.expression import Expression, Scalar, checked, formula, is_truth, leaves, sx
from acausal.language.origin import origin
from acausal.parts.pose import Pose, symbolic, vee
from acausal.parts.potential import AbstractPotential

_EVEN = 1e-9
"""Part of the entries within which a matrix counts as symmetric, and its least direction as not negative."""


@final
class Bushing(AbstractPotential):
    """A rubber mount: elastic and damped in all six directions between two frames, at rest where they coincide.

    Displacement p_ab in frame_a [m]; turn a = 2 sin(angle / 2) axis [rad]. Stores (a, p) K (a, p) / 2 with `stiffness` K: six numbers or a
    symmetric (6, 6), turns first [N*m/rad, N/m]; where it couples turns with displacements it is for turns below half a turn, where a changes sign.
    `damping`: the same shapes, by the angular velocity and velocity of frame_b against frame_a, seen in frame_a [N*m*s/rad, N*s/m]. Moments
    follow by virtual work.

        scene.mount = Bushing(stiffness=(50, 50, 20, 4e5, 4e5, 2e5), damping=(0, 0, 0, 800, 800, 400))
    """

    turns = True

    def __init__(self, stiffness: Scalar, damping: Scalar = (0.0,) * 6) -> None:
        self.stiffness = _matrix(stiffness, "stiffness")
        self.damping_matrix = _matrix(damping, "damping")

    def potential(self, X_ab: Pose, t: ca.SX) -> ca.SX:
        R, p, K = symbolic(X_ab.rotation), symbolic(X_ab.position), sx(self.stiffness)
        trace, double = ca.trace(R), vee(R)  # the sine of the whole angle along the axis
        rest = R + R.T + (1 - trace) * ca.SX.eye(3)
        squares = double @ double.T + (3 - trace) / 4 * rest  # a a' at any angle: rest is a a' too, but rounding of 1
        coupling = ca.dot(2 * double / ca.sqrt(1 + trace), K[:3, 3:] @ p)
        return 0.5 * (ca.dot(squares, K[:3, :3]) + ca.dot(p, K[3:, 3:] @ p)) + coupling

    def damping(self, X_ab: Pose, w_ab_b: ca.SX, v_ab_b: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
        R = symbolic(X_ab.rotation)
        wrench = -(sx(self.damping_matrix) @ ca.vertcat(R @ w_ab_b, R @ v_ab_b))
        return R.T @ wrench[:3], R.T @ wrench[3:]


def _matrix(value: Scalar, name: str) -> np.ndarray | Expression:
    """Six numbers on the diagonal, or a symmetric matrix (6, 6) without negative directions."""
    what = f"Bushing's {name}"
    found = leaves(value)
    try:
        entries = sx(value if found else np.asarray("no numbers" if is_truth(value) else value, dtype=float))
    except (TypeError, ValueError, OverflowError, ExpressionError):
        raise ParameterError(
            f"{what} is {shown(value)} ({origin()}). Give six numbers or a matrix (6, 6): turns first."
        ) from None
    if entries.shape == (6, 1):
        entries = ca.diag(entries)
    if entries.shape != (6, 6):
        raise ParameterError(
            f"{what} has the shape {entries.shape} ({origin()}). Give six numbers or a matrix (6, 6): turns first."
        )

    check = functools.partial(_check_mount, what=what)
    if found:
        return checked(Expression(formula(ca.densify(entries), what), found), check)
    numbers = np.array(ca.DM(ca.evalf(ca.densify(entries))))
    check(numbers)
    return numbers


def _check_mount(matrix: np.ndarray, what: str) -> None:
    size = float(np.max(np.abs(matrix), initial=0.0))
    if not np.isfinite(matrix).all() or np.max(np.abs(matrix - matrix.T)) > _EVEN * size:
        raise ParameterError(f"{what} is {matrix.tolist()} ({origin()}). It must be finite and symmetric.")
    ends = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), 1.0))  # turns and lengths have other units
    if np.linalg.eigvalsh(matrix / np.outer(ends, ends))[0] < -_EVEN:
        raise ParameterError(f"{what} has a negative direction ({origin()}): {matrix.tolist()}. No mount gives energy away.")
