"""Axes and rotations as a user writes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import casadi as ca
import numpy as np

from acausal.errors import ParameterError
from acausal.language.expression import Expression, Scalar, vector
from acausal.language.origin import origin
from acausal.parts.pose import Matrix, rotation_from_quaternion, rotation_to_axis, rotation_to_axis_symbolic, snapped

Axis = str | Sequence[float] | np.ndarray | Expression
"""'x', 'y', 'z', '-x', '-y', '-z', or a vector of any positive length."""


class HasMatrix(Protocol):
    """Scipy's `Rotation`."""

    def as_matrix(self) -> np.ndarray:
        """(3, 3)."""
        ...


Rotation = np.ndarray | Sequence[Sequence[float]] | Sequence[float] | tuple[Axis, float] | HasMatrix | None
"""A rotation matrix (3, 3), a tuple or list (w, x, y, z) of a unit quaternion, (axis, angle [rad]), scipy's `Rotation`, or None for none."""

_NAMED = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def axis_vector(axis: Axis, what: str) -> np.ndarray | Expression:
    """The unit vector along an axis: (3,) array, or an expression (3, 1). Raises `ParameterError` for length zero."""
    if isinstance(axis, str):
        name = axis.lstrip("+-")
        if name not in _NAMED:
            raise ParameterError(f"{what} is '{axis}' ({origin()}). Use 'x', 'y', 'z' (with '-' for the other way), or a vector.")
        return np.array(_NAMED[name]) * (-1.0 if axis.startswith("-") else 1.0) + 0.0
    direction = vector(axis, what)  # pyright: ignore[reportArgumentType]
    if isinstance(direction, Expression):
        return direction / Expression(ca.norm_2(direction.sx), direction.leaves)
    length = float(np.linalg.norm(direction))
    if length < 1e-12:
        raise ParameterError(f"{what} has length zero ({origin()}). Give a direction, e.g. (0, 0, 1) or 'z'.")
    return snapped(direction / length) + 0.0


def mounting(axis: np.ndarray | Expression) -> Matrix:
    """A rotation (3, 3) whose third axis is `axis`."""
    return rotation_to_axis_symbolic(axis.sx) if isinstance(axis, Expression) else rotation_to_axis(axis)


def rotation_matrix(rotation: Rotation | Scalar) -> np.ndarray | None:
    """The matrix (3, 3) of a rotation given in any of the accepted ways. Raises `ParameterError` if it is not a rotation."""
    if rotation is None:
        return None
    if isinstance(rotation, tuple) and len(rotation) == 2:
        axis, angle = rotation
        return rotation_about(np.asarray(axis_vector(axis, "rotation axis")), float(angle))  # pyright: ignore[reportArgumentType]
    matrix = getattr(rotation, "as_matrix", None)  # scipy's Rotation
    try:
        array = np.asarray(rotation if matrix is None else matrix(), dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape == (4,):
        if isinstance(rotation, np.ndarray):
            raise ParameterError(
                f"rotation: in {rotation} the scalar may stand first, as it does here, or last, as in scipy ({origin()}). Give scipy's Rotation "
                "itself, rotation=Rotation.from_quat(...), or a tuple (w, x, y, z)."
            )
        length = float(np.linalg.norm(array))
        if not abs(length - 1) < 1e-6:
            raise ParameterError(f"rotation: the quaternion {array} has length {length:g}, not 1 ({origin()}).")
        return snapped(np.array(ca.DM(ca.evalf(rotation_from_quaternion(ca.SX(ca.DM(array / length)))))))
    if array.shape == (3, 3) and np.all(np.isfinite(array)):
        if np.max(np.abs(array.T @ array - np.eye(3))) < 1e-9 and np.linalg.det(array) > 0:
            return snapped(array)
        raise ParameterError(f"rotation is not a right-handed orthogonal matrix ({origin()}): {array.tolist()}.")
    raise ParameterError(
        f"rotation must be a matrix (3, 3), a tuple (w, x, y, z) of a quaternion, scipy's Rotation, or (axis, angle), not {rotation!r} ({origin()})."
    )


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) by `angle` [rad] about the unit vector `axis` (3,): Rodrigues' formula."""
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return snapped(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)
