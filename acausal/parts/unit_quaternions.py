"""Unit quaternions among coordinates, found by what their joints' invariants say, so that joints of one's own are seen too."""

from __future__ import annotations

import casadi as ca
import numpy as np


def unit_quaternions(rows: ca.SX, q: ca.SX) -> dict[int, int]:
    """Which of the invariants `rows` (n, 1) say that four neighbours in q (nq, 1) have squares that add to 1, up to a factor.

    Number of the row -> where the four begin in q.
    """
    place = {q[i].element_hash(): i for i in range(q.numel())}
    found: dict[int, int] = {}
    for k in range(rows.numel()):
        symbols = ca.symvar(rows[k])
        at = sorted(place.get(s.element_hash(), -1) for s in symbols)
        if len(at) != 4 or at[0] < 0 or at[3] != at[0] + 3:
            continue
        column = q[at[0] : at[0] + 4]
        H, slope = ca.hessian(rows[k], column)
        if not ca.densify(H).is_constant():
            continue
        curvature = np.array(ca.DM(ca.evalf(ca.densify(H))))
        value, slope = ca.Function("rest", [column], [rows[k], ca.densify(slope)])(np.zeros(4))
        size = curvature[0, 0]
        sphere = size != 0 and np.array_equal(curvature, size * np.eye(4))
        if sphere and float(value) == -size / 2 and not np.any(np.array(slope)):
            found[k] = at[0]
    return found
