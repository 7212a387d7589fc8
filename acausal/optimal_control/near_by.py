"""Newton's steps to a least cost near by, on the bounds that press there.

Hintermueller, Ito and Kunisch: The primal-dual active set strategy as a semismooth Newton method (2002), with the exact curvature of the Lagrangian.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

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
        self._program = program
        self._matrix, function = _step(program)
        self._pivots = ca.Linsol("kkt", "ldl", self._matrix.sparsity_out(0))
        self._given = [np.zeros(function.size1_in(k)) for k in range(function.n_in())]
        self._told = [np.zeros(function.size1_out(k)) for k in range(function.n_out())]
        buffer, self._run = self._buffer = function.buffer()
        for k, given in enumerate(self._given):
            buffer.set_arg(k, memoryview(given))  # pyright: ignore[reportArgumentType]  # arrays are buffers
        for k, told in enumerate(self._told):
            buffer.set_res(k, memoryview(told))  # pyright: ignore[reportArgumentType]

    def __call__(self, w: np.ndarray, of_bounds: np.ndarray, of_rows: np.ndarray, bounds: np.ndarray) -> Solved | None:
        n, (lower, upper) = self._program.size, np.hstack([bounds, self._program.limits])
        equal, pressed = lower == upper, np.append(of_bounds, of_rows)
        held = np.where(np.abs(pressed) > _PRESSES, np.sign(pressed), 0.0)
        for count in range(_STEPS + 1):
            wall = np.where(held > 0, upper, lower)
            free = (~equal & (held == 0)) | ~np.isfinite(wall)
            wall[free] = 0.0
            for to, column in zip(self._given, (w, of_rows, free[:n], free[n:], wall[:n], wall[n:]), strict=True):
                to[:] = column
            self._run()
            slope, g, ahead, pull = (np.array(one) for one in self._told)
            if not np.isfinite(ahead).all():
                return None
            here, pressed = np.append(w, g), np.append(-slope, of_rows)
            off = np.where(free, np.maximum(lower - here, here - upper), np.abs(here - wall))
            left = max(np.max(off), np.max(np.abs(slope[free[:n]]), initial=0.0), np.sum(np.abs(pressed[~free] * off[~free])))
            if left < _TOLERANCE and (free | equal | (pressed * held >= 0)).all():
                return (np.clip(w, *bounds), pressed[:n], of_rows, count) if self._is_least() else None
            w, of_rows = ahead[:n], pull[n:]
            held = np.where(
                free, np.where(ahead > upper, 1.0, np.where(ahead < lower, -1.0, 0.0)), np.where(pull * held > 0, held, 0.0)
            )
        return None

    def _is_least(self) -> bool:
        """By the inertia of the matrix (Nocedal and Wright, theorem 16.3)."""
        matrix = self._matrix(*self._given[:4])
        self._pivots.nfact(matrix)
        return self._pivots.neig(matrix) == self._program.rows


def _step(program: Program) -> tuple[ca.Function, ca.Function]:
    """(w, multipliers of the rows, which unknowns are free, which rows are) -> the matrix of a step. And these, with where the others are to be, unknowns and rows -> slope of the
    Lagrangian, rows; after the step, to first order, unknowns and rows, and multipliers of bounds and rows.
    """
    n, m = program.size, program.rows
    w, factors, free, loose, wall, limit = (ca.MX.sym("given", size) for size in (n, m, n, m, n, m))
    none = ca.DM(0, 1)
    rows, J = program.derivatives["jac_g"](w, none)
    slope = program.derivatives["grad_f"](w, none)[1] + J.T @ factors
    H = ca.triu2symm(program.derivatives["hess_lag"](w, none, 1.0, factors))
    own, bound = ca.diag(free), ca.diag(1 - loose)
    A = bound @ J @ own
    matrix = ca.blockcat([
        [own @ H @ own + ca.diag(1 - free + _STIFF), A.T],
        [A, -ca.diag(loose + _SOFT)],
    ])  # fmt: skip
    known = (1 - free) * (wall - w)
    right = ca.vertcat(known - free * (slope + H @ known), (1 - loose) * (limit - rows - J @ known) + loose * factors)
    step = ca.solve(matrix, right, "ldl")
    soft = ca.DM(np.repeat([_STIFF, -_SOFT], [n, m]))
    step += ca.solve(matrix, right - matrix @ step + soft * step, "ldl")
    more = H @ step[:n] + J.T @ step[n:]
    ahead = ca.vertcat(w + step[:n], rows + J @ step[:n])
    pull = ca.vertcat(-(slope + more), factors + step[n:])
    given = [w, factors, free, loose, wall, limit]
    options = {"cse": True}
    return ca.Function("matrix", given[:4], [matrix], options), ca.Function("step", given, [slope, rows, ahead, pull], options)
