"""Rotations as people give and read them: twelve Euler sets, axis and angle, quaternions, Rodrigues' vectors, matrices.

R_AB turns what is written in B into what is written in A; its columns are the axes of B in A. Everything is made of numbers, or of any
expression of a scene. M. D. Shuster, A survey of attitude representations, J. Astronautical Sciences 41 (1993).

    R = rotations.seen_from(scene.world.frame, scene.top.frame)
    run[rotations.euler_angles(R, "intrinsic zxz")]  # precession, nutation, spin
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from acausal.arguments import shown
from acausal.errors import ExpressionError, ParameterError
from acausal.language.connector import Frame
from acausal.language.expression import Expression, Scalar, checked, formula, leaves, number, sx, vector
from acausal.language.origin import origin
from acausal.parts.pose import quaternion_from_matrix, rotation_from_quaternion, snapped

Axis = str | Sequence[float] | np.ndarray | Expression
"""'x', 'y', 'z', '-x', '-y', '-z', or a vector of any positive length."""


class HasMatrix(Protocol):
    """Scipy's `Rotation`."""

    def as_matrix(self) -> np.ndarray:
        """(3, 3)."""
        ...


Rotation = (
    np.ndarray
    | Sequence[Sequence[float]]
    | Sequence[float]
    | tuple[Axis, Scalar]
    | tuple[str, Scalar]
    | HasMatrix
    | Expression
    | None
)
"""A rotation matrix (3, 3), a tuple or list (w, x, y, z) of a unit quaternion, (axis, angle [rad]), scipy's `Rotation`, None for none, or a
pair of a name and numbers: ("intrinsic zxz", (a, b, c)) and ("extrinsic xyz", (a, b, c)) in radians and any of the twelve orders,
("quaternion wxyz", q), ("quaternion xyzw", q), ("rodrigues", axis tan(angle / 2)), ("modified rodrigues", axis tan(angle / 4)),
("rotation vector", axis angle)."""

