"""Whether what was decided by numbers holds at a state, a time and values of parameters: one number, for code that cannot decide again.

Rows of loops: the pivots of K K' of the kept rows K, each of its usual length, and what is left of the others beside the span of these (Gram and
Schmidt), and the gaps of crossings that motions would come to. Formulas of linear blocks are put into their equations, rows that follow from others must vanish, and gears that loops hold already must
be met, by lengths that are those of the build.
"""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np

from acausal.dynamics.formulas import pivots, solve_positive
from acausal.loops.examined import Examined
from acausal.loops.gaps import gap_margins
from acausal.loops.walk import Walk
from acausal.numerics.sizes import Drawn
from acausal.numerics.terms import rounded
from acausal.numerics.thresholds import ROUNDING, SINGULAR
from acausal.reduce.state_space import StateSpace
from acausal.scalar.decisions import linear_decisions

_FOLLOWS = 1e-10
"""Squares of what may be left of a row that follows from others."""
_DAMPING = 1e-14
_VANISHED = 1e-9
"""Of the usual length of a row, what is nothing of it."""
_SOLVED = 1e-9
"""What formulas may leave of equations, of the sum of their terms."""
_DRAWS, _PLACES = 12, 2
"""Places that are drawn, and of these where a row is looked at."""
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
    blocks = linear_decisions(s.scalar.blocks, s.p).blocks
    solved = ca.vertcat(ca.SX(0, 1), *(ca.densify(b.matrix @ b.found - b.right) for b in blocks))
    for rows, left in ((solved, _SOLVED), (space.identities, ROUNDING)):
        sampled = _sampled(space.put(rows), space)
        margins += ca.vertsplit(left * rounded(sampled) - ca.fabs(sampled))
    if s.scalar.looped and ca.depends_on(s.closing, s.p):
        looped = space.put(ca.vertcat(*(h.residual for h in s.scalar.looped)))
        margins += ca.vertsplit(_MET * rounded(looped) - ca.fabs(looped))
        margins += [
            -ca.fabs(s.p[k] - s.p_values[k]) for k in range(s.p.numel()) if ca.depends_on(s.closing, s.p[k])
        ]  # nothing tells it anew
    return space.put(functools.reduce(ca.fmin, margins)) if margins else None


def _sampled(rows: ca.SX, space: StateSpace) -> ca.SX:
    """Those that depend on parameters, by these: what holds whatever all else is does at places that are drawn, and at a state it may by chance, as equations of
    angles do where all are zero. Each at the first places where it has a value.
    """
    p, built = space.system.p, space.system.p_values
    rows = ca.vertcat(ca.SX(0, 1), *(row for row in ca.vertsplit(ca.densify(rows)) if ca.depends_on(row, p)))
    own = {p[i].element_hash() for i in range(p.numel())}
    free = ca.vertcat(ca.SX(0, 1), *(e for e in ca.symvar(rows) if e.element_hash() not in own))
    rng, size = np.random.default_rng(5), (free.numel(), _DRAWS)
    places = rng.uniform(0.5, 1.5, size) * rng.choice([-1.0, 1.0], size)
    found = np.array(ca.Function("rows", [p, free], [rows])(np.tile(built[:, None], _DRAWS), places)).reshape(
        rows.numel(), _DRAWS
    )
    chosen = [np.flatnonzero(np.isfinite(row))[:_PLACES] for row in found]
    by_place = [ca.substitute(rows, free, ca.DM(place)) for place in places.T]
    return ca.vertcat(ca.SX(0, 1), *(by_place[j][k] for k, here in enumerate(chosen) for j in here.tolist()))


def clearance(space: StateSpace) -> ca.SX | None:
    """By t, x, u and p: how far, at least, loops without singular positions are from one: the least of the pivots of K K', which falls with the square of
    the distance. None where no parameter can bring them to any.
    """
    found = [
        p
        for part in space.system.constraints.examined
        if part.parameters and not part.singular and part.rank.kept
        for p in ca.vertsplit(pivots(_kept_rows(part)[2]))
    ]
    return space.put(functools.reduce(ca.fmin, found)) if found else None


