"""Latches, couplings and grippers: what is fastened at an event, and let go at another one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import final

import casadi as ca

from acausal.errors import ParameterError
from acausal.language.connector import Frame, Point
from acausal.language.expression import Discrete, Expression, Reaction, Scalar, flag
from acausal.language.mode_laws import Lock, ModeLaw
from acausal.language.origin import origin
from acausal.language.when import when
from acausal.parts.contact import read
from acausal.parts.force import AbstractReactiveForce, Action, at_ends
from acausal.parts.placement import Placement
from acausal.parts.pose import pose_between, symbolic, vee

_LOOSE = "It fastens two bodies to one another: connect both of its frames."


class AbstractLatch(AbstractReactiveForce, ABC):
    """Holds frame_b at frame_a while `held` is 1, and does nothing while that is 0. Must call `_make`, and provide `gap` and `ends`.

    It is fastened where `closes` rises through zero, let go where `opens` does, or by events of one's own: `ac.when(..., set=latch.closing())` and
    `latch.opening()`. Positions stay as they are; of velocities it takes what it does not allow, with a plastic impact. `held`: from the start on; there it is
    assembled like a joint, places and velocities, where start values do not forbid that. `force` [N] and `torque` [N*m] on frame_b, in the axes
    of frame_a.
    """

    held: Discrete
    _force: tuple[Reaction, ...]
    _torque: tuple[Reaction, ...] = ()

    def _make(self, closes: Expression | None, opens: Expression | None, held: bool, turns: bool) -> None:
        name = type(self).__name__
        for what, given in (("closes", closes), ("opens", opens)):
            if not (given is None or isinstance(given, Expression)):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise ParameterError(
                    f"{name}'s {what} is {given!r} ({origin()}). Give an expression, which rises through zero where it does."
                )
        self.closes, self.opens = closes, opens
        self.held = Discrete("", "1 while it holds", start=float(flag(held, f"{name}'s held")))
        self._force = tuple(Reaction("N", "force on frame_b") for _ in range(3))
        self._torque = () if turns else tuple(Reaction("N*m", "torque on frame_b") for _ in range(3))

    @abstractmethod
    def ends(self) -> tuple[Frame, Point]:
        """Frames of the two bodies."""

    @abstractmethod
    def gap(self) -> tuple[ca.SX, ca.SX]:
        """What is kept at zero, a row for each reaction, and what must be zero too where it closes."""

    @property
    def force(self) -> Expression:
        """On frame_b, in the axes of frame_a (3, 1) [N]."""
        return read(ca.vertcat(*(entry.sx for entry in self._force)))

    @property
    def torque(self) -> Expression:
        """On frame_b, in the axes of frame_a (3, 1) [N*m]; zero where it may turn."""
        return read(ca.vertcat(*(entry.sx for entry in self._torque)) if self._torque else ca.SX.zeros(3))

    def closing(self) -> dict[Expression | str, Scalar]:
        """What an event sets that fastens it."""
        return {self.held: 1.0}

    def opening(self) -> dict[Expression | str, Scalar]:
        """What an event sets that lets it go."""
        return {self.held: 0.0}

    @final
    def laws(self) -> Iterable[ModeLaw]:
        gap, apart = self.gap()
        yield Lock((*self._force, *self._torque), read(gap), self.held, read(apart) if apart.numel() else None)
        if self.closes is not None:
            yield when(self.closes, "rising", set=self.closing())
        if self.opens is not None:
            yield when(self.opens, "rising", set=self.opening())

    @final
    def actions(self, placement: Placement) -> tuple[Action, ...]:
        return at_ends(placement, *self.ends(), self.force.sx, self.torque.sx)


def _turned(R: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Rotation vector of a small rotation, and what tells it from half a turn."""
    return vee(R - R.T) / 2, (3 - ca.trace(R)) / 4


@final
class Latch(AbstractLatch):
    """Holds frame_b at frame_a, origin on origin and axes along axes, while `held` is 1: a coupling, a docking port.

    Where it closes and the frames do not meet, the run ends with the gap.

        scene.dock = Latch(closes=scene.slide.q)
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, *, closes: Expression | None = None, opens: Expression | None = None, held: bool = False) -> None:
        self._make(closes, opens, held, turns=False)

    def ends(self) -> tuple[Frame, Frame]:
        return self.frame_a, self.frame_b

    def gap(self) -> tuple[ca.SX, ca.SX]:
        X = pose_between(self.frame_a, self.frame_b)
        turned, half = _turned(symbolic(X.rotation))
        return ca.vertcat(symbolic(X.position), turned), half


@final
class PointLatch(AbstractLatch):
    """Holds the origin of frame_b, a point, at that of frame_a while `held` is 1, and lets it turn: a hook, a hand that holds a bar.

    Where it closes and the origins do not meet, the run ends with the gap.

        scene.hook = PointLatch(closes=ac.time - 1.0, opens=ac.time - 2.0)
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Point.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, *, closes: Expression | None = None, opens: Expression | None = None, held: bool = False) -> None:
        self._make(closes, opens, held, turns=True)

    def ends(self) -> tuple[Frame, Point]:
        return self.frame_a, self.frame_b

    def gap(self) -> tuple[ca.SX, ca.SX]:
        a, b = self.frame_a, self.frame_b
        return (a.rotation.T @ (b.position - a.position)).sx, ca.SX(0, 1)


@final
class Gripper(AbstractLatch):
    """Holds frame_b as it stands against frame_a at the instant at which it closes, while `held` is 1.

    It remembers where that was: `place` [m], and the entries of a rotation matrix in `turned`. Whether the two are close to one another is not
    asked: let `closes` say so.

        scene.hand = Gripper(closes=ac.time - 1.0, opens=ac.time - 2.0)
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, *, closes: Expression | None = None, opens: Expression | None = None, held: bool = False) -> None:
        self._make(closes, opens, held, turns=False)
        place, turned = self._now()
        self.place = tuple(Discrete("m", "where it holds", start=value) for value in place)
        self.turned = tuple(Discrete("", "how it holds", start=value) for value in turned)

    def ends(self) -> tuple[Frame, Frame]:
        return self.frame_a, self.frame_b

    def gap(self) -> tuple[ca.SX, ca.SX]:
        X = pose_between(self.frame_a, self.frame_b)
        before = ca.reshape(ca.vertcat(*(entry.sx for entry in self.turned)), 3, 3)
        turned, half = _turned(symbolic(X.rotation) @ before.T)
        return ca.vertcat(symbolic(X.position) - ca.vertcat(*(entry.sx for entry in self.place)), turned), half

    def closing(self) -> dict[Expression | str, Scalar]:
        place, turned = self._now()
        return {self.held: 1.0, **dict(zip((*self.place, *self.turned), (*place, *turned), strict=True))}

    def _now(self) -> tuple[list[Expression], list[Expression]]:
        X = pose_between(self.frame_a, self.frame_b)
        return [read(entry) for entry in ca.vertsplit(symbolic(X.position))], [
            read(entry) for entry in ca.vertsplit(ca.vec(symbolic(X.rotation)))
        ]