_NAMED = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_EVEN = 1e-9
"""What a rotation may be off by where people have rounded its numbers."""
_LEAST = 1e-300


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
    largest = float(np.max(np.abs(direction)))
    if not largest:
        raise ParameterError(f"{what} has length zero ({origin()}). Give a direction, e.g. (0, 0, 1) or 'z'.")
    direction = np.ldexp(direction, -int(np.frexp(largest)[1]))  # whatever unit it is in, its square is a number
    return snapped(direction / np.linalg.norm(direction)) + 0.0


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) by `angle` [rad] about the unit vector `axis` (3,): Rodrigues' formula."""
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return snapped(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


def rotation_matrix(rotation: Rotation | Scalar) -> np.ndarray | Expression | None:
    """The matrix (3, 3) of a rotation given in any of the accepted ways, None for None. Raises `ParameterError` if it is not a rotation."""
    if rotation is None:
        return None
    if isinstance(rotation, tuple) and len(rotation) == 2:
        return _named(rotation[0], rotation[1])
    if leaves(rotation) or isinstance(rotation, Expression | ca.SX):
        return _numbers(_of_expression(rotation))  # pyright: ignore[reportArgumentType]
    matrix = getattr(rotation, "as_matrix", None)  # scipy's Rotation
    try:
        array = np.asarray(rotation if matrix is None else matrix(), dtype=float)
    except (TypeError, ValueError, OverflowError, ExpressionError):
        array = np.zeros(0)
    if array.shape == (4,):
        if isinstance(rotation, np.ndarray):
            raise ParameterError(
                f"rotation: in {rotation} the scalar may stand first, as it does here, or last, as in scipy ({origin()}). Give scipy's Rotation "
                'itself, rotation=Rotation.from_quat(...), or name the order, ("quaternion wxyz", q).'
            )
        return _numbers(quaternion(tuple(array.tolist())))
    if array.shape == (3, 3) and np.all(np.isfinite(array)):
        _check_matrix(array)
        return snapped(array)
    raise ParameterError(
        f"rotation must be a matrix (3, 3), a tuple (w, x, y, z) of a quaternion, scipy's Rotation, (axis, angle), or a pair such as "
        f'("intrinsic zxz", (a, b, c)), not {shown(rotation)} ({origin()}).'
    )


def _named(name: Any, value: Any) -> np.ndarray | Expression:
    """Of a pair: an axis and an angle, or a name and numbers."""
    words = name.split() if isinstance(name, str) else []
    if words and words[0] in ("intrinsic", "extrinsic"):
        return _numbers(euler(name, value))
    if words and words[0] == "quaternion":
        return _numbers(quaternion(value, order=words[1] if len(words) == 2 else ""))
    if name in _VECTORS:
        return _numbers(_VECTORS[name](value))
    if isinstance(name, str) and name.lstrip("+-") not in _NAMED:
        hint = (
            f' Say whether the axes turn along: ("intrinsic {name.lower()}", ...) or "extrinsic".' if _is_sequence(name) else ""
        )
        raise ParameterError(
            f"rotation is named {name!r} ({origin()}).{hint} Names are 'intrinsic zxz' and 'extrinsic xyz' with any of the twelve orders, 'quaternion "
            f"wxyz', 'quaternion xyzw', {', '.join(map(repr, _VECTORS))}; or give an axis and an angle, ('x', 0.3)."
        )
    axis = axis_vector(name, "rotation axis")
    if isinstance(axis, np.ndarray) and not isinstance(value, Expression | ca.SX):
        return rotation_about(axis, number(value, "rotation angle"))
    return _numbers(axis_angle(axis, value))


def _of_expression(rotation: Scalar) -> Expression:
    value = Expression(formula(sx(rotation), "rotation"), leaves(rotation))
    rows, found = value.shape, value.leaves
    if rows in ((9, 1), (3, 3)):
        matrix = value if rows == (3, 3) else Expression(ca.reshape(value.sx, 3, 3).T, found)
        return checked(matrix, _check_matrix)
    if rows == (4, 1):
        return quaternion(value)
    raise ParameterError(f"rotation has the shape {rows} ({origin()}). Give a matrix (3, 3) or a quaternion (w, x, y, z).")


def _check_matrix(array: np.ndarray) -> None:
    if not np.isfinite(array).all() or np.max(np.abs(array.T @ array - np.eye(3))) > _EVEN or np.linalg.det(array) < 0:
        raise ParameterError(f"rotation is not a right-handed orthogonal matrix ({origin()}): {array.tolist()}.")


def _numbers(matrix: Expression) -> np.ndarray | Expression:
    """An array where it is one."""
    return matrix if matrix.leaves else snapped(np.array(ca.DM(ca.evalf(ca.densify(matrix.sx)))))


def _entries(value: Scalar, count: int, what: str) -> list[ca.SX]:
    """The scalars of a list of this length. Raises `ParameterError`."""
    try:
        column = sx(value if leaves(value) else np.asarray(value, dtype=float))
    except (TypeError, ValueError, OverflowError, ExpressionError):
        column = ca.SX(0, 1)
    if column.shape not in ((count, 1), (1, count)) or (column.is_constant() and not np.isfinite(np.array(ca.DM(column))).all()):
        raise ParameterError(f"{what} must be {count} finite numbers or expressions, not {shown(value)} ({origin()}).")
    return [column[k] for k in range(count)]


def _about(axis: int, angle: ca.SX) -> ca.SX:
    """R (3, 3) about one of the axes."""
    c, s = ca.cos(angle), ca.sin(angle)
    R = ca.SX.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R[j, j], R[k, k], R[j, k], R[k, j] = c, c, -s, s
    return R


def _is_sequence(letters: str) -> bool:
    """Whether it is one of the twelve orders of axes."""
    axes = letters.lower()
    return len(axes) == 3 and set(axes) <= set("xyz") and axes[0] != axes[1] != axes[2]


def _sequence(name: object) -> tuple[bool, list[int]]:
    """Whether the axes turn along, and which they are. Raises `ParameterError`."""
    words = name.split() if isinstance(name, str) else []
    if len(words) != 2 or words[0] not in ("intrinsic", "extrinsic") or not _is_sequence(words[1]):
        hint = " Axes of the turned frame are 'intrinsic', those of the first one 'extrinsic'." if len(words) == 1 else ""
        raise ParameterError(
            f"Euler angles are asked for in the order {name!r} ({origin()}).{hint} Name one of the twelve, 'intrinsic zxz', 'intrinsic zyx', "
            "'extrinsic xyz' ..., no axis twice in a row."
        )
    return words[0] == "intrinsic", ["xyz".index(letter) for letter in words[1].lower()]


def euler(sequence: str, angles: Scalar) -> Expression:
    """R_AB (3, 3) of Euler angles (3,) [rad] in the order of their axes.

    `sequence`: "intrinsic zxz" turns about z, then about the new x, then about the new z; "extrinsic xyz" about the axes of A. Any of the
    twelve orders. scipy writes the first with capitals, the second without.
    """
    intrinsic, axes = _sequence(sequence)
    turns = [_about(axis, angle) for axis, angle in zip(axes, _entries(angles, 3, "Euler angles"), strict=True)]
    first, second, third = turns if intrinsic else turns[::-1]
    return Expression(first @ second @ third, leaves(angles))


_NOTHING = 1e-300
"""Beside entries of a rotation: where these are zero of either sign, an angle is 0 and not half a turn."""


def euler_angles(R: Scalar, sequence: str) -> Expression:
    """The angles (3, 1) [rad] of R (3, 3), as `euler` takes them: first and third in (-pi, pi], the second in [0, pi] where first and third axis are
    the same one, else in [-pi/2, pi/2]. Where the second is at an end of its range the other two turn about one axis: any first one goes with one third,
    and where nothing tells it, it is 0.
    """
    intrinsic, axes = _sequence(sequence)
    i, j, k = axes if intrinsic else axes[::-1]
    R_, found = _matrix(R)
    s = 1 if (j - i) % 3 == 1 else -1
    if i == k:
        n = 3 - i - j
        first = ca.atan2(R_[j, i], _NOTHING - s * R_[n, i])
        second = ca.atan2(_length(R_[i, j], R_[i, n]), R_[i, i])
    else:
        n = k
        first = ca.atan2(-s * R_[j, k], _NOTHING + R_[k, k])
        second = ca.atan2(s * R_[i, k], _length(R_[i, i], R_[i, j]))
    across = n if i == k else i
    sine, cosine = (
        ca.cos(first) * R_[j, column] + s * ca.sin(first) * R_[n, column] for column in (across, j)
    )  # of what the first turn leaves
    third = ca.atan2(-s * sine if i == k else s * sine, _NOTHING + cosine)
    return Expression(
        ca.vertcat(first, second, third) if intrinsic else ca.vertcat(third, second, first), found, f"{sequence}{{}}"
    )


def axis_angle(axis: Axis, angle: Scalar) -> Expression:
    """R (3, 3) of a turn by `angle` [rad] about `axis` (3,) of any length: Euler's representation."""
    n = sx(axis_vector(axis, "rotation axis"))
    (a,) = _entries([angle] if not isinstance(angle, list | tuple) else angle, 1, "rotation angle")
    K = ca.skew(n)
    return Expression(ca.SX.eye(3) + ca.sin(a) * K + (1 - ca.cos(a)) * (K @ K), leaves(axis, angle))


def quaternion(q: Scalar, order: str = "wxyz") -> Expression:
    """R (3, 3) of a unit quaternion (4,); `order`: "wxyz" with the scalar first, or "xyzw". Raises `ParameterError` for numbers of another length."""
    entries = _ordered(_entries(q, 4, "a quaternion"), order)
    column, found = ca.vertcat(*entries), leaves(q)
    if not found:
        length = float(ca.norm_2(column))
        if not abs(length - 1) < 1e-6:
            raise ParameterError(f"rotation: the quaternion {shown(q)} has length {length:g}, not 1 ({origin()}).")
    return Expression(rotation_from_quaternion(column / ca.norm_2(column)), found)


def _ordered(entries: Sequence[ca.SX], order: str) -> list[ca.SX]:
    """Scalar first. Raises `ParameterError` for an order that is none."""
    if order not in ("wxyz", "xyzw"):
        raise ParameterError(
            f"a quaternion's order is {order!r} ({origin()}). Use 'wxyz' (scalar first) or 'xyzw' (scalar last)."
        )
    return list(entries) if order == "wxyz" else [entries[3], *entries[:3]]


def quaternion_of(R: Scalar, order: str = "wxyz") -> Expression:
    """The unit quaternion (4, 1) of R (3, 3) in this order, up to its sign."""
    R_, found = _matrix(R)
    q = quaternion_from_matrix(R_)
    _ordered([q] * 4, order)
    return Expression(q if order == "wxyz" else ca.vertcat(q[1:], q[0]), found, "quaternion{}")


def rodrigues(r: Scalar) -> Expression:
    """R (3, 3) of Rodrigues' vector axis tan(angle / 2), (3,): every turn but half ones. Gibbs' vector is another name of it."""
    return Expression(_of_scaled(ca.SX(1), ca.vertcat(*_entries(r, 3, "Rodrigues' vector"))), leaves(r))


def modified_rodrigues(r: Scalar) -> Expression:
    """R (3, 3) of the vector axis tan(angle / 4), (3,): every turn but full ones."""
    v = ca.vertcat(*_entries(r, 3, "the modified Rodrigues vector"))
    return Expression(_of_scaled(1 - ca.sumsqr(v), 2 * v), leaves(r))


def rotation_vector(r: Scalar) -> Expression:
    """R (3, 3) of the vector axis angle, (3,) [rad]."""
    v = ca.vertcat(*_entries(r, 3, "a rotation vector"))
    angle = _length(v[0], v[1], v[2])
    return Expression(_of_scaled(ca.cos(angle / 2), ca.sin(angle / 2) / angle * v), leaves(r))


def _of_scaled(w: ca.SX, v: ca.SX) -> ca.SX:
    """Of a quaternion of any length."""
    q = ca.vertcat(w, v)
    return rotation_from_quaternion(q / ca.norm_2(q))


_VECTORS = {"rodrigues": rodrigues, "modified rodrigues": modified_rodrigues, "rotation vector": rotation_vector}


def rodrigues_of(R: Scalar) -> Expression:
    """Rodrigues' vector (3, 1) of R (3, 3); infinite at half a turn."""
    w, v, found = _halves(R)
    return Expression(v / w, found, "rodrigues{}")


def modified_rodrigues_of(R: Scalar) -> Expression:
    """The vector axis tan(angle / 4), (3, 1), of R (3, 3); angles from 0 to pi."""
    w, v, found = _halves(R)
    return Expression(v / (1 + w), found, "modified_rodrigues{}")


def rotation_vector_of(R: Scalar) -> Expression:
    """The vector axis angle, (3, 1) [rad], of R (3, 3); angles from 0 to pi."""
    w, v, found = _halves(R)
    sine = _length(v[0], v[1], v[2])
    return Expression(2 * ca.atan2(sine, w) / sine * v, found, "rotation_vector{}")


def axis_of(R: Scalar) -> Expression:
    """The unit vector (3, 1) that R (3, 3) turns about by `angle_of`, the same in A and in B; zeros where it does not turn."""
    _, v, found = _halves(R)
    return Expression(v / _length(v[0], v[1], v[2]), found, "axis{}")


def angle_of(R: Scalar) -> Expression:
    """The angle [rad] that R (3, 3) turns by, from 0 to pi."""
    w, v, found = _halves(R)
    return Expression(2 * ca.atan2(_length(v[0], v[1], v[2]), w), found, "angle{}")


def _halves(R: Scalar) -> tuple[ca.SX, ca.SX, frozenset[Any]]:
    """Quaternion with a scalar that is not negative: cosine and sine (3, 1) of half the angle."""
    R_, found = _matrix(R)
    q = quaternion_from_matrix(R_)
    sign = ca.if_else(q[0] < 0, -1, 1)
    return sign * q[0], sign * q[1:], found


def _matrix(R: Scalar) -> tuple[ca.SX, frozenset[Any]]:
    """Raises `ParameterError` for what is no (3, 3)."""
    value = sx(R)
    if isinstance(R, list | tuple) and value.shape == (9, 1):
        value = ca.reshape(value, 3, 3).T
    if value.shape != (3, 3):
        raise ParameterError(f"a rotation matrix has the shape {value.shape} ({origin()}). Give one of shape (3, 3).")
    return value, leaves(R)


def _length(*entries: ca.SX) -> ca.SX:
    return ca.sqrt(sum((entry * entry for entry in entries), ca.SX(_LEAST)))


def seen_from(a: Frame, b: Frame) -> Expression:
    """R_AB (3, 3): the axes of frame b as frame a sees them."""
    for frame in (a, b):
        if not isinstance(frame, Frame):  # pyright: ignore[reportUnnecessaryIsInstance]  # users pass anything
            raise ParameterError(f"seen_from takes two frames, not {shown(frame)} ({origin()}). A point has no orientation.")
    return a.rotation.T @ b.rotation


@dataclass(frozen=True)
class AnatomicalJoint:
    """Joint coordinates of anatomy: `flexion`, `adduction`, `external_rotation` [rad], and `shifts` (3, 1) [m] along the lateral axis of the
    proximal bone, the floating axis (forward), and the long axis of the distal bone (downwards: distraction)."""

    flexion: Expression
    adduction: Expression
    external_rotation: Expression
    shifts: Expression


def anatomical_joint(proximal: Frame, distal: Frame, side: str = "right") -> AnatomicalJoint:
    """How the distal bone (shank) stands against the proximal one (thigh), by axes that need no order: the lateral one of the proximal bone, the
    long one of the distal bone, and the floating axis across both.

    Frames: x to the right of the body, y forward, z upwards along the bone. Flexion moves the distal end backwards, adduction towards the
    middle of the body, external rotation turns y of the distal bone outwards. E. S. Grood, W. J. Suntay, A joint coordinate system for the clinical
    description of three-dimensional motions, J. Biomechanical Engineering 105 (1983).
    """
    if side not in ("right", "left"):
        raise ParameterError(f"side is {side!r} ({origin()}). Use 'right' or 'left'.")
    outwards = 1.0 if side == "right" else -1.0
    R = seen_from(proximal, distal)
    lateral, long_axis = sx((1.0, 0.0, 0.0)), R.sx[:, 2]
    across = ca.cross(long_axis, lateral)
    floating = across / _length(across[0], across[1], across[2])
    in_distal = R.sx.T @ floating
    offset = proximal.rotation.T @ (distal.position - proximal.position)
    found = R.leaves | offset.leaves
    return AnatomicalJoint(
        Expression(ca.atan2(-floating[2], floating[1]), R.leaves, "flexion{}"),
        Expression(outwards * ca.atan2(long_axis[0], _length(long_axis[1], long_axis[2])), R.leaves, "adduction{}"),
        Expression(outwards * ca.atan2(-in_distal[0], in_distal[1]), R.leaves, "external rotation{}"),
        Expression(ca.vertcat(offset.sx[0], ca.dot(offset.sx, floating), -ca.dot(offset.sx, long_axis)), found, "shifts{}"),
    )
