"""The line between two points as a flange, and cables that run over eyelets."""

from __future__ import annotations

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

_LOOSE = "A cable is held at both ends: connect both."


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


@final
class ConstantSum(Component):
    """Positions of any number of flanges whose sum stays `total` [m]: s_1 + s_2 + ... = total, the same f into each: a cable's pull.

    scene.tie = ConstantSum(1.5, 2); scene.connect(scene.tie.flanges[0], scene.left.flange)
    """

    tension = Variable("N", "pull")

    def __init__(self, total: Scalar, number: int) -> None:
        self.total = scalar(total, "ConstantSum's total", unit="m")
        if isinstance(number, bool) or not isinstance(number, int) or number < 1:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ParameterError(f"ConstantSum's number is {shown(number)} ({origin()}). Give a whole number of at least 1.")
        ports: list[Translational] = []
        for k in range(number):
            port = Translational(self, f"flange_{k}", must_connect=True, if_unconnected="Connect all its flanges.")
            setattr(self, port.name, port)
            ports.append(port)
        self.flanges = tuple(ports)

    def equations(self) -> Iterable[Equation]:
        yield equal(sum((port.s for port in self.flanges), -1.0 * self.total), 0.0)
        for port in self.flanges:
            yield equal(port.f, self.tension)


@final
class Cable(System):
    """A taut cable without mass of constant `length` [m] > 0 from frame_a over eyelets to frame_b: the sum of its straight pieces stays. Takes one freedom.

    `over`: points or frames of other parts that it runs through in turn, smoothly, fixed or on bodies that move: small pulleys. Its pull is the same in every
    piece and acts on every eyelet along both; `tension` [N] > 0 pulls. It holds on both sides: where tension is negative a real cable hangs loose.

        scene.rope = Cable(length=2.0, over=(scene.world.at((0, 0, 1)), scene.block.at((0.1, 0, 0))))
    """

    frame_a = Frame.port(must_connect=True, if_unconnected=_LOOSE)
    frame_b = Frame.port(must_connect=True, if_unconnected=_LOOSE)

    def __init__(self, length: Scalar, over: Sequence[Point] = ()) -> None:
        total = scalar(length, "Cable's length", positive=True, unit="m")
        eyelets: Any = over
        if not isinstance(eyelets, list | tuple) or not all(isinstance(eyelet, Point) for eyelet in eyelets):
            raise ParameterError(
                f"Cable's over is {shown(over)} ({origin()}). Give a list of points or frames of parts, over=(world.at((0, 0, 1)), pulley.frame)."
            )
        self.pieces = [LineOfAction() for _ in range(len(eyelets) + 1)]
        self.tie = ConstantSum(total, len(self.pieces))
        ends = [self.frame_a, *eyelets, self.frame_b]
        for piece, flange, a, b in zip(self.pieces, self.tie.flanges, ends, ends[1:], strict=False):
            self.connect(a, piece.frame_a)
            self.connect(piece.frame_b, b)
            self.connect(piece.flange, flange)

    @property
    def tension(self) -> Variable:
        """Pull [N], positive where it is taut."""
        return self.tie.tension
