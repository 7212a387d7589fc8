"""Modes: which reactions hold, as masks over one set of rows, so that one system of equations serves all of them.

Each reaction r does work along the rate of its row: accelerations are affine in all of them, x' = f + J r, and so are the rows' own,
a = b + W r with W = A M^-1 A'. A mask says of each row whether it holds (a = 0), or what its reaction is instead: nothing where a one-sided
contact is open, the limit against the slip where it slides. That is one linear system in r, whose pivots are solved in a fixed order, those of one-sided rows
first: with friction that slides they are not positive where no motion exists (Painleve).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.dynamics.mode_rows import LockRows, ModeRow, Size
from acausal.errors import ModelError, OptionError
from acausal.language.expression import Magnitude, Mode
from acausal.numerics import patches
from acausal.numerics.staged import Systems
from acausal.numerics.terms import rounded
from acausal.numerics.thresholds import ROUNDING
from acausal.reduce.changing_index import Index, Valves, valves_among
from acausal.reduce.magnitudes import Magnitudes
from acausal.reduce.motion import Motion, inputs_in
from acausal.wording import compact

DAMPING = 1e-6
"""Of rows that depend on one another, in units of the least of the other pivots, as `runtime/modes.h` has it."""


@dataclass(frozen=True)
class Modes:
    """Rows of reactions and what the masks make of them, by t, x, u (masks last) and p; n reactions in all.

    `rows`: laws, valves first, then others that are one-sided, then friction in one direction, then in two, then of patches. `rate` (n, 1): of gaps, and slips; `free` (n, 1): accelerations of the rows
    without any reaction; `compliance` (n, n): by reactions; `response` (nx, n): x' by reactions. `solved` (n, 1): the reactions, whose symbols are `reactions`; `dead`: those of others, which are zero. `guards`:
    positive as long as the masks are right, one for each one-sided row, and two for each friction and each of the `magnitudes`. `correction` (nx, 1): one Newton step to
    what is held. All three hold answers of `systems`. `redundant`: whether rows may depend on one another; then the last masks are `_Shared`, but for what parts remember.
    """

    rows: tuple[ModeRow, ...]
    masks: tuple[Mode, ...]
    reactions: ca.SX
    rate: ca.SX
    free: ca.SX
    compliance: ca.SX
    response: ca.SX
    solved: ca.SX
    guards: ca.SX
    invariants: ca.SX
    correction: ca.SX
    systems: Systems
    damping: Mode | None
    magnitudes: Magnitudes
    dead: ca.SX
    valves: int = 0
    index: Index | None = None
    """Of `valves`, the first rows, see changing_index.py."""

    @property
    def symbols(self) -> ca.SX:
        """Of all reactions, then those that are zero at all times."""
        return ca.vertcat(self.reactions, self.dead)

    def with_dead(self, values: ca.SX) -> ca.SX:
        """Values (n, 1) of the reactions, as those of `symbols`."""
        return ca.vertcat(ca.densify(values), ca.SX.zeros(self.dead.numel()))

    def with_answers(self, value: ca.SX) -> ca.SX:
        """An expression of the scene in which reactions are symbols still, with answers of `systems` for them."""
        return ca.substitute(value, self.symbols, self.with_dead(self.solved))

    @functools.cached_property
    def found(self) -> ca.SX:
        """The reactions (n, 1), without systems that are to be solved."""
        return self.systems.unrolled(self.solved)

    @functools.cached_property
    def needed(self) -> tuple[tuple[int, ...], ...]:
        """Of each law, numbers of the one-sided ones without whose reactions its limit is zero."""
        none = ca.SX.zeros(self.reactions.numel())
        found: list[tuple[int, ...]] = []
        for row in self.rows:
            limit = row.sliding
            if limit is None or not ca.substitute(limit, self.reactions, none).is_zero():
                found.append(())
            else:
                found.append(
                    tuple(k for k, one in enumerate(self.rows) if one.one_sided and ca.depends_on(limit, one.reaction.sx))
                )
        return tuple(found)

    @property
    def damped(self) -> int | None:
        """The place among the masks of the damping of rows that depend on one another; None where none do."""
        return None if self.damping is None else self.masks.index(self.damping)

    @property
    def redundant(self) -> bool:
        """Whether some rows may depend on one another."""
        return self.damping is not None

    @property
    def one_sided(self) -> int:
        """How many rows may open."""
        return sum(row.one_sided for row in self.rows)

    @property
    def held_places(self) -> ca.SX:
        """Of the invariants, gaps that are closed (one_sided, 1)."""
        return self.invariants[: self.one_sided, :]

    @property
    def followed(self) -> dict[str, ca.SX]:
        """Gaps that are closed, which are kept so by their rates alone, since inputs move them; by what has them."""
        return {
            f"the gap of {row.part.where}": mask.sx * row.gap
            for row, mask in zip(self.rows[: self.one_sided], self.masks, strict=False)
            if inputs_in(row.gap)
        }

    @property
    def held_speeds(self) -> ca.SX:
        """Of the invariants, rates of what is closed, and slips that stick (n, 1)."""
        return self.invariants[self.one_sided :, :]

    @property
    def frictions(self) -> tuple[ModeRow, ...]:
        """Laws of friction."""
        return self.rows[self.one_sided :]

    @property
    def gaps(self) -> ca.SX:
        """Of the one-sided rows (one_sided, 1)."""
        return ca.vertcat(ca.SX(0, 1), *(row.gated(row.gap, 2 if row.turned else 1) for row in self.rows if row.one_sided))


def refuse_modes(rows: Sequence[ModeRow | LockRows], what: str) -> None:
    """Raises `OptionError` where there are any, since `what` is not known to do with them yet."""
    if rows:
        raise OptionError(
            f"{what} does not go with parts that open, slip, strike or are let go yet: {compact(dict.fromkeys(row.part.path for row in rows), 4)}."
        )


@dataclass(frozen=True)
class _Masks:
    """Of one law. `holds`: 1 where its rows hold. Of friction: `slides` 1 where the force is against the slip, `frozen` 1 where it is against `along` (size), near
    slip zero; `threshold`: of the slip, between these. Of a patch `faster`: 1 where it slides faster than its edge turns, -1 where slower, 0 where it is not looked at."""

    holds: Mode
    slides: Mode | None = None
    frozen: Mode | None = None
    threshold: Mode | None = None
    along: tuple[Mode, ...] = ()
    faster: Mode | None = None

    @property
    def all(self) -> tuple[Mode, ...]:
        """In the order of the inputs."""
        given = (self.holds, self.slides, self.frozen, self.threshold)
        return (*(mask for mask in given if mask is not None), *self.along, *(() if self.faster is None else (self.faster,)))


def masks_of(row: ModeRow, names: Mapping[Any, str]) -> _Masks:
    """Those of one law."""
    name = names[row.reactions[0]].removesuffix("[0]")
    if row.one_sided:
        word = "open" if row.turned else "closed"
        return _Masks(Mode(f"{name}.{word}", f"1 where it is {word}, else 0"))
    sticks = Mode(f"{name}.sticks", "1 where it sticks, else 0")
    if row.size == 1:
        return _Masks(sticks, along=(Mode(f"{name}.slides", "sign of the slip where it slides, else 0"),))
    along = tuple(Mode(f"{name}.along[{k}]", "direction of the slip while that is not clear of zero") for k in range(row.size))
    return _Masks(
        sticks, Mode(f"{name}.slides", "1 where it slides, else 0"), Mode(f"{name}.starts", "1 where its direction is held, else 0"),
        Mode(f"{name}.threshold", "slip below which its direction is held"), along,
        None if row.pressure is None else Mode(f"{name}.faster", "which of slip and spin is faster, 1 or -1, or 0"),
    )  # fmt: skip


@dataclass(frozen=True)
class _Shared:
    """Of rows that depend on one another. `damping`: of them. Reactions are those nearest to what is carried on: so much at the time `since`, and its rates."""

    damping: Mode
    since: Mode
    reactions: tuple[Mode, ...]
    rates: tuple[Mode, ...]

    @staticmethod
    def among(count: int) -> _Shared:
        """So many reactions."""
        damping, since = Mode("damping", "of reactions that are not unique"), Mode("carried.since", "since when")
        carried = tuple(Mode(f"carried[{k}]", "reaction that others are nearest to, at that time") for k in range(count))
        return _Shared(damping, since, carried, tuple(Mode(f"carried.rate[{k}]", "its rate") for k in range(count)))

    @property
    def all(self) -> tuple[Mode, ...]:
        """In the order of the inputs."""
        return (self.damping, self.since, *self.reactions, *self.rates)

    def at(self, t: ca.SX) -> ca.SX:
        """(n, 1)."""
        return ca.vertcat(*(a.sx + b.sx * (t - self.since.sx) for a, b in zip(self.reactions, self.rates, strict=True)))


def modes_of(rows: Sequence[ModeRow], names: Mapping[Any, str], motion: Motion) -> tuple[Modes | None, ca.SX]:
    """Modes, None where no reaction moves anything; and reactions (n, 1) that are zero at all times, since nothing can move there.

    Where rows depend on inputs these have rates, and what holds is followed by these, and not among the invariants; nor is what may jump. Raises `ModelError` for a gap that is
    not one of positions, and reactions that the rates do not depend on as they should.
    """
    valves = valves_among(rows)
    rows, unmoving = _living([row for row in rows if row not in valves], valves, motion)
    motion, dead = motion.without(unmoving), ca.vertcat(ca.SX(0, 1), *unmoving)
    rows = [row.put([dead], [ca.SX.zeros(len(unmoving))]) for row in rows] if unmoving else rows
    rows = [*valves, *rows]
    if not rows:
        return None, dead
    reactions = ca.vertcat(*(reaction.sx for row in rows for reaction in row.reactions))
    masks, v = [masks_of(row, names) for row in rows], len(valves)
    own = Valves.of(valves, motion, reactions, ca.vertcat(ca.SX(0, 1), *(mask.holds.sx for mask in masks[:v])))
    moves = _Moves.of(rows[v:], motion, reactions)
    J = ca.jacobian(motion.x_dot, reactions)
    rate, W = ca.vertcat(ca.SX.zeros(v), moves.rate), ca.vertcat(own.values, moves.compliance(motion, J))
    owner = [row for row in rows for _ in row.reactions]
    for k, row in enumerate(owner):
        if ca.depends_on(ca.veccat(W[:, k], J[:, k]), reactions):
            raise ModelError(f"Rates are not linear in the reaction of {row.part.where}. Let forces be proportional to it.")
    free = ca.vertcat(ca.densify(own.h), ca.densify(ca.substitute(moves.acceleration, reactions, ca.SX.zeros(len(owner)))))
    redundant = any(_may_depend(found) for found in motion.at_places(W[v:, v:]))
    shared = _Shared.among(len(owner)) if redundant else None
    magnitudes = _magnitudes(rows, names, reactions)
    system = _Masked(rows, masks, reactions, W, None if shared is None else shared.damping.sx, own, magnitudes)
    carried = ca.SX.zeros(len(owner)) if shared is None else shared.at(motion.t)
    values, guards = system.found(free, rate, carried)
    closed = [
        holds * row.gap if row.one_sided and not (inputs_in(row.gap) or motion.may_jump(row.gap)) else ca.SX.zeros(row.size)
        for row, holds in zip(rows, system.by_law, strict=True)
    ]
    speeds = [
        ca.SX(0) if inputs_in(ca.vertcat(row.moved, part)) or motion.may_jump(part) else holds * part
        for row, holds, part in zip(owner[v:], system.holds[v:], ca.vertsplit(rate)[v:], strict=True)
    ]
    gaps, speeds = ca.vertcat(ca.SX(0, 1), *(row.gap for row in rows if row.one_sided)), ca.vertcat(own.left, *speeds)
    pushes = system.solved(system.held, ca.horzcat(-ca.vertcat(*closed), -speeds), ca.vertcat(*system.holds))
    everything = [
        *(mask for one in masks for mask in one.all), *magnitudes.masks, *own.masks, *(() if shared is None else shared.all)
    ]  # fmt: skip
    invariants = ca.vertcat(ca.vertcat(*closed)[: gaps.numel(), :], speeds)
    found = Modes(
        tuple(rows), tuple(everything), reactions, rate, free, ca.densify(W), ca.densify(J), values, guards, invariants, motion.closed(gaps, J, pushes), system.systems,
        None if shared is None else shared.damping, magnitudes, dead, v, own.index(J),
    )  # fmt: skip
    return found, dead


def _magnitudes(rows: Sequence[ModeRow], names: Mapping[Any, str], reactions: ca.SX) -> Magnitudes:
    """Those that limits depend on. Raises `ModelError` where something is not linear in what it should be."""
    sizes: dict[Magnitude, Size] = {}
    along: list[tuple[Mode, ...]] = []
    for row in rows:
        name = names[row.reactions[0]].removesuffix("[0]")
        for size in row.sizes:
            if size.symbol in sizes:
                continue
            if ca.depends_on(ca.densify(ca.jacobian(size.of, reactions)), reactions):
                raise ModelError(
                    f"What presses at {row.part.where} is not linear in reactions. Let its Magnitude be that of a force or a torque."
                )
            sizes[size.symbol] = size
            along.append(tuple(Mode(f"{name}.pressed[{k}]", "direction that a force is along") for k in range(3)))
    found = Magnitudes(tuple(sizes.values()), tuple(along))
    unknown = ca.vertcat(reactions, found.symbols)
    for row in rows:
        for limit in (row.sliding, row.holding):
            if limit is not None and ca.depends_on(ca.densify(ca.jacobian(limit, unknown)), unknown):
                raise ModelError(
                    f"The limit of {row.part.where} is not linear in reactions and magnitudes. Let them be factors: mu * self.push."
                )
    return found


@dataclass(frozen=True)
class _Moves:
    """Of rows (n, 1): `rate`, of gaps, and slips; `acceleration`, by reactions."""

    rate: ca.SX
    acceleration: ca.SX

    def compliance(self, motion: Motion, J: ca.SX) -> ca.SX:
        """(n, m): accelerations by m reactions, with x' = J reactions: what rates see of x', since few states move what touches."""
        return ca.densify(ca.jacobian(self.rate, motion.x) @ J)

    @staticmethod
    def of(rows: Sequence[ModeRow], motion: Motion, reactions: ca.SX) -> _Moves:
        """Raises `ModelError` for a gap that is not one of positions."""
        rates: list[ca.SX] = []
        for row in rows:
            if ca.depends_on(row.moved, reactions):
                what = "gap" if row.one_sided else "slip"
                raise ModelError(
                    f"The {what} of {row.part.where} follows from forces: nothing with inertia moves with it. Put a mass or an inertia where it acts."
                )
            rate = row.moved if row.one_way or not row.one_sided else motion.rate(row.moved)
            if ca.depends_on(rate, reactions):
                raise ModelError(
                    f"The gap of {row.part.where} is no expression of positions and time alone: its rate follows from forces."
                )
            rates.append(rate)
        rate = ca.densify(ca.vertcat(ca.SX(0, 1), *rates))
        return _Moves(rate, ca.densify(ca.vertcat(ca.SX(0, 1), *map(motion.rate, rates))))


def _slips(row: ModeRow, motion: Motion) -> bool:
    """Whether what states say of a slip is more than rounding."""
    slip = ca.vec(row.moved)
    places = motion.at_places(ca.horzcat(slip, rounded(slip))) if ca.depends_on(slip, motion.x) else []
    return any(bool(np.any(np.abs(found[:, 0]) > ROUNDING * found[:, 1])) for found in places)


def _living(rows: Sequence[ModeRow], valves: Sequence[ModeRow], motion: Motion) -> tuple[list[ModeRow], list[ca.SX]]:
    """Laws without what never moves, such as the slip across a rail; and the reactions that are zero then. Raises `ModelError` for a reaction that moves nothing it is
    held by, or drives it the wrong way."""
    reactions = [reaction.sx for row in rows for reaction in row.reactions]
    everything = ca.vertcat(ca.SX(0, 1), *reactions, *(row.reaction.sx for row in valves))
    acceleration = _Moves.of(rows, motion, everything).acceleration
    places = motion.at_places(ca.diag(ca.jacobian(acceleration, ca.vertcat(ca.SX(0, 1), *reactions))))
    size = np.max(np.abs(places), axis=0).ravel() if places else np.ones(len(reactions))
    kept: list[ModeRow] = []
    dead: list[ca.SX] = []
    first = 0
    for row in rows:
        own = slice(first, first + row.size)
        first += row.size
        worst = min((np.min(found[own]) for found in places), default=0.0)
        moves = size[own] > _NEVER * np.max(size[own]) if np.max(size[own]) > 0 else np.zeros(row.size, dtype=bool)
        if row.one_sided and not moves.any() and not worst < 0:
            hint = "Both its ends may be on one body, or on what other parts hold or move as prescribed: let one of them be free, or leave it out."
            raise ModelError(
                f"The reaction of {row.part.where} moves nothing that it holds. {row.part.component.if_undecided or hint}"
            )
        if worst < -_NEVER * np.max(size[own]) or (row.one_sided and not moves.any()):
            raise ModelError(
                f"The reaction of {row.part.where} drives what it holds the wrong way ({worst:.3g} per unit of the reaction, not positive). "
                "The reaction must push towards a larger gap, or along the slip."
            )
        if not moves.any() and _slips(row, motion):
            raise ModelError(
                f"What slips in {row.part.where} is not moved by its reaction: {row.moved}. Give a velocity, whose product with the reaction is power, of something "
                "that is free to move."
            )
        living = np.flatnonzero(moves).tolist()
        row = row if len(living) in (0, row.size) else _without_parts(row, living)
        dead += [row.reactions[k].sx for k in range(row.size) if k not in living]
        if living:
            kept.append(replace(row, reactions=tuple(row.reactions[k] for k in living), moved=row.moved[living]))
    return sorted(kept, key=lambda row: (not row.one_sided, row.size)), dead


def _without_parts(row: ModeRow, living: Sequence[int]) -> ModeRow:
    """A friction of which only these rows live. Raises `ModelError` where a patch slides one way only, and spins."""
    if row.pressure is None or row.sliding is None or row.holding is None:
        return row
    if living == [2]:
        part = patches.spinning(row.pressure)
        return replace(row, pressure=None, sliding=part * row.sliding, holding=part * row.holding)
    if 2 in living:
        raise ModelError(
            f"The patch of {row.part.where} can slide one way only, and spin: that is not there yet. Let it slide in a plane, or hold its spin."
        )
    return replace(row, pressure=None)


@dataclass
class _Masked:
    """One linear system for all modes. `damping`: of rows that depend on one another, None where none do. `valves`: the first rows. `systems`: what is to be solved so far."""

    rows: Sequence[ModeRow]
    masks: Sequence[_Masks]
    reactions: ca.SX
    compliance: ca.SX
    damping: ca.SX | None
    valves: Valves
    magnitudes: Magnitudes
    systems: Systems = field(default_factory=Systems)

    def found(self, free: ca.SX, rate: ca.SX, carried: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The reactions (n, 1), and guards, see `Modes`; nearest to what is `carried` on, where they are not unique."""
        symbols, M = self.magnitudes.symbols, self.matrix(rate)
        by = self.solved(M, ca.horzcat(self.right(free, rate) - M @ carried, self.by_magnitudes(rate)), self.active)
        given, more = carried + by[:, 0], by[:, 1:]
        if self.valves.rows:
            given -= self.solved(
                M, ca.vertcat(self.valves.open_by(given), ca.SX.zeros(given.numel() - len(self.valves.rows))), self.active
            )
        if not symbols.numel():
            return given, self.guards(given, rate, symbols)
        slopes = [ca.jacobian(size.of, self.reactions) @ more for size in self.magnitudes.sizes]
        first = self.magnitudes.components(self.reactions, given)
        s = self.magnitudes.solved(first, slopes)
        values = given + more @ s
        forces = self.magnitudes.components(self.reactions, values)
        return values, ca.vertcat(self.guards(values, rate, s), self.magnitudes.guards(forces, first, slopes, s))

    @property
    def by_law(self) -> list[ca.SX]:
        """Whether each law holds, 0 or 1."""
        return [mask.holds.sx for mask in self.masks]

    @property
    def holds(self) -> list[ca.SX]:
        """The same for each row."""
        return [mask.holds.sx for mask, row in zip(self.masks, self.rows, strict=True) for _ in row.reactions]

    def against(self, rate: ca.SX) -> list[tuple[ModeRow, ca.SX]]:
        """Of each row its law, and the part of the limit with which friction pushes back along it."""
        found: list[tuple[ModeRow, ca.SX]] = []
        for row, mask in zip(self.rows, self.masks, strict=True):
            first = len(found)
            slip, parts = rate[first : first + row.size, :], ca.vertcat(ca.SX(0, 1), *(along.sx for along in mask.along))
            if mask.slides is not None and mask.frozen is not None:
                none = 1 - mask.slides.sx
                way = (
                    slip / ca.sqrt(ca.sumsqr(slip) + none) if row.pressure is None else patches.against(row.pressure, slip, none)
                )
                parts = mask.frozen.sx * parts + mask.slides.sx * way
            found += [(row, parts[k] if mask.along else ca.SX(0)) for k in range(row.size)]
        return found

    def matrix(self, rate: ca.SX) -> ca.SX:
        """(n, n), by which reactions are given in a mode."""
        holds = ca.vertcat(*self.holds)
        M = ca.repmat(holds, 1, holds.numel()) * self.compliance + ca.diag(1 - holds)
        M[: len(self.valves.rows), :] = self.valves.matrix
        for i, (row, part) in enumerate(self.against(rate)):
            if row.sliding is not None:
                M[i, :] += (1 - holds[i]) * part * ca.jacobian(row.sliding, self.reactions)
        return M

    def by_magnitudes(self, rate: ca.SX) -> ca.SX:
        """(n, m), the other side by each magnitude."""
        symbols = self.magnitudes.symbols
        found = ca.SX(self.reactions.numel(), symbols.numel())
        for i, (row, part) in enumerate(self.against(rate)):
            if row.sizes and row.sliding is not None:
                found[i, :] = -(1 - self.holds[i]) * part * ca.jacobian(row.sliding, symbols)
        return found

    def right(self, free: ca.SX, rate: ca.SX) -> ca.SX:
        """(n, 1), the other side, without reactions and magnitudes."""
        unknown, found = ca.vertcat(self.reactions, self.magnitudes.symbols), ca.SX(free)
        none = ca.SX.zeros(unknown.numel())
        for i, (row, part) in enumerate(self.against(rate)):
            found[i] = -self.holds[i] * free[i]
            if row.sliding is not None:
                limit = ca.substitute(row.sliding, unknown, none)
                found[i] -= (1 - self.holds[i]) * part * limit
        found[: len(self.valves.rows), :] = self.valves.right
        return found

    @property
    def held(self) -> ca.SX:
        """(n, n): the compliance of what holds, and one on the diagonal of what does not."""
        holds = ca.vertcat(*self.holds)
        found = (holds @ holds.T) * self.compliance + ca.diag(1 - holds)
        found[: len(self.valves.rows), :] = self.valves.matrix
        return found

    @property
    def active(self) -> ca.SX:
        """(n, 1): not zero where a row of the matrix is more than one of the unit matrix."""
        found: list[ca.SX] = []
        for row, mask in zip(self.rows, self.masks, strict=True):
            slides = ca.SX(0)
            if row.sliding is not None and ca.depends_on(row.sliding, self.reactions):
                given = mask.along if mask.slides is None or mask.frozen is None else (mask.slides, mask.frozen)
                slides = sum((entry.sx**2 for entry in given), slides)
            found += [mask.holds.sx + slides] * row.size
        return ca.vertcat(*found)

    def solved(self, M: ca.SX, right: ca.SX, active: ca.SX) -> ca.SX:
        """M^-1 right; where M has no inverse, of least norm in units of the compliances."""
        v = len(self.valves.rows)
        whole = ca.vertcat(ca.SX.zeros(v), ca.vertcat(*self.holds)[v:, :] * ca.diag(self.compliance)[v:, :])
        damping = None if self.damping is None else self.damping * whole
        self.systems, answers = self.systems.with_one(active, M, right, damping)
        return answers

    def guards(self, found: ca.SX, rate: ca.SX, sizes: ca.SX) -> ca.SX:
        """Of laws, see `Modes`."""
        guards = self.valves.guards(found)
        unknown, values = ca.vertcat(self.reactions, self.magnitudes.symbols), ca.densify(ca.vertcat(found, sizes))
        first = len(guards)
        for row, mask in list(zip(self.rows, self.masks, strict=True))[first:]:
            holds, force, slip = mask.holds.sx, found[first : first + row.size, :], rate[first : first + row.size, :]
            first += row.size
            if row.holding is None:
                apart = row.gated(row.moved, 1) if row.one_way else row.moved
                guards.append((1 - holds) * apart + holds * force)
                continue
            limit = ca.substitute(row.holding, unknown, values)
            if mask.slides is None or mask.frozen is None or mask.threshold is None:
                sign = mask.along[0].sx
                guards.append(holds * (limit - force) + (1 - holds) * (sign * slip - (1 - sign**2) * limit))
                guards.append(holds * (limit + force) + (1 - holds) * (sign**2 * limit + (1 - sign**2)))
                continue
            slides, frozen, least = mask.slides.sx, mask.frozen.sx, mask.threshold.sx
            along = ca.vertcat(*(entry.sx for entry in mask.along))
            # what is added changes no digit where it counts, and leaves a derivative where the root is zero
            little = (_LITTLE * limit) ** 2 + (1 - holds)
            size = ca.sqrt(ca.sumsqr(force) + little) if row.pressure is None else patches.size(row.pressure, force, little)
            speed, slow = (
                ca.sqrt(ca.sumsqr(slip) + (1 - slides)),
                ca.sqrt(ca.sumsqr(slip) + (_LITTLE * least) ** 2 + (1 - frozen)),
            )
            inside = holds * (limit - size) + frozen * ca.dot(along, slip) + slides * (speed - least)
            guards.append(inside - (1 - holds - frozen - slides) * limit)
            way = limit
            if mask.faster is not None:
                apart = (ca.sumsqr(slip[:2]) - slip[2] ** 2) / ca.sqrt(ca.sumsqr(slip) + (1 - slides))
                way = mask.faster.sx * apart + (1 - mask.faster.sx**2)
            guards.append(frozen * (2 * least - slow) + slides * way + (1 - frozen - slides))
        return ca.vertcat(*guards)


def _may_depend(W: np.ndarray) -> bool:
    """Whether rows might depend on one another, if all of them held."""
    diagonal = np.diag(W)
    if not (diagonal > 0).all():
        return True
    scale = 1 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(scale[:, None] * W * scale)[:1].min(initial=1.0) < _NEARLY)


_NEARLY = 1e-3
"""Of the largest, what may become nothing as rows move with the states."""
_LITTLE = 1e-9
_NEVER = 1e-12
"""Part of the largest compliance that is none."""
