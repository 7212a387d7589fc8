"""Poses: position and orientation of one frame in another, numeric (numpy) or symbolic (`SX`)."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.language.connector import Frame
from acausal.language.expression import Expression
from acausal.numerics.inlined import inlined

Matrix = np.ndarray | ca.SX
_ONE = np.eye(3)


@dataclass(frozen=True)
class Pose:
    """X_AB: `rotation` R_AB (3, 3) and `position` p_AB_A (3,) [m] of frame B in frame A.

    Both entries are numpy arrays when the pose is a constant, else `SX`. `X_AB @ X_BC` is X_AC.
    """

    rotation: Matrix
    position: Matrix

    @classmethod
    def identity(cls) -> Pose:
        """The pose of a frame in itself."""
        return cls(np.eye(3), np.zeros(3))

    @property
    def is_constant(self) -> bool:
        """Whether it is made of numbers only."""
        return isinstance(self.rotation, np.ndarray) and isinstance(self.position, np.ndarray)

    def __matmul__(self, other: Pose) -> Pose:
        rotation = product(self.rotation, other.rotation)
        return Pose(rotation, total(self.position, product(self.rotation, other.position)))

    def inverse(self) -> Pose:
        """X_BA."""
        transposed = self.rotation.T
        return Pose(transposed, -product(transposed, self.position))


def pose(position: np.ndarray | Expression, rotation: np.ndarray | Expression | None = None) -> Pose:
    """A pose from checked numbers or expressions; no rotation by default."""
    turned = np.eye(3) if rotation is None else rotation
    return Pose(*(given.sx if isinstance(given, Expression) else given for given in (turned, position)))


def pose_between(a: Frame, b: Frame) -> Pose:
    """X_ab, as read of the frames."""
    return Pose((a.rotation.T @ b.rotation).sx, (a.rotation.T @ (b.position - a.position)).sx)


def symbolic(matrix: Matrix) -> ca.SX:
    """As `SX`, which is not to be changed; a vector becomes a column."""
    return matrix if isinstance(matrix, ca.SX) else _constant(matrix.shape, np.asarray(matrix, dtype=float).tobytes())


def symbols(X: Pose) -> Pose:
    """The same pose, both entries as `SX`: what methods of parts are called with."""
    return Pose(symbolic(X.rotation), symbolic(X.position))


@functools.lru_cache(maxsize=4096)
def _constant(shape: tuple[int, ...], entries: bytes) -> ca.SX:
    """Numbers as `SX`: the same few are asked for many times."""
    return ca.SX(ca.DM(np.frombuffer(entries).reshape(shape)))


def product(a: Matrix, b: Matrix) -> Matrix:
    """a @ b with a (3, 3), numeric if both are."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a @ b
    if _is_one(a) or (isinstance(b, np.ndarray) and not b.any()):
        return symbolic(b)
    return symbolic(a) if _is_one(b) else symbolic(a) @ symbolic(b)


def _is_one(a: Matrix) -> bool:
    return isinstance(a, np.ndarray) and np.array_equal(a, _ONE)


def total(a: Matrix, b: Matrix) -> Matrix:
    """a + b, numeric if both are."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a + b
    return ca.SX.binary(ca.OP_ADD, symbolic(a), symbolic(b))  # as quickly as CasADi adds


def snapped(matrix: np.ndarray, tolerance: float = 4e-15) -> np.ndarray:
    """Entries within `tolerance` of 0, 1 or -1 become exactly that, so that they fold away in symbolic code."""
    result = matrix.copy()
    for exact in (0.0, 1.0, -1.0):
        result[np.abs(result - exact) < tolerance] = exact
    return result


def cleaned_vector(vector: Matrix) -> Matrix:
    """Entries that are only rounding errors of the others become zero; symbolic ones stay."""
    if not isinstance(vector, np.ndarray):
        return vector
    size = float(np.max(np.abs(vector), initial=0.0))
    return np.where(np.abs(vector) < 1e-15 * size, 0.0, vector)


def cleaned(pose: Pose) -> Pose:
    """A constant pose without rounding errors where zeros and ones are meant."""
    if not isinstance(pose.rotation, np.ndarray):
        return pose
    return Pose(snapped(pose.rotation), cleaned_vector(pose.position))


_CYCLES = {
    (0.0, 0.0, 1.0): np.eye(3),
    (1.0, 0.0, 0.0): np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    (0.0, 1.0, 0.0): np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    (0.0, 0.0, -1.0): np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    (-1.0, 0.0, 0.0): np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    (0.0, -1.0, 0.0): np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}


def rotation_to_axis(axis: np.ndarray) -> np.ndarray:
    """A rotation R (3, 3) whose third column is the unit vector `axis`; a permutation for coordinate axes."""
    cycle = _CYCLES.get((float(axis[0]), float(axis[1]), float(axis[2])))
    if cycle is not None:
        return cycle
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


_UNLIKELY = -0.41
"""Of an axis' last component: axes in a plane, or at angles that things are built with, have others."""


