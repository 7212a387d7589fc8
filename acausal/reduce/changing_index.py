"""Modes of valves: which equations of what holds are solved, and which are solved with their rates, changes with the mode.

Values y = h + M r of what valves hold at zero follow from reactions r at once, and their rates y' = d + K r, while r stays, through the states. What holds, says y = 0; where rows of M
among these depend on one another, N M = 0, it says N h = 0 of the states alone, which their rates keep so: N y' = 0. (An inductor between two valves: while one of them
conducts, its current is that of the inductor, and the voltage of the other one is known at once; where both block, the current stays zero, and by that the voltage is known.) In each mode
two matrices take both together, P (h + M r) + Q (d + K r) = 0, which are chosen in numbers where the mode begins, so that P M + Q K is the unit matrix there. See runtime/index.h.

Which hold is told by what is so a little later: y after an implicit step of Euler's, which is y = h + M r to first order where that says anything, and goes on through states, stores and
inductors where it does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.dynamics.mode_rows import ModeRow
from acausal.errors import ModelError
from acausal.language.expression import Mode
from acausal.numerics.staged import Systems
from acausal.numerics.terms import rounded
from acausal.reduce.magnitudes import Magnitudes
from acausal.reduce.modes import Modes, Motion, masks_of


@dataclass(frozen=True)
class Index:
    """What decides a mode: `free` (n, 1) and `compliance` (n, n), by reactions, of values after an implicit step of Euler's from here, `later` [s], a mask, before the time that is given; with
    answers of `coming`. `values` M (n, n) and `rates` K (n, n): by reactions, here. `terms` (n, 1): the sizes of what h is made of."""

    free: ca.SX
    compliance: ca.SX
    values: ca.SX
    rates: ca.SX
    later: Mode
    terms: ca.SX
    coming: Systems


def changes_index(rows: Sequence[ModeRow]) -> bool:
    """Whether all that changes its mode are valves, whose values follow from reactions at once; in some modes, or where they are turned round, through states."""
    reactions = ca.vertcat(*(reaction.sx for row in rows for reaction in row.reactions))
    return any(row.turned for row in rows) or all(row.one_way and ca.depends_on(row.moved, reactions) for row in rows)


def modes_of_changing_index(rows: Sequence[ModeRow], names: Mapping[Any, str], motion: Motion) -> Modes:
    """Raises `ModelError` where something else than what goes one way changes its mode too, and for what is not linear in reactions."""
    other = next((row for row in rows if not row.one_way), None)
    if other is not None:
        raise ModelError(f"{other.part.where} stands in one scene with valves whose currents follow from inductors.")
    n = len(rows)
    reactions = ca.vertcat(*(row.reaction.sx for row in rows))
    y = ca.vertcat(*(row.moved for row in rows))
    rate, J, M = motion.rate(y), ca.densify(ca.jacobian(motion.x_dot, reactions)), ca.jacobian(y, reactions)
    K, none = ca.jacobian(rate, reactions), ca.SX.zeros(n)
    if ca.depends_on(ca.veccat(J, M, K), reactions):
        raise ModelError(
            f"What {rows[0].part.where} and others hold back is not linear in their reactions, or changes with what moves."
        )
    h, d, f = (ca.substitute(value, reactions, none) for value in (y, rate, motion.x_dot))
    own = [masks_of(row, names) for row in rows]
    holds = ca.vertcat(*(mask.holds.sx for mask in own))
    later = Mode("later", "so much later it is decided what goes on")
    values, rates = (_matrix(n, name) for name in ("by_values", "by_rates"))
    P, Q = _of_modes(values, n), _of_modes(rates, n)
    C, nx = ca.jacobian(h, motion.x), motion.x.numel()
    coming, both = Systems().with_one(
        ca.SX.ones(nx), ca.SX.eye(nx) - later.sx * ca.jacobian(f, motion.x), later.sx * ca.horzcat(f, J)
    )
    moved = C @ both
    left = Q @ h  # of states, which P says nothing of
    G = P @ M + Q @ K + ca.diag(1 - holds)
    systems, both = Systems().with_one(holds, G, -ca.horzcat(P @ h + Q @ d, left))
    found, pushes = ca.horzsplit(both)
    left_open = ca.substitute(P @ y + Q @ rate, reactions, found)  # where units are far apart
    systems, more = systems.with_one(holds, G, -holds * left_open)
    found += more
    apart = ca.substitute(y, reactions, found)
    guards = [
        (1 - holds[k]) * (apart[k] if row.turned else row.gated(apart[k], 1))
        + holds[k] * (row.gated(found[k], 1) if row.turned else found[k])
        for k, row in enumerate(rows)
    ]
    return Modes(
        tuple(rows), (*(mask.holds for mask in own), later, *values, *rates), reactions, ca.SX.zeros(n), ca.densify(h), ca.densify(M), J, found,
        ca.vertcat(*guards), ca.vertcat(ca.SX.zeros(n), left), J @ pushes, systems, None, Magnitudes((), ()), ca.SX(0, 1), Index(h + moved[:, 0], M + moved[:, 1:], ca.densify(M), ca.densify(K), later, ca.densify(rounded(h)), coming),
    )  # fmt: skip


def _matrix(n: int, name: str) -> tuple[Mode, ...]:
    return tuple(Mode(f"{name}[{i},{k}]", "of what holds, in which part") for i in range(n) for k in range(n))


def _of_modes(entries: Sequence[Mode], n: int) -> ca.SX:
    return ca.reshape(ca.vertcat(*(entry.sx for entry in entries)), n, n).T
