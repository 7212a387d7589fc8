"""Motion of one frame against another across a joint: what the recursions over a tree need to know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from acausal.parts.pose import Pose, symbolic, vee


@dataclass(frozen=True)
class Motion:
    """Frame B moves in frame A with velocity v (nv, 1).

    Spatial vectors (angular first) of B against A, in B, at B's origin:
    twist = subspace v + drift, acceleration = subspace v' + bias, where the linear part of the acceleration is the
    second derivative of p_AB. `mounting` turns A and B to the frames in which `pose`, twist and bias are given
    (its third axis is the axis of a hinge): X_AB = mounting pose mounting'.
    `axes`: if not None, `subspace` is `sign` times these columns of the 6 x 6 identity, constant: recursions then pick rows and do not multiply.
    `angle`: of a turn about the third axis, None for other motions.
    `spin`: R_CB where all this is given in axes C that share B's origin but not its turning (the heading axes of a wheel):
    then `pose` is X_AC, and twist, `subspace` and bias, of B as ever, are resolved in C. Only for bodies of revolution does it pay:
    the axis is then one of C.
    """

    pose: Pose
    rates: ca.SX
    subspace: ca.SX
    twist: ca.SX
    bias: ca.SX
    v: ca.SX
    axes: tuple[int, ...] | None = None
    sign: float = 1.0
    mounting: np.ndarray | ca.SX = field(default_factory=lambda: np.eye(3))
    angle: ca.SX | None = None
    spin: np.ndarray | ca.SX = field(default_factory=lambda: np.eye(3))

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return self.v.shape[0]


def motion_from_pose(
    pose: Callable[[ca.SX, ca.SX], Pose], rates: Callable[[ca.SX, ca.SX, ca.SX], ca.SX], q: ca.SX, v: ca.SX, t: ca.SX
) -> Motion:
    """Twist, motion subspace and bias by automatic differentiation of the pose along q' = rates(q, v, t), t' = 1."""
    X = pose(q, t)
    R, p = symbolic(X.rotation), symbolic(X.position)
    q_dot = rates(q, v, t)

    def rate(expression: ca.SX) -> ca.SX:
        column = ca.vec(expression)
        change = ca.jtimes(column, t, ca.SX(1))
        if q.numel():
            change += ca.jtimes(column, q, q_dot)
        return ca.reshape(change, *expression.shape)

    p_dot = rate(p)
    w = vee(R.T @ rate(R))
    twist = ca.vertcat(w, R.T @ p_dot)
    bias = ca.vertcat(rate(w), R.T @ rate(p_dot))
    subspace = ca.sparsify(ca.jacobian(twist, v)) if v.numel() else ca.SX(6, 0)
    return Motion(Pose(R, p), q_dot, subspace, twist, bias, v)


def reversed_motion(motion: Motion) -> Motion:
    """The motion of A against B, for a joint that the tree passes from frame_b to frame_a.

    Steps along or about z stay of their kind with the sign turned; any other motion is transformed.
    """
    R, p = symbolic(motion.pose.rotation), symbolic(motion.pose.position)
    back = Pose(R.T, -(R.T @ p))  # of A in the axes C
    if motion.axes in ((2,), (5,), (3, 4, 5)):
        angle = None if motion.angle is None else -motion.angle
        return replace(motion, pose=back, subspace=-motion.subspace, twist=-motion.twist, sign=-motion.sign, angle=angle)
    w, v = motion.twist[:3], motion.twist[3:]
    aw, av = motion.bias[:3], motion.bias[3:]
    S_w, S_v = motion.subspace[:3, :], motion.subspace[3:, :]
    # with r = p_BA in A's axes = -p: r' = -p', r'' = -p''; the frame B turns, so p_BA_B = -R' p
    wA = -(R @ w)
    position = back.position
    velocity_B = -v - ca.cross(w, position)
    acceleration_B = -av - ca.cross(aw, position) - 2 * ca.cross(w, velocity_B) - ca.cross(w, ca.cross(w, position))
    subspace = ca.vertcat(-(R @ S_w), -(R @ (S_v - ca.skew(position) @ S_w)))
    twist = ca.vertcat(wA, R @ velocity_B)
    bias = ca.vertcat(-(R @ aw), R @ acceleration_B)
    pose = Pose(motion.spin, np.zeros(3)).inverse() @ back
    return replace(
        motion, pose=pose, subspace=ca.sparsify(subspace), twist=twist, bias=bias, axes=None, angle=None, spin=np.eye(3)
    )
