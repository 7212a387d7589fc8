"""The line between two points as a flange, and cables that run over eyelets."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any, final

import casadi as ca

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.component import Component, System
from acausal.language.connector import Frame, Point, Translational
from acausal.language.equation import Equation, equal
from acausal.language.expression import Scalar, Variable, scalar
from acausal.language.origin import origin
from acausal.parts.pose import Pose, symbolic
from acausal.parts.span import AbstractSpan
from components.joints.revolute import Revolute
from components.pulley import CommonTangent, Pulley, RopeOverWheels, Tangent

_LOOSE = "A cable is held at both ends: connect both."
_MOST = 1000
"""Pieces of one rope."""


@final
class LineOfAction(AbstractSpan):
    """The straight line between the origins of frame_a and frame_b as a slide: s of `flange` is their distance [m]; f pushes them apart.

    No mass, no freedom less: a cylinder, a muscle, a belt is what is connected to the flange. The ends may be particles. They must lie apart: at the distance 0
    the line has no direction.

        scene.piston = LineOfAction(); scene.connect(scene.piston.flange, scene.pump.flange)
    """

    between_points = True
    flange = Translational.port()

    def coordinate(self, X_ab: Pose) -> ca.SX:
        return ca.norm_2(symbolic(X_ab.position))

    def line(self, X_ab: Pose) -> tuple[ca.SX, ca.SX]:
        return ca.SX.zeros(3), symbolic(X_ab.position)


@final
class ConstantSum(Component):
    """Positions of any number of flanges whose sum stays `total` [m]: s_1 + s_2 + ... = total, the same f into each: a cable's pull.

    scene.tie = ConstantSum(1.5, 2); scene.connect(scene.tie.flanges[0], scene.left.flange)
    """

    tension = Variable("N", "pull")

    def __init__(self, total: Scalar, number: int) -> None:
        self.total = scalar(total, "ConstantSum's total", unit="m")
        self.flanges = own_flanges(self, number)

    def equations(self) -> Iterable[Equation]:
        yield equal(sum((port.s for port in self.flanges), -1.0 * self.total), 0.0)
        for port in self.flanges:
            yield equal(port.f, self.tension)


@final
class Cable(System):
    """A taut cable without mass of constant `length` [m] > 0 from frame_a to frame_b: the sum of its pieces stays. Takes one freedom.

    `over`: what it runs over in turn: points or frames of other parts, through which it slides smoothly, and pulleys with a radius (`Pulley`), around
    which its arcs count. Its pull is the same in every piece and acts on all that it runs over; `tension` [N] > 0 pulls. Where a pulley has a wheel,
    it does not slip: the `hinges` of the wheels, in turn, drive it or are driven, and `tension` is that of each section from wheel to wheel.
    It holds on both sides: where tension is negative a real cable hangs loose.

        scene.rope = Cable(length=2.0, over=(scene.world.at((0, 0, 1)), Pulley(scene.block.at((0.1, 0, 0)), radius=0.05)))
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, length: Scalar, over: Sequence[Point | Pulley] = ()) -> None:
        total = scalar(length, "Cable's length", positive=True, unit="m")
        places: list[Point | Pulley] = [self.frame_a, *run_over(over, "Cable"), self.frame_b]
        self.pieces = [piece_between(self, a, b) for a, b in itertools.pairwise(places)]
        wheels = [(k, place.wheel, place) for k, place in enumerate(places) if isinstance(place, Pulley) and place.wheel]
        borders = [0, *(k for k, _, _ in wheels), len(self.pieces)]
        sections = [b - a for a, b in itertools.pairwise(borders)]
        rope = RopeOverWheels(total, sections, [pulley.radius for *_, pulley in wheels]) if wheels else None
        self.tie = rope or ConstantSum(total, len(self.pieces))
        for piece, flange in zip(self.pieces, self.tie.flanges, strict=True):
            self.connect(piece.flange, flange)
        self.hinges = [Revolute(pulley.axis) for *_, pulley in wheels]
        for hinge, (_, wheel, pulley), shaft in zip(self.hinges, wheels, rope.shafts if rope else (), strict=True):
            self.connect(pulley.frame, hinge.frame_a)
            self.connect(hinge.frame_b, wheel.frame)
            self.connect(hinge.flange, shaft)

    @property
    def tension(self) -> Variable:
        """Pull [N], positive where it is taut; of each section where there are wheels."""
        return self.tie.tension