def rotation_to_axis_symbolic(axis: ca.SX) -> ca.SX:
    """The same for an axis that depends on parameters: one of two formulas, each far from where it is singular. It jumps where no axis is likely to be."""
    x, y, z = axis[0], axis[1], axis[2]
    s = ca.if_else(z >= _UNLIKELY, 1, -1)
    k = 1 / (1 + s * z)
    return ca.vertcat(
        ca.horzcat(1 - k * x * x, -s * k * x * y, x), ca.horzcat(-k * x * y, s * (1 - k * y * y), y), ca.horzcat(-s * x, -y, z)
    )


def rotation_from_quaternion(q: ca.SX) -> ca.SX:
    """R(q) for a unit quaternion, scalar first, shape (4, 1) -> (3, 3)."""
    return _rotation_from_quaternion(q)[0]


@inlined((4, 1))
def _rotation_from_quaternion(q: ca.SX) -> tuple[ca.SX]:
    w, x, y, z = q[0], q[1], q[2], q[3]
    xx, yy, zz = 2 * x * x, 2 * y * y, 2 * z * z
    xy, xz, yz, wx, wy, wz = 2 * x * y, 2 * x * z, 2 * y * z, 2 * w * x, 2 * w * y, 2 * w * z
    first, second = ca.horzcat(1 - yy - zz, xy - wz, xz + wy), ca.horzcat(xy + wz, 1 - xx - zz, yz - wx)
    return (ca.vertcat(first, second, ca.horzcat(xz - wy, yz + wx, 1 - xx - yy)),)


def quaternion_rate(q: ca.SX, w: ca.SX) -> ca.SX:
    """q' = q * (0, w) / 2 for the angular velocity w in the turned frame."""
    return 0.5 * ca.vertcat(
        -q[1] * w[0] - q[2] * w[1] - q[3] * w[2],
        q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
        q[0] * w[1] + q[3] * w[0] - q[1] * w[2],
        q[0] * w[2] + q[1] * w[1] - q[2] * w[0],
    )


def rotation_about_z(angle: ca.SX) -> ca.SX:
    """R_z(angle)."""
    return _rotation_about_z(angle)[0]


@inlined((1, 1))
def _rotation_about_z(angle: ca.SX) -> tuple[ca.SX]:
    c, s = ca.cos(angle), ca.sin(angle)
    return (ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1)),)


def vee(matrix: ca.SX) -> ca.SX:
    """The vector of the skew-symmetric part."""
    return 0.5 * ca.vertcat(matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1])


def quaternion_from_matrix(R: ca.SX) -> ca.SX:
    """Unit quaternion (4, 1), scalar first, of a symbolic rotation matrix: Shepperd's four cases, the best conditioned one taken."""
    w4, x4 = 1 + R[0, 0] + R[1, 1] + R[2, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2]
    y4, z4 = 1 - R[0, 0] + R[1, 1] - R[2, 2], 1 - R[0, 0] - R[1, 1] + R[2, 2]
    wx, wy, wz = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[1, 0] + R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2]
    cases = [ca.vertcat(w4, wx, wy, wz), ca.vertcat(wx, x4, xy, xz), ca.vertcat(wy, xy, y4, yz), ca.vertcat(wz, xz, yz, z4)]
    best, chosen = w4, cases[0]
    for square, case in zip((x4, y4, z4), cases[1:], strict=True):
        chosen = ca.if_else(square > best, case, chosen)
        best = ca.fmax(square, best)
    return chosen / ca.norm_2(chosen)
