"""What a contact lets the bodies do where they touch: roll, pivot, slide."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.origin import origin


class AbstractTouchingLaw(ABC):
    """Of bodies that touch at all times. Must provide `turning` and `slipping`: what velocities v (freedoms, 1) are."""

    freedoms: ClassVar[int]
    unit: ClassVar[str] = "rad/s"

    @abstractmethod
    def turning(self, tangents: ca.SX) -> ca.SX:
        """(3, freedoms): angular velocity in frame_b by v. `tangents` (3, 2): of the surface, at right angles, in frame_b."""

    @abstractmethod
    def slipping(self) -> ca.SX:
        """(2, freedoms), numbers: velocity of the body's point over the surface along the tangents [m/s], by v."""


@final
@dataclass(frozen=True)
class Rolling(AbstractTouchingLaw):
    """Nothing slips; the body may pivot about the normal. v: angular velocity of frame_b against frame_a, in frame_b (3)."""

    freedoms = 3

    def turning(self, tangents: ca.SX) -> ca.SX:
        return ca.SX.eye(3)

    def slipping(self) -> ca.SX:
        return ca.SX(2, 3)


@final
@dataclass(frozen=True)
class RollingWithoutPivoting(AbstractTouchingLaw):
    """Nothing slips and nothing pivots, as of rough rubber. v: angular velocity along the surface's tangents (2)."""

    freedoms = 2

    def turning(self, tangents: ca.SX) -> ca.SX:
        return tangents

    def slipping(self) -> ca.SX:
        return ca.SX(2, 2)


@final
@dataclass(frozen=True)
class Sliding(AbstractTouchingLaw):
    """Smooth: no friction. v: angular velocity of frame_b against frame_a, in frame_b (3) [rad/s], and the velocity of the body's point over the
    surface along the surface's tangents (2) [m/s].
    """

    freedoms = 5
    unit = ""

    def turning(self, tangents: ca.SX) -> ca.SX:
        return ca.horzcat(ca.SX.eye(3), ca.SX(3, 2))

    def slipping(self) -> ca.SX:
        return ca.horzcat(ca.SX(2, 3), ca.SX.eye(2))


def checked_law(law: object, part: str) -> AbstractTouchingLaw:
    """Raises `ParameterError` for anything else."""
    if not isinstance(law, AbstractTouchingLaw):
        raise ParameterError(
            f"{part}'s law is {law!r} ({origin()}). Give what the bodies do where they touch: Rolling(), RollingWithoutPivoting() or Sliding()."
        )
    return law
