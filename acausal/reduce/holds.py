"""Whether what was decided by numbers holds at a state, a time and values of parameters: one number, for code that cannot decide again.

Rows of loops: the pivots of K K' of the kept rows K, each of its usual length, and what is left of the others beside the span of these (Gram and
Schmidt), and the gaps of crossings that motions would come to. Formulas of linear blocks are put into their equations, rows that follow from others must vanish, and gears that loops hold already must
be met.
"""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np

from acausal.dynamics.formulas import pivots, solve_positive
from acausal.loops.examined import Examined
from acausal.loops.gaps import gap_margins
from acausal.numerics.terms import rounded
from acausal.numerics.thresholds import SINGULAR
from acausal.reduce.state_space import StateSpace
from acausal.scalar.decisions import linear_decisions

_FOLLOWS = 1e-10
"""Squares of what may be left of a row that follows from others."""
_DAMPING = 1e-14
_VANISHED = 1e-9
"""What may be left of other rows, of the sum of their terms."""
_MET = 1e-4
"""The same of equations that closed loops hold: to tolerances of a run."""


def holds(space: StateSpace) -> ca.SX | None:
    """By t, x, u and p: not negative where everything that was decided holds; NaN counts as negative. None where nothing can change it."""
    s = space.system
    margins: list[ca.SX] = []
    for part in s.constraints.examined:
        if part.parameters or part.timed:
            margins += _loops(part)
        if part.parameters and part.trail:
            margins += gap_margins(part)
    followers = [h.residual for h in s.scalar.redundant]
    blocks = linear_decisions(s.scalar.blocks, s.p).blocks
    solved = [ca.densify(b.matrix @ b.found - b.right) for b in blocks]
    rows = space.put(_sampled(ca.vertcat(ca.SX(0, 1), *followers, *solved, space.vanishing), space))
    for k in range(rows.numel()):
        if ca.depends_on(rows[k], s.p):
            margins.append(_VANISHED * rounded(rows[k]) - ca.fabs(rows[k]))
    if s.scalar.looped and ca.depends_on(s.closing, s.p):
        looped = space.put(ca.vertcat(*(h.residual for h in s.scalar.looped)))
        margins += ca.vertsplit(_MET * rounded(looped) - ca.fabs(looped))
    return space.put(functools.reduce(ca.fmin, margins)) if margins else None


def _sampled(rows: ca.SX, space: StateSpace) -> ca.SX:
    """With numbers for symbols that are no states, inputs or parameters: what stands for the mechanics in equations of flanges."""
    s = space.system
    known = {e.element_hash() for e in ca.symvar(ca.vertcat(s.t, s.x, s.u, space.p))}
    free = ca.vertcat(ca.SX(0, 1), *(e for e in ca.symvar(rows) if e.element_hash() not in known))
    return ca.substitute(rows, free, ca.DM(np.random.default_rng(5).uniform(0.5, 1.5, free.numel()))) if free.numel() else rows


def _loops(part: Examined) -> list[ca.SX]:
    """Margins of the rows of a group, without unit, by the coordinates of the tree."""
    assert part.walk is not None
    rates, lengths = part.walk.sizes_of_velocities
    usual = np.max(lengths * part.scale, where=np.isfinite(lengths), initial=0.0)
    lengths = np.where(np.isfinite(lengths), lengths * part.scale, usual)  # rows of rounding errors may be more with other values
    # rows grow with what they are made of: lengths that are parameters
    functions, walk = part.walk.symbolic, part.walk
    usual_terms = np.array(functions.terms(part.samples[0], rates, walk.time, part.values)).ravel()
    here = functions.terms(part.group.q, ca.DM(rates), functions.t, functions.parameters)
    told = usual_terms > _VANISHED * lengths
    grown = ca.sum1(here[np.flatnonzero(told).tolist()]) / float(np.sum(usual_terms[told]))
    sizes = ca.vertcat(*(n * (here[k] / usual_terms[k] if told[k] else grown) for k, n in enumerate(lengths)))
    A = ca.jacobian(part.group.velocity, part.group.v)
    A = ca.sparsify(ca.diag(1 / sizes) @ A @ ca.diag(ca.DM(rates)))
    kept = list(part.rank.kept)
    others = [k for k in range(A.shape[0]) if k not in kept]
    K = A[kept, :]
    G = ca.densify(K @ K.T)
    margins = [] if part.singular or not kept else [p - SINGULAR**2 for p in ca.vertsplit(pivots(G))]
    if others and kept:
        D = A[others, :]
        span = solve_positive(G + _DAMPING * ca.SX.eye(len(kept)), ca.densify(K @ D.T))
        left = ca.sum2((D - span.T @ K) ** 2)
        margins += [_FOLLOWS - row for row in ca.vertsplit(ca.densify(left))]
    return margins
