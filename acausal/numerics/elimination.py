"""Linear equations in symbols, solved in the order in which they are given."""

from __future__ import annotations

import casadi as ca


def eliminated(A: ca.SX, B: ca.SX) -> ca.SX:
    """A^-1 B (n, m) by elimination in the order of the rows."""
    A, B = ca.SX(A), ca.densify(ca.SX(B))
    n = A.shape[0]
    for k in range(n):
        for i in range(k + 1, n):
            if A[i, k].is_zero():
                continue
            factor = A[i, k] / A[k, k]
            A[i, k + 1 :] -= factor * A[k, k + 1 :]
            B[i, :] -= factor * B[k, :]
    for k in reversed(range(n)):
        B[k, :] = (B[k, :] - A[k, k + 1 :] @ B[k + 1 :, :]) / A[k, k]
    return ca.densify(B)
