"""Newton's steps to a least cost near by, on the bounds that press there.

Hintermueller, Ito and Kunisch: The primal-dual active set strategy as a semismooth Newton method (2002), with the exact curvature of the Lagrangian.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.numerics.bound import bound
from acausal.optimal_control.separable import Program

_STEPS = 8
"""Who needs more is not near."""
_TOLERANCE, _PRESSES = 1e-9, 1e-7
"""Of the program in units of its own: what is left of its conditions and, by what presses, of its cost; and from which multiplier on something is held at its bound where it begins."""
_STIFF, _SOFT = 1e-9, 1e-6
"""In units of the program: by how much unknowns are held back in a step, and rows give way; a second solution takes nearly all of that back. Their product is more than rounding, so no pivot
vanishes.
"""

Solved = tuple[np.ndarray, np.ndarray, np.ndarray, int]
"""Unknowns, multipliers of their bounds and of the rows, and steps."""


class NearBy:
    """Unknowns (n,), multipliers of their bounds (n,) and of the rows, near those of a least cost, and `bounds` (2, n) -> what is solved; None where eight steps do not lead to
    a least cost.
    """

    def __init__(self, program: Program) -> None:
        self._program, n, m = program, program.size, program.rows
        here, self._matrix, step = _functions(program)
        self._pivots = ca.Linsol("kkt", "ldl", self._matrix.sparsity_out(0))
        self._at = [np.zeros(n), np.zeros(m)]
        self._local = [np.zeros(here.nnz_out(k)) for k in range(here.n_out())]
        self._held = [np.zeros(size) for size in (n, m, n, m)]
        self._after = [np.zeros(n + m), np.zeros(n + m)]
        self.look, looks = bound(here, self._at, self._local)
        """Evaluates all derivatives where it came last."""
        self._go, goes = bound(step, [*self._local, *self._held, *self._at], self._after)
        self._alive = looks, goes

    def __call__(self, w: np.ndarray, of_bounds: np.ndarray, of_rows: np.ndarray, bounds: np.ndarray) -> Solved | None:
        n, (lower, upper) = self._program.size, np.hstack([bounds, self._program.limits])
        equal, pressed = lower == upper, np.append(of_bounds, of_rows)
        held = np.where(np.abs(pressed) > _PRESSES, np.sign(pressed), 0.0)
        for count in range(_STEPS + 1):
            wall = np.where(held > 0, upper, lower)
            free = (~equal & (held == 0)) | ~np.isfinite(wall)
            wall[free] = 0.0
            self._at[0][:], self._at[1][:] = w, of_rows
            for to, column in zip(self._held, (free[:n], free[n:], wall[:n], wall[n:]), strict=True):
                to[:] = column
            self.look()
            slope, rows = self._local[:2]
            here, pressed = np.append(w, rows), np.append(-slope, of_rows)
            if not (np.isfinite(slope).all() and np.isfinite(rows).all()):
                return None
            off = np.where(free, np.maximum(lower - here, here - upper), np.abs(here - wall))
            left = max(np.max(off), np.max(np.abs(slope[free[:n]]), initial=0.0), np.sum(np.abs(pressed[~free] * off[~free])))
            if left < _TOLERANCE and (free | equal | (pressed * held >= 0)).all():
                return (np.clip(w, *bounds), pressed[:n], of_rows, count) if self._is_least() else None
            self._go()
            ahead, pull = (one.copy() for one in self._after)
            if not np.isfinite(ahead).all():
                return None
            w, of_rows = ahead[:n], pull[n:]
            held = np.where(
                free, np.where(ahead > upper, 1.0, np.where(ahead < lower, -1.0, 0.0)), np.where(pull * held > 0, held, 0.0)
            )
        return None

    def _is_least(self) -> bool:
        """By the inertia of the matrix (Nocedal and Wright, theorem 16.3)."""
        matrix = self._matrix(*self._local[2:], *self._held[:2])
        self._pivots.nfact(matrix)
        return self._pivots.neig(matrix) == self._program.rows


def _functions(program: Program) -> tuple[ca.Function, ca.Function, ca.Function]:
    """(w, multipliers of the rows) -> slope of the Lagrangian, rows, entries of their Jacobian and of the curvature; (these entries, which unknowns are free, which rows are) -> the matrix of a
    step; (all of these, where the others are to be: unknowns, rows, w, multipliers) -> after the step, to first order, unknowns and rows, and multipliers of bounds and rows.
    """
    n, m, none, options = program.size, program.rows, ca.DM(0, 1), {"cse": True}
    w, factors, free, loose, wall, limit = (ca.MX.sym("given", size) for size in (n, m, n, m, n, m))
    rows, J = program.derivatives["jac_g"](w, none)
    triangle = program.derivatives["hess_lag"](w, none, 1.0, factors)
    slope = program.derivatives["grad_f"](w, none)[1] + J.T @ factors
    entries = [ca.vec(ca.MX(part.nz[:])) for part in (J, triangle)]
    here = ca.Function("here", [w, factors], [slope, rows, *entries], options)
    at, gap, *told = (ca.MX.sym("told", size) for size in (n, m, *(one.numel() for one in entries)))
    J, triangle = (ca.MX(part.sparsity(), one) for part, one in zip((J, triangle), told, strict=True))
    H, own, bound = ca.triu2symm(triangle), ca.diag(free), ca.diag(1 - loose)
    A = bound @ J @ own
    matrix = ca.blockcat([
        [own @ H @ own + ca.diag(1 - free + _STIFF), A.T],
        [A, -ca.diag(loose + _SOFT)],
    ])  # fmt: skip
    known = (1 - free) * (wall - w)
    right = ca.vertcat(known - free * (at + H @ known), (1 - loose) * (limit - gap - J @ known) + loose * factors)
    step = ca.solve(matrix, right, "ldl")
    soft = ca.DM(np.repeat([_STIFF, -_SOFT], [n, m]))
    step += ca.solve(matrix, right - matrix @ step + soft * step, "ldl")
    ahead = ca.vertcat(w + step[:n], gap + J @ step[:n])
    pull = ca.vertcat(-(at + H @ step[:n] + J.T @ step[n:]), factors + step[n:])
    given = [at, gap, *told, free, loose, wall, limit, w, factors]
    return (
        here,
        ca.Function("matrix", [*told, free, loose], [matrix], options),
        ca.Function("step", given, [ahead, pull], options),
    )