@final
class TotalLength(Component):
    """The sum of the positions of any number of flanges as a slide of its own: s of `flange` = s_1 + s_2 + ...; what pushes there pushes at each. Made by
    `Tendon`.

        scene.sum = TotalLength(2); scene.connect(scene.sum.flanges[0], scene.left.flange)
    """

    flange = Translational.port()

    def __init__(self, number: int) -> None:
        self.flanges = own_flanges(self, number)

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.s, sum((port.s for port in self.flanges[1:]), 1.0 * self.flanges[0].s))
        for port in self.flanges:
            yield equal(port.f, -1.0 * self.flange.f)


@final
class Tendon(System):
    """The way of a rope from frame_a to frame_b as a slide: s of `flange` is its length [m], f > 0 makes it longer. No mass, no freedom less: a muscle, a
    winch or a spring is what is connected to the flange, and acts on all that the rope runs over.

    `over`: points or frames of other parts, through which it slides smoothly, and pulleys without a wheel (`Pulley`), around which its arcs count. An
    elastic rope that goes slack is ElasticStop(tendon.flange, upper=length, law=HuntCrossley(stiffness, exponent=1)). One that does not stretch is a Cable.

        scene.tendon = Tendon(over=(scene.arm.at((0.28, 0, 0.04)),))
        scene.muscle = ForceSource(-20.0); scene.connect(scene.muscle.flange, scene.tendon.flange)
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    flange = Translational.port()

    def __init__(self, over: Sequence[Point | Pulley] = ()) -> None:
        places: list[Point | Pulley] = [self.frame_a, *run_over(over, "Tendon"), self.frame_b]
        if any(isinstance(place, Pulley) and place.wheel for place in places):
            raise ParameterError(
                f"A Tendon's pulleys have no wheels ({origin()}): its pull is the same all along. Leave the wheel out, or take a Cable."
            )
        self.pieces = [piece_between(self, a, b) for a, b in itertools.pairwise(places)]
        self.total = TotalLength(len(self.pieces))
        for piece, port in zip(self.pieces, self.total.flanges, strict=True):
            self.connect(piece.flange, port)
        self.connect(self.flange, self.total.flange)


def own_flanges(part: Component, number: int) -> tuple[Translational, ...]:
    """So many flanges of a part. Raises `ParameterError`."""
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= _MOST:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ParameterError(
            f"{type(part).__name__}'s number is {shown(number)} ({origin()}). Give a whole number from 1 to {_MOST}."
        )
    ports: list[Translational] = []
    for k in range(number):
        port = Translational(part, f"flange_{k}", must_connect=True, if_unconnected="Connect all its flanges.")
        setattr(part, port.name, port)
        ports.append(port)
    return tuple(ports)


def run_over(over: Any, part: str) -> list[Point | Pulley]:
    """What a rope runs over. Raises `ParameterError`."""
    if not isinstance(over, list | tuple) or not all(isinstance(place, Point | Pulley) for place in over):
        raise ParameterError(
            f"{part}'s over is {shown(over)} ({origin()}). Give a list of points or frames of parts and pulleys, over=(world.at((0, 0, 1)), "
            "Pulley(block.frame, 0.1))."
        )
    return list(over)


def piece_between(rope: System, a: Point | Pulley, b: Point | Pulley) -> LineOfAction | Tangent | CommonTangent:
    """From one place of a rope to the next, connected to both."""
    ends = [place.frame if isinstance(place, Pulley) else place for place in (a, b)]
    if isinstance(a, Pulley) and isinstance(b, Pulley):
        piece = CommonTangent(a, b)
    elif isinstance(b, Pulley):  # seen from the pulley, the rope runs back
        piece, ends = Tangent(b.turned_round), ends[::-1]
    else:
        piece = Tangent(a) if isinstance(a, Pulley) else LineOfAction()
    for end, own in zip(ends, (piece.frame_a, piece.frame_b), strict=True):
        rope.connect(end, own)
    return piece
