"""Modes of valves: which equations of what holds are solved, and which are solved with their rates, changes with the mode.

Values y = h + M r of what valves hold at zero follow from reactions r at once, and their rates y' = d + K r, while r stays, through the states. What holds, says y = 0; where rows of M
among these depend on one another, N M = 0, it says N h = 0 of the states alone, which their rates keep so: N y' = 0. (An inductor between two valves: while one of them
conducts, its current is that of the inductor, and the voltage of the other one is known at once; where both block, the current stays zero, and by that the voltage is known.) In each mode
two matrices take both together, P (h + M r) + Q (d + K r) = 0, which are chosen in numbers where the mode begins, so that P M + Q K is the unit matrix there. See runtime/index.h.

Which hold is told by what is so a little later: y after an implicit step of Euler's, which is y = h + M r to first order where that says anything, and goes on through states, stores and
inductors where it does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from acausal.dynamics.mode_rows import ModeRow
from acausal.errors import ModelError
from acausal.language.expression import Mode
from acausal.numerics.entries import entries
from acausal.numerics.staged import Systems
from acausal.numerics.terms import rounded
from acausal.numerics.vanishing import Vanishing, vanishing
from acausal.reduce.motion import Motion


@dataclass(frozen=True)
class Index:
    """What decides a mode of v valves among n reactions: `free` (v, 1) and `compliance` (v, n), by reactions, of values after an implicit step of Euler's from here, `later` [s], a mask, before the
    time that is given. `values` M (v, v) and `rates` K (v, v): by their reactions, here. `terms` (v, 1): the sizes of what h is made of. `solved` (v, 1): reactions of valves in a mode, by those of
    others. With answers of `systems`."""

    free: ca.SX
    compliance: ca.SX
    values: ca.SX
    rates: ca.SX
    later: Mode
    terms: ca.SX
    solved: ca.SX
    systems: Systems


@dataclass(frozen=True)
class Valves:
    """v rows, the first ones of n `reactions`: values y (v, 1) and their rates, by reactions, and without any, h and d; `values` M and `rates` K (v, n) by them. `holds` (v, 1): masks."""

    rows: tuple[ModeRow, ...]
    motion: Motion
    reactions: ca.SX
    holds: ca.SX
    y: ca.SX
    y_dot: ca.SX
    h: ca.SX
    d: ca.SX
    values: ca.SX
    rates: ca.SX
    later: Mode
    by_values: tuple[Mode, ...]
    by_rates: tuple[Mode, ...]

    @staticmethod
    def of(rows: Sequence[ModeRow], motion: Motion, reactions: ca.SX, holds: ca.SX) -> Valves:
        """Raises `ModelError` for what is not linear in reactions."""
        moved, v = ca.vertcat(ca.SX(0, 1), *(row.moved for row in rows)), len(rows)
        (y, h, M), (rate, d, K) = (_by_reactions(value, reactions, motion.x) for value in (moved, motion.rate(moved)))
        if ca.depends_on(ca.veccat(M, K), reactions):
            raise ModelError(
                f"What {rows[0].part.where} and others hold back is not linear in their reactions, or changes with what moves."
            )
        later = Mode("later", "so much later it is decided what goes on")
        return Valves(
            tuple(rows), motion, reactions, holds, y, rate, h, d, M, K, later, _matrix(v, "by_values"), _matrix(v, "by_rates")
        )

    @property
    def masks(self) -> tuple[Mode, ...]:
        """But for `holds`."""
        return (self.later, *self.by_values, *self.by_rates) if self.rows else ()

    @property
    def P(self) -> ca.SX:
        """(v, v), by values."""
        return _of_modes(self.by_values, len(self.rows))

    @property
    def Q(self) -> ca.SX:
        """(v, v), by rates."""
        return _of_modes(self.by_rates, len(self.rows))

    @property
    def matrix(self) -> ca.SX:
        """(v, n): what holds, and what does not, by reactions."""
        found = self.P @ self.values + self.Q @ self.rates
        for i in range(len(self.rows)):
            found[i, i] += 1 - self.holds[i]
        return found

    @property
    def right(self) -> ca.SX:
        """(v, 1): the other side."""
        return -(self.P @ self.h + self.Q @ self.d)

    @property
    def left(self) -> ca.SX:
        """(v, 1): what holds of states, which `by_values` say nothing of."""
        return self.Q @ self.h

    def open_by(self, found: ca.SX) -> ca.SX:
        """(v, 1): what these reactions (n, 1) leave open, where units are far apart."""
        return self.holds * self._by(self.P @ self.y + self.Q @ self.y_dot, found)

    def _by(self, value: ca.SX, found: ca.SX) -> ca.SX:
        return ca.substitute(value, self.reactions, ca.densify(found))

    def guards(self, found: ca.SX) -> list[ca.SX]:
        """By these reactions (n, 1)."""
        apart = self._by(self.y, found)
        return [
            (1 - self.holds[k]) * (apart[k] if row.turned else row.gated(apart[k], 1))
            + self.holds[k] * (row.gated(found[k], 1) if row.turned else found[k])
            for k, row in enumerate(self.rows)
        ]

    def index(self, J: ca.SX) -> Index | None:
        """What modes are decided by, with x' = J r by reactions; None where there is no valve."""
        if not self.rows:
            return None
        v, nx, later = len(self.rows), self.motion.x.numel(), self.later.sx
        f = ca.substitute(self.motion.x_dot, self.reactions, ca.SX.zeros(self.reactions.numel()))
        systems, both = Systems().with_one(
            ca.SX.ones(nx), ca.SX.eye(nx) - later * ca.jacobian(f, self.motion.x), later * ca.horzcat(f, J)
        )
        moved = ca.jacobian(self.h, self.motion.x) @ both
        others, G = self.reactions[v:, :], self.matrix
        systems, by = systems.with_one(self.holds, G[:, :v], ca.horzcat(self.right, -G[:, v:]))
        open_ = self.open_by(ca.vertcat(by[:, 0], ca.SX.zeros(others.shape)))
        systems, more = systems.with_one(self.holds, G[:, :v], -open_)
        return Index(
            self.h + moved[:, 0], self.values + moved[:, 1:], ca.densify(self.values[:, :v]), ca.densify(self.rates[:, :v]), self.later,
            ca.densify(_sizes(self.h, self.motion.x)), ca.densify(by[:, 0] + more + by[:, 1:] @ others), systems,
        )  # fmt: skip


