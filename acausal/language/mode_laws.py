"""Laws of reactions that hold as long as they can: one-sided contact, dry friction, and what is like them (stops, ropes, clutches, freewheels)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import final

from acausal.errors import ModelError, ParameterError
from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression, Reaction, Scalar, scalar
from acausal.language.impact_laws import AbstractImpactLaw, Restitution, impact_law
from acausal.language.origin import origin
from acausal.language.when import when


@final
@dataclass(frozen=True, eq=False)
class OneSided:
    """`reaction` >= 0 and `gap` >= 0, and one of them is zero.

    `gap`: an expression of positions and time, whose rate does work with the reaction: the reaction pushes towards a larger gap ([m] with [N], [rad] with
    [N*m]). Where it closes with speed, it opens with `restitution` (0 ... 1) times that speed: by Poisson's law, or that of
    ac.Poisson(...), ac.Newton(...), ac.Energetic(...).
    """

    reaction: Reaction
    gap: Expression
    restitution: Restitution = 0.0

    def __post_init__(self) -> None:
        _check(self.reaction, self.gap, "OneSided", "gap")
        object.__setattr__(self, "restitution", impact_law(self.restitution, "A restitution"))

    @property
    def impact(self) -> AbstractImpactLaw:
        """How it strikes."""
        return impact_law(self.restitution, "A restitution")


@final
class Pressure(Enum):
    """How a round patch presses: the same everywhere; as balls by Hertz, p ~ sqrt(1 - (r / radius)^2); along its edge."""

    UNIFORM = 1
    HERTZ = 2
    RING = 3


@final
@dataclass(frozen=True, eq=False)
class DryFriction:
    """`reaction` is what keeps `slip` at zero, as far as it is at most `holding`; where it slips, it is `sliding` against the slip.

    `slip`: an expression of velocities, whose product with the reaction is power (m/s with N, rad/s with N*m); or two of them along two directions, (2, 1), with a
    pair of reactions: then limits are those of the pair's norm. `holding` and `sliding` [N or N*m]: expressions in which also reactions of one-sided laws may
    stand, as factors, and `ac.Magnitude`s of what joints bear. `holding` >= `sliding` >= 0; `sliding` unless given. `restitution`
    (0 ... 1): how much of a slip comes back in an impact, as far as friction can.

    A round patch that slides and spins at once has three: the slip of its centre along two directions, and the speed of its edge, radius times spin; with three
    reactions [N], the last one times the radius is a torque. `pressure`: of the patch; limits are those of sliding alone. Each point rubs against its own slip.
    """

    reaction: Reaction | tuple[Reaction, Reaction] | tuple[Reaction, Reaction, Reaction]
    slip: Expression
    sliding: Scalar
    holding: Scalar = field(default=None)  # pyright: ignore[reportAssignmentType]  # as much as `sliding`
    restitution: Scalar = 0.0
    pressure: Pressure | None = None

    def __post_init__(self) -> None:
        _check(self.reaction, self.slip, "DryFriction", "slip")
        if not (self.pressure is None or isinstance(self.pressure, Pressure)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ModelError(
                f"DryFriction's pressure is {self.pressure!r} ({origin()}). Give ac.Pressure.UNIFORM, HERTZ or RING."
            )
        if (len(self.reactions) == 3) != (self.pressure is not None):
            raise ModelError(
                f"DryFriction has {len(self.reactions)} reactions and pressure={self.pressure!r} ({origin()}). Three of them are those of a patch, with its "
                "pressure: ac.DryFriction((self.a, self.b, self.twist), slip, limit, pressure=ac.Pressure.UNIFORM)."
            )
        object.__setattr__(self, "restitution", impact_law(self.restitution, "DryFriction's restitution").restitution)
        sliding = scalar(self.sliding, "DryFriction's sliding", non_negative=True)
        holding = sliding if self.holding is None else scalar(self.holding, "DryFriction's holding", non_negative=True)  # pyright: ignore[reportUnnecessaryComparison]
        if isinstance(holding, float) and isinstance(sliding, float) and holding < sliding:
            raise ParameterError(
                f"DryFriction's holding is {holding:g}, below its sliding of {sliding:g} ({origin()}). What it takes to make it slip is at least what it slips with."
            )
        object.__setattr__(self, "sliding", sliding)
        object.__setattr__(self, "holding", holding)

    @property
    def reactions(self) -> tuple[Reaction, ...]:
        """One to three."""
        return self.reaction if isinstance(self.reaction, tuple) else (self.reaction,)


def together(reactions: tuple[Reaction, ...]) -> Reaction | tuple[Reaction, Reaction] | tuple[Reaction, Reaction, Reaction]:
    """One to three, as `DryFriction` has them."""
    if len(reactions) == 1:
        return reactions[0]
    return (reactions[0], reactions[1]) if len(reactions) == 2 else (reactions[0], reactions[1], reactions[2])


@final
@dataclass(frozen=True, eq=False)
class OneWay:
    """`reaction` >= 0 and `speed` >= 0, and one of them is zero: what goes one way only.

    `speed`: an expression of velocities, whose product with the reaction is power (m/s with N, rad/s with N*m), which the reaction makes larger: of freewheels,
    whose engaging at speed zero is no impact. Or a voltage that falls where the reaction, a current, flows: of ideal diodes; also one that depends
    on the current itself. Where there is a `gate`, what is open stays open unless that is positive (thyristors, pawls); what holds needs none to go on.

    The same law is that of an `other` reaction, which is what the speed is, while `flow`, a variable of the part which is what the reaction is, is the speed. It is
    turned round so where something else decides the flow, as an inductor does that of a diode in series; while its gate is shut it holds what is of either sign, too. The
    equation of `flow` is that of the law: its part has none.
    """

    reaction: Reaction
    speed: Expression
    gate: Expression | None = None
    flow: Expression | None = None
    other: Reaction | None = None

    def __post_init__(self) -> None:
        _check(self.reaction, self.speed, "OneWay", "speed")
        if self.gate is not None:
            _check(self.reaction, self.gate, "OneWay", "gate")
        if self.flow is not None and self.other is not None:
            _check(self.other, self.flow, "OneWay", "flow")

    @property
    def equations(self) -> tuple[Equation, ...]:
        """What its reaction is."""
        return () if self.flow is None else (equal(self.flow, self.reaction),)

    def turned(self) -> OneWay | None:
        """The law of the other reaction; None where there is none."""
        if self.flow is None or self.other is None:
            return None
        return OneWay(self.other, self.flow, self.gate, self.speed, self.reaction)


@final
@dataclass(frozen=True, eq=False)
class Lock:
    """`reactions` are what keeps a `gap` (n, 1) at zero, as many, while `held` is positive; else they are zero: a constraint that is imposed and released.

    `gap`: of positions; its rates do work with the reactions, which push towards larger entries ([m] with [N], [rad] with [N*m]). `held`: of
    `ac.Discrete`s, which events set. `apart` (m, 1): what must be zero too when it is imposed. Imposed, it takes the velocities that it does not
    allow, as a plastic impact does; what does not meet then is refused.
    """

    reactions: tuple[Reaction, ...]
    gap: Expression
    held: Expression
    apart: Expression | None = None

    def __post_init__(self) -> None:
        if not self.reactions or not all(isinstance(entry, Reaction) for entry in self.reactions):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ModelError(
                f"Lock's reactions are {self.reactions!r} ({origin()}). Keep some as attributes of the part: self.pull = ac.Reaction('N')."
            )
        if not isinstance(self.gap, Expression) or self.gap.sx.numel() != len(self.reactions):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ModelError(
                f"Lock's gap is {self.gap!r} ({origin()}). Give a column with as many entries as there are reactions."
            )
        if not isinstance(self.held, Expression) or not self.held.sx.is_scalar():  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ModelError(
                f"Lock's held is {self.held!r} ({origin()}). Give an ac.Discrete of the part, 1 where it holds, else 0."
            )


ModeLaw = OneSided | DryFriction | OneWay | Lock | when


def _check(reaction: object, moved: object, law: str, name: str) -> None:
    given: tuple[object, ...] = reaction if isinstance(reaction, tuple) and law == "DryFriction" else (reaction,)  # pyright: ignore[reportUnknownVariableType]
    if not all(isinstance(entry, Reaction) for entry in given) or len(given) not in (1, 2, 3):
        raise ModelError(
            f"{law}'s reaction is {reaction!r} ({origin()}). Keep one as an attribute of the part: self.push = ac.Reaction('N')."
        )
    if not isinstance(moved, Expression) or moved.sx.numel() != len(given):
        what = ("a scalar expression", "a column of two expressions", "a column of three expressions")[len(given) - 1]
        raise ModelError(f"{law}'s {name} is {moved!r} ({origin()}). Give {what} of the scene's variables.")
