"""Ropes that are taut or slack."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import final

from acausal.errors import ParameterError
from acausal.language.component import Component, System
from acausal.language.connector import Frame, Point
from acausal.language.equation import Equation, equal
from acausal.language.expression import Expression, Reaction, Scalar, scalar
from acausal.language.impact_laws import Restitution
from acausal.language.mode_laws import ModeLaw, OneSided
from acausal.language.origin import origin
from components.cable import own_flanges, piece_between, run_over
from components.contacts.laws import checked_restitution
from components.pulley import Pulley

_LOOSE = "A rope is held at both ends: connect both."


@final
class LimitedSum(Component):
    """Positions of any number of flanges whose sum is at most `total` [m]: s_1 + s_2 + ... <= total; there the same f >= 0 into each, a rope's pull.

    Where the sum is reached with speed, it shrinks with `restitution` (0 ... 1) times that speed.

        scene.tie = LimitedSum(1.5, 2); scene.connect(scene.tie.flanges[0], scene.left.flange)
    """

    if_overlaps = "A rope is shorter than its way from end to end: make it longer, or move its ends and eyelets together."

    def __init__(self, total: Scalar, number: int, restitution: Restitution = 0.0) -> None:
        self.total = scalar(total, "LimitedSum's total", unit="m")
        self.restitution = checked_restitution(restitution, "LimitedSum")
        self.tension = Reaction("N", "pull")
        self.flanges = own_flanges(self, number)

    @property
    def slack(self) -> Expression:
        """How much of the total is left [m]."""
        return self.total - sum((port.s for port in self.flanges[1:]), self.flanges[0].s)

    def equations(self) -> Iterable[Equation]:
        for port in self.flanges:
            yield equal(port.f, self.tension)

    def laws(self) -> Iterable[ModeLaw]:
        yield OneSided(self.tension, self.slack, self.restitution)


@final
class Rope(System):
    """A rope without mass of `length` [m] > 0 from frame_a to frame_b, taut or slack: the sum of its pieces is at most its length.

    `over`: what it runs over in turn: points or frames of other parts, through which it slides smoothly, and pulleys with a radius but without a wheel
    (`Pulley`). 0 <= `tension` [N], the same in every piece and on all that it runs over; 0 <= `slack` [m]; one of them zero. Where it tightens with speed
    its ends return with `restitution` (0 ... 1) times that. Slack it has no place: its pieces are seen as straight. Its ends and eyelets may be particles,
    and must lie apart. A rope that holds on both sides is a `Cable`.

        scene.string = Rope(length=2.0, restitution=0.0)
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, length: Scalar, restitution: Restitution = 0.0, over: Sequence[Point | Pulley] = ()) -> None:
        total = scalar(length, "Rope's length", positive=True, unit="m")
        bounce = checked_restitution(restitution, "Rope")
        places: list[Point | Pulley] = [self.frame_a, *run_over(over, "Rope"), self.frame_b]
        if any(isinstance(place, Pulley) and place.wheel for place in places):
            raise ParameterError(
                f"A Rope runs over a pulley with a wheel ({origin()}), which it would turn by friction: it may hang loose there. Leave the wheel out, or use a "
                "Cable, which holds on both sides."
            )
        self.pieces = [piece_between(self, a, b) for a, b in itertools.pairwise(places)]
        self.tie = LimitedSum(total, len(self.pieces), bounce)
        for piece, flange in zip(self.pieces, self.tie.flanges, strict=True):
            self.connect(piece.flange, flange)

    @property
    def tension(self) -> Expression:
        """Pull [N]; zero where it is slack."""
        return self.tie.tension

    @property
    def slack(self) -> Expression:
        """How much longer it is than its way [m]; zero where it is taut."""
        return self.tie.slack
