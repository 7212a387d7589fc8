"""Modes: which reactions hold, as masks over one set of rows, so that one system of equations serves all of them.

Each reaction r does work along the rate of its row: accelerations are affine in all of them, x' = f + J r, and so are the rows' own,
a = b + W r with W = A M^-1 A'. A mask says of each row whether it holds (a = 0), or what its reaction is instead: nothing where a one-sided
contact is open, the limit against the slip where it slides. That is one linear system in r, whose pivots are solved in a fixed order, those of one-sided rows
first: with friction that slides they are not positive where no motion exists (Painleve).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from acausal.dynamics.mode_rows import ModeRow
from acausal.errors import ModelError, OptionError
from acausal.language.equation import input_rate
from acausal.language.expression import Input, Mode, Reaction, declared
from acausal.wording import compact


@dataclass(frozen=True)
class Modes:
    """Rows of reactions and what the masks make of them, by t, x, u (masks last) and p.

    `rows`: one-sided ones first. `moved` (n, 1): gaps and slips; `rate` (n, 1): of the gaps, and slips; `free` (n, 1): accelerations of the rows without any
    reaction; `compliance` (n, n): by reactions; `response` (nx, n): x' by reactions. `sliding`, `holding` (frictions, 1): limits, by
    `reactions` (n, 1) symbols; `found` (n, 1): the reactions. `guards`: positive as long as the masks are right, one for each one-sided row and two for each
    friction. `correction` (nx, 1): one Newton step to what is held.
    """

    rows: tuple[ModeRow, ...]
    masks: tuple[Mode, ...]
    reactions: ca.SX
    rate: ca.SX
    free: ca.SX
    compliance: ca.SX
    response: ca.SX
    found: ca.SX
    guards: ca.SX
    invariants: ca.SX
    correction: ca.SX

    @property
    def one_sided(self) -> int:
        """How many rows may open."""
        return sum(row.one_sided for row in self.rows)

    @property
    def held_places(self) -> ca.SX:
        """Of the invariants, gaps that are closed (one_sided, 1)."""
        return self.invariants[: self.one_sided, :]

    @property
    def held_speeds(self) -> ca.SX:
        """Of the invariants, rates of what is closed, and slips that stick (n, 1)."""
        return self.invariants[self.one_sided :, :]

    @property
    def frictions(self) -> tuple[ModeRow, ...]:
        """Rows of friction."""
        return self.rows[self.one_sided :]

    @property
    def moved(self) -> ca.SX:
        """Gaps and slips."""
        return ca.vertcat(*(row.gated(row.gap, 1) for row in self.rows))


def refuse_modes(rows: Sequence[ModeRow], what: str) -> None:
    """Raises `OptionError` where there are any, since `what` is not known to do with them yet."""
    if rows:
        raise OptionError(
            f"{what} does not go with parts that open, slip or strike yet: {compact(dict.fromkeys(row.part.path for row in rows), 4)}."
        )


def masks_of(rows: Sequence[ModeRow], names: dict[object, str]) -> tuple[Mode, ...]:
    """One for each one-sided row: 1 where it is closed, else 0. Two for each friction: 1 where it sticks, else 0; and the sign of the slip where
    it slides, else 0."""
    found: list[Mode] = []
    for row in rows:
        name = names[row.reaction]
        if row.one_sided:
            found.append(Mode(f"{name}.closed", "1 where it is closed, else 0"))
        else:
            found.append(Mode(f"{name}.sticks", "1 where it sticks, else 0"))
            found.append(Mode(f"{name}.slides", "sign of the slip where it slides, else 0"))
    return tuple(found)


def modes_of(rows: Sequence[ModeRow], masks: Sequence[Mode], t: ca.SX, x: ca.SX, x_dot: ca.SX, nq: int) -> Modes:
    """Of a system with rates x_dot, by reactions that are inputs; its first nq states are positions. Where rows depend on inputs these have rates, and
    what holds is followed by these, and not among the invariants. Raises `ModelError` for a gap that is not one of positions, and reactions that the
    rates do not depend on as they should.
    """
    reactions = ca.vertcat(*(row.reaction.sx for row in rows))
    n, n1 = len(rows), sum(row.one_sided for row in rows)
    rates: list[ca.SX] = []
    at_once = [row.one_way and bool(ca.depends_on(row.moved, reactions)) for row in rows]
    for row, algebraic in zip(rows, at_once, strict=True):
        rate = ca.SX(0) if algebraic else row.moved if row.one_way or not row.one_sided else _rate(row.moved, t, x, x_dot)
        if not algebraic and ca.depends_on(row.moved, reactions):
            what = "gap" if row.one_sided else "slip"
            raise ModelError(
                f"The {what} of {row.part.where} follows from forces: nothing with inertia moves with it. Put a mass or an inertia where it acts."
            )
        if ca.depends_on(rate, reactions):
            raise ModelError(
                f"The gap of {row.part.where} is no expression of positions and time alone: its rate follows from forces."
            )
        rates.append(rate)
    rate = ca.densify(ca.vertcat(*rates))
    none = ca.SX.zeros(n)
    accelerations = ca.vertsplit(_rate(rate, t, x, x_dot))
    acceleration = ca.densify(ca.vertcat(*(rows[i].moved if at_once[i] else accelerations[i] for i in range(n))))
    W, J = ca.densify(ca.jacobian(acceleration, reactions)), ca.densify(ca.jacobian(x_dot, reactions))
    if ca.depends_on(ca.veccat(W, J), reactions):
        k = next(k for k in range(n) if ca.depends_on(ca.veccat(W[:, k], J[:, k]), reactions))
        raise ModelError(f"Rates are not linear in the reaction of {rows[k].part.where}. Let forces be proportional to it.")
    free = ca.substitute(acceleration, reactions, none)
    closed = [mask.sx for mask in masks[:n1]]
    sticks = [masks[n1 + 2 * k].sx for k in range(n - n1)]
    slides = [masks[n1 + 2 * k + 1].sx for k in range(n - n1)]
    holds = [*closed, *sticks]
    M, right = ca.SX.zeros(n, n), ca.SX.zeros(n)
    for i, row in enumerate(rows):
        M[i, :] = holds[i] * W[i, :]
        M[i, i] += (1 - holds[i]) * W[i, i]
        right[i] = -holds[i] * free[i]
        if row.sliding is not None:
            by, limit = ca.jacobian(row.sliding, reactions), ca.substitute(row.sliding, reactions, none)
            share = (1 - holds[i]) * W[i, i] * slides[i - n1]
            M[i, :] += share * by
            right[i] -= share * limit
    found = _solved(M, right)
    limits = [ca.substitute(row.holding, reactions, found) for row in rows[n1:] if row.holding is not None]
    apart = [row.gated(ca.substitute(row.moved, reactions, found), 1) if row.one_way else row.moved for row in rows[:n1]]
    guards = [(1 - closed[i]) * apart[i] + closed[i] * found[i] for i in range(n1)]
    for k in range(n - n1):
        force, away = found[n1 + k], slides[k] * rate[n1 + k] - (1 - slides[k] ** 2) * limits[k]
        guards.append(sticks[k] * (limits[k] - force) + (1 - sticks[k]) * away)
        guards.append(sticks[k] * (limits[k] + force) + (1 - sticks[k]) * (slides[k] ** 2 * (limits[k] - 1) + 1))
    K = ca.SX.zeros(n, n)
    for i in range(n):
        for j in range(n):
            both = 0 if i != j and (at_once[i] or at_once[j]) else holds[i] * holds[j]
            K[i, j] = both * W[i, j] + ((1 - holds[i]) * W[i, i] if i == j else 0)
    steady = [not _inputs_in(ca.vertcat(row.gap, rate[i])) for i, row in enumerate(rows)]
    gaps = ca.vertcat(*(steady[i] * closed[i] * rows[i].gap for i in range(n1)), ca.SX.zeros(n - n1))
    speeds = ca.vertcat(*(steady[i] * holds[i] * rate[i] for i in range(n)))
    pushes = _solved(K, ca.horzcat(-gaps, -speeds))
    along = ca.jacobian(x_dot, x) @ J
    places = _positions(ca.vertcat(*(row.gap for row in rows[:n1])), J, x, nq)
    moved = ca.SX.zeros(x.numel())
    if places:
        moved[places] = (along @ pushes[:, 0])[places]
    return Modes(
        tuple(rows), tuple(masks), reactions, rate, ca.densify(free), W, J, found, ca.vertcat(*guards), ca.vertcat(gaps[:n1, :], speeds), moved + J @ pushes[:, 1],
    )  # fmt: skip


def _positions(gaps: ca.SX, J: ca.SX, x: ca.SX, nq: int) -> list[int]:
    """Which states are positions that gaps may be closed by: coordinates, and scalar states in the gaps; their rates do not know the reactions."""
    in_gaps = set(ca.jacobian(gaps, x).sparsity().get_col()) if gaps.numel() else set[int]()
    return [i for i in range(x.numel()) if (i < nq or i in in_gaps) and J[i, :].is_zero()]


def check_compliance(modes: Modes, values: np.ndarray) -> None:
    """Raises `ModelError` for a reaction that moves nothing it is held by; `values`: of the diagonal of the compliance somewhere."""
    for row, value in zip(modes.rows, values, strict=True):
        if not value > 0:
            raise ModelError(
                f"{row.part.where} holds what its reaction does not move, or drives it the wrong way ({value:.3g} per unit of the reaction, not positive). "
                "The reaction must push towards a larger gap, or along the slip."
            )


def _rate(value: ca.SX, t: ca.SX, x: ca.SX, x_dot: ca.SX) -> ca.SX:
    own = (ca.jtimes(value, entry.sx, input_rate(entry).sx) for entry in _inputs_in(value))
    return sum(own, ca.jtimes(value, t, ca.SX(1)) + ca.jtimes(value, x, x_dot))


def _inputs_in(value: ca.SX) -> list[Input]:
    """What is given from outside, whose rates are then given too."""
    found = dict.fromkeys(declared(symbol) for symbol in ca.symvar(value))
    return [entry for entry in found if isinstance(entry, Input) and not isinstance(entry, Mode | Reaction)]


def _solved(A: ca.SX, B: ca.SX) -> ca.SX:
    """A^-1 B (n, m) by elimination in the order of the rows."""
    A, B = ca.SX(A), ca.densify(ca.SX(B))
    n = A.shape[0]
    for k in range(n):
        for i in range(k + 1, n):
            if A[i, k].is_zero():
                continue
            factor = A[i, k] / A[k, k]
            A[i, k + 1 :] -= factor * A[k, k + 1 :]
            B[i, :] -= factor * B[k, :]
    for k in reversed(range(n)):
        B[k, :] = (B[k, :] - A[k, k + 1 :] @ B[k + 1 :, :]) / A[k, k]
    return ca.densify(B)