def valves_among(rows: Sequence[ModeRow]) -> list[ModeRow]:
    """Those whose values follow from reactions at once, and where some are turned round, all that might be: in some modes they follow through states."""
    reactions = ca.vertcat(ca.SX(0, 1), *(reaction.sx for row in rows for reaction in row.reactions))
    turned = any(row.turned for row in rows)
    return [row for row in rows if row.one_way and (ca.depends_on(row.moved, reactions) or (turned and row.turns))]


def _sizes(h: ca.SX, x: ca.SX) -> ca.SX:
    """(v, 1): the sizes of what h (v, 1) is made of. Where systems of parameters have been solved for it, what relative changes of all symbols make of it: carried through each
    operation of these, sizes grow beyond all that rounding does, since its parts there belong together.
    """
    if not ca.symvar(ca.jacobian(h, x)):
        return rounded(h)
    symbols = ca.vertcat(*ca.symvar(h))
    return ca.fabs(h) + ca.fabs(ca.jacobian(h, symbols)) @ ca.fabs(symbols)


def _by_reactions(value: ca.SX, reactions: ca.SX, x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """A value (v, 1), what it is without reactions, and its slopes (v, n) by them. Where systems of parameters have been solved for it, written as the linear function of states
    and reactions that it is: then what rounding makes of voltages is not in currents that have nothing to do with these.
    """
    slopes = _without_nothing(ca.jacobian(value, reactions))
    alone = ca.substitute(value, reactions, ca.SX.zeros(reactions.numel()))
    of_states = ca.jacobian(alone, x)
    if ca.depends_on(of_states, x) or not ca.symvar(ca.veccat(slopes, of_states)):
        return value, alone, slopes
    rest = _without_nothing(ca.substitute(alone, x, ca.SX.zeros(x.numel())))
    alone = ca.densify(rest + _without_nothing(of_states) @ x)
    return alone + slopes @ reactions, alone, slopes


def _without_nothing(A: ca.SX) -> ca.SX:
    """Without the entries that are zero whatever their symbols are: what rounding makes of these were taken for what decides."""
    found = entries([A])
    for k, answer in enumerate(vanishing(found)):
        if answer is Vanishing.YES:
            found[k] = 0
    return ca.SX(A.sparsity(), found)


def _matrix(n: int, name: str) -> tuple[Mode, ...]:
    return tuple(Mode(f"{name}[{i},{k}]", "of what holds, in which part") for i in range(n) for k in range(n))


def _of_modes(entries: Sequence[Mode], n: int) -> ca.SX:
    return ca.reshape(ca.vertcat(ca.SX(0, 1), *(entry.sx for entry in entries)), n, n).T
