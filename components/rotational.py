"""Rotational mechanics on shafts: inertia, spring, damper, gear, sources. Torques flow positive into the component."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any, final

import acausal.language.expression as language
from acausal.errors import ParameterError
from acausal.language.component import Component
from acausal.language.connector import Rotational
from acausal.language.equation import Equation, der, equal
from acausal.language.expression import Expression, Scalar, Variable, scalar
from acausal.language.origin import origin
from components.flanges import asked

_HELD = "Connect both flanges; to hold one, connect it to a RotationalGround."


def not_zero(value: float | Expression, what: str) -> float | Expression:
    """The value of a ratio; raises `ParameterError` for 0, also as the value of a parameter."""
    return asked(value, functools.partial(_check_not_zero, what=what))


def _check_not_zero(value: float, what: str) -> None:
    if value == 0.0:
        raise ParameterError(f"{what} is 0 ({origin()}): nothing would be transmitted. Give a number that is not zero.")


@final
class RotationalGround(Component):
    """A shaft's end held at angle 0."""

    flange = Rotational.port()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.phi, 0.0)


@final
class Inertia(Component):
    """Rotating inertia between two flanges: inertia der(w) = tau_a + tau_b. `inertia` [kg m^2] > 0. Stores inertia w^2 / 2.

    scene.rotor = Inertia(0.01)
    """

    flange_a = Rotational.port()
    flange_b = Rotational.port()
    phi = Variable("rad", "angle")
    w = Variable("rad/s", "angular velocity")

    def __init__(self, inertia: Scalar) -> None:
        self.inertia = scalar(inertia, "Inertia's inertia", positive=True, unit="kg*m^2")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_a.phi, self.phi)
        yield equal(self.flange_b.phi, self.phi)
        yield equal(der(self.phi), self.w)
        yield equal(self.inertia * der(self.w), self.flange_a.tau + self.flange_b.tau)

    def stored_energy(self) -> Expression:
        return 0.5 * self.inertia * self.w * self.w


@final
class RotationalSpring(Component):
    """Torsion spring between two flanges: tau_b = stiffness (phi_b - phi_a - natural_angle) = -tau_a. [N*m/rad], [rad].

    scene.spring = RotationalSpring(stiffness=5.0)
    """

    flange_a = Rotational.port(must_connect=True, if_unconnected=_HELD)
    flange_b = Rotational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, stiffness: Scalar, natural_angle: Scalar = 0.0) -> None:
        self.stiffness = scalar(stiffness, "RotationalSpring's stiffness", non_negative=True, unit="N*m/rad")
        self.natural_angle = scalar(natural_angle, "RotationalSpring's natural_angle", unit="rad")

    def _stretch(self) -> Expression:
        return self.flange_b.phi - self.flange_a.phi - self.natural_angle

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_b.tau, self.stiffness * self._stretch())
        yield equal(self.flange_a.tau, -self.flange_b.tau)

    def stored_energy(self) -> Expression:
        return 0.5 * self.stiffness * self._stretch() * self._stretch()


@final
class RotationalDamper(Component):
    """Damper between two flanges: tau_b = damping (w_b - w_a) = -tau_a. `damping` [N*m*s/rad] >= 0; dissipates damping (w_b - w_a)^2.

    scene.bearing = RotationalDamper(damping=0.1)
    """

    flange_a = Rotational.port(must_connect=True, if_unconnected=_HELD)
    flange_b = Rotational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, damping: Scalar) -> None:
        self.damping = scalar(damping, "RotationalDamper's damping", non_negative=True, unit="N*m*s/rad")

    def _rate(self) -> Expression:
        return der(self.flange_b.phi) - der(self.flange_a.phi)

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_b.tau, self.damping * self._rate())
        yield equal(self.flange_a.tau, -self.flange_b.tau)

    def dissipated_power(self) -> Expression:
        return self.damping * self._rate() * self._rate()


