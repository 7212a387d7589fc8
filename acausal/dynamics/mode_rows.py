"""Laws of reactions as rows: what they hold, by the mechanism's own symbols."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as ca

from acausal.dynamics.readings import Readings
from acausal.errors import ModelError
from acausal.language.expression import Discrete, Expression, Magnitude, Parameter, Reaction, Scalar, declared, sx
from acausal.language.flatten import FlatSystem, Part
from acausal.language.impact_laws import Energetic
from acausal.language.mode_laws import DryFriction, Lock, OneSided, OneWay, Pressure
from acausal.language.when import when
from acausal.numerics.terms import rounded


@dataclass(frozen=True)
class Size:
    """What stands for a `Magnitude` in limits, `symbol`, and its components `of` (n, 1), n from 1 to 3."""

    symbol: Magnitude
    of: ca.SX


@dataclass(frozen=True)
class ModeRow:
    """A law of `reactions`, one to three: one-sided, with what it keeps from closing for `moved` [m or rad], and `restitution`; or friction, where `moved` (as many)
    is the slip [m/s or rad/s], and `sliding` and `holding` are the limits [N or N*m]. `one_way`: one-sided, and `moved` is no gap but a speed;
    `gate`: positive where that may close; `turns`: whether its law may be turned round, see `OneWay`. `sizes`: which the limits depend on. `impact`: by which law of impact, see impacts.h; `back`: how much of a slip comes
    back in one; `pressure`: of a patch, which has three reactions; `terms`: the sizes of what the gap is made of where it is read, as of places whose
    difference is a number.
    """

    part: Part
    reactions: tuple[Reaction, ...]
    moved: ca.SX
    restitution: ca.SX | None = None
    sliding: ca.SX | None = None
    holding: ca.SX | None = None
    one_way: bool = False
    gate: ca.SX | None = None
    turns: bool = False
    sizes: tuple[Size, ...] = ()
    impact: int = 0
    back: ca.SX = field(default_factory=lambda: ca.SX(0))
    pressure: Pressure | None = None
    terms: ca.SX = field(default_factory=lambda: ca.SX(0))

    @property
    def gap(self) -> ca.SX:
        """Of a one-sided row; nothing is between what goes one way only."""
        return ca.SX(0) if self.one_way else self.moved

    def gated(self, open_gate: ca.SX, shut: float) -> ca.SX:
        """A value where the gate is open, or where there is none, and what it is where that is shut."""
        return open_gate if self.gate is None else ca.if_else(self.gate > 0, open_gate, shut)

    @property
    def turned(self) -> bool:
        """Whether it holds where its part is open, see `OneWay`."""
        return self.one_way and self.part.turned

    @property
    def one_sided(self) -> bool:
        """Whether it may open."""
        return self.restitution is not None

    @property
    def size(self) -> int:
        """How many reactions."""
        return len(self.reactions)

    @property
    def masks(self) -> int:
        """How many inputs say what it does."""
        return 1 if self.one_sided else (2, 6, 8)[self.size - 1]

    @property
    def reaction(self) -> Reaction:
        """The first one."""
        return self.reactions[0]

    def put(self, old: Sequence[ca.SX], new: Sequence[ca.SX]) -> ModeRow:
        """With values in place of symbols."""
        named = {name: getattr(self, name) for name in ("moved", "restitution", "sliding", "holding", "gate", "back", "terms")}
        given = {name: value for name, value in named.items() if value is not None}
        found = dict(zip(given, ca.substitute([*given.values()], list(old), list(new)), strict=True))
        sizes = tuple(replace(size, of=ca.substitute([size.of], list(old), list(new))[0]) for size in self.sizes)
        return replace(self, sizes=sizes, **found)


@dataclass(frozen=True)
class LockRows:
    """A lock of `reactions`, n of them: `gap` (n, 1) is kept at zero where `held` is 1 and not 0; `apart` (m, 1) must be zero when it begins to be held.
    `terms` (n + m, 1): the sizes of what both are made of where they are read, as of places whose difference is a number; what rounding makes of them is known by these.
    """

    part: Part
    reactions: tuple[Reaction, ...]
    gap: ca.SX
    held: ca.SX
    apart: ca.SX
    terms: ca.SX

    def put(self, old: Sequence[ca.SX], new: Sequence[ca.SX]) -> LockRows:
        """With values in place of symbols."""
        gap, apart, terms = ca.substitute([self.gap, self.apart, self.terms], list(old), list(new))
        return replace(self, gap=gap, apart=apart, terms=terms)


def lock_rows(flat: FlatSystem, readings: Readings) -> tuple[LockRows, ...]:
    """Of all parts. Raises `ModelError` for what holds by something else than what is remembered, and what `Readings.resolved` raises."""
    found: list[LockRows] = []
    for part in flat.parts:
        for law in part.laws:
            if not isinstance(law, Lock):
                continue
            gap, held = ca.vec(readings.resolved(law.gap.sx, part)), readings.resolved(law.held.sx, part)
            apart = ca.SX(0, 1) if law.apart is None else ca.vec(readings.resolved(law.apart.sx, part))
            given = law.gap.sx if law.apart is None else ca.vertcat(ca.vec(law.gap.sx), ca.vec(law.apart.sx))
            terms = readings.resolved(rounded(ca.vec(given)), part)
            if not all(isinstance(declared(symbol), Discrete | Parameter) for symbol in ca.symvar(held)):
                raise ModelError(
                    f"What the lock of {part.where} is held by changes by itself: {law.held!r}. Give an ac.Discrete, and set it by ac.when(..., set=...)."
                )
            found.append(LockRows(part, law.reactions, gap, ca.SX(held > 0), apart, terms))
    return tuple(found)


def mode_rows(flat: FlatSystem, readings: Readings) -> tuple[ModeRow, ...]:
    """Of all parts: one-sided ones first, then friction in one direction, then in two, then of patches. Raises `ModelError` for a reaction without a law, or with two, and what
    `Readings.resolved` raises."""
    found: list[ModeRow] = []
    locked: list[Reaction] = []
    for part in flat.parts:
        for law in part.laws:

            def read(value: Scalar, part: Part = part) -> ca.SX:
                return readings.resolved(sx(value), part) if isinstance(value, Expression) else ca.SX(value)

            if isinstance(law, when):
                continue
            if isinstance(law, Lock):
                locked += law.reactions
                continue
            if isinstance(law, OneSided):
                bounce, terms = read(law.impact.restitution), readings.resolved(rounded(sx(law.gap)), part)
                found.append(ModeRow(part, (law.reaction,), read(law.gap), bounce, impact=law.impact.kind, terms=terms))
            elif isinstance(law, OneWay):
                gate = None if law.gate is None else read(law.gate)
                found.append(
                    ModeRow(
                        part, (law.reaction,), read(law.speed), ca.SX(0), one_way=True, gate=gate, turns=law.turned() is not None
                    )
                )
            elif isinstance(law, DryFriction):  # pyright: ignore[reportUnnecessaryIsInstance]  # users give anything
                slip, limits = ca.vec(read(law.slip)), (read(law.sliding), read(law.holding))
                sizes = tuple(Size(symbol, read(symbol.of)) for symbol in _magnitudes(ca.vertcat(*limits)))
                found.append(
                    ModeRow(
                        part, law.reactions, slip, None, *limits, sizes=sizes, back=read(law.restitution), pressure=law.pressure
                    )
                )
            else:
                raise ModelError(
                    f"laws() of {part.where} gives {law!r}. Give ac.OneSided(...), ac.OneWay(...), ac.DryFriction(...) and ac.Lock(...)."
                )
    ruled = [*locked, *(reaction for row in found for reaction in row.reactions)]
    for reaction in flat.reactions:
        if ruled.count(reaction) != 1:
            how = "no law" if reaction not in ruled else "more than one law"
            raise ModelError(
                f"{flat.names[reaction]} has {how}. Its part's laws() must give one: ac.OneSided(...), ac.OneWay(...), ac.DryFriction(...) or ac.Lock(...)."
            )
    _check_limits(flat, found)
    _check_patches(flat, found)
    return tuple(sorted(found, key=lambda row: (not row.one_sided, row.size)))


def _magnitudes(value: ca.SX) -> list[Magnitude]:
    return [s for s in dict.fromkeys(declared(scalar) for scalar in ca.symvar(value)) if isinstance(s, Magnitude)]


def _check_patches(flat: FlatSystem, rows: Sequence[ModeRow]) -> None:
    """Raises `ModelError` for a patch that is pressed by what strikes by the law of work, whose path knows two slips and no spin."""
    strikes = {
        law.reaction: part
        for part in flat.parts
        for law in part.laws
        if isinstance(law, OneSided) and isinstance(law.impact, Energetic)
    }
    for row in rows:
        for reaction, part in strikes.items():
            if row.pressure is not None and row.holding is not None and ca.depends_on(row.holding, reaction.sx):
                raise ModelError(
                    f"The patch of {row.part.where} is pressed by {part.where}, whose impacts are ac.Energetic(...): that is not there yet. Give a number, ac.Poisson(e), or ac.Newton(e)."
                )


def _check_limits(flat: FlatSystem, rows: Sequence[ModeRow]) -> None:
    """Raises `ModelError` for limits by reactions of friction, but for magnitudes, and for magnitudes of magnitudes."""
    friction = [reaction for row in rows if not row.one_sided for reaction in row.reactions]
    for row in rows:
        for limit in (row.sliding, row.holding):
            for reaction in friction:
                if limit is not None and ca.depends_on(limit, reaction.sx):
                    raise ModelError(
                        f"The limit of {row.part.where} depends on {flat.names[reaction]}, the reaction of a friction. Let it depend on reactions of one-sided laws, "
                        "positions, velocities, inputs and time, or on an ac.Magnitude."
                    )
        for size in row.sizes:
            if _magnitudes(size.of):
                raise ModelError(
                    f"A Magnitude that limits {row.part.where} depends on another one. Let it be that of a force alone."
                )
