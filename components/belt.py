"""Belts around pulleys: what they transmit, how they stretch, and where they slip."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, final

import casadi as ca

from acausal.arguments import shown
from acausal.errors import ParameterError
from acausal.language.component import Component, System
from acausal.language.connector import Rotational, Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Reaction, Scalar, Variable, scalar
from acausal.language.mode_laws import DryFriction, ModeLaw
from acausal.language.origin import origin
from acausal.parts.contact import read
from acausal.parts.pose import pose_between
from components.bodies import RigidBody
from components.contacts.laws import Coulomb
from components.joints.revolute import Revolute
from components.pulley import CommonTangent, Pulley, checked_pulley


class AbstractBelt(Component, ABC):
    """A closed belt without mass over n wheels of these `radii` [m]: section k runs from wheel k - 1 to wheel k, over `sections`[k] pieces, and has one pull T_k.

    It turns wheel k by r_k (T_(k+1) - T_k). Must call `_around`, and provide `pulls`, what makes the pulls.
    """

    tension = Variable("N", "pull of each section")

    @abstractmethod
    def pulls(self) -> Iterable[Equation]:
        """As many equations as there are wheels."""

    @final
    def _around(self, radii: Sequence[float | Expression], sections: Sequence[int], preload: Scalar) -> None:
        name, given = type(self).__name__, list[Any]([radii, sections])
        if not all(isinstance(part, list | tuple) for part in given) or not 0 < len(radii) == len(sections):
            raise ParameterError(
                f"{name}'s radii and sections are {shown(radii)} and {shown(sections)} ({origin()}). Give two lists, with one of each for every wheel."
            )
        if not all(type(number) is int and number > 0 for number in sections):
            raise ParameterError(f"{name}'s sections are {shown(sections)} ({origin()}). Give whole numbers of at least 1.")
        self.radii = tuple(scalar(radius, f"{name}'s radii", positive=True, unit="m") for radius in radii)
        self.preload = scalar(preload, f"{name}'s preload", non_negative=True, unit="N")
        self.count = len(self.radii)
        self._sized("tension", "N")
        self.pieces = [[self._port(Translational, f"piece_{k}_{i}") for i in range(n)] for k, n in enumerate(sections)]
        self.shafts = [self._port(Rotational, f"shaft_{k}") for k in range(self.count)]

    def _sized(self, name: str, unit: str) -> None:
        """The variable of this name has an entry for each section."""
        vars(self)[name] = Variable(unit, "of each section", size=self.count, name=name)

    def _port(self, kind: type[Any], name: str) -> Any:
        port = kind(self, name, must_connect=True, if_unconnected="Connect all its flanges.")
        setattr(self, name, port)
        return port

    @property
    def speeds(self) -> list[Expression]:
        """Of the wheels' rims [m/s]."""
        return [radius * der(shaft.phi) for radius, shaft in zip(self.radii, self.shafts, strict=True)]

    @final
    def equations(self) -> Iterable[Equation]:
        T = self.tension
        for k, (radius, shaft) in enumerate(zip(self.radii, self.shafts, strict=True)):
            yield equal(shaft.tau, radius * (T[k] - T[(k + 1) % self.count]))
        for k, section in enumerate(self.pieces):
            for port in section:
                yield equal(port.f, T[k])
        yield from self.pulls()


@final
class StiffBelt(AbstractBelt):
    """It does not stretch, on wheels whose centres stay where they are: r_k phi_k' are all the same; the mean of T is the `preload` [N]. A part of `Belt`."""

    def __init__(self, radii: Sequence[float | Expression], sections: Sequence[int], preload: Scalar) -> None:
        self._around(radii, sections, preload)

    def pulls(self) -> Iterable[Equation]:
        yield equal(sum((self.tension[k] for k in range(1, self.count)), 1.0 * self.tension[0]), self.count * self.preload)
        for speed in self.speeds[1:]:
            yield equal(speed, self.speeds[0])


