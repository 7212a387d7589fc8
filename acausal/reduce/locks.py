"""Locks: constraints that are imposed and released, in one set of equations for both.

Reactions of all locks obey (k W k + 1 - k) r = - k b, where the rows' accelerations are a = b + W r and k is 1 for rows that are held, else 0. Rows may depend on one another,
as six of them do between two bodies that move in a plane: then the reactions are those of least norm, by a damping that is taken out again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.mode_rows import LockRows
from acausal.errors import ModelError
from acausal.language.expression import Discrete, Input, Reaction, declared
from acausal.numerics.elimination import undamped
from acausal.numerics.terms import rounded
from acausal.reduce.motion import Motion

_DAMPING = 1e-10
"""Of rows of one lock that have one unit: part of the mean of their compliances."""
_REFINEMENTS = 3
_NEVER = 1e-12
"""Of its terms: a compliance that is none."""


@dataclass(frozen=True)
class Locks:
    """By t, x, u (masks last) and p, n reactions of all `rows` in all: `reactions` (n, 1), their symbols, and what they are (`found`); `response` (nx, n): x' by
    them. `held_places`, `held_speeds` (n, 1): what stays zero; `correction` (nx, 1): one Newton step there. `impulses` (n, 1): what takes
    the velocities that are not allowed. `meeting`: gaps that must be zero where something is held, then the terms that they are made of; `words` of each of these.
    """

    rows: tuple[LockRows, ...]
    reactions: ca.SX
    found: ca.SX
    response: ca.SX
    held_places: ca.SX
    held_speeds: ca.SX
    correction: ca.SX
    impulses: ca.SX
    meeting: ca.SX
    words: tuple[str, ...]

    @property
    def invariants(self) -> ca.SX:
        """All that stays zero (2 n, 1)."""
        return ca.vertcat(self.held_places, self.held_speeds)

    def places(self, k: int) -> slice:
        """Of row k among all reactions."""
        begin = sum(len(row.reactions) for row in self.rows[:k])
        return slice(begin, begin + len(self.rows[k].reactions))

    @property
    def closed_at_start(self) -> ca.SX:
        """1 for each row (rows, 1) that is held at a start."""
        return ca.vertcat(*(row.held for row in self.rows))

    def remembered(self, k: int) -> list[Discrete]:
        """What tells where row k holds, of those that hold wherever they stand by then; their places cannot be wrong at a start."""
        row = self.rows[k]
        return [d for s in ca.symvar(ca.vertcat(row.gap, row.apart)) if isinstance(d := declared(s), Discrete)]


def locks_of(rows: Sequence[LockRows], motion: Motion) -> Locks:
    """Raises `ModelError` for a gap that is not one of positions, or that its reactions do not move."""
    reactions = ca.vertcat(*(reaction.sx for row in rows for reaction in row.reactions))
    gaps, k = ca.vertcat(*(row.gap for row in rows)), ca.vertcat(*(ca.repmat(row.held, len(row.reactions), 1) for row in rows))
    _check_given(rows)
    rate = ca.densify(motion.rate(gaps))
    acceleration = motion.rate(rate)
    others = [s for s in ca.symvar(rate) if isinstance(declared(s), Reaction)]
    if others:
        raise ModelError(
            f"What {rows[0].part.where} holds moves as forces say at once: put a mass or an inertia where it acts, so that its gaps are of positions alone."
        )
    W, J = ca.densify(ca.jacobian(acceleration, reactions)), ca.densify(ca.jacobian(motion.x_dot, reactions))
    if ca.depends_on(ca.veccat(W, J), reactions):
        raise ModelError(f"Rates are not linear in the reactions of {rows[0].part.where}. Let forces be proportional to them.")
    free = ca.densify(ca.substitute(acceleration, reactions, ca.SX.zeros(reactions.numel())))
    groups = _moving(rows, W, motion)
    moving = [i for same in groups for i in same]
    k = ca.vertcat(*(entry if i in moving else ca.SX(0) for i, entry in enumerate(ca.vertsplit(k))))
    M, damping = _held(W, k), _damping(groups, W, k)
    found = undamped(M, damping, -k * free, _REFINEMENTS)
    closed, speeds = k * gaps, k * rate
    pushes = undamped(M, damping, ca.horzcat(-closed, -speeds), _REFINEMENTS)
    apart = ca.vertcat(*(ca.vertcat(row.gap, row.apart) for row in rows))
    where = ca.vertcat(*(ca.repmat(row.held, row.gap.numel() + row.apart.numel(), 1) for row in rows))
    terms = ca.vertcat(*(_of_vectors(row, rounded(ca.vertcat(row.gap, row.apart)) + row.terms) for row in rows))
    meeting = ca.vertcat(_where(where, apart), _where(where, terms))
    words = [(row.part.where, r.unit) for row in rows for r in (*row.reactions, *([row.reactions[-1]] * row.apart.numel()))]
    units = {"N": " m", "N*m": " rad"}
    return Locks(
        tuple(rows), reactions, found, J, closed, speeds, motion.closed(gaps, J, pushes), pushes[:, 1], meeting,
        tuple(f"{where}|{units.get(unit, '')}" for where, unit in words),
    )  # fmt: skip


def _of_vectors(row: LockRows, terms: ca.SX) -> ca.SX:
    """Of rows with one unit those of all: a component that is zero is rounded as the others are."""
    found = ca.SX(terms)
    for unit in dict.fromkeys(reaction.unit for reaction in row.reactions):
        same = [i for i, reaction in enumerate(row.reactions) if reaction.unit == unit]
        found[same] = ca.repmat(ca.sum1(terms[same]), len(same), 1)
    return found


def _where(held: ca.SX, values: ca.SX) -> ca.SX:
    return ca.vertcat(*(ca.if_else(k, value, 0) for k, value in zip(ca.vertsplit(held), ca.vertsplit(values), strict=True)))


def _check_given(rows: Sequence[LockRows]) -> None:
    for row in rows:
        given = [
            s for s in (declared(symbol) for symbol in ca.symvar(row.gap)) if isinstance(s, Input) and not isinstance(s, Discrete)
        ]
        if given:
            raise ModelError(
                f"What {row.part.where} holds is given by an input, {given[0].name}. Hold what is at rest, or moves by its own inertia."
            )


def _held(W: ca.SX, k: ca.SX) -> ca.SX:
    """(n, n): the compliance of what is held, and one on the diagonal of what is not."""
    return k * W * ca.repmat(k.T, k.numel(), 1) + ca.diag(1 - k)


def _moving(rows: Sequence[LockRows], W: ca.SX, motion: Motion) -> list[list[int]]:
    """Rows that are damped by the same: those of a lock that have one unit, so that it does not depend on the axes; without those that nothing moves, as the
    position of an arm that is held on its axis. Raises `ModelError` where nothing moves any row of a lock.

    What is remembered is drawn, and is no rotation then: such compliances have any sign."""
    found: list[list[int]] = []
    first = 0
    for row in rows:
        own = list(range(first, first + len(row.reactions)))
        first += len(own)
        groups: list[list[int]] = []
        for unit in dict.fromkeys(reaction.unit for reaction in row.reactions):
            same = [i for i, reaction in zip(own, row.reactions, strict=True) if reaction.unit == unit]
            mean = _mean(W, same)
            places = motion.at_places(_drawn(ca.vertcat(mean, rounded(mean))))
            if not places or any(abs(place[0, 0]) > _NEVER * place[1, 0] for place in places):
                groups.append(same)
        if not groups:
            raise ModelError(
                f"{row.part.where} holds what does not move: its frames are on one body, or on two that are at rest."
            )
        found += groups
    return found


def _mean(W: ca.SX, rows: Sequence[int]) -> ca.SX:
    return sum((W[i, i] for i in rows), ca.SX(0)) / len(rows)


def _damping(groups: Sequence[Sequence[int]], W: ca.SX, k: ca.SX) -> ca.SX:
    """(n, 1)."""
    found = ca.SX.zeros(k.numel())
    for same in groups:
        mean = _mean(W, same)
        for i in same:
            found[i] = k[i] * (_DAMPING * mean + ca.SX(mean <= 0))
    return found


def _drawn(values: ca.SX) -> ca.SX:
    """With numbers for what is remembered, which is set only when something is held."""
    free = ca.vertcat(ca.SX(0, 1), *(s for s in ca.symvar(values) if isinstance(declared(s), Discrete)))
    return ca.substitute(values, free, ca.DM(np.random.default_rng(3).uniform(0.5, 1.5, free.numel())))