@final
class Gear(Component):
    """Ideal gear without mass: phi_a = ratio phi_b, ratio tau_a + tau_b = 0. `ratio` is not zero.

    scene.gearbox = Gear(ratio=50)
    """

    flange_a = Rotational.port(must_connect=True, if_unconnected=_HELD)
    flange_b = Rotational.port(must_connect=True, if_unconnected=_HELD)

    def __init__(self, ratio: Scalar) -> None:
        self.ratio = not_zero(scalar(ratio, "Gear's ratio", unit="1"), "Gear's ratio")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange_a.phi, self.ratio * self.flange_b.phi)
        yield equal(self.ratio * self.flange_a.tau + self.flange_b.tau, 0.0)


@final
class TorqueSource(Component):
    """A torque on a flange: tau = -torque, so that a positive `torque` [N*m] drives it forward. Constant, input, or function of time.

    scene.motor = TorqueSource(ac.Input("N*m"))
    """

    flange = Rotational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or an inertia.")

    def __init__(self, torque: Scalar | Callable[[Any], Any]) -> None:
        self.torque = scalar(language.of_time(torque), "TorqueSource's torque", unit="N*m")

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.tau, -self.torque)

    def supplied_power(self) -> Expression:
        return self.torque * der(self.flange.phi)


@final
class AngleSource(Component):
    """A given angle: phi = angle [rad], constant, parameter, input, or function of time. Supplies -tau der(phi).

    What has inertia takes two rates of an input too: they follow from a number (held), an expression of `ac.time`, a smooth spline, or a function that
    takes these; of any other function give them with the value, inputs={scene.angle: (function, function of its rate, function of its second rate)}.

    scene.crank = AngleSource(lambda t: 2 * np.sin(t))
    """

    flange = Rotational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or an inertia.")

    def __init__(self, angle: Scalar | Callable[[Any], Any]) -> None:
        self.angle = scalar(language.of_time(angle), "AngleSource's angle", unit="rad")

    def given_motions(self) -> tuple[Expression, ...]:
        return (self.angle,) if isinstance(self.angle, Expression) else ()

    def equations(self) -> Iterable[Equation]:
        yield equal(self.flange.phi, self.angle)

    def supplied_power(self) -> Expression:
        return -1.0 * self.flange.tau * der(self.flange.phi)


@final
class SpeedSource(Component):
    """A given speed: der(phi) = speed [rad/s], constant, parameter, input, or function of time; phi is a state. Supplies -tau speed.

    What has inertia takes the rate of an input too: it follows from a number, an expression of `ac.time`, or a function that takes one; of any
    other function give it with the value, inputs={scene.speed: (function, function of its rate)}.

    scene.spindle = SpeedSource(10.0)
    """

    flange = Rotational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or an inertia.")

    def __init__(self, speed: Scalar | Callable[[Any], Any]) -> None:
        self.speed = scalar(language.of_time(speed), "SpeedSource's speed", unit="rad/s")

    def equations(self) -> Iterable[Equation]:
        yield equal(der(self.flange.phi), self.speed)

    def supplied_power(self) -> Expression:
        return -1.0 * self.flange.tau * self.speed


@final
class AngularAccelerationSource(Component):
    """A given angular acceleration: der(v) = acceleration [rad/s^2], der(phi) = v; constant, parameter, input, function of time, or any
    expression of the scene. phi and v are states. Supplies -tau v.

    scene.spindle = AngularAccelerationSource(ac.Input("rad/s^2"))
    """

    flange = Rotational.port(must_connect=True, if_unconnected="It drives nothing: connect it to a joint's flange or an inertia.")
    v = Variable("rad/s", "angular velocity")

    def __init__(self, acceleration: Scalar | Callable[[Any], Any]) -> None:
        self.acceleration = scalar(language.of_time(acceleration), "AngularAccelerationSource's acceleration", unit="rad/s^2")

    def equations(self) -> Iterable[Equation]:
        yield equal(der(self.flange.phi), self.v)
        yield equal(der(self.v), self.acceleration)

    def supplied_power(self) -> Expression:
        return -1.0 * self.flange.tau * self.v