@final
class ElasticBelt(AbstractBelt):
    """T_k = preload + stiffness e_k + damping e_k' by the stretch e_k of section k: e_k' = S_k' + r_k phi_k' - r_(k-1) phi_(k-1)', S_k its length.

    `preload` [N], where the stretch is zero; `stiffness` [N/m] > 0, `damping` [N*s/m] of each section. Stores preload e + stiffness e^2 / 2. A part of `Belt`.
    """

    stretch = Variable("m", "of each section, against where its pull is the preload")

    def __init__(
        self,
        radii: Sequence[float | Expression],
        sections: Sequence[int],
        preload: Scalar,
        stiffness: Scalar,
        damping: Scalar = 0.0,
    ) -> None:
        self._around(radii, sections, preload)
        self._sized("stretch", "m")
        self.stiffness = scalar(stiffness, "ElasticBelt's stiffness", positive=True, unit="N/m")
        self.damping = scalar(damping, "ElasticBelt's damping", non_negative=True, unit="N*s/m")

    def pulls(self) -> Iterable[Equation]:
        speeds, e = self.speeds, self.stretch
        for k, section in enumerate(self.pieces):
            lengthens = sum((der(port.s) for port in section[1:]), der(section[0].s))
            yield equal(der(e[k]), lengthens + speeds[k] - speeds[k - 1])
            yield equal(self.tension[k], self.preload + self.stiffness * e[k] + self.damping * der(e[k]))

    def stored_energy(self) -> Expression:
        return sum((self.preload * e + 0.5 * self.stiffness * e * e for e in self._each()), 0.0 * self.stretch[0])

    def dissipated_power(self) -> Expression:
        return sum((self.damping * der(e) * der(e) for e in self._each()), 0.0 * self.stretch[0])

    def _each(self) -> list[Expression]:
        return [self.stretch[k] for k in range(self.count)]


@final
class SlippingBelt(AbstractBelt):
    """Over two wheels, stiff, it drives them by at most `holding` [N], and slips with `sliding`: T = preload -+ drive / 2. A part of `Belt`.

    `drive` [N]: what it drives the second rim forward with, and the first back against.
    """

    def __init__(self, radius_a: Scalar, radius_b: Scalar, preload: Scalar, sliding: Scalar, holding: Scalar) -> None:
        given = ((radius_a, "radius_a"), (radius_b, "radius_b"))
        self._around(
            [scalar(radius, f"SlippingBelt's {name}", positive=True, unit="m") for radius, name in given], [1, 1], preload
        )
        self.sliding = scalar(sliding, "SlippingBelt's sliding", non_negative=True, unit="N")
        self.holding = scalar(holding, "SlippingBelt's holding", non_negative=True, unit="N")
        self.drive = Reaction("N", "what it drives the first rim forward with")

    @property
    def slip(self) -> Expression:
        """How much faster the first rim runs than the second [m/s]."""
        return self.speeds[0] - self.speeds[1]

    def pulls(self) -> Iterable[Equation]:
        yield equal(self.tension[0], self.preload - 0.5 * self.drive)
        yield equal(self.tension[1], self.preload + 0.5 * self.drive)

    def laws(self) -> Iterable[ModeLaw]:
        yield DryFriction(self.drive, self.slip, self.sliding, self.holding)

    def dissipated_power(self) -> Expression:
        return -1.0 * self.drive * self.slip


