"""Linear equations in symbols, solved in the order in which they are given."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

_CLEANINGS = 3
"""Of what has no inverse: the rest loses no more than this power of the damping by them."""


def factored(A: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """B (n, m) -> A^-1 B, by elimination in the order of the rows."""
    A = ca.SX(A)
    n = A.shape[0]
    factors: list[tuple[int, int, ca.SX]] = []
    for k in range(n):
        for i in range(k + 1, n):
            if A[i, k].is_zero():
                continue
            factor = A[i, k] / A[k, k]
            A[i, k + 1 :] -= factor * A[k, k + 1 :]
            factors.append((i, k, factor))

    def solved(B: ca.SX) -> ca.SX:
        B = ca.densify(ca.SX(B))
        for i, k, factor in factors:
            B[i, :] -= factor * B[k, :]
        for k in reversed(range(n)):
            B[k, :] = (B[k, :] - A[k, k + 1 :] @ B[k + 1 :, :]) / A[k, k]
        return ca.densify(B)

    return solved


def eliminated(A: ca.SX, B: ca.SX) -> ca.SX:
    """A^-1 B (n, m) by elimination in the order of the rows."""
    return factored(A)(B)


def undamped(A: ca.SX, damping: ca.SX, B: ca.SX, refinements: int) -> ca.SX:
    """A^-1 B (n, m); where A has no inverse, of least norm in units of the damping: a column of little numbers which A + diag(damping) has one with. Each
    refinement takes that out again, by a factor of them."""
    D = ca.diag(damping)
    solved = factored(A + D)
    found = ca.SX.zeros(B.shape)
    for _ in range(1 + refinements):
        found = found + solved(B - A @ found)
    # rounding along what A does not see is divided by the damping each time: taken out, since the answer has nothing there
    alone = found
    for _ in range(_CLEANINGS):
        alone = solved(D @ alone)
    return found - alone
