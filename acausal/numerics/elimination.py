"""Linear equations in symbols, solved in the order in which they are given, or by QR."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

_CLEANINGS = 3
"""Of what has no inverse: the rest loses no more than this power of the damping by them."""


def factored(A: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """B (n, m) -> A^-1 B, by elimination in the order of the rows."""
    A = ca.sparsify(ca.SX(A))
    n = A.shape[0]
    rows, columns, pivots = list[ca.SX](), list[ca.SX](), list[ca.SX]()
    for _ in range(n):
        pivots.append(A[0, 0])
        rows.append(ca.sparsify(A[0, 1:]))
        columns.append(ca.sparsify(A[1:, 0]) / A[0, 0])
        A = ca.sparsify(A[1:, 1:] - columns[-1] @ rows[-1])

    def solved(B: ca.SX) -> ca.SX:
        left, found = ca.densify(ca.SX(B)), list[ca.SX]()
        for column in columns:
            found.append(left[0, :])
            left = left[1:, :] - column @ found[-1]
        X = ca.SX(0, B.shape[1])
        for pivot, row, right in zip(reversed(pivots), reversed(rows), reversed(found), strict=True):
            X = ca.vertcat((right - row @ X) / pivot, X)
        return ca.densify(X)

    return solved


def eliminated(A: ca.SX, B: ca.SX) -> ca.SX:
    """A^-1 B (n, m) by elimination in the order of the rows."""
    return factored(A)(B)


def solved_by_qr(A: ca.SX, B: ca.SX) -> ca.SX:
    """A^-1 B (n, m) by QR, which needs no pivot that is known not to vanish, with rows brought to one size.

    QR looks at all rows of a column at once: of rows in small units it would see nothing. Columns need no such care. Sizes are roots of sums of squares:
    absolute values would be switches, at which steps of a motion end. Two rows by Cramer's rule, which is as good there and has the same bits in other
    units; three as CasADi does, likewise by minors.
    """
    A, B = ca.densify(ca.SX(A)), ca.densify(ca.SX(B))
    if A.shape[0] < 2:
        return B / ca.repmat(A, 1, B.shape[1]) if A.numel() else B
    if A.shape == (2, 2):
        found = ca.vertcat(A[1, 1] * B[0, :] - A[0, 1] * B[1, :], A[0, 0] * B[1, :] - A[1, 0] * B[0, :])
        return found / (A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0])
    if A.shape == (3, 3):
        return ca.solve(A, B)
    squares = A * A
    rows = ca.sqrt(ca.sum2(squares / ca.repmat(ca.sum1(squares), A.shape[0], 1)))
    A, B = A / ca.repmat(rows, 1, A.shape[1]), B / ca.repmat(rows, 1, B.shape[1])
    first, right = ca.qr(A)
    Q, R = ca.qr(first)  # again, since the first one is by Gram and Schmidt and not orthogonal where columns are nearly parallel
    return ca.solve(ca.triu(R @ right), Q.T @ B)


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