@final
class Belt(System):
    """A closed belt, chain or toothed belt without mass around `pulleys`, two or more, in the order in which it runs.

    `Pulley`'s `middle` is about the middle of the arc on which the belt lies, `along` where it runs there; pulleys that turn in opposite senses make it a
    crossed one. Each `wheel` is put on a hinge, `hinges` in turn, whose flange drives it or is driven; a pulley without one only leads it, without friction.
    `preload` [N]: its pull at rest; the mean of all sections in a motion. `tension` [N]: of each section, the first one
    comes on the first wheel; where it is negative a real belt hangs loose. It acts on the frames that carry the pulleys.

    Without `stiffness` it does not stretch, and its pulleys are to stay as far apart as they are: the speeds of all rims are the same. `stiffness` [N/m] > 0,
    `damping` [N*s/m]: of each section; pulleys may then move, such as one that tightens it. `friction`: Coulomb(...), on two pulleys that both have wheels and
    without stiffness: it slips on the one with the smaller angle of wrap alpha where one side pulls exp(mu alpha) times as much as the other (Euler and
    Eytelwein): at 2 preload tanh(mu alpha / 2).

        left = Pulley(scene.world.frame, 0.1, middle="-x", along="z", wheel=scene.motor)
        right = Pulley(scene.world.at((1, 0, 0)), 0.2, middle="x", along="-z", wheel=scene.mill)
        scene.belt = Belt([left, right], preload=200.0, friction=Coulomb(0.3))
    """

    def __init__(
        self,
        pulleys: Sequence[Pulley],
        preload: Scalar,
        stiffness: Scalar | None = None,
        damping: Scalar = 0.0,
        friction: Coulomb | None = None,
    ) -> None:
        run: Any = pulleys
        if not isinstance(run, list | tuple) or len(pulleys) < 2:
            raise ParameterError(
                f"Belt's pulleys are {shown(pulleys)} ({origin()}). Give a list of two or more, e.g. [Pulley(...), Pulley(...)]."
            )
        around = [checked_pulley(pulley, "Belt") for pulley in pulleys]
        first = next((k for k, pulley in enumerate(around) if pulley.wheel), None)
        if first is None:
            raise ParameterError(
                f"No pulley of a Belt has a wheel ({origin()}): it would drive nothing. Give Pulley(frame, radius, wheel=body)."
            )
        self.pulleys = [*around[first:], *around[:first]]
        self.pieces = [CommonTangent(a, b) for a, b in itertools.pairwise([*self.pulleys, self.pulleys[0]])]
        for piece in self.pieces:
            self.connect(piece.pulley_a.frame, piece.frame_a)
            self.connect(piece.pulley_b.frame, piece.frame_b)
        wheels = [(k, pulley, pulley.wheel) for k, pulley in enumerate(self.pulleys) if pulley.wheel]
        # the last section of pieces ends at the first wheel: it is the first of the sections
        ends = [*(k for k, _, _ in wheels), len(self.pulleys)]
        sections = [self.pieces[a:b] for a, b in itertools.pairwise(ends)]
        sections = [sections[-1], *sections[:-1]]
        radii, counts = [pulley.radius for _, pulley, _ in wheels], [len(section) for section in sections]
        self.tie: StiffBelt | ElasticBelt | SlippingBelt
        if friction is not None:
            limits = self._limits(friction, preload, stiffness)
            self.tie = SlippingBelt(self.pulleys[0].radius, self.pulleys[1].radius, preload, *limits)
        elif stiffness is not None:
            self.tie = ElasticBelt(radii, counts, preload, stiffness, damping)
        else:
            self.tie = StiffBelt(radii, counts, preload)
        if stiffness is None and not _is_zero(scalar(damping, "Belt's damping", non_negative=True, unit="N*s/m")):
            raise ParameterError(
                f"A Belt with damping {shown(damping)} has no stiffness ({origin()}): it does not stretch. Give both, or neither."
            )
        for section, ports in zip(sections, self.tie.pieces, strict=True):
            for piece, port in zip(section, ports, strict=True):
                self.connect(piece.flange, port)
        self.hinges = [Revolute(pulley.axis) for _, pulley, _ in wheels]
        for hinge, (_, pulley, wheel), shaft in zip(self.hinges, wheels, self.tie.shafts, strict=True):
            assert isinstance(wheel, RigidBody)
            self.connect(pulley.frame, hinge.frame_a)
            self.connect(hinge.frame_b, wheel.frame)
            self.connect(hinge.flange, shaft)

    @property
    def tension(self) -> Variable:
        """Pull of each section [N]."""
        return self.tie.tension

    @property
    def length(self) -> Expression:
        """Of the whole belt [m]."""
        lengths: list[Expression] = [port.s for section in self.tie.pieces for port in section]
        return sum(lengths[1:], 1.0 * lengths[0])

    @property
    def slip(self) -> Expression:
        """How much faster the rim of the first wheel runs than that of the second [m/s]."""
        return self.tie.speeds[0] - self.tie.speeds[1]

    @property
    def wraps(self) -> list[Expression]:
        """Angles on which it lies on each pulley [rad], from the first one with a wheel on."""
        arcs = [piece.arcs(pose_between(piece.frame_a, piece.frame_b)) for piece in self.pieces]
        return [read(leaving[0] + coming[1]) / pulley.radius for pulley, leaving, coming in zip(self.pulleys, arcs, [arcs[-1], *arcs[:-1]], strict=True)]  # fmt: skip

    def _limits(self, friction: object, preload: Scalar, stiffness: Scalar | None) -> tuple[Expression, Expression]:
        """Of what it drives the wheels with [N], where it slips and where it holds. Raises `ParameterError`."""
        if not isinstance(friction, Coulomb):
            raise ParameterError(
                f"Belt's friction is {shown(friction)} ({origin()}). Give Coulomb(0.3), or None where it does not slip."
            )
        if stiffness is not None or len(self.pulleys) != 2 or not all(pulley.wheel for pulley in self.pulleys):
            raise ParameterError(
                f"A Belt slips on two pulleys that both have wheels, and without stiffness ({origin()}): which section slips on which of more is not told by "
                "the preload. Leave friction out, or drive them in pairs."
            )
        mean = scalar(preload, "Belt's preload", non_negative=True, unit="N")
        least = read(ca.fmin(*(wrap.sx for wrap in self.wraps)))
        slips, holds = (2.0 * mean * read(ca.tanh(0.5 * (mu * least).sx)) for mu in (friction.mu, friction.static))
        return slips, holds


def _is_zero(value: float | Expression) -> bool:
    return not isinstance(value, Expression) and value == 0
