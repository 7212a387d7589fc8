"""The formulas of one link, built once and inlined for every link.

Notation: link B hangs on link A; X_AF is the constant offset from A to the base F of the joint (K, r), X_FB the joint's pose (R, p). Spatial inertia is
[[I, H], [H', M]] acting on [w'; a] with a the acceleration of the frame's origin (not Featherstone's spatial
acceleration), so only angular velocities enter the bias: Luh, Walker and Paul's choice within Featherstone's recursions.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import casadi as ca

from acausal.numerics.inlined import Formula, inlined

V, M33 = (3, 1), (3, 3)
_REORDERED = 8


def symmetric(lower: ca.SX) -> ca.SX:
    """The symmetric matrix with this lower triangle; what stands above the diagonal is not computed."""
    return ca.tril2symm(ca.tril(lower))


@inlined(M33, V, M33, V, V, V, V, V, V)
def velocity(
    K: ca.SX, r: ca.SX, R: ca.SX, p: ca.SX, w_A: ca.SX, w_J: ca.SX, v_J: ca.SX, alpha: ca.SX, beta: ca.SX
) -> tuple[ca.SX, ...]:
    """Angular velocity of B in B, and the acceleration of B that is left when w_A', a_A and v' are zero (angular, linear)."""
    w_F = K.T @ w_A
    w_AB = R.T @ w_F
    offset_bias = K.T @ ca.cross(w_A, ca.cross(w_A, r))
    gamma_w = ca.cross(w_AB, w_J) + alpha
    gamma_v = R.T @ (offset_bias + ca.cross(w_F, ca.cross(w_F, p))) + 2 * ca.cross(w_AB, v_J) + beta
    return w_AB + w_J, gamma_w, gamma_v


@inlined(M33, V, M33, V, V, V, V, V)
def linear_velocity(K: ca.SX, r: ca.SX, R: ca.SX, p: ca.SX, w_A: ca.SX, v_A: ca.SX, v_J: ca.SX, _w_J: ca.SX) -> tuple[ca.SX, ...]:
    """Velocity of B's origin against the world, in B."""
    return (R.T @ (K.T @ (v_A + ca.cross(w_A, r)) + ca.cross(K.T @ w_A, p)) + v_J,)


@inlined(M33, V, V)
def bias_wrench(inertia: ca.SX, moment: ca.SX, w: ca.SX) -> tuple[ca.SX, ...]:
    """Torque and force that a body with angular velocity w needs when w' and a are zero: w x I w, w x (w x m c)."""
    return ca.cross(w, inertia @ w), ca.cross(w, ca.cross(w, moment))


@inlined(M33, M33)
def rotate_symmetric(R: ca.SX, inertia: ca.SX) -> tuple[ca.SX, ...]:
    """R I R' for a symmetric block."""
    return (symmetric(R @ inertia @ R.T),)


@inlined(M33, M33)
def rotate_block(R: ca.SX, H: ca.SX) -> tuple[ca.SX, ...]:
    """R H R' for a general block."""
    return (R @ H @ R.T,)


@inlined(V, M33, M33, M33)
def shift_inertia(p: ca.SX, inertia: ca.SX, H: ca.SX, M: ca.SX) -> tuple[ca.SX, ...]:
    """Blocks of a spatial inertia about a point that lies -p away."""
    P = ca.skew(p)
    H_A = H + P @ M
    return symmetric(inertia + P @ H.T - H_A @ P), H_A, M


@inlined(M33, V, V, V)
def move_wrench(R: ca.SX, p: ca.SX, torque: ca.SX, force: ca.SX) -> tuple[ca.SX, ...]:
    """A wrench in B, in A and about A's origin, for the pose (R, p) of B in A."""
    f = R @ force
    return R @ torque + ca.cross(p, f), f


@inlined(M33, V, V, V)
def move_acceleration(R: ca.SX, p: ca.SX, w_dot: ca.SX, a: ca.SX) -> tuple[ca.SX, ...]:
    """Accelerations at B, in B, of the rigid motion with w', a at A (without the terms in w)."""
    return R.T @ w_dot, R.T @ (a + ca.cross(w_dot, p))


@functools.cache
def eliminate_axes(axes: tuple[int, ...]) -> Formula:
    """Articulated inertia behind a joint whose motion subspace are columns of the identity.

    Arguments I, H, M. Results: I, H, M as felt at the near side, U (6, n), 1/D (n, n). What is zero behind the joint by
    structure is zero, not a difference.
    """
    rest = [i for i in range(6) if i not in axes]

    @inlined(M33, M33, M33)
    def formula(I3: ca.SX, H: ca.SX, M: ca.SX) -> tuple[ca.SX, ...]:
        full = ca.blockcat([[I3, H], [H.T, M]])
        D_inverse = inverse_positive(full[list(axes), list(axes)])
        U_rest = full[rest, list(axes)]
        result = ca.SX(6, 6)
        result[rest, rest] = symmetric(full[rest, rest] - U_rest @ D_inverse @ U_rest.T)
        return result[:3, :3], result[:3, 3:], result[3:, 3:], full[:, list(axes)], D_inverse

    return formula


