"""Translational mechanics along a line: mass, spring, damper, source. Forces flow positive into the component."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, final

import acausal.language.expression as language
from acausal.language.component import Component
from acausal.language.connector import Translational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Scalar, Variable, scalar

_HELD = "Connect both flanges; to hold one, connect it to a TranslationalGround."


@final
class TranslationalGround(Component):
    """A rod's end held at position 0."""

    flange = Translational.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.s, 0.0)


@final
class SlidingMass(Component):
    """Mass between two flanges: mass der(v) = f_a + f_b. `mass` [kg] > 0. Stores mass v^2 / 2.

    scene.slider = SlidingMass(2.0)
    """

    flange_a = Translational.port()
    flange_b = Translational.port()
    s = Variable("m", "position")
    v = Variable("m/s", "velocity")

    def __init__(self, mass: Scalar) -> None:
        self.mass = scalar(mass, "SlidingMass's mass", positive=True, unit="kg")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_a.s, self.s)
        yield equal(self.flange_b.s, self.s)
        yield equal(der(self.s), self.v)
        yield equal(self.mass * der(self.v), self.flange_a.f + self.flange_b.f)

    def stored_energy(self) -> Expression:
        return 0.5 * self.mass * self.v * self.v


@final
class TranslationalSpring(Component):
    """Spring between two flanges: f_b = stiffness (s_b - s_a - natural_length) = -f_a. [N/m], [m].

    scene.spring = TranslationalSpring(stiffness=100.0)
    """

    flange_a = Translational.port(must_connect=True, if_unconnected=_HELD)
    flange_b = Translational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, stiffness: Scalar, natural_length: Scalar = 0.0) -> None:
        self.stiffness = scalar(stiffness, "TranslationalSpring's stiffness", non_negative=True, unit="N/m")
        self.natural_length = scalar(natural_length, "TranslationalSpring's natural_length", unit="m")

    def _stretch(self) -> Expression:
        return self.flange_b.s - self.flange_a.s - self.natural_length

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_b.f, self.stiffness * self._stretch())
        yield equal(self.flange_a.f, -self.flange_b.f)

    def stored_energy(self) -> Expression:
        return 0.5 * self.stiffness * self._stretch() * self._stretch()


@final
class TranslationalDamper(Component):
    """Damper between two flanges: f_b = damping (v_b - v_a) = -f_a. `damping` [N*s/m] >= 0; dissipates damping (v_b - v_a)^2.

    scene.friction = TranslationalDamper(damping=0.5)
    """

    flange_a = Translational.port(must_connect=True, if_unconnected=_HELD)
    flange_b = Translational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, damping: Scalar) -> None:
        self.damping = scalar(damping, "TranslationalDamper's damping", non_negative=True, unit="N*s/m")

    def _rate(self) -> Expression:
        return der(self.flange_b.s) - der(self.flange_a.s)

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_b.f, self.damping * self._rate())
        yield equal(self.flange_a.f, -self.flange_b.f)

    def dissipated_power(self) -> Expression:
        return self.damping * self._rate() * self._rate()


@final
class ForceSource(Component):
    """A force on a flange: f = -force, so that a positive `force` [N] drives it forward. Constant, input, or function of time.

    scene.push = ForceSource(ac.Input("N"))
    """

    flange = Translational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or a mass.")

    def __init__(self, force: Scalar | Callable[[Any], Any]) -> None:
        self.force = scalar(language.of_time(force), "ForceSource's force", unit="N")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.f, -self.force)

    def supplied_power(self) -> Expression:
        return self.force * der(self.flange.s)


@final
class PositionSource(Component):
    """A given position: s = position [m], constant, parameter, input, or function of time. Supplies -f der(s).

    What has inertia takes two rates of an input too: they follow from a number (held), an expression of `ac.time`, a smooth spline, or a function that
    takes these; of any other function give them with the value, inputs={scene.position: (function, function of its rate, function of its second rate)}.

    scene.shaker = PositionSource(lambda t: 0.01 * np.sin(50 * t))
    """

    flange = Translational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or a mass.")

    def __init__(self, position: Scalar | Callable[[Any], Any]) -> None:
        self.position = scalar(language.of_time(position), "PositionSource's position", unit="m")

    def given_motions(self) -> tuple[Expression, ...]:
        return (self.position,) if isinstance(self.position, Expression) else ()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.s, self.position)

    def supplied_power(self) -> Expression:
        return -1.0 * self.flange.f * der(self.flange.s)


@final
class VelocitySource(Component):
    """A given velocity: der(s) = velocity [m/s], constant, parameter, input, or function of time; s is a state. Supplies -f velocity.

    scene.belt = VelocitySource(0.5)
    """

    flange = Translational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or a mass.")

    def __init__(self, velocity: Scalar | Callable[[Any], Any]) -> None:
        self.velocity = scalar(language.of_time(velocity), "VelocitySource's velocity", unit="m/s")

    def equations(self) -> Iterable[Equation]:
        yield equal(der(self.flange.s), self.velocity)

    def supplied_power(self) -> Expression:
        return -1.0 * self.flange.f * self.velocity


@final
class AccelerationSource(Component):
    """A given acceleration: der(v) = acceleration [m/s^2], der(s) = v; constant, parameter, input, function of time, or any
    expression of the scene. s and v are states. Supplies -f v.

    scene.sledge = AccelerationSource(ac.Input("m/s^2"))
    """

    flange = Translational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or a mass.")
    v = Variable("m/s", "velocity")

    def __init__(self, acceleration: Scalar | Callable[[Any], Any]) -> None:
        self.acceleration = scalar(language.of_time(acceleration), "AccelerationSource's acceleration", unit="m/s^2")

    def equations(self) -> Iterable[Equation]:
        yield equal(der(self.flange.s), self.v)
        yield equal(der(self.v), self.acceleration)

    def supplied_power(self) -> Expression:
        return -1.0 * self.flange.f * self.v