def _kept_rows(part: Examined) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The rows A of a group, each of its usual length, those that are kept, K, and K K'."""
    assert part.walk is not None
    lengths = _usual_lengths(part, part.walk.sizes_of_velocities[1] * part.scale)
    speeds, grown = _growth(part, part.walk, lengths)
    A = ca.jacobian(part.group.velocity, part.group.v)
    A = ca.sparsify(ca.diag(1 / (ca.DM(lengths) * grown)) @ A @ ca.diag(speeds))
    K = A[list(part.rank.kept), :]
    return A, K, ca.densify(K @ K.T)


def _usual_lengths(part: Examined, found: np.ndarray) -> np.ndarray:
    """Of the rows (m,), where those of rounding errors, which may be more with other values, are infinite: these are as long as others of their kind, or, where
    there are none, as what they are made of; turns have no unit, whatever that of lengths is.
    """
    known, drawn, lengths = np.isfinite(found), Drawn.joined([rows.drawn for rows in part.group.loops]), found.copy()
    for kind in (drawn.shifts, drawn.turns, np.ones(found.size, dtype=bool)):
        most = float(np.max(found, where=kind & known, initial=0.0))
        open_still = kind & ~np.isfinite(lengths)
        lengths[open_still] = most if most > 0 else np.where(drawn.sizes > 0, drawn.sizes, np.inf)[open_still]
    return np.where(np.isfinite(lengths), lengths, 0.0)


def _growth(part: Examined, walk: Walk, lengths: np.ndarray) -> tuple[ca.SX, ca.SX]:
    """How much velocities are (nv, 1), and times as much as where the part was examined its rows (m, 1) of these `lengths` are: rows grow with what they
    are made of, lengths that are parameters, and so do the shifts and speeds that go with these.
    """
    group, f, rates = part.group, walk.symbolic, walk.sizes_of_velocities[0]
    slopes = ca.DM(ca.jacobian(group.rates, group.v).sparsity(), 1).full()
    spins = np.any(slopes[group.turning], axis=0)

    def speeds(by: ca.SX | float) -> ca.SX:
        return ca.vertcat(*(rate if spin else by * rate for rate, spin in zip(rates, spins, strict=True)))

    def grown(by: ca.SX | float, built: float) -> tuple[ca.SX, ca.SX]:
        """The rows, and all that tell together, where what is no angle is `by` times as much, `built` times where the part was examined."""
        here, there = (
            ca.vertcat(*(x if turn else part_of * x for x, turn in zip(part.samples[0], group.turning, strict=True)))
            for part_of in (by, built)
        )
        now = f.terms(here, speeds(by), f.t, f.parameters)
        usual = np.array(ca.evalf(f.terms(there, speeds(built), walk.time, part.values))).ravel()
        told = np.flatnonzero(usual > _VANISHED * lengths).tolist()
        total = ca.sum1(now[told]) / float(np.sum(usual[told])) if told else ca.SX(1)
        return ca.vertcat(*(now[k] / usual[k] if k in told else total for k in range(usual.size))), total

    by = grown(0.0, 0.0)[1]
    return speeds(by), grown(by, 1.0)[0]


def _loops(part: Examined) -> list[ca.SX]:
    """Margins of the rows of a group, without unit, by the coordinates of the tree."""
    A, K, G = _kept_rows(part)
    kept = list(part.rank.kept)
    others = [k for k in range(A.shape[0]) if k not in kept]
    margins = [] if part.singular or not kept else [p - SINGULAR**2 for p in ca.vertsplit(pivots(G))]
    if others and kept:
        D = A[others, :]
        span = solve_positive(G + _DAMPING * ca.SX.eye(len(kept)), ca.densify(K @ D.T))
        left = ca.sum2((D - span.T @ K) ** 2)
        margins += [_FOLLOWS - row for row in ca.vertsplit(ca.densify(left))]
    return margins
