"""Gaps where branches of a motion cross or nearly do, for other values of parameters: whether lengths fit that did not, or the reverse."""

from __future__ import annotations

import casadi as ca
import numpy as np

from acausal.loops.crossing import Crossing, closing_rows, crossing_near
from acausal.loops.examined import Examined
from acausal.numerics.thresholds import ROUNDING, SINGULAR

_REACH = 1.5
"""How far from a least singular value a crossing belongs to it: rad, or sizes of the loop."""
_MOST = 8
_ROUNDS = 4
"""Steps of Newton's method with the inverse of one Jacobian; gaps change with the square of what they leave."""
_APART = 1e-4
"""Gaps, as parts of their terms, from which on motions miss a crossing widely."""


def gap_margins(part: Examined) -> list[ca.SX]:
    """By the coordinates, the time and the parameters, without unit: negative where branches come to cross that miss each other with the
    values of the build, or to miss each other narrowly where they crossed.
    """
    margins: list[ca.SX] = []
    for crossing in _crossings(part):
        gap = _gap(part, crossing)
        for k, size in enumerate(crossing.sizes):
            off, built = ca.fabs(gap[k]) / size, abs(float(crossing.gaps[k])) / size
            if built <= ROUNDING:
                margins.append(ca.fmax(ROUNDING - off, off - _APART))
            else:
                margins.append(off - min(SINGULAR, 0.5 * built))
    return margins


def _crossings(part: Examined) -> list[Crossing]:
    """Those that are known, and those nearest to the least singular values of the walk, however widely they are missed."""
    walk, found = part.walk, list(part.crossings)
    assert walk is not None
    s = np.array([smallest for smallest, _ in part.trail])
    inner = [k for k in range(1, s.size - 1) if s[k] <= s[k - 1] and s[k] <= s[k + 1]]
    for k in sorted({0, int(s.argmin()), s.size - 1, *inner} if s.size else (), key=lambda k: s[k])[:_MOST]:
        near = crossing_near(walk, part.trail[k][1] / walk.unit, part.scale, part.rank.kept, _REACH)
        if near is not None and all(np.max(np.abs(near.z - one.z)) > 1e-6 for one in found):
            found.append(near)
    return found


def _gap(part: Examined, crossing: Crossing) -> ca.SX:
    """(k, 1). A single one follows its crossing, whose place depends on the parameters; several at one place are taken where they are."""
    walk = part.walk
    assert walk is not None
    symbolic, group = walk.symbolic, walk.symbolic.group
    closing = ca.Function("closing", [group.q, symbolic.t, symbolic.parameters], [ca.densify(group.closing)])
    q0, W, t, p = crossing.z * walk.unit, crossing.weights, symbolic.t, symbolic.parameters
    if len(W) > 1:
        return ca.DM(W) @ closing(q0, t, p)
    at = closing_rows(walk)
    kept = [k for k in part.rank.kept if at[k] >= 0]
    rows = [*range(group.invariants.numel()), *(int(at[k]) for k in kept)]
    w0 = W[0, at[kept]]
    along = w0 / (w0 @ w0)
    w, gap = ca.SX.sym("w", w0.size), ca.SX.sym("gap")
    slope = ca.gradient(ca.dot(w * ca.DM(np.abs(w0).max()), group.velocity[kept]), group.v) * ca.DM(walk.rate)
    opened = ca.vertcat(ca.SX.zeros(group.invariants.numel()), gap * ca.DM(along))
    scaled = np.abs(w0).max() * along
    y = ca.vertcat(group.q / ca.DM(walk.unit), w, gap)
    left = ca.vertcat(group.closing[rows] - opened, slope, ca.dot(w, ca.DM(scaled)) - 1)
    z = ca.SX.sym("z", y.numel())
    n = q0.size
    put = [group.q, w, gap], [z[:n] * ca.DM(walk.unit), z[n : n + w0.size], z[y.numel() - 1]]
    left = ca.substitute(left, ca.vertcat(*put[0]), ca.vertcat(*put[1]))
    first = np.concatenate([crossing.z, w0 / np.abs(w0).max(), crossing.gaps])
    J = np.array(ca.Function("J", [z, t, p], [ca.jacobian(left, z)])(first, walk.time, part.values))
    size = np.linalg.norm(J, axis=1)
    back = ca.DM(np.linalg.pinv(J / np.where(size > 0, size, 1.0)[:, None], rcond=1e-12) / np.where(size > 0, size, 1.0))
    residual = ca.Function("residual", [z, t, p], [ca.densify(left)])
    found = ca.SX(ca.DM(first))
    for _ in range(_ROUNDS):
        found = found - back @ residual(found, t, p)
    sums = found[n : n + w0.size] * ca.DM(np.abs(w0).max())
    return ca.dot(sums, closing(found[:n] * ca.DM(walk.unit), t, p)[[int(at[k]) for k in kept]])