@functools.cache
def pass_axes(axes: tuple[int, ...]) -> Formula:
    """Bias (6, 1) as felt at the near side of such a joint, and u (n, 1).

    Arguments: I, H, M felt at the near side, U, 1/D, torque and force bias behind the joint (3, 1 each), gamma (6, 1), tau (n, 1).
    """
    n = len(axes)
    rest = [i for i in range(6) if i not in axes]

    @inlined(M33, M33, M33, (6, n), (n, n), V, V, (6, 1), (n, 1))
    def formula(
        I3: ca.SX, H: ca.SX, M: ca.SX, U: ca.SX, D_inverse: ca.SX, torque: ca.SX, force: ca.SX, gamma: ca.SX, tau: ca.SX
    ) -> tuple[ca.SX, ...]:
        reduced = ca.blockcat([[I3, H], [H.T, M]])[rest, rest]
        bias = ca.vertcat(torque, force)
        u = tau - bias[list(axes)]
        felt = ca.SX(6, 1)
        felt[rest] = bias[rest] + reduced @ gamma[rest] + U[rest, :] @ (D_inverse @ u)
        felt[list(axes)] = tau
        return felt, u

    return formula


@functools.cache
def eliminate(n: int) -> Formula:
    """As `eliminate_axes` for a general motion subspace S (6, n), and inertia of the motion itself: U = I S + C, D = S' I S + E."""

    @inlined(M33, M33, M33, (6, n), (6, n), (n, n))
    def formula(I3: ca.SX, H: ca.SX, M: ca.SX, S: ca.SX, C: ca.SX, E: ca.SX) -> tuple[ca.SX, ...]:
        full = ca.blockcat([[I3, H], [H.T, M]])
        U = full @ S
        D_inverse = inverse_positive(symmetric(S.T @ U) + symmetric(E))
        U = U + C
        result = symmetric(full - U @ D_inverse @ U.T)
        return result[:3, :3], result[:3, 3:], result[3:, 3:], U, D_inverse

    return formula


@functools.cache
def pass_motion(n: int) -> Formula:
    """As `pass_axes` for a general motion subspace S (6, n), which comes before tau."""

    @inlined(M33, M33, M33, (6, n), (n, n), V, V, (6, 1), (6, n), (n, 1))
    def formula(
        I3: ca.SX, H: ca.SX, M: ca.SX, U: ca.SX, D_inverse: ca.SX, torque: ca.SX, force: ca.SX, gamma: ca.SX, S: ca.SX, tau: ca.SX
    ) -> tuple[ca.SX, ...]:
        bias = ca.vertcat(torque, force)
        u = tau - S.T @ bias
        return bias + ca.blockcat([[I3, H], [H.T, M]]) @ gamma + U @ (D_inverse @ u), u

    return formula


@functools.cache
def joint_acceleration(n: int) -> Formula:
    """v' = 1/D (u - U' a) for the acceleration a (6, 1) that B would have with v' = 0."""

    @inlined((6, n), (n, n), (n, 1), (6, 1))
    def formula(U: ca.SX, D_inverse: ca.SX, u: ca.SX, a: ca.SX) -> tuple[ca.SX, ...]:
        return (D_inverse @ (u - U.T @ a),)

    return formula


def inverse_positive(D: ca.SX) -> ca.SX:
    """Inverse of a symmetric positive definite matrix by its L D L' factors, without pivoting."""
    n = D.shape[0]
    if n == 1:
        return 1 / D
    d, Lt, _ = ca.ldl(D, False)
    L, inverse = Lt.T, ca.SX(n, n)
    L_inverse = ca.SX.eye(n)
    for j in range(n):
        for i in range(j + 1, n):
            value = -L[i, j]
            for k in range(j + 1, i):
                value -= L[i, k] * L_inverse[k, j]
            L_inverse[i, j] = value
    for i in range(n):
        for j in range(i + 1):
            entry = ca.SX(0)
            for k in range(i, n):
                entry += L_inverse[k, i] * L_inverse[k, j] / d[k]
            inverse[i, j] = entry
    return symmetric(ca.densify(inverse))


def positive_solver(A: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """B -> A \\ B for a symmetric positive definite A by sparse L D L' without pivoting; straight-line code."""
    A = ca.sparsify(A)
    full = A.nnz() == A.numel()
    factors = ca.ldl(A, not full and A.shape[0] > _REORDERED)  # against fill-in
    return lambda B: ca.densify(ca.ldl_solve(ca.densify(B), *factors))


def solve_positive(A: ca.SX, B: ca.SX) -> ca.SX:
    """A \\ B for a symmetric positive definite A, see `positive_solver`."""
    return positive_solver(A)(B)


def damped_solver(A: ca.SX, damping: ca.SX, refinements: int = 0) -> Callable[[ca.SX], ca.SX]:
    """B -> A \\ B for a symmetric semidefinite A, its components along small eigenvalues left out; straight-line code.

    A + diag(damping) is solved, and refined against A: along an eigenvector with eigenvalue s, in units where the damping d is the
    same for all rows, the result is the exact one times 1 - (d / (s + d))^(1 + refinements).
    """
    solve = positive_solver(A + ca.diag(damping))

    def refined(B: ca.SX) -> ca.SX:
        X = solve(B)
        for _ in range(refinements):
            X = X + solve(B - A @ X)
        return X

    return refined


def pivots(A: ca.SX) -> ca.SX:
    """(n, 1) pivots of a symmetric positive definite A, in the order of its factors: one is small where A is nearly singular."""
    A = ca.sparsify(A)
    return ca.densify(ca.ldl(A, A.nnz() < A.numel() and A.shape[0] > _REORDERED)[0])
